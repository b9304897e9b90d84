"""The identified parameters beside the nominal ones."""

from dataclasses import dataclass

from mbot_protocol.calibration import Interval, MotionCalibration, MotorCalibration
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.elements import paragraph, table
from mbot_workstation.simulation.robot_parameters import MotorParameters, RobotParameters
from mbot_workstation.variation.presets import measured


@dataclass(frozen=True, slots=True)
class _Line:
    """One parameter; `name` is its key in motion.toml."""

    name: str
    words: str
    value: float
    nominal: float
    factor: float = 1.0
    digits: int = 1


def parameter_section(files: CalibrationFiles) -> str:
    """HTML."""
    heading = "<h2>Identified parameters</h2>"
    motion = files.motion
    if motion is None:
        return heading + paragraph("None yet; the command is named at the top.", "soft")
    lines = _lines(motion)
    rows = [
        [
            line.words,
            _number(line, line.value),
            _interval(line, motion.intervals.get(line.name)),
            _number(line, line.nominal),
        ]
        for line in lines
    ]
    text = heading + table(["", "identified", "95 % interval", "nominal"], rows, numbers=3)
    if motion.undetermined:
        reasons = [[name, why] for name, why in motion.undetermined.items()]
        text += paragraph("What the recordings can't tell, and why:") + table(["", ""], reasons)
    return text


def _lines(motion: MotionCalibration) -> list[_Line]:
    robot = RobotParameters()
    nominal_latency_ms = measured().action_latency_ms
    return [
        *_motor_lines("left", motion.left_motor, robot.left_motor),
        *_motor_lines("right", motion.right_motor, robot.right_motor),
        *_optional_lines(motion, robot),
        _Line("track_m", "track, mm", motion.track_m, robot.track_m, 1000),
        _Line(
            "wheel_radius_m",
            "wheel radius, mm",
            motion.wheel_radius_m,
            robot.wheel_radius_m,
            1000,
            2,
        ),
        _Line("free_speed_rpm", "free speed, rpm", motion.free_speed_rpm, robot.free_speed_rpm),
        _Line("load_loss", "lost under load, %", motion.load_loss, robot.load_loss, 100),
        _Line(
            "turning_drag_n_m",
            "drag in turns, N mm",
            motion.turning_drag_n_m,
            robot.turning_drag_n_m,
            1000,
        ),
        _Line(
            "wheel_friction",
            "wheel friction",
            motion.wheel_friction,
            robot.wheel_friction,
            digits=2,
        ),
        _Line("latency_ms", "latency, ms", motion.latency_ms, nominal_latency_ms),
    ]


def _optional_lines(motion: MotionCalibration, robot: RobotParameters) -> list[_Line]:
    lines = [
        _Line(
            "inertia_scale", "moment of inertia, of the body's", motion.inertia_scale, 1, digits=2
        )
    ]
    if motion.mass_ahead_m is not None:
        ahead = motion.mass_ahead_m, robot.centre_of_mass_m
        lines.append(_Line("mass_ahead_m", "centre of mass ahead of the axle, mm", *ahead, 1000))
    return lines


def _motor_lines(side: str, motor: MotorCalibration, nominal: MotorParameters) -> list[_Line]:
    key = f"{side}_motor"
    return [
        _Line(f"{key}.gain", f"{side} motor: gain", motor.gain, nominal.gain, digits=4),
        _Line(
            f"{key}.backward_share",
            f"{side} motor: backward, of forward",
            motor.backward_share,
            nominal.backward_share,
            digits=4,
        ),
        _Line(
            f"{key}.dead_band",
            f"{side} motor: dead band, of 255",
            motor.dead_band,
            255 * nominal.dead_band,
        ),
        _Line(
            f"{key}.time_constant_ms",
            f"{side} motor: time constant, ms",
            motor.time_constant_ms,
            1000 * nominal.time_constant_s,
        ),
        _Line(
            f"{key}.dry_friction",
            f"{side} motor: dry friction, %",
            motor.dry_friction,
            nominal.dry_friction,
            100,
        ),
    ]


def _number(line: _Line, value: float) -> str:
    return f"{line.factor * value:.{line.digits}f}"


def _interval(line: _Line, interval: Interval | None) -> str:
    if interval is None:
        return ""
    return f"{_number(line, interval.low)} to {_number(line, interval.high)}"

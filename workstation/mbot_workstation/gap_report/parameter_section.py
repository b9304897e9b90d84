"""The identified parameters beside the nominal ones."""

from mbot_protocol.calibration import Interval, MotionCalibration
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles, motion_value
from mbot_workstation.gap_report.elements import paragraph, table
from mbot_workstation.simulation.parameter_table import BY_NAME, PARAMETERS, Parameter, value
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.variation.presets import measured


def parameter_section(files: CalibrationFiles) -> str:
    """HTML."""
    heading = "<h2>Identified parameters</h2>"
    motion = files.motion
    if motion is None:
        return heading + paragraph("None yet; the command is named at the top.", "soft")
    rows = [row for one in PARAMETERS if (row := _row(motion, one)) is not None]
    rows.append(_latency(motion))
    text = heading + table(["", "identified", "95 % interval", "nominal"], rows, numbers=3)
    if motion.undetermined:
        words = {one.file_key: one.words for one in BY_NAME.values()}
        reasons = [[words.get(key, key), why] for key, why in motion.undetermined.items()]
        text += paragraph("What the recordings can't tell, and why:") + table(["", ""], reasons)
    return text


def _row(motion: MotionCalibration, known: Parameter) -> list[str] | None:
    found = motion_value(motion, known)
    if found is None:
        return None
    nominal = value(RobotParameters(), known.name)
    interval = _words(motion.intervals.get(known.file_key), known.shown_factor / known.file_factor)
    return [
        known.words,
        f"{known.shown_factor * found:.4g}",
        interval,
        f"{known.shown_factor * nominal:.4g}",
    ]


def _latency(motion: MotionCalibration) -> list[str]:
    interval = _words(motion.intervals.get("latency_ms"), 1.0)
    nominal = measured().action_latency_ms
    return ["latency [ms]", f"{motion.latency_ms:.4g}", interval, f"{nominal:.4g}"]


def _words(interval: Interval | None, factor: float) -> str:
    if interval is None:
        return ""
    return f"{factor * interval.low:.4g} to {factor * interval.high:.4g}"

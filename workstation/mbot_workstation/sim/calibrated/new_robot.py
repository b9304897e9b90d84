"""Another robot from a ruler and a stopwatch: its calibration folder, and what its daemon is told.

The body is the nominal robot's, moved apart to this wheelbase and down to these wheels: what is
weighed and driven later replaces it, file by file.
"""

from dataclasses import dataclass
from datetime import date
from math import pi
from pathlib import Path

from mbot_protocol.drive.calibration import MOTION_FILE, check_range
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.wire.keys import check_robot_id
from mbot_workstation.sim.body.robot_parameters import BoxBody, RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import (
    BODY_FILE,
    BodyCalibration,
    Component,
    MountCalibration,
)
from mbot_workstation.sim.calibrated.calibration_folder import write_body, write_motion
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration, MotorCalibration
from mbot_workstation.sim.effects.presets import KNOWN

CONFIG_FILE = "config.toml"
CHASSIS = "chassis"
CLEARANCE_M = 0.002

_HEAD = """\
# {name}: /etc/mbot-agent/config.toml, with the other files of this folder in
# /etc/mbot-agent/calibration. All settings: deploy/config.toml; which wires: docs/other-robots.md.
robot_id = "{name}"
calibration = "calibration"

[board]
kind = "{kind}"
"""
_STRAIGHT = """
# Wired so that both wheels roll forward when their motors run forward.
[motors.left]
reversed = false
"""
CONFIG = {
    "mcore": _HEAD,
    "serial-line": f"""{_HEAD}# The board's port; /dev/serial/by-id/... is stable.
port = "/dev/ttyUSB0"
{_STRAIGHT}""",
    "gpio": f"""{_HEAD}# Pins may stay on if the daemon is killed: true where that does no harm.
accept_no_deadman = false

[board.gpio]
left = [17, 27]
right = [22, 23]
enable = []
{_STRAIGHT}""",
}
"""By kind of board."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRobot:
    """What a person knows of a robot that was just put together.

    Attributes:
        name: its robot_id.
        board: a key of CONFIG.
        wheelbase_m: between the wheels' centres.
        wheel_diameter_m: of both.
        top_speed_m_s: of the whole robot, straight ahead at full duty.
        camera_height_m, camera_ahead_m, camera_pitch_deg: see `CameraMount`.
        mass_kg: of the whole robot.

    Raises:
        ConfigurationError: a value is out of its range.

    """

    name: str
    board: str
    wheelbase_m: float
    wheel_diameter_m: float
    top_speed_m_s: float
    camera_height_m: float
    camera_ahead_m: float
    camera_pitch_deg: float
    mass_kg: float

    def __post_init__(self) -> None:
        check_robot_id(self.name)
        if self.board not in CONFIG:
            raise ConfigurationError(
                f"--board is {self.board!r}, expected one of {', '.join(CONFIG)}"
            )
        least, most = (self.top_speed_at(rpm) for rpm in (20, 600))
        for option, value, low, high in (
            ("--wheelbase [mm]", 1000 * self.wheelbase_m, 60, 300),
            ("--wheel-diameter [mm]", 1000 * self.wheel_diameter_m, 20, 150),
            ("--top-speed [m/s]", self.top_speed_m_s, round(least, 2), round(most, 2)),
            ("--camera-height [mm]", 1000 * self.camera_height_m, 20, 400),
            ("--camera-ahead [mm]", 1000 * self.camera_ahead_m, -200, 300),
            ("--camera-pitch [degrees]", self.camera_pitch_deg, -45, 60),
            ("--mass [g]", 1000 * self.mass_kg, 200, 2500),
        ):
            try:
                check_range(option, round(value, 6), low, high)
            except ValueError as error:
                raise ConfigurationError(str(error)) from None

    def top_speed_at(self, free_speed_rpm: float) -> float:
        """In m/s, of wheels that turn so fast without load."""
        nominal = RobotParameters()
        return free_speed_rpm / 60 * pi * self.wheel_diameter_m * (1 - nominal.load_loss)

    @property
    def free_speed_rpm(self) -> float:
        """Of a wheel without load, at this top speed."""
        return self.top_speed_m_s / self.top_speed_at(1)

    def body(self) -> BodyCalibration:
        """The nominal robot's parts around these wheels."""
        nominal = RobotParameters()
        wider = self.wheelbase_m / nominal.track_m
        heavier = self.mass_kg / nominal.mass_kg
        return BodyCalibration(
            components=tuple(self._component(part, wider, heavier) for part in nominal.bodies),
            camera_mount=MountCalibration(
                height_m=self.camera_height_m,
                ahead_m=self.camera_ahead_m,
                pitch_down_deg=self.camera_pitch_deg,
            ),
            wheel_mass_kg=_rounded(nominal.wheel_mass_kg * heavier),
            wheel_radius_m=_rounded(self.wheel_diameter_m / 2),
            track_m=self.wheelbase_m,
            caster_ahead_m=_rounded(nominal.caster_ahead_m * wider),
            touch_radius_m=_rounded(nominal.touch_radius_m * wider),
        )

    def _component(self, part: BoxBody, wider: float, heavier: float) -> Component:
        nominal = RobotParameters()
        length_m, width_m, height_m = part.size_m
        if part.name == CHASSIS:
            length_m, width_m = length_m * wider, width_m * wider
        ahead_m, left_m, z_m = part.centre_m
        z_m += self.wheel_diameter_m / 2 - nominal.wheel_radius_m
        ahead_m *= wider
        if part.name == "camera":  # its lens is at the front of it
            ahead_m, z_m = self.camera_ahead_m - length_m / 2 - 0.003, self.camera_height_m
        z_m = max(z_m, height_m / 2 + CLEARANCE_M)
        mass_kg = _rounded(part.mass_kg * heavier)
        return Component(
            name=part.name,
            mass_kg=mass_kg,
            mass_uncertainty_kg=_rounded(mass_kg / 3),
            size_m=(_rounded(length_m), _rounded(width_m), height_m),
            centre_m=(_rounded(ahead_m), _rounded(left_m * wider), _rounded(z_m)),
            source="assumed: an mBot's part, moved and scaled by `workstation robot new`",
            centre_uncertainty_m=0.02,
            colour_rgb=part.colour_rgb,
        )

    def motion(self) -> MotionCalibration:
        """Usual motors, as fast as these."""
        return MotionCalibration(
            left_motor=MotorCalibration(),
            right_motor=MotorCalibration(),
            free_speed_rpm=round(self.free_speed_rpm, 1),
            latency_ms=KNOWN.action_latency_ms,
            made_on=date.today().isoformat(),
        )


def _rounded(value: float) -> float:
    return round(value, 5)


def write_new_robot(robot: NewRobot, folder: Path) -> list[Path]:
    """Write its files into a folder that has none of them; their paths.

    Raises:
        ConfigurationError: one is there already, a part of the body can't be, or can't be written.

    """
    for name in (BODY_FILE, MOTION_FILE, CONFIG_FILE):
        if (folder / name).exists():
            raise ConfigurationError(f"{folder / name} exists already: choose another --output")
    try:
        body, motion = robot.body(), robot.motion()
    except ValueError as error:
        raise ConfigurationError(f"no such robot can be simulated: {error}") from None
    config = folder / CONFIG_FILE
    written = [write_body(folder, body), write_motion(folder, motion), config]
    text = CONFIG[robot.board].format(name=robot.name, kind=robot.board)
    try:
        atomic_file.replace(config, text.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {config}: {error.strerror}") from None
    return written

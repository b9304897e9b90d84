"""The calibration folder of one robot: its files, and the simulated robot they describe.

camera.toml                both sides read it: `mbot_protocol.drive.calibration`
motion.toml                both sides; of the motion the daemon reads how to drive the motors only
body.toml, light.toml      the simulation's alone
rooms/*.jpg, *.png         panoramas of this robot's rooms
"""

from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import Struct

from mbot_protocol.drive.calibration import (
    CAMERA_FILE,
    MOTION_FILE,
    CameraCalibration,
    read_camera,
    read_part,
)
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.body.robot_parameters import (
    BoxBody,
    CameraMount,
    RobotParameters,
)
from mbot_workstation.sim.calibrated.body_calibration import BODY_FILE, BodyCalibration
from mbot_workstation.sim.calibrated.light_calibration import LIGHT_FILE, LightCalibration
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration, read_motion
from mbot_workstation.sim.calibrated.motion_ranges import narrowed
from mbot_workstation.sim.calibrated.toml_writer import write_toml
from mbot_workstation.sim.effects.effects import EffectRanges, RealWorldEffects
from mbot_workstation.sim.effects.presets import KNOWN, preset
from mbot_workstation.sim.scene.scene_parameters import Light, SceneParameters
from mbot_workstation.wording import typed

ROOMS_FOLDER = "rooms"
ROOM_SUFFIXES = (".jpg", ".jpeg", ".png")

CALIBRATED_LENS = {
    "fov_scale": (0.99, 1.01),
    "principal_right": (-0.005, 0.005),
    "principal_down": (-0.005, 0.005),
    "lens_k1": (-0.02, 0.02),
    "lens_k2": (-0.02, 0.02),
}
"""What may be left of a lens's errors once it is calibrated: intrinsics come out within 0.5 %;
doubled, for a lens that is focused by hand. Replaces what randomised presets assume of a lens
nobody has measured, whose distortion is not even 0 on average."""


class CalibrationFiles(Struct, frozen=True, forbid_unknown_fields=True):
    """What the files of a folder say; None where one is missing.

    Attributes:
        folder: where they were read.
        camera, motion, body, light: see their types.

    """

    folder: str = ""
    camera: CameraCalibration | None = None
    motion: MotionCalibration | None = None
    body: BodyCalibration | None = None
    light: LightCalibration | None = None

    @property
    def robot(self) -> RobotParameters:
        """The robot to simulate: nominal where nothing was calibrated."""
        robot = RobotParameters()
        if self.body is not None:
            robot = _with_body(robot, self.body)
        if self.camera is not None:
            robot = replace(robot, camera=self.camera.model())
        if self.motion is not None:
            robot = self.motion.robot(robot)
        return robot

    @property
    def scene(self) -> SceneParameters:
        """What is around it."""
        if self.light is None:
            return SceneParameters()
        return SceneParameters(light=Light(self.light.direction, self.light.ambient))

    @property
    def effects(self) -> RealWorldEffects:
        """Every effect at its value for this robot."""
        effects = KNOWN
        if self.motion is not None:
            effects = replace(effects, action_latency_ms=self.motion.latency_ms)
        if self.light is not None:
            effects = replace(
                effects,
                exposure_gain=self.light.exposure_gain,
                red_gain=self.light.red_gain,
                blue_gain=self.light.blue_gain,
            )
        return effects

    def ranges(self, name: str) -> EffectRanges:
        """A preset around this robot, without what its calibration has ruled out.

        Raises:
            ValueError: there is no such preset, or it can't be centred.

        """
        ranges = preset(name, self.effects)
        if ranges.is_fixed:
            return ranges
        if self.camera is not None:
            ranges = ranges.changed(**CALIBRATED_LENS)
        if self.motion is not None:
            ranges = narrowed(ranges, self.motion)
        return ranges


@dataclass(frozen=True)
class Calibration:
    """One robot, ready to be simulated.

    Attributes:
        robot: body, motors, camera and the daemon's motor maps.
        scene: the light around it.
        effects: everything else at its measured, or else nominal, value.
        rooms: panoramas of its rooms.

    """

    robot: RobotParameters
    scene: SceneParameters
    effects: RealWorldEffects
    rooms: tuple[Path, ...]


def read_calibration(folder: Path) -> Calibration:
    """Read a whole folder; what is missing stays nominal.

    Raises:
        ConfigurationError: there is no such folder, or a file is unusable.

    """
    files = read_files(folder)
    return Calibration(files.robot, files.scene, files.effects, room_pictures(folder))


def read_files(folder: Path) -> CalibrationFiles:
    """What the files say, as it stands.

    Raises:
        ConfigurationError: there is no such folder, or a file is unusable.

    """
    return CalibrationFiles(
        folder=str(folder),
        camera=read_camera(folder),
        motion=read_motion(folder),
        body=read_part(folder, BODY_FILE, BodyCalibration),
        light=read_part(folder, LIGHT_FILE, LightCalibration),
    )


def files_to_simulate(folder: Path | None) -> CalibrationFiles:
    """What `--calibration FOLDER` says of a robot that is there already; nominal when None.

    Raises:
        ConfigurationError: there is no such folder, it is not one robot's, or a file is unusable.

    """
    if folder is None:
        return CalibrationFiles()
    files = read_files(folder)
    if files == CalibrationFiles(folder=str(folder)) and not room_pictures(folder):
        parts = f"{BODY_FILE}, {CAMERA_FILE}, {LIGHT_FILE}, {MOTION_FILE} or {ROOMS_FOLDER}"
        raise ConfigurationError(
            f"--calibration {typed(folder)} has no {parts}: expected one robot's folder, such as "
            "calibration/mbot-1"
        )
    return files


def made_folder(folder: Path) -> Path:
    """The folder, made if it is not there yet.

    Raises:
        ConfigurationError: it can't be made.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"can't make the calibration folder {folder}: {error.strerror}"
        ) from None
    return folder


def room_pictures(folder: Path) -> tuple[Path, ...]:
    """The panoramas in a folder, sorted; they are not opened here."""
    rooms = folder / ROOMS_FOLDER
    if not rooms.is_dir():
        return ()
    return tuple(path for path in sorted(rooms.iterdir()) if path.suffix.lower() in ROOM_SUFFIXES)


def write_camera(folder: Path, camera: CameraCalibration) -> Path:
    """Write camera.toml.

    Raises:
        ConfigurationError: it can't be written.

    """
    return write_toml(folder / CAMERA_FILE, camera, "The camera: `workstation calibrate camera`.")


def write_motion(folder: Path, motion: MotionCalibration) -> Path:
    """Write motion.toml.

    Raises:
        ConfigurationError: it can't be written.

    """
    return write_toml(folder / MOTION_FILE, motion, "Motors and wheels: `workstation identify`.")


def write_body(folder: Path, body: BodyCalibration) -> Path:
    """Write body.toml.

    Raises:
        ConfigurationError: it can't be written.

    """
    return write_toml(
        folder / BODY_FILE, body, "Masses and dimensions: `workstation calibrate body`."
    )


def write_light(folder: Path, light: LightCalibration) -> Path:
    """Write light.toml.

    Raises:
        ConfigurationError: it can't be written.

    """
    return write_toml(folder / LIGHT_FILE, light, "The light: `workstation calibrate light`.")


def _with_body(robot: RobotParameters, body: BodyCalibration) -> RobotParameters:
    changed = replace(
        robot,
        bodies=tuple(
            BoxBody(part.name, part.mass_kg, part.size_m, part.centre_m, part.colour_rgb)
            for part in body.components
        ),
    )
    for name in ("wheel_mass_kg", "wheel_radius_m", "track_m", "caster_ahead_m", "touch_radius_m"):
        if (value := getattr(body, name)) is not None:
            changed = replace(changed, **{name: value})
    if (mount := body.camera_mount) is not None:
        values = {name: getattr(mount, name) for name in mount.__struct_fields__}
        changed = replace(changed, camera_mount=CameraMount(**values))
    return changed

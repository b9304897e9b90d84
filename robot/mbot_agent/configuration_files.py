"""The files that complete config.toml: a calibration folder, and what `workstation enroll` wrote.

Each is a file of its own, so that a new calibration, person, certificate or key is copied, not
edited in. A value that stands in two files is refused: neither could win without somebody looking
for the fault in the wrong place. Keys add up instead.
"""

import tomllib
from pathlib import Path

import msgspec
from msgspec import Struct

from mbot_agent.configuration import Access, Configuration, Network, load
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.calibration import (
    CAMERA_FILE,
    MOTION_FILE,
    CameraCalibration,
    MotorMappings,
    read_camera,
    read_motor_mappings,
)
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import text_if_any
from mbot_protocol.files.toml_file import read_toml
from mbot_protocol.signing.public_key import PublicKey

ENROLMENT_FILE = "enrolment.toml"
TRUSTED_KEYS_FILE = "trusted-keys.toml"


def calibrated(configuration: Configuration, origin: Path) -> Configuration:
    """The configuration with the values of the folder it names, if it names one.

    Args:
        configuration: as read.
        origin: its file; a relative folder counts from there, and errors name it.

    Raises:
        ConfigurationError: the folder or a file in it is unusable, or a value stands twice.

    """
    if not configuration.calibration:
        return configuration
    folder = origin.parent / configuration.calibration
    camera, motion = read_camera(folder), read_motor_mappings(folder)
    if camera is None and motion is None:
        raise ConfigurationError(
            f"{folder} holds neither {CAMERA_FILE} nor {MOTION_FILE}: copy this robot's "
            f"calibration there, or leave calibration empty in {origin}"
        )
    if camera is not None:
        configuration = _with_camera(configuration, camera, origin, folder)
    if motion is not None:
        configuration = _with_motion(configuration, motion, origin, folder)
    return configuration


def _with_camera(
    configuration: Configuration, camera: CameraCalibration, origin: Path, folder: Path
) -> Configuration:
    if configuration.camera.intrinsics is not None:
        raise ConfigurationError(
            f"{origin}: [camera.intrinsics] is set, and {folder / CAMERA_FILE} gives the camera "
            "too: delete one of the two"
        )
    changed = msgspec.structs.replace(configuration.camera, intrinsics=camera.model())
    size_px = changed.width_px, changed.height_px
    if size_px[0] and size_px[1] and not changed.is_calibrated_for(size_px[0], size_px[1]):
        raise ConfigurationError(
            f"{origin}: camera.width_px and height_px are {size_px[0]} x {size_px[1]}, another "
            f"shape than the {camera.width_px} x {camera.height_px} of {folder / CAMERA_FILE}: "
            "frames must show the whole view that was calibrated"
        )
    return msgspec.structs.replace(configuration, camera=changed)


def _with_motion(
    configuration: Configuration, motion: MotorMappings, origin: Path, folder: Path
) -> Configuration:
    motors = configuration.motors
    # Whether it is set: a value that happens to be the nominal one stands there all the same.
    written = tomllib.loads(text_if_any(origin) or "").get("motors", {})
    for side in ("left", "right"):
        for name in ("trim", "dead_band"):
            if name in written.get(side, {}):
                raise ConfigurationError(
                    f"{origin}: motors.{side}.{name} is set, and {folder / MOTION_FILE} gives it "
                    "too: delete one of the two"
                )
    changed = WheelMaps(
        motion.left_motor.motor_map(motors.left.reversed),
        motion.right_motor.motor_map(motors.right.reversed),
    )
    return msgspec.structs.replace(configuration, motors=changed)


class Enrolment(Struct, frozen=True, forbid_unknown_fields=True):
    """The file's content."""

    robot_id: str
    network: Network
    access: Access


def enrolled(configuration: Configuration, origin: Path) -> Configuration:
    """The configuration with the network and people of the enrolment, if there is one.

    Args:
        configuration: as read.
        origin: its file; the enrolment is looked for beside it, and errors name it.

    Raises:
        ConfigurationError: the enrolment is unusable or another robot's, or certificates or
            people stand in both files: neither could win without somebody being let in by the
            other.

    """
    path = origin.parent / ENROLMENT_FILE
    if not path.exists():
        return configuration
    enrolment = read_toml(path, Enrolment)
    if enrolment.robot_id != configuration.robot_id:
        raise ConfigurationError(
            f"{path} is for robot {enrolment.robot_id!r}, but robot_id in {origin} is "
            f"{configuration.robot_id!r}: copy this robot's, or change robot_id"
        )
    if configuration.network.tls is not None or configuration.access != Access():
        raise ConfigurationError(
            f"{origin} has [network.tls] or [access], and {path} has them too: delete one of the "
            "two"
        )
    try:
        return msgspec.structs.replace(
            configuration, network=enrolment.network, access=enrolment.access
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None


class TrustedKeys(Struct, frozen=True, forbid_unknown_fields=True):
    """The content of trusted-keys.toml: whose models are taken, and nothing about releases."""

    keys: tuple[str, ...]

    @property
    def public_keys(self) -> tuple[PublicKey, ...]:
        """The keys, read; each once."""
        return tuple({key.raw: key for key in map(PublicKey.parse, self.keys)}.values())

    def __post_init__(self) -> None:
        _ = self.public_keys


def trusting(configuration: Configuration, origin: Path) -> Configuration:
    """The configuration that also trusts the keys of trusted-keys.toml, if there is one.

    Args:
        configuration: as read.
        origin: its file; the keys are looked for beside it.

    Raises:
        ConfigurationError: the file is unusable.

    """
    trust = configuration.trust
    known = {key.raw for key in trust.public_keys}
    more = tuple(key.line for key in _sent_keys(origin) if key.raw not in known)
    trust = msgspec.structs.replace(trust, keys=(*trust.keys, *more))
    return msgspec.structs.replace(configuration, trust=trust) if more else configuration


def keys_by_file(origin: Path) -> dict[Path, tuple[PublicKey, ...]]:
    """Whose models are taken, by the file that says so; raises as `load` and `trusting`."""
    return {
        origin: load(origin).trust.public_keys,
        origin.with_name(TRUSTED_KEYS_FILE): _sent_keys(origin),
    }


def _sent_keys(origin: Path) -> tuple[PublicKey, ...]:
    path = origin.with_name(TRUSTED_KEYS_FILE)
    return read_toml(path, TrustedKeys).public_keys if path.exists() else ()


def complete(path: Path) -> Configuration:
    """The configuration with all that completes it; raises as its parts."""
    configuration = calibrated(load(path), path)
    return trusting(enrolled(configuration, path), path)

"""The daemon's configuration: one TOML file, decoded strictly, read once at start.

deploy/config.toml is the annotated example; a test keeps it equal to the defaults here.
"""

import contextlib
import logging
import math
import os
import re
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.calibration import check_lens
from mbot_protocol.drive.camera_model import (
    PI_CAMERA_HORIZONTAL_FOV_DEG,
    PI_CAMERA_VERTICAL_FOV_DEG,
    CameraModel,
)
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import text_if_any
from mbot_protocol.files.toml_file import decode_toml
from mbot_protocol.policy.policy_contract import DECISION_RATE_HZ
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.wire.access_rules import check_name
from mbot_protocol.wire.keys import DEFAULT_ENDPOINT, Right, check_robot_id

log = logging.getLogger(__name__)

DEFAULT_STATE_DIRECTORY = Path("/var/lib/mbot-agent")

ASPECT_TOLERANCE = 0.02
"""Of a frame's shape against the calibration's: 2028 x 1520 and 320 x 240 differ by 0.1 %, 4:3 and
16:9 by a third."""

Pixels = Annotated[int, Meta(ge=16, le=8192)]
Degrees = Annotated[float, Meta(ge=1, le=170)]


_LOGIN = re.compile(r"//.*@", re.DOTALL)
"""Up to the last @: a password may have any of / ? # @ in it, though it should be quoted."""
_QUERY = re.compile(r"\?.*", re.DOTALL)


def shown_source(source: str) -> str:
    """A camera's source for people to read: passwords in addresses are left out."""
    return _QUERY.sub("?...", _LOGIN.sub("//...@", source)) if "://" in source else source


_AUTHORITY = re.compile(r"://([^/?#]*)")


def address_advice(source: str) -> str:
    """What to write otherwise in an address that seems to have an @ of a password's in it."""
    authority = _AUTHORITY.search(source)
    if authority is None or authority[1].count("@") < 2:
        return ""
    return "; its address has more than one @: a password's own is written %40"


class CameraSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Where frames come from and when they are too bad to drive on."""

    source: str = "picamera2"
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    frame_rate_hz: Annotated[float, Meta(ge=1, le=120)] = 30.0
    horizontal_fov_deg: Degrees = PI_CAMERA_HORIZONTAL_FOV_DEG
    vertical_fov_deg: Degrees = PI_CAMERA_VERTICAL_FOV_DEG
    intrinsics: CameraModel | None = None
    stale_after_ms: Annotated[float, Meta(ge=50, le=600)] = 300.0
    identical_frames: Literal["auto", "refuse", "refuse-while-driving"] = "auto"
    automatic: Literal["settle", "always", "off"] = "settle"

    def __post_init__(self) -> None:
        is_address = "://" in self.source and not self.source.startswith("ffmpeg:")
        if is_address and not self.source.startswith("http://"):
            raise ValueError(
                f"source is {shown_source(self.source)!r}, expected picamera2, a device, a file or "
                f'http://; FFmpeg opens other addresses, by source = "ffmpeg:ADDRESS"'
            )
        if self.intrinsics is not None:
            check_lens(self.intrinsics)

    def model_at(self, width_px: int, height_px: int) -> CameraModel:
        """The intrinsics for frames of this size: calibrated, or from the field of view."""
        if self.intrinsics is not None:
            return self.intrinsics.scaled_to(width_px, height_px)
        return CameraModel.from_field_of_view(
            width_px, height_px, self.horizontal_fov_deg, self.vertical_fov_deg
        )

    def is_calibrated_for(self, width_px: int, height_px: int) -> bool:
        """Whether frames of this size can be the calibrated camera's whole view."""
        if self.intrinsics is None:
            return True
        calibrated = self.intrinsics.width_px / self.intrinsics.height_px
        return abs(width_px / height_px / calibrated - 1) <= ASPECT_TOLERANCE


Pin = Annotated[int, Meta(ge=9, le=27)]
"""GPIO 0 to 8 are pulled up while a Pi boots: motors would run."""


class GpioSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """A motor driver's inputs on the computer's pins, by their GPIO numbers.

    Attributes:
        left, right: inputs that turn that motor forward and backward, each with PWM.
        enable: what is held high as long as the daemon has the driver.

    """

    left: tuple[Pin, Pin] = (17, 27)
    right: tuple[Pin, Pin] = (22, 23)
    enable: tuple[Pin, ...] = ()

    @property
    def pins(self) -> tuple[int, ...]:
        """All of them."""
        return *self.left, *self.right, *self.enable

    def __post_init__(self) -> None:
        if len(set(self.pins)) < len(self.pins):
            raise ValueError(f"pins are {list(self.pins)}, expected each once")


class BoardSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Which kind of board turns the wheels, how to reach it, and what is expected of its firmware.

    Attributes:
        kind: a line of `board.board_kinds.KINDS`.
        port: a serial port's path; "auto": found by the kind.
        baud_rate: the port's.
        accept_no_deadman: whether to drive with firmware that goes on when this computer dies.
        gpio: the pins of a motor driver on them.

    """

    kind: str = "mcore"
    port: str = "auto"
    baud_rate: Annotated[int, Meta(gt=0)] = 115_200
    accept_no_deadman: bool = False
    gpio: GpioSettings = GpioSettings()


Port = Annotated[int, Meta(ge=1, le=4)]


class SensesSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What the board is to feel, and what holds it back.

    Attributes:
        edge: "stop": without a floor in front no wheel turns forward; "tell": it is only told.
        distance_m: nothing goes forward when an echo is nearer; 0: no echo matters.
        line_ports: RJ25 ports with infrared pairs.
        ultrasonic_port: that of the ultrasonic sensor; 0: there is none.

    """

    edge: Literal["off", "tell", "stop"] = "off"
    distance_m: Annotated[float, Meta(ge=0, le=2.5)] = 0.0
    line_ports: tuple[Port, ...] = (2,)
    ultrasonic_port: Annotated[int, Meta(ge=0, le=4)] = 3

    def __post_init__(self) -> None:
        if self.edge == "stop" and not self.line_ports:
            raise ValueError('edge = "stop" needs infrared pairs: name their port in line_ports')
        if self.distance_m and not self.ultrasonic_port:
            raise ValueError(
                "distance_m needs an ultrasonic sensor: set ultrasonic_port to its port"
            )
        if self.ultrasonic_port in self.line_ports:
            raise ValueError(f"port {self.ultrasonic_port} can't have both kinds of sensor")

    @property
    def are_read(self) -> bool:
        """Whether anybody asks for any of them."""
        return self.edge != "off" or self.distance_m > 0


NOTHING_READ = SensesSettings()


class Control(Struct, frozen=True, forbid_unknown_fields=True):
    """The control loop."""

    decision_rate_hz: Annotated[float, Meta(ge=0.5, le=20)] = DECISION_RATE_HZ
    start: Literal["idle", "running"] = "idle"
    on_lost_link: Literal["drive", "stop"] = "drive"
    lost_link_after_s: Annotated[float, Meta(ge=1, le=60)] = 3.0
    longest_hold_s: Annotated[float, Meta(ge=0, le=10)] = 2.0
    longest_wait_s: Annotated[float, Meta(ge=1, le=3600)] = 30.0


class Models(Struct, frozen=True, forbid_unknown_fields=True):
    """Where pushed models are kept: `models` under $STATE_DIRECTORY, which systemd sets."""

    directory: str = ""
    keep: Annotated[int, Meta(ge=2, le=100)] = 8
    clean_decisions: Annotated[int, Meta(ge=1, le=10_000)] = 25
    dry_run_s: Annotated[float, Meta(ge=1, le=60)] = 6.0

    @property
    def path(self) -> Path:
        """The directory, resolved."""
        if self.directory:
            return Path(self.directory)
        return state_directory() / "models"


def state_directory() -> Path:
    """What systemd gives the daemon to keep its files in."""
    return Path(os.environ.get("STATE_DIRECTORY", DEFAULT_STATE_DIRECTORY))


class TrustSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Whose models and releases the robot takes: public keys as `workstation keys show` prints
    them."""

    keys: tuple[str, ...] = ()
    release_keys: tuple[str, ...] = ()
    allow_unsigned: bool = False

    @property
    def public_keys(self) -> tuple[PublicKey, ...]:
        """The keys, read.

        Raises:
            ConfigurationError: a line is not a key, or two lines are the same one.

        """
        return _parsed(self.keys)

    @property
    def public_release_keys(self) -> tuple[PublicKey, ...]:
        """Whose releases of the daemon are taken; raises as `public_keys`."""
        return _parsed(self.release_keys)


def _parsed(lines: tuple[str, ...]) -> tuple[PublicKey, ...]:
    keys = tuple(PublicKey.parse(line) for line in lines)
    if len({key.raw for key in keys}) < len(keys):
        raise ConfigurationError("a key is there twice: leave one of the lines out")
    return keys


class Tls(Struct, frozen=True, forbid_unknown_fields=True):
    """Mutual TLS: files in PEM; whoever connects must show a certificate of the same authority."""

    ca: str
    certificate: str
    key: str


class TelemetrySettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What the robot tells of itself."""

    pictures: bool | Literal["while-watched"] = "while-watched"


class Recording(Struct, frozen=True, forbid_unknown_fields=True):
    """What the robot keeps of its drives, and how much of the card that may take."""

    enabled: bool = True
    directory: str = ""
    leave_free_mb: Annotated[float, Meta(ge=64, le=1e6)] = 500.0
    largest_mb: Annotated[float, Meta(ge=16, le=1e6)] = 2000.0
    longest_days: Annotated[float, Meta(ge=0.01, le=3650)] = 30.0


class Network(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the daemon listens for workstations. Plain TCP is for loopback only."""

    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    connect: tuple[str, ...] = ()
    tls: Tls | None = None


class Access(Struct, frozen=True, forbid_unknown_fields=True):
    """Who may do what, by the names in their certificates. A router checks people itself."""

    people: dict[str, tuple[Right, ...]] = {}
    routers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        try:
            for name in (*self.people, *self.routers):
                check_name(name)
        except ConfigurationError as error:
            raise ValueError(str(error)) from None  # msgspec adds where


class Configuration(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything the daemon can be told."""

    robot_id: str
    calibration: str = ""
    camera: CameraSettings = CameraSettings()
    board: BoardSettings = BoardSettings()
    senses: SensesSettings = SensesSettings()
    motors: WheelMaps = WheelMaps()
    control: Control = Control()
    models: Models = Models()
    trust: TrustSettings = TrustSettings()
    telemetry: TelemetrySettings = TelemetrySettings()
    recording: Recording = Recording()
    network: Network = Network()
    access: Access = Access()

    @property
    def recordings_path(self) -> Path:
        """Where recordings are kept: `recordings`, beside the models' directory, if not set."""
        if self.recording.directory:
            return Path(self.recording.directory)
        return self.models.path.parent / "recordings"

    def __post_init__(self) -> None:
        check_robot_id(self.robot_id)
        try:
            _ = self.trust.public_keys, self.trust.public_release_keys
        except ConfigurationError as error:
            raise ConfigurationError(f"trust.keys: {error}") from None
        if (self.camera.width_px is None) != (self.camera.height_px is None):
            raise ConfigurationError(
                "camera.width_px and camera.height_px belong together: set both or neither"
            )
        if self.camera.intrinsics is not None and not all(
            math.isfinite(value) for value in self.camera.intrinsics.distortion
        ):
            raise ConfigurationError(
                "camera.intrinsics.distortion holds a value that is not a number"
            )
        for endpoint in (*self.network.listen, *self.network.connect):
            _check_endpoint(endpoint, self.network.tls)
        anyone = bool(self.access.people or self.access.routers)
        if anyone and self.network.tls is None:
            raise ConfigurationError(
                "access: people are known by their certificates, which takes [network.tls]"
            )
        if self.network.tls is not None and not anyone:
            raise ConfigurationError(
                "network.tls: nobody could talk to this robot: name people in [access.people], "
                "or let `workstation enroll` write all of it"
            )


_LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "[::1]")


def _check_endpoint(endpoint: str, tls: Tls | None) -> None:
    """Refuse an endpoint that would let strangers drive the robot."""
    transport, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0]
    if transport not in ("tcp", "tls") or not host:
        raise ConfigurationError(
            f"network: endpoint {endpoint!r} is not understood, expected "
            "'tcp/127.0.0.1:7447' or 'tls/0.0.0.0:7447'"
        )
    if transport == "tls" and tls is None:
        raise ConfigurationError(
            f"network: {endpoint} needs [network.tls] with ca, certificate, key"
        )
    if transport == "tcp" and host not in _LOOPBACK_HOSTS:
        raise ConfigurationError(
            f"network: {endpoint} would let anyone on the network drive this robot: use tls/ with "
            "[network.tls], or tcp/127.0.0.1 and an ssh tunnel"
        )


def load(path: Path) -> Configuration:
    """Read the configuration file.

    Raises:
        ConfigurationError: it is missing, no TOML, or a setting is unknown or out of range.

    """
    text = text_if_any(path)
    if text is None:
        raise ConfigurationError(
            f"no configuration at {path}: copy deploy/config.toml there, or name one by --config"
        )
    return decode(text, str(path))


class _OnlyBoard(Struct, frozen=True):
    board: BoardSettings


def load_board(path: Path) -> BoardSettings:
    """How to reach the board, from whatever of the file can be read: a mistake in another section,
    or no valid TOML at all, must not keep anybody from stopping the motors.
    """
    try:
        return load(path).board
    except ConfigurationError as error:
        log.warning("%s; looking for the board's port all the same", error)
    try:
        text = path.read_text(errors="replace")
    except OSError:
        return BoardSettings()
    with contextlib.suppress(ConfigurationError):
        sections = re.findall(r"^\[board[\].].*?(?=^\[(?!board[\].])|\Z)", text, re.M | re.S)
        return decode_toml("".join(sections), _OnlyBoard, str(path)).board
    section = re.search(r"^\s*\[board\]([^\[]*)", text, re.MULTILINE)
    found: dict[str, str] = {}
    if section is not None:
        setting = r"^\s*(kind|port|baud_rate)\s*=\s*[\"']?([^\"'#\s]+)"
        found = dict(re.findall(setting, section[1], re.M))
    nominal, baud_rate = BoardSettings(), found.get("baud_rate", "")
    return BoardSettings(
        kind=found.get("kind", nominal.kind),
        port=found.get("port", nominal.port),
        baud_rate=int(baud_rate) if baud_rate.isdecimal() else nominal.baud_rate,
    )


def decode(text: str, origin: str) -> Configuration:
    """Decode configuration text; `origin` names it in errors.

    Raises:
        ConfigurationError: as `load`.

    """
    return decode_toml(text, Configuration, origin)

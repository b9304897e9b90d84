"""Everything that reads bytes or text from outside: whatever comes, a value or a clear error.

Some thousand inputs for each parser in every run of the tests, 100,000 by `make fuzz`. They are
drawn by a plain generator, not by Hypothesis: that is a hundred times as fast, and the tests beside
each parser have Hypothesis look for small examples.
"""

import os
import random
import string
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
import tomli_w

from mbot_agent import configuration
from mbot_agent.camera.jpeg_picture import read_jpeg
from mbot_agent.camera.multipart import MultipartError, MultipartParser
from mbot_agent.camera.source_contract import JpegError
from mbot_agent.configuration_files import Enrolment, TrustedKeys
from mbot_agent.models.activation import Activation
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.actions import to_steps
from mbot_protocol.drive.calibration import CameraCalibration, MotorMappings
from mbot_protocol.drive.mcore import Acknowledgement, ReplyParser
from mbot_protocol.errors import MbotError
from mbot_protocol.files.toml_file import read_toml
from mbot_protocol.policy.golden_frames import PROPERTY, read_golden_frames
from mbot_protocol.policy.model_structure import check_structure
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_protocol.signing.envelope import Envelope
from mbot_protocol.signing.model_manifest import decode, encode
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire.access_rules import split_common_name
from mbot_protocol.wire.schema import decode as decode_message
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration

from ..protocol.test_envelope import SIGNED
from ..protocol.test_model_manifest import MANIFEST
from ..robot.test_jpeg_picture import PICTURE, jpeg
from ..robot.test_multipart import BOUNDARY, stream
from ..robot.tiny_models import constant_model
from ..workstation.samples import decision
from .effort import FUZZ_CASES

pytestmark = pytest.mark.timeout(300 + 0.03 * FUZZ_CASES)

SEED = os.urandom(8) if FUZZ_CASES > 10_000 else b"the same in every run"

Errors = tuple[type[Exception], ...]
T = TypeVar("T")


def damaged(*whole: bytes) -> Iterator[bytes]:
    """Noise, or something whole with one to three pieces cut out and others put in."""
    chance = random.Random(SEED)
    for _ in range(FUZZ_CASES):
        if chance.random() < 0.1:
            yield chance.randbytes(chance.randrange(200))
            continue
        data = chance.choice(whole)
        for _ in range(chance.randrange(1, 4)):
            at = chance.randrange(len(data) + 1)
            until = at + chance.choice((0, 1, 1, 2, chance.randrange(len(data) + 1)))
            piece = chance.choice(
                (b"", chance.randbytes(chance.randrange(1, 9)), ascii_piece(chance))
            )
            data = data[:at] + piece + data[until:]
        yield data


def ascii_piece(chance: random.Random) -> bytes:
    """What is likely to mean something in a text."""
    words = ("0", "-1", "1e999", "nan", "true", "[", "]", "{", "}", '"', "=", "\n", ".", ":", "'")
    return chance.choice((*words, chance.choice(string.printable))).encode()


def damaged_text(*whole: str) -> Iterator[str]:
    for data in damaged(*(text.encode() for text in whole)):
        yield data.decode(errors="replace")


def feed(read: Callable[[T], object], inputs: Iterator[T], expected: Errors = (MbotError,)) -> None:
    """Read each input; anything but a value or an expected error fails and shows the input."""
    refused = 0
    for data in inputs:
        try:
            read(data)
        except expected:
            refused += 1
        except Exception as error:
            raise AssertionError(f"{data!r}") from error
    assert refused  # else it was not damage that was fed


def message(kind: type, **fields: object) -> bytes:
    return kind(schema_version=1, **fields).SerializeToString()


MESSAGES: dict[type, bytes] = {
    messages.Command: message(
        messages.Command,
        robot_id="mbot-1",
        session_id=1,
        expires_monotonic_ns=1,
        drive=messages.Drive(wheels=messages.Wheels(left=1, right=-1), hold_ms=500),
    ),
    messages.PushBegin: message(
        messages.PushBegin, robot_id="mbot-1", sha256="0" * 64, size_bytes=100, manifest=b"{}"
    ),
    messages.PushChunk: message(messages.PushChunk, push_id="x", data=b"x" * 40),
    messages.PushCommit: message(messages.PushCommit, push_id="x"),
    messages.Status: message(messages.Status, robot_id="mbot-1"),
    messages.Decision: message(messages.Decision, robot_id="mbot-1", sequence=7),
}

CONFIGURATION = """robot_id = "mbot-1"
[camera]
source = "/dev/video0"
width_px = 320
height_px = 240
[board]
accept_no_deadman = true
[motors.left]
trim = 0.9
[control]
decision_rate_hz = 2.5
[models]
keep = 3
[network]
listen = ["tcp/127.0.0.1:7447"]
"""
CAMERA = """width_px = 2028
height_px = 1520
focal_x_px = 1935.0
focal_y_px = 1935.0
principal_x_px = 1014.0
principal_y_px = 760.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
reprojection_error_px = 0.3
pictures = 20
made_on = "2026-01-01"
"""
ENROLMENT = """robot_id = "mbot-1"
[network]
listen = ["tls/0.0.0.0:7447"]
[network.tls]
ca = "a"
certificate = "b"
key = "c"
[access.people]
rosa = ["drive", "view"]
"""
TRUSTED_KEYS = f'keys = ["ed25519:{"A" * 43}= rosa"]\n'
MOTION = """made_on = "2026-01-01"
reverse_ms = 5
[left_motor]
gain = 1.0
"""


def test_board_replies() -> None:
    for data in damaged(b"\xff\x55\r\n\xff\x55\x00\x04\x0906.01.009\r\nVersion: 06.01.107\r\n"):
        parser = ReplyParser()
        list(parser.feed(data))
        assert parser.pending <= ReplyParser.LONGEST, data
        assert list(parser.feed(b"\xff\x55\r\n" * 20))[-1] == Acknowledgement(), data


def test_camera_streams() -> None:
    """Some of them announce their end."""
    parts = [b"one picture", b"", b"and another one" * 3]
    last = f"--{BOUNDARY}--\r\n".encode()
    whole = (stream(parts) + last, stream(parts, counted=False) + last)
    feed(lambda data: MultipartParser(BOUNDARY).feed(data, 0), damaged(*whole), (MultipartError,))


def test_camera_pictures() -> None:
    feed(lambda data: read_jpeg(data).picture(), damaged(jpeg(PICTURE[::4, ::4])), (JpegError,))


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_messages(kind: type) -> None:
    feed(lambda data: decode_message(kind, data, "somebody"), damaged(MESSAGES[kind]))


def test_manifests() -> None:
    def read(data: bytes) -> None:
        assert encode(decode(data)) == data

    feed(read, damaged(encode(MANIFEST)))


def test_kept_manifests() -> None:
    feed(Envelope.from_text, damaged_text(SIGNED.to_text()))


def test_configurations() -> None:
    feed(lambda text: configuration.decode(text, "robot.toml"), damaged_text(CONFIGURATION))


SECTIONS = {
    section.name: [field.name for field in msgspec.structs.fields(section.type)]
    for section in msgspec.structs.fields(configuration.Configuration)
    if isinstance(section.type, type) and issubclass(section.type, msgspec.Struct)
}
VALUES = (True, 0, -1, 2**63 - 1, 0.0, float("nan"), float("inf"), -1e300, "", "x", "tcp/", [], {})


def any_values() -> Iterator[str]:
    """Each setting with values of any type."""
    chance = random.Random(SEED)
    for _ in range(FUZZ_CASES):
        section = chance.choice(sorted(SECTIONS))
        fields = chance.sample(SECTIONS[section], min(2, len(SECTIONS[section])))
        values = {field: chance.choice((*VALUES, chance.random() * 1000)) for field in fields}
        yield tomli_w.dumps({"robot_id": "a", section: values})


def test_configurations_with_any_value() -> None:
    feed(lambda text: configuration.decode(text, "robot.toml"), any_values())


def test_policy_metadata() -> None:
    properties = PolicyMetadata("x").to_properties()
    chance = random.Random(SEED)

    def read(text: str) -> None:
        key = chance.choice(sorted(properties))
        found = PolicyMetadata.from_properties(properties | {key: text})
        assert 0.5 <= found.decision_rate_hz <= 20

    feed(read, damaged_text("2.5", "55.3", "1"))


def test_golden_frames() -> None:
    text = '[{"name": "a", "png": "AAAA", "action": [0.0, 1.0]}]'
    feed(lambda text: read_golden_frames({PROPERTY: text}), damaged_text(text))


def test_models() -> None:
    feed(check_structure, damaged(constant_model()))


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (CameraCalibration, CAMERA),
        (MotionCalibration, MOTION),
        (MotorMappings, MOTION),
        (Enrolment, ENROLMENT),
        (TrustedKeys, TRUSTED_KEYS),
    ],
    ids=[
        "camera.toml",
        "motion.toml",
        "motion.toml on the robot",
        "enrolment.toml",
        "trusted-keys.toml",
    ],
)
def test_toml_files(kind: type, text: str, memory_file: Path) -> None:
    def read(content: bytes) -> None:
        memory_file.write_bytes(content)
        read_toml(memory_file, kind)

    feed(read, damaged(text.encode()))


def test_recordings(memory_file: Path) -> None:
    with TelemetryFile(memory_file, "mbot-1") as recording:
        recording.write(decision(1))
    whole = memory_file.read_bytes()

    def read(content: bytes) -> None:
        memory_file.write_bytes(content)
        read_drive(memory_file)

    feed(read, damaged(whole))


def test_public_keys() -> None:
    feed(PublicKey.parse, damaged_text("ed25519:" + "A" * 43 + "= anna"))


def test_addresses() -> None:
    feed(parse_address, damaged_text("tls/[fe80::1]:7447", "mbot-1.local", "tcp/127.0.0.1:7447"))


def test_names_in_certificates() -> None:
    def read(text: str) -> None:
        if (found := split_common_name(text)) is None:
            raise MbotError
        assert text == f"{found[0].value}:{found[1]}"

    feed(read, damaged_text("person:rosa", "robot:mbot-1"))


def test_activations() -> None:
    whole = msgspec.json.encode(Activation("a", "b", ("a",), ("c",), {"a": 1}))
    errors = (msgspec.DecodeError, UnicodeDecodeError)
    feed(lambda data: msgspec.json.decode(data, type=Activation), damaged(whole), errors)


def test_actions() -> None:
    def read(text: str) -> None:
        steps = to_steps(float(text), 0.5)
        assert -250 <= steps.left <= 250

    feed(read, damaged_text("0.25", "-1.0", "1e-300", "nan", "inf"), (ValueError,))


@pytest.fixture
def memory_file(tmp_path: Path) -> Iterator[Path]:
    """On no disk: 100,000 writes would wear one out."""
    folder = Path("/dev/shm")
    path = folder / f"mbot-fuzz-{os.getpid()}" if folder.is_dir() else tmp_path / "file"
    path.unlink(missing_ok=True)
    yield path
    path.unlink(missing_ok=True)

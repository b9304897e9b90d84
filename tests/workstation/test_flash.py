import stat
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_workstation.cli.set_up import flash
from mbot_workstation.fleet.firmware import flashing as firmware_flash
from mbot_workstation.fleet.firmware.flashing import Image, read_image

from ..robot.fake_board import FakeBoard
from .called import output_of

STOCK, OURS = "06.01.107", "mbot-deadman 1"


def hex_file(path: Path, content: bytes) -> Path:
    lines: list[str] = []
    for at in range(0, len(content), 16):
        data = content[at : at + 16]
        record = bytes((len(data), at >> 8 & 255, at & 255, 0)) + data
        lines.append(f":{(record + bytes((-sum(record) & 255,))).hex().upper()}")
    path.write_text("\n".join([*lines, ":00000001FF", ""]))
    return path


class Bench:
    """A board, an image and a program called avrdude.

    Attributes:
        board: to be flashed; with stock firmware.
        image: the firmware to be written; ours.
        program: the fake avrdude.

    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.board = FakeBoard(STOCK)
        self.image = hex_file(folder / "ours.hex", bytes(100) + OURS.encode() + bytes(50))
        self.avrdude_will(0)

    def avrdude_will(self, code: int, said: str = "") -> None:
        (self._folder / "said").write_text(said)
        self.program = self._folder / "avrdude"
        self.program.write_text(
            f'#!/bin/sh\nprintf "%s\\n" "$@" > {self._folder}/arguments\n'
            f"cat {self._folder}/said >&2\nexit {code}\n"
        )
        self.program.chmod(stat.S_IRWXU)

    @property
    def arguments(self) -> list[str]:
        """What avrdude was called with; empty if it was not."""
        noted = self._folder / "arguments"
        return noted.read_text().splitlines() if noted.exists() else []

    def flash(self, *options: str) -> str:
        """Run the command; returns what it printed, raises what it raised."""
        return output_of(flash, "--port", self.board.path, "--hex", self.image, *options)


class RenamedBoard(FakeBoard):
    """Calls itself something else once avrdude has run."""

    def __init__(self, bench: Bench, after: str) -> None:
        self._bench, self._after = bench, after
        super().__init__(STOCK)

    @property
    def version(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self._after if self._bench.arguments else STOCK

    @version.setter
    def version(self, name: str) -> None:
        pass


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(firmware_flash, "ANSWER_TIMEOUT_S", 0.6)
    bench = Bench(tmp_path)
    with bench.board:
        yield bench


def test_it_writes_and_tells_the_version_before_and_after(bench: Bench) -> None:
    with RenamedBoard(bench, OURS) as bench.board:
        said = bench.flash()
        assert said.splitlines()[0].endswith(STOCK)
        assert said.splitlines()[-1].endswith(OURS)
        assert " ".join(bench.arguments) == (
            f"-c arduino -p m328p -P {bench.board.path} -b 115200 -D -U flash:w:{bench.image}:i"
        )
        assert " ".join(bench.arguments) in said, "it says what it does"


def test_a_board_that_did_not_take_it_is_noticed(bench: Bench) -> None:
    with pytest.raises(RefusedError, match=r"calls itself 06\.01\.107, expected mbot-deadman 1"):
        bench.flash()


def test_a_dry_run_writes_nothing(bench: Bench) -> None:
    said = bench.flash("--dry-run")
    assert "would write mbot-deadman 1, 164 bytes" in said
    assert bench.arguments == []


def test_another_firmware_goes_back_to_stock(bench: Bench) -> None:
    bench.image = hex_file(bench.image, b"no name of ours in it")
    assert bench.flash().splitlines()[-1].endswith(STOCK)


@pytest.mark.parametrize("version", ["09.01.016", "kettle 2"])
def test_what_is_no_mcore_is_left_alone_unless_forced(bench: Bench, version: str) -> None:
    bench.board.version = version
    bench.image = hex_file(bench.image, b"anything")
    with pytest.raises(RefusedError, match=r"is not an mCore firmware known here.*--force"):
        bench.flash()
    assert bench.arguments == []
    bench.flash("--force")
    assert bench.arguments


def test_what_does_not_answer_is_left_alone_unless_forced(bench: Bench) -> None:
    bench.board.mute = True
    with pytest.raises(UnreachableError, match=r"answers like an mCore board; --force"):
        bench.flash()
    assert bench.arguments == []
    with pytest.raises(UnreachableError, match="the firmware is written, but then: nothing on"):
        bench.flash("--force")
    assert bench.arguments


def test_a_board_in_use_is_left_alone(bench: Bench) -> None:
    with (
        serial.Serial(bench.board.path, exclusive=True),
        pytest.raises(UnreachableError, match="in use by another process"),
    ):
        bench.flash("--force")
    assert bench.arguments == []


@pytest.mark.parametrize(
    ("said", "kind", "words"),
    [
        (
            "avrdude: stk500_getsync() attempt 10 of 10: not in sync: resp=0x00",
            UnreachableError,
            "no boot loader answers",
        ),
        ("avrdude error: programmer is not responding", UnreachableError, "no boot loader"),
        (
            "avrdude: Device signature = 0x1e9801\n"
            "avrdude: Expected signature for ATmega328P is 1E 95 0F",
            RefusedError,
            "not an ATmega328P",
        ),
        (
            "avrdude error: connected part ATmega2560 signature does not match -p m328p's",
            RefusedError,
            "not an ATmega328P",
        ),
        (
            "avrdude: Device signature = 0x1e950f\navrdude: verification error; content mismatch",
            RefusedError,
            "reads back differently",
        ),
        (
            "avrdude OS error: cannot open port /dev/ttyUSB0: Permission denied",
            UnreachableError,
            "permission",
        ),
        (
            "avrdude: ser_open(): can't open device: Device or resource busy",
            UnreachableError,
            "in use by another process",
        ),
        ("\nReading |\navrdude error: the moon is full\n", UnreachableError, "the moon is full"),
        ("", UnreachableError, "it said nothing"),
    ],
)
def test_avrdudes_errors_come_down_to_one_line(
    bench: Bench, said: str, kind: type[Exception], words: str
) -> None:
    bench.avrdude_will(1, said)
    with pytest.raises(kind, match=words) as raised:
        bench.flash()
    assert "\n" not in str(raised.value)


def test_a_missing_avrdude_is_named_with_its_remedy(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ConfigurationError, match="sudo apt-get install avrdude"):
        bench.flash()


def test_a_missing_port_is_explained(bench: Bench) -> None:
    with pytest.raises(UnreachableError, match="is it plugged in"):
        bench.flash("--port", "/dev/nothing-here")


def test_the_only_ch340_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        SimpleNamespace(device="/dev/ttyACM0", vid=0x2341, pid=0x0043),
        SimpleNamespace(device="/dev/ttyUSB1", vid=0x1A86, pid=0x7523),
    ]
    monkeypatch.setattr(firmware_flash.list_ports, "comports", lambda: ports)
    assert firmware_flash.find_port(None) == "/dev/ttyUSB1"
    assert firmware_flash.find_port("/dev/other") == "/dev/other"
    ports.append(ports[1])
    with pytest.raises(UnreachableError, match="choose with --port: /dev/ttyUSB1, /dev/ttyUSB1"):
        firmware_flash.find_port(None)
    ports.clear()
    with pytest.raises(UnreachableError, match="plug it in and switch it on"):
        firmware_flash.find_port(None)


@given(content=st.binary(min_size=1, max_size=500))
def test_an_image_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("image") / "image.hex"
    assert read_image(hex_file(path, content)) == Image(path, content)


def test_unusable_images_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.hex"
    with pytest.raises(ConfigurationError, match="make firmware"):
        read_image(path)
    whole = hex_file(path, bytes(range(64))).read_text()
    for damaged, words in (
        ("", "ends too early"),
        ("\x7fELF", "line 1"),
        (whole.replace(":00000001FF", ""), "ends too early"),
        (whole.replace("0F", "0E", 1), "line 1"),
        (whole + whole, "line 6"),
        (":00000001FF", "ends too early"),
    ):
        path.write_text(damaged)
        with pytest.raises(ConfigurationError, match=words):
            read_image(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_image(path)
    with pytest.raises(ConfigurationError, match="an mCore holds 32256"):
        read_image(hex_file(path, bytes(32_257)))

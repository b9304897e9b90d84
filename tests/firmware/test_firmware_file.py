"""Which firmware and emulator are taken, and what is said when there is none."""

import os
from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.firmware.firmware_file import find_firmware
from mbot_workstation.virtual.emulated.board_simulator import cache_folder, simulator_program


def test_ours_is_what_make_firmware_makes() -> None:
    path = find_firmware("deadman")
    assert path.name == "mbot-deadman.elf"
    assert b"mbot-deadman 3 300ms" in path.read_bytes()


def test_elf_and_hex_are_taken_as_they_are(firmware_folder: Path) -> None:
    for name in ("mbot-deadman.elf", "mbot-deadman.hex"):
        assert find_firmware(str(firmware_folder / name)) == firmware_folder / name


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("none.elf", None, "none.elf .No such file"),
        ("none.hex", None, "no firmware at .*none.hex"),
        ("torn.hex", b":100000000C94", r"not an Intel HEX file, or damaged \(line 1\)"),
        ("empty.elf", b"", "empty.elf is not firmware of an mCore board"),
        ("photo.jpg", b"\xff\xd8\xff", "expected an ELF file for AVR, or Intel HEX"),
        ("ours.elf", b"\x7fELF" + bytes(14) + b"\x3e\x00", "not firmware of an mCore"),  # x86-64
    ],
)
def test_anything_else_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, told: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=told) as refusal:
        find_firmware(str(path))
    assert "\n" not in str(refusal.value)


def test_without_an_avr_compiler_it_names_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(_programs(tmp_path, "make")))
    with pytest.raises(ConfigurationError, match=r"needs avr-gcc: sudo apt-get .* gcc-avr .*libc"):
        find_firmware("deadman")


def test_what_make_says_is_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs = _programs(tmp_path, "make", "avr-gcc", "avr-objcopy", told="it is Sunday")
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    with pytest.raises(ConfigurationError, match="`make firmware` failed: it is Sunday"):
        find_firmware("deadman")


def test_the_emulator_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    program = simulator_program()
    assert program.parent == cache_folder() == tmp_path / "mbot-agent"
    made_ns = program.stat().st_mtime_ns
    monkeypatch.setenv("PATH", str(tmp_path))  # no compiler any more
    assert simulator_program() == program
    assert program.stat().st_mtime_ns == made_ns
    assert list(program.parent.iterdir()) == [program]


def test_without_a_compiler_it_names_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigurationError, match=r"apt-get install gcc .*libsimavr-dev libelf-dev"):
        simulator_program(tmp_path)


def test_without_simavr_it_names_the_packages_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = "fatal error: simavr/avr_adc.h: No such file"
    monkeypatch.setenv("PATH", f"{_programs(tmp_path, 'gcc', told=told)}:{os.environ['PATH']}")
    cache = tmp_path / "cache"
    with pytest.raises(ConfigurationError, match=r"simavr/avr_adc.h.*apt-get.*libsimavr-dev"):
        simulator_program(cache)
    assert list(cache.iterdir()) == []


def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ConfigurationError, match=r"file/cache.*set XDG_CACHE_HOME"):
        simulator_program(tmp_path / "file" / "cache")


def _programs(folder: Path, *names: str, told: str = "") -> Path:
    """A folder of programs that say something and fail."""
    folder = folder / "programs"
    folder.mkdir()
    for name in names:
        program = folder / name
        program.write_text(f"#!/bin/sh\necho '{told}' >&2\nexit 1\n")
        program.chmod(0o755)
    return folder

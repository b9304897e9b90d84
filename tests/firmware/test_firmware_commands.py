"""`--firmware` of `workstation virtual-robot` and `workstation demo`, as a person runs them."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ..end_to_end.processes import PROGRAMS
from ..ran import ran
from ..until import until
from .simulated_board import emulators_of, is_emulator

WORKSTATION = PROGRAMS.format("workstation")


def demo(folder: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    command = (WORKSTATION, "demo", "--json", "--seconds", "5", "--output", str(folder / "demo"))
    return ran(*command, *options)


@contextmanager
def virtual_robot(folder: Path, *options: str) -> Iterator["subprocess.Popen[bytes]"]:
    """In a process group of its own, as a shell would start it."""
    ready = folder / "ready.json"
    command = [WORKSTATION, "virtual-robot", "--plain", "--size", "64x48", *options]
    command += ["--camera-port", "0", "--board", str(folder / "board"), "--ready-file", str(ready)]
    with subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL) as process:
        try:
            assert until(lambda: ready.exists() or process.poll() is not None, 60)
            assert process.poll() is None
            yield process
        finally:
            process.kill()


def test_the_demo_drives_with_the_real_firmware(tmp_path: Path, firmware_folder: Path) -> None:
    done = demo(tmp_path, "--firmware", str(firmware_folder / "mbot-deadman.hex"))
    assert done.stdout, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["board_version"] == "mbot-deadman 3 300ms"
    assert result["board_has_deadman"]
    assert result["distance_driven_m"] > 0.1
    assert "accept_no_deadman = false" in (tmp_path / "demo" / "robot.toml").read_text()


def test_the_demo_does_not_drive_a_firmware_that_drives_on(tmp_path: Path, drives_on: Path) -> None:
    done = demo(tmp_path, "--firmware", str(drives_on))
    assert done.returncode == 6
    (line,) = done.stderr.splitlines()
    error = json.loads(line)["error"]
    assert error["kind"] == "refused"
    assert "--accept-no-deadman" in error["text"]


def test_the_demo_drives_it_if_told_to(tmp_path: Path, drives_on: Path) -> None:
    done = demo(tmp_path, "--firmware", str(drives_on), "--accept-no-deadman")
    assert done.stdout, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert (result["board_version"], result["board_has_deadman"]) == ("06.01.107", False)
    assert result["distance_driven_m"] > 0.1


@pytest.mark.parametrize("command", ["demo", "virtual-robot"])
def test_a_wrong_firmware_is_one_line_and_exit_code_2(command: str, tmp_path: Path) -> None:
    photo = tmp_path / "photo.elf"
    photo.write_bytes(b"\xff\xd8\xff")
    done = ran(WORKSTATION, command, "--firmware", str(photo))
    assert done.returncode == 2
    assert done.stderr.startswith(f"workstation: {photo} is not firmware of an mCore board")
    assert len(done.stderr.splitlines()) == 1


def test_ctrl_c_ends_robot_and_emulator(tmp_path: Path, firmware_folder: Path) -> None:
    firmware = str(firmware_folder / "mbot-deadman.elf")
    with virtual_robot(tmp_path, "--firmware", firmware) as process:
        (emulator,) = emulators_of(process.pid)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(20) == 0
        assert not is_emulator(emulator)
    assert not os.path.lexists(tmp_path / "board")


def test_a_killed_robot_leaves_no_emulator(tmp_path: Path, firmware_folder: Path) -> None:
    firmware = str(firmware_folder / "mbot-deadman.elf")
    with virtual_robot(tmp_path, "--firmware", firmware) as process:
        (emulator,) = emulators_of(process.pid)
        process.kill()
        assert until(lambda: not is_emulator(emulator))


def test_a_dead_emulator_ends_the_robot_with_a_reason(
    tmp_path: Path, firmware_folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    firmware = str(firmware_folder / "mbot-deadman.elf")
    with virtual_robot(tmp_path, "--firmware", firmware) as process:
        (emulator,) = emulators_of(process.pid)
        os.kill(emulator, signal.SIGKILL)
        assert process.wait(20) == 1
    assert capfd.readouterr().err == "workstation: the emulated board has ended: exit -9\n"

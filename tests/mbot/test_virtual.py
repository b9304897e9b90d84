"""`Robot.virtual`: wheels that an exception really stops, and that nothing is left behind."""

import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from mbot import ConfigurationError, ContractError, MbotError, RefusedError, Robot
from mbot.virtual import virtual_robot

from ..end_to_end.processes import Process
from ..until import until

POINTS = 3
"""A tenth of a second apart."""


class Trace:
    """Where a virtual robot has been."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "trajectory.jsonl"
        self.options = ("--plain", "--radius", "2.5", "--trajectory", str(self._file))

    def moves(self) -> bool:
        """Whether it drives now."""
        lines = [json.loads(line) for line in self._file.read_text().splitlines()[:-1]]
        last = [(one["x"], one["y"]) for one in lines if "x" in one][-POINTS:]
        return len(last) == POINTS and len(set(last)) == POINTS

    def stands(self) -> bool:
        return not self.moves()


def children(parent: int) -> set[int]:
    """Processes that it has started and that still run."""
    found: set[int] = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, its_parent = stat.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if int(its_parent) == parent and state != "Z":
            found.add(int(stat.parent.name))
    return found


def is_there(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def drive_and_fail(address: str, trace: Trace, error: type[BaseException]) -> None:
    with Robot(address) as robot:
        robot.drive(0.5, 0.5)
        assert until(trace.moves, 10)
        raise error


@pytest.mark.slow
def test_an_exception_in_the_block_stops_the_wheels(tmp_path: Path) -> None:
    trace = Trace(tmp_path)
    with virtual_robot("anna", "fetch", None, 0, trace.options) as (both, _):
        for error in (ZeroDivisionError, KeyboardInterrupt):
            with pytest.raises(error):
                drive_and_fail(both.address, trace, error)
            assert until(trace.stands, 3)
            time.sleep(0.5)
            assert trace.stands()
        with Robot(both.address) as robot:
            assert (robot.name, robot.state().state) == ("anna", "stopped")
            robot.drive(0.2, -0.2, seconds=0.3)


@pytest.mark.slow
def test_its_policy_drives_until_it_is_stopped(tmp_path: Path) -> None:
    trace = Trace(tmp_path)
    before = children(os.getpid())
    with Robot.virtual(policy="servo", options=trace.options) as robot:
        assert len(children(os.getpid()) - before) == 2
        assert robot.state().model == "servo"
        assert robot.run().state == "running"
        beats = [beat for beat in robot.beats(seconds=2.0) if beat.state == "running"]
        assert beats
        assert all(beat.action and beat.frame is not None for beat in beats)
        assert next(robot.frames(wide=True)).shape == (240, 320, 3)
        robot.stop()
        assert robot.state().state == "stopped"
    assert children(os.getpid()) == before


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_leave_nothing_behind(number: signal.Signals, tmp_path: Path) -> None:
    text = (
        "import time; from mbot import Robot\n"
        "with Robot.virtual(options=['--plain']) as robot:\n"
        "    robot.drive(0.2, 0.2)\n"
        "    print('drives', flush=True)\n"
        "    time.sleep(60)\n"
    )
    with Process(sys.executable, "-c", text, log=tmp_path / "log") as program:
        assert until(lambda: "drives" in program.output, 60), program.output
        both = children(program.pid)
        assert len(both) == 2
        program.signal(number)
        program.wait()
        assert "KeyboardInterrupt" in program.output
        assert until(lambda: not any(map(is_there, both)), 5)


@pytest.mark.slow
def test_without_a_policy_it_is_driven_by_hand_only() -> None:
    with (
        Robot.virtual(options=["--plain"]) as robot,
        pytest.raises(RefusedError, match="no model yet"),
    ):
        robot.run()


def test_what_is_wrong_is_said_before_anything_starts(tmp_path: Path) -> None:
    text = tmp_path / "text.onnx"
    text.write_text("no policy")
    before = children(os.getpid())
    with pytest.raises(ConfigurationError, match=r"no policy missing\.onnx"):
        Robot.virtual(policy="missing.onnx").__enter__()
    with pytest.raises(ContractError, match="text"):
        Robot.virtual(policy=text).__enter__()
    with pytest.raises(ConfigurationError, match="robot id"):
        Robot.virtual(name="a/b").__enter__()
    with pytest.raises(MbotError, match=r"did not start: .*no task 'fetsch'"):
        Robot.virtual(task="fetsch").__enter__()
    assert children(os.getpid()) == before

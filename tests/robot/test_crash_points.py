"""Rows of the fault table: power cut during activation; disk full, EIO.

Every system call of the store is a point at which the power fails (all that may be left on the disk
is tried), the process is killed, or the disk refuses. Once more with strace and a real SIGKILL in
`test_killed_by_strace.py`.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from mbot_protocol.files import atomic_file
from mbot_protocol.v1.messages_pb2 import PushReply

from .faulty_disk import EIO, ENOSPC, FaultyDisk, State, fails_at, put
from .model_bench import KEY, Robot, digest
from .tiny_models import constant_model

A, B, C, D = (constant_model(0.1, 0.1, name=name) for name in "ABCD")


class Story:
    """What happens to a robot; each step with the model that is active afterwards."""

    def __init__(self, directory: Path) -> None:
        self.robot = Robot(directory, keep=2)
        self.steps: list[tuple[Callable[[], object], str]] = [
            (lambda: self._now().push(A), "A"),
            (lambda: self._now().decide_well(), "A"),
            (lambda: self._now().push(B), "B"),
            (lambda: self._now().fail(), "A"),
            (lambda: self._now().push(C), "C"),
            (self._restart, "C"),
            (lambda: self._now().decide_well(), "C"),
            (lambda: self._now().activate(digest(A)), "A"),
            (lambda: self._now().push(D), "D"),
            (lambda: self._now().push(B), "B"),
            (lambda: self._now().fail(), "A"),
        ]

    def _now(self) -> Robot:
        return self.robot

    def _restart(self) -> None:
        self.robot = Robot(self.robot.directory, keep=2)


@dataclass
class Seen:
    """A state of the disk, and what may be made of it."""

    state: State
    allowed: set[str]
    least_floor: int


def test_after_a_power_cut_at_any_point_one_whole_model_loads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "models").mkdir()
    disk = FaultyDisk(tmp_path / "models")
    story = Story(tmp_path / "models")
    found: dict[frozenset[tuple[str, bytes]], Seen] = {}
    before, floor = "", 0
    for act, after in story.steps:

        def look(before: str = before, after: str = after, floor: int = floor) -> None:
            for state in (disk.after_kill(), *disk.after_power_cut()):
                key = frozenset(state.items())
                seen = found.setdefault(key, Seen(state, set(), floor))
                seen.allowed |= {before, after}

        disk.watch = look
        with monkeypatch.context() as patched:
            patched.setattr(atomic_file, "os", disk)
            act()
        assert story.robot.active == after
        before, floor = after, story.robot.floors.of(KEY.public.raw)
    assert len(found) > 100
    for number, seen in enumerate(found.values()):
        life = Robot(put(seen.state, tmp_path / "after" / str(number % 20)), keep=2)
        assert life.active in seen.allowed, number
        assert life.floors.of(KEY.public.raw) >= seen.least_floor
        with life.keeper:
            pass  # an orderly end, and the next start finds the same
        assert Robot(life.directory, keep=2).active == life.active
        assert not list(life.directory.glob("*.tmp"))


def test_the_sequence_is_durable_before_the_model_is_active(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a power cut would open a way back for the push that was just replaced."""
    robot = Robot(tmp_path / "models")
    robot.push(A)
    disk = FaultyDisk(robot.directory)
    states: list[State] = []
    disk.watch = lambda: states.extend(disk.after_power_cut())
    monkeypatch.setattr(atomic_file, "os", disk)
    robot.push(B)
    monkeypatch.undo()
    floor = robot.floors.of(KEY.public.raw)
    different = {frozenset(state.items()): state for state in states}.values()
    active = [Robot(put(state, tmp_path / "after")) for state in different]
    assert {life.active for life in active} == {"A", "B"}
    assert {life.floors.of(KEY.public.raw) for life in active if life.active == "B"} == {floor}


@pytest.mark.parametrize(
    ("code", "for_good"),
    [(EIO, False), (EIO, True), (ENOSPC, False)],
    ids=["EIO", "dead", "ENOSPC"],
)
def test_a_disk_that_refuses_at_any_point_costs_no_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, for_good: bool
) -> None:
    number, refused = 0, 0
    while True:
        story = Story(tmp_path / str(number))
        for act, _ in story.steps[:2]:
            act()
        disk = FaultyDisk(story.robot.directory)
        disk.fault = fails_at(number, code, for_good=for_good)
        for act, _ in story.steps[2:6]:
            before = story.robot.active
            with monkeypatch.context() as patched:
                patched.setattr(atomic_file, "os", disk)
                reply = act()
            after = Robot(put(disk.after_kill(), tmp_path / "restart"), keep=2).active
            assert story.robot.active
            assert after
            if isinstance(reply, PushReply) and not reply.accepted:
                refused += 1
                assert os.strerror(code) in reply.reason
                assert story.robot.active == before
            if isinstance(reply, PushReply) and not for_good:
                # What was said is what a restart finds.
                assert after == story.robot.active, (number, disk.calls[number])
        if number >= len(disk.calls):
            break
        number += 1
    assert number > 50
    assert refused > 40

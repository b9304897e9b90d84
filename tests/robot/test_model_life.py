"""Any order of pushes, roll-backs, crashes, power cuts, full disks; always a working model."""

import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
)

from mbot_protocol.errors import ContractError
from mbot_protocol.files import atomic_file
from mbot_protocol.policy.dry_run import Report

from .faulty_disk import EIO, ENOSPC, FaultyDisk, PowerCut, dies_at, fails_at, no_fault, put
from .model_bench import KEY, Robot, SignedManifest, digest, sign
from .tiny_models import constant_model

MODELS = {name: constant_model(0.1, 0.1, name=name) for name in "ABCD"}
BAD = constant_model(0.2, 0.2, name="bad")

names = st.sampled_from(sorted(MODELS))
numbers = st.integers(0, 40)


def try_model(data: bytes, _rate_hz: float) -> Report:
    if data == BAD:
        raise ContractError("the model answered (nan, 0), expected two finite numbers")
    return Report(0.1, 0)


class ModelLife(RuleBasedStateMachine):
    """The real store, keeper and service on a disk that may fail."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.directory = self.folder / "models"
        self.patched = pytest.MonkeyPatch()
        self.had_one = False
        self.floor = 0
        self.recorded: SignedManifest | None = None
        self._start()

    def teardown(self) -> None:
        self.patched.undo()
        shutil.rmtree(self.folder)

    def _start(self) -> None:
        self.patched.undo()
        self.disk = FaultyDisk(self.directory)
        self.patched.setattr(atomic_file, "os", self.disk)
        self.robot = Robot(self.directory, keep=2, try_model=try_model)

    @initialize()
    def first(self) -> None:
        self.push("A")
        assert self.robot.active == "A"

    @rule(name=names)
    def push(self, name: str) -> None:
        before = self.robot.active
        signed = sign(MODELS[name], self.robot.nonce())
        reply = self.robot.push(MODELS[name], signed)
        self.recorded = signed
        assert self.robot.active == (name if reply.accepted else before)

    @rule()
    def push_a_bad_one(self) -> None:
        before = self.robot.active
        assert not self.robot.push(BAD).accepted
        assert self.robot.active == before

    @precondition(lambda self: self.recorded is not None)
    @rule(name=names)
    def replay(self, name: str) -> None:
        before = self.robot.active
        assert not self.robot.push(MODELS[name], self.recorded).accepted
        assert self.robot.active == before

    @rule()
    def go_back(self) -> None:
        before, previous = self.robot.active, self.robot.store.activation.previous
        reply = self.robot.activate()
        assert reply.accepted == bool(previous) or self.robot.active == before

    @rule(name=names)
    def choose(self, name: str) -> None:
        before = self.robot.active
        reply = self.robot.activate(digest(MODELS[name]))
        assert self.robot.active == (name if reply.accepted else before)

    @precondition(lambda self: self.robot.used)
    @rule()
    def decide_well(self) -> None:
        self.robot.decide_well()

    @precondition(lambda self: self.robot.used)
    @rule()
    def fail(self) -> None:
        self.robot.fail()

    @precondition(lambda self: self.robot.used)
    @rule()
    def idle(self) -> None:
        for _ in range(5):
            self.robot.trial.idle()
        self.robot.settle()

    @rule()
    def restart(self) -> None:
        with self.robot.keeper:
            pass
        self._start()

    @rule()
    def crash(self) -> None:
        """Killed: whatever was done is on the disk."""
        self._start()

    @rule(what=st.sampled_from(["push", "choose", "fail", "restart"]), name=names, number=numbers)
    def with_a_full_disk(self, what: str, name: str, number: int) -> None:
        self.disk.fault = fails_at(len(self.disk.calls) + number, ENOSPC)
        self._do(what, name)
        self.disk.fault = no_fault

    @rule(what=st.sampled_from(["push", "choose", "fail"]), name=names, number=numbers)
    def with_a_dying_disk(self, what: str, name: str, number: int) -> None:
        self.disk.fault = fails_at(len(self.disk.calls) + number, EIO, for_good=True)
        self._do(what, name)
        self._start()  # with another card, a copy of this one

    @rule(
        what=st.sampled_from(["push", "choose", "fail", "crash", "decide_well"]),
        name=names,
        number=numbers,
        which=st.integers(0, 10**6),
    )
    def power_cut(self, what: str, name: str, number: int, which: int) -> None:
        self.disk.fault = dies_at(len(self.disk.calls) + number)
        try:
            self._do(what, name)
        except PowerCut:
            pass
        else:
            self.disk.fault = no_fault
        states = list(self.disk.after_power_cut())
        self.patched.undo()
        put(states[which % len(states)], self.directory)
        self._start()

    def _do(self, what: str, name: str) -> None:
        acts: dict[str, Callable[[], None]] = {
            "push": lambda: self.push(name),
            "choose": lambda: self.choose(name),
            "fail": self.fail,
            "decide_well": self.decide_well,
            "restart": self.restart,
            "crash": self.crash,
        }
        if self.robot.used or what in ("push", "choose", "restart", "crash"):
            acts[what]()

    @invariant()
    def a_working_model_is_active_here_and_after_a_restart(self) -> None:
        activation = self.robot.store.activation
        alone = not self.robot.store.successors(activation.active)
        if activation.crashes(activation.active, time.time()) and alone:
            return  # the only model, and it takes the daemon down: better none
        self.had_one = self.had_one or bool(self.robot.active)
        if not self.had_one:
            return
        assert self.robot.active
        with self.robot.keeper._turn:  # pyright: ignore[reportPrivateUsage]
            copy = shutil.copytree(self.directory, self.folder / "copy", dirs_exist_ok=False)
        self.patched.undo()
        again = Robot(copy, keep=2)
        left_out = any(notice.kind == "model-left-out" for notice in again.notices)
        assert again.active or left_out
        assert again.floors.of(KEY.public.raw) >= self.floor
        shutil.rmtree(copy)
        self.patched.setattr(atomic_file, "os", self.disk)

    @invariant()
    def sequences_never_go_down(self) -> None:
        floor = self.robot.floors.of(KEY.public.raw)
        assert floor >= self.floor
        self.floor = floor


TestModelLife = ModelLife.TestCase
TestModelLife.settings = settings(
    max_examples=25,
    stateful_step_count=20,
    suppress_health_check=[HealthCheck.too_slow],
)

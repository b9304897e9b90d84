"""A recorded drive decided once more, by the robot's own runtime: where does it differ?"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.actions import Steps, to_steps
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.engine import processor_name
from mbot_protocol.policy.policy import Answer, Policy, PolicyError
from mbot_protocol.policy.policy_contract import FieldOfView, Memory
from mbot_workstation.pictures.picture_file import observation

TOLERANCE = 1e-5
"""Of an action on another processor, whose float32 adds up in another order."""

MODEL_PLACES = ("*.onnx", "models/*.onnx", "runs/*/*.onnx")

Progress = Callable[[int, int], None]
Wheels = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Redecided:
    """One decision, then and now.

    Attributes:
        beat: as recorded.
        since_s: from the recording's begin.
        action: what comes out now.
        action_then: what the policy answered on the robot; what a hand did, where one drove.
        levels: what the motors would be told now, in 255ths.
        levels_then: what they were told.
        same_memory: whether the policy went on with the very memory it had then.
        failure: why there is no action now; empty: there is one.

    """

    beat: Beat
    since_s: float
    action: Wheels
    action_then: Wheels
    levels: tuple[int, int]
    levels_then: tuple[int, int]
    same_memory: bool
    failure: str = ""

    @property
    def difference(self) -> float:
        """Of the wheel that differs more; infinite without an action."""
        if self.failure:
            return float("inf")
        return max(abs(a - b) for a, b in zip(self.action, self.action_then, strict=True))

    @property
    def apart(self) -> float:
        """The mean of both wheels' differences, as they would have turned; 1 without an action."""
        if self.failure:
            return 1.0
        both = zip(self.action, self.action_then, strict=True)
        return sum(abs(max(-1.0, min(1.0, now)) - then) for now, then in both) / 2

    @property
    def is_exact(self) -> bool:
        """To the last bit: action, motor bytes, and what the policy remembered."""
        same = self.action == self.action_then and self.levels == self.levels_then
        return same and self.same_memory and not self.failure


@dataclass(frozen=True, slots=True)
class Replay:
    """What came of it.

    Attributes:
        drive: the recording.
        model_sha256, model_name: what has decided now; digests with a comma if several.
        same_model: whether it is what drove.
        same_processor: whether it was computed on the same kind.
        decisions: in order.
        left_out: decisions that could not be asked again: their picture is not in the recording.
        other_views: where the model wants to see another field of view than the recorded pictures
            show: what they show (None: the recording does not say), and what it wants.

    """

    drive: RecordedDrive
    model_sha256: str
    model_name: str
    same_model: bool
    same_processor: bool
    decisions: tuple[Redecided, ...]
    left_out: int
    other_views: tuple[tuple[FieldOfView | None, FieldOfView], ...] = ()

    @property
    def exact(self) -> int:
        """How many decisions are the same to the last bit."""
        return sum(one.is_exact for one in self.decisions)

    @property
    def same_motor_bytes(self) -> int:
        """In how many the board would be sent the same."""
        return sum(one.levels == one.levels_then for one in self.decisions)

    @property
    def largest_difference(self) -> float:
        """Of any wheel's action in any decision."""
        return max((one.difference for one in self.decisions), default=0.0)

    @property
    def is_as_expected(self) -> bool:
        """The same model must decide the same, on another processor to 1e-5."""
        if not self.same_model:
            return all(not one.failure for one in self.decisions)
        if self.same_processor:
            return self.exact == len(self.decisions)
        return self.largest_difference <= TOLERANCE


def models_near(here: Path) -> list[Path]:
    """Where a model that drove may lie, from a folder on."""
    return [path for places in MODEL_PLACES for path in sorted(here.glob(places))]


def replay(
    drive: RecordedDrive,
    models: Sequence[Path],
    other: Path | None = None,
    on_progress: Progress = lambda _done, _all: None,
) -> Replay:
    """Decide a drive once more.

    Args:
        drive: from the robot's own card: telemetry's pictures are not what the policy saw.
        models: files among which the models that drove are looked for, by their digests.
        other: a model that did not drive, asked in their place, and beside a hand as well.
        on_progress: hears how many decisions of how many are done.

    Raises:
        ConfigurationError: nothing can be replayed, or a model that drove is not among the files.
        ContractError, NewerSchemaError: a model cannot be loaded.

    """
    facts = drive.facts
    decided = [one for one in drive.beats if one.decided or (other is not None and one.by_hand)]
    usable = [beat for beat in decided if beat.is_replayable]
    if facts is None or not usable:
        raise ConfigurationError(f"{drive.name} cannot be replayed: {_why_not(drive)}")
    digests = list(dict.fromkeys(beat.decision.model_sha256 for beat in usable))
    paths = {digest: other or find_model(digest, models) for digest in digests}
    loaded = {path: Policy.load(path) for path in dict.fromkeys(paths.values())}
    policies = {digest: loaded[path] for digest, path in paths.items()}
    return Replay(
        drive,
        ", ".join(policy.sha256 for policy in loaded.values()),
        ", ".join(policy.metadata.name for policy in loaded.values()),
        all(policy.sha256 == digest for digest, policy in policies.items()),
        processor_name() == facts.processor,
        tuple(_decided_again(drive, facts, usable, policies, on_progress)),
        len(decided) - len(usable),
        _other_views(usable, policies),
    )


def _other_views(
    beats: Sequence[Beat], policies: Mapping[str, Policy]
) -> tuple[tuple[FieldOfView | None, FieldOfView], ...]:
    """Pictures of another view are not what the model would have seen: no question to ask it."""
    found: dict[tuple[FieldOfView | None, FieldOfView], None] = {}
    for beat in beats:
        digest = beat.decision.model_sha256
        shown, wanted = beat.view, policies[digest].metadata.view
        if shown is None and policies[digest].sha256 == digest:
            continue  # it was what drove, so its view is theirs
        if shown != wanted:
            found[shown, wanted] = None
    return tuple(found)


def _decided_again(
    drive: RecordedDrive,
    facts: RobotFacts,
    beats: Sequence[Beat],
    policies: Mapping[str, Policy],
    on_progress: Progress,
) -> list[Redecided]:
    """Ask for each decision the policy that stands for the one that drove, by its digest."""
    found: list[Redecided] = []
    deciders = {policy.sha256: _Decider(policy) for policy in policies.values()}
    before, told = -1, (0.0, 0.0)
    for beat in beats:
        known, digest = beat.policy_input, beat.decision.model_sha256
        assert known is not None
        policy = policies[digest]
        decider, drove = deciders[policy.sha256], policy.sha256 == digest
        decider.recall(beat, told, follows=beat.decision.sequence == before + 1, drove=drove)
        before, told = beat.decision.sequence, drive.at_wheels(beat)
        memory = decider.memory.state.tobytes() if decider.memory is not None else b""
        action, failure = (0.0, 0.0), ""
        try:
            action = decider.decide(beat)
        except PolicyError as error:
            failure = str(error)
        steps, then = to_steps(*action), beat.decision.action
        found.append(
            Redecided(
                beat,
                drive.since_s(beat),
                action,
                told if beat.by_hand else (then.left, then.right),
                facts.wheels.levels(facts.wheels.duties(steps)),
                _levels_then(beat, facts),
                not drove or memory == known.memory,
                failure,
            )
        )
        on_progress(len(found), len(beats))
    return found


class _Decider:
    """A policy with what it remembers.

    Attributes:
        memory: what the next decision goes on with; None: it starts over.

    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._answer: Answer | None = None
        self.memory: Memory | None = None

    def recall(self, beat: Beat, wheels: Wheels, *, follows: bool, drove: bool) -> None:
        """Remember what the policy did before this beat.

        Args:
            beat: to be decided next.
            wheels: what they were told in the beat decided last.
            follows: it comes right after that one; else the recorded memory counts.
            drove: this policy drove; the state of one model says nothing to another.

        """
        known = beat.policy_input
        assert known is not None
        # Of a policy that was not asked beside the hand nothing is recorded.
        asked = beat.decided or beat.decision.HasField("would_have_done")
        told = (beat.told or wheels) if asked else wheels
        begins_anew = known.began_anew or not (asked or follows)
        recorded = b"" if follows else known.memory or b""
        blank = self._policy.blank.state
        if begins_anew or (recorded and not (drove and len(recorded) == blank.nbytes)):
            self.memory = self._answer = None
        elif recorded:
            state = np.frombuffer(recorded, "<f4").astype(np.float32).reshape(blank.shape)
            self.memory, self._answer = Memory(state, told), None
        elif self._answer is not None:
            self.memory = Memory(self._answer.state, told)

    def decide(self, beat: Beat) -> Wheels:
        """Left and right wheel, not yet clipped; raises PolicyError."""
        if (picture := observation(beat)) is None:
            raise PolicyError("what it saw is no picture")
        self._answer = self._policy.decide(picture, self.memory or self._policy.blank)
        return self._answer.left, self._answer.right


def _levels_then(beat: Beat, facts: RobotFacts) -> tuple[int, int]:
    then = beat.decision.board_m1, beat.decision.board_m2
    if any(then):
        return then
    # A stop came in between: what the policy wanted of the motors.
    steps = beat.decision.steps
    return facts.wheels.levels(facts.wheels.duties(Steps(steps.left, steps.right)))


def find_model(digest: str, models: Sequence[Path]) -> Path:
    """The file that drove, by its digest.

    Raises:
        ConfigurationError: none of them is it.

    """
    import hashlib

    for path in models:
        if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest:
            return path
    short = re.sub(r"[^0-9a-f]", "", digest)[:12]
    raise ConfigurationError(
        f"model {short or 'without a digest'} drove, and none of {len(models)} files here is it: "
        "name it, or one to compare with, by --model FILE"
    )


def _why_not(drive: RecordedDrive) -> str:
    if not drive.decided and any(beat.by_hand for beat in drive.beats):
        return "a person drove it, and no policy (`workstation drives review` compares the two)"
    if not drive.decided:
        return "no policy drove in it"
    return (
        "it is of telemetry, whose pictures are not exactly what the policy saw; fetch the robot's "
        "own recording (`workstation recordings fetch`)"
    )

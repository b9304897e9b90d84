"""A recorded drive decided once more, by the daemon's own code: where does it differ?"""

import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.actions import Steps
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FieldOfView
from mbot_protocol.policy.replay_step import ReplayAnswer, ReplayGreeting, ReplayStep
from mbot_workstation.look.drives.decider import MOST_ASKED, Decider
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
        action: what comes out now; before, it was `beat.decision.action`.
        levels: what the motors would be told now, in 255ths.
        levels_then: what they were told.
        same_memory: whether the policy went on with the very memory it had then.
        failure: why there is no action now; empty: there is one.

    """

    beat: Beat
    since_s: float
    action: Wheels
    levels: tuple[int, int]
    levels_then: tuple[int, int]
    same_memory: bool
    failure: str = ""

    @property
    def action_then(self) -> Wheels:
        """What the policy answered on the robot."""
        return self.beat.decision.action.left, self.beat.decision.action.right

    @property
    def difference(self) -> float:
        """Of the wheel that differs more; infinite without an action."""
        if self.failure:
            return float("inf")
        return max(abs(a - b) for a, b in zip(self.action, self.action_then, strict=True))

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
        other: a model that did not drive, asked in their place.
        on_progress: hears how many decisions of how many are done.

    Raises:
        ConfigurationError: nothing can be replayed, or a model that drove is not among the files.
        MbotError: the daemon's program says why it cannot decide.

    """
    facts, decided = drive.facts, drive.decided
    usable = [beat for beat in decided if beat.is_replayable]
    if facts is None or not usable:
        raise ConfigurationError(
            f"{drive.name} cannot be replayed: {_why_not(drive)}; fetch the robot's own recording "
            "(`workstation recordings fetch`)"
        )
    digests = list(dict.fromkeys(beat.decision.model_sha256 for beat in usable))
    paths = {digest: other or find_model(digest, models) for digest in digests}
    with ExitStack() as stack:
        running = {
            path: stack.enter_context(Decider(path)) for path in dict.fromkeys(paths.values())
        }
        found = _decided_again(
            drive, usable, {d: running[p] for d, p in paths.items()}, on_progress
        )
        greetings = [decider.greeting for decider in running.values()]
    return Replay(
        drive,
        ", ".join(greeting.sha256 for greeting in greetings),
        ", ".join(greeting.name for greeting in greetings),
        all(running[path].greeting.sha256 == digest for digest, path in paths.items()),
        all(greeting.processor == facts.processor for greeting in greetings),
        tuple(found),
        len(decided) - len(usable),
        _other_views(usable, {d: running[p].greeting for d, p in paths.items()}),
    )


def _other_views(
    beats: Sequence[Beat], greetings: dict[str, ReplayGreeting]
) -> tuple[tuple[FieldOfView | None, FieldOfView], ...]:
    """Pictures of another view are not what the model would have seen: no question to ask it."""
    found: dict[tuple[FieldOfView | None, FieldOfView], None] = {}
    for beat in beats:
        digest = beat.decision.model_sha256
        greeting = greetings[digest]
        if not all(greeting.view_deg):
            continue
        shown, wanted = beat.view, FieldOfView(*greeting.view_deg)
        if shown is None and greeting.sha256 == digest:
            continue  # it was what drove, so its view is theirs
        if shown != wanted:
            found[shown, wanted] = None
    return tuple(found)


def _decided_again(
    drive: RecordedDrive,
    beats: Sequence[Beat],
    deciders: dict[str, Decider],
    on_progress: Progress,
) -> list[Redecided]:
    """Ask for each decision who stands for the model that drove, by its digest; some ahead."""
    found: list[Redecided] = []
    waiting: deque[tuple[Beat, Decider, bool]] = deque()

    def take() -> None:
        beat, decider, is_same = waiting.popleft()
        found.append(_compared(drive, beat, decider.answer(), same_model=is_same))
        on_progress(len(found), len(beats))

    for beat, step in _steps(beats):
        digest = beat.decision.model_sha256
        is_same = deciders[digest].greeting.sha256 == digest
        # The state of one model says nothing to another.
        lost = bool(step.memory) and not is_same
        deciders[digest].ask(ReplayStep(step.observation, True, step.told) if lost else step)
        waiting.append((beat, deciders[digest], is_same))
        if len(waiting) == MOST_ASKED:
            take()
    while waiting:
        take()
    return found


def _steps(beats: Sequence[Beat]) -> Iterator[tuple[Beat, ReplayStep]]:
    """What the policy is asked. After a gap it goes on with the memory that was recorded."""
    before = -1
    for beat in beats:
        known, picture = beat.policy_input, observation(beat)
        assert known is not None
        assert picture is not None
        follows = beat.decision.sequence == before + 1
        yield (
            beat,
            ReplayStep(
                picture.tobytes(),
                known.began_anew,
                beat.told or (0.0, 0.0),
                b"" if follows else known.memory,
            ),
        )
        before = beat.decision.sequence


def _compared(
    drive: RecordedDrive, beat: Beat, answer: ReplayAnswer, *, same_model: bool
) -> Redecided:
    decision, known, facts = beat.decision, beat.policy_input, drive.facts
    assert known is not None
    assert facts is not None
    wheels = facts.wheels
    then = decision.board_m1, decision.board_m2
    if not any(then):  # a stop came in between: what the policy wanted of the motors
        then = wheels.levels(wheels.duties(Steps(decision.steps.left, decision.steps.right)))
    return Redecided(
        beat,
        drive.since_s(beat),
        answer.action,
        wheels.levels(wheels.duties(Steps(*answer.steps))),
        then,
        not same_model or answer.memory == known.memory,
        answer.failure,
    )


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
    if not drive.decided:
        return "no policy drove in it"
    return "it is of telemetry, whose pictures are not exactly what the policy saw"

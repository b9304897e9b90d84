"""`workstation promote`: whether what was trained may take the place of what drives."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import (
    calibration_option,
    json_option,
    photographs,
    task_option,
)
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer, table, working
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from mbot_protocol.beat.recorded_drive import RecordedDrive
    from mbot_workstation.learn.evaluation.episodes import Estimate
    from mbot_workstation.learn.evaluation.promotion import Compared, Promotion

REFUSED = 1
"""Exit code."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PromoteOptions:
    """What `promote` takes."""

    policy: Path = argument("A run's folder, or an exported policy.", metavar="RUN|MODEL.onnx")
    against: Path | None = option(
        None,
        "What drives now; if not given, what drove the drives held out, found by its digest among "
        "`*.onnx`, `models/*.onnx` and `runs/*/*.onnx` here.",
        metavar="MODEL.onnx",
    )
    drives: Path = option(Path("drives"), "Folder that `recordings fetch` has filled.")
    episodes: int = option(100, "In simulation, of each policy on each kind of robot.", min=2)
    pictures: list[Path] | None = option(
        None,
        "More labelled pictures, as of `evaluate`; the labels of the drives held out count "
        "anyway. Repeatable.",
        metavar="FOLDER",
    )
    task: str = task_option()
    calibration: Path | None = calibration_option()
    seed: int = option(0, "Of rooms, robots and objects.")
    workers: int | None = option(None, "Processes; one a core if not given.", min=0)
    as_json: bool = json_option()


@with_options
def promote(options: PromoteOptions) -> Answer:
    """Say whether a policy may take the place of the one that drives; exit code 1: it may not.

    It must be nearer to the hand on the kept drives for judging, and no worse beyond the intervals
    in simulation, on nominal and on rough robots, and on labelled pictures.

    Examples:

    - `workstation promote runs/kitchen --drives drives`
    - `workstation promote kitchen.onnx --against models/red-cube.onnx --episodes 16`
    """
    from tempfile import TemporaryDirectory

    from mbot_protocol.beat.recorded_drive import read_drives
    from mbot_protocol.policy.policy import Policy
    from mbot_workstation.fleet.models.trained_task import trained_task
    from mbot_workstation.learn.evaluation.promotion import Promotion, objections
    from mbot_workstation.look.collect.reviews import drives_in, kept_for, read_review
    from mbot_workstation.look.drives.replayed_drive import find_model, models_near

    reviews = {path: read_review(path) for path in drives_in(options.drives)}
    kept = kept_for(reviews, ("judging",))["judging"]
    drives = [one for one in read_drives(kept) if any(beat.by_hand for beat in one.beats)]
    if not drives:
        raise ConfigurationError(
            f"no hand has driven in the {len(kept)} drives for judging: take over where the policy "
            "is wrong, or choose other ones by `workstation drives keep DRIVE --for judging`"
        )
    with TemporaryDirectory() as folder:
        model = _model(options, Path(folder))
        if learned := [path.name for path in kept if path.name in trained_task(model).drives]:
            raise ConfigurationError(
                f"{options.policy} has learned from {learned[0]}, so it can't be judged by it: "
                f"`workstation drives keep {typed(learned[0])} --for training`"
            )
        drove = drives[-1].beats[-1].decision.model_sha256
        against = options.against or find_model(drove, models_near(Path()))
        pair = (against, model)
        rows = [
            *_by_hand(drives, pair),
            *_pictured(kept, options, pair, Path(folder)),
            *_simulated(options, pair),
        ]
        digests = (Policy.load(model).sha256, Policy.load(against).sha256)
    why_not = tuple(objections(rows))
    found = Promotion(*digests, not why_not, why_not, tuple(rows))
    return Answer(found, _said(found, options), exit_code=0 if found.passed else REFUSED)


def _model(options: PromoteOptions, folder: Path) -> Path:
    """The policy as a file."""
    if options.policy.is_file():
        return options.policy
    from mbot_workstation.fleet.models.written_policy import write_policy
    from mbot_workstation.learn.learning.policy_export import export_policy
    from mbot_workstation.learn.learning.trained_policy import trained_policy

    policy = trained_policy(options.policy, options.task)
    path = folder / "policy.onnx"
    write_policy(path, policy.name, export_policy(policy, policy.name))
    return path


def _by_hand(drives: "Sequence[RecordedDrive]", pair: tuple[Path, Path]) -> "Iterator[Compared]":
    """How far each policy is from the hand, by drives."""
    from mbot_workstation.learn.evaluation.promotion import compare
    from mbot_workstation.look.drives.replay_words import view_words
    from mbot_workstation.look.drives.replayed_drive import replay

    def apart(drive: "RecordedDrive", model: Path) -> list[float]:
        found = replay(drive, [], model)
        if found.other_views:
            said = " ".join(" ".join(view_words(*found.other_views[0])).split())
            raise ConfigurationError(f"{drive.name}, {model}: {said}; judge by other drives")
        return [one.apart for one in found.decisions if one.beat.by_hand]

    both = [tuple(apart(drive, model) for model in pair) for drive in drives]
    before, after = ([sum(of[place]) for of in both] for place in range(2))
    beats = [len(now) for now, _ in both]
    yield compare("hand", "distance from hand", before, after, weights=beats)


def _pictured(
    kept: Sequence[Path], options: PromoteOptions, pair: tuple[Path, Path], folder: Path
) -> "Iterator[Compared]":
    """Mistakes on labelled pictures, those of the drives held out among them."""
    from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
    from mbot_workstation.learn.evaluation.labelled_pictures import (
        KINDS,
        PLAIN_KINDS,
        judge,
        observations,
        read_labelled,
    )
    from mbot_workstation.learn.evaluation.promotion import compare
    from mbot_workstation.look.collect.exports import write_pictures

    counts, _ = write_pictures(folder, {"judging": kept})
    folders = [*([folder / "judging"] if counts["judging"] else []), *(options.pictures or [])]
    for place in folders:
        labelled = read_labelled(place)
        scores = []
        for path in pair:
            policy = OnnxPolicy.load(path)
            seen = observations(labelled, None, policy.metadata.view)
            scores.append(judge(policy.act(seen), labelled))
        name = "the drives held out" if place.parent == folder else str(place)
        for kind in PLAIN_KINDS:
            able = [one.name for one in labelled if kind in one.kinds]
            wrong = ([float(one in score[kind].names) for one in able] for score in scores)
            if able:
                yield compare("pictures", f"{KINDS[kind]}, {name}", *wrong)


def _simulated(options: PromoteOptions, pair: tuple[Path, Path]) -> "Iterator[Compared]":
    """Rewards of the same episodes, on nominal robots and on those of the last lesson."""
    from mbot_workstation.learn.drivers.contestants import titles
    from mbot_workstation.learn.evaluation.episodes import Trial, evaluate
    from mbot_workstation.learn.evaluation.objects_tried import objects_tried
    from mbot_workstation.learn.evaluation.promotion import compare
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.effects.presets import preset
    from mbot_workstation.tasks.find import find_task, full_reference
    from mbot_workstation.tasks.lesson import lesson_named

    task, files = find_task(options.task), files_to_simulate(options.calibration)
    ranges = files.ranges if options.calibration else preset
    (thing,), _ = objects_tried(titles([str(path) for path in pair]), [])
    scene = replace(files.scene, objects=thing.kinds)
    rooms = evaluation_rooms(photographs([], options.calibration))
    for robots, guided in (("nominal", False), ("lived-in", True)):
        lesson = lesson_named(task.lessons, task.course(guided=guided, further=guided)[-1])
        trial = Trial(lesson, ranges(robots), rooms, options.episodes, options.seed)
        trial = replace(trial, workers=options.workers, robot=files.robot, scene=scene)
        trial = replace(trial, task=full_reference(options.task))
        rewards: list[list[float]] = []
        for path in pair:
            with working(f"{path.stem}, {robots}", trial.episodes) as done:
                rewards.append([one.reward for one in evaluate(str(path), trial, done)])
        name = f"reward, {'rough' if guided else robots}"
        yield compare("simulation", name, *rewards, more_is_better=True)


def _said(found: "Promotion", options: PromoteOptions) -> Iterator:
    def words(one: "Estimate") -> str:
        return f"{one.mean:.2f} ({one.low:.2f} to {one.high:.2f})"

    rows = (
        (
            one.name,
            str(one.count),
            words(one.before),
            words(one.after),
            "better" if one.is_better else "WORSE" if one.is_worse else "as good",
        )
        for one in found.compared
    )
    yield table(("", "of", "now, 95 %", "new, 95 %", ""), rows, right=("of",))
    yield from found.objections
    if not found.passed:
        yield "it stays where it is: not to be pushed"
    elif options.policy.is_file():
        yield f"next: workstation push-model {typed(options.policy)}"
    else:
        name = f"{options.policy.resolve().name}.onnx"
        yield f"next: workstation export {typed(options.policy)} -o {typed(name)}"
        yield f"then: workstation push-model {typed(name)}"

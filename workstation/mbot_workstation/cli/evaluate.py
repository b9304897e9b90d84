"""Evaluate policies: how good they are, what they look at, what they bear."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import (
    calibration_option,
    find_lesson,
    json_option,
    object_option,
    photographs,
    task_option,
)
from mbot_workstation.cli.options import (
    PICTURES,
    argument,
    option,
    output_file,
    output_folder,
    with_options,
)
from mbot_workstation.cli.presenter import Answer, note, working

if TYPE_CHECKING:
    from mbot_workstation.learn.evaluation.activations import Activations
    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.evaluation.evaluation_report import Line
    from mbot_workstation.learn.studies.study_run import Condition
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
    from mbot_workstation.sim.effects.effects import EffectRanges


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateOptions:
    """What `evaluate` takes."""

    contestants: list[str] = argument(
        "ONNX policies, or servo (the colour servo), random, oracle (is told where the "
        "object is: an upper bound).",
        metavar="MODEL...",
    )
    episodes: int = option(100, "For each of them.", min=1)
    task: str = task_option()
    lesson: str | None = option(
        None, "Of the task; of fetch 1 to 10, blur or rough, 10 if not given.", metavar="NAME"
    )
    preset: list[str] | None = option(
        None,
        "Robots to try it on: ideal, nominal, randomised, or a perturbed one such as "
        "uneven, handicap, sluggish, slippery, blurry, noisy, distorted, dim, bright, late; "
        "all for every one. May be given several times; nominal if not.",
    )
    calibration: Path | None = calibration_option()
    object: list[Path] | None = object_option(
        "What they shall fetch, as of train; what they were trained for if not given. Given "
        "several times: a table of policies by objects.",
    )
    panorama: list[Path] | None = option(
        None,
        "360-degree photo of a room to try it in, in place of the two that come along; may be "
        "given several times.",
        metavar="FILE",
    )
    made_up_rooms: int | None = option(
        None,
        "Extra generated rooms, none of which training uses; 4 without a photo, 0 with one.",
        min=0,
        metavar="N",
    )
    seed: int = option(0, "Of rooms, robots and objects.")
    workers: int | None = option(None, "Processes; one a core if not given.", min=0)
    pictures: Path | None = option(
        None,
        "Instead of driving: what the policies do about the labelled pictures in this folder, by "
        "its truth.csv (file, in_view, bearing_left_deg; also distance_m, distractor, plain).",
        metavar="FOLDER",
    )
    contact_sheet: Path | None = output_file(
        None,
        "With --pictures: what the first MODEL got wrong, by kind, with its wheels.",
        endings=(".png",),
        metavar="FILE.png",
    )
    plot: Path | None = output_file(
        None, "Draw the comparison too.", endings=PICTURES, metavar="FILE.png"
    )
    film: Path | None = output_file(
        None,
        "Film one episode too, all MODELs side by side, on the first --preset.",
        endings=(".mp4",),
        metavar="FILE.mp4",
    )
    as_json: bool = json_option()


@with_options
def evaluate(options: EvaluateOptions) -> Answer:
    """Try policies on the paper's task: seeded episodes, means, 95 % confidence intervals.

    The paper's score on lesson 10 is a mean reward of 19.8 in 200 decisions, 20 an object; 21 is
    the most there is.

    Examples:

    - `workstation evaluate policy.onnx servo oracle --plot comparison.png`
    - `workstation evaluate policy.onnx servo --calibration calibration/mbot-1`
    - `workstation evaluate policy.onnx --preset slippery --preset uneven --panorama kitchen.jpg`
    - `workstation evaluate red-cube.onnx ball.onnx --object red-cube.toml --object ball.toml`
    - `workstation evaluate policy.onnx servo --episodes 16 --film side-by-side.mp4`
    - `workstation evaluate policy.onnx servo --pictures my-photos --contact-sheet mistakes.png`
    """
    if options.pictures is not None:
        return _judge_pictures(options, options.pictures)
    if options.contact_sheet is not None:
        raise ConfigurationError("--contact-sheet shows mistakes on --pictures FOLDER: give both")
    return _drive(options)


def _judge_pictures(options: EvaluateOptions, folder: Path) -> Answer:
    from mbot_protocol.drive.calibration import read_camera
    from mbot_workstation.learn.drivers.contestants import BUILT_IN, SERVO, read_policy, titles
    from mbot_workstation.learn.evaluation.labelled_pictures import (
        judge,
        observations,
        read_labelled,
    )
    from mbot_workstation.learn.evaluation.picture_report import (
        mistakes_sheet,
        picture_fields,
        picture_table,
    )
    from mbot_workstation.pictures.picture_file import write_picture

    if options.object is not None:
        raise ConfigurationError(
            "--object does nothing with --pictures, which show what they show: leave it out"
        )
    if blind := [name for name in options.contestants if name in BUILT_IN and name != SERVO]:
        raise ConfigurationError(f"{blind[0]} sees no pictures; give ONNX policies, or servo")
    calibrated = read_camera(options.calibration) if options.calibration else None
    camera = None if calibrated is None else calibrated.model()
    pictures = read_labelled(folder)
    scores = {}
    for contestant, title in titles(options.contestants).items():
        policy = read_policy(contestant)
        seen = observations(pictures, camera, policy.metadata.view)
        actions = policy.act(seen)
        scores[title] = judge(actions, pictures)
        if options.contact_sheet is not None and len(scores) == 1:
            sheet = mistakes_sheet(title, scores[title], pictures, seen, actions)
            write_picture(options.contact_sheet, sheet)
    value = [picture_fields(title, score) for title, score in scores.items()]
    return Answer(value, [picture_table(scores, f"{len(pictures)} pictures of {folder}")])


def _drive(options: EvaluateOptions) -> Answer:
    from mbot_workstation.learn.drivers.contestants import check_contestants, titles
    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.evaluation.evaluation_report import draw, fields, table
    from mbot_workstation.learn.evaluation.objects_tried import object_table, objects_tried
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.tasks.find import find_task, full_reference

    check_contestants(options.contestants)
    task = find_task(options.task)
    files = files_to_simulate(options.calibration)
    stage = find_lesson(options.lesson, options.task)
    robots = _presets(options.preset or ["nominal"], files if options.calibration else None)
    panorama = photographs(options.panorama, options.calibration)
    named = titles(options.contestants)
    things, notes = objects_tried(named, options.object or [])
    if len(things) > 1 and (options.film or options.plot):
        raise ConfigurationError("--film and --plot show one object: give one --object")
    for words in (*notes, *_other_tasks(options.contestants, options.task)):
        note(words)
    rooms = evaluation_rooms(panorama, options.made_up_rooms)
    count, seed, workers = options.episodes, options.seed, options.workers
    reference = full_reference(options.task)
    scenes = [replace(files.scene, objects=thing.kinds) for thing in things]
    trials = [
        {
            name: Trial(stage, effects, rooms, count, seed, workers, files.robot, scene, reference)
            for name, effects in robots.items()
        }
        for scene in scenes
    ]
    tried = [
        (thing.name, _lines(trial, named)) for thing, trial in zip(things, trials, strict=True)
    ]
    shown, lines = next(iter(trials[0].values())), tried[0][1]
    if options.film is not None:
        from mbot_workstation.learn.evaluation.episode_film import film_episode

        contestants = {title: contestant for contestant, title in named.items()}
        film_episode(contestants, shown, options.film)
    if options.plot is not None:
        draw(lines, options.plot, shown)
    heading = f"lesson {stage.name}, {count} episodes each, {len(rooms)} rooms, seed {seed}"
    several = len(tried) > 1
    said = object_table(tried, heading, task) if several else table(lines, heading, task)
    value = [
        {**fields(line, lines, task), "object": name} for name, lines in tried for line in lines
    ]
    return Answer(value, [said])


def _other_tasks(contestants: Sequence[str], reference: str) -> Iterator[str]:
    """What a person should know of policies that learned another task, or this one as it was."""
    from mbot_workstation.fleet.models.trained_task import trained_task
    from mbot_workstation.learn.drivers.contestants import BUILT_IN
    from mbot_workstation.tasks.find import find_task, is_file, task_digest

    name = find_task(reference).name
    for contestant in contestants:
        if contestant in BUILT_IN:
            continue
        learned = trained_task(Path(contestant))
        if learned.task != name:
            yield f"{contestant} learned the task {learned.words}, and is tried in {name}"
        elif is_file(reference) and learned.task_sha256 != task_digest(reference):
            yield f"{reference} is not as it was when {contestant} learned it"


def _lines(trials: "Mapping[str, Trial]", named: Mapping[str, str]) -> "list[Line]":
    """All contestants' episodes on all robots."""
    from mbot_workstation.learn.evaluation.episodes import evaluate as run
    from mbot_workstation.learn.evaluation.episodes import score
    from mbot_workstation.learn.evaluation.evaluation_report import Line

    lines: list[Line] = []
    for name, trial in trials.items():
        for contestant, title in named.items():
            with working(f"{title}, {name}", trial.episodes) as done:
                lines.append(Line(title, name, score(run(contestant, trial, done))))
    return lines


def _presets(names: list[str], calibrated: "CalibrationFiles | None") -> "dict[str, EffectRanges]":
    from mbot_workstation.sim.effects.presets import PRESETS, preset

    if "all" in names:
        names = [name for name in PRESETS if calibrated is None or name != "ideal"]
    try:
        ranges = preset if calibrated is None else calibrated.ranges
        return {name: ranges(name) for name in names}
    except ValueError as error:
        raise ConfigurationError(f"--preset: {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainOptions:
    """What `explain` takes."""

    model: Path = argument("A policy.", metavar="MODEL.onnx")
    more_frames: list[Path] | None = argument("More pictures.", default=None, metavar="[FILE]...")
    frames: list[Path] | None = option(
        None,
        "Pictures to explain: 64 x 64 as the policy sees it, or the whole camera's.",
        "--frames",
        metavar="FILE",
    )
    recording: Path | None = option(None, "Take pictures from this recording.", metavar="REC")
    count: int = option(4, "How many, evenly spread over the recording.", min=1, max=12)
    output: Path = output_file(
        Path("explanation.png"),
        "The picture to write.",
        "--output",
        "-o",
        endings=PICTURES,
        metavar="FILE.png",
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class Explanation:
    """A picture of what a policy looks at, and its wheels by the titles of what it saw."""

    path: Path
    actions: dict[str, list[float]]
    actions_without_memory: dict[str, Sequence[float]]


@with_options
def explain(options: ExplainOptions) -> Answer:
    """Show where a policy looks in pictures, what its first layer makes of them, and what it does.

    Each place of a picture is blurred away in turn; what changes the wheels matters to the policy.
    In a recording a policy with a memory has in mind what came before, since its memory was last
    reset (by a stop, a hold, a gap), and the picture shows what it would do without.

    Without --frames and --recording: three pictures as in the paper, with no object, with the
    object on the left, and with the object straight ahead.

    Examples:

    - `workstation explain policy.onnx -o explanation.png`
    - `workstation explain policy.onnx --frames a.png b.png`
    - `workstation explain policy.onnx --recording drive.mcap --count 6`
    """
    from mbot_workstation.fleet.models.check import check_model
    from mbot_workstation.learn.evaluation.activations import ActivationReader
    from mbot_workstation.learn.evaluation.explanation import draw, load_frame, recorded_looks
    from mbot_workstation.learn.worlds.example_frames import example_frames

    files = [*(options.frames or ()), *(options.more_frames or ())]
    if files and options.recording:
        raise ConfigurationError("--frames and --recording: give one of the two")
    checked = check_model(options.model)
    reader = ActivationReader(checked.data)
    view = checked.metadata.view
    if options.recording is not None:
        seen = recorded_looks(reader, options.recording, view, options.count)
    else:
        pictures = {path.stem: load_frame(path, view) for path in files} or example_frames()
        seen = {title: reader.look(picture) for title, picture in pictures.items()}
    draw(seen, options.output)
    found = Explanation(
        options.output,
        {title: [round(v, 4) for v in one.action] for title, one in seen.items()},
        {t: one.first_action for t, one in seen.items() if one.first_action is not None},
    )
    return Answer(found, _looked_at(seen, options.output))


def _looked_at(seen: "dict[str, Activations]", output: Path) -> Iterator[str]:
    for title, one in seen.items():
        first = one.first_action
        without = f"; without memory {first[0]:+.2f}, {first[1]:+.2f}" if first else ""
        yield f"{title}: left {one.action[0]:+.2f}, right {one.action[1]:+.2f}{without}"
    yield f"wrote {output}"


TOLERANCE = "tolerance"
NAMES = ("handicap", "blur", "latency", "robots", TOLERANCE)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """What `study` takes."""

    name: str = argument(f"One of {', '.join(NAMES)}.", metavar="STUDY")
    contestants: list[str] = argument(
        "ONNX policies, servo, random or oracle; as in evaluate.", metavar="MODEL..."
    )
    output: Path | None = output_folder(
        None,
        "For the page and the picture; `studies` beside the first policy if not given.",
        "--output",
        "-o",
        metavar="FOLDER",
    )
    episodes: int | None = option(
        None, "For each of them under each condition; 50, or 12 for tolerance.", min=1
    )
    task: str = task_option()
    lesson: str | None = option(
        None, "Of the task; of fetch 1 to 10, blur or rough, 10 if not given.", metavar="NAME"
    )
    object: Path | None = object_option(
        "What there is to fetch; what the policies were trained for if not given."
    )
    calibration: Path | None = calibration_option()
    panorama: list[Path] | None = option(
        None, "Room to try it in; may be given several times.", metavar="FILE"
    )
    seed: int = option(0, "Of rooms, robots and objects.")
    pair: list[str] | None = option(
        None,
        "For tolerance: two deviations, such as fov_scale:camera_pitch_deg; may be given "
        "several times; five usual pairs if not.",
        metavar="A:B",
    )
    cells: int = option(7, "For tolerance: values of each deviation.", min=2, max=25)
    backend: str = option("threading", "Of joblib: threading (this machine's cores), dask or ray.")


@with_options
def study(options: StudyOptions) -> Answer:
    """Try policies under one condition after the other, and write what comes out.

    - **handicap**: one motor at 50 %
    - **blur**: exposure from 0 to 60 ms; give the models before and after the blur lesson
    - **latency**: 0 to 600 ms from picture to wheels
    - **robots**: all perturbed robots
    - **tolerance**: maps over pairs of deviations, of the first MODEL; also as numbers, in
      tolerance.json, for `workstation gap-report`

    Examples:

    - `workstation study latency policy.onnx servo`
    - `workstation study blur before.onnx after.onnx -o docs/results`
    - `workstation study tolerance policy.onnx --pair track_scale:fov_scale --cells 9`
    - `workstation study robots policy.onnx --calibration calibration/mbot-1 -o results`
    """
    from mbot_workstation.learn.drivers.contestants import check_contestants, titles
    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.evaluation.objects_tried import objects_tried
    from mbot_workstation.learn.studies.study_plans import study_plan
    from mbot_workstation.learn.studies.study_report import write_report
    from mbot_workstation.learn.studies.tolerance_study import map_tolerances, pairs_named
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.effects.presets import preset
    from mbot_workstation.tasks.find import find_task, full_reference

    if options.name not in NAMES:
        meant = did_you_mean(options.name, NAMES)
        raise ConfigurationError(
            f"no study {options.name!r}, expected one of {', '.join(NAMES)}{meant}"
        )
    check_contestants(options.contestants)
    stage = find_lesson(options.lesson, options.task)
    files = files_to_simulate(options.calibration)
    robots = files.ranges if options.calibration else preset
    photos = photographs(options.panorama, options.calibration)
    rooms = evaluation_rooms(photos)
    number = options.episodes or (12 if options.name == TOLERANCE else 50)
    named = [options.object] if options.object else []
    (thing,), notes = objects_tried(titles(options.contestants), named)
    for words in notes:
        note(words)
    scene = replace(files.scene, objects=thing.kinds)
    task, nominal = full_reference(options.task), robots("nominal")
    trial = Trial(stage, nominal, rooms, number, options.seed, None, files.robot, scene, task)
    how = _how(options, stage.name, number, len(rooms), photographed=bool(photos))
    run = _runner(options, trial)
    folder = options.output or _beside(options.contestants)
    if options.name == TOLERANCE:
        maps = pairs_named(options.pair or (), options.cells)
        homes = robots("home") if find_task(task).mistakes else None
        written = map_tolerances(options.contestants[0], maps, trial, run, folder, how, homes)
    else:
        plan = study_plan(options.name, robots)
        lines = run(plan.conditions, options.contestants)
        written = [write_report(plan, lines, folder, how, trial)]
    return Answer(written, [f"wrote {path}" for path in written])


def _runner(
    options: StudyOptions, trial: "Trial"
) -> "Callable[[Sequence[Condition], Sequence[str]], list[Line]]":
    """What tries drivers under conditions, behind a bar."""
    from mbot_workstation.learn.studies.study_run import run_study

    def run(conditions: "Sequence[Condition]", drivers: Sequence[str]) -> "list[Line]":
        words = f"{options.name}: {len(conditions)} conditions"
        with working(words, len(conditions) * len(drivers)) as done:
            return run_study(conditions, drivers, trial, options.backend, done)

    return run


def _beside(contestants: "Sequence[str]") -> Path:
    """The folder `studies` where the first policy's file is, or here if all are built in."""
    files = [Path(name) for name in contestants if Path(name).is_file()]
    return (files[0].parent if files else Path()) / "studies"


def _how(
    options: StudyOptions, lesson: str, episodes: int, rooms: int, *, photographed: bool
) -> str:
    """How it was tried, for the page."""
    from mbot_workstation.learn.evaluation.provenance import provenance

    kind = "photographed" if photographed else "made-up"
    # A calibration's own room may be one the policy was trained in.
    seen = "" if options.calibration else " never trained in"
    robot = f" Nominal here is the robot of {options.calibration}." if options.calibration else ""
    return (
        f"Lesson {lesson}, {episodes} episodes a line, {rooms} {kind} rooms{seen}, seed "
        f"{options.seed}; "
        f"intervals of 95 %.{robot}\n\n{provenance(options.contestants)}"
    )

"""`workstation identify` and `gap-report`: the simulated robot's motion, and how far it is off."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_protocol.files import atomic_file
from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.presenter import Answer, working

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from mbot_workstation.learn.evaluation.trim_trial import TrimTrial
    from mbot_workstation.measure.identification.motor_trim import TrimChoice
    from mbot_workstation.measure.identification.result import Identification
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
    from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration

SHIPPED_MAP = Path(__file__).parents[3] / "models" / "tolerance.json"
"""In the checkout, wherever the command is called, beside the policy it is of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions:
    """What `identify` takes."""

    recordings: list[Path] = argument(
        "Folders written by `workstation maneuvers run`, with a track; see docs/recordings.md.",
        metavar="RECORDING...",
    )
    calibration: Path | None = option(
        None,
        "The robot's calibration folder: its body is used, motion.toml is written. "
        "calibration/ROBOT if not given.",
        metavar="FOLDER",
    )
    robot: str | None = option(
        None, "Whose recordings these are, if they do not say so or differ.", metavar="ID"
    )
    same_clock: bool = option(
        False,
        "The tracks' times are on the robot's clock: then the delay from command to "
        "wheel can be told.",
        "--same-clock",
    )
    no_trim: bool = option(
        False,
        "Leave uneven motors to the policy: motion.toml trims neither. A trim drives straight, at "
        "the weaker motor's speed.",
        "--no-trim",
    )
    policy: str | None = option(
        None,
        "Where a trim would cost much speed, try on the simulated robot whether this policy does "
        "better with it, and write what it does better with.",
        "--policy",
        metavar="POLICY.onnx",
    )
    as_json: bool = json_option()


@with_options
def identify(options: IdentifyOptions) -> Answer:
    """Fit the simulated robot to half of the repetitions, try it on the other half, then fit all.

    What the recordings can't tell is taken as usual and listed with the reason. The tracker's
    place on the robot, its floor, and its clock are estimated on the way.

    Examples:

    - `workstation identify recordings/mbot-1-2026-11-21`
    - `workstation identify monday tuesday --calibration calibration/mbot-1 --json`
    - `workstation identify recordings/weak --policy policy.onnx`
    """
    import os

    # Before numpy is loaded: on matrices as small as these, threads of its own cost more than they
    # bring, and the simulations want the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from mbot_workstation.measure.identification.fit import identify as fit
    from mbot_workstation.measure.identification.motion_file import motion_calibration
    from mbot_workstation.measure.identification.motor_trim import trim_choice
    from mbot_workstation.measure.identification.result_words import fit_answer
    from mbot_workstation.measure.tracks.recording_folder import read_maneuvers
    from mbot_workstation.measure.tracks.run import common_robot, common_wheel_maps
    from mbot_workstation.sim.calibrated.calibration_folder import write_motion

    if options.no_trim and options.policy is not None:
        raise ConfigurationError("--no-trim and --policy: give one of the two")
    if options.policy is not None:
        from mbot_workstation.learn.drivers.contestants import read_policy

        read_policy(options.policy)  # now, not after the fit
    read = [read_maneuvers(folder) for folder in options.recordings]
    robot_id = options.robot or common_robot(read)
    folder = options.calibration or Path("calibration") / robot_id
    files = _known(folder)
    runs = sum(len(recording.runs) for recording in read)
    with working(f"{runs} runs", 1.0) as advance:
        found = fit(
            read, files.robot, robot_id=robot_id, same_clock=options.same_clock, advance=advance
        )
    uneven = trim_choice(found, common_wheel_maps(read))
    tried: TrimTrial | None = None
    written: list[str] = []
    if not found.is_worse:
        ways = [motion_calibration(found, way) for way in (uneven.straight, uneven.left_alone)]
        if options.policy is not None and uneven.is_a_choice:
            tried = _tried(options.policy, files, *ways)
        trims = tried.chosen == "trimmed" if tried else not options.no_trim
        written = [str(write_motion(folder, ways[0] if trims else ways[1]))]
    error = MbotError(
        "on the held-out runs the identified robot is further off than before, so nothing was "
        "written: look at the tables; are all runs of one robot, on one floor?",
        kind="worse-than-before",
    )
    said = _identified_words(found, uneven, tried, written)
    value = fit_answer(found, uneven, written, tried)
    return Answer(value, said, error=error if found.is_worse else None)


def _known(folder: Path) -> "CalibrationFiles":
    """The robot without its motion: that is what shall be found."""
    import msgspec

    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, read_files

    files = read_files(folder) if folder.is_dir() else CalibrationFiles()
    return msgspec.structs.replace(files, motion=None)


def _tried(
    policy: str, files: "CalibrationFiles", trimmed: "MotionCalibration", alone: "MotionCalibration"
) -> "TrimTrial":
    from rich.console import Console

    from mbot_workstation.learn.evaluation.trim_trial import try_trim

    with Console(stderr=True).status(f"{policy} drives the identified robot, trimmed and not"):
        return try_trim(policy, files, trimmed, alone)


def _identified_words(
    found: "Identification",
    uneven: "TrimChoice",
    tried: "TrimTrial | None",
    written: "Sequence[str]",
) -> "Iterator[RenderableType]":
    from mbot_workstation.measure.identification import result_words
    from mbot_workstation.measure.identification.exclusion import grouped

    for line in grouped(found.excluded):
        yield f"left out: {line}"
    yield f"{found.robot_id}: fitted {found.fitted} runs, {len(found.errors)} held out\n"
    yield result_words.parameter_table(found)
    yield "\nnot to be told from these recordings:"
    for line in result_words.undetermined_lines(found):
        yield f"  {line}"
    yield ""
    yield result_words.steady_table(found)
    yield from result_words.misfit_lines(found)
    yield ""
    yield result_words.error_table(found)
    yield from result_words.error_lines(found)
    yield ""
    yield from result_words.trim_lines(uneven)
    yield from result_words.backward_lines(found)
    if tried is not None:
        yield tried.line()
    for path in written:
        yield f"wrote {path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class GapReportOptions:
    """What `gap_report` takes."""

    recordings: list[Path] = argument(
        "Folders of `workstation maneuvers run` with their tracks.", metavar="RECORDING..."
    )
    calibration: Path | None = option(
        None,
        "The robot's calibration; calibration/ROBOT if not given.",
        "--calibration",
        metavar="FOLDER",
    )
    tolerance: Path | None = option(
        None,
        "What a policy bears: tolerance.json of `workstation study tolerance`; the one that ships "
        "with the policy, models/tolerance.json, if not given. Without, there are no verdicts.",
        metavar="FILE.json",
    )
    frames: Path | None = option(
        None,
        "Pictures of the robot's camera, with frames.csv: file,x_m,y_m,yaw_deg and, where "
        "the cube is in view, cube_x_m,cube_y_m,cube_yaw_deg.",
        metavar="FOLDER",
    )
    output: Path = output_file(Path("gap.html"), "The page.", "--output", "-o", metavar="FILE.html")
    as_json: bool = json_option()


@with_options
def gap_report(options: GapReportOptions) -> Answer:
    """Compare the calibrated simulation with the real robot, and write one page about it.

    Paths, errors over time and steady rates of runs that `identify` has not fitted; the lens, the
    light, the same frame real and simulated; and for each quantity a verdict: does a policy bear
    what is left? What is missing is said with the command that makes it. The page needs no other
    file and prints well.

    Examples:

    - `workstation gap-report recordings/mbot-1-2026-11-21`
    - `workstation gap-report recordings/mbot-1-* --calibration calibration/mbot-1
      --tolerance results/tolerance.json --frames frames -o gap.html`
    """
    from rich.console import Console

    from mbot_workstation.measure.gap_report.answer import gap_answer
    from mbot_workstation.measure.gap_report.page import page, printed
    from mbot_workstation.measure.gap_report.report import build

    with Console(stderr=True).status("reading") as status:
        report = build(
            options.recordings,
            options.calibration,
            options.tolerance or (SHIPPED_MAP if SHIPPED_MAP.is_file() else None),
            options.frames,
            status.update,
        )
        status.update("drawing the page")
        text = page(report)
    atomic_file.save(options.output, text.encode())
    value = gap_answer(report, str(options.output))
    return Answer(value, [*printed(report), f"wrote {options.output}"])

"""`workstation identify`: from recorded maneuvers to the simulated robot's motion."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mbot_protocol.drive.actions import WheelMaps
    from mbot_workstation.learn.evaluation.trim_trial import TrimTrial
    from mbot_workstation.measure.identification.motor_trim import TrimChoice
    from mbot_workstation.measure.identification.result import Identification
    from mbot_workstation.measure.tracks.run import ManeuverRecording
    from mbot_workstation.sim.body.robot_parameters import RobotParameters
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
    from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration


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
def identify(options: IdentifyOptions) -> None:
    """Fit the simulated robot to half of the repetitions, try it on the other half, then fit all.

    What the recordings can't tell is taken as usual and listed with the reason. The tracker's
    place on the robot, its floor, and its clock are estimated on the way.

    Examples:

    - `workstation identify recordings/mbot-1-2026-11-21`
    - `workstation identify monday tuesday --calibration calibration/mbot-1 --json`
    - `workstation identify recordings/weak --policy policy.onnx`
    """
    import json
    import os

    # Before numpy is loaded: on matrices as small as these, threads of its own cost more than they
    # bring, and the simulations want the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from mbot_workstation.measure.identification.motion_file import motion_calibration
    from mbot_workstation.measure.identification.motor_trim import trim_choice
    from mbot_workstation.measure.identification.result_words import as_fields
    from mbot_workstation.measure.tracks.recording_folder import read_maneuvers
    from mbot_workstation.sim.calibrated.calibration_folder import write_motion

    if options.no_trim and options.policy is not None:
        raise ConfigurationError("--no-trim and --policy: give one of the two")
    if options.policy is not None:
        from mbot_workstation.learn.drivers.contestants import read_policy

        read_policy(options.policy)  # now, not after the fit
    read = [read_maneuvers(folder) for folder in options.recordings]
    robot_id = options.robot or _robot_id(read)
    folder = options.calibration or Path("calibration") / robot_id
    maps = _maps(read)
    files = _known(folder)
    found = _identified(read, files.robot, robot_id, same_clock=options.same_clock)
    uneven = trim_choice(found, maps)
    tried: TrimTrial | None = None
    written: list[str] = []
    if not found.is_worse:
        ways = [motion_calibration(found, way) for way in (uneven.straight, uneven.left_alone)]
        if options.policy is not None and uneven.is_a_choice:
            tried = _tried(options.policy, files, *ways)
        trims = tried.is_better_trimmed if tried else not options.no_trim
        written = [str(write_motion(folder, ways[0] if trims else ways[1]))]
    if options.as_json:
        told = as_fields(found, uneven, written)
        print(json.dumps(told | ({"trim_trial": tried.fields()} if tried else {})))
    else:
        _show(found, uneven, tried, written)
    if found.is_worse:
        raise MbotError(
            "on the held-out runs the identified robot is further off than before, so nothing was "
            "written: look at the tables; are all runs of one robot, on one floor?"
        )


def _robot_id(recordings: "Sequence[ManeuverRecording]") -> str:
    names = list(dict.fromkeys(recording.robot_id for recording in recordings))
    if len(names) > 1:
        raise ConfigurationError(
            f"the recordings are of {' and '.join(names)}; identify one robot at a time, or say "
            "with --robot whose they are"
        )
    return names[0]


def _maps(recordings: "Sequence[ManeuverRecording]") -> "WheelMaps":
    maps = [recording.wheel_maps for recording in recordings]
    for one in maps[1:]:
        if (one.left.reversed, one.right.reversed) != (
            maps[0].left.reversed,
            maps[0].right.reversed,
        ):
            raise ConfigurationError(
                "the recordings differ in which motor is reversed (recording.toml); identify them "
                "one by one"
            )
    return maps[-1]


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


def _identified(
    recordings: "Sequence[ManeuverRecording]",
    nominal: "RobotParameters",
    robot_id: str,
    *,
    same_clock: bool,
) -> "Identification":
    from rich.console import Console
    from rich.progress import Progress

    from mbot_workstation.measure.identification.fit import identify as run

    console = Console(stderr=True)
    runs = sum(len(recording.runs) for recording in recordings)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{runs} runs", total=1.0)
        return run(
            recordings,
            nominal,
            robot_id=robot_id,
            same_clock=same_clock,
            advance=lambda done: progress.update(task, completed=done),
        )


def _show(
    found: "Identification",
    uneven: "TrimChoice",
    tried: "TrimTrial | None",
    written: "Sequence[str]",
) -> None:
    from rich.console import Console

    from mbot_workstation.measure.identification.exclusion import grouped
    from mbot_workstation.measure.identification.result_words import (
        backward_lines,
        error_lines,
        error_table,
        misfit_lines,
        parameter_table,
        steady_table,
        trim_lines,
        undetermined_lines,
    )

    console = Console()
    for line in grouped(found.excluded):
        print(f"left out: {line}")
    print(f"{found.robot_id}: fitted {found.fitted} runs, {len(found.errors)} held out\n")
    console.print(parameter_table(found))
    print("\nnot to be told from these recordings:")
    for line in undetermined_lines(found):
        console.print(f"  {line}", highlight=False, markup=False, soft_wrap=True)
    print()
    console.print(steady_table(found))
    for line in misfit_lines(found):
        print(line)
    print()
    console.print(error_table(found))
    for line in error_lines(found):
        print(line)
    print()
    for line in (*trim_lines(uneven), *backward_lines(found)):
        print(line)
    if tried is not None:
        print(tried.line())
    for path in written:
        print(f"wrote {path}")

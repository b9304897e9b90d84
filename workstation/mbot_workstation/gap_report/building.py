"""The report from files: recordings, a calibration folder, tolerance maps, frames."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles, read_files
from mbot_workstation.gap_report.comparison import Comparison, compare
from mbot_workstation.gap_report.frame_pair import RealFrame, frame_pairs
from mbot_workstation.gap_report.frames_folder import read_frames
from mbot_workstation.gap_report.missing import missing_parts
from mbot_workstation.gap_report.report import GapReport, driven, judged
from mbot_workstation.gap_report.telemetry_frames import telemetry_frames
from mbot_workstation.recordings.recording_folder import read_recording
from mbot_workstation.recordings.run import Recording
from mbot_workstation.training.studies.tolerance_file import read_tolerances


@dataclass(frozen=True, slots=True)
class Sources:
    """What the report is made from.

    Attributes:
        recordings: folders, at least one, of one robot.
        calibration: its folder; None is calibration/ROBOT.
        tolerance: tolerance.json, if there is one.
        frames: a folder of pictures with their places, if there is one.
        made_on: ISO date.

    """

    recordings: tuple[Path, ...]
    calibration: Path | None
    tolerance: Path | None
    frames: Path | None
    made_on: str


def build(sources: Sources, tell: Callable[[str], None] = lambda _: None) -> GapReport:
    """Read everything, simulate, and work out all figures.

    Args:
        sources: see `Sources`.
        tell: called with what is being done.

    Raises:
        ConfigurationError: something is unusable.

    """
    tolerances = read_tolerances(sources.tolerance) if sources.tolerance else None
    real = read_frames(sources.frames) if sources.frames else ()
    files = read_files(sources.calibration) if sources.calibration else None
    tell("reading the recordings")
    recordings = tuple(read_recording(folder) for folder in sources.recordings)
    robot_id = _one_robot(sources.recordings, recordings)
    if files is None:
        files = read_files(Path("calibration") / robot_id)
    tell("driving every run in simulation")
    comparison = compare(recordings, files)
    seen = _seen(sources.recordings[0], recordings[0], comparison)
    tell("drawing frames")
    pairs = frame_pairs([*real, *seen], files)
    figures = driven(comparison.held_out)
    names = [one.name for one in figures.maneuvers]
    return GapReport(
        robot_id=robot_id,
        made_on=sources.made_on,
        recordings=tuple(str(folder) for folder in sources.recordings),
        recorded_runs=sum(len(one.runs) for one in recordings),
        held_out_words=comparison.words,
        left_out=comparison.left_out,
        files=files,
        maneuvers=figures.maneuvers,
        rates=figures.rates,
        calibrated=figures.calibrated,
        nominal=figures.nominal,
        judged=judged(files, figures.rates, tolerances),
        tolerances=tolerances,
        frames=pairs,
        frames_words=_frames_words(files, len(real), len(seen)),
        missing=missing_parts(
            files,
            sources.recordings[0],
            names,
            tolerances=tolerances,
            has_frames=bool(pairs),
        ),
    )


def _one_robot(folders: Sequence[Path], recordings: Sequence[Recording]) -> str:
    first = recordings[0].robot_id
    for folder, recording in zip(folders, recordings, strict=True):
        if recording.robot_id != first:
            raise ConfigurationError(
                f"{folder} is a recording of {recording.robot_id}, {folders[0]} one of {first}: "
                "one report is about one robot"
            )
    return first


def _seen(folder: Path, recording: Recording, comparison: Comparison) -> tuple[RealFrame, ...]:
    if comparison.first is None:
        return ()
    return telemetry_frames(folder, comparison.first, recording.runs[0].commands.start_s)


def _frames_words(files: CalibrationFiles, given: int, seen: int) -> str:
    if not given and not seen:
        return (
            "There is none: the recording's telemetry holds no pictures, and --frames names no "
            "folder of pictures with their places."
        )
    parts: list[str] = []
    if given:
        parts.append(f"{given} by the robot's camera from marked places (--frames).")
    if seen:
        parts.append(
            f"{seen} of 64 x 64 as a policy sees them, from the recording's telemetry: before and "
            "in the session's first run, taken to begin where the panorama was photographed, "
            "facing its middle, with a daemon that has no calibration yet."
        )
    if files.camera is None or files.light is None:
        parts.append("What is not calibrated is nominal in both simulations.")
    return " ".join(parts)

"""The report from files, all that the page shows worked out; nothing here knows HTML."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from mbot_protocol.drive.calibration import CAMERA_FILE, MOTION_FILE
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.studies.tolerance_file import Tolerances, read_tolerances
from mbot_workstation.measure.gap_report.compare import compare
from mbot_workstation.measure.gap_report.figures import Driving, driving
from mbot_workstation.measure.gap_report.frames import read_frames, telemetry_frames
from mbot_workstation.measure.gap_report.quantities import TITLES, quantities
from mbot_workstation.measure.gap_report.simulated_view import FramePair, frame_pairs
from mbot_workstation.measure.gap_report.verdict import JudgedQuantity, judge
from mbot_workstation.measure.identification.exclusion import Exclusion
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.recording_folder import read_maneuvers
from mbot_workstation.sim.calibrated.body_calibration import BODY_FILE
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    read_files,
    room_pictures,
)
from mbot_workstation.sim.calibrated.light_calibration import LIGHT_FILE
from mbot_workstation.wording import typed

CALIBRATION_PARTS = {
    "body": (
        f"no {BODY_FILE}: masses and the camera's mounting are the nominal robot's",
        "calibrate body COMPONENTS.toml",
    ),
    "camera": (
        f"no {CAMERA_FILE}: the lens is the data sheet's, its error is not known",
        "calibrate camera PHOTOS",
    ),
    "light": (
        f"no {LIGHT_FILE}: exposure and white balance are nominal, the gray card's error is not "
        "known",
        "calibrate light PHOTOS",
    ),
    "room": ("no panorama: simulated pictures show a made-up room", "panorama PHOTO.jpg"),
}
"""What is lost without each, and the command that makes it."""


@dataclass(frozen=True, slots=True)
class Missing:
    """What the page can't show, with what is lost by it; and the command that would make it."""

    what: str
    command: str


@dataclass(frozen=True, slots=True, eq=False)
class GapReport:
    """The whole report.

    Attributes:
        made_on: ISO date.
        recorded_runs: in all recordings.
        held_out_words: which runs were held out.
        excluded: runs that could not be used, by name.
        driving: figures of the held-out runs.
        given_frames: of the frames those from marked places, first; the others are telemetry's.

    """

    robot_id: str
    made_on: str
    recordings: tuple[str, ...]
    recorded_runs: int
    held_out_words: str
    excluded: dict[str, Exclusion]
    files: CalibrationFiles
    driving: Driving
    judged: tuple[JudgedQuantity, ...]
    tolerances: Tolerances | None
    frames: tuple[FramePair, ...]
    given_frames: int
    missing: tuple[Missing, ...]


def build(
    recordings: Sequence[Path],
    calibration: Path | None,
    tolerance: Path | None,
    frames: Path | None,
    tell: Callable[[str], None] = lambda _: None,
) -> GapReport:
    """Read everything, simulate, and work out all figures.

    Args:
        recordings: folders, at least one, of one robot.
        calibration: its folder; None is calibration/ROBOT.
        tolerance: tolerance.json, if there is one.
        frames: a folder of pictures with their places, if there is one.
        tell: called with what is being done.

    Raises:
        ConfigurationError: something is unusable.

    """
    tolerances = read_tolerances(tolerance) if tolerance else None
    given = read_frames(frames) if frames else ()
    files = read_files(calibration) if calibration else None
    tell("reading the recordings")
    folder, read = recordings[0], [read_maneuvers(one) for one in recordings]
    robot_id = read[0].robot_id
    for other, recording in zip(recordings, read, strict=True):
        if recording.robot_id != robot_id:
            raise ConfigurationError(
                f"{other} is a recording of {recording.robot_id}, {folder} one of {robot_id}: "
                "one report is about one robot"
            )
    files = files or read_files(Path("calibration") / robot_id)
    tell("driving every run in simulation")
    comparison = compare(read, files)
    start_s = read[0].runs[0].commands.start_s
    seen = telemetry_frames(folder, comparison.first, start_s) if comparison.first else ()
    tell("drawing frames")
    pairs = frame_pairs([*given, *seen], files)
    driven = driving(comparison.held_out)
    return GapReport(
        robot_id=robot_id,
        made_on=datetime.now().astimezone().date().isoformat(),
        recordings=tuple(str(one) for one in recordings),
        recorded_runs=sum(len(one.runs) for one in read),
        held_out_words=comparison.words,
        excluded=comparison.excluded,
        files=files,
        driving=driven,
        judged=tuple(judge(one, tolerances) for one in quantities(files, driven.runs)),
        tolerances=tolerances,
        frames=pairs,
        given_frames=len(given),
        missing=missing_parts(
            files, folder, tuple(driven.maneuvers), tolerances, has_frames=bool(pairs)
        ),
    )


def missing_parts(
    files: CalibrationFiles,
    recording: Path,
    maneuvers: Sequence[str],
    tolerances: Tolerances | None,
    *,
    has_frames: bool,
) -> tuple[Missing, ...]:
    """What the page can't show and the command that would make it, in the afternoon's order.

    Args:
        files: the calibration, read from a folder.
        recording: one of the recordings.
        maneuvers: those that were driven.
        tolerances: the maps that were given.
        has_frames: whether there are pictures.

    """
    into = f"--calibration {typed(files.folder)}"
    known = {field: getattr(files, field) is not None for field in ("body", "camera", "light")}
    known["room"] = bool(room_pictures(Path(files.folder)))
    found = [
        Missing(what, f"workstation {command} {into}")
        for part, (what, command) in CALIBRATION_PARTS.items()
        if not known[part]
    ]
    undriven = [one.name for one in MANEUVERS if one.name not in maneuvers]
    if undriven:
        options = " ".join(f"--maneuver {name}" for name in undriven)
        command = f"workstation maneuvers run --resume {typed(recording)} {options}"
        found.append(Missing(f"no runs of {', '.join(undriven)}", command))
    if files.motion is None:
        what = (
            f"no {MOTION_FILE}: the simulated motors are nominal, so both simulations drive alike"
        )
        found.append(Missing(what, f"workstation identify {typed(recording)} {into}"))
    if not has_frames:
        what = "no frame of the real camera with its place"
        found.append(Missing(what, "workstation gap-report ... --frames FOLDER"))
    study = "workstation study tolerance POLICY.onnx"
    if tolerances is None:
        what = "no tolerance map, hence no verdicts: nobody has tried what the policy bears"
        command = f"{study} -o FOLDER, then --tolerance FOLDER/tolerance.json"
        return (*found, Missing(what, command))
    mapped = {axis.name for one in tolerances.maps for axis in (one.across, one.up)}
    unmapped = [name for name in TITLES if name not in mapped]
    if unmapped:
        pairs = " ".join(f"--pair '{name}:exposure_ms'" for name in unmapped)
        found.append(Missing(f"no tolerance map over {', '.join(unmapped)}", f"{study} {pairs}"))
    return tuple(found)

"""A recording's folder: recording.toml, commands.csv and the tracks. See docs/recordings.md."""

import re
from collections.abc import Sequence
from pathlib import Path

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.commands_csv import CommandedRun, read_commands, write_commands
from mbot_workstation.measure.tracks.plausibility import check_runs
from mbot_workstation.measure.tracks.recording_toml import (
    RecordingInfo,
    read_info,
    write_info,
)
from mbot_workstation.measure.tracks.run import ManeuverRecording, Run, UnusableRunError
from mbot_workstation.measure.tracks.session_track import find_tracker_ahead_s, parts_of
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.measure.tracks.track_file import TRACK_SUFFIXES, read_track, write_tum
from mbot_workstation.measure.tracks.track_format import TrackFormat, read_track_format

COMMANDS_FILE = "commands.csv"
TELEMETRY_FILE = "telemetry.mcap"

_RUN_TRACK = re.compile(r"track-0*([0-9]+)")


def read_maneuvers(folder: Path) -> ManeuverRecording:
    """All runs of a folder with their tracks, checked but not cleaned.

    Raises:
        ConfigurationError: something is missing, unreadable, or can't be what it is declared to
            be: other units or axes, quaternions of another order, a mirrored frame, motors or
            runs that do not do what they were told. The text says what was found and what fits.

    """
    info = read_info(folder)
    commanded = read_commands(folder / COMMANDS_FILE)
    unknown = set(info.leave_out) - {run.number for run in commanded}
    if unknown:
        raise ConfigurationError(
            f"{folder}: leave_out names run {min(unknown)}, which {COMMANDS_FILE} does not have"
        )
    commanded = tuple(run for run in commanded if run.number not in info.leave_out)
    if not commanded:
        raise ConfigurationError(f"{folder}: leave_out leaves no run to use")
    session, tracks = _track_files(folder)
    tracker_ahead_s: float | None = None
    form = read_track_format(folder)
    if session is not None:
        tracker_ahead_s, runs = _cut(session, read_track(session, form), commanded)
    else:
        runs = _match(folder, tracks, form, commanded)
    check_runs(folder, runs, form or TrackFormat())
    return ManeuverRecording(info.robot_id, info.wheel_maps, runs, tracker_ahead_s)


def write_maneuvers(
    folder: Path,
    robot_id: str,
    runs: Sequence[Run],
    *,
    wheel_maps: WheelMaps | None = None,
    session_track: Track | None = None,
    made_on: str = "",
) -> None:
    """Write a new recording, as generators and tests need it.

    Args:
        folder: made if it does not exist.
        robot_id: whose.
        runs: their tracks are written one by one as track-<run>.tum, unless:
        session_track: one track of everything, written as track.tum instead.
        wheel_maps: the daemon's; nominal if not given.
        made_on: ISO date.

    Raises:
        ConfigurationError: the folder can't be written.

    """
    maps = wheel_maps or WheelMaps()
    info = RecordingInfo(robot_id, made_on, left=maps.left, right=maps.right)
    commanded = (CommandedRun(r.number, r.maneuver, r.repetition, r.commands) for r in runs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_info(folder, info)
        write_commands(folder / COMMANDS_FILE, commanded)
        if session_track is not None:
            write_tum(folder / "track.tum", session_track)
            return
        for run in runs:
            write_tum(folder / f"track-{run.number}.tum", run.track)
    except OSError as error:
        raise ConfigurationError(f"can't write to {folder}: {error.strerror}") from None


def _track_files(folder: Path) -> tuple[Path | None, dict[int, Path]]:
    """The track of the whole session, or one a run."""
    found = [p for p in sorted(folder.glob("track*")) if p.suffix.lower() in TRACK_SUFFIXES]
    sessions = [path for path in found if path.stem == "track"]
    numbered: dict[int, Path] = {}
    for path in found:
        match = _RUN_TRACK.fullmatch(path.stem)
        if match:
            number = int(match[1])
            if number in numbered:
                raise ConfigurationError(
                    f"{numbered[number]} and {path.name} are both the track of run {number}; "
                    "keep one"
                )
            numbered[number] = path
    if len(sessions) > 1 or (sessions and numbered):
        names = ", ".join(path.name for path in [*sessions, *numbered.values()][:3])
        raise ConfigurationError(
            f"{folder} holds several tracks of the same runs ({names}); keep one track of the "
            "whole session, or one a run"
        )
    if not sessions and not numbered:
        raise ConfigurationError(
            f"{folder} holds no track: expected track.csv, .tum or .mcap of the whole session, or "
            "one a run such as track-1.csv"
        )
    return (sessions[0] if sessions else None), numbered


def _cut(
    path: Path, track: Track, commanded: Sequence[CommandedRun]
) -> tuple[float, tuple[Run, ...]]:
    try:
        ahead_s = find_tracker_ahead_s(commanded, track)
    except ConfigurationError as error:
        raise error.within(path) from None
    runs: list[Run] = []
    for run, part in zip(commanded, parts_of(track, commanded, ahead_s), strict=True):
        if part is None:
            raise UnusableRunError.of(
                run.number,
                f"{path} has nothing of run {run.number} ({run.maneuver}, repetition "
                f"{run.repetition}): the tracker began late, ended early or was lost",
            )
        runs.append(Run(run.number, run.maneuver, run.repetition, run.commands, part))
    return ahead_s, tuple(runs)


def _match(
    folder: Path,
    tracks: dict[int, Path],
    form: TrackFormat | None,
    commanded: Sequence[CommandedRun],
) -> tuple[Run, ...]:
    missing = [run.number for run in commanded if run.number not in tracks]
    if missing:
        raise ConfigurationError(
            f"{folder} holds no track of run {', '.join(map(str, missing[:5]))}; record it again, "
            "or add it to leave_out in recording.toml"
        )
    return tuple(
        Run(
            run.number,
            run.maneuver,
            run.repetition,
            run.commands,
            read_track(tracks[run.number], form),
        )
        for run in commanded
    )

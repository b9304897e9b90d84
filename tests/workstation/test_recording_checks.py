"""Each check by itself on runs a robot has driven, and on the same runs spoilt."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.axes_check import check_frame
from mbot_workstation.measure.tracks.commands_csv import CommandedRun
from mbot_workstation.measure.tracks.direction_check import check_directions
from mbot_workstation.measure.tracks.motion import DrivenRun
from mbot_workstation.measure.tracks.plausibility import (
    check_repeated_numbers,
    check_run,
    check_runs,
)
from mbot_workstation.measure.tracks.raw_track import RawTrack
from mbot_workstation.measure.tracks.run import Run
from mbot_workstation.measure.tracks.session_track import find_tracker_ahead_s, parts_of
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.measure.tracks.track_format import TrackFormat
from mbot_workstation.measure.tracks.track_mcap import read_mcap
from mbot_workstation.measure.tracks.track_table import read_table
from mbot_workstation.measure.tracks.unit_check import check_units

from .driven_robot import Robot, session, track_of

FORM = TrackFormat()
N = 400


@pytest.fixture(scope="module")
def runs() -> tuple[Run, ...]:
    return session(repetitions=2, duration_s=2.0)


@pytest.fixture(scope="module")
def driven(runs: tuple[Run, ...]) -> list[DrivenRun]:
    return [DrivenRun.of(run) for run in runs]


def raw(**changes: np.ndarray) -> RawTrack:
    time = np.arange(N) / 90.0
    quaternion = np.tile((1.0, 0.0, 0.0, 0.0), (N, 1))
    places = tuple(f"line {i}" for i in range(N))
    made = RawTrack(Path("x.csv"), places, time, np.zeros((N, 3)), quaternion)
    return replace(made, **changes)


def spoilt(run: Run, position_scale: float = 1.0, upside: bool = False) -> DrivenRun:
    track = run.track
    position = track.position_m * position_scale
    if upside:
        position = position[:, [0, 2, 1]]
    return DrivenRun.of(replace(run, track=Track(track.time_s, position, track.quaternion_wxyz)))


def test_what_a_robot_drove_passes_every_check(
    runs: tuple[Run, ...], driven: list[DrivenRun]
) -> None:
    check_runs(Path("recording"), runs, FORM)
    check_units(driven, "m")
    check_frame(driven, FORM)
    check_directions(driven)
    check_repeated_numbers(driven)
    for run in driven:
        check_run(run)


def test_millimetres_taken_for_metres_are_named(runs: tuple[Run, ...]) -> None:
    with pytest.raises(ConfigurationError, match="mm"):
        check_units([spoilt(run, 1000.0) for run in runs], "m")


def test_another_up_axis_is_named(runs: tuple[Run, ...]) -> None:
    with pytest.raises(ConfigurationError, match=r"up|axis|level"):
        check_frame([spoilt(run, upside=True) for run in runs], FORM)


def test_swapped_commands_are_named(runs: tuple[Run, ...]) -> None:
    mirrored = []
    for run in runs:
        track = run.track
        position = track.position_m * (1, -1, 1)
        quaternion = track.quaternion_wxyz * (1, -1, 1, -1)
        mirrored.append(DrivenRun.of(replace(run, track=Track(track.time_s, position, quaternion))))
    with pytest.raises(ConfigurationError, match=r"mirror|swapped"):
        check_directions(mirrored)


def test_a_repeated_number_and_a_short_track_are_named(
    runs: tuple[Run, ...], driven: list[DrivenRun]
) -> None:
    with pytest.raises(ConfigurationError, match="number the repetitions"):
        check_repeated_numbers([driven[0], DrivenRun.of(replace(runs[0], number=99))])
    track = runs[0].track
    half = len(track) // 3
    cut = Track(track.time_s[:half], track.position_m[:half], track.quaternion_wxyz[:half])
    with pytest.raises(ConfigurationError, match="cut short"):
        check_run(DrivenRun.of(replace(runs[0], track=cut)))


def test_runs_are_found_in_one_long_track() -> None:
    made = session(repetitions=1, duration_s=3.0)
    told = [CommandedRun(r.number, r.maneuver, r.repetition, r.commands) for r in made]
    whole = track_of(Robot(), [run.commands for run in made], 0, carried=True)
    ahead_s = find_tracker_ahead_s(told, whole)
    for run, part in zip(made, parts_of(whole, told, ahead_s), strict=True):
        assert part is not None
        assert part.time_s[0] < run.commands.start_s + ahead_s < part.time_s[-1]


def test_poses_become_a_track() -> None:
    track = raw().to_track(FORM)
    assert len(track) == N
    assert track.quaternion_wxyz[0].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": np.zeros(N)}, "expected to rise"),
        ({"time": np.arange(N) * 11.1}, "ms"),
        ({"position": np.full((N, 3), np.nan)}, "400 of 400 were lost"),
        ({"quaternion_wxyz": np.full((N, 4), 0.9)}, "expected 1"),
    ],
)
def test_poses_that_are_none_are_named(change: dict[str, np.ndarray], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        raw(**change).to_track(FORM)


def test_files_that_are_none_are_named(tmp_path: Path) -> None:
    table, recording = tmp_path / "track.csv", tmp_path / "track.mcap"
    table.write_text("a,b\n1,2\n")
    recording.write_bytes(b"no mcap")
    with pytest.raises(ConfigurationError, match=r"track\.csv"):
        read_table(table, FORM)
    with pytest.raises(ConfigurationError, match=r"track\.mcap"):
        read_mcap(recording)

"""A recording's folder: read back as written, and every way it can be wrong is named."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.axes_check import check_frame
from mbot_workstation.measure.tracks.commands_csv import CommandedRun, write_commands
from mbot_workstation.measure.tracks.direction_check import check_directions
from mbot_workstation.measure.tracks.maneuver import MANEUVERS, maneuver_named
from mbot_workstation.measure.tracks.motion import DrivenRun
from mbot_workstation.measure.tracks.plausibility import check_runs
from mbot_workstation.measure.tracks.recording_folder import (
    COMMANDS_FILE,
    read_maneuvers,
    write_maneuvers,
)
from mbot_workstation.measure.tracks.run import CommandSeries, Run, UnusableRunError
from mbot_workstation.measure.tracks.session_track import find_tracker_ahead_s, parts_of
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_format import TrackFormat
from mbot_workstation.measure.tracks.unit_check import check_units

from .driven_robot import Robot, Tracker, session, track_of


def as_csv(path: Path, track: Track, columns: Array | None = None) -> None:
    """A file with a header: t,x,y,z,qw,qx,qy,qz."""
    table = np.column_stack([track.time_s, track.position_m, track.quaternion_wxyz])
    table = table if columns is None else columns
    np.savetxt(path, table, "%.7f", ",", header="t,x,y,z,qw,qx,qy,qz", comments="")


MAP = """
time = "t"
position = ["x", "y", "z"]
quaternion = ["qw", "qx", "qy", "qz"]
quaternion_order = "w-first"
"""


def csv_recording(folder: Path, runs: Sequence[Run], change=None, track_toml: str = MAP) -> Path:
    """As a stranger writes it; `change` takes a run and its table of 8 columns, and spoils it."""
    write_maneuvers(folder, "mbot-1", runs)
    for run in runs:
        (folder / f"track-{run.number}.tum").unlink()
        track = run.track
        table = np.column_stack([track.time_s, track.position_m, track.quaternion_wxyz])
        as_csv(folder / f"track-{run.number}.csv", track, change(run, table) if change else table)
    (folder / "track.toml").write_text(track_toml)
    return folder


@pytest.fixture(scope="module")
def runs() -> tuple[Run, ...]:
    return session(repetitions=3, duration_s=2.0)


def test_a_recording_reads_back_as_it_was_written(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    maps = WheelMaps(MotorMap(True, 0.9, 45), MotorMap(False, 1.0, 50))
    write_maneuvers(tmp_path, "mbot-7", runs, wheel_maps=maps, made_on="2026-11-21")
    found = read_maneuvers(tmp_path)
    assert (found.robot_id, found.wheel_maps) == ("mbot-7", maps)
    assert found.tracker_ahead_s is None
    assert len(found.runs) == len(runs) == 24
    for before, after in zip(runs, found.runs, strict=True):
        assert (after.number, after.maneuver, after.repetition) == (
            (before.number, before.maneuver, before.repetition)
        )
        assert np.allclose(after.commands.time_s, before.commands.time_s, atol=1e-6)
        assert np.array_equal(after.commands.left, before.commands.left)
        assert np.array_equal(after.commands.right, before.commands.right)
        assert np.allclose(after.track.time_s, before.track.time_s, atol=1e-6)
        assert np.allclose(after.track.position_m, before.track.position_m, atol=1e-6)
        assert np.allclose(after.track.quaternion_wxyz, before.track.quaternion_wxyz, atol=1e-6)


def test_a_minimal_recording_has_nominal_motors(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    write_maneuvers(tmp_path, "mbot-1", runs)
    (tmp_path / "recording.toml").write_text('robot_id = "mbot-1"\n')
    assert read_maneuvers(tmp_path).wheel_maps == WheelMaps()
    (tmp_path / "recording.toml").write_text('robot_id = "mbot-1"\n[left]\ntrim = 0.9\n')
    assert read_maneuvers(tmp_path).wheel_maps.left == MotorMap(True, 0.9, 40)


@pytest.mark.parametrize("seed", range(3))
def test_one_track_of_the_whole_session_is_cut_into_its_runs(tmp_path: Path, seed: int) -> None:
    runs = session(repetitions=2, duration_s=3.0)
    ahead_s = -7000.0
    whole = track_of(Robot(), [run.commands for run in runs], seed, carried=True)
    write_maneuvers(tmp_path, "mbot-1", runs, session_track=whole)
    found = read_maneuvers(tmp_path)
    assert found.tracker_ahead_s == pytest.approx(ahead_s, abs=0.15)
    assert [run.number for run in found.runs] == [run.number for run in runs]
    for run in found.runs:
        before_s = run.commands.start_s + ahead_s - run.track.time_s[0]
        after_s = run.track.time_s[-1] - run.commands.end_s - ahead_s
        assert before_s == pytest.approx(1.0, abs=0.2)
        assert after_s == pytest.approx(1.0, abs=0.2)


def test_a_session_track_that_is_another_ones_is_refused(tmp_path: Path) -> None:
    runs = session(repetitions=1, duration_s=3.0)
    other = session(repetitions=2, duration_s=1.3, maneuvers=MANEUVERS[::-1])
    whole = track_of(Robot(), [run.commands for run in other], 0, carried=True)
    write_maneuvers(tmp_path, "mbot-1", runs, session_track=whole)
    with pytest.raises(ConfigurationError, match="nowhere to be found in the track"):
        read_maneuvers(tmp_path)


def test_a_session_track_that_ends_early_names_the_run(tmp_path: Path) -> None:
    runs = session(repetitions=2, duration_s=3.0)
    whole = track_of(Robot(), [run.commands for run in runs], 0, carried=True)
    part = whole.between(whole.time_s[0], float(whole.time_s[-1]) - 10.5)
    write_maneuvers(tmp_path, "mbot-1", runs, session_track=part)
    with pytest.raises(ConfigurationError, match=r"nothing of run 16 .*leave_out"):
        read_maneuvers(tmp_path)
    text = (tmp_path / "recording.toml").read_text()
    (tmp_path / "recording.toml").write_text("leave_out = [16]\n" + text)
    with pytest.raises(ConfigurationError, match=r"run 15 .*cut short"):
        read_maneuvers(tmp_path)
    (tmp_path / "recording.toml").write_text("leave_out = [15, 16]\n" + text)
    assert len(read_maneuvers(tmp_path).runs) == 14


# Bad input: each is a file that reads perfectly well.


def refused(folder: Path) -> str:
    with pytest.raises(ConfigurationError) as caught:
        read_maneuvers(folder)
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1000), ("cm", 100), ("inch", 39.37)])
def test_positions_in_another_unit_are_named(
    tmp_path: Path, runs: tuple[Run, ...], unit: str, factor: float
) -> None:
    text = refused(csv_recording(tmp_path, runs, lambda _run, t: scaled(t, factor)))
    assert "m/s, expected about 0.4" in text
    assert f'set position_unit = "{unit}"' in text
    read_maneuvers(
        csv_recording(
            tmp_path, runs, lambda _run, t: scaled(t, factor), MAP + f'position_unit = "{unit}"'
        )
    )


def test_feet_are_told_from_metres_by_the_turns(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    slow = Robot(left_mps=0.25, right_mps=0.25)  # 0.82 ft/s would pass for a fast robot
    slow_runs = session(slow, repetitions=1, duration_s=2.0)
    text = refused(csv_recording(tmp_path, slow_runs, lambda _run, t: scaled(t, 3.2808)))
    assert "wheels 0.3" in text
    assert 'set position_unit = "foot"' in text


def test_metres_declared_as_millimetres_are_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    text = refused(csv_recording(tmp_path, runs, track_toml=MAP + 'position_unit = "mm"'))
    assert 'set position_unit = "m"' in text


def test_half_the_files_in_millimetres_are_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    text = refused(
        csv_recording(tmp_path, runs, lambda run, t: scaled(t, 1000) if run.number > 16 else t)
    )
    assert "runs 17, 18, 19, 20 and 4 more and the others differ" in text
    assert "its file is in mm" in text


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_file_that_changes_its_unit_half_way_is_named(
    tmp_path: Path, runs: tuple[Run, ...], number: int
) -> None:
    def change(run: Run, table: Array) -> Array:
        table = table.copy()
        if run.number == number:
            table[len(table) // 2 :, 1:4] *= 1000
        return table

    text = refused(csv_recording(tmp_path, runs, change))
    assert f"run {number} (" in text
    assert "only part of the time" in text
    assert "in m elsewhere" in text


def test_a_session_that_changes_its_unit_half_way_is_named(tmp_path: Path) -> None:
    runs = session(repetitions=2, duration_s=3.0)
    whole = track_of(Robot(), [run.commands for run in runs], 3, carried=True)
    position = whole.position_m.copy()
    position[len(position) // 2 :] *= 1000
    write_maneuvers(tmp_path, "mbot-1", runs, session_track=replace(whole, position_m=position))
    text = refused(tmp_path)
    assert "the others differ" in text or "part of the time" in text
    assert "mm" in text


@pytest.mark.parametrize("up", ["x", "y"])
def test_a_wrong_up_axis_is_named(tmp_path: Path, runs: tuple[Run, ...], up: str) -> None:
    # As a tracker with that axis up would have written it.
    order = {"x": [2, 0, 1], "y": [1, 2, 0]}[up]  # file's x, y, z from ours, cyclic

    def change(_run: Run, table: Array) -> Array:
        return np.concatenate(
            [table[:, :1], table[:, 1:4][:, order], table[:, 4:5], table[:, 5:8][:, order]],
            axis=1,
        )

    text = refused(csv_recording(tmp_path, runs, change))
    assert f"axis {up} of the tracker's frame is the one that points up" in text
    assert f'set up = "{up}"' in text
    read_maneuvers(csv_recording(tmp_path, runs, change, MAP + f'up = "{up}"'))


@pytest.mark.parametrize("mount", [(1.0, 0.0, 0.0, 0.0), (0.8, 0.5, -0.3, 0.1)])
def test_quaternions_of_another_order_are_named(
    tmp_path: Path, mount: tuple[float, float, float, float]
) -> None:
    runs = session(Robot(tracker=Tracker(mount_wxyz=mount)), repetitions=1, duration_s=2.0)

    def last(_run: Run, table: Array) -> Array:
        return np.concatenate([table[:, :4], np.roll(table[:, 4:], -1, axis=1)], axis=1)

    text = refused(csv_recording(tmp_path, runs, last))
    assert 'set quaternion_order = "w-last"' in text
    assert "up axis" not in text
    text = refused(csv_recording(tmp_path, runs, None, MAP.replace("w-first", "w-last")))
    assert 'set quaternion_order = "w-first"' in text
    read_maneuvers(csv_recording(tmp_path, runs))
    read_maneuvers(csv_recording(tmp_path, runs, last, MAP.replace("w-first", "w-last")))


def test_both_wrong_at_once_are_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    def change(_run: Run, table: Array) -> Array:
        y_up = [1, 2, 0]
        return np.column_stack(
            [table[:, 0], table[:, 1:4][:, y_up], table[:, 5:8][:, y_up], table[:, 4]]
        )

    text = refused(csv_recording(tmp_path, runs, change))
    assert 'set up = "y" and quaternion_order = "w-last"' in text


def mirrored(_run: Run, table: Array) -> Array:
    """A left-handed frame: y and with it the turns about x and z the other way."""
    return table * np.array([1, 1, -1, 1, 1, -1, 1, -1])


def test_a_mirrored_frame_is_found_but_not_told_from_swapped_plugs(
    tmp_path: Path, runs: tuple[Run, ...]
) -> None:
    text = refused(csv_recording(tmp_path, runs, mirrored))
    for cause in ("turns the other way than told", "plugs exchanged", "mirrored", "can't tell"):
        assert cause in text
    read_maneuvers(csv_recording(tmp_path, runs, mirrored, MAP + 'handedness = "left"'))


def test_swapped_motors_are_found(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    def swapped(run: Run) -> Run:
        left, right = run.maneuver.split("-")
        series = CommandSeries(run.commands.time_s, run.commands.right, run.commands.left)
        return replace(run, maneuver=f"{right}-{left}", commands=series)

    write_maneuvers(tmp_path, "mbot-1", [swapped(run) for run in runs])
    assert "plugs exchanged" in refused(tmp_path)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_reversed_motor_is_found(tmp_path: Path, side: str) -> None:
    reversed_robot = Robot(left_mps=-0.4) if side == "left" else Robot(right_mps=-0.4)
    write_maneuvers(tmp_path, "mbot-1", session(reversed_robot, 1, 2.0))
    assert f"the {side} motor runs backwards" in refused(tmp_path)


def test_a_mirrored_position_alone_is_found(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    def exchanged(_run: Run, table: Array) -> Array:
        return table[:, [0, 2, 1, 3, 4, 5, 6, 7]]

    text = refused(csv_recording(tmp_path, runs, exchanged))
    assert "the path curves one way and the attitude turns the other" in text


def test_a_weak_motor_is_no_bad_input(tmp_path: Path) -> None:
    write_maneuvers(tmp_path, "mbot-1", session(Robot(right_mps=0.2), 2, 3.0))
    assert len(read_maneuvers(tmp_path).runs) == 16


def shortened(run: Run) -> Track:
    return cut(run, run.track.time_s[0], run.track.time_s[0] + 1.5).track


def with_hole(run: Run) -> Track:
    return run.track.where(np.abs(run.track.time_s - run.track.time_s[0] - 2.0) >= 0.35)


def standing(run: Run) -> Track:
    return track_of(Robot(left_mps=0, right_mps=0), [run.commands], 1)


@pytest.mark.parametrize(
    ("number", "spoil", "words"),
    [
        (10, shortened, r"run 10 \(forward-neutral, repetition 2\) was cut short"),
        (5, with_hole, "the tracker was lost for 0.7 s"),
        (7, standing, "never moves"),
    ],
)
def test_a_run_without_a_whole_track_is_named(
    tmp_path: Path,
    runs: tuple[Run, ...],
    number: int,
    spoil: Callable[[Run], Track],
    words: str,
) -> None:
    spoilt = replace(runs[number - 1], track=spoil(runs[number - 1]))
    write_maneuvers(tmp_path, "mbot-1", [spoilt if r.number == number else r for r in runs])
    with pytest.raises(UnusableRunError, match=words) as caught:
        read_maneuvers(tmp_path)
    assert (caught.value.number, caught.value.kind) == (number, "run-spoilt")
    assert str(caught.value).startswith(f"{tmp_path}: ")


def test_a_track_that_ends_while_the_robot_drives_is_named(tmp_path: Path) -> None:
    runs = list(session(repetitions=1, duration_s=5.0))
    early = runs[2].track.time_s[0]
    runs[2] = cut(runs[2], early, early + 4.9)
    write_maneuvers(tmp_path, "mbot-1", runs)
    with pytest.raises(UnusableRunError, match="still drives when the track ends") as caught:
        read_maneuvers(tmp_path)
    assert caught.value.number == 3


def test_a_wrongly_labelled_run_is_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    by_number = {run.number: run for run in runs}
    spoilt = replace(by_number[2], track=by_number[4].track)
    write_maneuvers(tmp_path, "mbot-1", [spoilt if run is runs[1] else run for run in runs])
    with pytest.raises(UnusableRunError, match="turns at") as caught:
        read_maneuvers(tmp_path)
    assert caught.value.number == 2


def test_what_a_robot_drove_passes_every_check(runs: tuple[Run, ...]) -> None:
    check_runs(Path("recording"), runs, TrackFormat())
    driven = [DrivenRun.of(run) for run in runs]
    check_units(driven, "m")
    check_frame(driven, TrackFormat())
    check_directions(driven)


def test_runs_are_found_in_one_long_track() -> None:
    made = session(repetitions=1, duration_s=3.0)
    told = [CommandedRun(r.number, r.maneuver, r.repetition, r.commands) for r in made]
    whole = track_of(Robot(), [run.commands for run in made], 0, carried=True)
    ahead_s = find_tracker_ahead_s(told, whole)
    for run, part in zip(made, parts_of(whole, told, ahead_s), strict=True):
        assert part is not None
        assert part.time_s[0] < run.commands.start_s + ahead_s < part.time_s[-1]


# commands.csv and the folder itself


def test_what_is_missing_is_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    assert "is not a recording" in refused(tmp_path)
    write_maneuvers(tmp_path, "mbot-1", runs[:2])
    (tmp_path / "track-2.tum").unlink()
    assert "no track of run 2" in refused(tmp_path)
    (tmp_path / "track-1.tum").unlink()
    assert "holds no track" in refused(tmp_path)
    (tmp_path / COMMANDS_FILE).unlink()
    assert "can't read" in refused(tmp_path)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("", "holds no run"),
        ("1,forward-forward,1,0,0", "line 2: 5 fields, expected 6"),
        ("1,forward-forward,1,0,0,zero", "should be whole numbers"),
        ("1,sideways,1,0,0,0", "no maneuver 'sideways'"),
        ("1,forward-forward,1,0,1,1\n1,forward-forward,1,9,1,1", "the last row is not 0, 0"),
        ("1,forward-forward,1,0,1,-1\n1,forward-forward,1,9,0,0", "expected 1, 1 or 0, 0"),
        ("1,forward-forward,1,5,1,1\n1,forward-forward,1,5,0,0", "time_s does not rise"),
        ("1,forward-forward,1,nan,1,1\n1,forward-forward,1,5,0,0", "time_s does not rise"),
        ("1,forward-forward,1,0,0,0\n1,forward-forward,1,5,0,0", "both motors are 0 throughout"),
        ("1,forward-forward,1,0,1,1\n1,forward-forward,2,5,0,0", "a number of its own"),
    ],
)
def test_bad_commands_are_named(tmp_path: Path, lines: str, words: str) -> None:
    (tmp_path / "recording.toml").write_text('robot_id = "mbot-1"\n')
    header = "run,maneuver,repetition,time_s,left,right\n"
    (tmp_path / COMMANDS_FILE).write_text(header + lines)
    assert words in refused(tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot_id = 7", "robot_id is 7"),
        ('robot_id = "*"', "expected 1 to 32"),
        ('robot_id = "a"\ncolour = 1', "colour"),
        ('robot_id = "a"\n[left]\ntrim = 2', "left.trim is 2"),
        ('robot_id = "a"\nleave_out = [99]', "leave_out names run 99"),
        ("robot_id", "recording.toml"),
    ],
)
def test_a_bad_recording_toml_is_named(
    tmp_path: Path, runs: tuple[Run, ...], text: str, words: str
) -> None:
    write_maneuvers(tmp_path, "mbot-1", runs[:1])
    (tmp_path / "recording.toml").write_text(text)
    assert words in refused(tmp_path)


def test_two_runs_of_the_same_repetition_are_named(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    write_maneuvers(tmp_path, "mbot-1", [runs[0], replace(runs[8], repetition=1)])
    assert "runs 1 and 9 are both forward-forward, repetition 1" in refused(tmp_path)


def test_several_tracks_of_the_same_run_are_refused(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    write_maneuvers(tmp_path, "mbot-1", runs[:2])
    (tmp_path / "track-01.csv").write_text("1,2,3\n")
    assert "are both the track of run 1" in refused(tmp_path)
    (tmp_path / "track-01.csv").rename(tmp_path / "track.csv")
    assert "several tracks of the same runs" in refused(tmp_path)


def test_commands_hold_until_the_next_row() -> None:
    series = CommandSeries(np.array([1.0, 2.0, 5.0]), np.array([0.0, 1, 0]), np.array([0.0, -1, 0]))
    left, right = series.at(np.array([0.0, 1.5, 2.0, 4.99, 5.0, 9.0]))
    assert left.tolist() == [0, 0, 1, 1, 0, 0]
    assert right.tolist() == [0, 0, -1, -1, 0, 0]
    assert (series.start_s, series.end_s) == (2.0, 5.0)


def test_the_eight_maneuvers_are_the_papers() -> None:
    assert len(MANEUVERS) == len({maneuver.name for maneuver in MANEUVERS}) == 8
    assert {(m.left, m.right) for m in MANEUVERS} == {
        (left, right) for left in (-1, 0, 1) for right in (-1, 0, 1) if (left, right) != (0, 0)
    }
    assert maneuver_named("forward-neutral").left == 1
    with pytest.raises(ConfigurationError, match="expected one of forward-forward"):
        maneuver_named("neutral-neutral")


def scaled(table: Array, factor: float) -> Array:
    return table * np.array([1, factor, factor, factor, 1, 1, 1, 1])


def cut(run: Run, first_s: float, last_s: float) -> Run:
    track = run.track.between(first_s, last_s)
    assert track is not None
    return replace(run, track=track)


def test_written_commands_are_plain(tmp_path: Path, runs: tuple[Run, ...]) -> None:
    run = runs[2]
    write_commands(
        tmp_path / "c.csv", [CommandedRun(run.number, run.maneuver, run.repetition, run.commands)]
    )
    assert (tmp_path / "c.csv").read_text().splitlines()[1:3] == [
        "3,forward-backward,1,5012.110000,0,0",
        "3,forward-backward,1,5013.110000,1,-1",
    ]


def test_the_documents_example_is_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = Path(__file__).parents[2] / "docs" / "recordings.md"
    program = page.read_text().split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    found = read_maneuvers(tmp_path / "ideal")
    assert len(found.runs) == 16
    assert {run.maneuver for run in found.runs} == {one.name for one in MANEUVERS}
    assert found.tracker_ahead_s == pytest.approx(7000, abs=0.15)
    turning = next(run for run in found.runs if run.maneuver == "forward-backward")
    assert turning.track.yaw_rad[-1] == pytest.approx(-10 * 2 * 0.404 / 0.115, rel=0.01)

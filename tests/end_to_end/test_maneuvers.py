"""`workstation maneuvers run` with the real daemon and the virtual robot, tracked by its truth."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_workstation.measure.tracks.motion import DrivenRun
from mbot_workstation.measure.tracks.recording_folder import read_maneuvers
from mbot_workstation.measure.tracks.track_file import read_track

from .processes import Daemon, until, workstation

TOLD = ("forward-forward", "forward-backward", "neutral-forward", "backward-backward")


@pytest.mark.timeout(150)
def test_maneuvers_are_driven_recorded_and_found_in_the_track(tmp_path: Path) -> None:
    board, ready = tmp_path / "board", tmp_path / "ready.json"
    folder = tmp_path / "recording"
    daemon = Daemon(tmp_path, str(board))
    options = ["--plain", "--frame-rate", "5", "--free-floor", "--right-gain", "0.9"]
    options += ["--camera-port", str(daemon.camera_port), "--board", str(board)]
    options += ["--truth-track", str(tmp_path / "truth.csv"), "--truth-offset", "20", "-15"]
    options += ["--truth-noise", "4", "0.3", "--ready-file", str(ready)]
    with workstation("virtual-robot", *options, log=tmp_path / "robot.log") as robot:
        assert until(ready.exists, 60), robot.output
        with daemon.start() as agent:
            assert daemon.is_up(), agent.output
            assert until(lambda: not _board_faults(daemon), 30)
            arguments = ["maneuvers", "run", "--yes", "--robot", daemon.address]
            arguments += ["--seconds", "1", "--repetitions", "2", "--pause", "1.5"]
            arguments += ["--output", str(folder), "--order", "listed"]
            for name in TOLD:
                arguments += ["--maneuver", name]
            with workstation(*arguments, log=tmp_path / "maneuvers.log") as drive:
                assert drive.wait(90) == 0, drive.output
            agent.signal(signal.SIGTERM)
            assert agent.wait() == 0
        robot.signal(signal.SIGTERM)
        assert robot.wait() == 0, robot.output

    (tmp_path / "truth.csv").rename(folder / "track.csv")
    (folder / "track.toml").write_text('preset = "triad-openvr"\n')
    recording = read_maneuvers(folder)
    assert recording.robot_id == "mbot-test"
    assert tuple(run.maneuver for run in recording.runs) == TOLD * 2
    ahead_s = recording.tracker_ahead_s
    assert ahead_s is not None
    for run in recording.runs:
        assert 0.9 < run.commands.end_s - run.commands.start_s < 1.5
        told_s = np.array([run.commands.start_s, run.commands.end_s]) + ahead_s
        moving_s = DrivenRun.of(run).moving_s
        assert moving_s is not None
        assert np.abs(np.array(moving_s) - told_s).max() < 0.5
    straight, spin, _, back = (DrivenRun.of(run) for run in recording.runs[:4])
    assert 0.25 < straight.pace_mps < 0.45
    assert 0.25 < back.pace_mps < 0.45
    assert -8 < spin.yaw_radps < -4
    assert straight.yaw_radps < -0.1  # the right motor is the weaker one
    decisions = [beat.decision for beat in read_drive(folder / "telemetry.mcap").beats]
    assert len(decisions) > 10
    driven = [run.commands for run in recording.runs]
    assert decisions[0].started_monotonic_ns / 1e9 < driven[0].start_s + 1
    assert decisions[-1].started_monotonic_ns / 1e9 > driven[-1].start_s


def _board_faults(daemon: Daemon) -> list[str]:
    return [fault.kind for fault in daemon.status().faults if fault.kind.startswith("board")]


@pytest.mark.parametrize("ending", ["csv", "tum"])
def test_a_truth_track_lies_where_the_virtual_robot_stands(tmp_path: Path, ending: str) -> None:
    truth, trajectory = tmp_path / f"truth.{ending}", tmp_path / "path.jsonl"
    options = ["--plain", "--frame-rate", "5", "--camera-port", "0", "--seconds", "2"]
    options += ["--board", str(tmp_path / "board"), "--truth-track", str(truth)]
    options += ["--truth-noise", "0", "0", "--truth-offset", "30", "0"]
    options += ["--trajectory", str(trajectory)]
    with workstation("virtual-robot", *options, log=tmp_path / "robot.log") as robot:
        assert robot.wait(60) == 0, robot.output
    (tmp_path / "track.toml").write_text('preset = "triad-openvr"\n')
    from mbot_workstation.measure.tracks.track_format import read_track_format

    form = read_track_format(tmp_path) if ending == "csv" else None
    track = read_track(truth, form)
    assert len(track) > 60
    assert np.median(np.diff(track.time_s)) == pytest.approx(1 / 90, abs=1e-4)
    standing = json.loads(trajectory.read_text().splitlines()[0])
    assert (standing["x"], standing["y"]) == pytest.approx((0, 0), abs=0.002)
    assert np.ptp(track.position_m, axis=0).max() < 0.005
    assert track.position_m[-1, 2] == pytest.approx(0.12, abs=0.01)
    # 30 mm ahead of the middle, in an arena turned by 0.6 rad and moved to (1.3, -0.4).
    assert track.position_m[-1, :2] == pytest.approx(
        [1.3 + 0.03 * np.cos(0.6), -0.4 + 0.03 * np.sin(0.6)], abs=0.005
    )
    assert track.up_in_tracker[-1, 2] > 0.99


def test_a_truth_track_that_can_not_be_written_is_refused(tmp_path: Path) -> None:
    for name, words in (
        ("truth.bag", "expected .csv, .tum or .txt"),
        ("no/t.csv", "there is no folder"),
    ):
        with workstation(
            "virtual-robot", "--truth-track", str(tmp_path / name), log=tmp_path / "log"
        ) as robot:
            assert robot.wait(30) == 2
            assert words in robot.output

"""The real daemon records what it does; killed, it leaves a drive that decides the same again."""

import signal
import time
from pathlib import Path
from statistics import median

import pytest

from mbot_agent.configuration import decode
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.v1.messages_pb2 import Decision, State
from mbot_workstation.fleet.link.recording_fetch import fetch, keep, list_recordings, remove
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.telemetry.stream import TelemetryStream
from mbot_workstation.look.drives.drive_figures import figures
from mbot_workstation.look.drives.replayed_drive import TOLERANCE, replay

from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import seeing_model
from .processes import Daemon, until, workstation

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"

pytestmark = pytest.mark.slow


def test_a_killed_daemon_leaves_a_drive_that_is_fetched_and_decided_again(
    daemon: Daemon, board: FakeBoard, tmp_path: Path
) -> None:
    with daemon.camera():
        with daemon.start() as process:
            assert daemon.is_up()
            daemon.push(seeing_model())
            daemon.run()
            assert until(lambda: board.moved)
            with daemon.link() as link:
                until_s = time.monotonic() + 4
                before = link.status()
                assert until(lambda: time.monotonic() > until_s, 10)
                decisions = link.status().decisions - before.decisions
            process.signal(signal.SIGKILL)
            process.wait()
        daemon.log.write_text("")
        with daemon.start():
            assert daemon.is_up()
            with daemon.link() as link:
                (drive,) = list_recordings(link).drives
                assert not drive.open
                folder = fetch(link, drive, tmp_path / "here")
                assert keep(link, drive.name, kept=True).drives[0].kept
                keep(link, drive.name, kept=False)
                assert not remove(link, drive.name).drives
    recorded = read_drive(folder)
    assert "was never ended properly" in recorded.words[0]
    # A second at 2.5 beats a second may be lost, and one beat is counted on either side.
    assert len(recorded.decided) >= decisions - 4
    found = replay(recorded, [daemon.directory / "model.onnx"])
    assert found.same_model
    assert found.largest_difference <= TOLERANCE
    assert found.same_motor_bytes == len(found.decisions)
    assert figures(recorded).lost_records == 0


def test_a_drive_under_way_is_fetched_without_a_missed_beat(
    daemon: Daemon, board: FakeBoard, tmp_path: Path
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(seeing_model())
        daemon.run()
        assert until(lambda: board.moved)
        with daemon.link() as link:
            assert until(lambda: any(drive.files for drive in list_recordings(link).drives))
            for _ in range(5):
                (drive,) = list_recordings(link).drives
                assert drive.open
                fetch(link, drive, tmp_path / "here")
            RemoteControl(link).stop()
            assert until(lambda: not list_recordings(link).drives[0].open)
            folder = fetch(link, list_recordings(link).drives[0], tmp_path / "here")
    recorded = read_drive(folder)
    assert recorded.words == ()
    assert figures(recorded).missed_beats == 0
    assert "was stopped by" in figures(recorded).sentence


def test_a_robot_told_so_records_nothing(daemon: Daemon, board: FakeBoard) -> None:
    daemon.config.write_text(daemon.config.read_text() + "[recording]\nenabled = false\n")
    assert not decode(daemon.config.read_text(), "here").recording.enabled
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(seeing_model())
        daemon.run()
        assert until(lambda: board.moved)
        with daemon.link() as link:
            found = list_recordings(link)
    assert not found.enabled
    assert not found.drives
    assert not (daemon.directory / "recordings").exists()


def test_a_recording_is_played_to_a_daemon_which_decides_about_the_same(tmp_path: Path) -> None:
    recorded = read_drive(RECORDED)
    then = [beat.decision.action.left for beat in recorded.decided]
    daemon = Daemon(tmp_path, str(tmp_path / "board"))
    where = ("--board", str(tmp_path / "board"), "--camera-port", str(daemon.camera_port))
    arguments = ("virtual-robot", "--replay", str(RECORDED), *where)
    with workstation(*arguments, log=tmp_path / "robot.log") as robot:
        assert until(lambda: "ready" in robot.output, 20), robot.output
        with daemon.start():
            assert daemon.is_up()
            daemon.push((RECORDED / "seeing.onnx").read_bytes())
            daemon.run()
            driven = heard_actions(daemon, 2 * len(then))
            assert daemon.status().state == State.STATE_RUNNING
            assert not daemon.status().faults
        assert "played once" in robot.output
    # Not to the beat: the daemon's beats fall elsewhere between the recording's pictures, and where
    # the last one is followed by the first its memory knows of a jump that never was. Pictures
    # that stand still would have it settle.
    assert median(driven) == pytest.approx(median(then), abs=0.1)
    assert max(driven) - min(driven) > 0.7 * (max(then) - min(then))
    assert all(min(then) - 0.3 < one < max(then) + 0.3 for one in driven)


def heard_actions(daemon: Daemon, wanted: int) -> list[float]:
    """What the policy says of the left wheel in so many decisions."""
    driven: list[float] = []
    with daemon.link() as link, TelemetryStream(link) as stream:

        def enough() -> bool:
            decisions = [one.message for one in stream.poll(0.2)]
            driven.extend(
                one.action.left
                for one in decisions
                if isinstance(one, Decision) and one.HasField("action")
            )
            return len(driven) > wanted

        assert until(enough, 40), daemon.log.read_text()
    return driven

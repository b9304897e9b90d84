"""Row of the fault table: power cut while recording. The real command, killed without a word."""

import itertools
import signal
import time
from collections.abc import Callable

import pytest

from mbot_protocol.beat.recorded_drive import read_drive

from ..end_to_end.processes import Daemon, until, workstation
from ..promised import promised
from ..robot.fake_board import FakeBoard
from .effort import within
from .motion import configure, driving

Record = Callable[[str, object], None]

PERIOD_S = 0.1


@pytest.mark.timeout(600)
def test_a_recording_that_was_cut_off_lacks_less_than_a_second(
    daemon: Daemon, board: FakeBoard, record_property: Record
) -> None:
    configure(daemon, "control", f"decision_rate_hz = {1 / PERIOD_S}")
    paths = (daemon.directory / f"{number}.mcap" for number in itertools.count())
    with daemon.camera(), driving(daemon, board, daemon.start()):

        def lost_s() -> float:
            path = next(paths)
            arguments = ("telemetry", "--robot", daemon.address, "--record", str(path))
            with workstation(*arguments, log=daemon.directory / "telemetry.log") as recorder:
                assert until(lambda: path.exists() and path.stat().st_size > 40_000, 60)
                recorder.signal(signal.SIGKILL)
                killed_s = time.time()
                recorder.wait()
            records = [beat.decision for beat in read_drive(path).beats]
            sequences = [decision.sequence for decision in records]
            assert len(sequences) >= 5
            assert sequences == sorted(sequences)
            return killed_s - records[-1].unix_time_ns / 1e9

        found = within(promised("power-cut-lost"), lost_s)
    record_property("lost s", round(max(found), 2))

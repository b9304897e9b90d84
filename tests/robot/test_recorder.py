import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbot_agent.recording import recorder as module
from mbot_agent.recording.recorder import BACKLOG, Recorder
from mbot_agent.recording.robot_facts import processor_name
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.drive.actions import AS_BUILT
from mbot_protocol.drive.wheel_command import Duties

from ..until import until
from .recording_bench import FACTS, Drive, directory, to_beat, written


def recorder_in(path: Path, **settings: Any) -> Recorder:
    return Recorder(directory(path, **settings), FACTS, to_beat)


def files(path: Path) -> list[Path]:
    return sorted(path.glob("drive-*/*.mcap"))


def test_a_drive_is_recorded_exactly_from_arming_to_the_stop(tmp_path: Path) -> None:
    drive = Drive()
    with recorder_in(tmp_path) as recorder:
        for tick in drive.ticks(3):
            recorder.offer(tick)
        drive.bench.run()
        driven = [drive.tick() for _ in range(5)]
        drive.bench.helm.stop("anna")
        driven.append(drive.tick())
        for tick in driven:
            recorder.offer(tick)
    (path,) = files(tmp_path)
    found = written(path)
    assert [record["sequence"] for record in found["drive"]] == [tick.sequence for tick in driven]
    for record, picture, tick in zip(found["drive"], found["observation"], driven, strict=True):
        assert np.array_equal(picture, tick.observation)  # pyright: ignore[reportArgumentType]
        assert (record["board_m1"], record["board_m2"]) == AS_BUILT.levels(tick.duties)
        assert record["armed"] is tick.orders.is_armed
        assert (record["view_horizontal_deg"], record["view_vertical_deg"]) == (55.3, 42.9)
    assert [record["began_anew"] for record in found["drive"]] == [True, *[False] * 5]
    assert all(record["resident_memory_bytes"] > 1e6 for record in found["drive"])
    third = found["drive"][2]
    before, then = driven[1].steps, driven[2].action
    assert before is not None
    assert then is not None
    assert (third["told_left"], third["told_right"]) == before.action
    assert third["action_left"] == then.left == 0.25
    assert any(b"stopped by anna" in line for line in found["log"])


def test_what_a_hand_told_the_board_is_recorded(tmp_path: Path) -> None:
    drive = Drive()
    with recorder_in(tmp_path) as recorder:
        drive.bench.hold(Duties(100 / 255, 90 / 255))
        recorder.offer(drive.tick())
        drive.bench.helm.stop()
        recorder.offer(drive.tick())
    (path,) = files(tmp_path)
    records = written(path)["drive"]
    boards = [(record["board_m1"], record["board_m2"]) for record in records]
    assert boards == [(-100, 90), (0, 0)]
    assert [record["state"] for record in records] == ["manual", "stopped"]


def test_a_robot_that_stands_writes_nothing(tmp_path: Path) -> None:
    drive = Drive()
    with recorder_in(tmp_path / "recordings") as recorder:
        for tick in drive.ticks(5):
            recorder.offer(tick)
    assert list(tmp_path.iterdir()) == []


def test_a_beat_is_on_the_card_within_a_second_though_no_other_follows(tmp_path: Path) -> None:
    drive = Drive()
    drive.bench.run()
    armed, took_s = drive.tick(), list[float]()
    with recorder_in(tmp_path) as recorder:
        for count in range(1, 4):
            offered_s = time.monotonic()
            recorder.offer(armed)
            assert until(
                lambda n=count: [p for p in files(tmp_path) if len(written(p)["drive"]) == n]
            )
            took_s.append(time.monotonic() - offered_s)
    assert sorted(took_s)[-2] < 1.0  # one may be held up by what else runs here


def test_a_card_that_hangs_holds_up_nobody_and_what_is_lost_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, free = Drive(), threading.Event()
    drive.bench.run()
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda file: (free.wait(20), fsync(file)))
    with recorder_in(tmp_path) as recorder:
        ticks = [drive.tick() for _ in range(BACKLOG + 30)]
        slowest_s = 0.0
        for tick in ticks:
            began_s = time.monotonic()
            recorder.offer(tick)
            slowest_s = max(slowest_s, time.monotonic() - began_s)
        assert slowest_s < 0.1
        free.set()
        assert until(
            lambda: [1 for path in files(tmp_path) if len(written(path)["drive"]) >= BACKLOG]
        )
        recorder.offer(drive.tick())

        def lost() -> tuple[int, int]:
            """As the last record counts them, and as they lack."""
            records = written(files(tmp_path)[0])["drive"]
            return records[-1]["dropped_records"], len(ticks) + 1 - len(records)

        # Closing waits a second for the card, which may be slower.
        assert until(lambda: lost()[0] == lost()[1]), lost()
        assert lost()[1] > 0


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(28, "No space left on device"), "No space left"),
        (ValueError("what?"), "ValueError: what"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_whatever_goes_wrong_is_told_and_recording_goes_on_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    drive, broken = Drive(), True
    sync = BeatWriter.sync

    def sync_if_whole(segment: BeatWriter) -> None:
        if broken:
            raise error
        sync(segment)

    monkeypatch.setattr(BeatWriter, "sync", sync_if_whole)
    monkeypatch.setattr(module, "TRY_AGAIN_S", 0.05)
    drive.bench.run()
    with recorder_in(tmp_path) as recorder:
        armed = drive.tick()
        recorder.offer(armed)
        assert until(lambda: recorder.notices)
        (notice,) = recorder.notices
        assert notice.kind == "recording-stopped"
        assert words in notice.detail
        broken = False
        assert until(lambda: recorder.offer(armed) or not recorder.notices)
    *_, last = files(tmp_path)
    records = written(last)["drive"]
    assert records
    assert records[-1]["dropped_records"] > 0


def test_a_full_card_is_told_and_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 70_000_000}))
    drive = Drive()
    drive.bench.run()
    with recorder_in(tmp_path / "recordings", leave_free_mb=100) as recorder:
        recorder.offer(drive.tick())
        assert until(lambda: recorder.notices)
        assert "70 MB are free, recording.leave_free_mb leaves 100" in recorder.notices[0].detail
    assert list(tmp_path.iterdir()) == []


def test_a_long_drive_is_several_files_of_one_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SEGMENT_S", 0.0)
    drive = Drive()
    drive.bench.run()
    with recorder_in(tmp_path) as recorder:
        for tick in drive.ticks(3):
            recorder.offer(tick)
    found = files(tmp_path)
    assert [path.name for path in found] == ["000.mcap", "001.mcap", "002.mcap"]
    assert [written(path)["drive"][0]["sequence"] for path in found] == [0, 1, 2]
    assert len({path.parent for path in found}) == 1


def test_the_processor_is_named(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nmodel name\t: Fast One\n\nprocessor\t: 1\n")
    assert processor_name(cpuinfo).endswith(" Fast One")
    assert processor_name(tmp_path / "none")

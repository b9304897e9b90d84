"""Every armed drive, written to the robot's card by a thread of its own.

It hears of every beat as telemetry does. Whatever the card does, be it slow, full or gone, costs
beats of the recording, which are counted, and nothing else.
"""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import msgspec
import numpy as np

from mbot_agent.faults import Notice
from mbot_agent.recording.beat_log import BeatLog
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.segment import Segment
from mbot_agent.tick import Tick
from mbot_protocol.beat.drive_record import DriveRecord, RobotFacts, drive_record
from mbot_protocol.v1.messages_pb2 import Decision

log = logging.getLogger(__name__)

BACKLOG = 128
"""Beats waiting for the card, at 13 kB each: 1.7 MB, and 51 s at 2.5 Hz. Cards pause for
seconds."""

SYNC_AFTER_S = 0.8
"""From a chunk's first beat to its sync. With the time that this takes it stays below a second."""

SEGMENT_S = 300.0
"""A file's length: what a damaged card may take along, and what goes at once to make room."""

TAIL_S = 3.0
"""The recording goes on so long after the end of a drive: what came of it, and a `drive` that is
renewed by hand stays one drive."""

LOOK_FOR_ROOM_S = 10.0
"""At 30 kB/s and the smallest floor a card does not fill up in between."""

TRY_AGAIN_S = 10.0


class Recorder:
    """The recording thread. A context manager."""

    def __init__(
        self,
        directory: RecordingDirectory,
        facts: RobotFacts,
        to_message: Callable[[Tick], Decision],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare; `to_message` is called on this thread, for each beat of a drive."""
        self._directory = directory
        self._facts = facts
        self._to_message = to_message
        self._monotonic_s = monotonic_s
        self._backlog: queue.Queue[Tick | None] = queue.Queue(BACKLOG)
        self._refused = 0  # counted by who offers
        self._lost = 0  # counted by this thread
        self._segment: Segment | None = None
        self._folder: Path | None = None
        self._files = 0
        self._log = BeatLog()
        self._began_s = self._room_s = 0.0
        self._unsynced_s: float | None = None
        self._armed_ns: int | None = None
        self._wait_until_s = 0.0
        self._problem = ""
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with contextlib.suppress(queue.Full):
            self._backlog.put_nowait(None)
        self._thread.join(timeout=1.0)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Why drives are not recorded now, if they are not; any thread may ask."""
        problem = self._problem
        return (Notice("recording-stopped", f"drives are not recorded: {problem}"),) * bool(problem)

    def offer(self, tick: Tick) -> None:
        """Hand over a beat; returns at once."""
        try:
            self._backlog.put_nowait(tick)
        except queue.Full:
            self._refused += 1

    def _run(self) -> None:
        while True:
            try:
                tick = self._backlog.get(timeout=self._until_sync_s())
            except queue.Empty:
                tick = None
            else:
                if tick is None:
                    break
            try:
                if tick is not None:
                    self._take(tick)
                self._sync_if_due()
            except Exception as error:
                self._give_up(error)
        try:
            self._end_drive()
        except Exception as error:
            self._give_up(error)

    def _take(self, tick: Tick) -> None:
        """Write a beat, if it belongs to a drive."""
        if tick.orders.is_armed:
            self._armed_ns = tick.started_ns
        elif self._armed_ns is None or tick.started_ns - self._armed_ns > TAIL_S * 1e9:
            self._armed_ns = None
            self._end_drive()
            return
        segment = self._open_segment()
        if segment is None:
            self._lost += 1
            return
        if self._unsynced_s is None:
            self._unsynced_s = self._monotonic_s()
        decision = self._to_message(tick)
        decision.unix_time_ns = time.time_ns() - (time.monotonic_ns() - tick.started_ns)
        decision.dropped_records = self._refused + self._lost
        for level, words in self._log.changes(tick):
            segment.write_log(level, words, decision.unix_time_ns)
        if tick.observation is not None:
            segment.write_picture(tick.observation, decision.unix_time_ns)
        record = replayable(drive_record(decision), tick)
        segment.write_decision(decision, msgspec.json.encode(record))

    def _open_segment(self) -> Segment | None:
        """The file to write to; None while there can be none."""
        now_s = self._monotonic_s()
        if self._segment is not None and now_s - self._began_s > SEGMENT_S:
            self._close_segment()
        if self._segment is not None or now_s < self._wait_until_s:
            return self._segment
        if not self._is_room():
            return None
        if self._folder is None:
            self._folder, self._files, self._log = self._directory.new_drive(), 0, BeatLog()
            self._directory.open_drive = self._folder.name
            log.info("recording %s", self._folder.name)
        path = self._folder / f"{self._files:03d}.mcap"
        self._files += 1  # also where this fails: it may have left something of that name
        self._segment = Segment(path, self._facts)
        self._began_s = now_s
        if self._problem:
            self._problem = ""
            log.info("drives are recorded again")
        return self._segment

    def _is_room(self) -> bool:
        self._room_s = self._monotonic_s() + LOOK_FOR_ROOM_S
        problem = self._directory.make_room()
        if problem:
            self._stop_recording(problem)
        return not problem

    def _until_sync_s(self) -> float | None:
        """How long to wait for the next beat; None: there is nothing to sync."""
        if self._unsynced_s is None:
            return None
        return max(0.0, self._unsynced_s + SYNC_AFTER_S - self._monotonic_s())

    def _sync_if_due(self) -> None:
        if self._segment is None or self._until_sync_s() != 0.0:
            return
        self._segment.sync()
        self._unsynced_s = None
        if self._monotonic_s() > self._room_s and not self._is_room():
            self._close_segment()

    def _close_segment(self) -> None:
        segment, self._segment, self._unsynced_s = self._segment, None, None
        if segment is not None:
            segment.close()

    def _end_drive(self) -> None:
        self._folder, self._directory.open_drive = None, ""
        self._close_segment()

    def _give_up(self, error: Exception) -> None:
        """Leave the file as it is, and begin another one after a while."""
        segment, self._segment, self._unsynced_s = self._segment, None, None
        if segment is not None:
            self._lost += 1
            segment.abandon()
        if isinstance(error, OSError):
            self._stop_recording(f"{error.strerror or error}")
        else:
            self._stop_recording(f"{type(error).__name__}: {error}"[:200])
        with contextlib.suppress(OSError):
            if self._folder is not None and not self._folder.is_dir():
                self._folder, self._directory.open_drive = None, ""

    def _stop_recording(self, problem: str) -> None:
        self._wait_until_s = self._monotonic_s() + TRY_AGAIN_S
        if problem != self._problem:
            self._problem = problem
            log.warning("drives are not recorded: %s", problem)


def replayable(record: DriveRecord, tick: Tick) -> DriveRecord:
    """A beat's numbers with what a replay needs besides."""
    memory, view, unset = tick.memory, tick.view, msgspec.UNSET
    told = memory.previous_action if memory is not None else (0.0, 0.0)
    state = memory.state.astype(np.dtype("<f4")).tobytes() if memory is not None else b""
    return msgspec.structs.replace(
        record,
        armed=tick.orders.is_armed,
        began_anew=tick.action is not None and memory is None,
        told_left=told[0],
        told_right=told[1],
        memory=state,
        view_horizontal_deg=view.horizontal_deg if view is not None else unset,
        view_vertical_deg=view.vertical_deg if view is not None else unset,
    )

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
from dataclasses import replace
from pathlib import Path
from typing import Self

import cv2

from mbot_agent.faults import Notice
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.drive.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision

log = logging.getLogger(__name__)

BACKLOG = 128
"""Beats waiting for the card, at 13 kB each: 1.7 MB, and 51 s at 2.5 Hz. Cards pause for
seconds."""

PNG_EFFORT = 1
"""Of 0 to 9. Lossless either way; 9 saves a tenth and takes three times as long."""

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
        to_beat: Callable[[Tick], Beat],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare; `to_beat` is called on this thread, for each beat of a drive."""
        self._directory = directory
        self._facts = facts
        self._to_beat = to_beat
        self._monotonic_s = monotonic_s
        self._backlog: queue.Queue[Tick | None] = queue.Queue(BACKLOG)
        self._refused = 0  # counted by who offers
        self._lost = 0  # counted by this thread
        self._segment: BeatWriter | None = None
        self._folder: Path | None = None
        self._files = 0
        self._before: Decision | None = None
        self._began_s = self._room_s = 0.0
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
        beat = self._to_beat(tick)
        beat.decision.dropped_records = self._refused + self._lost
        if tick.observation is not None:
            beat = replace(beat, encoded=_lossless(tick.observation), is_exact=True)
        segment.write(beat)
        self._before = beat.decision

    def _open_segment(self) -> BeatWriter | None:
        """The file to write to; None while there can be none."""
        now_s = self._monotonic_s()
        if self._segment is not None and now_s - self._began_s > SEGMENT_S:
            self._close_segment()
        if self._segment is not None or now_s < self._wait_until_s:
            return self._segment
        if not self._is_room():
            return None
        if self._folder is None:
            self._folder, self._files, self._before = self._directory.new_drive(), 0, None
            self._directory.open_drive = self._folder.name
            log.info("recording %s", self._folder.name)
        path = self._folder / f"{self._files:03d}.mcap"
        self._files += 1  # also where this fails: it may have left something of that name
        library = f"mbot-agent {self._facts.software_version}"
        self._segment = BeatWriter(
            path,
            self._facts.robot_id,
            library,
            self._facts,
            before=self._before,
            monotonic_s=self._monotonic_s,
        )
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
        return self._segment.due_in_s if self._segment is not None else None

    def _sync_if_due(self) -> None:
        if self._segment is None or self._until_sync_s() != 0.0:
            return
        self._segment.sync()
        if self._monotonic_s() > self._room_s and not self._is_room():
            self._close_segment()

    def _close_segment(self) -> None:
        segment, self._segment = self._segment, None
        if segment is not None:
            segment.close()

    def _end_drive(self) -> None:
        self._folder, self._directory.open_drive = None, ""
        self._close_segment()

    def _give_up(self, error: Exception) -> None:
        """Leave the file as it is, and begin another one after a while."""
        segment, self._segment = self._segment, None
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


def _lossless(observation: Picture) -> bytes:
    """What the policy saw, shape (64, 64, 3), uint8, RGB, as a PNG."""
    bgr = cv2.cvtColor(observation, cv2.COLOR_RGB2BGR)
    _, png = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, PNG_EFFORT])
    return png.tobytes()

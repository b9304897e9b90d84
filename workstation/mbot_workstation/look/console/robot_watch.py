"""What the console knows of its robot: two threads that listen and ask, one view for all pages."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.stream import TelemetryStream
from mbot_workstation.fleet.telemetry.window import TelemetryWindow
from mbot_workstation.look.console.page_state import page_state

ASK_EVERY_S = 0.25
ANSWER_WITHIN_S = 1.0
_POLL_S = 0.05
_PAUSE_S = 1.0


@dataclass(frozen=True, slots=True)
class WatchedRobot:
    """What a page is to show.

    Attributes:
        version: grows with each change.
        state: as `page_state` makes it.
        policy_jpeg, camera_jpeg: the newest pictures; empty before there are any.

    """

    version: int
    state: dict[str, object]
    policy_jpeg: bytes
    camera_jpeg: bytes


class RobotWatch:
    """The threads. A context manager around an open link."""

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self._lock = threading.Lock()
        self._version = 0
        self._status: Status | None = None
        self._answered_s = 0.0
        self._problem = "not asked yet"
        self._window = TelemetryWindow()
        self._ask_now = threading.Event()
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._again_and_again, args=(work,), name=name, daemon=True)
            for name, work in (("ask robot", self._ask), ("hear robot", self._hear))
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._ask_now.set()
        for thread in self._threads:
            thread.join(timeout=4.0)

    def look_now(self) -> None:
        """Ask the robot at once: something has just been done to it."""
        self._ask_now.set()

    def view(self) -> WatchedRobot:
        """What there is to show now."""
        with self._lock:
            window = self._window
            state = page_state(
                self._link.robot_id,
                self._status,
                window,
                silence_s=time.monotonic() - self._answered_s,
                problem=self._problem,
            )
            return WatchedRobot(
                self._version,
                state,
                window.picture.data if window.picture is not None else b"",
                window.camera.data if window.camera is not None else b"",
            )

    @property
    def version(self) -> int:
        """As in `WatchedRobot`."""
        return self._version

    def _again_and_again(self, work: Callable[[], None]) -> None:
        while not self._closing.is_set():
            try:
                work()
            except MbotError as error:
                self._note(str(error))
                self._closing.wait(_PAUSE_S)

    def _ask(self) -> None:
        """Ask for the state four times a second, and whenever somebody wants to know."""
        while not self._closing.is_set():
            status = self._link.status(ANSWER_WITHIN_S)
            with self._lock:
                self._status, self._answered_s, self._problem = status, time.monotonic(), ""
                self._version += 1
            self._ask_now.wait(ASK_EVERY_S)
            self._ask_now.clear()

    def _hear(self) -> None:
        """Take in telemetry."""
        with TelemetryStream(self._link, camera=True) as stream:
            while not self._closing.is_set():
                samples = stream.poll(_POLL_S)
                with self._lock:
                    for sample in samples:
                        self._window.add(sample)
                        self._version += 1

    def _note(self, problem: str) -> None:
        with self._lock:
            self._problem = problem
            self._version += 1

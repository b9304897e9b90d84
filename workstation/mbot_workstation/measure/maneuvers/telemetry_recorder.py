"""Records telemetry beside the drive, in a thread: the disk must not delay a command."""

import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.stream import TelemetryStream
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile

_POLL_S = 0.1


class TelemetryRecorder:
    """Everything the robot publishes, into a new MCAP file; a context manager.

    Attributes:
        failure: why recording ended early, if it did; driving goes on.

    """

    def __init__(self, link: RobotLink, path: Path) -> None:
        self.failure: str | None = None
        self._link = link
        self._path = path
        self._ending = threading.Event()
        self._stack = ExitStack()
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)

    def __enter__(self) -> Self:
        """Open file and subscription.

        Raises:
            ConfigurationError: the file can't be written.

        """
        with ExitStack() as stack:
            self._recording = stack.enter_context(TelemetryFile(self._path, self._link.robot_id))
            self._stream = stack.enter_context(TelemetryStream(self._link))
            self._stack = stack.pop_all()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        try:
            self._stack.close()
        except MbotError as failure:
            self.failure = self.failure or str(failure)

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                for sample in self._stream.poll(_POLL_S):
                    self._recording.write(sample.message)
                self._recording.save_if_due()
        except MbotError as error:
            self.failure = str(error)

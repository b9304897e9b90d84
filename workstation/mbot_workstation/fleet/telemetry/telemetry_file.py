"""Telemetry in an MCAP file, which Foxglove, Lichtblick and Rerun open as it is."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.writer import CompressionType

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision

SAVE_AFTER_S = 0.5
"""At most this much is lost to a power cut, plus the time to the next write: below 1 s."""


class TelemetryFile:
    """A recording as a robot's own, of what it tells; a context manager, which ends it properly."""

    def __init__(
        self,
        path: Path,
        robot_id: str,
        monotonic_s: Callable[[], float] = time.monotonic,
        facts: RobotFacts | None = None,
    ) -> None:
        """Create the file.

        Args:
            path: of a new file.
            robot_id: whose telemetry.
            monotonic_s: the time, for the next save.
            facts: what a replay needs to know of the robot; telemetry does not tell.

        Raises:
            ConfigurationError: it exists already, or can't be written.

        """
        self._path = path
        try:
            self._writer = BeatWriter(
                path,
                robot_id,
                "mbot-workstation",
                facts,
                compression=CompressionType.ZSTD,
                sync_after_s=SAVE_AFTER_S,
                monotonic_s=monotonic_s,
            )
        except FileExistsError:
            raise ConfigurationError(f"{path} exists already; choose another name") from None
        except OSError as error:
            raise ConfigurationError(f"can't write {path}: {error.strerror}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._disk_errors():
            self._writer.close()

    def write(self, message: Decision | CompressedImage | Beat) -> None:
        """Add one message, or a beat with all that is known of it, and save what is due.

        Raises:
            ConfigurationError: the disk is full or gone.

        """
        with self._disk_errors():
            if isinstance(message, CompressedImage):
                stamp_ns = message.timestamp.ToNanoseconds()
                self._writer.write_picture(message.data, message.format, stamp_ns)
            else:
                self._writer.write(Beat(message) if isinstance(message, Decision) else message)
        self.save_if_due()

    def save_if_due(self) -> None:
        """Save to disk what came in since the last time, at most every 0.5 s.

        To be called also while nothing arrives. Raises as `write`.
        """
        if self._writer.due_in_s == 0.0:
            with self._disk_errors():
                self._writer.sync()

    @contextmanager
    def _disk_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ConfigurationError(
                f"can't write {self._path}: {error.strerror}; what was saved can be read"
            ) from None

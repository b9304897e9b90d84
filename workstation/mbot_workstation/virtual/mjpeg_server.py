"""A camera over the network: Motion JPEG over HTTP on this machine's loopback.

The paper's robot had its camera this way. OpenCV, browsers and VLC open it. Whoever is too slow
gets the newest picture next, never an old one.
"""

import contextlib
import socket
import threading
from collections.abc import Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

from mbot_protocol.errors import ConfigurationError

HOST = "127.0.0.1"
STREAM_PATH, SNAPSHOT_PATH = "/stream.mjpg", "/snapshot.jpg"
BOUNDARY = "picture"

FIRST_PICTURE_TIMEOUT_S = 5.0
"""How long a snapshot waits for a camera that is only starting."""

SEND_BUFFER_BYTES = 65_536
"""A few pictures: what lies in a large buffer is old by the time a slow client gets it."""

STUCK_CLIENT_S = 5.0
"""A client that takes nothing for so long is let go."""


class NewestPicture:
    """The one picture that counts; every waiting reader sees each newer one at most once."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._jpeg = b""
        self._number = 0
        self._closed = False

    def put(self, jpeg: bytes) -> None:
        """Replace the picture and wake the readers."""
        with self._condition:
            self._jpeg = jpeg
            self._number += 1
            self._condition.notify_all()

    def close(self) -> None:
        """Let every reader end."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()

    def wait(self, seen: int, timeout_s: float | None = None) -> tuple[int, bytes] | None:
        """The newest picture and its number as soon as it is newer than `seen`; None at the end."""
        with self._condition:
            self._condition.wait_for(lambda: self._closed or self._number > seen, timeout_s)
            return None if self._closed or self._number <= seen else (self._number, self._jpeg)

    def follow(self) -> Iterator[bytes]:
        """Every picture that comes while the last one is not being dealt with."""
        seen = 0
        while (found := self.wait(seen)) is not None:
            seen, jpeg = found
            yield jpeg


class MjpegServer:
    """Serves pictures to any number of clients; use it in a `with`.

    Attributes:
        port: the TCP port; a free one was chosen if 0 was asked for.

    """

    def __init__(self, port: int = 0) -> None:
        """Listen on loopback.

        Raises:
            ConfigurationError: the port is taken.

        """
        self._newest = NewestPicture()
        try:
            self._server = _Server((HOST, port), _Handler, self._newest)
        except OSError as error:
            raise ConfigurationError(
                f"can't serve the camera on port {port}: {error.strerror}; choose another one "
                "with --camera-port, 0 for any free one"
            ) from None
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.1,), name="mjpeg-server", daemon=True
        )

    @property
    def url(self) -> str:
        """Where the stream is."""
        return f"http://{HOST}:{self.port}{STREAM_PATH}"

    def publish(self, jpeg: bytes) -> None:
        """Show a new picture to everybody."""
        self._newest.put(jpeg)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._newest.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True  # a client that hangs must not keep the program alive
    block_on_close = False

    def __init__(
        self,
        address: tuple[str, int],
        handler: type[BaseHTTPRequestHandler],
        newest: NewestPicture,
    ) -> None:
        self.newest = newest
        super().__init__(address, handler)

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that went away is nothing to report."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server  # pyright: ignore[reportIncompatibleVariableOverride]
    timeout = STUCK_CLIENT_S

    def do_GET(self) -> None:
        """Answer with the stream or one picture."""
        # A picture must not wait for the acknowledgement of the one before.
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        with contextlib.suppress(ConnectionError, TimeoutError):
            if self.path in {"/", STREAM_PATH}:
                self._stream()
            elif self.path == SNAPSHOT_PATH:
                self._snapshot()
            else:
                self.send_error(HTTPStatus.NOT_FOUND, f"there is {STREAM_PATH} and {SNAPSHOT_PATH}")

    def _stream(self) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        for jpeg in self.server.newest.follow():
            head = (
                f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            )
            self.wfile.write(head.encode() + jpeg + b"\r\n")

    def _snapshot(self) -> None:
        found = self.server.newest.wait(0, FIRST_PICTURE_TIMEOUT_S)
        if found is None:
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, "the camera has no picture yet")
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "image/jpeg")
        self.send_header("Content-Length", str(len(found[1])))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(found[1])

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing: the program prints its own lines."""

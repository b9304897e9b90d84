"""A network camera that sends JPEGs over HTTP, read here so that each picture's shape is known.

OpenCV's ffmpeg scales all pictures of a stream to the first one's shape; a stretched picture would
be driven on.
"""

import base64
import http.client
import io
import socket
import time
from typing import Self, cast
from urllib.parse import SplitResult, unquote, urlsplit

from mbot_agent.camera.jpeg_picture import JpegError, check_jpeg, decode_jpeg
from mbot_agent.camera.multipart import MultipartError, MultipartParser, Part
from mbot_agent.camera.source_contract import OPEN_TIMEOUT_S, READ_TIMEOUT_S, CameraError, Shot
from mbot_agent.configuration import shown_source

RECEIVE_BYTES = 64 << 10


class MjpegSource:
    """A stream of JPEGs. A frame's capture time is when it began to arrive.

    If several have come since the last `read`, the newest is taken. One that is damaged is left
    out: the frame before it turns stale soon enough.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._shown = shown_source(url)
        self._connection: _Connection | None = None

    def __enter__(self) -> Self:
        """Open it.

        Raises:
            CameraError: nobody answers, or with something else: a redirection, a password
                prompt, a film.

        """
        self._connection = _Connection(self._url)
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def hold_light(self, held: bool) -> bool:
        """See FrameSource: nobody can tell this one."""
        return False

    def read(self) -> Shot:
        """See FrameSource."""
        if self._connection is None:
            raise CameraError("the camera is not open")
        deadline_s = time.monotonic() + READ_TIMEOUT_S
        problem = "has stopped delivering frames"
        while True:
            try:
                part = self._connection.receive(deadline_s)
            except TimeoutError:
                raise CameraError(f"the camera {self._shown!r} {problem}") from None
            except MultipartError as error:
                raise CameraError(f"the camera {self._shown!r} {error}") from None
            except (OSError, http.client.HTTPException):
                raise CameraError(f"the camera {self._shown!r} has broken the connection") from None
            if part is not None:
                try:
                    return _shot(part)
                except JpegError as error:
                    problem = f"sends no usable picture: {error}"


def _shot(part: Part) -> Shot:
    width_px, height_px = check_jpeg(part.data)
    return Shot((height_px, width_px, 3), part.began_ns, lambda: decode_jpeg(part.data))


class _Connection:
    """An HTTP response that goes on for ever, read up to a deadline each time."""

    def __init__(self, url: str) -> None:
        deadline_s = time.monotonic() + OPEN_TIMEOUT_S
        try:
            parts = urlsplit(url)
            address = (parts.hostname or "", parts.port or http.client.HTTP_PORT)
            self._socket = socket.create_connection(address, OPEN_TIMEOUT_S)
        except (OSError, ValueError) as error:
            raise CameraError(
                f"cannot open the camera {shown_source(url)!r}: {error}; is it running? "
                "(camera.source)"
            ) from None
        try:
            self._bytes = _DeadlineReader(self._socket, deadline_s)
            self._socket.sendall(_request(parts))
            self._response = http.client.HTTPResponse(cast(socket.socket, self._bytes))
            self._response.begin()
            self._parser = _parser(self._response)
        except CameraError:
            self.close()
            raise
        except (OSError, ValueError, http.client.HTTPException) as error:
            self.close()
            # Other errors may quote what came, whatever that is.
            known = isinstance(error, OSError | MultipartError)
            reason = error if known else "what answers there does not speak HTTP"
            raise CameraError(
                f"cannot open the camera {shown_source(url)!r}: {reason} (camera.source)"
            ) from None

    def close(self) -> None:
        self._socket.close()

    def receive(self, deadline_s: float) -> Part | None:
        """The newest part that some more bytes have completed, if any.

        Raises:
            TimeoutError: nothing came until then.
            OSError, HTTPException, MultipartError: the stream has ended or is none.

        """
        self._bytes.deadline_s = deadline_s
        data = self._response.read1(RECEIVE_BYTES)
        if not data:
            raise MultipartError("has ended its stream")
        parts = self._parser.feed(data, time.monotonic_ns())
        return parts[-1] if parts else None


class _DeadlineReader(io.RawIOBase):
    """A socket's bytes until a deadline, however slowly they trickle in."""

    def __init__(self, connected: socket.socket, deadline_s: float) -> None:
        self._socket = connected
        self.deadline_s = deadline_s

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        left_s = self.deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError("timed out")  # as the socket itself says it
        self._socket.settimeout(left_s)
        return self._socket.recv_into(buffer)

    def makefile(self, _mode: str) -> io.BufferedReader:
        """What HTTPResponse asks a socket for."""
        return io.BufferedReader(self, RECEIVE_BYTES)


def _request(url: SplitResult) -> bytes:
    path = (url.path or "/") + (f"?{url.query}" if url.query else "")
    host = url.netloc.rpartition("@")[2]
    lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Accept: */*", "Connection: close"]
    if url.username is not None:
        login = f"{unquote(url.username)}:{unquote(url.password or '')}"
        lines.append(f"Authorization: Basic {base64.b64encode(login.encode()).decode()}")
    return "\r\n".join([*lines, "", ""]).encode()


def _parser(response: http.client.HTTPResponse) -> MultipartParser:
    kind = response.msg.get_content_maintype()
    boundary = response.msg.get_boundary()
    if response.status != http.HTTPStatus.OK or kind != "multipart" or boundary is None:
        raise CameraError(
            f"what answers at the camera's address sends no stream of JPEGs (status "
            f'{response.status}); for a film or H.264 set camera.source = "ffmpeg:http://..."'
        )
    return MultipartParser(boundary)

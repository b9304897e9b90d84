"""A network camera that sends JPEGs over HTTP, read here so that each picture's shape is known.

OpenCV's ffmpeg scales all pictures of a stream to the first one's shape; a stretched picture would
be driven on.
"""

import base64
import http.client
import io
import re
import socket
import time
from email.message import Message
from typing import Self, cast
from urllib.parse import SplitResult, unquote, urlsplit

from mbot_agent.camera.jpeg_picture import read_jpeg
from mbot_agent.camera.multipart import MultipartError, MultipartParser, Part
from mbot_agent.camera.source_contract import (
    OPEN_TIMEOUT_S,
    READ_TIMEOUT_S,
    CameraError,
    JpegError,
    Shot,
)
from mbot_agent.configuration import shown_source

RECEIVE_BYTES = 64 << 10

_HEAD_LINE = re.compile(rb"HTTP/|[!-9;-~]+:|[ \t\r\n]")
"""The first one, one with a name, a continued one, the empty one."""


class MjpegSource:
    """A stream of JPEGs. A frame's capture time is when it began to arrive.

    If several have come since the last `read`, the newest is taken. One that is damaged is left
    out: the frame before it turns stale soon enough.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._shown = shown_source(url)
        self._connection: _Connection | None = None
        self._has_delivered = False

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
        problem = ""
        while True:
            try:
                part = self._connection.receive(deadline_s)
            except TimeoutError:
                problem = problem or self._silence(self._connection)
                raise CameraError(f"the camera {self._shown!r} {problem}") from None
            except MultipartError as error:
                raise CameraError(f"the camera {self._shown!r} {error}") from None
            except (OSError, http.client.HTTPException):
                raise CameraError(f"the camera {self._shown!r} has broken the connection") from None
            if part is not None:
                try:
                    shot = _shot(part)
                except JpegError as error:
                    problem = f"sends no usable picture: {error}"
                else:
                    self._has_delivered = True
                    return shot

    def _silence(self, connection: "_Connection") -> str:
        if self._has_delivered:
            return "has stopped delivering frames"
        if not connection.has_received:
            return "answers, and then sends nothing"
        return (
            f"sends no whole picture in {READ_TIMEOUT_S:g} s: is the link too slow, or are its "
            f"pictures parted otherwise than by the {connection.boundary[:80]!r} that it names?"
        )


def _shot(part: Part) -> Shot:
    jpeg = read_jpeg(part.data)
    return Shot((jpeg.height_px, jpeg.width_px, 3), part.began_ns, jpeg.picture)


class _Connection:
    """An HTTP response that goes on for ever, read up to a deadline each time.

    Attributes:
        boundary: between pictures, as the camera names it.
        has_received: whether anything came after the headers.

    """

    def __init__(self, url: str) -> None:
        deadline_s = time.monotonic() + OPEN_TIMEOUT_S
        try:
            parts = urlsplit(url)
            address = (parts.hostname or "", parts.port or http.client.HTTP_PORT)
            self._socket = socket.create_connection(address, OPEN_TIMEOUT_S)
        except OSError as error:
            raise CameraError(
                f"cannot open the camera {shown_source(url)!r}: {error}; is it running? "
                "(camera.source)"
            ) from None
        except ValueError:  # it quotes what may be a password
            raise CameraError(
                f"cannot open the camera {shown_source(url)!r}: its address is not understood; a "
                "password's own / ? # @ : % are written %2F %3F %23 %40 %3A %25 (camera.source)"
            ) from None
        try:
            self._bytes = _DeadlineReader(self._socket, deadline_s)
            self._socket.sendall(_request(parts))
            answer = _Answer(self._bytes, RECEIVE_BYTES)
            self._response = http.client.HTTPResponse(cast(socket.socket, answer))
            self._response.begin()
            answer.is_in_head = False
            self.boundary = _boundary(self._response, has_login=parts.username is not None)
            self._parser = MultipartParser(self.boundary)
            self.has_received = False
            # Some cameras put the first part's headers among the stream's own.
            self._response.length = None
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
        self.has_received = True
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


class _Answer(io.BufferedReader):
    """What a camera answers, without lines of the head that have no name, as some send them:
    Python's parser would take those for the head's end.
    """

    is_in_head = True

    def readline(self, size: int | None = -1, /) -> bytes:
        line = super().readline(size)
        while self.is_in_head and line.endswith(b"\n") and not _HEAD_LINE.match(line):
            line = super().readline(size)
        return line

    def makefile(self, _mode: str) -> Self:
        """What HTTPResponse asks a socket for."""
        return self


def _request(url: SplitResult) -> bytes:
    path = (url.path or "/") + (f"?{url.query}" if url.query else "")
    host = url.netloc.rpartition("@")[2]
    lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Accept: */*", "Connection: close"]
    if url.username is not None:
        login = f"{unquote(url.username)}:{unquote(url.password or '')}"
        lines.append(f"Authorization: Basic {base64.b64encode(login.encode()).decode()}")
    return "\r\n".join([*lines, "", ""]).encode()


def _boundary(response: http.client.HTTPResponse, *, has_login: bool) -> str:
    """What stands between the pictures of a stream.

    Raises:
        CameraError: it is none, or it is not for us.

    """
    for value in response.msg.get_all("content-type", []):
        header = Message()
        header["content-type"] = value
        boundary = header.get_boundary()
        is_stream = response.status == http.HTTPStatus.OK
        if is_stream and header.get_content_maintype() == "multipart" and boundary is not None:
            return boundary
    raise CameraError(
        f"what answers at the camera's address, with status {response.status}, "
        f"{_refusal(response, has_login=has_login)}"
    )


def _refusal(response: http.client.HTTPResponse, *, has_login: bool) -> str:
    if response.status == http.HTTPStatus.UNAUTHORIZED:
        scheme = re.match("[A-Za-z]{1,20}", response.headers.get("www-authenticate", "Basic"))
        if scheme is not None and scheme[0].lower() != "basic":
            return (
                f"wants a password by {scheme[0]}: let the camera take Basic, or set "
                'camera.source = "ffmpeg:http://NAME:PASSWORD@..."'
            )
        wrong = "takes another name or password" if has_login else "wants a name and a password"
        return f'{wrong}: camera.source = "http://NAME:PASSWORD@..."'
    if response.status in range(300, 400):
        return "sends us to another one, which is not followed: name that in camera.source"
    if response.status != http.HTTPStatus.OK:
        return "has no stream there: is the path right?"
    return 'sends no stream of JPEGs; for a film or H.264 set camera.source = "ffmpeg:http://..."'

"""Network cameras, good and bad ones, on a real socket."""

import base64
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_agent.camera import mjpeg_source
from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.frame_sources import frame_source
from mbot_agent.camera.mjpeg_source import MjpegSource
from mbot_agent.camera.source_contract import CameraError, Shot
from mbot_agent.configuration import CameraSettings, decode
from mbot_protocol.errors import ConfigurationError

GREETING = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"

Serve = Callable[[socket.socket, bytes], None]
"""Answers one request on its connection."""


@contextmanager
def server(serve: Serve) -> Iterator[str]:
    """The address of something that answers each request so."""

    def run() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection:
                try:
                    serve(connection, connection.recv(4096))
                except OSError:
                    continue  # the reader has gone

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=run, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}/stream.mjpg"
        finally:
            listener.shutdown(socket.SHUT_RDWR)


def jpeg(level: int, width_px: int = 64, height_px: int = 48) -> bytes:
    picture = np.full((height_px, width_px, 3), level, np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def level(shot: Shot) -> int:
    """What `jpeg` was given, to the nearest ten."""
    return round(shot.picture().mean() / 10) * 10


def part(data: bytes) -> bytes:
    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
    return head.encode() + data + b"\r\n"


def sends(*pieces: bytes, pause_s: float = 0.02, greeting: bytes = GREETING) -> Serve:
    """The greeting and these, with a pause after each; then silence."""

    def serve(connection: socket.socket, _: bytes) -> None:
        connection.sendall(greeting)
        for piece in pieces:
            connection.sendall(piece)
            time.sleep(pause_s)
        connection.settimeout(5)
        connection.recv(1)  # until the reader goes

    return serve


def ends_after(*pieces: bytes) -> Serve:
    def serve(connection: socket.socket, _: bytes) -> None:
        connection.sendall(b"".join(pieces))

    return serve


def test_each_picture_has_its_own_shape_and_the_time_it_came() -> None:
    with (
        server(sends(part(jpeg(50)), part(jpeg(90, 32, 48)), part(jpeg(130)))) as url,
        MjpegSource(url) as source,
    ):
        began_ns = time.monotonic_ns()
        read = [source.read() for _ in range(3)]
    assert [shot.shape for shot in read] == [(48, 64, 3), (48, 32, 3), (48, 64, 3)]
    assert not any(shot.is_decoded for shot in read)
    assert [shot.picture().shape for shot in read] == [shot.shape for shot in read]
    assert [level(shot) for shot in read] == [50, 90, 130]
    captured = [shot.captured_ns for shot in read]
    assert captured == sorted(captured)
    assert began_ns - 1e9 < captured[0] <= captured[-1] <= time.monotonic_ns()


def with_line(line: bytes) -> bytes:
    """The greeting with one more line in front of the others."""
    status, newline, rest = GREETING.partition(b"\r\n")
    return status + newline + line + newline + rest


def uncounted(data: bytes) -> bytes:
    return b"--frame\r\nContent-Type: image/jpeg\r\n\r\n" + data + b"\r\n"


ODD: dict[str, tuple[bytes, Callable[[bytes], bytes]]] = {
    "a header line without a name": (with_line(b"Tue, 12 Jun 2012 01:56:34 GMT"), part),
    "the first part's length in the head": (with_line(b"Content-Length: 700"), part),
    "the first part's type in the head": (with_line(b"Content-Type: image/jpeg"), part),
    "bytes behind a picture": (GREETING, lambda data: part(data + b"dhav\x59\x19\1\0")),
    "uncounted bytes behind a picture": (GREETING, lambda data: uncounted(data + b"dhav\x59\x19")),
    "a length that is 300 too long": (GREETING, lambda data: part(data + b"\xaa" * 300)),
    "headers on the boundary's line": (
        GREETING,
        lambda data: part(data).replace(b"--frame\r\n", b"--frame"),
    ),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_streams_of_real_cameras_are_read(name: str) -> None:
    greeting, parted = ODD[name]
    pieces = [parted(jpeg(level)) for level in (50, 90, 130, 170)]
    with server(sends(*pieces, greeting=greeting)) as url, MjpegSource(url) as source:
        assert [level(source.read()) for _ in range(3)] == [50, 90, 130]


def test_half_a_picture_with_an_older_ones_end_is_damaged_and_not_decided_on() -> None:
    good, older = (
        cv2.imencode(".jpg", np.random.default_rng(seed).integers(0, 256, (48, 64, 3), np.uint8))[1]
        for seed in (1, 2)
    )
    mixed = good.tobytes()[: len(good) // 2] + older.tobytes()[-300:]
    with (
        server(sends(*[part(mixed)] * 200)) as url,
        CaptureThread(CameraSettings(source=url)) as capture,
    ):
        deadline_s = time.monotonic() + 5
        while (fault := capture.fault) is None or fault.kind == "camera-starting":
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        assert (fault.kind, capture.latest()) == ("camera-damaged", None)
        assert "cut off" in fault.detail


def test_a_camera_that_never_sends_a_byte_has_not_stopped() -> None:
    with (
        server(sends()) as url,
        MjpegSource(url) as source,
        pytest.raises(CameraError, match="answers, and then sends nothing"),
    ):
        source.read()


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b'401 No\r\nWWW-Authenticate: Digest realm="x"', r"password by Digest.*\"ffmpeg:http"),
        (b'401 No\r\nWWW-Authenticate: Basic realm="x"', "wants a name and a password"),
        (b"404 Not Found", "is the path right"),
        (b"302 Found\r\nLocation: http://10.0.0.5/", "another one, which is not followed"),
    ],
    ids=["digest", "basic", "path", "moved"],
)
def test_why_there_is_no_stream_is_told(head: bytes, words: str) -> None:
    answer = b"HTTP/1.1 " + head + b"\r\nContent-Length: 0\r\n\r\n"
    with server(ends_after(answer)) as url, pytest.raises(CameraError, match=words):
        MjpegSource(url).__enter__()


def test_of_several_waiting_pictures_the_newest_is_taken() -> None:
    pictures = [part(jpeg(level)) for level in (50, 90, 130)]
    with server(sends(b"".join(pictures))) as url, MjpegSource(url) as source:
        assert level(source.read()) == 130


def test_a_damaged_picture_is_left_out() -> None:
    cut = jpeg(50)[:-30]
    with (
        server(sends(part(cut), part(b"text"), part(b""), part(jpeg(90)))) as url,
        MjpegSource(url) as source,
    ):
        assert level(source.read()) == 90


def test_nothing_but_damaged_pictures_is_named() -> None:
    cut = part(jpeg(50)[:-30])
    with (
        server(sends(*[cut] * 100)) as url,
        MjpegSource(url) as source,
        pytest.raises(CameraError, match="no usable picture: it is cut off"),
    ):
        source.read()


def test_chunked_answers_are_read_too() -> None:
    """As small cameras send them, a picture in pieces of their own."""
    body = part(jpeg(90)) + b"--frame\r\n"
    pieces = [body[at : at + 100] for at in range(0, len(body), 100)]
    chunks = b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces)
    greeting = GREETING.replace(b"1.0", b"1.1").removesuffix(b"\r\n")
    greeting += b"Transfer-Encoding: chunked\r\n\r\n"
    with server(ends_after(greeting + chunks)) as url, MjpegSource(url) as source:
        assert source.read().picture().shape == (48, 64, 3)
        with pytest.raises(CameraError, match=r"ended its stream|broken the connection"):
            source.read()


@pytest.mark.parametrize(
    ("serve", "words"),
    [
        (sends(part(jpeg(90))), "stopped delivering frames"),
        (ends_after(GREETING, part(jpeg(90))), "ended its stream"),
        (ends_after(GREETING, part(jpeg(90)), part(jpeg(90))[:200]), "ended its stream"),
        (sends(part(jpeg(90)), b"--frame--\r\n"), "ended its stream"),
        (sends(part(jpeg(90)), b"--frame\r\nContent-Length: 99999999\r\n\r\n"), "99999999 bytes"),
        (
            sends(part(jpeg(90)), b"--frame\r\n\r\n", *[bytes(1 << 20)] * 6),
            "without a picture's end",
        ),
    ],
    ids=["silence", "end", "end in a picture", "announced end", "giant", "endless"],
)
def test_whatever_ends_a_stream_is_told_in_time(serve: Serve, words: str) -> None:
    with server(serve) as url, MjpegSource(url) as source:
        source.read()
        began_s = time.monotonic()
        with pytest.raises(CameraError, match=words):
            source.read()
        assert time.monotonic() - began_s < 2.0


def test_a_trickle_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each byte comes before a time-out that began with the last one would have passed."""
    monkeypatch.setattr(mjpeg_source, "READ_TIMEOUT_S", 0.4)
    monkeypatch.setattr(mjpeg_source, "OPEN_TIMEOUT_S", 0.4)
    with (
        server(sends(*[b"x"] * 200)) as url,
        MjpegSource(url) as source,
        pytest.raises(CameraError, match=r"no whole picture.* 'frame' that it names"),
    ):
        source.read()

    def slow_greeting(connection: socket.socket, _: bytes) -> None:
        for byte in GREETING:
            connection.sendall(bytes([byte]))
            time.sleep(0.02)

    with server(slow_greeting) as url:
        began_s = time.monotonic()
        with pytest.raises(CameraError, match="timed out"):
            MjpegSource(url).__enter__()
        assert time.monotonic() - began_s < 2.0


@pytest.mark.parametrize(
    ("answer", "words"),
    [(b"", "closed connection"), (b"hello\r\n\r\n", "speak HTTP"), (b"\xff" * 99999, "speak HTTP")],
    ids=["nothing", "no HTTP", "endless line"],
)
def test_an_answer_that_is_no_http_is_told_in_one_line(answer: bytes, words: str) -> None:
    with server(ends_after(answer)) as url, pytest.raises(CameraError) as caught:
        MjpegSource(url).__enter__()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["http://127.0.0.1:1/x", "http://127.0.0.1:99999/", "http:///x"])
def test_nobody_there_is_told_in_one_line(url: str) -> None:
    with pytest.raises(CameraError, match="cannot open the camera"):
        frame_source(CameraSettings(source=url)).__enter__()


def test_name_and_password_of_the_address_are_shown() -> None:
    heard: list[bytes] = []

    def serve(connection: socket.socket, request: bytes) -> None:
        heard.append(request)
        sends(part(jpeg(90)))(connection, request)

    with server(serve) as url:
        address = url.replace("127", "anna:pass%20word@127") + "?fps=30"
        with frame_source(CameraSettings(source=address)) as source:
            source.read()
    lines = heard[0].split(b"\r\n")
    assert lines[0] == b"GET /stream.mjpg?fps=30 HTTP/1.1"
    assert b"Authorization: Basic " + base64.b64encode(b"anna:pass word") in lines
    assert not any(b"@" in line for line in lines)


def test_what_is_no_stream_of_jpegs_is_opened_by_ffmpeg_only_if_told_so(tmp_path: Path) -> None:
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
    for level in range(0, 250, 10):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    film = clip.read_bytes()
    greeting = b"HTTP/1.0 200 OK\r\nContent-Type: video/x-msvideo\r\nContent-Length: %d\r\n\r\n"
    with server(ends_after(greeting % len(film), film)) as url:
        with pytest.raises(CameraError, match=r'status 200.*set camera.source = "ffmpeg:'):
            frame_source(CameraSettings(source=url)).__enter__()
        with frame_source(CameraSettings(source=f"ffmpeg:{url}")) as source:
            assert source.read().picture().shape == (48, 64, 3)


def ffmpeg_can_stay() -> bool:
    """Whether OpenCV's FFmpeg can be told to; deploy/config.toml says that Bookworm's can't."""
    found = re.search(r"avformat: +YES \((\d+)", cv2.getBuildInformation())
    assert found is not None
    return int(found[1]) > 59


@pytest.mark.parametrize("prefix", ["", "ffmpeg:"])
def test_nobody_sends_us_to_another_address(prefix: str) -> None:
    asked: list[bytes] = []

    def other(connection: socket.socket, request: bytes) -> None:
        asked.append(request)
        sends(part(jpeg(90)))(connection, request)

    with server(other) as elsewhere:
        moved = f"HTTP/1.0 302 Found\r\nLocation: {elsewhere}\r\n\r\n".encode()
        with (
            server(ends_after(moved)) as url,
            pytest.raises(CameraError),
            frame_source(CameraSettings(source=f"{prefix}{url}")) as source,
        ):
            source.read()
    assert (asked == []) is (not prefix or ffmpeg_can_stay())


def test_ffmpeg_goes_where_rtsp_sends_it() -> None:
    """No option keeps it from that; deploy/config.toml and docs/security.md say so."""
    asked: list[bytes] = []

    def moved(connection: socket.socket, request: bytes) -> None:
        while request:
            number = re.search(rb"CSeq: \d+", request)
            assert number is not None
            status = b"200 OK" if request.startswith(b"OPTIONS") else b"302 Moved"
            head = b"RTSP/1.0 " + status + b"\r\n" + number[0]
            connection.sendall(head + f"\r\nLocation: {rtsp(elsewhere)}\r\n\r\n".encode())
            request = connection.recv(4096)

    def rtsp(address: str) -> str:
        return address.replace("http:", "rtsp:")

    with (
        server(lambda _, request: asked.append(request)) as elsewhere,
        server(moved) as url,
        pytest.raises(CameraError),
        frame_source(CameraSettings(source=f"ffmpeg:{rtsp(url)}")),
    ):
        pass
    assert asked


@pytest.mark.parametrize("password", ["geheim", "ge@geheim", "ge/geheim@", "?geheim", "ge#geheim"])
@pytest.mark.parametrize("prefix", ["", "ffmpeg:"])
def test_a_password_is_shown_to_the_camera_and_to_nobody_else(
    prefix: str, password: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever is in it, though a browser would want it quoted."""
    source = f"{prefix}http://anna:{password}@127.0.0.1:1/stream?token=geheim"
    with pytest.raises(CameraError) as caught:
        frame_source(CameraSettings(source=source)).__enter__()
    with CaptureThread(CameraSettings(source=source)) as capture:
        deadline_s = time.monotonic() + 5
        while capture.fault is None or capture.fault.kind != "camera-lost":
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        fault = capture.fault
    for words in (str(caught.value), fault.detail, caplog.text):
        assert "geheim" not in words
        assert "anna" not in words
    assert "http://...@127.0.0.1:1/stream?..." in fault.detail


@pytest.mark.parametrize("source", ["rtsp://anna:geheim@10.0.0.5/x", "https://10.0.0.5/x"])
def test_ffmpeg_is_reached_by_name_only(source: str) -> None:
    with pytest.raises(ConfigurationError, match="ffmpeg:ADDRESS") as caught:
        decode(f'robot_id = "x"\n[camera]\nsource = "{source}"', "robot.toml")
    assert "geheim" not in str(caught.value)

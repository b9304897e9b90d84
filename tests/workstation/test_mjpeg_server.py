import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.virtual.camera_stream import encode
from mbot_workstation.virtual.mjpeg_server import MjpegServer

LIMIT_S = 20


def picture(shade: int) -> bytes:
    plain = np.full((48, 64, 3), shade, np.uint8)
    plain[..., 0] = 200  # red
    return encode(plain)


@pytest.fixture
def server() -> Iterator[MjpegServer]:
    with MjpegServer() as running:
        yield running


@pytest.fixture
def moving(server: MjpegServer) -> Iterator[MjpegServer]:
    """A server that gets a new picture all the time."""
    done = threading.Event()

    def publish() -> None:
        number = 0
        while not done.wait(0.005):
            number += 1
            server.publish(picture(number % 100))

    thread = threading.Thread(target=publish)
    thread.start()
    yield server
    done.set()
    thread.join()


def test_opencv_reads_the_stream(moving: MjpegServer) -> None:
    capture = cv2.VideoCapture(moving.url)
    try:
        frames = [capture.read() for _ in range(5)]
        assert all(found for found, _ in frames)
        frame = frames[-1][1]
        assert frame.shape == (48, 64, 3)
        assert frame[..., 2].mean() > 180, "red is red"
        assert frame[..., 0].mean() < 120
    finally:
        capture.release()


def test_several_clients_get_pictures_at_once(moving: MjpegServer) -> None:
    clients = [urllib.request.urlopen(moving.url, timeout=LIMIT_S) for _ in range(3)]
    for client in clients:
        assert client.headers.get_content_type() == "multipart/x-mixed-replace"
        assert b"image/jpeg" in client.read(300)
        client.close()


def test_a_snapshot_is_one_jpeg(server: MjpegServer) -> None:
    server.publish(picture(40))
    with urllib.request.urlopen(
        f"http://127.0.0.1:{server.port}/snapshot.jpg", timeout=LIMIT_S
    ) as reply:
        assert reply.headers["Content-Type"] == "image/jpeg"
        assert reply.read() == picture(40)


def test_another_path_is_refused(server: MjpegServer) -> None:
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"http://127.0.0.1:{server.port}/etc/passwd", timeout=LIMIT_S)


def test_a_slow_client_skips_to_the_newest(server: MjpegServer) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)
    large = encode(noise)
    with socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16384)
        client.sendall(b"GET /stream.mjpg HTTP/1.0\r\n\r\n")
        for _ in range(60):
            server.publish(large)
            time.sleep(0.002)
        server.publish(b"the last")
        received = b""
        while b"the last" not in received:
            received += client.recv(1 << 20)
    assert received.count(b"--picture") < 30


def test_it_closes_while_clients_wait() -> None:
    with MjpegServer() as server:
        client = urllib.request.urlopen(server.url, timeout=LIMIT_S)
    assert client.read() == b""
    client.close()


def test_a_taken_port_is_explained(server: MjpegServer) -> None:
    with pytest.raises(ConfigurationError, match=f"port {server.port}.*--camera-port"):
        MjpegServer(server.port)


def test_only_this_machine_can_connect(server: MjpegServer) -> None:
    assert server.url == f"http://127.0.0.1:{server.port}/stream.mjpg"

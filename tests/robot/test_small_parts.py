"""Parts of the daemon that the larger tests only pass through."""

import socket
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_agent.camera.opencv_source import OpenCvSource, device_index
from mbot_agent.camera.source_contract import CameraError
from mbot_agent.configuration import Camera
from mbot_agent.network.pulse import Pulse
from mbot_agent.process.service_manager import notify

from ..until import until


def test_what_is_a_device_and_what_an_address() -> None:
    assert device_index("0") == device_index("/dev/video0") == 0
    assert device_index("http://127.0.0.1:1/x") is None
    assert device_index("film.avi") is None


def test_a_film_is_a_camera_until_its_end(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 100, (64, 48))
    for level in (50, 100, 150):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    with OpenCvSource(Camera(source=str(path))) as source:
        shots = [source.read() for _ in range(3)]
        assert shots[0].captured_ns < shots[1].captured_ns < shots[2].captured_ns
        with pytest.raises(CameraError):
            source.read()


def test_a_camera_that_is_not_there_is_named() -> None:
    with (
        pytest.raises(CameraError, match=r"missing\.avi"),
        OpenCvSource(Camera(source="missing.avi")),
    ):
        pass


def test_systemd_hears_what_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(place)
        heard.settimeout(5)
        monkeypatch.setenv("NOTIFY_SOCKET", place)
        notify("READY=1")
        assert heard.recv(64) == b"READY=1"
    notify("WATCHDOG=1")  # nobody listens any more: nothing happens
    monkeypatch.delenv("NOTIFY_SOCKET")
    notify("STOPPING=1")


def test_a_stop_service_that_is_silent_is_not_taken_for_answering() -> None:
    answers = iter([True, False])
    probe = Pulse(lambda _timeout_s: next(answers))
    began_ns = probe.answered_ns
    probe.ask()
    answered_ns = probe.answered_ns
    assert answered_ns > began_ns
    probe.ask()
    assert probe.answered_ns == answered_ns
    probe.ask()  # asking raises: as if silent
    assert probe.answered_ns == answered_ns


def test_the_daemon_asks_itself_again_and_again_until_its_end() -> None:
    asked: list[float] = []
    with Pulse(lambda timeout_s: asked.append(timeout_s) is None) as pulse:
        assert until(lambda: len(asked) >= 2)
        answered_ns = pulse.answered_ns
        assert until(lambda: pulse.answered_ns > answered_ns)
        thread = pulse._thread  # pyright: ignore[reportPrivateUsage]
    assert not thread.is_alive()
    assert len(asked) <= 4

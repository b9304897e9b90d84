"""A recording's camera: what the policy saw, back in frames, and played in time."""

import json
import subprocess
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from typer.testing import CliRunner

from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView
from mbot_workstation.cli.subcommands import app
from mbot_workstation.pictures.picture_file import observation
from mbot_workstation.virtual.live_report import LiveReport
from mbot_workstation.virtual.replay_session import ReplaySettings, play
from mbot_workstation.virtual.replayed_camera import BackProjection, Frame, ReplayedCamera, frames

from ..ran import WORKSTATION
from ..until import until

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"
CAMERA = nominal_pi_camera(640, 480)
LENS = structs.replace(CAMERA, distortion=(-0.2, 0.05, 0.001, -0.001, 0.0))


def pictures(drive: RecordedDrive) -> list[Picture]:
    return [seen for beat in drive.beats if (seen := observation(beat)) is not None]


@pytest.mark.parametrize("camera", [CAMERA, LENS])
@pytest.mark.parametrize("view", [FULL_VIEW, FieldOfView(40.0, 35.0)])
def test_the_daemon_sees_in_a_frame_what_the_policy_saw(
    drive: RecordedDrive, camera: CameraModel, view: FieldOfView
) -> None:
    observer, back = Observer(camera, view), BackProjection(camera, view)
    for seen in pictures(drive):
        again = observer.observe(back.frame(seen))
        inner = np.abs(again.astype(int) - seen)[2:-2, 2:-2]
        assert inner.mean() < 2.0


def test_through_the_coder_it_is_about_the_same(drive: RecordedDrive) -> None:
    observer = Observer(CAMERA, FULL_VIEW)
    shown = frames(drive, CAMERA)
    assert len(shown) == len(pictures(drive))
    for frame, seen in zip(shown, pictures(drive), strict=True):
        bgr = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert bgr is not None
        again = observer.observe(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8))
        assert np.abs(again.astype(int) - seen).mean() < 3.0


def test_pauses_are_shortened_and_the_order_is_kept(drive: RecordedDrive) -> None:
    at_s = [frame.since_s for frame in frames(drive, CAMERA)]
    assert at_s[0] == 0.0
    assert at_s == sorted(at_s)
    between_s = np.diff(at_s)
    assert between_s.max() <= 1.0
    assert np.median(between_s) == pytest.approx(0.4, abs=0.02)


def test_a_recording_without_pictures_is_refused(drive: RecordedDrive) -> None:
    blind = replace(drive, beats=tuple(replace(beat, encoded=b"") for beat in drive.beats))
    with pytest.raises(ConfigurationError, match="recorded-drive has no pictures"):
        frames(blind, CAMERA)


@settings(deadline=None)
@given(
    st.lists(st.floats(0, 1), min_size=1, max_size=8),
    st.floats(1, 120),
)
def test_every_picture_comes_in_every_round_at_its_time(steps: list[float], rate: float) -> None:
    at_s = np.cumsum([0.0, *steps[1:]])
    shown = [Frame(float(s), bytes([n])) for n, s in enumerate(at_s)]
    camera = ReplayedCamera(shown, rate, lambda _: None)
    found: list[tuple[float, int]] = []
    for due_s, jpeg in camera._schedule():
        if camera.rounds == 2:
            break
        found.append((due_s, jpeg[0]))
    times = [due_s for due_s, _ in found]
    assert all(b >= a - 1e-9 for a, b in pairwise(times))
    first: list[int] = list(dict.fromkeys(n for _, n in found))
    assert first == list(range(len(shown)))
    for n, frame in enumerate(shown):
        assert min(t for t, m in found if m == n) == pytest.approx(frame.since_s)


def test_a_session_plays_round_and_round_until_it_is_stopped(
    drive: RecordedDrive, tmp_path: Path
) -> None:
    class Report(LiveReport):
        def played(self, rounds: int, pictures: int, commands: int) -> None:
            heard.append((rounds, pictures, commands))
            stop.set()

    heard: list[tuple[int, int, int]] = []
    stop = threading.Event()
    short = replace(drive, beats=drive.beats[:3])
    ready = tmp_path / "ready.json"
    played = ReplaySettings(short, CAMERA, board_link=tmp_path / "board", ready_file=ready)
    play(played, Report(as_json=True), stop, 30.0)
    assert heard == [(1, 3, 0)]
    assert not ready.exists()
    assert not (tmp_path / "board").is_symlink()


def test_options_of_the_simulation_are_refused(tmp_path: Path) -> None:
    for wrong, named in (
        (["--seed", "3"], "--seed"),
        (["--plain"], "--plain"),
        (["--object", "ball.toml"], "--object"),
    ):
        result = CliRunner().invoke(app, ["virtual-robot", "--replay", str(RECORDED), *wrong])
        assert isinstance(result.exception, ConfigurationError)
        assert f"{named} does nothing with --replay" in str(result.exception)


def test_the_command_shows_the_recording(tmp_path: Path) -> None:
    ready = tmp_path / "ready.json"
    where = ["--board", str(tmp_path / "board"), "--camera-port", "0", "--ready-file", str(ready)]
    with subprocess.Popen(
        [*WORKSTATION, "virtual-robot", "--json", *where, "--replay", str(RECORDED)]
    ) as running:
        try:
            assert until(ready.exists)
            found: dict[str, Any] = json.loads(ready.read_text())
            capture = cv2.VideoCapture(found["camera"])
            seen = [capture.read()[1] for _ in range(30)]
            capture.release()
        finally:
            running.terminate()
    assert seen[0].shape == (480, 640, 3)
    assert any(not np.array_equal(seen[0], other) for other in seen), "it moves"

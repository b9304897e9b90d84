"""A camera overhead finds where a marker goes, whatever it is not told; SteamVR likewise."""

import ctypes
import itertools
import re
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError, MbotError, UnreachableError
from mbot_workstation.cli.track import track as track_command
from mbot_workstation.measure.targets.marker_detection import (
    MarkerDetector,
    refine_corners,
    to_grey,
)
from mbot_workstation.measure.targets.specifications import MARKER_DICTIONARY, ROBOT_MARKER_ID
from mbot_workstation.measure.tracking.floor_plane import (
    FloorPlane,
    pixel_rays,
    plane_from_board,
    plane_from_corners,
)
from mbot_workstation.measure.tracking.marker_track import floor_finder, watch_marker
from mbot_workstation.measure.tracking.openvr_tracker import (
    OpenVrTracker,
    load_openvr,
    quaternion_of,
    record_poses,
)
from mbot_workstation.measure.tracking.overhead_camera import camera_for
from mbot_workstation.measure.tracking.overhead_track import (
    MarkerSight,
    overhead_track,
    plane_from_marker,
)
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_file import TrackFile, read_track

from ..ran import LIMIT_S, WORKSTATION
from .called import output_of
from .overhead_film import Overhead, drive, film, marker_sheet, sheet_corners, webcam


def guess(like: CameraModel, fov_deg: float = 65.0) -> CameraModel:
    width_px, height_px = like.width_px, like.height_px
    vertical = np.degrees(np.arctan(np.tan(np.radians(fov_deg) / 2) * height_px / width_px)) * 2
    return CameraModel.from_field_of_view(width_px, height_px, fov_deg, float(vertical))


def misfit(found: Array, truth: Array) -> tuple[float, float]:
    """Largest distance in m after moving and turning, and how much larger it all is."""
    first, second = found - found.mean(axis=0), truth - truth.mean(axis=0)
    left, _, right = np.linalg.svd(first.T @ second)
    turn = left @ np.diag([1, np.sign(np.linalg.det(left @ right))]) @ right
    turned = first @ turn
    scale = float(np.sum(turned * second) / np.sum(second * second))
    return float(np.linalg.norm(turned - second, axis=1).max()), scale


def check(track: Track, times_s: Array, poses: Array, largest_m: float = 0.003) -> None:
    """The track goes where the film went, to the left when it went to the left, in metres."""
    rows = np.round(track.time_s * 30).astype(int)
    assert np.abs(track.time_s - times_s[rows]).max() < 0.002
    worst_m, scale = misfit(track.position_m[:, :2], poses[rows, :2])
    assert worst_m < largest_m
    assert scale == pytest.approx(1, abs=0.006)
    turned = track.yaw_rad - track.yaw_rad[0] - poses[rows, 2] + poses[rows[0], 2]
    assert np.degrees(np.abs(turned - np.median(turned))).max() < 2


# Geometry, without pictures


@settings(max_examples=20)
@given(
    st.floats(0, 50),
    st.floats(50, 80),
    st.floats(-0.1, 0.05),
    st.booleans(),
    st.integers(0, 1000),
)
def test_a_square_seen_in_many_places_tells_the_plane(
    tilt_deg: float, fov_deg: float, k1: float, known: bool, seed: int
) -> None:
    view = Overhead(webcam(1280, fov_deg, k1), 2.4, tilt_deg)
    random = np.random.default_rng(seed)
    poses = np.column_stack(
        [
            random.uniform(-0.9, 0.9, 60),
            random.uniform(-0.45, 0.45, 60),
            random.uniform(0, 6.28, 60),
        ]
    )
    quads = np.stack([view.pixels(sheet_corners(pose, 0.08, 0.11)) for pose in poses])
    quads += random.normal(0, 0.1, quads.shape)
    camera = view.camera if known else guess(view.camera)
    found = plane_from_marker(camera, quads, 0.08, camera_is_known=known)
    places = found.plane.places_m(pixel_rays(found.camera, quads)).mean(axis=1)
    worst_m, scale = misfit(places, poses[:, :2])
    assert worst_m < (0.003 if known else 0.006)
    assert scale == pytest.approx(1, abs=0.005)
    assert found.error_px < 0.3
    if known:
        assert found.plane.distance_m == pytest.approx(2.29, rel=0.01)
        tilt = np.degrees(np.arccos(-found.plane.up[2]))
        assert tilt == pytest.approx(tilt_deg, abs=1.5)


def test_a_plane_maps_known_points() -> None:
    straight_down = FloorPlane(np.array([0.0, 0.0, -1.0]), 2.0)
    rays = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, 0.25, 1.0], [0.0, 0.0, -1.0]])
    places = straight_down.places_m(rays)
    assert np.allclose(places[:3], [[0, 0], [1, 0], [0, -0.5]])  # y away from the picture's bottom
    assert np.isnan(places[3]).all()
    assert np.allclose(straight_down.raised(0.5).places_m(rays)[1], [0.75, 0])


def sights(count: int, edge_px: float = 40.0) -> list[MarkerSight]:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64) * edge_px
    return [
        MarkerSight(row / 30, square + np.array([300 + row, 200 + row % 7])) for row in range(count)
    ]


def test_too_little_is_refused() -> None:
    camera = guess(webcam())
    with pytest.raises(ConfigurationError, match="in 19 pictures only"):
        overhead_track(sights(19), camera, 0.08, 0.1, camera_is_known=True)
    with pytest.raises(ConfigurationError, match="the marker is 8 pixels wide"):
        overhead_track(sights(50, 8.0), camera, 0.08, 0.1, camera_is_known=True)


def test_a_marker_of_another_size_than_declared_is_named() -> None:
    camera = guess(webcam())
    floor = FloorPlane(np.array([0.0, 0.0, -1.0]), 2.0)
    with pytest.raises(ConfigurationError, match=r"the marker measures .* mm .* declared are 60"):
        overhead_track(sights(50), camera, 0.06, 0.1, camera_is_known=True, floor=floor)


# Films


tracked = partial(output_of, track_command)


def refused(*arguments: str) -> str:
    with pytest.raises(ConfigurationError) as caught:
        tracked(*arguments)
    return str(caught.value)


@pytest.fixture(scope="module")
def view() -> Overhead:
    return Overhead(webcam())


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory, view: Overhead) -> Path:
    """Eight seconds, a third of a second of it hidden."""
    path = tmp_path_factory.mktemp("film") / "eight.avi"
    film(path, view, drive(8)[1], hidden=range(100, 110))
    return path


@pytest.mark.slow
def test_a_film_is_enough(eight: Path, tmp_path: Path) -> None:
    """Nothing is known but the marker's edge: neither the camera, nor where it hangs."""
    output = tmp_path / "a" / "new" / "folder" / "t.tum"
    assert "poses in 8.0 s" in tracked(str(eight), "--output", str(output))
    track = read_track(output)
    assert 225 <= len(track) <= 230
    check(track, *drive(8))
    assert np.allclose(track.position_m[:, 2], 0.11)
    assert np.diff(track.time_s).max() == pytest.approx(11 / 30, abs=0.04)


@pytest.mark.slow
def test_a_calibrated_camera_is_used_as_it_is(eight: Path, view: Overhead, tmp_path: Path) -> None:
    camera = view.camera
    (tmp_path / "camera.toml").write_text(
        f"width_px = {2 * camera.width_px}\nheight_px = {2 * camera.height_px}\n"
        f"focal_x_px = {2 * camera.focal_x_px}\nfocal_y_px = {2 * camera.focal_y_px}\n"
        f"principal_x_px = {2 * camera.principal_x_px + 0.5}\n"
        f"principal_y_px = {2 * camera.principal_y_px + 0.5}\n"
        f"distortion = {list(camera.distortion)}\n"
        'reprojection_error_px = 0.1\npictures = 20\nmade_on = "2026-11-21"\n'
    )
    output = tmp_path / "t.tum"
    said = tracked(str(eight), "--output", str(output), "--camera", str(tmp_path))
    assert "camera 2.19 m above the marker, tilted by 12 degrees" in said
    check(read_track(output), *drive(8), largest_m=0.002)


@pytest.mark.slow
@pytest.mark.parametrize("reference", ["corners", "board"])
def test_the_floor_may_be_given(view: Overhead, tmp_path: Path, reference: str) -> None:
    times_s, poses = drive(2)
    path, output = tmp_path / "film.avi", tmp_path / "t.tum"
    if reference == "corners":
        film(path, view, poses, corners_m=(1.6, 0.9))
        options = ("--corners", "1.6", "0.9")
    else:
        film(path, view, poses, board_mm=60)
        options = ("--board-mm", "60")
    # The field of view is known, the distortion is not.
    said = tracked(str(path), "--output", str(output), *options, "--fov-deg", "62")
    assert "80.0 were declared" in said or "80 were declared" in said
    rows = read_track(output)
    worst_m, scale = misfit(rows.position_m[:, :2], poses[: len(rows), :2])
    assert worst_m < 0.03
    assert scale == pytest.approx(1, abs=0.02)
    unwritten = str(tmp_path / "u.tum")
    wrong = refused(str(path), "--output", unwritten, *options, "--marker-mm", "107")
    assert "check --marker-mm" in wrong
    assert not (tmp_path / "u.tum").exists()
    assert len(times_s) == len(rows)


def test_a_mirrored_film_is_named(view: Overhead, tmp_path: Path) -> None:
    film(tmp_path / "film.avi", view, drive(1)[1], mirrored=True)
    said = refused(str(tmp_path / "film.avi"), "--output", str(tmp_path / "t.tum"))
    assert "the pictures are mirrored" in said


@pytest.mark.slow
def test_a_film_without_what_is_looked_for_is_named(eight: Path, tmp_path: Path) -> None:
    output = ("--output", str(tmp_path / "t.tum"))
    assert "is in 0 pictures only" in refused(str(eight), *output, "--marker-id", "8")
    none = refused(str(eight), *output, "--corners", "1", "1")
    assert "should lie on the floor is in none" in none
    assert not (tmp_path / "t.tum").exists()


@pytest.mark.slow
def test_ctrl_c_ends_a_live_camera_and_keeps_the_track(eight: Path, tmp_path: Path) -> None:
    from mbot_workstation.virtual.mjpeg_server import MjpegServer

    capture = cv2.VideoCapture(str(eight))
    jpegs = []
    while (shot := capture.read())[0]:
        jpegs.append(cv2.imencode(".jpg", shot[1])[1].tobytes())
    output, log = tmp_path / "t.tum", tmp_path / "log"

    def seen() -> int:
        return max(map(int, re.findall(r"marker 7 in (\d+) of", log.read_text())), default=0)

    with MjpegServer(0) as server, log.open("w") as errors:
        command = [*WORKSTATION, "track", server.url, "--output", str(output)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process:
            deadline_s = time.monotonic() + LIMIT_S
            for row in itertools.count():
                server.publish(jpegs[row % len(jpegs)])
                time.sleep(0.01)
                assert process.poll() is None, log.read_text()
                assert time.monotonic() < deadline_s, log.read_text()
                if seen() >= 40:
                    break
            process.send_signal(signal.SIGINT)
            while process.poll() is None and time.monotonic() < deadline_s:
                server.publish(jpegs[0])  # it looks up with the next picture
                time.sleep(0.05)
            out, _ = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, log.read_text()
    assert b"poses in" in out
    track = read_track(output)
    assert len(track) >= 40
    assert track.time_s[-1] == pytest.approx(time.monotonic(), abs=600)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("nowhere.avi",), 4, "can't open the camera 'nowhere.avi'"),
        (("0", "--output", "t.csv"), 2, "expected .tum"),
        (("0", "--output", "/dev/null/t.tum"), 2, "can't make /dev/null"),
        (("0", "--corners", "1", "1", "--board-mm", "60"), 2, "exclude each other"),
        (("0", "--corners", "1", "-1"), 2, "expected 0.1 to 20"),
        (("0", "--camera", "nowhere"), 2, "no calibration folder"),
        (("openvr",), 2, "'.[measure,tracking]'"),
    ],
)
def test_nonsense_is_refused(
    tmp_path: Path,
    arguments: tuple[str, ...],
    code: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "openvr", None)  # should it be installed
    output = () if "--output" in arguments else ("--output", str(tmp_path / "t.tum"))
    with pytest.raises(MbotError) as caught:
        tracked(*arguments, *output)
    assert (caught.value.exit_code, words in str(caught.value)) == (code, True)


def test_what_exists_is_not_overwritten(eight: Path, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("years of work")
    assert "exists already" in refused(str(eight), "--output", str(tmp_path / "t.tum"))
    assert (tmp_path / "t.tum").read_text() == "years of work"


def picture_with_marker(left: float, top: float, side: float) -> tuple[np.ndarray, np.ndarray]:
    """A marker on a light floor, seen straight from above; and its corners."""
    sheet = marker_sheet()
    height, width = sheet.shape
    reach = side * 0.5  # of paper around it
    source = np.array([[0, 0], [width, 0], [width, height]], np.float32)
    first, last = (left - reach, top - reach), (left + side + reach, top + side + reach)
    place = np.array([first, (last[0], first[1]), last], np.float32)
    turned = cv2.getAffineTransform(source, place)
    grey = cv2.warpAffine(sheet, turned, (640, 480), borderValue=(200,))
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, MARKER_DICTIONARY))
    )
    corners, _, _ = detector.detectMarkers(grey)
    return grey, np.asarray(corners[0], np.float64).reshape(4, 2)


def test_corners_become_sharper_than_they_were_found() -> None:
    grey, found = picture_with_marker(200.25, 150.75, 120.0)
    edge = np.linalg.norm(np.diff(np.vstack([found, found[:1]]), axis=0), axis=1).mean()
    moved = found + np.random.default_rng(0).uniform(-0.7, 0.7, (4, 2))
    refined = refine_corners(grey, moved)
    assert refined.shape == (4, 2)
    assert np.abs(refined - found).max() < 0.8
    sides = np.linalg.norm(np.diff(np.vstack([refined, refined[:1]]), axis=0), axis=1)
    assert np.ptp(sides) < 0.02 * edge


def test_a_floor_without_what_marks_it_is_not_found() -> None:
    camera = webcam()
    blank = np.full((camera.height_px, camera.width_px), 128, np.uint8)
    assert plane_from_board(camera, blank, 25.0) is None
    assert plane_from_corners(camera, {}, 3.0, 3.0) is None


def test_a_film_without_the_marker_shows_none() -> None:
    frames = iter([(0.1 * i, np.full((240, 320, 3), 90, np.uint8)) for i in range(5)])

    def camera_for(width_px: int, height_px: int) -> CameraModel:
        return CameraModel.from_field_of_view(width_px, height_px, 60.0, 47.0)

    watches = list(watch_marker(frames, ROBOT_MARKER_ID, camera_for, None))
    assert watches[-1].pictures == 5
    assert len(watches[-1].sights) == 0


def test_the_detector_gives_corners_from_the_upper_left_clockwise(view: Overhead) -> None:
    pose = np.array([0.2, 0.1, np.pi / 2])  # its upper edge away from the camera: up in the picture
    path_quads = view.pixels(sheet_corners(pose, 0.16, 0.11))
    canvas = np.full((540, 960), 140, np.uint8)
    from .overhead_film import lay

    lay(canvas, marker_sheet(), view.pixels(sheet_corners(pose, 0.16 * 8 / 6, 0.11)))
    found = MarkerDetector().find(to_grey(np.repeat(canvas[..., None], 3, axis=2)))
    assert set(found) == {7}
    assert np.abs(found[7] - path_quads).max() < 0.15
    other = sheet_corners(pose - np.array([0.6, 0, 0]), 0.16 * 8 / 6, 0.11)
    lay(canvas, marker_sheet(), view.pixels(other))
    assert MarkerDetector().find(canvas) == {}  # two of the same: neither


# SteamVR, by a stand-in with the layout of the real package; it needs a headset otherwise.


class Matrix(ctypes.Structure):
    _fields_ = (("m", (ctypes.c_float * 4) * 3),)


class Pose(ctypes.Structure):
    _fields_ = (
        ("mDeviceToAbsoluteTracking", Matrix),
        ("vVelocity", ctypes.c_float * 3),
        ("vAngularVelocity", ctypes.c_float * 3),
        ("eTrackingResult", ctypes.c_uint),
        ("bPoseIsValid", ctypes.c_ubyte),
        ("bDeviceIsConnected", ctypes.c_ubyte),
    )


class SteamVr:
    """What of the openvr package is used. Device 0 is a headset, then a tracker each."""

    class OpenVRError(Exception):
        pass

    VRApplication_Other = 0
    TrackingUniverseStanding = 1
    TrackedDeviceClass_GenericTracker = 3
    TrackingResult_Running_OK = 200
    Prop_SerialNumber_String = 1002
    k_unMaxTrackedDeviceCount = 8  # noqa: N815
    TrackedDevicePose_t = Pose

    def __init__(self, trackers: int = 1, running: bool = True) -> None:
        self.devices = ["HMD-1", *(f"LHR-{number}" for number in range(trackers))]
        self.running = running
        self.open = False
        self.result = self.TrackingResult_Running_OK
        self.yaw = 0.0

    def init(self, kind: int) -> "SteamVr":
        assert kind == self.VRApplication_Other
        if not self.running:
            raise self.OpenVRError
        self.open = True
        return self

    def shutdown(self) -> None:
        self.open = False

    def getDeviceToAbsoluteTrackingPose(  # noqa: N802
        self, universe: int, ahead_s: float, poses: Any
    ) -> Any:
        assert (universe, ahead_s, self.open) == (self.TrackingUniverseStanding, 0.0, True)
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        for index in range(len(self.devices)):
            poses[index].bDeviceIsConnected = poses[index].bPoseIsValid = 1
            poses[index].eTrackingResult = self.result
            # Turned to the left about y, 1 m right, 0.2 m up, 3 m back.
            rows = [[cosine, 0, sine, 1.0], [0, 1, 0, 0.2], [-sine, 0, cosine, 3.0]]
            for row, numbers in enumerate(rows):
                for column, number in enumerate(numbers):
                    poses[index].mDeviceToAbsoluteTracking.m[row][column] = number
        return poses

    def getTrackedDeviceClass(self, index: int) -> int:  # noqa: N802
        return 1 if index == 0 else self.TrackedDeviceClass_GenericTracker

    def getStringTrackedDeviceProperty(self, index: int, which: int) -> str:  # noqa: N802
        assert which == self.Prop_SerialNumber_String
        return self.devices[index]


def test_steamvr_poses_come_out_z_up() -> None:
    steam = SteamVr()
    with OpenVrTracker(steam) as tracker:
        assert tracker.serial == "LHR-0"
        steam.yaw = 0.5
        pose = tracker.pose()
    assert not steam.open
    assert pose is not None
    position, quaternion = pose
    assert position == pytest.approx([1.0, -3.0, 0.2], abs=1e-6)
    assert quaternion == pytest.approx([np.cos(0.25), 0, 0, np.sin(0.25)], abs=1e-6)


def test_a_lost_steamvr_pose_is_none() -> None:
    steam = SteamVr()
    with OpenVrTracker(steam) as tracker:
        steam.result = 201  # out of range, where SteamVR goes on guessing
        assert tracker.pose() is None


def test_the_right_steamvr_device_is_chosen() -> None:
    with pytest.raises(
        ConfigurationError, match="2 trackers: LHR-0, LHR-1; choose one by --serial"
    ):
        OpenVrTracker(SteamVr(2)).__enter__()
    with OpenVrTracker(SteamVr(2), "LHR-1") as tracker:
        assert tracker.serial == "LHR-1"
    with OpenVrTracker(SteamVr(0), "HMD-1") as tracker:  # whatever is on the robot
        assert tracker.serial == "HMD-1"
    steam = SteamVr(0)
    with pytest.raises(ConfigurationError, match="sees no tracker, only HMD-1"):
        OpenVrTracker(steam).__enter__()
    assert not steam.open
    with pytest.raises(ConfigurationError, match="sees no device LHR-9"):
        OpenVrTracker(SteamVr(), "LHR-9").__enter__()


def test_steamvr_that_does_not_run_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnreachableError, match=r"SteamVR does not answer \(OpenVRError\)"):
        OpenVrTracker(SteamVr(running=False)).__enter__()
    monkeypatch.setitem(sys.modules, "openvr", None)  # as if not installed
    with pytest.raises(ConfigurationError, match="needs the openvr package"):
        load_openvr()
    monkeypatch.setitem(sys.modules, "openvr", SimpleNamespace())
    assert load_openvr() is sys.modules["openvr"]


def test_steamvr_is_recorded_and_lost_poses_are_left_out(tmp_path: Path) -> None:
    steam, stop = SteamVr(), threading.Event()
    with OpenVrTracker(steam) as tracker, TrackFile(tmp_path / "t.tum") as file:
        progress = None
        for progress in record_poses(tracker, file, 90, stop):
            total = progress.recorded + progress.lost
            steam.yaw = total / 50
            steam.result = 201 if 20 <= total < 30 else steam.TrackingResult_Running_OK
            if total >= 60:
                stop.set()
    assert progress is not None
    assert (progress.recorded, progress.lost) == (50, 10)
    track = read_track(tmp_path / "t.tum")
    assert len(track) == 50
    assert track.yaw_rad[-1] == pytest.approx(59 / 50, abs=0.03)
    assert track.position_m[0] == pytest.approx([1, -3, 0.2])
    assert np.diff(track.time_s).max() > 10 / 90 - 0.005


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_every_rotation_has_its_quaternion(values: tuple[float, float, float, float]) -> None:
    w, x, y, z = np.array(values) / np.linalg.norm(values)
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    found = quaternion_of(matrix)
    assert found is not None
    assert abs(found @ [w, x, y, z]) == pytest.approx(1)
    assert quaternion_of(matrix * [1, 1, -1]) is None
    assert quaternion_of(matrix * 1.1) is None


def test_a_camera_without_calibration_is_guessed_from_its_view(tmp_path: Path) -> None:
    model = camera_for(None, 60.0)(640, 480)
    assert (model.width_px, model.height_px) == (640, 480)
    assert model.focal_x_px == pytest.approx(320 / np.tan(np.radians(30)))
    assert model.focal_y_px == pytest.approx(model.focal_x_px)
    with pytest.raises(ConfigurationError):
        camera_for(tmp_path, 60.0)


def test_the_floor_is_looked_for_by_what_lies_on_it() -> None:
    assert floor_finder(None, None) is None
    by_corners = floor_finder((1.8, 1.2), None)
    assert by_corners is not None
    assert by_corners(camera_for(None, 60.0)(640, 480), np.zeros((480, 640), np.uint8), {}) is None

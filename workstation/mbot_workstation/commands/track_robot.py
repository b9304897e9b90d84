"""`workstation track`: where a robot goes, seen by a camera overhead or by SteamVR."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.targets.specifications import ROBOT_MARKER_EDGE_MM, ROBOT_MARKER_ID

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable

    from mbot_protocol.camera_model import CameraModel
    from mbot_workstation.tracking.marker_watch import FindFloor

OPENVR = "openvr"

REPORT_EVERY_S = 2.0

_CAMERA, _FLOOR, _STEAMVR = "Camera", "Floor", "SteamVR"


def track(
    *,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A camera overhead (0, /dev/video0), its stream's URL or a video file; or "
            "`openvr` for a SteamVR tracker on this machine.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.tum", help="The track, in TUM format.")
    ] = Path("track.tum"),
    marker_mm: Annotated[
        float,
        typer.Option(
            min=5, max=1000, help="Edge of the marker's black square; measure the printed one."
        ),
    ] = ROBOT_MARKER_EDGE_MM,
    marker_id: Annotated[int, typer.Option(min=0, max=49, help="Of the robot's marker.")] = (
        ROBOT_MARKER_ID
    ),
    height_m: Annotated[
        float, typer.Option(min=0, max=2, help="Of the marker above the floor.")
    ] = 0.11,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.5, help="End by itself, a camera or SteamVR; Ctrl-C does it, too."),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Calibration of this camera, by `workstation calibrate camera --calibration "
            "FOLDER`. Without, focal length and distortion are found from the marker.",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    fov_deg: Annotated[
        float,
        typer.Option(
            min=15,
            max=140,
            help="The camera's horizontal field of view, roughly; webcams have 55 to 80.",
            rich_help_panel=_CAMERA,
        ),
    ] = 65.0,
    corners: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="WIDTH_M DEPTH_M",
            help="Markers 1, 2, 3, 4 lie on the floor, clockwise at the corners of a rectangle; "
            "distances 1 to 2 and 2 to 3, centre to centre. Otherwise the robot's marker tells "
            "where the floor is.",
            rich_help_panel=_FLOOR,
        ),
    ] = None,
    board_mm: Annotated[
        float | None,
        typer.Option(
            min=5,
            max=500,
            help="The printed ChArUco board lies on the floor, with squares of this size.",
            rich_help_panel=_FLOOR,
        ),
    ] = None,
    serial: Annotated[
        str | None,
        typer.Option(help="Which device, where SteamVR sees several.", rich_help_panel=_STEAMVR),
    ] = None,
    rate: Annotated[
        float,
        typer.Option(metavar="HZ", min=1, max=500, help="Of poses.", rich_help_panel=_STEAMVR),
    ] = 90.0,
) -> None:
    """Follow a robot while it drives, and write its track for `workstation identify`.

    With a camera: put the marker of `workstation print marker` flat on the robot, its upper edge
    ahead, and hang the camera so that it sees the whole floor. Start this before `workstation
    maneuvers run` and end it with Ctrl-C after. The clocks need not agree.

    Examples:

    - `workstation track 0 --marker-mm 79.5 --output recordings/mbot-1-2026-11-21/track.tum`
    - `workstation track film.mp4 --height-m 0.12 --camera calibration/webcam`
    - `workstation track 0 --corners 1.80 1.20`
    - `workstation track openvr --output recordings/mbot-1-2026-11-21/track.tum`
    """
    from mbot_workstation.tracking.track_file import check_new

    if corners is not None and board_mm is not None:
        raise ConfigurationError("--corners and --board-mm exclude each other")
    if corners is not None and not all(0.1 <= side <= 20 for side in corners):
        raise ConfigurationError(
            f"--corners are {corners[0]:g} and {corners[1]:g} m apart, expected 0.1 to 20"
        )
    check_new(output)
    camera_for = _camera_model(camera, fov_deg)
    stop = _stop_on_signals(seconds)
    if source == OPENVR:
        _record_openvr(output, serial, rate, stop)
        return
    from mbot_workstation.tracking.marker_track import MarkerSettings, track_marker

    settings = MarkerSettings(
        marker_id=marker_id,
        edge_m=marker_mm / 1000,
        height_m=height_m,
        camera_for=camera_for,
        camera_is_known=camera is not None,
        find_floor=_floor_finder(corners, board_mm),
    )
    reporter = _Reporter()
    result = track_marker(
        source,
        output,
        settings,
        stop,
        lambda watch: reporter.say(
            f"marker {marker_id} in {len(watch.sights)} of {watch.pictures} pictures"
        ),
    )
    print(
        f"{output}: {len(result.track)} poses in {result.track.duration_s:.1f} s; camera "
        f"{result.distance_m:.2f} m above the marker, tilted by {result.tilt_deg:.0f} degrees; the "
        f"marker's corners are off by {result.error_px:.2f} pixels"
    )
    if corners is not None or board_mm is not None:
        print(f"the marker measures {result.edge_mm:.1f} mm there, {marker_mm:g} were declared")


def _camera_model(folder: Path | None, fov_deg: float) -> "Callable[[int, int], CameraModel]":
    """The camera's model for pictures of a given size."""
    from mbot_protocol.calibration import CAMERA_FILE, read_camera
    from mbot_protocol.camera_model import CameraModel

    if folder is None:

        def guess(width_px: int, height_px: int) -> CameraModel:
            vertical = 2 * math.atan(math.tan(math.radians(fov_deg) / 2) * height_px / width_px)
            return CameraModel.from_field_of_view(
                width_px, height_px, fov_deg, math.degrees(vertical)
            )

        return guess
    calibrated = read_camera(folder)
    if calibrated is None:
        raise ConfigurationError(f"{folder} holds no {CAMERA_FILE}")
    model = calibrated.model()

    def scaled(width_px: int, height_px: int) -> CameraModel:
        if abs(width_px * model.height_px / (height_px * model.width_px) - 1) > 0.02:
            raise ConfigurationError(
                f"pictures are {width_px} x {height_px}, {folder / CAMERA_FILE} is for "
                f"{model.width_px} x {model.height_px}, another shape"
            )
        return model.scaled_to(width_px, height_px)

    return scaled


def _floor_finder(
    corners: tuple[float, float] | None, board_mm: float | None
) -> "FindFloor | None":
    from mbot_workstation.tracking.floor_reference import plane_from_board, plane_from_corners

    if corners is not None:
        return lambda camera, _grey, markers: plane_from_corners(camera, markers, *corners)
    if board_mm is not None:
        return lambda camera, grey, _markers: plane_from_board(camera, grey, board_mm)
    return None


def _record_openvr(
    output: Path, serial: str | None, rate_hz: float, stop: "threading.Event"
) -> None:
    from mbot_workstation.tracking.openvr_recording import record_poses
    from mbot_workstation.tracking.openvr_tracker import OpenVrTracker, load_openvr
    from mbot_workstation.tracking.track_file import TrackFile

    reporter = _Reporter()
    recorded, lost = 0, 0
    with OpenVrTracker(load_openvr(), serial) as tracker, TrackFile(output) as file:
        for progress in record_poses(tracker, file, rate_hz, stop):
            recorded, lost = progress.recorded, progress.lost
            away = f"; lost for {progress.lost_for_s:.0f} s" if progress.lost_for_s > 1 else ""
            reporter.say(f"tracker {tracker.serial}: {recorded} poses, {lost} lost{away}")
    print(f"{output}: {recorded} poses, {lost} lost ones left out")


class _Reporter:
    """A line on standard error every two seconds."""

    def __init__(self) -> None:
        import time

        self._clock_s = time.monotonic
        self._next_s = time.monotonic() + REPORT_EVERY_S

    def say(self, text: str) -> None:
        """The text, if it is time for one."""
        import sys

        if self._clock_s() >= self._next_s:
            self._next_s = self._clock_s() + REPORT_EVERY_S
            print(text, file=sys.stderr, flush=True)


def _stop_on_signals(seconds: float | None) -> "threading.Event":
    import signal
    import threading
    from types import FrameType

    stop = threading.Event()

    def ask(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    if seconds is not None:
        timer = threading.Timer(seconds, stop.set)
        timer.daemon = True
        timer.start()
    return stop

"""`workstation track`: where a robot goes, seen by a camera overhead or by SteamVR."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.stop_signals import stop_signals
from mbot_workstation.measure.targets.specifications import ROBOT_MARKER_EDGE_MM, ROBOT_MARKER_ID

if TYPE_CHECKING:
    import threading

OPENVR = "openvr"

REPORT_EVERY_S = 2.0

_CAMERA, _FLOOR, _STEAMVR = "Camera", "Floor", "SteamVR"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOptions:
    """What `track` takes."""

    source: str = argument(
        "A camera overhead (0, /dev/video0), its stream's URL or a video file; or "
        "`openvr` for a SteamVR tracker on this machine.",
        metavar="SOURCE",
    )
    output: Path = option(
        Path("track.tum"), "The track, in TUM format.", "--output", "-o", metavar="FILE.tum"
    )
    marker_mm: float = option(
        ROBOT_MARKER_EDGE_MM,
        "Edge of the marker's black square; measure the printed one.",
        min=5,
        max=1000,
    )
    marker_id: int = option(ROBOT_MARKER_ID, "Of the robot's marker.", min=0, max=49)
    height_m: float = option(0.11, "Of the marker above the floor.", min=0, max=2)
    seconds: float | None = option(
        None, "End by itself, a camera or SteamVR; Ctrl-C does it, too.", min=0.5
    )
    camera: Path | None = option(
        None,
        "Calibration of this camera, by `workstation calibrate camera --calibration "
        "FOLDER`. Without, focal length and distortion are found from the marker.",
        panel=_CAMERA,
        metavar="FOLDER",
    )
    fov_deg: float = option(
        65.0,
        "The camera's horizontal field of view, roughly; webcams have 55 to 80.",
        panel=_CAMERA,
        min=15,
        max=140,
    )
    corners: tuple[float, float] | None = option(
        None,
        "Markers 1, 2, 3, 4 lie on the floor, clockwise at the corners of a rectangle; "
        "distances 1 to 2 and 2 to 3, centre to centre. Otherwise the robot's marker tells "
        "where the floor is.",
        panel=_FLOOR,
        metavar="WIDTH_M DEPTH_M",
    )
    board_mm: float | None = option(
        None,
        "The printed ChArUco board lies on the floor, with squares of this size.",
        panel=_FLOOR,
        min=5,
        max=500,
    )
    serial: str | None = option(None, "Which device, where SteamVR sees several.", panel=_STEAMVR)
    rate: float = option(90.0, "Of poses.", panel=_STEAMVR, metavar="HZ", min=1, max=500)


@with_options
def track(options: TrackOptions) -> None:
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
    from mbot_workstation.measure.tracks.track_file import check_new

    if options.corners is not None and options.board_mm is not None:
        raise ConfigurationError("--corners and --board-mm exclude each other")
    if options.corners is not None and not all(0.1 <= side <= 20 for side in options.corners):
        raise ConfigurationError(
            f"--corners are {options.corners[0]:g} and {options.corners[1]:g} m apart, expected "
            "0.1 to 20"
        )
    check_new(options.output)
    with stop_signals(options.seconds) as stop:
        if options.source == OPENVR:
            _record_openvr(options.output, options.serial, options.rate, stop)
        else:
            _track_marker(options, stop)


def _track_marker(options: TrackOptions, stop: "threading.Event") -> None:
    from mbot_workstation.measure.tracking.marker_track import (
        MarkerSettings,
        floor_finder,
        track_marker,
    )
    from mbot_workstation.measure.tracking.overhead_camera import camera_for

    settings = MarkerSettings(
        marker_id=options.marker_id,
        edge_m=options.marker_mm / 1000,
        height_m=options.height_m,
        camera_for=camera_for(options.camera, options.fov_deg),
        camera_is_known=options.camera is not None,
        find_floor=floor_finder(options.corners, options.board_mm),
    )
    reporter = _Reporter()
    result = track_marker(
        options.source,
        options.output,
        settings,
        stop,
        lambda watch: reporter.say(
            f"marker {options.marker_id} in {len(watch.sights)} of {watch.pictures} pictures"
        ),
    )
    print(
        f"{options.output}: {len(result.track)} poses in {result.track.duration_s:.1f} s; camera "
        f"{result.distance_m:.2f} m above the marker, tilted by {result.tilt_deg:.0f} degrees; the "
        f"marker's corners are off by {result.error_px:.2f} pixels"
    )
    if options.corners is not None or options.board_mm is not None:
        print(
            f"the marker measures {result.edge_mm:.1f} mm there, {options.marker_mm:g} were "
            "declared"
        )


def _record_openvr(
    output: Path, serial: str | None, rate_hz: float, stop: "threading.Event"
) -> None:
    from mbot_workstation.measure.tracking.openvr_tracker import (
        OpenVrTracker,
        load_openvr,
        record_poses,
    )
    from mbot_workstation.measure.tracks.track_file import TrackFile

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
        self._next_s = time.monotonic() + REPORT_EVERY_S

    def say(self, text: str) -> None:
        """The text, if it is time for one."""
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + REPORT_EVERY_S
            print(text, file=sys.stderr, flush=True)

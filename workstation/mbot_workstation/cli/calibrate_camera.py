"""`workstation calibrate camera`: focal length, optical axis and distortion from photographs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.simulation_options import calibration_output_option
from mbot_workstation.measure.targets.specifications import (
    BOARD_DICTIONARY,
    BOARD_MARKER_SHARE,
    BOARD_SQUARE_MM,
    Board,
)

if TYPE_CHECKING:
    from mbot_workstation.measure.calibration.camera.camera_fit import CameraFit
    from mbot_workstation.measure.calibration.camera.camera_pictures import SeenBoards
    from mbot_workstation.measure.calibration.camera.camera_quality import CameraQuality

_BOARD, _LIVE = "Board", "Live"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """What `camera` takes."""

    photos: list[Path] | None = argument(
        "Pictures of the board, or a folder of them.", default=None, metavar="[PHOTO]..."
    )
    calibration: Path = calibration_output_option()
    live: str | None = option(
        None,
        "Take the pictures now: a device (0, /dev/video0), a stream's URL or a film. Ends "
        "by itself or with Ctrl-C.",
        panel=_LIVE,
        metavar="SOURCE",
    )
    count: int = option(25, "Pictures to take.", panel=_LIVE, min=3, max=200)
    inner_corners: str | None = option(
        None,
        "Corners inside the board where four squares meet; found by itself if not given.",
        panel=_BOARD,
        metavar="COLUMNSxROWS",
    )
    charuco: bool = option(False, "The board has markers.", "--charuco", panel=_BOARD)
    square_mm: float = option(BOARD_SQUARE_MM, "Edge of a square.", panel=_BOARD, min=1, max=500)
    marker_mm: float | None = option(
        None,
        f"Edge of a marker; {BOARD_MARKER_SHARE:g} of a square's if not given.",
        panel=_BOARD,
        min=0.5,
        max=475,
    )
    dictionary: str = option(BOARD_DICTIONARY, "Of the markers.", panel=_BOARD, metavar="NAME")
    keep_outliers: bool = option(
        False, "Fit to every picture, also those that don't fit.", "--keep-outliers"
    )
    force: bool = option(False, "Write the result even if it is too poor.", "--force")
    as_json: bool = json_option()


@with_options
def camera(options: CameraOptions) -> None:
    """Calibrate the camera with photographs of a board, and write camera.toml and camera.png.

    Print a board by `workstation print board`. Take 20 pictures or more with the robot's own
    camera in the mode it drives with: the board near enough to fill half of the view, tilted every
    way, also in the corners of the view; sharp and still. Sizes may differ if all show the same
    view. On the Pi, with mbot-agent stopped:
    `rpicam-still --mode 2028:1520 --width 2028 --height 1520 -o 01.jpg`.

    Examples:

    - `workstation calibrate camera photos/*.jpg`
    - `workstation calibrate camera photos --inner-corners 9x6 --calibration calibration/mbot-2`
    - `workstation calibrate camera --live tcp://mbot-1.local:8888` while the Pi runs
      `rpicam-vid -t 0 --mode 2028:1520 --width 1014 --height 760 --codec mjpeg --listen
      -o tcp://0.0.0.0:8888`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.cli.camera_fit_words import fields, print_table, print_words

    photos = options.photos
    boards = _boards(
        options.inner_corners,
        options.charuco,
        options.square_mm,
        options.marker_mm,
        options.dictionary,
    )
    if (options.live is None) == (not photos):
        raise ConfigurationError("give either photographs or --live SOURCE")
    if options.live is not None:
        photos = _collect(
            options.live, boards, options.calibration / "camera-pictures", options.count
        )
    seen, fit, quality = _calibrate(photos or [], boards, keep_outliers=options.keep_outliers)
    refused = bool(quality.objections) and not options.force
    if not options.as_json:
        print_table(fit)
        print_words(seen, fit, quality)
    written = None if refused else _write(fit, options.calibration)
    _draw(
        fit,
        options.calibration / ("camera-refused.png" if refused else "camera.png"),
        as_json=options.as_json,
    )
    if options.as_json:
        import json

        print(json.dumps(fields(seen, fit, quality, written), indent=2))
    elif written:
        print(f"wrote {written}")
    if refused:
        raise ConfigurationError(
            f"too poor to be used: {'; '.join(quality.objections)} (--force writes it all the same)"
        )


def _boards(
    inner_corners: str | None,
    charuco: bool,
    square_mm: float,
    marker_mm: float | None,
    dictionary: str,
) -> list[Board]:
    """The boards named by the options; none if they are to be guessed."""
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.targets.specifications import (
        BOARD_COLUMNS,
        BOARD_ROWS,
        charuco_board,
    )

    charuco = charuco or marker_mm is not None or dictionary != BOARD_DICTIONARY
    if inner_corners is None and not charuco:
        return []
    columns, rows = BOARD_COLUMNS, BOARD_ROWS
    if inner_corners is not None:
        across, _, down = inner_corners.lower().partition("x")
        if not (across.isdecimal() and down.isdecimal()):
            raise ConfigurationError(
                f"--inner-corners is {inner_corners!r}, expected COLUMNSxROWS such as 9x7"
            )
        columns, rows = int(across) + 1, int(down) + 1
    share = BOARD_MARKER_SHARE if marker_mm is None else marker_mm / square_mm
    try:
        board = Board(columns, rows, square_mm, charuco, dictionary, share)
        if charuco:
            charuco_board(board)
        return [board]
    except ValueError as error:
        raise ConfigurationError(
            f"{error} (--inner-corners, --square-mm, --marker-mm, --dictionary)"
        ) from None


def _collect(source: str, boards: list[Board], folder: Path, count: int) -> list[Path]:
    from rich.console import Console

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.calibration.camera.camera_live import FrameVerdict, collect

    console = Console(stderr=True)
    looked_for = boards or [Board(charuco=True), Board()]  # the one that is quicker to rule out
    console.print(
        f"hold a {' or a '.join(board.name for board in looked_for)} before the camera, tilt it "
        "and move it all over the view; a picture is taken whenever it is still; Ctrl-C ends",
        highlight=False,
        soft_wrap=True,
    )
    with console.status("waiting for the camera") as status:

        def tell(verdict: FrameVerdict, taken: int, empty: tuple[str, ...]) -> None:
            missing = f"; still empty: {', '.join(empty)}" if empty else ""
            words = f"{taken} of {count} pictures, {verdict.value}{missing}"
            status.update(words)
            if verdict is FrameVerdict.TAKEN and not console.is_terminal:
                console.print(words, highlight=False, soft_wrap=True)

        taken = collect(source, looked_for, folder, count, tell)
    if not taken:
        raise ConfigurationError(
            f"no picture taken from {source}: the board was never found standing still"
        )
    console.print(f"{len(taken)} pictures in {folder}", highlight=False, soft_wrap=True)
    return taken


def _calibrate(
    photos: list[Path], boards: list[Board], *, keep_outliers: bool
) -> "tuple[SeenBoards, CameraFit, CameraQuality]":
    from rich.console import Console
    from rich.progress import Progress

    from mbot_workstation.measure.calibration.camera.camera_fit import fit_camera
    from mbot_workstation.measure.calibration.camera.camera_pictures import look_for_boards
    from mbot_workstation.measure.calibration.camera.camera_quality import judge
    from mbot_workstation.pictures.picture_file import picture_files

    files = picture_files(photos)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("looking for the board", total=len(files))
        seen = look_for_boards(files, boards, lambda done: progress.update(task, completed=done))
    fit = fit_camera(seen.sightings, keep_outliers=keep_outliers)
    return seen, fit, judge(fit)


def _write(fit: "CameraFit", folder: Path) -> Path:
    from datetime import datetime

    from mbot_protocol.drive.calibration import CameraCalibration
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.sim.calibrated.calibration_folder import write_camera

    model = fit.camera
    try:
        calibration = CameraCalibration(
            width_px=model.width_px,
            height_px=model.height_px,
            focal_x_px=model.focal_x_px,
            focal_y_px=model.focal_y_px,
            principal_x_px=model.principal_x_px,
            principal_y_px=model.principal_y_px,
            distortion=model.distortion,
            reprojection_error_px=fit.error_px,
            pictures=len(fit.kept),
            made_on=datetime.now().astimezone().date().isoformat(),
        )
    except ValueError as error:
        raise ConfigurationError(f"these pictures fit no usable camera: {error}") from None
    return write_camera(folder, calibration)


def _draw(fit: "CameraFit", path: Path, *, as_json: bool) -> None:
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.calibration.camera.camera_drawing import draw_calibration

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    draw_calibration(fit, path)
    if not as_json:
        print(f"wrote {path}")

"""`workstation calibrate camera` and `light`: the lens from a board, the light from a gray card."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import calibration_output_option, json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer, table, working
from mbot_workstation.measure.targets.specifications import (
    BOARD_COLUMNS,
    BOARD_DICTIONARY,
    BOARD_MARKER_SHARE,
    BOARD_ROWS,
    BOARD_SQUARE_MM,
    Board,
)

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from mbot_workstation.measure.calibration.camera.camera_result import CameraResult
    from mbot_workstation.measure.calibration.light.light_measurement import LightMeasurement

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
def camera(options: CameraOptions) -> Answer:
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
    from mbot_workstation.measure.calibration.camera.camera_fit import fit_camera
    from mbot_workstation.measure.calibration.camera.camera_pictures import look_for_boards
    from mbot_workstation.measure.calibration.camera.camera_quality import judge
    from mbot_workstation.measure.calibration.camera.camera_result import (
        camera_lines,
        camera_result,
        save_camera,
    )
    from mbot_workstation.pictures.picture_file import picture_files

    boards = _boards(options)
    photos = options.photos or []
    if (options.live is None) == (not photos):
        raise ConfigurationError("give either photographs or --live SOURCE")
    if options.live is not None:
        folder = options.calibration / "camera-pictures"
        photos = _collect(options.live, boards, folder, options.count)
    files = picture_files(photos)
    with working("looking for the board", len(files)) as done:
        seen = look_for_boards(files, boards, done)
    fit = fit_camera(seen.sightings, keep_outliers=options.keep_outliers)
    quality = judge(fit)
    refused = bool(quality.objections) and not options.force
    written, drawing = save_camera(fit, options.calibration, refused=refused)
    result = camera_result(seen, fit, quality, written)
    wrote = [f"wrote {path}" for path in (drawing, written) if path]
    error = ConfigurationError(
        f"too poor to be used: {'; '.join(quality.objections)} (--force writes it all the same)",
        kind="poor-calibration",
        objections=quality.objections,
    )
    return Answer(
        result,
        [_pictures_table(result), *camera_lines(seen, fit, quality), *wrote],
        error=error if refused else None,
    )


def _pictures_table(result: "CameraResult") -> "Table":
    """A line a picture: what was seen in it, and how well it fits."""
    headings = ("picture", "size", "corners", "distance", "tilt", "error", "")
    rows = [
        (
            one.name,
            f"{one.width_px} x {one.height_px}",
            str(one.corners),
            f"{one.distance_m:.2f} m",
            f"{one.tilt_deg:.0f}°",
            f"{one.error_px:.3f} px",
            "" if one.kept else "left out",
        )
        for one in result.pictures
    ]
    return table(headings, rows, right=headings[1:-1])


def _boards(options: CameraOptions) -> list[Board]:
    """The boards named by the options; none if they are to be guessed."""
    from mbot_workstation.measure.targets.specifications import charuco_board

    marker_mm, named = options.marker_mm, options.inner_corners
    charuco = options.charuco or marker_mm is not None or options.dictionary != BOARD_DICTIONARY
    if named is None and not charuco:
        return []
    columns, rows = BOARD_COLUMNS, BOARD_ROWS
    if named is not None:
        across, _, down = named.lower().partition("x")
        if not (across.isdecimal() and down.isdecimal()):
            raise ConfigurationError(
                f"--inner-corners is {named!r}, expected COLUMNSxROWS such as 9x7"
            )
        columns, rows = int(across) + 1, int(down) + 1
    share = BOARD_MARKER_SHARE if marker_mm is None else marker_mm / options.square_mm
    try:
        board = Board(columns, rows, options.square_mm, charuco, options.dictionary, share)
        if charuco:
            charuco_board(board)
        return [board]
    except ValueError as error:
        raise ConfigurationError(
            f"{error} (--inner-corners, --square-mm, --marker-mm, --dictionary)"
        ) from None


def _collect(source: str, boards: list[Board], folder: Path, count: int) -> list[Path]:
    from rich.console import Console

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


@dataclass(frozen=True, slots=True, kw_only=True)
class LightOptions:
    """What `light` takes."""

    photos: list[Path] = argument(
        "Photographs of the card, or a folder of them.", metavar="PHOTO..."
    )
    calibration: Path = calibration_output_option()
    card: str | None = option(
        None,
        "Where the card is in the photographs, in pixels; found by itself if not given.",
        metavar="X,Y,WIDTH,HEIGHT",
    )
    card_mm: tuple[float, float] = option(
        (127.0, 102.0), "Of the card in its printed frame.", metavar="WIDTH HEIGHT"
    )
    reflectance: float = option(18.0, "Of the gray card.", metavar="PERCENT", min=3, max=95)
    three_patches: bool = option(
        False, "The card is white, gray and black side by side.", "--three-patches"
    )
    facing: list[str] | None = option(
        None,
        "Without the frame: how far the card is turned to the robot's left from facing "
        "the robot, and tilted up, in degrees; once a photograph, in their order.",
        metavar="LEFT:UP",
    )
    heading: float = option(
        0.0,
        "Where the robot looked, to the left of the middle of its room's panorama.",
        metavar="DEGREES",
        min=-360,
        max=360,
    )
    as_json: bool = json_option()


@with_options
def light(options: LightOptions) -> Answer:
    """Match the simulation's light to photographs of a gray card, and write light.toml.

    Put the card into the frame of `workstation print gray-card`. Let the robot stand at its start
    and photograph the card half a metre ahead with its own camera, exposure and white balance as
    when it drives: at least four times, the card turned left, right, up and towards the window or
    lamp. In one facing only exposure and white balance can be told.

    Examples:

    - `workstation calibrate light gray/*.jpg`
    - `workstation calibrate light a.png b.png c.png d.png --card 140,90,40,40
      --facing 0:0 --facing 45:0 --facing -45:0 --facing 0:50`
    """
    from mbot_workstation.measure.calibration.light.light_measurement import (
        CardSettings,
        measure_light,
    )
    from mbot_workstation.measure.calibration.light.light_result import save_light
    from mbot_workstation.pictures.picture_file import picture_files
    from mbot_workstation.sim.body.robot_parameters import RobotParameters
    from mbot_workstation.sim.calibrated.calibration_folder import read_calibration

    settings = CardSettings(
        options.card_mm,
        options.reflectance / 100,
        options.three_patches,
        _rectangle(options.card),
        tuple(_facing(text) for text in options.facing or ()),
    )
    files, known = picture_files(options.photos), options.calibration.is_dir()
    robot = read_calibration(options.calibration).robot if known else RobotParameters()
    with working("looking for the gray card", len(files)) as done:
        measured = measure_light(files, robot, settings, done)
    result = save_light(measured, options.calibration, options.heading)
    return Answer(result, _light_words(measured, result.path))


def _rectangle(text: str | None) -> tuple[int, int, int, int] | None:

    if text is None:
        return None
    parts = text.split(",")
    if len(parts) != 4 or not all(part.strip().isdecimal() for part in parts):
        raise ConfigurationError(
            f"--card is {text!r}, expected X,Y,WIDTH,HEIGHT such as 140,90,40,40"
        )
    left, top, width, height = (int(part) for part in parts)
    return left, top, width, height


def _facing(text: str) -> tuple[float, float]:

    left, separator, up = text.partition(":")
    try:
        turned = float(left), float(up) if separator else 0.0
    except ValueError:
        turned = (float("nan"), 0.0)
    if not (abs(turned[0]) <= 89 and abs(turned[1]) <= 90):  # also false for NaN
        raise ConfigurationError(
            f"--facing is {text!r}, expected LEFT:UP in degrees such as 45:0 or 0:-30, up to 89 "
            "and 90: beyond, the camera can't see the card"
        )
    return turned


def _light_words(measured: "LightMeasurement", path: Path) -> "Iterator[RenderableType]":
    from mbot_workstation.measure.calibration.light.light_result import light_lines, photograph_rows

    headings = ("photograph", "levels", "turned", "simulated", "off by", "calibrated", "off by")
    yield table(headings, photograph_rows(measured), right=headings[1:])
    yield from light_lines(measured)
    yield f"wrote {path} and {path.with_name('light.png').name}"

"""`workstation print`: boards and markers to print at their exact size."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.files import atomic_file
from mbot_workstation.cli.options import option, with_options
from mbot_workstation.measure.targets.specifications import (
    BOARD_COLUMNS,
    BOARD_ROWS,
    BOARD_SQUARE_MM,
    ROBOT_MARKER_EDGE_MM,
    ROBOT_MARKER_ID,
)

if TYPE_CHECKING:
    from mbot_workstation.measure.targets.sheet import Page, Paper

app = typer.Typer(
    help="Write pages to print at their exact size: boards for the camera, a marker for the robot.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

PaperOption = Annotated[str, typer.Option("--paper", metavar="NAME", help="a4, letter or a3.")]
OutputOption = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="A .pdf, .svg or .png; the ending says which."
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardOptions:
    """What `board` takes."""

    charuco: bool = option(
        False,
        "With markers in the white squares: a part of the board in view is enough. Needs "
        "pictures at least 1000 pixels wide, or a board nearby.",
        "--charuco",
    )
    columns: int = option(BOARD_COLUMNS, "Squares across.")
    rows: int = option(BOARD_ROWS, "Squares down.")
    square_mm: float = option(BOARD_SQUARE_MM, "Edge of a square.")
    paper: str = option("a4", "a4, letter or a3.", "--paper", metavar="NAME")
    output: Path | None = option(
        None, "A .pdf, .svg or .png; the ending says which.", "--output", "-o", metavar="FILE"
    )


@app.command("board")
@with_options
def board(options: BoardOptions) -> None:
    """A board to photograph with the robot's camera: checkerboard, or ChArUco.

    Print at 100 %, check the 100 mm scale with a ruler, glue the sheet on something flat.

    Examples:

    - `workstation print board` writes board.pdf
    - `workstation print board --charuco --paper letter -o charuco.pdf`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.targets.layouts import board_page
    from mbot_workstation.measure.targets.specifications import Board, charuco_board

    try:
        wanted = Board(options.columns, options.rows, options.square_mm, options.charuco)
        if options.charuco:
            charuco_board(wanted)
    except ValueError as error:
        raise ConfigurationError(f"{error} (--columns, --rows, --square-mm)") from None
    _write(board_page(wanted, _paper(options.paper)), options.output or Path("board.pdf"))
    if not wanted.tells_mirrored:
        print(
            "note: with an odd number of squares along one side nobody can tell a mirrored "
            "picture of it from a good one"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerOptions:
    """What `marker` takes."""

    number: int = option(ROBOT_MARKER_ID, "Of the marker; one a robot.", "--id", min=0, max=49)
    edge_mm: float = option(ROBOT_MARKER_EDGE_MM, "Of its black square.", min=20, max=250)
    paper: str = option("a4", "a4, letter or a3.", "--paper", metavar="NAME")
    output: Path | None = option(
        None, "A .pdf, .svg or .png; the ending says which.", "--output", "-o", metavar="FILE"
    )


@app.command("marker")
@with_options
def marker(options: MarkerOptions) -> None:
    """The marker for the top of the robot, which `workstation track` follows.

    Example: `workstation print marker` writes marker.pdf
    """
    from mbot_workstation.measure.targets.layouts import marker_page

    _write(
        marker_page(options.number, options.edge_mm, _paper(options.paper)),
        options.output or Path("marker.pdf"),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GrayCardOptions:
    """What `gray_card` takes."""

    card_mm: tuple[float, float] = option(
        (127.0, 102.0), "Of the gray card that goes into it.", metavar="WIDTH HEIGHT"
    )
    paper: str = option("a4", "a4, letter or a3.", "--paper", metavar="NAME")
    output: Path | None = option(
        None, "A .pdf, .svg or .png; the ending says which.", "--output", "-o", metavar="FILE"
    )


@app.command("gray-card")
@with_options
def gray_card(options: GrayCardOptions) -> None:
    """A frame of four markers around a gray card: `calibrate light` sees how the card is turned.

    Example: `workstation print gray-card --card-mm 85 54` writes gray-card.pdf
    """
    from mbot_workstation.measure.targets.layouts import card_page

    _write(
        card_page(options.card_mm, _paper(options.paper)), options.output or Path("gray-card.pdf")
    )


def _paper(name: str) -> "Paper":
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.targets.sheet import PAPERS

    if name.lower() not in PAPERS:
        raise ConfigurationError(f"--paper is {name!r}, expected one of {', '.join(PAPERS)}")
    return PAPERS[name.lower()]


def _write(page: "Page", path: Path) -> None:
    from mbot_protocol.errors import ConfigurationError

    ending = path.suffix.lower()
    if ending == ".pdf":
        from mbot_workstation.measure.targets.page_files import to_pdf as encode
    elif ending == ".svg":
        from mbot_workstation.measure.targets.page_files import to_svg as encode
    elif ending == ".png":
        from mbot_workstation.measure.targets.page_files import to_png as encode
    else:
        raise ConfigurationError(
            f"can't write {path}: expected a file ending in .pdf, .svg or .png"
        )
    atomic_file.save(path, encode(page))
    print(
        f"wrote {path}: {page.title} on {page.width_mm:g} x {page.height_mm:g} mm; print it at "
        "100 % and check its scale with a ruler"
    )

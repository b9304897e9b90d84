"""`workstation print`: boards and markers to print at their exact size."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.options import option, with_options
from mbot_workstation.cli.presenter import Answer
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """What every page takes."""

    paper: str = option("a4", "a4, letter or a3.", "--paper", metavar="NAME")
    output: Path | None = option(
        None, "A .pdf, .svg or .png; the ending says which.", "--output", "-o", metavar="FILE"
    )

    def on_paper(self) -> "Paper":
        """The paper that is named; raises ConfigurationError."""
        from mbot_workstation.measure.targets.sheet import PAPERS

        if self.paper.lower() not in PAPERS:
            raise ConfigurationError(
                f"--paper is {self.paper!r}, expected one of {', '.join(PAPERS)}"
            )
        return PAPERS[self.paper.lower()]

    def written(self, page: "Page", usual: str, *notes: str) -> Answer:
        """The page in its file, and what to look at when it is printed."""
        from mbot_workstation.measure.targets.page_file import save_page

        path = self.output or Path(usual)
        save_page(path, page)
        words = (
            f"wrote {path}: {page.title} on {page.width_mm:g} x {page.height_mm:g} mm; print it at "
            "100 % and check its scale with a ruler"
        )
        return Answer(str(path), [words, *notes])


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardOptions(PageOptions):
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


@app.command("board")
@with_options
def board(options: BoardOptions) -> Answer:
    """A board to photograph with the robot's camera: checkerboard, or ChArUco.

    Print at 100 %, check the 100 mm scale with a ruler, glue the sheet on something flat.

    Examples:

    - `workstation print board` writes board.pdf
    - `workstation print board --charuco --paper letter -o charuco.pdf`
    """
    from mbot_workstation.measure.targets.layouts import board_page
    from mbot_workstation.measure.targets.specifications import Board, charuco_board

    try:
        wanted = Board(options.columns, options.rows, options.square_mm, options.charuco)
        if options.charuco:
            charuco_board(wanted)
    except ValueError as error:
        raise ConfigurationError(f"{error} (--columns, --rows, --square-mm)") from None
    mirrored = (
        "note: with an odd number of squares along one side nobody can tell a mirrored picture of "
        "it from a good one"
    )
    page = board_page(wanted, options.on_paper())
    return options.written(page, "board.pdf", *(() if wanted.tells_mirrored else (mirrored,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerOptions(PageOptions):
    """What `marker` takes."""

    number: int = option(ROBOT_MARKER_ID, "Of the marker; one a robot.", "--id", min=0, max=49)
    edge_mm: float = option(ROBOT_MARKER_EDGE_MM, "Of its black square.", min=20, max=250)


@app.command("marker")
@with_options
def marker(options: MarkerOptions) -> Answer:
    """The marker for the top of the robot, which `workstation track` follows.

    Example: `workstation print marker` writes marker.pdf
    """
    from mbot_workstation.measure.targets.layouts import marker_page

    page = marker_page(options.number, options.edge_mm, options.on_paper())
    return options.written(page, "marker.pdf")


@dataclass(frozen=True, slots=True, kw_only=True)
class GrayCardOptions(PageOptions):
    """What `gray_card` takes."""

    card_mm: tuple[float, float] = option(
        (127.0, 102.0), "Of the gray card that goes into it.", metavar="WIDTH HEIGHT"
    )


@app.command("gray-card")
@with_options
def gray_card(options: GrayCardOptions) -> Answer:
    """A frame of four markers around a gray card: `calibrate light` sees how the card is turned.

    Example: `workstation print gray-card --card-mm 85 54` writes gray-card.pdf
    """
    from mbot_workstation.measure.targets.layouts import card_page

    return options.written(card_page(options.card_mm, options.on_paper()), "gray-card.pdf")

"""`workstation print`: boards and markers to print at their exact size."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_workstation.targets.specifications import (
    BOARD_COLUMNS,
    BOARD_ROWS,
    BOARD_SQUARE_MM,
    ROBOT_MARKER_EDGE_MM,
    ROBOT_MARKER_ID,
)

if TYPE_CHECKING:
    from mbot_workstation.targets.sheet import Page, Paper

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


@app.command("board")
def board(
    *,
    charuco: Annotated[
        bool,
        typer.Option(
            "--charuco",
            help="With markers in the white squares: a part of the board in view is enough. Needs "
            "pictures at least 1000 pixels wide, or a board nearby.",
        ),
    ] = False,
    columns: Annotated[int, typer.Option(help="Squares across.")] = BOARD_COLUMNS,
    rows: Annotated[int, typer.Option(help="Squares down.")] = BOARD_ROWS,
    square_mm: Annotated[float, typer.Option(help="Edge of a square.")] = BOARD_SQUARE_MM,
    paper: PaperOption = "a4",
    output: OutputOption = None,
) -> None:
    """A board to photograph with the robot's camera: checkerboard, or ChArUco.

    Print at 100 %, check the 100 mm scale with a ruler, glue the sheet on something flat.

    Examples:

    - `workstation print board` writes board.pdf
    - `workstation print board --charuco --paper letter -o charuco.pdf`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.targets.layouts import board_page
    from mbot_workstation.targets.specifications import Board, charuco_board

    try:
        wanted = Board(columns, rows, square_mm, charuco)
        if charuco:
            charuco_board(wanted)
    except ValueError as error:
        raise ConfigurationError(f"{error} (--columns, --rows, --square-mm)") from None
    _write(board_page(wanted, _paper(paper)), output or Path("board.pdf"))
    if not wanted.tells_mirrored:
        print(
            "note: with an odd number of squares along one side nobody can tell a mirrored "
            "picture of it from a good one"
        )


@app.command("marker")
def marker(
    *,
    number: Annotated[
        int, typer.Option("--id", min=0, max=49, help="Of the marker; one a robot.")
    ] = ROBOT_MARKER_ID,
    edge_mm: Annotated[
        float, typer.Option(min=20, max=250, help="Of its black square.")
    ] = ROBOT_MARKER_EDGE_MM,
    paper: PaperOption = "a4",
    output: OutputOption = None,
) -> None:
    """The marker for the top of the robot, which `workstation track` follows.

    Example: `workstation print marker` writes marker.pdf
    """
    from mbot_workstation.targets.layouts import marker_page

    _write(marker_page(number, edge_mm, _paper(paper)), output or Path("marker.pdf"))


@app.command("gray-card")
def gray_card(
    *,
    card_mm: Annotated[
        tuple[float, float],
        typer.Option(metavar="WIDTH HEIGHT", help="Of the gray card that goes into it."),
    ] = (127.0, 102.0),
    paper: PaperOption = "a4",
    output: OutputOption = None,
) -> None:
    """A frame of four markers around a gray card: `calibrate light` sees how the card is turned.

    Example: `workstation print gray-card --card-mm 85 54` writes gray-card.pdf
    """
    from mbot_workstation.targets.layouts import card_page

    _write(card_page(card_mm, _paper(paper)), output or Path("gray-card.pdf"))


def _paper(name: str) -> "Paper":
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.targets.sheet import PAPERS

    if name.lower() not in PAPERS:
        raise ConfigurationError(f"--paper is {name!r}, expected one of {', '.join(PAPERS)}")
    return PAPERS[name.lower()]


def _write(page: "Page", path: Path) -> None:
    from mbot_protocol.errors import ConfigurationError

    ending = path.suffix.lower()
    if ending == ".pdf":
        from mbot_workstation.targets.pdf import to_pdf as encode
    elif ending == ".svg":
        from mbot_workstation.targets.svg_page import to_svg as encode
    elif ending == ".png":
        from mbot_workstation.targets.png import to_png as encode
    else:
        raise ConfigurationError(
            f"can't write {path}: expected a file ending in .pdf, .svg or .png"
        )
    try:
        path.write_bytes(encode(page))
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    print(
        f"wrote {path}: {page.title} on {page.width_mm:g} x {page.height_mm:g} mm; print it at "
        "100 % and check its scale with a ruler"
    )

"""The printed targets: boards for the camera, markers on the robot and around the gray card.

What is printed and what is looked for in pictures must be the same, so both read it here. Nothing
heavy is imported before a target is asked for: the commands' help shows these numbers.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MARKER_DICTIONARY = "DICT_4X4_50"
"""Of the robot's and the gray card's markers: 6 cells a side with its border, so each cell is as
large as it gets in a webcam's picture from the ceiling."""

ROBOT_MARKER_ID = 7
"""On top of the robot; its printed top edge points forward."""

ROBOT_MARKER_EDGE_MM = 80.0
"""With its white margin (one cell) 107 mm: covers the mCore board, stays within the circle of
90 mm radius that is the robot for the task, and is 40 pixels in a 1920 pixels wide picture of
4 m."""

CARD_MARKER_IDS = (40, 41, 42, 43)
"""Around the gray card: upper left, upper right, lower right, lower left."""

CARD_MARKER_EDGE_MM = 35.0

BOARD_DICTIONARY = "DICT_5X5_100"
"""Of the ChArUco board: another one, so that a board in view is never taken for the robot."""

BOARD_COLUMNS, BOARD_ROWS = 10, 8
"""Squares. Both even: only then does a mirrored checkerboard differ from an upright one."""

BOARD_SQUARE_MM = 20.0
"""200 x 160 mm: fits A4 and Letter with a white margin of more than a square, which the detectors
need."""

BOARD_MARKER_SHARE = 0.75
"""Of a square's edge: 15 mm of 20."""


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board of black and white squares.

    Attributes:
        columns, rows: squares, at least 3 each.
        square_mm: edge of a square; only matters where distances are measured.
        charuco: with an ArUco marker in every white square, so that a part of it is enough.
        dictionary: of its markers, by OpenCV's name.
        marker_share: edge of a marker against that of a square.

    """

    columns: int = BOARD_COLUMNS
    rows: int = BOARD_ROWS
    square_mm: float = BOARD_SQUARE_MM
    charuco: bool = False
    dictionary: str = BOARD_DICTIONARY
    marker_share: float = BOARD_MARKER_SHARE

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 4 or max(self.columns, self.rows) > 30:
            raise ValueError(f"board has {self.columns} x {self.rows} squares, expected 4 to 30")
        if not 1 <= self.square_mm <= 500:
            raise ValueError(f"squares are {self.square_mm:g} mm, expected 1 to 500")
        if not 0.2 <= self.marker_share <= 0.95:
            raise ValueError(
                f"markers are {self.marker_share:g} of a square's edge, expected 0.2 to 0.95"
            )

    @property
    def inner_corners(self) -> tuple[int, int]:
        """Corners where four squares meet: columns, rows."""
        return self.columns - 1, self.rows - 1

    @property
    def marker_mm(self) -> float:
        """Edge of a ChArUco board's markers."""
        return self.marker_share * self.square_mm

    @property
    def tells_mirrored(self) -> bool:
        """Whether a mirrored picture of it can be told from a good one.

        A checkerboard with an odd number of squares along one side is its own mirror image.
        """
        return self.charuco or (self.columns % 2 == 0 and self.rows % 2 == 0)

    @property
    def name(self) -> str:
        """As a person would say it."""
        kind = "ChArUco board" if self.charuco else "checkerboard"
        return f"{kind} of {self.columns} x {self.rows} squares"

    def corner_points(self) -> "NDArray[np.float32]":
        """The inner corners on the board. Shape (n, 3), metres, row by row, z = 0.

        x runs along the columns, y down the rows, as OpenCV counts a ChArUco board's corners.
        """
        import numpy as np

        columns, rows = self.inner_corners
        x, y = np.meshgrid(np.arange(1, columns + 1), np.arange(1, rows + 1))
        places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)
        return (places * self.square_mm / 1000).astype(np.float32)


def dictionary(name: str) -> Any:
    """One of OpenCV's ArUco dictionaries, by its name in OpenCV.

    Raises:
        ValueError: there is none of this name.

    """
    import cv2

    number = getattr(cv2.aruco, name, None)
    if not name.startswith("DICT_") or number is None:
        raise ValueError(
            f"no ArUco dictionary {name!r}, expected a name such as {BOARD_DICTIONARY}"
        )
    return cv2.aruco.getPredefinedDictionary(number)


def charuco_board(board: Board) -> Any:
    """OpenCV's own description of a ChArUco board, in metres.

    Raises:
        ValueError: the dictionary does not exist, or has too few markers.

    """
    import cv2

    markers = dictionary(board.dictionary)
    needed = board.columns * board.rows // 2
    if len(markers.bytesList) < needed:
        raise ValueError(
            f"{board.dictionary} has {len(markers.bytesList)} markers, a {board.name} needs "
            f"{needed}"
        )
    return cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_mm / 1000, board.marker_mm / 1000, markers
    )


def marker_cells(name: str, number: int) -> "NDArray[np.bool_]":
    """The cells of a marker with its black border, True where black.

    Args:
        name: of the dictionary.
        number: which marker.

    Returns:
        Shape (n, n), top row first.

    """
    import cv2

    found = dictionary(name)
    side = int(found.markerSize) + 2
    return cv2.aruco.generateImageMarker(found, number, side) == 0

"""A board seen in a picture: what the camera is fitted to."""

from dataclasses import dataclass

from mbot_workstation.calibration.camera.board_detection import FoundBoard


@dataclass(frozen=True, slots=True)
class Sighting:
    """One picture with a board in it.

    Attributes:
        name: of the picture, for people.
        size: width and height in pixels.
        board: where it is in the picture.

    """

    name: str
    size: tuple[int, int]
    board: FoundBoard

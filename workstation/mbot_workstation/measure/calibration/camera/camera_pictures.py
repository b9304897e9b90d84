"""From picture files to boards seen in them, and what was wrong with the others."""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.board_detection import (
    Grey,
    Sighting,
    find_board,
    most_likely_checkerboard,
)
from mbot_workstation.measure.targets.specifications import BOARD_COLUMNS, BOARD_ROWS, Board
from mbot_workstation.pictures.picture_file import read_picture

LOOKED_AT_FOR_SIZE = 12
"""Pictures in which the size of an unknown checkerboard is looked for, spread over all."""


@dataclass(frozen=True, slots=True)
class SeenBoards:
    """What a set of pictures shows.

    Attributes:
        sightings: boards found, not mirrored as far as can be told.
        without: names of pictures without a board.
        boards: which boards were found.
        unreadable: names of files that are not pictures; they were left out.

    """

    sightings: tuple[Sighting, ...]
    without: tuple[str, ...]
    boards: tuple[Board, ...]
    unreadable: tuple[str, ...] = ()


def grey_picture(path: Path) -> Grey:
    """A picture file in grey, shape (h, w).

    Raises:
        ConfigurationError: it can't be read.

    """
    return cast(Grey, cv2.cvtColor(read_picture(path), cv2.COLOR_RGB2GRAY))


def look_for_boards(
    paths: Sequence[Path],
    boards: Sequence[Board],
    looked: Callable[[int], None] = lambda _count: None,
) -> SeenBoards:
    """Find a board in each picture.

    Args:
        paths: the pictures.
        boards: which may be in them, the likeliest first; if none is given, a ChArUco board as
            `workstation print board` makes it, or a checkerboard of any size.
        looked: called with the number of pictures done.

    Raises:
        ConfigurationError: no picture can be read, none shows a board, or one is mirrored.

    """
    given, boards = boards, boards or guess_boards(paths)
    unreadable: list[str] = []
    sightings: list[Sighting] = []
    without: list[str] = []
    seen: list[Board] = []
    for count, path in enumerate(paths, start=1):
        looked(count)
        try:
            picture = grey_picture(path)
        except ConfigurationError:
            if len(unreadable) + 1 == len(paths):
                raise
            # One bad file is no reason to photograph again.
            unreadable.append(path.name)
            continue
        sighting, board = look(picture, path.name, boards)
        if sighting is None or board is None:
            without.append(path.name)
        else:
            sightings.append(sighting)
            seen.append(board)
    if not sightings:
        raise _no_board(paths, given)
    check_not_mirrored(sightings)
    return SeenBoards(
        tuple(sightings), tuple(without), tuple(dict.fromkeys(seen)), tuple(unreadable)
    )


def _no_board(paths: Sequence[Path], boards: Sequence[Board]) -> ConfigurationError:
    wanted = " or ".join(board.name for board in boards) or "checkerboard or ChArUco board"
    others = [board for board in guess_boards(paths) if board not in boards] if boards else []
    if others:
        across, down = others[0].inner_corners
        hint = (
            f"there is a {others[0].name} (--inner-corners {across}x{down}"
            f"{' --charuco' if others[0].charuco else ''}), or leave the board's options out"
        )
    else:
        hint = (
            "is all of it in view, sharp, with a white margin? `workstation print board` makes one "
            f"of {BOARD_COLUMNS} x {BOARD_ROWS} squares; another is named by --inner-corners and "
            "--charuco"
        )
    return ConfigurationError(f"no {wanted} in any of {len(paths)} pictures; {hint}")


def look(
    picture: Grey, name: str, boards: Sequence[Board]
) -> tuple[Sighting, Board] | tuple[None, None]:
    """The first of the boards that is in a grey picture of shape (h, w)."""
    for board in boards:
        found = find_board(picture, board)
        if found is not None:
            size = picture.shape[1], picture.shape[0]
            return Sighting(name, size, found), board
    return None, None


def guess_boards(paths: Sequence[Path]) -> list[Board]:
    """Our ChArUco board if it is in a few of the pictures, and the likeliest checkerboard."""
    step = max(1, len(paths) // LOOKED_AT_FOR_SIZE)
    pictures: list[Grey] = []
    for path in paths[::step][:LOOKED_AT_FOR_SIZE]:
        with contextlib.suppress(ConfigurationError):
            pictures.append(grey_picture(path))
    charuco = Board(charuco=True)
    with_charuco = [find_board(picture, charuco) is not None for picture in pictures]
    rest = [p for p, has_it in zip(pictures, with_charuco, strict=True) if not has_it]
    checkerboard = most_likely_checkerboard(rest)
    return [
        *([charuco] if any(with_charuco) else []),
        *([checkerboard] if checkerboard is not None else []),
    ]


def check_not_mirrored(sightings: Sequence[Sighting]) -> None:
    """Refuse mirrored pictures.

    Raises:
        ConfigurationError: there are some.

    """
    mirrored = [sighting.name for sighting in sightings if sighting.board.mirrored]
    if mirrored:
        raise ConfigurationError(
            f"{len(mirrored)} of {len(sightings)} pictures, such as {mirrored[0]}, show the board "
            "mirrored: left and right are swapped; switch the camera's mirror or flip off (hflip), "
            "or print the board again if the print is mirrored"
        )

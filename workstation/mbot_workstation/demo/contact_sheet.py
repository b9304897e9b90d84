"""One picture of a run: what the robot saw and did, beside its path from above."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.recordings.drive_mcap import read_recording

COLUMNS, ROWS = 6, 4
TILE_PX = 128
CAPTION_PX = 34
GAP_PX = 8
TITLE_PX = 44
INK, FAINT, PAPER = (40, 40, 40), (150, 150, 150), (250, 250, 248)
FORWARD, BACKWARD = (20, 130, 60), (200, 90, 20)


@dataclass(frozen=True, slots=True)
class Moment:
    """What the policy saw, shape (64, 64, 3) RGB, and the decision it took."""

    observation: Picture
    decision: Decision


def moments(recording: Path) -> list[Moment]:
    """The recorded decisions in which the policy was asked, each with its picture."""
    pictures: dict[int, bytes] = {}
    decisions: list[Decision] = []
    for _, message in read_recording(recording):
        if isinstance(message, CompressedImage):
            pictures[message.timestamp.ToNanoseconds()] = message.data
        elif message.HasField("action"):
            decisions.append(message)
    found: list[Moment] = []
    for decision in decisions:
        jpeg = pictures.get(decision.unix_time_ns)
        if jpeg is None:
            continue
        bgr = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        if bgr is not None:
            found.append(Moment(cast(Picture, cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)), decision))
    return found


def contact_sheet(seen: Sequence[Moment], path: Picture | None, title: str) -> Picture:
    """Arrange up to 24 moments, evenly over the run, and the path.

    Args:
        seen: from `moments`.
        path: from `draw_path`; None leaves it out.
        title: one line on top.

    Returns:
        RGB picture.

    """
    height = TITLE_PX + ROWS * (TILE_PX + CAPTION_PX + GAP_PX) + GAP_PX
    width = GAP_PX + COLUMNS * (TILE_PX + GAP_PX)
    sheet = np.full((height, width, 3), PAPER, np.uint8)
    _text(sheet, title, (GAP_PX, 28), INK, 0.55)
    count = min(len(seen), COLUMNS * ROWS)
    chosen = [seen[round(k)] for k in np.linspace(0, len(seen) - 1, count)] if count else []
    for number, moment in enumerate(chosen):
        row, column = divmod(number, COLUMNS)
        top = TITLE_PX + row * (TILE_PX + CAPTION_PX + GAP_PX)
        left = GAP_PX + column * (TILE_PX + GAP_PX)
        since_ns = moment.decision.unix_time_ns - seen[0].decision.unix_time_ns
        _tile(sheet[top : top + TILE_PX + CAPTION_PX, left : left + TILE_PX], moment, since_ns)
    if path is None:
        return sheet
    beside = np.full((height, path.shape[1] + 2 * GAP_PX, 3), PAPER, np.uint8)
    beside[TITLE_PX : TITLE_PX + path.shape[0], GAP_PX : GAP_PX + path.shape[1]] = path
    return np.hstack([sheet, beside])


def path_side_px() -> int:
    """The side of a path picture that fills the sheet's height."""
    return ROWS * (TILE_PX + CAPTION_PX + GAP_PX)


def save(picture: Picture, path: Path) -> None:
    """Write a PNG.

    Raises:
        ConfigurationError: it can't be written.

    """
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise ConfigurationError(f"can't write the picture {path}")


def _tile(area: Picture, moment: Moment, since_ns: int) -> None:
    """One observation, enlarged without smoothing, its time, and both wheels as bars."""
    area[:TILE_PX] = cv2.resize(
        moment.observation, (TILE_PX, TILE_PX), interpolation=cv2.INTER_NEAREST
    )
    _text(area, f"{since_ns / 1e9:.1f} s", (2, TILE_PX + 14), INK, 0.4)
    middle = TILE_PX * 2 // 3
    for line, step in enumerate((moment.decision.steps.left, moment.decision.steps.right)):
        y = TILE_PX + 9 + 12 * line
        _text(area, "LR"[line], (middle - 48, y + 4), FAINT, 0.35)
        cv2.line(area, (middle - 36, y), (middle + 36, y), (220, 220, 216), 1)
        end = (middle + round(36 * step / 250), y)
        cv2.line(area, (middle, y), end, FORWARD if step >= 0 else BACKWARD, 5)


def _text(
    area: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int], size: float
) -> None:
    cv2.putText(area, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)

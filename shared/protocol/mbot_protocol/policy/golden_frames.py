"""Golden frames: pictures with the actions they gave when the model was exported, inside the model.

One metadata property, a JSON list of {"name", "png", "action"}: the picture as PNG in base64, the
action as two numbers. Whoever runs the model can see whether it still does the same. An entry with
"fresh": false goes on with what a model with memory said to the entry before: of such a model they
are a golden sequence.
"""

import base64
import binascii
import struct
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import OBSERVATION_SHAPE

PROPERTY = "mbot.golden_frames"

TOLERANCE = 1e-4
"""Processors round differently; a motor step is 0.004."""

MOST_FRAMES = 128

_PNG_HEAD = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", *OBSERVATION_SHAPE[2:0:-1])
"""How a picture of the one size begins; another could be of any."""


class _Entry(msgspec.Struct):
    name: str
    png: str
    action: tuple[float, float]
    fresh: bool = True


@dataclass(frozen=True, slots=True)
class GoldenFrame:
    """A picture, shape (64, 64, 3), uint8, RGB, and the action the model gave for it.

    Attributes:
        fresh: with a zeroed memory; else with what it remembered of the frame before, whose action
            the wheels were told.

    """

    name: str
    picture: Picture
    action: tuple[float, float]
    fresh: bool = True


def read_golden_frames(properties: Mapping[str, str]) -> list[GoldenFrame]:
    """The frames in a model's metadata properties; empty if it brings none.

    Raises:
        ContractError: they are damaged, or more than MOST_FRAMES.

    """
    text = properties.get(PROPERTY)
    if text is None:
        return []
    try:
        entries = msgspec.json.decode(text, type=list[_Entry])
    except msgspec.DecodeError as error:
        raise ContractError(f"the model's {PROPERTY} is damaged: {error}") from None
    if not 0 < len(entries) <= MOST_FRAMES:
        raise ContractError(
            f"the model's {PROPERTY} is damaged: {len(entries)} frames, expected 1 to {MOST_FRAMES}"
        )
    return [
        GoldenFrame(entry.name, _picture(entry), entry.action, entry.fresh) for entry in entries
    ]


def check_deviation(deviation: float) -> float:
    """Return the largest deviation of a wheel if it can be rounding.

    Raises:
        ContractError: it is more than TOLERANCE, or no number.

    """
    if not deviation <= TOLERANCE:
        raise ContractError(
            f"the model's actions on its own golden frames are off by {deviation:.3g}; export it "
            "again, or update onnxruntime"
        )
    return deviation


def _picture(entry: _Entry) -> Picture:
    picture = None
    try:
        encoded = base64.b64decode(entry.png, validate=True)
        if encoded.startswith(_PNG_HEAD):
            picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
    except (binascii.Error, ValueError, cv2.error):
        pass
    if picture is None or picture.shape != OBSERVATION_SHAPE[1:]:
        raise ContractError(f"the model's {PROPERTY} is damaged: a frame can't be read")
    return np.ascontiguousarray(picture[..., ::-1], np.uint8)  # OpenCV decodes to BGR

"""Golden frames for an export: pictures with the actions the model gives, inside the model.

`mbot_protocol.policy.golden_frames` has the format; a robot compares them before it takes the
model.
"""

import base64
import json
from collections.abc import Sequence

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.golden_frames import check_deviation, read_golden_frames
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy


def golden_property(model: onnx.ModelProto, frames: Sequence[tuple[Picture, bool]]) -> str:
    """The property for a model that has none yet: frames, and what the model makes of them.

    Args:
        model: to be asked.
        frames: pictures, shape (64, 64, 3), and whether the memory is zeroed before each.

    """
    answers = _answers(model, frames)
    return json.dumps(
        [
            {
                "name": str(number),
                "png": _to_png(picture),
                "action": [round(float(value), 6) for value in action],
                "fresh": fresh,
            }
            for number, ((picture, fresh), action) in enumerate(zip(frames, answers, strict=True))
        ],
        separators=(",", ":"),
    )


def check_golden_frames(model: onnx.ModelProto) -> float | None:
    """Compare what a model does today with what it did when it was exported.

    Returns:
        The largest deviation of a wheel; None if the model brings no frames.

    Raises:
        ContractError: the frames are damaged, or an action is off by more than the tolerance.

    """
    frames = read_golden_frames({entry.key: entry.value for entry in model.metadata_props})
    if not frames:
        return None
    answers = _answers(model, [(frame.picture, frame.fresh) for frame in frames])
    expected = np.array([frame.action for frame in frames], np.float64)
    return check_deviation(float(np.abs(answers - expected).max()))


def _answers(model: onnx.ModelProto, frames: Sequence[tuple[Picture, bool]]) -> NDArray[np.float32]:
    """Actions, shape (n, 2)."""
    policy = OnnxPolicy(model.SerializeToString())
    actions: list[NDArray[np.float32]] = []
    for picture, fresh in frames:
        if fresh:
            policy.forget()
        actions.append(policy.act(picture[None])[0])
    return np.stack(actions)


def _to_png(frame: Picture) -> str:
    _, data = cv2.imencode(".png", frame[..., ::-1])
    return base64.b64encode(data.tobytes()).decode("ascii")

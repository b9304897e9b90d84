"""Golden frames for an export: pictures with the actions the model gives, inside the model.

`mbot_protocol.golden_frames` has the format; a robot compares them before it takes the model.
"""

import base64
import json
from collections.abc import Mapping

import cv2
import numpy as np
import onnx

from mbot_protocol.golden_frames import check_deviation, read_golden_frames
from mbot_protocol.picture import Picture
from mbot_workstation.training.drivers.onnx_policy import OnnxPolicy


def golden_property(model: onnx.ModelProto, frames: Mapping[str, Picture]) -> str:
    """The property for a model that has none yet: frames, and what the model makes of them."""
    actions = OnnxPolicy(model.SerializeToString()).act(np.stack(list(frames.values())))
    return json.dumps(
        [
            {"name": name, "png": _to_png(frame), "action": [round(float(v), 6) for v in action]}
            for (name, frame), action in zip(frames.items(), actions, strict=True)
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
    actions = OnnxPolicy(model.SerializeToString()).act(np.stack([f.picture for f in frames]))
    expected = np.array([frame.action for frame in frames], np.float64)
    return check_deviation(float(np.abs(actions - expected).max()))


def _to_png(frame: Picture) -> str:
    _, data = cv2.imencode(".png", frame[..., ::-1])
    return base64.b64encode(data.tobytes()).decode("ascii")

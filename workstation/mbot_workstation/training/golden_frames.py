"""Frames with the actions they gave, inside the model: anyone can check that it still works.

They travel as one metadata property, a JSON list of {"name", "png", "action"}: the picture as PNG
in base64, the action as two numbers.
"""

import base64
import json
from collections.abc import Mapping

import cv2
import numpy as np
import onnx

from mbot_protocol.errors import ContractError
from mbot_protocol.picture import Picture
from mbot_workstation.half_blocks import decode_picture
from mbot_workstation.training.onnx_policy import OnnxPolicy

PROPERTY = "mbot.golden_frames"

TOLERANCE = 1e-4
"""Processors round differently; a motor step is 0.004."""


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
        ContractError: the frames are damaged, or an action is off by more than TOLERANCE.

    """
    text = {entry.key: entry.value for entry in model.metadata_props}.get(PROPERTY)
    if text is None:
        return None
    try:
        entries = json.loads(text)
        pictures = [decode_picture(base64.b64decode(entry["png"])) for entry in entries]
        expected = np.array([entry["action"] for entry in entries], np.float64)
    except (ValueError, KeyError, TypeError) as error:
        raise ContractError(f"the model's {PROPERTY} is damaged: {error}") from None
    frames = [picture for picture in pictures if picture is not None]
    if len(frames) != len(entries) or not frames or expected.shape != (len(frames), 2):
        raise ContractError(f"the model's {PROPERTY} is damaged: a frame can't be read")
    actions = OnnxPolicy(model.SerializeToString()).act(np.stack(frames))
    deviation = float(np.abs(actions - expected).max())
    if not deviation <= TOLERANCE:
        raise ContractError(
            f"the model's actions on its own golden frames are off by {deviation:.3g}; export it "
            "again, or update onnxruntime"
        )
    return deviation


def _to_png(frame: Picture) -> str:
    _, data = cv2.imencode(".png", frame[..., ::-1])
    return base64.b64encode(data.tobytes()).decode("ascii")

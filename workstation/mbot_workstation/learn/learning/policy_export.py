"""A trained network becomes a policy file: graph, where it comes from, frames to check it by."""

import base64
import json
from collections.abc import Sequence

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.golden_frames import PROPERTY, check_deviation, read_golden_frames
from mbot_protocol.policy.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.learn.learning.policy_graph import policy_graph
from mbot_workstation.learn.learning.trained_policy import PROVENANCE, TrainedPolicy
from mbot_workstation.learn.worlds.example_frames import golden_sequence


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


def export_policy(policy: TrainedPolicy, name: str, *, for_armv6: bool = False) -> onnx.ModelProto:
    """Build the policy file's content.

    The same weights give the same model, on machines that render alike.

    Args:
        policy: what to export.
        name: what robots call it.
        for_armv6: see `policy_graph`.

    Raises:
        ConfigurationError: nothing can be rendered here.

    """
    origin = json.dumps(policy.provenance, separators=(",", ":"))
    metadata = PolicyMetadata(name, FULL_VIEW)
    model = policy_graph(policy.weights, metadata, {PROVENANCE: origin}, for_armv6=for_armv6)
    golden = model.metadata_props.add()
    golden.key, golden.value = PROPERTY, golden_property(model, golden_sequence())
    return model

"""A policy that looks for one colour, turned into one that looks for another: its first layer is
told that the new colour is the old one.

Hues are angles about the grey axis of red, green and blue, so this is a rotation, which greys do
not notice. A policy for a red cube turned to a green ball found all ten of it before it had
seen one (simulated; docs/objects.md).
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.sim.scene.target_object import TargetObject


def hue_turn_deg(before: TargetObject, now: TargetObject) -> float:
    """How far the one's hue is from the other's, in (-180, 180]."""
    turn = (now.mean_hsv[0] - before.mean_hsv[0]) * 360
    return 180 - (180 - turn) % 360


def turned(weights: dict[str, torch.Tensor], turn_deg: float) -> dict[str, torch.Tensor]:
    """Weights of a network that makes of a picture what the given one makes of it with all hues
    turned back.

    Args:
        weights: by name; of convolutions on pictures, "...first.weight", shape (filters, 3, h, w).
        turn_deg: positive from red to green.

    """
    back = torch.tensor(_rotation(-turn_deg), dtype=torch.float32)
    return {
        name: torch.einsum("okhw,kc->ochw", value, back)
        if name.endswith("features_extractor.first.weight")
        else value
        for name, value in weights.items()
    }


def _rotation(turn_deg: float) -> NDArray[np.float64]:
    """About the grey axis, shape (3, 3); Rodrigues' formula."""
    angle, along = math.radians(turn_deg), 1 / math.sqrt(3)
    across = along * np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
    return (
        math.cos(angle) * np.eye(3)
        + math.sin(angle) * across
        + (1 - math.cos(angle)) * np.full((3, 3), 1 / 3)
    )

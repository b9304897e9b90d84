"""What becomes of wheels that are asked for more than full speed: both give way, the turn stays.

A policy that can't be sure of a turn asks for the mean of what it may be. If each wheel were
clipped by itself, that mean would cost speed wherever the robot drives ahead (5 %: the shipped
policy eb7d083a3b84 on nominal robots); so the guide asks for full speed and a turn on top of it,
and the wheels are brought within bounds here.
"""

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import helper
from torch.nn import functional

KEEPS_TURNS = "keeps_turns"
"""Marks the weights of a policy that was trained so."""


def within_full_speed(wheels: torch.Tensor) -> torch.Tensor:
    """What the wheels are told; both shapes (n, 2), the result in [-1, 1]."""
    too_fast = functional.relu(wheels.amax(dim=1, keepdim=True) - 1)
    too_far_back = functional.relu(-1 - wheels.amin(dim=1, keepdim=True))
    return (wheels - too_fast + too_far_back).clamp(-1, 1)


def full_speed_nodes(wheels: str, output: str) -> list[onnx.NodeProto]:
    """The same up to the clipping, by what every engine has; see `full_speed_constants`."""
    steps = [
        ("Gemm", [wheels, "beyond.weight", "beyond.bias"], "beyond"),
        ("Relu", ["beyond"], "excess"),
        # The larger of two excesses is the first and what the second has more.
        ("Gemm", ["excess", "more.weight", "more.bias"], "more"),
        ("Relu", ["more"], "parts"),
        ("Gemm", ["parts", "give_way.weight", "give_way.bias"], "give_way"),
        ("Add", [wheels, "give_way"], output),
    ]
    return [helper.make_node(kind, inputs, [out], name=out) for kind, inputs, out in steps]


def full_speed_constants() -> dict[str, NDArray[np.float32]]:
    """Of the nodes, by name: excess of left and right beyond 1, then beyond -1.

    Weights have shape (inputs, outputs), biases (outputs,).
    """
    matrices = {
        "beyond": ([[1, 0, -1, 0], [0, 1, 0, -1]], [-1] * 4),
        "more": ([[1, -1, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1], [0, 0, 0, 1]], [0] * 4),
        "give_way": ([[-1, -1], [-1, -1], [1, 1], [1, 1]], [0] * 2),
    }
    return {
        f"{name}.{part}": np.array(value, np.float32)
        for name, pair in matrices.items()
        for part, value in zip(("weight", "bias"), pair, strict=True)
    }

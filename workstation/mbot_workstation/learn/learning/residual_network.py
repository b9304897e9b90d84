"""A network that tells a cube from a can: deeper than the paper's, with residual blocks.

    64 px -> 30, 24 filters -> 15, 48, and a block -> 7, 96, and a block -> 3, 128 -> dense

Blocks are two convolutions of 3 x 3 that are added to their own input (He et al., "Deep residual
learning", 2016). It learns by labels before anybody drives (`eye.py`). A picture costs 29 million
products, ten times as many as in network.py with filters of 6 x 6. Asked whether there is a cube in
rooms that look like photographs, it has 0.92 of the area under the curve where a network without
blocks has 0.83 (one seed each: docs/notebook/training.md).
"""

from typing import Any

import gymnasium
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from mbot_workstation.learn.learning.network import (
    DENSE_UNITS,
    first_layer,
    keep_channels_last,
    leaky,
)

FILTERS = (24, 48, 96, 128)
"""Of the four convolutions that halve the picture."""

LAST_SIDE_PX = 3


class Residual(nn.Module):
    """Two convolutions, added to their input.

    Attributes:
        inner, outer: 3 x 3; a LeakyReLU follows the first, and the sum.

    """

    def __init__(self, filters: int) -> None:
        super().__init__()
        self.inner = nn.Conv2d(filters, filters, kernel_size=3, padding=1)
        self.outer = nn.Conv2d(filters, filters, kernel_size=3, padding=1)

    def forward(self, hidden: torch.Tensor) -> torch.Tensor:
        """Of the same shape."""
        return leaky(hidden + self.outer(leaky(self.inner(hidden))))


class ResidualNetwork(BaseFeaturesExtractor):
    """Pictures to features, shape (n, 64, 64, 3) to (n, 256).

    Attributes:
        first: 5 x 5 at a stride of 2, without a margin, as `first_layer` wants it.
        second, third, fourth: 4 x 4 at a stride of 2, with a margin of 1.
        near, far: the blocks behind the second and the third.
        dense: the last layer.

    """

    def __init__(self, observation_space: gymnasium.Space[Any]) -> None:
        super().__init__(observation_space, DENSE_UNITS)
        one, two, three, four = FILTERS
        self.first = nn.Conv2d(3, one, kernel_size=5, stride=2)
        self.second = nn.Conv2d(one, two, kernel_size=4, stride=2, padding=1)
        self.near = Residual(two)
        self.third = nn.Conv2d(two, three, kernel_size=4, stride=2, padding=1)
        self.far = Residual(three)
        self.fourth = nn.Conv2d(three, four, kernel_size=4, stride=2, padding=1)
        self.dense = nn.Linear(four * LAST_SIDE_PX**2, DENSE_UNITS)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features of pictures, float, 0 to 255."""
        hidden = leaky(first_layer(self.first, observations))
        hidden = self.near(leaky(self.second(hidden)))
        hidden = self.far(leaky(self.third(hidden)))
        hidden = leaky(self.fourth(hidden))
        keep_channels_last(hidden)
        return leaky(self.dense(hidden.flatten(1)))

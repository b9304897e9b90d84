"""The paper's "simple" network: two convolutions and a dense layer, for pictures as they come.

A policy with a memory has two layers more, each added to its own input: a third convolution behind
the second, and a dense one behind the first; and its first filters may be smaller and lie closer.
Trained to say whether and where the object is (6 times 90,000 pictures) and asked about 16,000 of
other rooms, at 3 % false alarms, the paper's network missed 28 % of the objects that are 2 to 2.5 m
away and 40 % of those to 3 m; the deeper one 16 and 27 %; with filters of 6 x 6 at a stride of 3
besides, 14 and 20 % (measured once, one seed, by a script that is not kept).

A policy that is to tell a cube from a can needs more: first filters of 5 x 5 at a stride of 2, and
a third convolution with a stride, 64 filters, and a fourth added to it. Trained to say whether and
where the object is among other things of its colour (8 times 72,000 pictures of homes, once, one
seed, by a script that is not kept), it takes things 0.6 to 1 m away for the object in 21 % of the
pictures without one, the one before in 31 %; a sample of a batch costs it 2.5 times as much.

Pictures stay height x width x channel from the renderer to the first convolution: torch takes such
memory as its "channels last" layout, so nobody transposes or copies them. Measured on one thread,
forward and backward, a batch of 256: 96 us a sample, against 110 us with a transposed copy.
"""

import math
from typing import Any

import gymnasium
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.nn import functional

from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX

LEAKY_SLOPE = 0.01
PAPER_FILTER_PX = 8
"""Side of the first convolution's filters."""

PAPER_HALVINGS = 2
"""Convolutions with a stride; three at most."""

DENSE_UNITS = 256
"""The paper names a dense layer without its width."""

PIXEL_SCALE = 1 / 255
PIXEL_SHIFT = -0.5
"""Observations enter the network as pixel / 255 - 0.5, in [-0.5, 0.5]: inputs around zero."""

INITIAL_NOISE = 0.27
"""Of the exploration, on each wheel, in shares of full speed. More drowns the steering: at full
opposite commands the robot turns 160 degrees in a decision, and with 0.6 lesson 4 was not passed in
200,000 decisions (measured)."""


class PictureNetwork(BaseFeaturesExtractor):
    """Pictures to features: 16 filters 8 x 8 stride 4, 32 filters 4 x 4 stride 2, dense.

    The first filters may be smaller, at a stride of half their side.

    Attributes:
        first, second, dense: the layers; each is followed by a LeakyReLU.
        third, mixing: what a deeper one has besides: 32 filters 3 x 3 and another dense layer, each
            with a LeakyReLU, and added to its own input.
        fourth, fifth: what one that halves three times has besides: 64 filters 4 x 4 stride 2, and
            64 filters 3 x 3, added to their input; each with a LeakyReLU.

    """

    def __init__(
        self,
        observation_space: gymnasium.Space[Any],
        deeper: bool = False,
        first_filter_px: int = PAPER_FILTER_PX,
        halvings: int = PAPER_HALVINGS,
    ) -> None:
        super().__init__(observation_space, DENSE_UNITS)
        self.first = nn.Conv2d(3, 16, first_filter_px, stride=first_stride(first_filter_px))
        self.second = nn.Conv2d(16, 32, kernel_size=4, stride=2)
        first_side = (OBSERVATION_SIDE_PX - first_filter_px) // first_stride(first_filter_px) + 1
        side, filters = (first_side - 4) // 2 + 1, 32
        more = halvings > PAPER_HALVINGS
        if more:
            side, filters = (side - 4) // 2 + 1, 64
        self.dense = nn.Linear(filters * side**2, DENSE_UNITS)
        self.third = nn.Conv2d(32, 32, kernel_size=3, padding=1) if deeper else None
        self.fourth = nn.Conv2d(32, 64, kernel_size=4, stride=2) if more else None
        self.fifth = nn.Conv2d(64, 64, kernel_size=3, padding=1) if more else None
        self.mixing = nn.Linear(DENSE_UNITS, DENSE_UNITS) if deeper else None

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features of pictures.

        Args:
            observations: shape (n, 64, 64, 3), float, 0 to 255.

        Returns:
            Shape (n, 256).

        """
        weight, bias = self.scaled_first_layer()
        pictures = observations.permute(0, 3, 1, 2)  # a view: the memory stays as it is
        hidden = _leaky(functional.conv2d(pictures, weight, bias, stride=self.first.stride))
        hidden = _leaky(self.second(hidden))
        if self.third is not None:
            hidden = hidden + _leaky(self.third(hidden))
        if self.fourth is not None and self.fifth is not None:
            hidden = _leaky(self.fourth(hidden))
            hidden = hidden + _leaky(self.fifth(hidden))
        if hidden.requires_grad:
            # Convolutions keep their results as pictures are kept, channels last; what comes back
            # through `flatten` is not, and every layer would go through two orders at once
            # (docs/notebook/training.md has what that costs).
            hidden.register_hook(_channels_last)
        features = _leaky(self.dense(hidden.flatten(1)))
        if self.mixing is not None:
            features = features + _leaky(self.mixing(features))
        return features

    def scaled_first_layer(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The first convolution's weight and bias for raw pixels.

        Scaling 3,000 weights is 4,000 times less work than scaling a batch of pictures. It is
        exact, since no filter hangs over the picture's edge.
        """
        assert self.first.bias is not None
        shift = PIXEL_SHIFT * self.first.weight.sum(dim=(1, 2, 3))
        return self.first.weight * PIXEL_SCALE, self.first.bias + shift


def _leaky(hidden: torch.Tensor) -> torch.Tensor:
    return functional.leaky_relu(hidden, LEAKY_SLOPE)


def _channels_last(gradient: torch.Tensor) -> torch.Tensor:
    return gradient.contiguous(memory_format=torch.channels_last)


def first_stride(filter_px: int) -> int:
    """How far apart the first convolution's filters are, in pixels."""
    return filter_px // 2


def policy_arguments(
    initial_log_std: float = math.log(INITIAL_NOISE),
    *,
    deeper: bool = False,
    first_filter_px: int = PAPER_FILTER_PX,
    halvings: int = PAPER_HALVINGS,
) -> dict[str, Any]:
    """What SB3's ActorCriticPolicy needs to be the paper's policy, or one of the deeper network.

    The action's mean and the value are each one linear layer on the features; the noise is a number
    a wheel.
    """
    return {
        "features_extractor_class": PictureNetwork,
        "features_extractor_kwargs": {
            "deeper": deeper,
            "first_filter_px": first_filter_px,
            "halvings": halvings,
        },
        "net_arch": [],
        "normalize_images": False,  # the network does it
        "log_std_init": initial_log_std,
        "optimizer_kwargs": {"fused": True, "eps": 1e-5},  # one pass over the weights, not ten
    }

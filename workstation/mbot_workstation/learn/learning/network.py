"""The paper's "simple" network: two convolutions and a dense layer, for pictures as they come.

A policy with a memory has two layers more, each added to its own input: a third convolution behind
the second, and a dense one behind the first; and its first filters may be smaller and lie closer.
Trained to say whether and where the object is (6 times 90,000 pictures) and asked about 16,000 of
other rooms, at 3 % false alarms, the paper's network missed 28 % of the objects that are 2 to 2.5 m
away and 40 % of those to 3 m; the deeper one 16 and 27 %; with filters of 6 x 6 at a stride of 3
besides, 14 and 20 % (measured once, one seed, by a script that is not kept).

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

    """

    def __init__(
        self,
        observation_space: gymnasium.Space[Any],
        deeper: bool = False,
        first_filter_px: int = PAPER_FILTER_PX,
    ) -> None:
        super().__init__(observation_space, DENSE_UNITS)
        self.first = nn.Conv2d(3, 16, first_filter_px, stride=first_stride(first_filter_px))
        self.second = nn.Conv2d(16, 32, kernel_size=4, stride=2)
        first_side = (OBSERVATION_SIDE_PX - first_filter_px) // first_stride(first_filter_px) + 1
        side = (first_side - 4) // 2 + 1
        self.dense = nn.Linear(32 * side**2, DENSE_UNITS)
        self.third = nn.Conv2d(32, 32, kernel_size=3, padding=1) if deeper else None
        self.mixing = nn.Linear(DENSE_UNITS, DENSE_UNITS) if deeper else None

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features of pictures.

        Args:
            observations: shape (n, 64, 64, 3), float, 0 to 255.

        Returns:
            Shape (n, 256).

        """
        hidden = leaky(first_layer(self.first, observations))
        hidden = leaky(self.second(hidden))
        if self.third is not None:
            hidden = hidden + leaky(self.third(hidden))
        keep_channels_last(hidden)
        features = leaky(self.dense(hidden.flatten(1)))
        if self.mixing is not None:
            features = features + leaky(self.mixing(features))
        return features


def first_layer(layer: nn.Conv2d, observations: torch.Tensor) -> torch.Tensor:
    """A convolution of raw pixels, shape (n, 64, 64, 3), that means them as PIXEL_SCALE says.

    Scaling 3,000 weights is 4,000 times less work than scaling a batch of pictures. It is exact as
    long as no filter hangs over the picture's edge.
    """
    assert layer.bias is not None
    shift = PIXEL_SHIFT * layer.weight.sum(dim=(1, 2, 3))
    pictures = observations.permute(0, 3, 1, 2)  # a view: the memory stays as it is
    weight, bias = layer.weight * PIXEL_SCALE, layer.bias + shift
    return functional.conv2d(pictures, weight, bias, stride=layer.stride)


def keep_channels_last(hidden: torch.Tensor) -> None:
    """Let what comes back through `flatten` lie as convolutions keep their results, or every layer
    goes through two orders at once (docs/notebook/training.md has what that costs).
    """
    if hidden.requires_grad:
        hidden.register_hook(_channels_last)


def leaky(hidden: torch.Tensor) -> torch.Tensor:
    """What follows every layer."""
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
) -> dict[str, Any]:
    """What SB3's ActorCriticPolicy needs to be the paper's policy, or one of the deeper network.

    The action's mean and the value are each one linear layer on the features; the noise is a number
    a wheel.
    """
    return {
        "features_extractor_class": PictureNetwork,
        "features_extractor_kwargs": {"deeper": deeper, "first_filter_px": first_filter_px},
        "net_arch": [],
        "normalize_images": False,  # the network does it
        "log_std_init": initial_log_std,
        "optimizer_kwargs": {"fused": True, "eps": 1e-5},  # one pass over the weights, not ten
    }

import gymnasium
import numpy as np
import pytest
import torch
from torch import nn

from mbot_workstation.learn.learning.network import (
    PIXEL_SCALE,
    PIXEL_SHIFT,
    PictureNetwork,
    first_layer,
)
from mbot_workstation.learn.learning.residual_network import ResidualNetwork

SPACE = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)


@pytest.fixture
def network() -> PictureNetwork:
    torch.manual_seed(1)
    return PictureNetwork(SPACE)


def pictures(count: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(2).integers(0, 256, (count, 64, 64, 3))).float()


def test_it_is_the_papers_network(network: PictureNetwork) -> None:
    textbook = nn.Sequential(
        network.first,
        nn.LeakyReLU(),
        network.second,
        nn.LeakyReLU(),
        nn.Flatten(),
        network.dense,
        nn.LeakyReLU(),
    )
    assert [tuple(p.shape) for p in textbook.parameters()] == [
        (16, 3, 8, 8),
        (16,),
        (32, 16, 4, 4),
        (32,),
        (256, 1152),
        (256,),
    ]
    batch = pictures(5)
    scaled = batch.permute(0, 3, 1, 2).contiguous() * PIXEL_SCALE + PIXEL_SHIFT
    torch.testing.assert_close(network(batch), textbook(scaled), rtol=1e-4, atol=1e-5)


def test_finer_filters_lie_closer() -> None:
    finer = PictureNetwork(SPACE, deeper=True, first_filter_px=6)
    assert finer.first.weight.shape == (16, 3, 6, 6)
    assert finer.first.stride == (3, 3)
    assert finer.dense.in_features == 32 * 9 * 9
    batch = pictures(3)
    scaled = batch.permute(0, 3, 1, 2) * PIXEL_SCALE + PIXEL_SHIFT
    raw = first_layer(finer.first, batch)
    torch.testing.assert_close(raw, finer.first(scaled), rtol=1e-4, atol=1e-5)
    assert finer(batch).shape == (3, 256)


def test_pictures_are_not_copied_on_the_way(network: PictureNetwork) -> None:
    seen: list[torch.Tensor] = []
    convolution = nn.functional.conv2d

    def spy(picture: torch.Tensor, *others: object, **named: object) -> torch.Tensor:
        seen.append(picture)
        return convolution(picture, *others, **named)  # pyright: ignore[reportCallIssue, reportArgumentType]

    batch = pictures(2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nn.functional, "conv2d", spy)
        network(batch)
    assert seen[0].data_ptr() == batch.data_ptr()
    assert seen[0].is_contiguous(memory_format=torch.channels_last)


def test_every_weight_learns(network: PictureNetwork) -> None:
    network(pictures(4)).square().sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert bool(parameter.grad.abs().sum() > 0), name


def test_blocks_are_added_to_what_they_are_given() -> None:
    network = ResidualNetwork(SPACE)
    block, hidden = network.near, torch.rand(2, 48, 15, 15)
    with torch.no_grad():
        for convolution in (block.inner, block.outer):
            convolution.weight.zero_()
            assert convolution.bias is not None
            convolution.bias.fill_(0.5)
    torch.testing.assert_close(block(hidden), hidden + 0.5)
    assert network(pictures(3)).shape == (3, 256)


@pytest.mark.parametrize("kind", ["paper", "deeper", "residual"])
def test_gradients_are_those_of_the_outputs(kind: str) -> None:
    """By differences, in float64."""
    torch.manual_seed(3)
    residual = kind == "residual"
    made = ResidualNetwork(SPACE) if residual else PictureNetwork(SPACE, deeper=kind == "deeper")
    network = made.double()
    batch, heed = pictures(4).double(), torch.randn(4, 256).double()
    (network(batch) * heed).sum().backward()
    with torch.no_grad():
        for weight in (network.first.weight, network.second.weight):
            assert weight.grad is not None
            way = 1e-6 * weight.grad / weight.grad.abs().max()  # where it matters most
            weight.add_(way)
            ahead = (network(batch) * heed).sum()
            weight.sub_(2 * way)
            behind = (network(batch) * heed).sum()
            weight.add_(way)
            expected = float((weight.grad * way).sum())
            assert float(ahead - behind) / 2 == pytest.approx(expected, rel=1e-3)


def test_gradients_come_back_in_the_order_of_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    orders: list[bool] = []
    leaky_relu = nn.functional.leaky_relu

    def watched(hidden: torch.Tensor, slope: float) -> torch.Tensor:
        result = leaky_relu(hidden, slope)
        if result.ndim == 4:
            result.register_hook(
                lambda found: orders.append(found.is_contiguous(memory_format=torch.channels_last))
            )
        return result

    monkeypatch.setattr(nn.functional, "leaky_relu", watched)
    PictureNetwork(SPACE, deeper=True)(pictures(4)).sum().backward()
    assert orders == [True] * 3

import colorsys

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.learn.learning.colour_turn import hue_turn_deg, turned
from mbot_workstation.learn.learning.network import PictureNetwork
from mbot_workstation.sim.scene.target_object import RED_CUBE, Shape, TargetObject

GREEN = TargetObject("ball", Shape.BALL, 0.1, 0.1, (30, 200, 35))
BLUE = TargetObject("ball", Shape.BALL, 0.1, 0.1, (35, 30, 200))


def through(network: PictureNetwork, picture: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return network(torch.tensor(picture[None], dtype=torch.float32)).numpy()


def turned_network(network: PictureNetwork, turn_deg: float) -> PictureNetwork:
    weights = {f"features_extractor.{k}": v for k, v in network.state_dict().items()}
    made = PictureNetwork(Box(0, 255, (64, 64, 3), np.uint8))
    made.load_state_dict(
        {
            name.removeprefix("features_extractor."): value
            for name, value in turned(weights, turn_deg).items()
        }
    )
    return made


@pytest.fixture(scope="module")
def network() -> PictureNetwork:
    torch.manual_seed(0)
    return PictureNetwork(Box(0, 255, (64, 64, 3), np.uint8))


def test_hues_are_apart_the_short_way() -> None:
    assert hue_turn_deg(RED_CUBE, RED_CUBE) == 0
    assert hue_turn_deg(RED_CUBE, GREEN) == pytest.approx(123, abs=2)
    assert hue_turn_deg(RED_CUBE, BLUE) == pytest.approx(-117, abs=2)
    assert hue_turn_deg(GREEN, RED_CUBE) == -hue_turn_deg(RED_CUBE, GREEN)


def test_a_third_of_a_turn_takes_green_for_red(network: PictureNetwork) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (64, 64, 3))
    green = picture[..., (2, 0, 1)]  # what was red is green now
    seen, before = through(turned_network(network, 120), green), through(network, picture)
    assert np.allclose(seen, before, atol=1e-4)
    assert not np.allclose(through(network, green), before, atol=1e-2)


@given(st.integers(0, 255), st.floats(-180, 180))
def test_greys_do_not_notice(level: int, turn_deg: float) -> None:
    torch.manual_seed(0)
    network = PictureNetwork(Box(0, 255, (64, 64, 3), np.uint8))
    grey = np.full((64, 64, 3), level)
    assert np.allclose(
        through(turned_network(network, turn_deg), grey), through(network, grey), atol=1e-4
    )


@given(st.sampled_from([(200, 30, 35), (30, 200, 35), (200, 120, 30)]), st.floats(-170, 170))
def test_a_colour_turned_there_and_back_is_itself(
    colour: tuple[int, int, int], turn_deg: float
) -> None:
    weight = torch.tensor(colour, dtype=torch.float32).reshape(1, 3, 1, 1)
    there = turned({"pi_features_extractor.first.weight": weight}, turn_deg)
    hue = colorsys.rgb_to_hsv(*there["pi_features_extractor.first.weight"].flatten().tolist())[0]
    apart_deg = (360 * (hue - colorsys.rgb_to_hsv(*colour)[0]) - turn_deg + 180) % 360 - 180
    assert abs(apart_deg) < 12, "a hue is nearly the angle about the grey axis"
    back = turned(there, -turn_deg)["pi_features_extractor.first.weight"]
    assert torch.allclose(back, weight, atol=1e-3)

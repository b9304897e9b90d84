"""Whether the picture stands still while the wheels turn; pictures made by hand."""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.arming import Mode, Orders
from mbot_agent.camera.stuck import (
    AREA_PX,
    NOISE_MARGIN,
    NOISIEST,
    ROUNDING,
    StuckCheck,
)
from mbot_agent.tick import Tick
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.wheel_command import STOP, Duties

from ..promised import promised

PERIOD_S = 0.4
AHEAD = Duties(169 / 255, 169 / 255)
"""0.6 of full speed."""
FAST = Duties(1, 1)
GREY = (0.299, 0.587, 0.114)
"""How much of red, green and blue (ITU-R BT.601)."""
Look = Callable[[float], Picture]


def scene(seed: int = 0) -> np.ndarray:
    """Something to see, soft as a lens shows it. Shape (64, 128, 3), float."""
    rough = np.random.default_rng(seed).uniform(40, 200, (8, 16, 3))
    return cv2.resize(rough, (128, 64), interpolation=cv2.INTER_CUBIC).clip(0, 255)


def plain(level: float) -> np.ndarray:
    return np.full((64, 128, 3), float(level))


def camera(
    light: np.ndarray,
    *,
    noise: float = 0.0,
    exposure: Callable[[float], float] = lambda _: 1.0,
    turn_px_s: float = 0.0,
) -> Look:
    """What a camera shows of the left half, or of what lies further right once it turns."""
    rng = np.random.default_rng(1)

    def look(time_s: float) -> Picture:
        shift = np.array([[1, 0, -turn_px_s * time_s], [0, 1, 0]], np.float64)
        turned = cv2.warpAffine(light, shift, (128, 64), borderMode=cv2.BORDER_WRAP)[:, :64]
        seen = turned * exposure(time_s) + rng.normal(0, noise, turned.shape)
        return seen.round().clip(0, 255).astype(np.uint8)

    return look


def found_after_s(
    look: Look, told: Duties = AHEAD, longest_s: float = 20.0, period_s: float = PERIOD_S
) -> float | None:
    """When a robot that is driven so, and sees this, is found to be stuck."""
    check = StuckCheck()
    for number in range(round(longest_s / period_s)):
        tick = beat(number, look(number * period_s), told, period_s=period_s)
        if check.judge(tick) is not None:
            return round(number * period_s, 1)
    return None


def beat(
    number: int,
    observation: Picture | None,
    told: Duties,
    mode: Mode = Mode.RUNNING,
    period_s: float = PERIOD_S,
) -> Tick:
    at_ns = round(number * period_s * 1e9)
    orders = Orders(mode)
    return Tick(number, at_ns, at_ns, 0, orders, observation=observation, duties=told)


STANDING: dict[str, Look] = {
    "no noise": camera(scene()),
    "noise": camera(scene(), noise=1.0),
    "much noise": camera(scene(), noise=3.0),
    "exposure settles": camera(scene(), noise=1.0, exposure=lambda s: 1 - 0.4 * 0.6**s),
    "exposure hunts": camera(scene(), noise=1.0, exposure=lambda s: 1 + 0.1 * np.sin(s)),
    "exposure falls": camera(scene(), noise=1.0, exposure=lambda s: 0.6 + 0.4 * 0.6**s),
    "a plain wall": camera(plain(150)),
    "a plain wall, noise": camera(plain(150), noise=1.0),
    "a plain wall, rounding": camera(plain(150), exposure=lambda s: 1 + 0.002 * np.sin(9 * s)),
}


@pytest.mark.parametrize("name", STANDING)
def test_a_picture_that_stands_still_for_3_s_of_driving_is_stuck(name: str) -> None:
    assert found_after_s(STANDING[name]) == 3.2  # the next decision
    assert found_after_s(STANDING[name], FAST, period_s=0.1) == promised("stuck-found")


MOVING: dict[str, Look] = {
    "a slow turn": camera(scene(), noise=3.0, turn_px_s=1.0),
    "a turn": camera(scene(), turn_px_s=30.0),
    "a carpet": camera(
        np.random.default_rng(2).uniform(60, 190, (64, 128, 1)).repeat(3, 2), turn_px_s=3.0
    ),
    "from a scene to a plain wall and back": lambda s: camera(
        scene() if int(s / PERIOD_S) % 2 else plain(120)
    )(s),
    "light that is switched": lambda s: camera(scene() * (0.3 if int(s) % 2 else 1.0))(s),
}


@pytest.mark.parametrize("name", MOVING)
def test_a_picture_that_changes_is_not(name: str) -> None:
    assert found_after_s(MOVING[name]) is None


def tells_apart(first: np.ndarray, then: np.ndarray) -> bool:
    """Whether what is seen from the second observation on is another picture than the first."""
    shown = [picture.round().clip(0, 255).astype(np.uint8) for picture in (first, then)]
    found_s = found_after_s(lambda time_s: shown[time_s > 0], FAST)
    if found_s == pytest.approx(3.2):
        return False
    assert found_s == pytest.approx(3.2 + PERIOD_S)  # it stands still from then on
    return True


def faint(variance: float) -> np.ndarray:
    """An upper part that is lighter by whole levels, so that areas vary so; shape (64, 64, 1)."""
    level = math.ceil(2 * math.sqrt(variance))  # half the areas would vary as much, or more
    share = (1 - math.sqrt(1 - 4 * variance / level**2)) / 2
    lighter = np.arange(256) < 256 * share
    return np.kron(lighter.reshape(16, 16), np.full((AREA_PX, AREA_PX), level))[..., np.newaxis]


@pytest.mark.parametrize("noise", [0.0, 2.0, 3.5, 7.0])
@pytest.mark.parametrize(
    "first",
    [np.full((64, 64, 3), 100.0), scene()[:, :64].round()],
    ids=["a plain wall", "a scene"],
)
@pytest.mark.parametrize("exposure", [1.0, 0.6])
def test_what_noise_explains_is_no_change_and_what_is_more_is_one(
    first: np.ndarray, noise: float, exposure: float
) -> None:
    of_colour = noise / np.linalg.norm(GREY)
    grain = np.random.default_rng(4).normal(0, of_colour, (16, AREA_PX, 16, AREA_PX, 3))
    grain -= grain.mean((1, 3), keepdims=True)  # so that areas are known to differ by `faint` alone
    then = first * exposure + grain.reshape(64, 64, 3)
    bar = ROUNDING + (NOISE_MARGIN * min(noise, NOISIEST) / AREA_PX) ** 2
    assert not tells_apart(first, then + faint(0.85 * bar))
    assert tells_apart(first, then + faint(1.15 * bar))


def test_creeping_takes_as_long_as_half_a_metre() -> None:
    wall = camera(plain(150), noise=1.0)
    assert found_after_s(wall, FAST) == 3.2
    # (94 - 65) / (255 - 65) of 0.3 m/s.
    assert found_after_s(wall, Duties(94 / 255, 94 / 255)) == pytest.approx(
        0.5 / 0.0458, abs=PERIOD_S
    )


@given(st.integers(-65, 65), st.integers(-65, 65))
def test_in_the_dead_band_nobody_is_stuck(left: int, right: int) -> None:
    wall = camera(plain(90))
    assert (
        found_after_s(wall, Duties(left / 255, right / 255), longest_s=3600, period_s=400) is None
    )


def test_the_way_of_before_the_picture_stood_still_does_not_count() -> None:
    check, turning, still = StuckCheck(), camera(scene(), turn_px_s=30.0), scene()[:, :64]
    for number in range(20):
        assert check.judge(beat(number, turning(number * PERIOD_S), FAST)) is None
    creeping = Duties(94 / 255, 94 / 255)
    for number in range(20, 40):  # 8 s of 11
        assert check.judge(beat(number, still.astype(np.uint8), creeping)) is None


def test_to_and_fro_leads_nowhere() -> None:
    check, still = StuckCheck(), scene()[:, :64].astype(np.uint8)
    for number in range(50):
        told = Duties(0.8, 0.8) if number % 2 else Duties(-0.8, -0.8)
        assert check.judge(beat(number, still, told)) is None


@pytest.mark.parametrize("gap", [STOP, None])
def test_it_is_3_s_without_a_pause(gap: Duties | None) -> None:
    check, still = StuckCheck(), scene()[:, :64].astype(np.uint8)
    for number in range(40):
        pause = number % 8 == 7
        seen = None if pause and gap is None else still
        told = STOP if pause and gap is not None else AHEAD
        assert check.judge(beat(number, seen, told)) is None


def test_each_3_s_of_it_are_said_once() -> None:
    check, still = StuckCheck(), scene()[:, :64].astype(np.uint8)
    said = [n for n in range(20) if check.judge(beat(n, still, AHEAD)) is not None]
    assert said == [8, 17]


def test_it_is_said_until_somebody_sets_the_robot_in_motion() -> None:
    check, still = StuckCheck(), scene()[:, :64].astype(np.uint8)
    fault = next(filter(None, (check.judge(beat(n, still, AHEAD)) for n in range(20))))
    assert fault.kind == "stuck"
    assert "3.2 s" in fault.detail
    for number in range(20, 40):
        assert check.judge(beat(number, still, STOP, Mode.STOPPED)) is None
        assert check.fault == fault
    check.judge(beat(40, still, AHEAD))
    assert check.fault is None

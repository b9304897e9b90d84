import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.camera.isp import ImageSignalProcessor, IspSettings

SIZE = 64
AUTOMATIC = IspSettings(auto_exposure=1.0, auto_exposure_lag_s=0.5, exposure_target=0.4)


def grey(level: int) -> Picture:
    return np.full((SIZE, SIZE, 3), level, np.uint8)


def processor(settings: IspSettings) -> ImageSignalProcessor:
    made = ImageSignalProcessor(SIZE, SIZE, noise_seed=1)
    made.become(settings)
    made.restart(0.0)
    return made


def scene() -> NDArray[np.uint8]:
    ramp = np.linspace(0, 255, SIZE).astype(np.uint8)
    return np.stack(
        [np.tile(ramp, (SIZE, 1)), np.tile(ramp[:, None], (1, SIZE)), grey(128)[..., 0]], 2
    )


def test_a_plain_camera_leaves_pictures_as_they_are() -> None:
    picture = scene()
    assert processor(IspSettings()).process(picture, 0.0) is picture


@given(st.integers(45, 235))  # 20 would need more than eight times the light
def test_an_automatic_exposure_brings_any_grey_to_its_target(level: int) -> None:
    shown = processor(AUTOMATIC).process(grey(level), 0.0)
    assert abs(float(shown.mean()) / 255 - 0.4) < 0.01


def test_the_exposure_follows_with_its_lag() -> None:
    camera = processor(AUTOMATIC)
    camera.process(grey(60), 0.0)
    at_once = float(camera.process(grey(180), 0.0).mean())
    assert at_once > 200, "the gain of the dark picture still holds"
    after_a_lag = float(camera.process(grey(180), 0.5).mean())
    much_later = float(camera.process(grey(180), 10.0).mean())
    assert at_once > after_a_lag > much_later
    assert abs(much_later / 255 - 0.4) < 0.01


def test_a_lag_is_a_time_constant() -> None:
    camera = processor(AUTOMATIC)
    camera.process(grey(90), 0.0)
    shown = float(camera.process(grey(130), 0.5).mean())
    # On a logarithmic scale the gain has gone all but 1/e of its way; levels are its 2.2th root.
    before, wanted = math.log(0.4 * 255 / 90), math.log(0.4 * 255 / 130)
    assert shown == pytest.approx(130 * math.exp(wanted + (before - wanted) / math.e), abs=1.5)


def test_an_automatic_white_balance_takes_a_lamps_tint_away() -> None:
    tinted = grey(120)
    tinted[..., 0], tinted[..., 2] = 150, 90
    full = processor(IspSettings(auto_white_balance=1.0)).process(tinted, 0.0)
    half = processor(IspSettings(auto_white_balance=0.5)).process(tinted, 0.0)
    assert np.ptp(full.reshape(-1, 3).mean(0)) < 2
    assert 10 < np.ptp(half.reshape(-1, 3).mean(0)) < 50


@pytest.mark.parametrize(
    "settings",
    [
        IspSettings(filmic=1.0),
        IspSettings(contrast=0.8),
        IspSettings(contrast=-0.2, black_level=0.06),
        IspSettings(filmic=0.5, contrast=0.5, black_level=-0.04),
    ],
)
def test_every_tone_curve_rises(settings: IspSettings) -> None:
    levels = [int(processor(settings).process(grey(g), 0.0)[0, 0, 0]) for g in range(0, 256, 5)]
    assert levels == sorted(levels)
    assert levels[-1] - levels[0] > 100


def test_vignetting_darkens_the_corners_by_its_share_of_the_light() -> None:
    shown = processor(IspSettings(vignetting=0.5)).process(grey(200), 0.0).astype(float)
    middle, corner = shown[31, 31, 0], shown[0, 0, 0]
    assert middle > 198
    assert abs((corner / 200) ** 2.2 - 0.51) < 0.03  # the corner pixel's middle is 0.98 out


def test_saturation_moves_colours_and_keeps_grey() -> None:
    red = grey(60)
    red[..., 0] = 200
    camera = processor(IspSettings(saturation=1.3))
    assert np.ptp(camera.process(red, 0.0)[0, 0].astype(int)) > 160
    assert (np.abs(camera.process(grey(90), 0.0).astype(int) - 90) <= 1).all()


def test_chroma_noise_colours_and_hardly_changes_brightness() -> None:
    shown = processor(IspSettings(chroma_noise=4.0)).process(grey(128), 0.0).astype(float)
    luma = shown @ np.array((0.299, 0.587, 0.114))
    assert shown[..., 0].std() > 1.5
    assert luma.std() < shown[..., 0].std() / 3


def test_sharpening_steepens_an_edge() -> None:
    edge = grey(80)
    edge[:, 32:] = 160
    shown = processor(IspSettings(sharpening=1.0)).process(edge, 0.0)
    assert shown[:, 31].max() < 80
    assert shown[:, 32].min() > 160


def test_a_coder_leaves_its_traces() -> None:
    assert (processor(IspSettings(jpeg_quality=30)).process(scene(), 0.0) != scene()).any()

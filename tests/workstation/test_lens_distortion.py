import numpy as np
import pytest
from msgspec.structs import replace

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_workstation.sim.camera.lens_distortion import LensDistortion, covering_pinhole
from mbot_workstation.sim.camera.sensor_noise import SensorNoise

CAMERA = nominal_pi_camera(320, 240)


def test_without_distortion_nothing_changes() -> None:
    picture = np.zeros((240, 320, 3), np.uint8)
    assert covering_pinhole(CAMERA) is CAMERA
    assert LensDistortion(CAMERA, 320, 240).apply(picture) is picture


@pytest.mark.parametrize("k1", [-0.2, -0.05, 0.1])
def test_the_pinhole_sees_all_the_lens_sees(k1: float) -> None:
    camera = replace(CAMERA, distortion=(k1, 0.0, 0.0, 0.0, 0.0))
    lens = LensDistortion(camera, 320, 240)
    ones = np.full((lens.drawn.height_px, lens.drawn.width_px, 3), 255, np.uint8)
    assert lens.apply(ones).shape == (240, 320, 3)
    assert lens.apply(ones).min() == 255
    assert (lens.drawn.width_px > 320) == (k1 < 0)


def test_noise_grows_with_brightness_and_leaves_the_mean() -> None:
    noise = SensorNoise(320, 240, seed=1)
    deviations = []
    for brightness in (60, 180):
        noisy = noise.apply(np.full((240, 320, 3), brightness, np.uint8)).astype(float)
        assert noisy.mean() == pytest.approx(brightness, abs=0.1)
        deviations.append(noisy.std())
    assert 0.8 < deviations[0] < deviations[1] < 3

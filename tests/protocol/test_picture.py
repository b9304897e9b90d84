import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Observer
from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView


def gradient(width_px: int, height_px: int) -> np.ndarray:
    """Red rises to the right, green downwards, blue is constant."""
    frame = np.zeros((height_px, width_px, 3), np.uint8)
    frame[..., 0] = np.linspace(0, 255, width_px)[None, :]
    frame[..., 1] = np.linspace(0, 255, height_px)[:, None]
    frame[..., 2] = 77
    return frame


@settings(max_examples=25)
@given(st.integers(64, 700), st.integers(64, 600))
def test_the_full_view_is_the_frames_area_average(width_px: int, height_px: int) -> None:
    observer = Observer(nominal_pi_camera(width_px, height_px), FULL_VIEW)
    observation = observer.observe(gradient(width_px, height_px))
    assert observation.shape == (64, 64, 3)
    assert observation.dtype == np.uint8
    expected = (np.arange(64) + 0.5) / 64 * 255
    np.testing.assert_allclose(observation[32, :, 0], expected, atol=4)
    np.testing.assert_allclose(observation[:, 32, 1], expected, atol=4)
    assert (observation[..., 2] == 77).all()


def test_area_resampling_keeps_a_distant_objects_light() -> None:
    # A red spot of 3 x 3 of 640 x 480 pixels must not fall between samples.
    observer = Observer(nominal_pi_camera(640, 480), FULL_VIEW)
    for x in range(300, 320):
        frame = np.zeros((480, 640, 3), np.uint8)
        frame[200:203, x : x + 3, 0] = 255
        total = observer.observe(frame)[..., 0].astype(float).sum()
        assert total == pytest.approx(9 * 255 / 75, rel=0.12)


def test_a_square_crop_shows_the_middle() -> None:
    camera = nominal_pi_camera(320, 240)
    observer = Observer(camera, FieldOfView(42.9, 42.9))
    observation = observer.observe(gradient(320, 240))
    edge_px = camera.principal_x_px - camera.focal_x_px * np.tan(np.radians(42.9 / 2))
    assert observation[32, 0, 0] == pytest.approx(edge_px / 319 * 255, abs=4)


def test_distortion_is_undone() -> None:
    # Draw straight-line rays through a lens, then look whether they come out where they belong.
    import cv2

    camera = CameraModel(640, 480, 610.0, 611.0, 325.0, 236.0, (-0.1, 0.04, 0.001, -0.001, 0.0))
    observer = Observer(camera, FULL_VIEW)
    ideal = CameraModel.from_field_of_view(64, 64, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg)
    for u, v in [(10, 12), (50, 9), (32, 32), (8, 55), (58, 52)]:
        ray = np.array(
            [
                (u - ideal.principal_x_px) / ideal.focal_x_px,
                (v - ideal.principal_y_px) / ideal.focal_y_px,
                1.0,
            ]
        )
        pixels, _ = cv2.projectPoints(
            ray[None], np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
        )
        frame = np.zeros((480, 640, 3), np.uint8)
        x, y = (round(float(value)) for value in pixels.ravel())
        frame[y - 4 : y + 5, x - 4 : x + 5] = 255
        seen = observer.observe(frame)[..., 0].astype(float)
        rows, columns = np.mgrid[0:64, 0:64]
        assert (seen * columns).sum() / seen.sum() == pytest.approx(u, abs=0.2)
        assert (seen * rows).sum() / seen.sum() == pytest.approx(v, abs=0.2)


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((240, 321, 3), np.uint8),
        np.zeros((240, 320), np.uint8),
        np.zeros((240, 320, 3), np.float32),
    ],
)
def test_another_shape_is_refused_by_name(frame: np.ndarray) -> None:
    with pytest.raises(ContractError, match=r"expected uint8 \(240, 320, 3\)"):
        Observer(nominal_pi_camera(320, 240), FULL_VIEW).observe(frame)


def test_scaling_a_camera_keeps_its_rays() -> None:
    camera = CameraModel(640, 480, 610.0, 611.0, 325.0, 236.0)
    half = camera.scaled_to(320, 240)
    for x in (0.0, 100.0, 639.0):
        ray = (x - camera.principal_x_px) / camera.focal_x_px
        assert half.focal_x_px * ray + half.principal_x_px == pytest.approx((x + 0.5) / 2 - 0.5)

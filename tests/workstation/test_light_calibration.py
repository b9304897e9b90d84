import json
import math
from collections.abc import Sequence
from dataclasses import fields
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.calibrate_camera import light as light_command
from mbot_workstation.measure.calibration.light.colour_difference import ciede2000, lab, srgb_level
from mbot_workstation.measure.calibration.light.gray_card import read_card
from mbot_workstation.measure.calibration.light.light_fit import (
    LEAST_ERROR,
    WORST_DIRECTION_DEG,
    fit_light,
    shade,
)
from mbot_workstation.measure.calibration.light.light_result import CardPhotograph
from mbot_workstation.sim.calibrated.calibration_folder import read_calibration
from mbot_workstation.sim.scene.scene_parameters import Light

from .called import output_of
from .card_pictures import HEIGHT_PX, WIDTH_PX, Facing, photographs

LAMP = Light(direction=(0.45, -0.6, -0.66), ambient=0.45)
"""From behind the robot, its left and above: another one than the nominal window."""
GAINS = (0.85 * 1.15, 0.85, 0.85 * 0.8)
FACINGS = [
    Facing(left, up)
    for left, up in ((0, 0), (35, 0), (-35, 0), (0, 35), (25, 30), (-25, 25), (0, -20))
]
CAMERA = nominal_pi_camera(WIDTH_PX, HEIGHT_PX)

SHARMA = """
    50.0000 2.6772 -79.7751  50.0000 0.0000 -82.7485  2.0425
    50.0000 3.1571 -77.2803  50.0000 0.0000 -82.7485  2.8615
    50.0000 2.8361 -74.0200  50.0000 0.0000 -82.7485  3.4412
    50.0000 -1.3802 -84.2814  50.0000 0.0000 -82.7485  1.0000
    50.0000 -1.1848 -84.8006  50.0000 0.0000 -82.7485  1.0000
    50.0000 -0.9009 -85.5211  50.0000 0.0000 -82.7485  1.0000
    50.0000 0.0000 0.0000  50.0000 -1.0000 2.0000  2.3669
    50.0000 -1.0000 2.0000  50.0000 0.0000 0.0000  2.3669
    50.0000 2.4900 -0.0010  50.0000 -2.4900 0.0009  7.1792
    50.0000 2.4900 -0.0010  50.0000 -2.4900 0.0010  7.1792
    50.0000 2.4900 -0.0010  50.0000 -2.4900 0.0011  7.2195
    50.0000 2.4900 -0.0010  50.0000 -2.4900 0.0012  7.2195
    50.0000 -0.0010 2.4900  50.0000 0.0009 -2.4900  4.8045
    50.0000 -0.0010 2.4900  50.0000 0.0010 -2.4900  4.8045
    50.0000 -0.0010 2.4900  50.0000 0.0011 -2.4900  4.7461
    50.0000 2.5000 0.0000  50.0000 0.0000 -2.5000  4.3065
    50.0000 2.5000 0.0000  73.0000 25.0000 -18.0000  27.1492
    50.0000 2.5000 0.0000  61.0000 -5.0000 29.0000  22.8977
    50.0000 2.5000 0.0000  56.0000 -27.0000 -3.0000  31.9030
    50.0000 2.5000 0.0000  58.0000 24.0000 15.0000  19.4535
    50.0000 2.5000 0.0000  50.0000 3.1736 0.5854  1.0000
    50.0000 2.5000 0.0000  50.0000 3.2972 0.0000  1.0000
    50.0000 2.5000 0.0000  50.0000 1.8634 0.5757  1.0000
    50.0000 2.5000 0.0000  50.0000 3.2592 0.3350  1.0000
    60.2574 -34.0099 36.2677  60.4626 -34.1751 39.4387  1.2644
    63.0109 -31.0961 -5.8663  62.8187 -29.7946 -4.0864  1.2630
    61.2901 3.7196 -5.3901  61.4292 2.2480 -4.9620  1.8731
    35.0831 -44.1164 3.7933  35.0232 -40.0716 1.5901  1.8645
    22.7233 20.0904 -46.6940  23.0331 14.9730 -42.5619  2.0373
    36.4612 47.8580 18.3852  36.2715 50.5065 21.2231  1.4146
    90.8027 -2.0831 1.4410  91.1528 -1.6435 0.0447  1.4441
    90.9257 -0.5406 -0.9208  88.6381 -0.8985 -0.7239  1.5381
    6.7747 -0.2908 -2.4247  5.8714 -0.0985 -2.2286  0.6377
    2.0776 0.0795 -1.1350  0.9033 -0.0636 -0.5514  0.9082
"""
"""L, a, b of two colours and their difference: Sharma, Wu, Dalal (2005), table 1."""


def test_ciede2000_gives_the_published_differences() -> None:
    table = np.array(SHARMA.split(), float).reshape(-1, 7)
    assert len(table) == 34
    np.testing.assert_allclose(ciede2000(table[:, :3], table[:, 3:6]), table[:, 6], atol=5e-5)
    np.testing.assert_allclose(ciede2000(table[:, 3:6], table[:, :3]), table[:, 6], atol=5e-5)


def test_srgb_becomes_lab() -> None:
    np.testing.assert_allclose(lab([255, 255, 255]), [100, 0, 0], atol=1e-3)
    np.testing.assert_allclose(lab([0, 0, 0]), 0, atol=1e-9)
    np.testing.assert_allclose(lab([255, 0, 0]), [53.24, 80.09, 67.20], atol=0.01)
    assert lab([srgb_level(0.18)] * 3)[0] == pytest.approx(49.5, abs=0.05)  # L* of 18 %


@st.composite
def lights(draw: st.DrawFn) -> Light:
    turn, height = draw(st.floats(0, 2 * math.pi)), draw(st.floats(0.2, 1.4))
    across = math.cos(height)
    direction = (across * math.cos(turn), across * math.sin(turn), -math.sin(height))
    return Light(direction, draw(st.floats(0.1, 0.85)))


def knowable_deg(design: NDArray, light: Light) -> float:
    """How well a light's direction can be known from readings good to 1 %: half its 95 % cone.

    Of a light in which all cards are, by the textbook: the covariance of a linear fit, across the
    light's vector.
    """
    towards = -np.array(light.direction) / np.linalg.norm(light.direction)
    vector = (1 - light.ambient) * towards
    readings = design @ [light.ambient, *vector]
    inverse = np.linalg.pinv(design)
    covariance = (LEAST_ERROR * readings.mean()) ** 2 * (inverse @ inverse.T)[1:, 1:]
    one, other = np.linalg.svd(vector[None])[2][1:]
    across = [[a @ covariance @ b for b in (one, other)] for a in (one, other)]
    widest = max(np.linalg.eigvals(across).real)
    return math.degrees(math.atan2(2 * math.sqrt(widest), 1 - light.ambient))


@example(
    light=Light((-0.4032098391861156, 0.881029571880929, -0.24740395925452294), 0.5),
    gain=1.0,
    seed=9981,
)  # was found as an ambient share of 0.688: the fit had settled on cards that were not lit
@example(
    light=Light((0.17036939949395286, 0.5127385780712221, -0.8414709848078965), 0.84765625),
    gain=1.0,
    seed=3902,
)  # is declined: a sixth of the light has a direction, known to 30 degrees
@given(light=lights(), gain=st.floats(0.3, 2), seed=st.integers(0, 10_000))
def test_the_light_is_recovered_or_declined_but_never_wrong(
    light: Light, gain: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    normals = [
        Facing(left, up).normal
        for left, up in zip(rng.uniform(-50, 50, 9), rng.uniform(-30, 60, 9), strict=True)
    ]
    levels = np.array([118 * gain * shade(normal, light) for normal in normals])
    found = fit_light(np.stack([1.2 * levels, levels, 0.7 * levels], axis=1), normals, 118, Light())
    assert (found.red_gain, found.blue_gain) == (pytest.approx(1.2), pytest.approx(0.7))
    all_lit = all(shade(normal, light) > light.ambient for normal in normals)
    design = np.column_stack([np.ones(len(normals)), normals])
    can_tell = np.linalg.cond(design) < 50 and knowable_deg(design, light) <= WORST_DIRECTION_DEG
    assert found.undetermined is None or not (all_lit and can_tell)
    if found.undetermined is None:
        assert found.light.ambient == pytest.approx(light.ambient, abs=0.02)
        assert found.exposure_gain == pytest.approx(gain, rel=0.03)
        assert np.dot(found.light.direction, light.direction) > 0.99
    else:
        assert found.light == Light()


@cache
def taken(*, framed: bool = True) -> list[NDArray]:
    return photographs(LAMP, GAINS, FACINGS, framed=framed)


def saved(folder: Path, pictures: Sequence[NDArray]) -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{number:02d}.png" for number in range(len(pictures))]
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(str(path), np.ascontiguousarray(picture[..., ::-1]))
    return [str(path) for path in paths]


run = partial(output_of, light_command)


@pytest.mark.slow
def test_photographs_under_another_light_bring_the_simulation_to_it(tmp_path: Path) -> None:
    paths, folder = saved(tmp_path / "photos", taken()), tmp_path / "calibration"
    found = json.loads(
        run(*paths, "--card-mm", "100", "100", "--calibration", str(folder), "--json")
    )
    assert found["exposure_gain"] == pytest.approx(0.85, rel=0.03)
    assert found["red_gain"] == pytest.approx(1.15, rel=0.02)
    assert found["blue_gain"] == pytest.approx(0.8, rel=0.02)
    assert found["ambient"] == pytest.approx(0.45, abs=0.04)
    towards = np.array(LAMP.direction) / np.linalg.norm(LAMP.direction)
    assert np.degrees(np.arccos(np.dot(found["direction"], towards))) < 6
    assert found["photographs"][0].keys() == {field.name for field in fields(CardPhotograph)}
    assert found["delta_e_before"] > 8
    assert found["delta_e_after"] < 1
    read = read_calibration(folder)
    assert read.scene.light.ambient == pytest.approx(found["ambient"])
    assert read.effects.blue_gain == pytest.approx(found["blue_gain"])
    assert cv2.imread(str(folder / "light.png")) is not None


@pytest.mark.slow
def test_facings_may_be_told_and_the_card_found_without_a_frame(tmp_path: Path) -> None:
    paths = saved(tmp_path / "photos", taken(framed=False))
    facings = [word for f in FACINGS for word in ("--facing", f"{f.left}:{f.up}")]
    options = [*paths, *facings, "--card", "310,165,20,20", "--calibration", str(tmp_path)]
    said = run(*options)
    assert "% from all sides" in said
    read = read_calibration(tmp_path)
    towards = np.array(LAMP.direction) / np.linalg.norm(LAMP.direction)
    assert np.degrees(np.arccos(np.dot(read.scene.light.direction, towards))) < 6
    run(*options, "--heading", "90")
    turned = read_calibration(tmp_path).scene.light.direction
    x, y, _ = read.scene.light.direction
    assert turned[:2] == pytest.approx((-y, x), abs=0.05), "the robot looked to the left"


@pytest.mark.slow
def test_one_facing_tells_colour_only_and_says_so(tmp_path: Path) -> None:
    paths = saved(tmp_path / "photos", [taken()[0]] * 4)
    said = run(*paths, "--card-mm", "100", "100", "--calibration", str(tmp_path))
    assert "can't be told and stays nominal: all cards face one way" in said
    read = read_calibration(tmp_path)
    assert read.scene.light == Light()
    assert read.effects.red_gain == pytest.approx(1.15, rel=0.02)
    (path,) = saved(tmp_path / "plain", taken(framed=False)[:1])
    assert "of 0 of 1 photographs how the card is turned" in run(
        path, "--calibration", str(tmp_path)
    )


def test_a_card_turned_about_one_axis_leaves_the_lights_height_open() -> None:
    normals = [Facing(left, 0).normal for left in (-50, -25, 0, 25, 50)]
    levels = np.array([118 * shade(normal, LAMP) for normal in normals])
    found = fit_light(np.stack([levels] * 3, axis=1), normals, 118, Light())
    assert found.undetermined is not None
    assert "about one axis only" in found.undetermined


def card(level: int = 118, *, width: int = 160) -> NDArray[np.uint8]:
    rng = np.random.default_rng(0)
    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), (150, 140, 90), np.uint8)
    picture[120:240, 200 : 200 + width] = level
    return np.clip(picture + rng.normal(0, 1, picture.shape), 0, 255).astype(np.uint8)


def test_a_three_patch_card_is_read_by_its_gray(tmp_path: Path) -> None:
    picture = card(width=240)
    picture[120:240, 200:280], picture[120:240, 360:440] = 230, 50
    (path,) = saved(tmp_path, [picture])
    reading = read_card(picture, "x", CAMERA, (240, 120), (200, 120, 240, 120), three_patches=True)
    np.testing.assert_allclose(reading.rgb, 118, atol=1)
    assert reading.white is not None
    assert reading.white.mean() == pytest.approx(230, abs=1)
    options = ["--card", "200,120,240,120", "--calibration", str(tmp_path)]
    run(path, "--three-patches", *options)
    with pytest.raises(ConfigurationError, match=r"unevenly lit, levels from 50 to 230"):
        run(path, *options)
    (plain,) = saved(tmp_path / "plain", [card(width=240)])
    with pytest.raises(ConfigurationError, match="expected black, gray and white"):
        run(plain, "--three-patches", *options)


def test_what_cannot_be_measured_is_named(tmp_path: Path) -> None:
    two = card()
    two[300:420, 60:220] = 100
    shaded = card()
    shaded[120:240, 270:360] //= 2
    for picture, options, message in (
        (card(252), (), r"too bright, levels 25\d"),
        (card(3), ("--card", "210,130,100,80"), "too dark"),
        (shaded, ("--card", "210,130,140,100"), "unevenly lit"),
        (np.full((480, 640, 3), 90, np.uint8), (), "no gray card found"),
        (two, (), "2 rectangles could be the gray card"),
        (card()[:300], (), r"is 640 x 300, expected the shape of the robot's camera"),
        (card(), ("--card", "600,0,100,100"), r"--card is 600,0,100,100.*within 640 x 480"),
        (card(), ("--card", "1,2,3"), "--card is '1,2,3', expected X,Y,WIDTH,HEIGHT"),
        (card(), ("--facing", "0:0", "--facing", "1:1"), "2 --facing for 1 photographs"),
        (card(), ("--facing", "left"), "--facing is 'left', expected LEFT:UP"),
        (card(), ("--facing", "120:0"), "--facing is '120:0'"),
    ):
        (path,) = saved(tmp_path, [picture])
        with pytest.raises(ConfigurationError, match=message):
            run(path, *options, "--calibration", str(tmp_path / "calibration"))
    assert not (tmp_path / "calibration").exists()


def test_a_plain_card_is_found() -> None:
    reading = read_card(card(), "x", CAMERA, (160, 120))
    np.testing.assert_allclose(reading.rgb, 118, atol=0.5)
    assert reading.outline_px.mean(axis=0) == pytest.approx((279.5, 179.5), abs=2)

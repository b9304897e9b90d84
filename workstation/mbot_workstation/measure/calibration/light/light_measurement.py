"""From photographs of a gray card to light.toml: reading, fit, and a look at the simulated card."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.light.colour_difference import ciede2000, lab, srgb_level
from mbot_workstation.measure.calibration.light.gray_card import CardReading, Rectangle, read_card
from mbot_workstation.measure.calibration.light.light_fit import LightFit, Values, fit_light
from mbot_workstation.measure.calibration.light.simulated_card import camera_axes, simulated_card
from mbot_workstation.pictures.picture_file import read_picture
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.scene.scene_parameters import Light

TOWARDS_ROBOT = np.array([-1.0, 0.0, 0.0])
"""A card of unknown facing is taken to be held upright before the camera."""

ASPECT_TOLERANCE = 0.02

BLACK_SHARE = 0.04
"""Reflectance of the black patch of a usual three-patch card."""


@dataclass(frozen=True, slots=True)
class CardSettings:
    """What the user says about the card.

    Attributes:
        card_mm: width and height in its frame.
        reflectance: share of light it reflects; 0.18 for a photographer's gray card.
        three_patches: white, gray and black side by side.
        rectangle: where it is in every photograph; None finds it.
        facings: for each photograph, how far the card is turned to the robot's left from facing the
            robot, and tilted up, in degrees; none if the frame tells it, or nobody knows.

    """

    card_mm: tuple[float, float]
    reflectance: float = 0.18
    three_patches: bool = False
    rectangle: Rectangle | None = None
    facings: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class LightMeasurement:
    """What came out.

    Attributes:
        fit: exposure, white balance and light, seen from the robot's start.
        readings: of each photograph.
        normals: out of each card, in the robot's axes; None if not known.
        before, after: levels of the simulated card, shape (n, 3), with the nominal and the fitted
            light.
        differences_before, differences_after: CIEDE2000 to the real card, shape (n,).
        notes: what a person should know.

    """

    fit: LightFit
    readings: tuple[CardReading, ...]
    normals: tuple[Values | None, ...]
    before: Values
    after: Values
    differences_before: Values
    differences_after: Values
    notes: tuple[str, ...]


def measure_light(
    paths: Sequence[Path],
    robot: RobotParameters,
    settings: CardSettings,
    done: Callable[[int], None] = lambda _count: None,
) -> LightMeasurement:
    """Measure the light.

    Args:
        paths: photographs by the robot's camera, from one place.
        robot: its camera and mount.
        settings: about the card.
        done: called with the number of photographs read.

    Raises:
        ConfigurationError: a photograph can't be used.

    """
    if settings.facings and len(settings.facings) != len(paths):
        raise ConfigurationError(
            f"{len(settings.facings)} --facing for {len(paths)} photographs, expected one each, in "
            "their order"
        )
    readings: list[CardReading] = []
    for path in paths:
        readings.append(_read(path, robot, settings))
        done(len(readings))
    axes = camera_axes(robot)
    normals = tuple(
        _given(settings.facings[index])
        if settings.facings
        else None
        if reading.normal is None
        else axes @ reading.normal
        for index, reading in enumerate(readings)
    )
    rgb = np.array([reading.rgb for reading in readings])
    level = round(srgb_level(settings.reflectance))
    fit = fit_light(rgb, normals, level, Light())
    faced = [TOWARDS_ROBOT if normal is None else normal for normal in normals]
    before = simulated_card(robot, Light(), (1.0, 1.0, 1.0), level, faced)
    gains = (fit.exposure_gain * fit.red_gain, fit.exposure_gain, fit.exposure_gain * fit.blue_gain)
    after = simulated_card(robot, fit.light, gains, level, faced)
    real = lab(rgb)
    return LightMeasurement(
        fit,
        tuple(readings),
        normals,
        before,
        after,
        ciede2000(lab(before), real),
        ciede2000(lab(after), real),
        _notes(readings, level),
    )


def turned(light: Light, heading_deg: float) -> Light:
    """The light in the arena, seen by a robot whose heading is turned to the left by so much."""
    turn = np.radians(heading_deg)
    x, y, z = light.direction
    across = (x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn))
    return replace(light, direction=(float(across[0]), float(across[1]), z))


def _read(path: Path, robot: RobotParameters, settings: CardSettings) -> CardReading:
    picture = read_picture(path)
    height, width = picture.shape[:2]
    camera = robot.camera
    usual = camera.width_px / camera.height_px
    if abs(width / height / usual - 1) > ASPECT_TOLERANCE:
        raise ConfigurationError(
            f"{path} is {width} x {height}, expected the shape of the robot's camera, such as "
            f"{camera.width_px} x {camera.height_px}: take the photographs with that camera, as it "
            "sees the arena"
        )
    return read_card(
        picture,
        path.name,
        camera.scaled_to(width, height),
        settings.card_mm,
        settings.rectangle,
        three_patches=settings.three_patches,
    )


def _given(facing: tuple[float, float]) -> Values:
    """The normal of a card turned left and tilted up by degrees from facing the robot."""
    left, up = np.radians(facing)
    return np.array([-np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)])


def _notes(readings: Sequence[CardReading], level: int) -> tuple[str, ...]:
    notes: list[str] = []
    for reading in readings:
        if reading.white is None or reading.black is None:
            continue
        if reading.white.max() > 249:
            notes.append(f"{reading.name}: white is cut off; bright things will look alike")
        expected = srgb_level(BLACK_SHARE) / level
        found = reading.black.mean() / reading.rgb.mean()
        if found > 1.4 * expected:
            notes.append(
                f"{reading.name}: black is {found:.2f} of gray, expected about {expected:.2f}: "
                "stray light or a raised black level, which the simulation does not have"
            )
    return tuple(notes)

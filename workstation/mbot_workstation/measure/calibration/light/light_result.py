"""The result of a light's calibration: what is written, and what is said of it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.light.light_drawing import draw_light
from mbot_workstation.measure.calibration.light.light_measurement import LightMeasurement, turned
from mbot_workstation.sim.calibrated.calibration_folder import write_light
from mbot_workstation.sim.calibrated.light_calibration import LightCalibration


@dataclass(frozen=True, slots=True)
class CardPhotograph:
    """A gray card: levels, how it was turned as `--facing` takes it, CIEDE2000 off."""

    name: str
    rgb: list[float]
    turned: str
    delta_e_before: float
    delta_e_after: float


@dataclass(frozen=True, slots=True)
class LightResult:
    """Gains against the nominal camera, and the light: its way in the room, its share from all
    sides, and why its way can't be told, if it can't.
    """

    exposure_gain: float
    red_gain: float
    blue_gain: float
    direction: Sequence[float]
    direction_known_to_deg: float | None
    ambient: float
    undetermined: str | None
    delta_e_before: float
    delta_e_after: float
    photographs: list[CardPhotograph]
    notes: Sequence[str]
    path: Path


def save_light(measured: LightMeasurement, folder: Path, heading_deg: float) -> LightResult:
    """Write light.toml and light.png.

    Args:
        measured: from the photographs.
        folder: the robot's calibration.
        heading_deg: where the robot looked, to the left of the middle of its room's panorama.

    Raises:
        ConfigurationError: no usable light, or a file can't be written.

    """
    fit = measured.fit
    light = fit.light if fit.undetermined else turned(fit.light, heading_deg)
    before = float(measured.differences_before.mean())
    after = float(measured.differences_after.mean())
    try:
        calibration = LightCalibration(
            exposure_gain=fit.exposure_gain,
            red_gain=fit.red_gain,
            blue_gain=fit.blue_gain,
            direction=light.direction,
            ambient=light.ambient,
            delta_e_before=before,
            delta_e_after=after,
            pictures=len(measured.readings),
            made_on=datetime.now().astimezone().date().isoformat(),
        )
    except ValueError as error:
        raise ConfigurationError(f"these photographs give no usable light: {error}") from None
    path = write_light(folder, calibration)
    draw_light(measured, folder / "light.png")
    photographs = [
        CardPhotograph(
            reading.name,
            reading.rgb.tolist(),
            _turn_words(measured.normals[index]),
            float(measured.differences_before[index]),
            float(measured.differences_after[index]),
        )
        for index, reading in enumerate(measured.readings)
    ]
    return LightResult(
        exposure_gain=fit.exposure_gain,
        red_gain=fit.red_gain,
        blue_gain=fit.blue_gain,
        direction=light.direction,
        direction_known_to_deg=fit.direction_deg,
        ambient=light.ambient,
        undetermined=fit.undetermined,
        delta_e_before=before,
        delta_e_after=after,
        photographs=photographs,
        notes=measured.notes,
        path=path,
    )


def photograph_rows(measured: LightMeasurement) -> Iterator[tuple[str, ...]]:
    """A row a photograph: the card as it was seen, as it was turned, simulated, calibrated."""
    for index, reading in enumerate(measured.readings):
        yield (
            reading.name,
            _levels(reading.rgb),
            _turn_words(measured.normals[index]),
            _levels(measured.before[index]),
            f"{measured.differences_before[index]:.1f}",
            _levels(measured.after[index]),
            f"{measured.differences_after[index]:.1f}",
        )


def light_lines(measured: LightMeasurement) -> Iterator[str]:
    """For people: gains, the light, how near the simulation comes, notes."""
    fit = measured.fit
    yield (
        f"exposure {fit.exposure_gain:.3f}, red {fit.red_gain:.3f}, blue {fit.blue_gain:.3f} "
        "against the simulation's"
    )
    if fit.undetermined is None:
        x, y, z = fit.light.direction
        yield (
            f"light shines towards {x:+.2f}, {y:+.2f}, {z:+.2f} (ahead, left, up; +-"
            f"{fit.direction_deg:.0f} degrees), {100 * fit.light.ambient:.0f} % from all sides"
        )
    else:
        yield f"the light's direction can't be told and stays nominal: {fit.undetermined}"
    yield (
        f"colour difference (CIEDE2000) {measured.differences_before.mean():.1f} before, "
        f"{measured.differences_after.mean():.1f} after"
    )
    for note in measured.notes:
        yield f"note: {note}"


def _levels(rgb: Any) -> str:
    return " ".join(f"{value:.0f}" for value in rgb)


def _turn_words(normal: Any) -> str:
    """How far a card is turned left and up, as --facing takes it."""
    if normal is None:
        return "?"
    left = math.degrees(math.atan2(normal[1], -normal[0]))
    up = math.degrees(math.asin(max(-1.0, min(1.0, normal[2]))))
    return f"{round(left)}:{round(up)}"

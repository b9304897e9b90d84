"""light.toml: how bright and how coloured the robot's own camera shows its own rooms."""

import math

from msgspec import Struct

from mbot_protocol.drive.calibration import check_date, check_range

LIGHT_FILE = "light.toml"

LARGEST_DELTA_E = 200.0
"""CIEDE2000 between black and white is 100; saturated colours reach a little more."""


class LightCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """From photographs of a gray card to the simulation's light.

    Attributes:
        exposure_gain: brightness of the camera's pictures against the simulation's.
        red_gain, blue_gain: white balance against green.
        direction: x, y, z the light shines in; any length.
        ambient: share of light that comes from everywhere, in [0, 1].
        delta_e_before, delta_e_after: CIEDE2000 between real and simulated gray card.
        pictures: how many were used.
        made_on: ISO date.

    Raises:
        ValueError: a value is out of its range.

    """

    exposure_gain: float
    red_gain: float
    blue_gain: float
    direction: tuple[float, float, float]
    ambient: float
    delta_e_before: float
    delta_e_after: float
    pictures: int
    made_on: str

    def __post_init__(self) -> None:
        for name in ("exposure_gain", "red_gain", "blue_gain"):
            check_range(name, getattr(self, name), 0.05, 20)
        if not math.isfinite(sum(self.direction)) or math.hypot(*self.direction) < 1e-6:
            raise ValueError(f"direction is {list(self.direction)}, expected a finite x, y, z")
        if self.direction[2] >= 0:
            raise ValueError(
                f"direction is {list(self.direction)}: a light that shines upwards; expected a "
                "negative z, since it is where the light goes, not where it comes from"
            )
        check_range("ambient", self.ambient, 0, 1)
        for name in ("delta_e_before", "delta_e_after"):
            check_range(name, getattr(self, name), 0, LARGEST_DELTA_E)
        check_range("pictures", self.pictures, 1, 100_000)
        check_date(self.made_on)

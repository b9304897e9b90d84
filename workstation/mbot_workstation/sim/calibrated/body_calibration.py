"""body.toml: what the robot is made of, weighed and measured by hand.

The same file is what a person fills in for `workstation calibrate body`, and what is kept in the
calibration folder once it has been checked. Uncertainties are those of a 95 % interval: the
"plus or minus" one would say aloud.
"""

import re

from msgspec import Struct

from mbot_protocol.drive.calibration import check_range

BODY_FILE = "body.toml"

Metres3 = tuple[float, float, float]

LONGEST_M = 0.5
"""Nothing on such a robot is longer or further out; a size in millimetres is."""

HEAVIEST_KG = 5.0
LIGHTEST_KG = 0.00005
LIGHTEST_KG_M3, DENSEST_KG_M3 = 5.0, 12_000.0
"""From a box around an open frame to solid lead; grams taken for kilograms are far outside."""

UNKNOWN_COLOUR = (0.6, 0.6, 0.6)

CAMERA_TILT_DEG = 60.0


class Component(Struct, frozen=True, forbid_unknown_fields=True):
    """One part of the robot as a solid box along its axes.

    Attributes:
        name: unique.
        mass_kg, mass_uncertainty_kg: as weighed.
        size_m: full edge lengths along x (forward), y (left), z (up).
        centre_m: its centre; x and y from the axle's centre, z from the floor.
        source: where the figures are from: scale, ruler, data sheet, CAD, a guess.
        centre_uncertainty_m: of each coordinate of the centre.
        colour_rgb: each in [0, 1]; for drawings and the simulation.

    Raises:
        ValueError: a value is out of its range.

    """

    name: str
    mass_kg: float
    mass_uncertainty_kg: float
    size_m: Metres3
    centre_m: Metres3
    source: str
    centre_uncertainty_m: float = 0.002
    colour_rgb: tuple[float, float, float] = UNKNOWN_COLOUR

    def __post_init__(self) -> None:
        if not re.fullmatch(r"\S(.{0,38}\S)?", self.name):
            raise ValueError(f"name is {self.name!r}, expected 1 to 40 characters")
        if not self.source.strip():
            raise ValueError(f"{self.name!r} has no source: say how it was weighed and measured")
        _check_mass(self.name, "mass_kg", self.mass_kg)
        if not 0 <= self.mass_uncertainty_kg <= self.mass_kg:
            raise ValueError(
                f"{self.name!r}: mass_uncertainty_kg is {self.mass_uncertainty_kg}, expected 0 to "
                f"the mass itself, {self.mass_kg}; it counts in kilograms, 1 g is 0.001"
            )
        for axis, edge_m in zip("xyz", self.size_m, strict=True):
            _check_metres(self.name, f"size_m along {axis}", edge_m, 0.0002, LONGEST_M)
        for axis, least, place_m in zip("xyz", (-1, -1, 0), self.centre_m, strict=True):
            _check_metres(
                self.name, f"centre_m along {axis}", place_m, least * LONGEST_M, LONGEST_M
            )
        _check_metres(self.name, "centre_uncertainty_m", self.centre_uncertainty_m, 0, 0.1)
        bottom_m = self.centre_m[2] - self.size_m[2] / 2
        if bottom_m < -0.0005:
            raise ValueError(
                f"{self.name!r} reaches {-bottom_m * 1000:.1f} mm below the floor: centre_m is the "
                f"box's middle, so its z is at least half its height, {self.size_m[2] / 2:g}"
            )
        length_m, width_m, height_m = self.size_m
        density = self.mass_kg / (length_m * width_m * height_m)
        if not LIGHTEST_KG_M3 <= density <= DENSEST_KG_M3:
            raise ValueError(
                f"{self.name!r}: mass_kg is {self.mass_kg} in a box of {_mm(self.size_m)}, a "
                f"density of {density:.3g} kg/m3, expected {LIGHTEST_KG_M3:g} to "
                f"{DENSEST_KG_M3:g}; are these kilograms and metres?"
            )
        for value in self.colour_rgb:
            check_range(f"{self.name!r}: colour_rgb", value, 0, 1)


class MountCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the camera sits; see `simulation.robot_parameters.CameraMount`.

    Raises:
        ValueError: a value is out of its range.

    """

    height_m: float
    ahead_m: float
    left_m: float = 0.0
    pitch_down_deg: float = 0.0
    yaw_left_deg: float = 0.0
    roll_clockwise_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_metres("camera_mount", "height_m", self.height_m, 0.005, LONGEST_M)
        _check_metres("camera_mount", "ahead_m", self.ahead_m, -LONGEST_M, LONGEST_M)
        _check_metres("camera_mount", "left_m", self.left_m, -LONGEST_M, LONGEST_M)
        for name in ("pitch_down_deg", "yaw_left_deg", "roll_clockwise_deg"):
            check_range(name, getattr(self, name), -CAMERA_TILT_DEG, CAMERA_TILT_DEG)


class Weighing(Struct, frozen=True, forbid_unknown_fields=True):
    """Several parts on the scale at once, which the single ones have to add up to.

    Attributes:
        what: for messages.
        mass_kg, uncertainty_kg: what the scale showed.
        parts: names of components; "wheels" is the pair of them. None is the whole robot.

    Raises:
        ValueError: a value is out of its range.

    """

    what: str
    mass_kg: float
    uncertainty_kg: float
    parts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_mass(self.what, "mass_kg", self.mass_kg)
        check_range("uncertainty_kg", self.uncertainty_kg, 0, self.mass_kg)


class BodyCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file. What is None stays nominal.

    Attributes:
        components: everything but the two wheels.
        camera_mount: see `MountCalibration`.
        wheel_mass_kg, wheel_mass_uncertainty_kg: of one wheel.
        wheel_radius_m, track_m: by ruler; what driving has shown, motion.toml, counts more.
        caster_ahead_m: where the passive wheel touches the floor, ahead of the axle.
        touch_radius_m: the body as the task sees it, a circle about the axle's centre.
        caster_load_kg: what a scale below the caster shows, the wheels level beside it; checks
            the centre of mass.
        weighings: see `Weighing`.

    Raises:
        ValueError: a value is out of its range, or two components have one name.

    """

    components: tuple[Component, ...]
    camera_mount: MountCalibration | None = None
    wheel_mass_kg: float | None = None
    wheel_mass_uncertainty_kg: float = 0.001
    wheel_radius_m: float | None = None
    track_m: float | None = None
    caster_ahead_m: float | None = None
    touch_radius_m: float | None = None
    caster_load_kg: float | None = None
    weighings: tuple[Weighing, ...] = ()

    def __post_init__(self) -> None:
        if not self.components:
            raise ValueError("there are no [[components]], expected at least one")
        names = [component.name for component in self.components]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"{doubled[0]!r} is there twice: every component needs its own name")
        if self.wheel_mass_kg is not None:
            _check_mass("a wheel", "wheel_mass_kg", self.wheel_mass_kg)
        if self.caster_load_kg is not None:
            _check_mass("the caster", "caster_load_kg", self.caster_load_kg)
        for name, least, most in (
            ("wheel_radius_m", 0.005, 0.15),
            ("track_m", 0.03, 0.6),
            ("caster_ahead_m", -0.3, 0.3),
            ("touch_radius_m", 0.03, 0.4),
        ):
            value = getattr(self, name)
            if value is not None:
                _check_metres("the robot", name, value, least, most)
        known = {*names, "wheels"}
        for weighing in self.weighings:
            if unknown := [part for part in weighing.parts if part not in known]:
                raise ValueError(
                    f"weighing {weighing.what!r} has the part {unknown[0]!r}, expected names of "
                    'components, or "wheels"'
                )


def _check_mass(what: str, key: str, mass_kg: float) -> None:
    if not LIGHTEST_KG <= mass_kg <= HEAVIEST_KG:
        hint = f"; {mass_kg:g} g would be {mass_kg / 1000:g}" if 1 < mass_kg < 10_000 else ""
        raise ValueError(
            f"{what!r}: {key} is {mass_kg}, expected kilograms, {LIGHTEST_KG:g} to "
            f"{HEAVIEST_KG:g}{hint}"
        )


def _check_metres(what: str, key: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        hint = ""
        if LONGEST_M < abs(value) <= 1000:
            cm = f", {value:g} cm {value / 100:g}" if abs(value) < 50 else ""
            hint = f"; {value:g} mm would be {value / 1000:g}{cm}"
        raise ValueError(
            f"{what!r}: {key} is {value}, expected metres, {least:g} to {most:g}{hint}"
        )


def _mm(size_m: Metres3) -> str:
    return " x ".join(f"{edge * 1000:g}" for edge in size_m) + " mm"

"""Do the components make a robot that could be? What does not fit together is said, part by part.

What can't be at all is refused when the file is read; here is what a person should look at.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
from mbot_workstation.sim.body.own_view import MARGIN_DEG, parts_in_view
from mbot_workstation.sim.body.robot_mjcf import TAIL_BEHIND_M
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration, Component, Weighing

WRONG_SHARE = 0.10
"""Of a weighed mass: if the parts are off by more, one is missing or in another unit."""

USUAL_MASS_KG = (0.5, 1.6)
"""A bare mBot is about 0.5 kg; with Pi, camera and batteries 0.8 to 1.1 (assumed)."""

UNEVEN_M = 0.005
"""So far the centre of mass may lie beside the middle."""

SAME_PLACE = 0.8
"""Share of a box that lies in another one of about its size."""

CAMERA_BOX_M = 0.03
"""So far from its box the camera's optical centre may be: a long lens."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something to look at.

    Attributes:
        verdict: "note", or "warning" if it is probably a mistake.
        text: what, and what to do.

    """

    verdict: str
    text: str


def examine(
    origin: Path, body: BodyCalibration, robot: RobotParameters, whole: MassProperties
) -> list[Finding]:
    """Look at everything.

    Args:
        origin: the file, for errors.
        body: what was measured.
        robot: what it makes.
        whole: what it adds up to.

    Raises:
        ConfigurationError: the parts' masses contradict a weighing altogether.

    """
    try:
        findings = [_weighed(body, robot, weighing) for weighing in body.weighings]
        findings += [_total(whole), _balance(body, robot, whole), *_stands(robot, whole)]
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from None
    findings += [_camera(body), *_in_view(body, robot), *_overlaps(body)]
    found = [finding for finding in findings if finding is not None]
    return sorted(found, key=lambda finding: finding.verdict != "warning")


def _weighed(body: BodyCalibration, robot: RobotParameters, weighing: Weighing) -> Finding | None:
    everything = not weighing.parts
    parts = [part for part in body.components if everything or part.name in weighing.parts]
    wheels = 2 if everything or "wheels" in weighing.parts else 0
    mass_kg = sum(part.mass_kg for part in parts) + wheels * robot.wheel_mass_kg
    allowed_kg = math.hypot(
        weighing.uncertainty_kg,
        *(part.mass_uncertainty_kg for part in parts),
        wheels * body.wheel_mass_uncertainty_kg,
    )
    missing_kg = weighing.mass_kg - mass_kg
    what = (
        f"{weighing.what}: the parts add up to {_grams(mass_kg)}, the scale showed "
        f"{_grams(weighing.mass_kg)}"
    )
    if abs(missing_kg) <= allowed_kg:
        return None
    advice = (
        f"{_grams(missing_kg)} are missing: cables, screws, a part left out?"
        if missing_kg > 0
        else f"{_grams(-missing_kg)} are too much: a part weighed with another one on it?"
    )
    if abs(missing_kg) > max(WRONG_SHARE * weighing.mass_kg, allowed_kg):
        raise ConfigurationError(f"{what}; {advice} Or grams taken for kilograms somewhere")
    return Finding(
        "warning", f"{what}, more apart than the {_grams(allowed_kg)} they may be; {advice}"
    )


def _total(whole: MassProperties) -> Finding | None:
    low, high = USUAL_MASS_KG
    if low <= whole.mass_kg <= high:
        return None
    return Finding(
        "warning",
        f"the robot weighs {_grams(whole.mass_kg)}; an mBot with Pi and battery {low:g} to "
        f"{high:g} kg: is a part missing or doubled, or in grams?",
    )


def _balance(
    body: BodyCalibration, robot: RobotParameters, whole: MassProperties
) -> Finding | None:
    """The scale below the caster against the centre of mass."""
    if body.caster_load_kg is None:
        return None
    if body.caster_load_kg >= whole.mass_kg:
        raise ConfigurationError(
            f"caster_load_kg is {body.caster_load_kg}, more than the whole robot, "
            f"{_grams(whole.mass_kg)}"
        )
    weighed_m = robot.caster_ahead_m * body.caster_load_kg / whole.mass_kg
    computed_m, allowed_m = float(whole.centre_m[0]), float(whole.centre_uncertainty_m[0])
    allowed_m = math.hypot(allowed_m, 0.002)  # the scale's edge and the caster's place
    if abs(weighed_m - computed_m) <= allowed_m:
        return None
    return Finding(
        "warning",
        f"by the caster's {_grams(body.caster_load_kg)} the centre of mass is "
        f"{_mm(weighed_m)} ahead of the axle, by the parts {_mm(computed_m)} +- {_mm(allowed_m)}: "
        "look for a part with a wrong x in the drawing",
    )


def _stands(robot: RobotParameters, whole: MassProperties) -> list[Finding]:
    x, y, _ = (float(value) for value in whole.centre_m)
    findings: list[Finding] = []
    near, far = sorted((0.0, robot.caster_ahead_m))
    if not near < x < far:
        side = "behind" if x <= near else "ahead of"
        tail = f", on its tail {_mm(TAIL_BEHIND_M)} behind the axle" if x <= near else ""
        findings.append(
            Finding(
                "warning",
                f"the centre of mass is {_mm(x)} ahead of the axle, {side} what wheels and caster "
                f"hold up ({_mm(near)} to {_mm(far)}): the robot would tip over{tail}; x counts "
                "forward",
            )
        )
    if abs(y) > UNEVEN_M + whole.centre_uncertainty_m[1]:
        findings.append(
            Finding(
                "warning",
                f"the centre of mass is {_mm(abs(y))} to the {'left' if y > 0 else 'right'} of the "
                "middle: is a y without its sign? y counts to the left",
            )
        )
    return findings


def _camera(body: BodyCalibration) -> Finding | None:
    mount = body.camera_mount
    cameras = [part for part in body.components if "camera" in part.name.lower()]
    if mount is None or not cameras:
        return None
    place = np.array([mount.ahead_m, mount.left_m, mount.height_m])
    nearest = min(
        float(np.linalg.norm(np.maximum(np.abs(place - part.centre_m) - _half(part), 0)))
        for part in cameras
    )
    if nearest <= CAMERA_BOX_M:
        return None
    return Finding(
        "warning",
        f"camera_mount puts the lens {_mm(nearest)} away from the component "
        f"{cameras[0].name!r}: one of the two is wrong",
    )


def _in_view(body: BodyCalibration, robot: RobotParameters) -> list[Finding]:
    if body.camera_mount is None:
        return []
    camera = robot.camera
    across, down = (
        math.degrees(2 * math.atan(size_px / 2 / focal_px))
        for size_px, focal_px in (
            (camera.width_px, camera.focal_x_px),
            (camera.height_px, camera.focal_y_px),
        )
    )
    return [
        Finding(
            "warning",
            f"{name!r} reaches into the camera's view or to within {MARGIN_DEG:g} degrees of it, "
            "and the simulation shows it there: does the real camera see it?",
        )
        for name in parts_in_view(robot, across, down)
    ]


def _overlaps(body: BodyCalibration) -> list[Finding]:
    findings: list[Finding] = []
    for one, other in combinations(body.components, 2):
        shared = _half(one) + _half(other) - np.abs(np.subtract(one.centre_m, other.centre_m))
        deepest = int(np.argmin(shared))
        slack = math.hypot(one.centre_uncertainty_m, other.centre_uncertainty_m)
        if shared[deepest] <= slack:
            continue
        smaller = min((one, other), key=lambda part: math.prod(part.size_m))
        inside = np.minimum(shared, 2 * _half(smaller))
        share = float(np.prod(inside) / math.prod(smaller.size_m))
        larger = other if smaller is one else one
        if share > SAME_PLACE and math.prod(smaller.size_m) > math.prod(larger.size_m) / 2:
            findings.append(
                Finding(
                    "warning",
                    f"{one.name!r} and {other.name!r} are in the same place: is a sign missing in "
                    "centre_m? y counts to the left",
                )
            )
            continue
        findings.append(
            Finding(
                "note",
                f"{one.name!r} and {other.name!r} overlap by {_mm(float(shared[deepest]))} along "
                f"{'xyz'[deepest]}, {share:.0%} of {smaller.name!r}: right if one is hollow",
            )
        )
    return findings


def _half(part: Component) -> np.ndarray:
    return np.array(part.size_m) / 2


def _grams(mass_kg: float) -> str:
    return f"{mass_kg * 1000:.0f} g" if mass_kg >= 0.01 else f"{mass_kg * 1000:.1f} g"


def _mm(length_m: float) -> str:
    return f"{length_m * 1000:.1f} mm"

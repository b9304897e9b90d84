"""The result as motion.toml: the simulated robot's numbers, and the daemon's motor maps."""

from datetime import date

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.measure.identification.result import Identification
from mbot_workstation.sim.body.parameter_table import BY_NAME, PARAMETERS, value
from mbot_workstation.sim.calibrated.motion_calibration import (
    Interval,
    MotionCalibration,
    MotorCalibration,
)


def motion_calibration(found: Identification, maps: WheelMaps) -> MotionCalibration:
    """What `write_motion` writes.

    Args:
        found: the result.
        maps: what the daemon shall do with a policy's steps.

    """
    fields: dict[str, dict[str, float]] = {"": {}, "left_motor": {}, "right_motor": {}}
    intervals: dict[str, Interval] = {}
    undetermined: dict[str, str] = {}
    estimates = {one.name: one for one in found.estimates}
    for known in PARAMETERS:
        section, _, field = known.file_key.rpartition(".")
        one, factor = estimates[known.name], known.file_factor
        fields[section][field] = _short(factor * value(found.robot, known.name))
        if one.low is not None and one.high is not None:
            intervals[known.file_key] = Interval(
                _short(factor * one.low), _short(factor * one.high)
            )
        elif one.why_not is not None:
            undetermined[known.file_key] = one.why_not
    latency = found.latency
    if latency.low is not None and latency.high is not None:
        ends = _short(1000 * latency.low), _short(1000 * latency.high)
        intervals[latency.name] = Interval(*ends)
    elif latency.why_not is not None:
        undetermined[latency.name] = latency.why_not
    left, right = (
        MotorCalibration(**fields[section], trim=used.trim, dead_band_compensation=used.dead_band)
        for section, used in (("left_motor", maps.left), ("right_motor", maps.right))
    )
    return MotionCalibration(
        left_motor=left,
        right_motor=right,
        **fields[""],  # pyright: ignore[reportArgumentType]: numbers only
        latency_ms=_short(1000 * latency.value),
        made_on=date.today().isoformat(),
        intervals=intervals,
        undetermined=undetermined,
    )


def known_dead_bands(found: Identification) -> dict[str, float]:
    """By side, of 255: those that the recordings tell."""
    names = {side: f"{side}_dead_band" for side in ("left", "right")}
    told = {one.name for one in found.estimates if one.low is not None}
    return {
        side: BY_NAME[name].file_factor * value(found.robot, name)
        for side, name in names.items()
        if name in told
    }


def _short(number: float) -> float:
    """Six digits: more than any of it deserves."""
    return float(f"{number:.6g}")

"""What the daemon should do about uneven motors: drive straight, or leave it to the policy."""

import math
from dataclasses import dataclass

import numpy as np
from msgspec import structs

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_workstation.measure.identification.conclusions import steady_rate
from mbot_workstation.measure.identification.motion_file import known_dead_bands
from mbot_workstation.measure.identification.result import Identification
from mbot_workstation.measure.identification.rollout import Plan, rollouts
from mbot_workstation.measure.tracks.run import CommandSeries
from mbot_workstation.sim.body.robot_parameters import RobotParameters

WORTH_A_CHOICE = 0.1
"""Of full speed: a trim that costs more is no longer a matter of course."""

LEAST_TRIM = 0.25
"""Below, a motor would hardly turn."""

TRIMS = 17
"""Tried at once, and then again between the two nearest ones."""

FULL_SPEED = CommandSeries(np.array([0.0, 3.0]), np.array([1.0, 0.0]), np.array([1.0, 0.0]))


@dataclass(frozen=True, slots=True)
class TrimChoice:
    """Two ways to drive a robot whose motors differ.

    Attributes:
        straight: motor maps with which equal commands drive straight at full speed.
        left_alone: motor maps without trim; the policy has to correct what the motors do.
        straight_m_s: speed at full command, trimmed.
        alone_m_s, alone_turn_rad_s: speed and turn rate at full command without trim.

    """

    straight: WheelMaps
    left_alone: WheelMaps
    straight_m_s: float
    alone_m_s: float
    alone_turn_rad_s: float

    @property
    def cost(self) -> float:
        """Share of the speed at full command that driving straight takes."""
        return max(0.0, 1 - self.straight_m_s / self.alone_m_s) if self.alone_m_s > 0 else 0.0

    @property
    def is_a_choice(self) -> bool:
        """Whether that is enough to think about."""
        return self.cost > WORTH_A_CHOICE


def trim_choice(found: Identification, recorded: WheelMaps) -> TrimChoice:
    """Find the trim that drives straight, and what it costs.

    Dead bands that are known are skipped, so that equal commands do alike at every speed; those
    that the recordings can't tell stay as the daemon had them.
    """
    bands = known_dead_bands(found)
    alone = WheelMaps(
        left=_map(recorded.left, bands.get("left")), right=_map(recorded.right, bands.get("right"))
    )
    ((speed, turn),) = _rates(found.robot, [alone])
    side = "left" if turn < 0 else "right"  # the stronger one
    trim = _straight_trim(found.robot, alone, side)
    straight = _trimmed(alone, side, trim)
    ((trimmed_speed, _),) = _rates(found.robot, [straight])
    return TrimChoice(straight, alone, trimmed_speed, speed, turn)


def _map(recorded: MotorMap, dead_band: float | None) -> MotorMap:
    skipped = recorded.dead_band if dead_band is None else math.floor(dead_band)
    return MotorMap(recorded.reversed, 1.0, skipped)


def _trimmed(maps: WheelMaps, side: str, trim: float) -> WheelMaps:
    motor: MotorMap = getattr(maps, side)
    # A motor map leaves some range for driving.
    least = (motor.dead_band + 1) / 255
    return structs.replace(maps, **{side: structs.replace(motor, trim=round(max(trim, least), 3))})


def _straight_trim(robot: RobotParameters, maps: WheelMaps, side: str) -> float:
    """Where the turn rate at full command changes sign, to a step of the board."""
    low, high = LEAST_TRIM, 1.0
    for _ in range(2):
        trims = np.linspace(low, high, TRIMS)
        rates = _rates(robot, [_trimmed(maps, side, trim) for trim in trims.tolist()])
        turns = np.array([turn for _, turn in rates])
        first = int(np.argmax(turns < 0 if side == "left" else turns > 0))
        low, high = float(trims[max(first - 1, 0)]), float(trims[first])
    return (low + high) / 2


def _rates(robot: RobotParameters, maps: list[WheelMaps]) -> list[tuple[float, float]]:
    plans = [Plan(FULL_SPEED, one) for one in maps]
    (paths,) = rollouts([robot], plans)
    return [steady_rate(path, plan) for path, plan in zip(paths, plans, strict=True)]

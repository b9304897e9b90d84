"""Does the robot turn as it was told? If not: swapped plugs, a reversed motor, a mirrored frame."""

from collections.abc import Callable, Sequence

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.maneuver import Maneuver
from mbot_workstation.measure.tracks.motion import DrivenRun, numbers_of
from mbot_workstation.measure.tracks.run import UnusableRunError

TURNING_RADPS = 1.0
"""Below this nothing is concluded from a turn: a seventh of a full spin."""

CLEARLY_BETTER = 0.6
"""Another explanation is named if its misfit is below this share of the declared one's."""

CURVING = 0.15
"""Mean sine of the angle between directions 0.1 s apart; a turn of 3 rad/s makes 0.3."""

ODD_SHARE = 0.4
"""A run is odd if its turn rate is off its repetitions' median by this share of a full spin's."""

_TURNS: dict[str, Callable[[Maneuver], float]] = {
    "as told": lambda told: told.right - told.left,
    "opposite": lambda told: told.left - told.right,
    "left motor reversed": lambda told: told.right + told.left,
    "right motor reversed": lambda told: -told.right - told.left,
}


def check_directions(runs: Sequence[DrivenRun]) -> None:
    """Find attitudes that contradict positions, and turns that contradict commands.

    Raises:
        ConfigurationError: with what the recording can tell of the cause, and what it can't.

    """
    _check_path_against_attitude(runs)
    _check_turns(runs)
    _check_repetitions(runs)


def _check_path_against_attitude(runs: Sequence[DrivenRun]) -> None:
    senses = [(_curving(run), run.yaw_radps) for run in runs]
    telling = [(c, y) for c, y in senses if abs(c) > CURVING and abs(y) > TURNING_RADPS]
    against = [1 for curving, yaw in telling if curving * yaw < 0]
    if len(against) > len(telling) / 2:
        raise ConfigurationError(
            f"in {len(against)} of {len(telling)} runs the path curves one way and the attitude "
            "turns the other: positions and quaternions are of different frames. Either two "
            "position columns are exchanged (or one has the wrong sign), or the quaternions turn "
            "the world into the tracker instead of the tracker into the world"
        )


def _check_turns(runs: Sequence[DrivenRun]) -> None:
    names = list(dict.fromkeys(run.run.maneuver for run in runs))
    rates = np.array(
        [np.median([run.yaw_radps for run in runs if run.run.maneuver == name]) for name in names]
    )
    fastest = float(np.abs(rates).max())
    if fastest < TURNING_RADPS:
        return
    told = [next(run.maneuver for run in runs if run.run.maneuver == name) for name in names]
    misfits = {
        cause: float(np.mean(np.abs(rates / fastest - np.array([turn(m) / 2 for m in told]))))
        for cause, turn in _TURNS.items()
    }
    cause = min(misfits, key=lambda name: misfits[name])
    if cause == "as told" or misfits[cause] > CLEARLY_BETTER * misfits["as told"]:
        return
    if cause == "opposite":
        raise ConfigurationError(
            "the robot turns the other way than told in every maneuver, and all else fits. These "
            "recordings can't tell which it is: the motors' plugs exchanged left for right; both "
            "motors reversed; the tracker's frame mirrored (then set handedness to the other one "
            'in track.toml); or its up axis pointing down (then up = "-..."). Turn the robot to '
            "the left by hand while tracking: if its yaw falls, it is the tracker"
        )
    side = cause.split()[0]
    other = "right" if side == "left" else "left"
    raise ConfigurationError(
        f"the robot spins when told to drive straight, and the other way round: the {side} motor "
        f"runs backwards (or the {other} one, if the tracker's frame is mirrored); set `reversed` "
        "in the robot's configuration and record again"
    )


def _check_repetitions(runs: Sequence[DrivenRun]) -> None:
    fastest = max(abs(run.yaw_radps) for run in runs)
    for name in dict.fromkeys(run.run.maneuver for run in runs):
        group = [run for run in runs if run.run.maneuver == name]
        if len(group) < 3:
            continue
        usual = float(np.median([run.yaw_radps for run in group]))
        odd = [run for run in group if abs(run.yaw_radps - usual) > ODD_SHARE * fastest]
        if odd and fastest > TURNING_RADPS:
            raise UnusableRunError.of(
                odd[0].run.number,
                f"{odd[0].name} turns at {odd[0].yaw_radps:.1f} rad/s, the other repetitions at "
                f"{usual:.1f}: another maneuver, or spoilt ({numbers_of(odd)} in all)",
            )


def _curving(run: DrivenRun) -> float:
    """Mean sine of the change of direction over 0.1 s, positive to the left."""
    rates = run.motion
    track = run.run.track
    position = np.stack(
        [np.interp(rates.time_s, track.time_s, track.position_m[:, axis]) for axis in (0, 1)],
        axis=1,
    )
    smooth = (position[:-2] + position[1:-1] + position[2:]) / 3
    ways = smooth[3:] - smooth[:-3]
    first, second = ways[:-2], ways[2:]
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    total = float(np.sum(lengths))
    return float(np.sum(cross)) / total if total > 0 else 0.0

"""Driven runs and tolerance maps whose figures are known beforehand."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbot_workstation.learn.studies.tolerance_file import MapAxis, RewardMap, Tolerances
from mbot_workstation.measure.gap_report.compare import ComparedRun
from mbot_workstation.measure.gap_report.figures import driving
from mbot_workstation.measure.gap_report.quantities import quantities
from mbot_workstation.measure.gap_report.report import GapReport, missing_parts
from mbot_workstation.measure.gap_report.verdict import judge
from mbot_workstation.measure.tracks.maneuver import MANEUVERS, Maneuver
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles

Wheels = tuple[float, float, float]
"""Speeds of the left and right wheel at full command [m/s], and the track [m]."""

TRUE: Wheels = (0.42, 0.38, 0.120)
FITTED: Wheels = (0.42, 0.38, 0.120)
NOMINAL: Wheels = (0.40, 0.40, 0.115)


def path(maneuver: Maneuver, wheels: Wheels, time_s: Array) -> Array:
    """x, y, yaw of a robot whose wheels have their full speed at once. Shape (n, 3)."""
    left, right = maneuver.left * wheels[0], maneuver.right * wheels[1]
    speed, turn = (left + right) / 2, (right - left) / wheels[2]
    yaw = turn * time_s
    if turn == 0:
        return np.stack([speed * time_s, 0 * time_s, yaw], axis=1)
    radius = speed / turn
    return np.stack([radius * np.sin(yaw), radius * (1 - np.cos(yaw)), yaw], axis=1)


def compared_runs(
    maneuvers: Sequence[Maneuver] = MANEUVERS,
    repetitions: int = 2,
    duration_s: float = 4.0,
    *,
    true: Wheels = TRUE,
    fitted: Wheels = FITTED,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[ComparedRun, ...]:
    """Runs whose measured path is the true robot's, moved by `offset` (x, y, yaw)."""
    time_s = np.arange(0, duration_s + 0.01, 0.02)
    runs: list[ComparedRun] = []
    for repetition in range(1, repetitions + 1):
        for maneuver in maneuvers:
            runs.append(
                ComparedRun(
                    number=len(runs) + 1,
                    maneuver=maneuver.name,
                    repetition=repetition,
                    driven_s=duration_s,
                    time_s=time_s,
                    measured=path(maneuver, true, time_s) + np.array(offset),
                    calibrated=path(maneuver, fitted, time_s),
                    nominal=path(maneuver, NOMINAL, time_s),
                )
            )
    return tuple(runs)


def tolerances(
    names: tuple[str, str] = ("gain asymmetry", "track_scale"), share: float = 0.95
) -> Tolerances:
    """One map: the reward falls by 10 % for every 0.1 of either deviation, by 0.5 at most."""
    nominal = {"gain asymmetry": 0.0}
    axes = [
        MapAxis(
            name=name,
            unit="of nominal",
            nominal=nominal.get(name, 1.0),
            values=tuple(nominal.get(name, 1.0) + step / 10 for step in range(-3, 4)),
        )
        for name in names
    ]
    across, up = (np.abs(np.array(axis.values) - axis.nominal) for axis in axes)
    rewards = 20 * (1 - np.minimum(across[None, :] + up[:, None], 0.5))
    return Tolerances(
        contestant="red-cube",
        nominal_reward=20.0,
        tolerated_share=share,
        how="made up",
        maps=(RewardMap(axes[0], axes[1], tuple(tuple(row) for row in rewards.tolist())),),
    )


def report(
    runs: Sequence[ComparedRun],
    files: CalibrationFiles,
    maps: Tolerances | None = None,
    **changes: Any,
) -> GapReport:
    """A report about these runs without frames."""
    driven = driving(runs)
    folder = Path("recordings/mbot-1")
    fields: dict[str, Any] = {
        "robot_id": "mbot-1",
        "made_on": "2026-11-21",
        "recordings": (str(folder),),
        "recorded_runs": 2 * len(runs),
        "held_out_words": "Every other repetition.",
        "excluded": {},
        "files": files,
        "driving": driven,
        "judged": tuple(judge(one, maps) for one in quantities(files, runs)),
        "tolerances": maps,
        "frames": (),
        "given_frames": 0,
        "missing": missing_parts(files, folder, tuple(driven.maneuvers), maps, has_frames=False),
    }
    return GapReport(**(fields | changes))

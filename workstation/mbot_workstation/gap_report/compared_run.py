"""A recorded run beside what two simulated robots make of the same commands."""

from dataclasses import dataclass

import numpy as np

from mbot_workstation.recordings.track import Array


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """One run that the calibration has not been fitted to.

    Poses are x [m], y [m] of the axle's centre and yaw [rad], which counts whole turns; each path
    begins in the origin, heading along +x, when the first command takes effect.

    Attributes:
        number, repetition: as recorded.
        maneuver: its name, such as "forward-neutral".
        driven_s: from the first command to the stop.
        time_s: since the first command took effect, shape (n,), rising, ends with the drive.
        measured, calibrated, nominal: the tracked robot, the simulated one with its calibration,
            and the simulated one without; shape (n, 3).

    Raises:
        ValueError: a shape is wrong, or something is not finite.

    """

    number: int
    maneuver: str
    repetition: int
    driven_s: float
    time_s: Array
    measured: Array
    calibrated: Array
    nominal: Array

    def __post_init__(self) -> None:
        shape = (len(self.time_s), 3)
        for name in ("measured", "calibrated", "nominal"):
            values: Array = getattr(self, name)
            if values.shape != shape:
                raise ValueError(f"{name} has shape {values.shape}, expected {shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} holds a value that is not finite")
        if shape[0] < 2 or not (np.diff(self.time_s) > 0).all():
            raise ValueError("time_s does not rise")

    @property
    def turned_rad(self) -> float:
        """How far the robot turned, positive to the left."""
        return float(self.measured[-1, 2] - self.measured[0, 2])

    def paths(self) -> dict[str, Array]:
        """The three, by the names everything else calls them."""
        return {name: getattr(self, name) for name in PATHS}


MEASURED, CALIBRATED, NOMINAL = "measured", "calibrated", "nominal"
PATHS = (MEASURED, CALIBRATED, NOMINAL)

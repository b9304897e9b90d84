"""Where something was, moment by moment, as a tracker saw it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Poses in a right-handed frame, z up, in metres and seconds; n of them, at least 2.

    The clock, the place of the origin, the direction of x and how the tracker sits on the robot
    are the tracker's own: nothing of that is aligned here.

    Attributes:
        time_s: shape (n,), rising.
        position_m: of the tracker, shape (n, 3).
        quaternion_wxyz: its attitude, tracker to world, unit length, shape (n, 4).

    Raises:
        ValueError: a shape is wrong, a value is not finite, or time does not rise.

    """

    time_s: Array
    position_m: Array
    quaternion_wxyz: Array

    def __post_init__(self) -> None:
        count = len(self.time_s)
        shapes = {"time_s": (count,), "position_m": (count, 3), "quaternion_wxyz": (count, 4)}
        for name, shape in shapes.items():
            values: Array = getattr(self, name)
            if values.shape != shape:
                raise ValueError(f"{name} has shape {values.shape}, expected {shape}")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} holds a value that is not finite")
        if count < 2:
            raise ValueError(f"the track has {count} poses, expected at least 2")
        if not (np.diff(self.time_s) > 0).all():
            raise ValueError("time_s does not rise")
        norms = np.linalg.norm(self.quaternion_wxyz, axis=1)
        if not np.allclose(norms, 1, atol=1e-6):
            raise ValueError("quaternion_wxyz holds a quaternion that is not of unit length")

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def duration_s(self) -> float:
        """From the first pose to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def attitudes(self) -> Rotation:
        """The n rotations from tracker to world."""
        return Rotation.from_quat(self.quaternion_wxyz, scalar_first=True)

    @property
    def yaw_rad(self) -> Array:
        """How far it has turned to the left about the vertical since the first pose. Shape (n,).

        Continuous beyond a whole turn as long as it turns less than half a turn between two
        poses. Holds for a tracker mounted at any tilt, since only the change is taken.
        """
        attitudes = self.attitudes
        change = (attitudes * attitudes[0].inv()).as_quat(scalar_first=True)
        # Twist about z: the rest of the change, a tilt, leaves the ratio of w and z alone.
        return np.unwrap(2 * np.arctan2(change[:, 3], change[:, 0]))

    @property
    def up_in_tracker(self) -> Array:
        """The world's up, seen from the tracker: constant while it stays level. Shape (n, 3)."""
        return self.attitudes.inv().apply([0.0, 0.0, 1.0])

    def between(self, first_s: float, last_s: float) -> "Track | None":
        """The poses from `first_s` to `last_s`, both included; None if fewer than 2."""
        chosen = (self.time_s >= first_s) & (self.time_s <= last_s)
        return self.where(chosen) if np.count_nonzero(chosen) >= 2 else None

    def where(self, chosen: NDArray[np.bool_]) -> "Track":
        """The chosen poses only. `chosen` has shape (n,)."""
        return Track(self.time_s[chosen], self.position_m[chosen], self.quaternion_wxyz[chosen])


def without_sign_flips(quaternions: Array) -> Array:
    """The same attitudes, no two neighbours on opposite sides: q and -q are one. Shape (n, 4)."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return quaternions * signs[:, None]


def running_windows(values: Array, reach: int) -> Array:
    """Each row with the `reach` rows before and after it. Shape (n, m, 2 reach + 1) for (n, m).

    Before the first and after the last row the rest is mirrored through that row, so that the
    median there is the row itself however fast the values change.
    """
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)

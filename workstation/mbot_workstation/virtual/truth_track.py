"""Stands in for the tracker on a real robot: the true pose, with a tracker's faults."""

import threading
import time
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pacer import Pacer
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.virtual.scene_history import SceneHistory

Array = NDArray[np.float64]

RATE_HZ = 90.0
"""SteamVR's, as in the paper."""

HEIGHT_M = 0.12
"""Of the tracker: on top of the robot."""

ORIGIN_M = np.array([1.3, -0.4, 0.0])
FRAME_YAW_RAD = 0.6
"""Of the arena in the tracker's own frame: any, but not none, so that nobody relies on it."""

LOOK_BACK_S = 0.03
"""Six slices of physics."""

FLUSH_EVERY = round(RATE_HZ / 2)
"""Poses: what is lost if the program is killed."""

TRIAD_HEADER = "time,x,y,z,yaw,pitch,roll,r_w,r_x,r_y,r_z"


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """How good the tracker is, and where it sits.

    Attributes:
        position_noise_m, angle_noise_rad: standard deviations, per axis; about 4 mm is usual
            (paper).
        ahead_m, left_m: of the axle's centre.
        seed: of the noise.

    """

    position_noise_m: float = 0.004
    angle_noise_rad: float = np.radians(0.3)
    ahead_m: float = 0.0
    left_m: float = 0.0
    seed: int = 0


class TruthTrack:
    """Writes poses 90 times a second; a context manager. The clock begins at 0 with the file.

    A `.csv` file is what triad_openvr writes, y up; `.tum` and `.txt` are TUM's, z up.
    """

    def __init__(self, path: Path, settings: TrackerSettings) -> None:
        """Open the file.

        Raises:
            ConfigurationError: its ending is unknown, or it can't be written.

        """
        if path.suffix not in (".csv", ".tum", ".txt"):
            raise ConfigurationError(f"{path} ends in {path.suffix!r}, expected .csv, .tum or .txt")
        self._csv = path.suffix == ".csv"
        self._settings = settings
        self._random = np.random.default_rng(settings.seed)
        self._began_s = time.monotonic()
        self._rows = 0
        try:
            self._file: TextIOWrapper = path.open("w", encoding="utf-8")
        except OSError as error:
            raise ConfigurationError(f"can't write the track to {path}: {error.strerror}") from None
        header = TRIAD_HEADER if self._csv else "# time_s x_m y_m z_m qx qy qz qw"
        self._file.write(header + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def run(self, history: SceneHistory, stop: threading.Event) -> None:
        """Follow a live robot until stopped."""
        next_s = time.monotonic() - LOOK_BACK_S
        pacer = Pacer(1 / RATE_HZ, 1_000_000)
        while (ticks := pacer.wait(stop)) > 0:
            next_s += ticks / RATE_HZ
            # Looking back a little, there is a moment of physics after it as well.
            (before_s, before), (after_s, after) = history.around(next_s)
            if before_s <= next_s <= after_s:  # else the physics has stalled: a lost pose
                share = (next_s - before_s) / (after_s - before_s)
                joints = before.joints[:7] + share * (after.joints[:7] - before.joints[:7])
                self.add(next_s, joints[:3], joints[3:7] / np.linalg.norm(joints[3:7]))

    def add(self, moment_s: float, position_m: Array, quaternion_wxyz: Array) -> None:
        """Write where the axle's centre was at this moment.

        Args:
            moment_s: on the monotonic clock.
            position_m: in the arena, shape (3,), z from the floor.
            quaternion_wxyz: robot to arena, shape (4,).

        """
        time_s = moment_s - self._began_s
        position, quaternion = self._seen(position_m, quaternion_wxyz)
        if self._csv:  # OpenVR: x right, y up, -z forward
            x, y, z = position[0], position[2], -position[1]
            turn = quaternion[[0, 1, 3, 2]] * [1, 1, 1, -1]
            numbers = [time_s, x, y, z, *_angles_deg(turn), *turn]
            self._file.write(",".join(f"{number:.6f}" for number in numbers) + "\n")
        else:
            numbers = [time_s, *position, *np.roll(quaternion, -1)]
            self._file.write(" ".join(f"{number:.6f}" for number in numbers) + "\n")
        self._rows += 1
        if self._rows % FLUSH_EVERY == 0:
            self._file.flush()

    def _seen(self, position_m: Array, quaternion_wxyz: Array) -> tuple[Array, Array]:
        """As the tracker reports it, z up."""
        settings = self._settings
        arm = np.array([settings.ahead_m, settings.left_m, HEIGHT_M])
        frame = _turn(np.array([0, 0, FRAME_YAW_RAD]))
        place = _rotated(frame, position_m + _rotated(quaternion_wxyz, arm)) + ORIGIN_M
        place = place + self._random.normal(0, settings.position_noise_m, 3)
        wobble = _turn(self._random.normal(0, settings.angle_noise_rad, 3))
        return place, _product(_product(frame, quaternion_wxyz), wobble)


def _turn(rotation_vector: Array) -> Array:
    """Quaternion, shape (4,)."""
    quaternion, angle = np.empty(4), float(np.linalg.norm(rotation_vector))
    mujoco.mju_axisAngle2Quat(quaternion, rotation_vector / max(angle, 1e-12), angle)
    return quaternion


def _rotated(quaternion: Array, vector: Array) -> Array:
    result = np.empty(3)
    mujoco.mju_rotVecQuat(result, vector, quaternion)
    return result


def _product(first: Array, second: Array) -> Array:
    result = np.empty(4)
    mujoco.mju_mulQuat(result, first, second)
    return result


def _angles_deg(quaternion_wxyz: Array) -> Array:
    """Yaw, pitch, roll with y up, shape (3,). For people: readers take the quaternion."""
    w, x, y, z = quaternion_wxyz
    yaw = np.arctan2(2 * (w * y + x * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * x - y * z), -1, 1))
    return np.degrees([yaw, pitch, np.arctan2(2 * (w * z + x * y), 1 - 2 * (x * x + z * z))])

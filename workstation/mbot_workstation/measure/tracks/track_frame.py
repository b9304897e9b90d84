"""From a tracker's own frame and units to ours: right-handed, z up, metres."""

import numpy as np
from scipy.spatial.transform import Rotation

from mbot_workstation.sim.track import Array

# Each matrix takes the tracker's axes to ours by a proper rotation.
_TO_Z_UP: dict[str, Array] = {
    "z": np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64),
    "-z": np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=np.float64),
    "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float64),
    "-y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float64),
    "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float64),
    "-x": np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=np.float64),
}


def to_our_frame(
    position_m: Array, quaternion_wxyz: Array, up: str, handedness: str
) -> tuple[Array, Array]:
    """Positions (n, 3) and attitudes (n, 4) in a right-handed frame with z up.

    The tracker's own axes are renamed along with the world's, so that a tracker that lay flat in
    its frame lies flat in ours.
    """
    if handedness == "left":
        position_m, quaternion_wxyz = _mirrored(position_m, quaternion_wxyz, up)
    return _turned(position_m, quaternion_wxyz, _TO_Z_UP[up])


def to_file_frame(
    position_m: Array, quaternion_wxyz: Array, up: str, handedness: str
) -> tuple[Array, Array]:
    """The inverse of `to_our_frame`: positions, shape (n, 3), and attitudes, shape (n, 4)."""
    position_m, quaternion_wxyz = _turned(position_m, quaternion_wxyz, _TO_Z_UP[up].T)
    if handedness == "left":
        return _mirrored(position_m, quaternion_wxyz, up)
    return position_m, quaternion_wxyz


def _turned(position_m: Array, quaternion_wxyz: Array, matrix: Array) -> tuple[Array, Array]:
    vector = quaternion_wxyz[:, 1:] @ matrix.T
    return position_m @ matrix.T, np.concatenate([quaternion_wxyz[:, :1], vector], axis=1)


def _mirrored(position_m: Array, quaternion_wxyz: Array, up: str) -> tuple[Array, Array]:
    """Mirrored in a horizontal axis; any does, as the direction of x is the tracker's own.

    A rotation's axis mirrors the other way round, as M R M does.
    """
    signs = np.ones(3)
    signs[1 if up.endswith("z") else 2] = -1
    return position_m * signs, quaternion_wxyz * np.concatenate([[1], -signs])


def from_euler(angles_rad: Array, axes: str) -> Array:
    """Quaternions (n, 4), w first, from intrinsic rotations about `axes`. Angles (n, len(axes))."""
    result = Rotation.identity(len(angles_rad))
    # One by one: SciPy's own takes no axis twice in a row.
    for column, axis in enumerate(axes):
        result *= Rotation.from_euler(axis, angles_rad[:, [column]])
    return result.as_quat(scalar_first=True)

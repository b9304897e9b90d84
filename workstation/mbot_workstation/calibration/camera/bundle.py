"""Bundle adjustment of one camera: intrinsics and board poses that fit all corners best.

OpenCV's calibrateCamera minimises the same sum, but can weigh no picture. Here one may count
less, because it is small or suspect. Levenberg-Marquardt; the poses are eliminated from the normal
equations (Schur complement), as each touches its own picture only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.camera_model import CameraModel

Values = NDArray[np.float64]

INTRINSICS = ("focal x", "focal y", "principal x", "principal y", "k1", "k2", "p1", "p2", "k3")
WIDE_INTRINSICS = (*INTRINSICS, "k4", "k5", "k6")
"""In the order of all arrays of 9 here."""

MOST_STEPS = 60
CONVERGED = 1e-9
"""Of the sum of squares, relative; the intrinsics then move by far less than their uncertainty."""


@dataclass(frozen=True, slots=True)
class View:
    """A board in one picture.

    Attributes:
        points_m: corners on the board, shape (n, 3).
        corners_px: corners in the picture, shape (n, 2).

    """

    points_m: Values
    corners_px: Values


@dataclass(frozen=True, slots=True)
class Adjusted:
    """The best fit.

    Attributes:
        intrinsics: shape (9,), as INTRINSICS.
        deviations: their standard deviations, shape (9,); 0 for what was held.
        poses: rotation vector and translation of each board, shape (views, 6).
        errors_px: root mean square distance of each view's corners, shape (views,).

    """

    intrinsics: Values
    deviations: Values
    poses: Values
    errors_px: Values


def intrinsics_of(camera: CameraModel) -> Values:
    """A camera's intrinsics in the order of INTRINSICS. Shape (9,)."""
    return np.array(
        [
            *(camera.focal_x_px, camera.focal_y_px, camera.principal_x_px, camera.principal_y_px),
            *camera.distortion,
        ]
    )


def camera_of(intrinsics: Values, width_px: int, height_px: int) -> CameraModel:
    """The camera with these intrinsics: fx, fy, cx, cy, k1, k2, p1, p2, k3; shape (9,).

    Raises:
        ValueError: they are no camera's.

    """
    fx, fy, cx, cy, *distortion = intrinsics.tolist()
    return CameraModel(width_px, height_px, fx, fy, cx, cy, tuple(distortion))


def pose_of(view: View, intrinsics: Values) -> Values:
    """The board's pose under given intrinsics, refined. Shape (6,); NaN if there is none."""
    matrix, distortion = _matrix(intrinsics), intrinsics[4:]
    try:
        found, turn, place = cv2.solvePnP(
            view.points_m, view.corners_px, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
        )
        if not found:
            return np.full(6, np.nan)
        turn, place = cv2.solvePnPRefineLM(
            view.points_m, view.corners_px, matrix, distortion, turn, place
        )
    except cv2.error:
        return np.full(6, np.nan)
    return np.concatenate([turn.ravel(), place.ravel()]).astype(np.float64)


def residuals(view: View, intrinsics: Values, pose: Values) -> Values:
    """Projected minus seen corners. Shape (n, 2)."""
    seen, _ = cv2.projectPoints(
        view.points_m, pose[:3], pose[3:], _matrix(intrinsics), intrinsics[4:]
    )
    return np.asarray(seen, np.float64).reshape(-1, 2) - view.corners_px


def error_px(view: View, intrinsics: Values, pose: Values) -> float:
    """Root mean square distance between projected and seen corners, in pixels.

    Args:
        view: what was seen.
        intrinsics: shape (9,).
        pose: of the board, shape (6,).

    """
    return float(np.sqrt((residuals(view, intrinsics, pose) ** 2).sum(axis=1).mean()))


def adjust(
    views: Sequence[View],
    intrinsics: Values,
    poses: Values,
    weights: Values,
    held: Sequence[int] = (),
) -> Adjusted:
    """Improve intrinsics and poses.

    Args:
        views: at least 3.
        intrinsics: to start from, shape (9,).
        poses: to start from, shape (views, 6).
        weights: of each view's squared residuals, shape (views,).
        held: indices of intrinsics that stay as they are.

    """
    free = [index for index in range(len(INTRINSICS)) if index not in held]
    current = _Equations(views, intrinsics, poses, weights, free)
    damping = 1e-3
    for _ in range(MOST_STEPS):
        step = current.step(damping)
        candidate = _Equations(views, *step, weights, free)
        if candidate.cost < current.cost:
            gained = current.cost - candidate.cost
            current, damping = candidate, max(damping / 10, 1e-12)
            if gained < CONVERGED * current.cost:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    deviations = np.zeros(len(INTRINSICS))
    deviations[free] = current.deviations()
    errors = [
        error_px(view, current.intrinsics, pose)
        for view, pose in zip(views, current.poses, strict=True)
    ]
    return Adjusted(current.intrinsics, deviations, current.poses, np.array(errors))


class _Equations:
    """The normal equations at one point.

    Attributes:
        intrinsics, poses: the point.
        cost: weighted sum of squared residuals; infinite where nothing can be projected.

    """

    def __init__(
        self,
        views: Sequence[View],
        intrinsics: Values,
        poses: Values,
        weights: Values,
        free: Sequence[int],
    ) -> None:
        self.intrinsics, self.poses = intrinsics, poses
        self._free = list(free)
        count = len(self._free)
        self._common = np.zeros((count, count))  # intrinsics with themselves
        self._gradient = np.zeros(count)
        self._own = np.zeros((len(views), 6, 6))  # each pose with itself
        self._mixed = np.zeros((len(views), count, 6))
        self._own_gradient = np.zeros((len(views), 6))
        self._scores = np.zeros((len(views), count))
        self._freedom = -count - 6 * len(views)
        self.cost = 0.0
        for index, (view, pose, weight) in enumerate(zip(views, poses, weights, strict=True)):
            seen, jacobian = cv2.projectPoints(
                view.points_m, pose[:3], pose[3:], _matrix(intrinsics), intrinsics[4:]
            )
            residual = (np.asarray(seen).reshape(-1, 2) - view.corners_px).ravel()
            by_pose, by_intrinsics = jacobian[:, :6], jacobian[:, 6:15][:, self._free]
            self._common += weight * by_intrinsics.T @ by_intrinsics
            self._own[index] = weight * by_pose.T @ by_pose
            self._mixed[index] = weight * by_intrinsics.T @ by_pose
            self._scores[index] = weight * by_intrinsics.T @ residual
            self._gradient += self._scores[index]
            self._own_gradient[index] = weight * by_pose.T @ residual
            self._freedom += residual.size
            self.cost += weight * float(residual @ residual)
        if not np.isfinite(self.cost):
            self.cost = np.inf

    def step(self, damping: float) -> tuple[Values, Values]:
        """Intrinsics, shape (9,), and poses, shape (views, 6), after a damped step."""
        own = self._own + damping * self._own * np.eye(6)
        common = self._common + damping * np.diag(np.diag(self._common))
        back = self._mixed @ np.linalg.inv(own)
        reduced = common - np.einsum("vij,vkj->ik", back, self._mixed)
        right = self._gradient - np.einsum("vij,vj->i", back, self._own_gradient)
        change = np.linalg.lstsq(reduced, -right, rcond=None)[0]
        intrinsics = self.intrinsics.copy()
        intrinsics[self._free] += change
        pull = self._own_gradient + np.einsum("vij,i->vj", self._mixed, change)
        poses = self.poses - np.linalg.solve(own, pull[..., None])[..., 0]
        return intrinsics, poses

    def deviations(self) -> Values:
        """Standard deviations of the free intrinsics, shape (free,).

        Two estimates, of which the larger counts: from the scatter of single corners, and from
        how much whole pictures disagree, which also sees a bent board or a blurred picture.
        """
        back = self._mixed @ np.linalg.inv(self._own)
        reduced = self._common - np.einsum("vij,vkj->ik", back, self._mixed)
        inverse = np.linalg.pinv(reduced)
        by_corners = self.cost / max(1, self._freedom) * np.diag(inverse)
        scores = self._scores - np.einsum("vij,vj->vi", back, self._own_gradient)
        views = len(scores)
        spare = max(1, views - len(self._free) / 2)  # two numbers a corner, one pose a view
        by_pictures = np.diag(inverse @ scores.T @ scores @ inverse) * views / spare
        return np.sqrt(np.maximum(by_corners, by_pictures))


def _matrix(intrinsics: Values) -> Values:
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

"""A run as plane motion: the tracker's floor made level, its attitude reduced to a heading."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.run import ManeuverRecording, Run
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_cleaning import clean

Plane: TypeAlias = NDArray[np.complex128]
"""Points of the plane, x + iy."""

SMALLEST_EXTENT_M = 0.2
"""Tracks that cover less (sd) say little about how the floor leans: 4 mm of noise are a degree."""

STEEPEST_DEG = 15.0
"""No floor leans that much; a tracker whose up is another axis makes it look so."""


@dataclass(frozen=True, slots=True, eq=False)
class FlatRun:
    """What the tracker saw of a run, on the floor it found.

    Attributes:
        run: the run.
        recording: the index of its recording: each has its own clock and tracker offset.
        time_s: on the tracker's clock, shape (n,).
        place: of the tracker on the floor [m], shape (n,).
        heading: of the tracker [rad], counting whole turns, shape (n,). Its zero is the same for
            all runs of a recording, though not known.
        place_noise_m, heading_noise_rad: standard deviation of a single sample.

    """

    run: Run
    recording: int
    time_s: Array
    place: Plane
    heading: Array
    place_noise_m: float
    heading_noise_rad: float

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"run {self.run.number} ({self.run.maneuver}, repetition {self.run.repetition})"


def flatten(recording: ManeuverRecording, index: int = 0) -> tuple[FlatRun, ...]:
    """All runs of a recording on its floor, without what the tracker did wrong.

    Raises:
        ConfigurationError: the floor is too steep to be one.

    """
    cleaned = [clean(run.track) for run in recording.runs]
    level = _levelling([track for track, _ in cleaned])
    reference = level * cleaned[0][0].attitudes[0]
    runs: list[FlatRun] = []
    for run, (track, quality) in zip(recording.runs, cleaned, strict=True):
        place = level.apply(track.position_m)
        # The robot only turns about the vertical, so the change since any moment is such a turn,
        # however the tracker is mounted.
        change = (level * track.attitudes * reference.inv()).as_quat()
        heading = np.unwrap(2 * np.arctan2(change[:, 2], change[:, 3]))
        noise = quality.position_noise_m, quality.angle_noise_rad
        runs.append(
            FlatRun(run, index, track.time_s, place[:, 0] + 1j * place[:, 1], heading, *noise)
        )
    return tuple(runs)


def _levelling(tracks: Sequence[Track]) -> Rotation:
    """The rotation that makes the floor level: no more than the tracks can tell."""
    position = np.concatenate([track.position_m for track in tracks])
    position = position - np.median(position, axis=0)
    height, plane = position[:, 2], position[:, :2]
    # A weak wish for a level floor decides where the tracks cover too little to tell.
    wish = len(position) * SMALLEST_EXTENT_M**2 / 100
    slope, weight = np.zeros(2), np.ones(len(position))
    for _ in range(10):  # outliers lose their weight
        weighted = plane * weight[:, None]
        slope = np.linalg.solve(weighted.T @ plane + wish * np.eye(2), weighted.T @ height)
        off = np.abs(height - plane @ slope)
        weight = 1 / np.maximum(1, off / max(2 * float(np.median(off)), 1e-6))
    normal = np.array([-slope[0], -slope[1], 1]) / np.sqrt(1 + slope @ slope)
    lean_deg = float(np.degrees(np.arccos(normal[2])))
    if lean_deg > STEEPEST_DEG:
        raise ConfigurationError(
            f"the tracked floor leans by {lean_deg:.0f} degrees, expected less than "
            f"{STEEPEST_DEG:.0f}: is another of the tracker's axes up?"
        )
    axis = np.array([normal[1], -normal[0], 0])
    return Rotation.from_rotvec(axis / max(np.linalg.norm(axis), 1e-12) * np.radians(lean_deg))

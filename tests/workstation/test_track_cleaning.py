"""What a tracker does wrong is found, what the robot did is kept."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.motion import motion
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_cleaning import (
    clean,
    frozen_poses,
    noise,
    outlying_poses,
)

from .driven_robot import Robot, Tracker, commands, track_of

PERFECT = Tracker(position_noise_m=0.0, angle_noise_rad=0.0, time_jitter_s=0.0, lost_share=0.0)


def driven(tracker: Tracker, maneuver: int = 2, seed: int = 0, duration_s: float = 5.0) -> Track:
    return track_of(Robot(tracker=tracker), [commands(MANEUVERS[maneuver], 10, duration_s)], seed)


def with_positions(track: Track, position: Array) -> Track:
    return Track(track.time_s, position, track.quaternion_wxyz)


@pytest.mark.parametrize("maneuver", range(8))
@pytest.mark.parametrize("tracker", [PERFECT, Tracker()], ids=["perfect", "noisy"])
def test_nothing_of_a_good_track_is_lost(tracker: Tracker, maneuver: int) -> None:
    track = driven(tracker, maneuver)
    kept, quality = clean(track)
    assert quality.frozen == 0
    assert quality.outliers <= 0.002 * len(track)
    assert len(kept) == len(track) - quality.outliers


@pytest.mark.parametrize("noise_m", [0.0005, 0.004, 0.01])
@pytest.mark.parametrize("angle_deg", [0.1, 0.3, 1.0])
def test_noise_is_estimated_while_driving(noise_m: float, angle_deg: float) -> None:
    tracker = Tracker(position_noise_m=noise_m, angle_noise_rad=np.radians(angle_deg))
    for maneuver in (0, 1):
        position_m, angle_rad = noise(driven(tracker, maneuver, duration_s=10))
        assert position_m == pytest.approx(noise_m, rel=0.12, abs=0.0003)
        assert angle_rad == pytest.approx(np.radians(angle_deg), rel=0.12, abs=np.radians(0.05))


def test_rate_jitter_and_losses_are_reported() -> None:
    _, quality = clean(driven(Tracker(lost_share=0.1, time_jitter_s=0.0005), duration_s=20))
    assert quality.rate_hz == pytest.approx(90, rel=0.02)
    assert quality.lost_share == pytest.approx(0.1, abs=0.03)
    assert 0.0001 < quality.jitter_s < 0.001
    _, quality = clean(driven(PERFECT))
    assert (quality.lost_share, quality.jitter_s) == (pytest.approx(0, abs=1e-9), 0)


@settings(max_examples=25)
@given(st.integers(0, 7), st.integers(0, 1000))
def test_spikes_are_found_and_little_else(maneuver: int, seed: int) -> None:
    track = driven(Tracker(), maneuver, seed)
    random = np.random.default_rng(seed)
    spikes = np.zeros(len(track), dtype=bool)
    # The first and the last pose have neighbours on one side only and always pass.
    spikes[1 + random.choice(len(track) - 2, 12, replace=False)] = True
    shift = random.normal(size=(len(track), 3))
    shift *= random.uniform(0.06, 2, (len(track), 1)) / np.linalg.norm(shift, axis=1, keepdims=True)
    found = outlying_poses(with_positions(track, track.position_m + spikes[:, None] * shift))
    assert np.count_nonzero(found & spikes) >= 11
    assert np.count_nonzero(found & ~spikes) <= 0.003 * len(track)


def test_a_reflection_of_a_fifth_of_a_second_is_found() -> None:
    track = driven(Tracker(), 0)
    away = (track.time_s > track.time_s[0] + 3) & (track.time_s < track.time_s[0] + 3.2)
    found = outlying_poses(
        with_positions(track, track.position_m + away[:, None] * np.array([0.5, 0.3, 0.2]))
    )
    assert found[away].all()
    assert np.count_nonzero(found[~away]) <= 2


def test_a_flipped_attitude_is_found() -> None:
    track = driven(Tracker(), 1)
    quaternion = track.quaternion_wxyz.copy()
    flipped = track.attitudes[100] * Rotation.from_euler("x", np.pi)
    quaternion[100] = flipped.as_quat(scalar_first=True)
    found = outlying_poses(Track(track.time_s, track.position_m, quaternion))
    assert found[100]
    assert np.count_nonzero(found) <= 2


def test_the_sign_of_a_quaternion_means_nothing() -> None:
    track = driven(Tracker(), 2)
    random = np.random.default_rng(0)
    signs = random.choice([-1.0, 1.0], (len(track), 1))
    flipped = Track(track.time_s, track.position_m, track.quaternion_wxyz * signs)
    assert np.array_equal(outlying_poses(flipped), outlying_poses(track))
    assert noise(flipped) == pytest.approx(noise(track))


def test_a_tracker_that_repeats_itself_while_lost_is_found() -> None:
    track = driven(PERFECT, 0)
    lost = slice(250, 290)
    position, quaternion = track.position_m.copy(), track.quaternion_wxyz.copy()
    position[lost], quaternion[lost] = position[249], quaternion[249]
    frozen = frozen_poses(Track(track.time_s, position, quaternion))
    assert np.flatnonzero(frozen).tolist() == list(range(250, 290))
    kept, quality = clean(Track(track.time_s, position, quaternion))
    assert (quality.frozen, quality.outliers) == (40, 0)
    assert quality.longest_gap_s == pytest.approx(41 / 90)
    assert len(kept) == len(track) - 40


def test_a_robot_that_stands_is_not_a_tracker_that_is_lost() -> None:
    track = driven(PERFECT, 0)  # a perfect tracker repeats itself to the last digit
    assert (track.position_m[1:80] == track.position_m[0]).all()
    assert not frozen_poses(track).any()


@pytest.mark.parametrize(
    ("maneuver", "speed", "yaw"), [(0, 0.40, -0.171), (2, None, -6.84), (6, 0.205, 3.504)]
)
def test_speeds_are_those_that_were_driven(maneuver: int, speed: float | None, yaw: float) -> None:
    # 0.41 and 0.39 m/s, wheels 0.117 m apart.
    centred = Tracker(ahead_m=0, left_m=0)
    rates = motion(driven(centred, maneuver))
    steady = (rates.time_s > 11 - 7000) & (rates.time_s < 14.8 - 7000)
    assert np.median(rates.yaw_radps[steady]) == pytest.approx(yaw, abs=0.02)
    assert np.median(rates.turn_radps[steady]) == pytest.approx(abs(yaw), abs=0.1)
    if speed is not None:
        assert np.median(rates.speed_mps[steady]) == pytest.approx(speed, rel=0.03)

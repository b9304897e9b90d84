"""Held-out runs beside simulated ones: `gap_report.compare` and `gap_report.figures`."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_workstation.measure.gap_report.compare import CALIBRATED, NOMINAL, line_at, steady_rate
from mbot_workstation.measure.gap_report.figures import driving, path_error
from mbot_workstation.measure.tracks.maneuver import MANEUVERS, maneuver_named

from .gap_samples import compared_runs


def test_errors_of_the_nominal_robot_are_those_of_its_path() -> None:
    (run,) = compared_runs([maneuver_named("forward-forward")], 1)
    result = driving([run])
    away = np.hypot(*(run.nominal - run.measured)[-1, :2])
    assert result.nominal.position_m == pytest.approx(away)
    assert result.nominal.yaw_deg == pytest.approx(np.degrees(abs(run.measured[-1, 2])))
    assert result.nominal.position_m > 0.2


def test_errors_are_those_of_each_moment_and_repetition() -> None:
    runs = compared_runs(MANEUVERS[:1], 3, offset=(0.03, -0.04, 0.1))
    found = path_error(runs, CALIBRATED)
    assert found.position_m[:, -1] == pytest.approx([0.05] * 3)
    assert found.yaw_rad[:, -1] == pytest.approx([0.1] * 3)
    assert path_error(runs, NOMINAL).position_m[:, -1].min() > 0.05
    near, far = (compared_runs(MANEUVERS[:1], 1, offset=(size, 0, 0))[0] for size in (0.01, 0.03))
    both = path_error([near, far], CALIBRATED).position_m
    assert both == pytest.approx(np.array([[0.01], [0.03]]) * np.ones_like(both))


def test_where_a_calibration_did_not_help_is_told() -> None:
    maneuvers = MANEUVERS[:2]
    assert driving(compared_runs(maneuvers)).not_helped == ()
    # Nominal is right here, and what was fitted is off.
    nominal = (0.40, 0.40, 0.115)
    worse = driving(compared_runs(maneuvers, true=nominal, fitted=(0.42, 0.38, 0.12)))
    assert worse.not_helped == (
        "the position and heading of forward-forward",
        "the position and heading of forward-neutral",
    )


def test_a_line_through_noise_bridges_gaps() -> None:
    seen_s = np.concatenate([np.arange(0, 1, 0.01), np.arange(1.5, 2, 0.01)])
    rng = np.random.default_rng(0)
    seen = 0.4 * seen_s + rng.normal(0, 0.004, seen_s.size)
    moments_s = np.arange(0.1, 1.9, 0.1)
    found = line_at(seen_s, seen[:, None], moments_s)
    np.testing.assert_allclose(found[:, 0], 0.4 * moments_s, atol=0.01)


@given(
    speed=st.floats(-0.7, 0.7),
    turn=st.floats(-9, 9),
    start=st.floats(-3, 3),
    seed=st.integers(0, 99),
)
@settings(max_examples=40)
def test_steady_rates_are_found_through_the_trackers_noise(
    speed: float, turn: float, start: float, seed: int
) -> None:
    time_s = np.arange(0, 5, 0.02)
    yaw = start + turn * time_s
    way = np.cumsum(speed * 0.02 * np.exp(1j * (yaw - turn * 0.01)))
    rng = np.random.default_rng(seed)
    path = np.stack([way.real, way.imag, yaw], axis=1)
    noisy = path + rng.normal(0, [0.002, 0.002, 0.002], path.shape)
    found = steady_rate(time_s, noisy)
    assert found.turn_radps == pytest.approx(turn, abs=2e-3)
    assert found.speed_mps == pytest.approx(speed, abs=6e-3)

"""What a policy bears of what is left: `gap_report.quantities` and `gap_report.verdict`."""

import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.studies.study_plans import DEVIATIONS
from mbot_workstation.learn.studies.tolerance_file import (
    HomeMistakes,
    Tolerances,
    read_tolerances,
    write_tolerances,
)
from mbot_workstation.learn.studies.tolerance_map import (
    TOLERATED_SHARE,
    ToleranceMap,
    as_file,
    map_page,
)
from mbot_workstation.measure.gap_report.compare import CALIBRATED, NOMINAL
from mbot_workstation.measure.gap_report.page import verdict_lines
from mbot_workstation.measure.gap_report.quantities import TITLES, Quantity, deviation, quantities
from mbot_workstation.measure.gap_report.verdict import Word, judge, tolerated_range
from mbot_workstation.measure.tracks.maneuver import maneuver_named
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.effects.presets import KNOWN

from .calibrations import BODY, CAMERA, LIGHT, MOTION
from .gap_samples import compared_runs, report, tolerances

ALL = CalibrationFiles(
    folder="calibration/mbot-1", camera=CAMERA, motion=MOTION, body=BODY, light=LIGHT
)


@given(
    left=st.floats(0.3, 0.5),
    right=st.floats(0.3, 0.5),
    track=st.floats(0.10, 0.13),
)
@settings(max_examples=30)
def test_deviations_are_read_from_straight_runs_and_spins(
    left: float, right: float, track: float
) -> None:
    names = ("forward-forward", "backward-backward", "forward-backward", "backward-forward")
    maneuvers = [maneuver_named(name) for name in names]
    runs = compared_runs(maneuvers, 1, true=(left, right, track), fitted=(0.4, 0.4, 0.115))
    found = deviation(runs, CALIBRATED)
    assert found is not None
    middle = (left + right) / 2
    asymmetry, track_scale, radius_scale = found
    assert asymmetry == pytest.approx((left - right) / middle, abs=5e-3)
    assert radius_scale == pytest.approx(middle / 0.4, rel=5e-3)
    assert track_scale == pytest.approx(track / 0.115, rel=5e-3)


def test_without_spins_no_deviation_is_invented() -> None:
    runs = compared_runs([maneuver_named("forward-forward")])
    assert deviation(runs, NOMINAL) is None
    rows = quantities(CalibrationFiles(), runs)
    assert [row.uncalibrated for row in rows] == [None] * 7
    assert "workstation maneuvers run" in rows[0].source


def quantity(value: float | None, name: str = "gain asymmetry") -> Quantity:
    return Quantity("Q", name, "%", value, 0.0, "test")


@pytest.mark.parametrize(
    ("value", "word", "used"),
    [
        (0.0, Word.FINE, 0.0),
        (0.02, Word.FINE, 0.4),
        (-0.04, Word.BORDERLINE, 0.8),
        (0.06, Word.WILL_NOT_HOLD, 1.2),
        (-0.5, Word.WILL_NOT_HOLD, 10.0),
    ],
)
def test_verdicts_follow_the_way_to_the_border(value: float, word: Word, used: float) -> None:
    # The reward falls by 1 % a percent of asymmetry, and 95 % must be left: the border is at 5 %.
    found = judge(quantity(value), tolerances()).uncalibrated
    assert found.verdict is word
    assert found.used == pytest.approx(used, abs=1e-9)
    assert found.reward_share == pytest.approx(1 - min(abs(value), 0.3), abs=1e-9)


def test_beyond_a_map_whose_border_is_not_on_it_nothing_is_sure() -> None:
    wide = tolerances(share=0.6)  # all of the map is tolerated: 70 % are left at its ends
    tolerated = tolerated_range(wide, "gain asymmetry")
    assert tolerated is not None
    assert (tolerated.ends_low, tolerated.ends_high) == (True, True)
    inside, outside = (judge(quantity(value), wide).uncalibrated for value in (0.1, 0.4))
    assert inside.verdict is Word.FINE
    assert outside.verdict is Word.BORDERLINE
    assert "beyond" in outside.why


def test_of_two_maps_the_stricter_one_counts() -> None:
    mild, strict = tolerances(), tolerances()
    harder = strict.maps[0]
    rewards = tuple(tuple(20 - 2 * (20 - reward) for reward in row) for row in harder.rewards)
    both = Tolerances(
        contestant="x",
        nominal_reward=20.0,
        tolerated_share=0.95,
        how="",
        maps=(mild.maps[0], type(harder)(harder.across, harder.up, rewards)),
    )
    tolerated = tolerated_range(both, "gain asymmetry")
    assert tolerated is not None
    assert tolerated.high == pytest.approx(0.025)
    assert tolerated.low == pytest.approx(-0.025)


def test_without_map_or_value_there_is_no_verdict() -> None:
    assert judge(quantity(0.1), None).uncalibrated.verdict is Word.UNKNOWN
    assert judge(quantity(None), tolerances()).uncalibrated.verdict is Word.UNKNOWN
    assert judge(quantity(1.1, "fov_scale"), tolerances()).uncalibrated.verdict is Word.UNKNOWN


@given(value=st.floats(-0.3, 0.3))
def test_a_tolerated_deviation_leaves_enough_reward(value: float) -> None:
    verdict = judge(quantity(value), tolerances()).uncalibrated
    assert verdict.reward_share is not None
    assert (verdict.reward_share >= 0.95 - 1e-9) == (verdict.verdict is not Word.WILL_NOT_HOLD)


def test_quantities_stand_on_the_axes_of_the_tolerance_maps() -> None:
    rows = quantities(ALL, ())
    assert tuple(row.deviation for row in rows) == tuple(TITLES)
    assert set(TITLES) <= set(DEVIATIONS)
    assert DEVIATIONS["camera_latency_ms"].nominal == KNOWN.camera_latency_ms
    assert [row.words(row.nominal) for row in rows[3:]] == ["0 %", "0°", "0 ms", "0 %"]
    assert rows[0].words(0.031) == "+3.1 %"
    values = {row.title: row.uncalibrated for row in rows}
    assert values["Mounting pitch"] == pytest.approx(2.0)
    assert values["Latency"] == pytest.approx(60 + 35 - 15)
    assert values["Exposure"] == pytest.approx(0.8)
    view = math.tan(math.radians(55.3 / 2)) * math.tan(math.radians(42.9 / 2))
    mine = (2028 / 2 / 1990) * (1520 / 2 / 1985)
    assert values["Field of view"] == pytest.approx(math.sqrt(mine / view), rel=1e-3)


def test_tolerance_maps_survive_their_file(tmp_path: Path) -> None:
    grid = ToleranceMap.of("track_scale", "exposure_gain", 3)
    rewards = np.arange(9.0).reshape(3, 3)
    homes = HomeMistakes("wrong_things", 2.125, 1.5, 2.82, 96)
    made = as_file([(grid, rewards)], "servo", 19.5, "how", (homes,))
    found = read_tolerances(write_tolerances(tmp_path / "tolerance.json", made))
    assert found == made
    assert found.tolerated_share == TOLERATED_SHARE
    (one,) = found.maps
    assert one.across.nominal == DEVIATIONS["track_scale"].nominal
    assert one.rewards[2] == (6.0, 7.0, 8.0)
    assert found.mistakes[0].words == "wrong things 2.1 (1.5 to 2.8) an episode"


def test_mistakes_in_homes_are_told_beside_the_verdicts() -> None:
    homes = HomeMistakes("wrong_things", 2.125, 1.5, 2.82, 96)
    maps = msgspec.structs.replace(tolerances(), mistakes=(homes,))
    runs = compared_runs([maneuver_named("forward-forward")])
    *_, last = verdict_lines(report(runs, CalibrationFiles(), maps))
    assert last == ("red-cube in simulated homes", homes.words)
    assert len(verdict_lines(report(runs, CalibrationFiles(), tolerances()))) == 2
    with_them = map_page([], "red-cube", 20.0, "how", "x.png", (homes,))
    assert "In homes: wrong things 2.1 (1.5 to 2.8) an episode (96 episodes)." in with_them


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        "no json",
        '{"contestant": "x", "nominal_reward": -1, "tolerated_share": 0.95, "how": "", "maps": []}',
    ],
)
def test_another_file_is_no_tolerance_map(tmp_path: Path, content: str) -> None:
    path = tmp_path / "tolerance.json"
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=re.escape(str(path))):
        read_tolerances(path)

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mbot_workstation.learn.learning.curriculum import PAPER_MARK, passed
from mbot_workstation.sim.effects.effects import IDEAL
from mbot_workstation.sim.effects.presets import KNOWN, PRESETS
from mbot_workstation.sim.pose import ORIGIN
from mbot_workstation.tasks.fetch.lessons import BLUR_LESSON, LESSONS, ROUGH_LESSON
from mbot_workstation.tasks.fetch.rules import spawn
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named, lessons_named


def test_there_are_the_papers_ten() -> None:
    assert [stage.objects for stage in LESSONS] == [1] * 6 + [2] + [10] * 3
    assert [stage.largest_reward for stage in LESSONS] == [3] * 6 + [5] + [21] * 3
    assert all(a.spawn_farthest_m < b.spawn_farthest_m for a, b in pairwise(LESSONS))
    last = LESSONS[-1].rules
    assert (last.spawn_farthest_m, last.border_m) == (2.5, 2.9)
    assert last.time_limit_s == pytest.approx(167 * 0.4)


def test_the_first_object_is_close_and_in_view() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        cube = spawn(ORIGIN, LESSONS[0].rules, rng)
        assert 0.4 <= np.hypot(cube.x_m, cube.y_m) <= 0.5
        assert abs(np.degrees(np.arctan2(cube.y_m, cube.x_m))) < 55.3 / 2


@pytest.mark.parametrize("stage", LESSONS, ids=lambda stage: stage.name)
def test_passing_takes_420_episodes_at_nine_tenths_of_the_largest_reward(stage) -> None:
    enough = 0.9 * stage.largest_reward + 1e-9
    assert passed(stage, [enough] * PAPER_MARK.episodes)
    assert not passed(stage, [enough] * (PAPER_MARK.episodes - 1))
    assert not passed(stage, [enough - 0.01] * PAPER_MARK.episodes)
    assert passed(stage, [-1.0] * 500 + [enough] * PAPER_MARK.episodes), "only the last ones count"


def test_one_object_of_ten_does_not_pass() -> None:
    assert not passed(LESSONS[8], [1.9] * PAPER_MARK.episodes)


def test_the_blur_lesson_is_the_last_one_with_an_exposure_time() -> None:
    assert BLUR_LESSON.rules == LESSONS[-1].rules
    ideal, rng = PRESETS["ideal"], np.random.default_rng(0)
    assert BLUR_LESSON.draw_robot(ideal, rng).exposure_ms >= 10
    assert LESSONS[-1].draw_robot(ideal, rng) == ideal.low


def test_lessons_are_found_by_name() -> None:
    assert lesson_named(TASK.lessons, "7") is LESSONS[6]
    assert lesson_named(TASK.lessons, "blur") is BLUR_LESSON
    assert lesson_named(TASK.lessons, "rough") is ROUGH_LESSON
    with pytest.raises(ValueError, match=r"no lesson '11'.*blur"):
        lesson_named(TASK.lessons, "11")


def test_the_rough_lesson_shows_usual_robots_and_worse_ones() -> None:
    rng = np.random.default_rng(0)
    usual = PRESETS["randomised"]
    robots = [ROUGH_LESSON.draw_robot(usual, rng) for _ in range(400)]
    assert 30 < sum(robot.right_gain < 0.7 <= robot.left_gain for robot in robots) < 200
    assert 30 < sum(robot.left_gain < 0.7 <= robot.right_gain for robot in robots) < 200
    assert max(robot.camera_latency_ms for robot in robots) > usual.high.camera_latency_ms
    inside = [usual.low.left_gain <= min(robot.left_gain, robot.right_gain) for robot in robots]
    assert sum(inside) > 100
    tilts_deg = [abs(robot.camera_pitch_deg) for robot in robots]
    assert 10 < sum(tilt_deg > usual.high.camera_pitch_deg for tilt_deg in tilts_deg) < 60
    assert max(tilts_deg) > 5
    vignetting = [robot.vignetting for robot in robots]
    assert usual.low.vignetting <= min(vignetting)
    assert max(vignetting) <= usual.high.vignetting


def test_a_rough_robot_changes_in_some_episodes_on_the_way_and_into_one_of_its_kind() -> None:
    rng = np.random.default_rng(0)
    usual = PRESETS["randomised"]
    drawn = [ROUGH_LESSON.draw_change(usual, rng) for _ in range(1000)]
    changes = [change for change in drawn if change is not None]
    assert len(changes) / 1000 == pytest.approx(ROUGH_LESSON.changes, abs=0.04)
    after = [decisions for decisions, _ in changes]
    assert (min(after), max(after)) >= (10, 100)
    assert max(after) < 120
    assert any(robot.right_gain < 0.6 for _, robot in changes)


def test_worse_robots_are_worse_than_the_calibrated_one() -> None:
    late = replace(KNOWN, camera_latency_ms=90.0)
    moved = ROUGH_LESSON.moved(KNOWN, late)
    alone = {name: ranges for kind in moved.kinds if len(kind) == 1 for name, ranges in kind}
    assert alone["left_gain"] == (0.4, 0.7), "of its own"
    assert alone["camera_latency_ms"] == pytest.approx((130.0, 430.0))
    assert alone["friction_scale"] == (0.15, 0.4), "not measured, so as usual"
    assert ROUGH_LESSON.moved(KNOWN, KNOWN) == ROUGH_LESSON


def test_ranges_of_lessons_are_spelt_out() -> None:
    assert lessons_named(TASK.lessons, ["1-10", "rough"]) == (
        *(stage.name for stage in LESSONS),
        "rough",
    )
    assert lessons_named(TASK.lessons, ["9-10"]) == ("9", "10")
    assert lessons_named(TASK.lessons, ["4-4", "blur"]) == ("4", "blur")
    for wrong in ("10-9", "0-3", "8-11", "-3", "3-", "blur-10"):
        with pytest.raises(ValueError, match="rising range"):
            lessons_named(TASK.lessons, [wrong])


def test_rough_robots_are_also_better_than_any_down_to_ideal_ones() -> None:
    """In whatever delays a wheel or blurs a picture; each between nothing and what is known."""
    delays = {
        "action_latency_ms", "action_jitter_ms", "compensation_scale", "dead_band_scale",
        "time_constant_scale", "camera_latency_ms", "frame_interval_ms", "exposure_ms",
        "readout_ms", "noise",
    }  # fmt: skip
    better = [kind for kind in ROUGH_LESSON.kinds if delays <= {name for name, _ in kind}]
    assert len(better) == 1
    for name, (low, high) in better[0]:
        assert low == getattr(IDEAL, name)
        assert high <= getattr(KNOWN, name)

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting, Step
from mbot_workstation.tasks.floor.tape import Tape, even
from mbot_workstation.tasks.line import (
    AHEAD_M,
    BESIDE_M,
    FACTS,
    LAP,
    LOST,
    LOST_M,
    STEP_M,
    TASK,
    TIME_OUT,
    TURN_AWAY_RAD,
    WAY,
    WAY_M,
    LineLesson,
    LineRun,
    LineSight,
)

from .driven_task import drives
from .small_world import ROOMS

SETTING = Setting(contact_radius_m=0.09, border_m=2.9, footprints=())
CURVES, LAST = (lesson for lesson in TASK.lessons if isinstance(lesson, LineLesson))
SIGHT = LineSight()
EIGHT = replace(CURVES, crossings=1.0)


def line(lesson: LineLesson = CURVES, seed: int = 0) -> LineRun:
    return TASK.begin(lesson, SETTING, np.random.default_rng(seed))


def around(run: LineRun) -> list[Pose]:
    """Places of the whole line, 2 cm apart, from the start on."""
    return [Pose(x, y) for x, y in even(run.tape.points, STEP_M).tolist()]


def drive(run: LineRun, poses: Iterable[Pose], each_s: float = 0.05) -> list[Step]:
    """Along there, until the run ends."""
    steps: list[Step] = []
    for pose in poses:
        steps.append(run.advance(pose, each_s))
        if steps[-1].ended:
            break
    return steps


def counted(steps: Sequence[Step]) -> Counter[str]:
    return Counter(step.happening for step in steps if step.happening != NOTHING)


def facts(run: LineRun, robot: Pose, seen_from: Pose | None = None) -> dict[str, Any]:
    told = run.facts(Moment(robot, 0.4, seen_from or robot, 0.35, camera_ahead_m=0.06))
    return dict(zip(FACTS.names or (), told, strict=True))


def test_it_begins_on_the_line_along_it() -> None:
    for seed in range(20):
        run = line(LAST, seed)
        assert run.tape.away_m(0.0, 0.0) < 1e-9
        told = facts(run, ORIGIN)
        assert told["beside_m"] < 1e-9
        assert told["aim_ahead_m"] > 0.2
        assert abs(told["aim_left_m"]) < 0.2


def test_half_metres_and_the_lap_are_paid() -> None:
    run = line()
    places = around(run)
    steps = drive(run, [*places, places[0]])
    halves = int((len(places) - 1) * STEP_M / WAY_M)
    assert counted(steps) == {WAY: halves, LAP: 1}
    assert (steps[-1].happening, steps[-1].score, steps[-1].ended) == (LAP, 1.0, True)
    assert sum(step.score for step in steps) == pytest.approx(1 + 0.1 * halves)
    assert run.result() == {"laps": 1, "score": pytest.approx(1 + 0.1 * halves)}
    assert run.ended


def test_three_laps_make_a_run_and_each_has_its_own_time() -> None:
    run = line(replace(CURVES, laps=3))
    places = around(run)
    each_s = 50 / len(places)
    for lap in range(3):
        assert facts(run, places[0])["time_left_s"] == pytest.approx(60 - each_s * (lap > 0), 0.02)
        steps = drive(run, [*places[1:], places[0]], each_s)
        assert counted(steps)[LAP] == 1
        assert steps[-1].ended == (lap == 2)
    assert run.result()["laps"] == 3


def test_half_a_metre_is_paid_once_however_often_it_is_driven() -> None:
    run = line()
    places = around(run)
    there = places[:26]
    assert counted(drive(run, there)) == {WAY: 1}
    for _ in range(3):
        assert not counted(drive(run, there[::-1] + there))


def test_who_drives_the_line_backwards_is_paid_nothing() -> None:
    run = line()
    steps = drive(run, around(run)[::-1])
    assert not counted(steps)
    assert run.result() == {"laps": 0, "score": 0.0}


def test_too_far_from_the_line_it_is_lost() -> None:
    run = line()
    beside = Pose(0.0, LOST_M - 0.01)
    assert run.advance(beside, 0.4).happening == NOTHING
    free_m = run.free_way_m(beside)
    assert 0 < free_m <= 0.03
    assert run.advance(Pose(0.0, beside.y_m + free_m - 1e-6), 0.4).happening == NOTHING
    bend_m = max(run.tape.points[:, 1].min(), run.tape.points[:, 1].max(), key=abs)
    away = Pose(0.0, -math.copysign(LOST_M + 0.001, bend_m))
    step = run.advance(away, 0.4)
    assert (step.happening, step.score, step.ended) == (LOST, -1.0, True)
    assert (run.ended, run.free_way_m(away)) == (True, 0.0)


def test_who_stands_is_out_of_time() -> None:
    run = line()
    steps = drive(run, [ORIGIN] * 200, 0.4)
    assert counted(steps) == {TIME_OUT: 1}
    assert len(steps) == pytest.approx(150, abs=1)
    assert (steps[-1].score, run.ended) == (-1.0, True)


@pytest.mark.parametrize("seed", range(4))
def test_at_a_crossing_the_way_goes_on_straight(seed: int) -> None:
    """Neither by wobbling about nor by driving past the other branch is any of the way left out."""
    run = line(EIGHT, seed)
    rng = np.random.default_rng(seed)
    places = [*around(run), ORIGIN]
    way_m = [0.0]
    for place in places:
        step = run.advance(replace(place, x_m=place.x_m + rng.uniform(-0.03, 0.03)), elapsed_s=0.05)
        way_m.append(facts(run, place)["way_m"])
        assert step.ended == (step.happening == LAP)
        if step.ended:
            break
    assert np.abs(np.diff(way_m)).max() < 0.1
    assert way_m[-1] == pytest.approx(STEP_M * (len(places) - 1), abs=0.06)


def test_who_turns_off_at_a_crossing_has_lost_the_line() -> None:
    run = line(EIGHT)
    places = around(run)
    xy = np.array([(place.x_m, place.y_m) for place in places])
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    count = len(places)
    later = np.arange(count)[None] - np.arange(count)[:, None] > count / 4
    first, second = divmod(int(np.where(later, apart, 9.0).argmin()), count)
    assert apart[first, second] < 0.03
    steps = drive(run, [*places[: first + 1], *places[second + 1 : second + 40]])
    assert steps[-1].happening == LOST
    assert len(steps) < first + 25


def test_gaps_are_pieces_that_are_not_drawn_and_none_is_at_the_start() -> None:
    missing: list[int] = []
    for seed in range(60):
        run = line(LAST, seed)
        whole, laid = run.tape.pieces(), TASK.pieces(run)
        gone = [number for number, piece in enumerate(whole) if piece not in laid]
        assert gone == sorted(run.missing)
        assert len(laid) == len(whole) - len(gone)
        assert all(2 < number < len(whole) - 2 for number in gone)
        missing.append(len(gone))
    assert {0, 1, 2} <= set(missing) <= {0, 1, 2, 3, 4}
    assert TASK.pieces(line()) == line().tape.pieces(), "the first lesson has none"


def test_lines_of_the_last_lesson_cross_themselves_now_and_then() -> None:
    def crosses(tape: Tape) -> bool:
        around_m = np.abs(np.subtract.outer(*[np.arange(len(tape.points))] * 2))
        apart = np.hypot(*(tape.points[:, None] - tape.points[None]).transpose(2, 0, 1))
        far = np.minimum(around_m, len(tape.points) - around_m) > 6
        return bool(apart[far].min() < 0.1)

    share = np.mean([crosses(line(LAST, seed).tape) for seed in range(100)])
    assert 0.2 < share < 0.5
    assert not any(crosses(line(CURVES, seed).tape) for seed in range(20))


def test_the_line_is_driven_in_either_direction() -> None:
    def turns_left(run: LineRun) -> bool:
        x, y = run.tape.points.T
        return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) > 0

    assert 5 < sum(turns_left(line(CURVES, seed)) for seed in range(30)) < 25


def test_facts_name_the_line_further_on_now_and_when_the_picture_was_taken() -> None:
    run = line()
    places = around(run)
    drive(run, places[:31])
    told = facts(run, places[30], places[25])
    assert told["way_m"] == pytest.approx(0.6, abs=0.021)
    further = round(AHEAD_M / STEP_M)
    for name, robot, place in (("aim", 30, 30 + further), ("seen", 25, 25 + further)):
        here, there = places[robot], places[place]
        apart = (there.x_m - here.x_m, there.y_m - here.y_m)
        found = (told[f"{name}_ahead_m"], told[f"{name}_left_m"])
        assert found == pytest.approx(apart, abs=0.03), name
    beside = facts(run, replace(places[30], yaw_rad=1.0))
    assert math.hypot(beside["aim_ahead_m"], beside["aim_left_m"]) == pytest.approx(0.3, abs=0.03)


def test_facts_change_nothing_and_the_result_is_json() -> None:
    run, asked = line(), line()
    for place in around(run)[:60]:
        assert facts(asked, place) == facts(asked, place)
        assert asked.advance(place, 0.1) == run.advance(place, 0.1)
    assert json.loads(json.dumps(run.result())) == dict(asked.result())
    assert dict(run.places()) == {}


def test_pictures_are_taken_by_the_line_and_tell_on_which_side_it_is() -> None:
    run, rng = line(LAST, 2), np.random.default_rng(0)
    told: list[tuple[Any, ...]] = []
    for _ in range(200):
        pose = SIGHT.scatter(run, rng)
        assert run.tape.away_m(pose.x_m, pose.y_m) < BESIDE_M + 0.01
        told.append(tuple(facts(run, pose).values()))
    known = np.array(told, FACTS)
    assert known["beside_m"].max() < BESIDE_M + 0.02
    turned = np.arctan2(known["seen_left_m"], known["seen_ahead_m"])
    assert np.abs(turned).max() < TURN_AWAY_RAD + 0.7
    shown = SIGHT.shown(known)
    assert 0.5 < shown[:, 0].mean() < 1
    assert ((shown[:, 1] > 0) == (turned > 0)).all()
    np.testing.assert_array_equal(SIGHT.mirrored(shown), shown * (1, -1, 1))


def test_its_line_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = TaskEnv("ideal", rooms=ROOMS, task="line")
    taped, _ = environment.reset(seed=1)
    monkeypatch.setattr(type(TASK), "pieces", lambda *_: ())
    bare, _ = environment.reset(seed=1)
    environment.close()
    darker = bare.astype(int).sum(axis=2) - taped.astype(int).sum(axis=2) > 60
    assert 20 < darker.sum() < 1000
    assert darker[-6:, 24:40].any(axis=1).all(), "it runs towards the robot"


def test_its_guide_earns_most_of_what_there_is_and_standing_does_not() -> None:
    guide, standing = drives("line", "guide"), drives("line", "standing")
    assert set(guide.counts) == {3}
    assert guide.reward > 0.85 * guide.largest
    assert standing.reward == -1.0
    assert set(standing.counts) == {0}


def test_it_is_learned_from_its_last_lesson_with_the_guide() -> None:
    assert TASK.course(guided=True, further=False) == ("3-laps",)
    assert TASK.course(guided=False, further=False) == ("curves", "3-laps")
    assert [lesson.goal for lesson in TASK.lessons] == [1, 3]
    assert isinstance(TASK.sight, LineSight)

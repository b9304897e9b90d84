"""Flats, and finding what is in another room."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.episode import Moment, Setting
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.rules import WRONG_SCORE
from mbot_workstation.tasks.floor.flat import DOOR_M, FROM_CORNER_M, FROM_START_M, HALF_M, draw_flat
from mbot_workstation.tasks.floor.solids import Solids, Wall
from mbot_workstation.tasks.hidden import FLAT, TASK
from mbot_workstation.tasks.obstacles.episode import FROM_WALLS_M, Obstacles, ObstaclesEpisode

from .driven_task import drives, world_of

SETTING = Setting(0.09, 2.9, (RED_CUBE.footprint,))
ACROSS = Wall(1.0, -3.0, 1.0, 3.0)
AHEAD, BEHIND = Pose(2.0, 0.0), Pose(-2.0, 0.0)


def run_in(*walls: Wall, target: Pose = AHEAD) -> ObstaclesEpisode:
    rules = replace(FLAT.rules, touch_radius_m=0.09, footprints=SETTING.footprints)
    run = ObstaclesEpisode(rules, np.random.default_rng(0), Obstacles((), walls=walls))
    run.target = target
    return run


@pytest.mark.parametrize("seed", range(60))
def test_every_room_of_a_flat_has_a_door(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flat = draw_flat(rng, 3)
    assert 2 <= len(flat.rooms) <= 4
    area_m2 = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in flat.rooms)
    assert area_m2 == pytest.approx((2 * HALF_M) ** 2)
    assert len(flat.pieces(rng)) == len(flat.walls) == 2 * (len(flat.rooms) - 1)
    solids = Solids.of((), flat.walls)
    assert (solids.gaps_m(np.zeros(2)) > FROM_START_M - 0.05).all()
    run = run_in(*flat.walls)
    ways = run.floor.ways_to(ORIGIN)
    for x0, y0, x1, y1 in flat.rooms:
        middle = Pose((x0 + x1) / 2, (y0 + y1) / 2)
        assert math.isfinite(ways.from_m(middle)), f"room {x0:.1f} {y0:.1f} {x1:.1f} {y1:.1f}"
    for one, other in zip(flat.walls[::2], flat.walls[1::2], strict=True):
        door_m = math.hypot(one.x1_m - other.x0_m, one.y1_m - other.y0_m)
        assert DOOR_M[0] - 1e-9 <= door_m <= DOOR_M[1] + 1e-9


def test_no_wall_begins_in_a_door_or_right_beside_one() -> None:
    for seed in range(200):
        walls = draw_flat(np.random.default_rng(seed), 3).walls
        pairs = list(zip(walls[::2], walls[1::2], strict=True))
        doors = [((one.x1_m, one.y1_m), (other.x0_m, other.y0_m)) for one, other in pairs]
        for number, (one, other) in enumerate(pairs):
            for end in ((one.x0_m, one.y0_m), (other.x1_m, other.y1_m)):
                for door in doors[:number]:
                    away_m = min(math.dist(end, edge) for edge in door)
                    middle = [(a + b) / 2 for a, b in zip(*door, strict=True)]
                    assert min(away_m, math.dist(end, middle)) >= FROM_CORNER_M


def test_flats_differ_and_come_again() -> None:
    one, same, other = (draw_flat(np.random.default_rng(seed), 3) for seed in (1, 1, 2))
    assert one == same != other


def test_an_object_behind_a_wall_is_out_of_sight_and_around_it_is_not() -> None:
    door = (Wall(1.0, -3.0, 1.0, -0.4), Wall(1.0, 0.4, 1.0, 3.0))
    assert run_in(ACROSS).is_out_of_sight(ORIGIN)
    assert not run_in(*door).is_out_of_sight(ORIGIN)
    assert run_in(*door).is_out_of_sight(Pose(0.9, 1.0))
    seen = dict(
        zip(
            TASK.facts.names or (),
            run_in(ACROSS).facts(Moment(ORIGIN, 1.0, ORIGIN, 0.9, 0.06)),
            strict=True,
        )
    )
    assert not abs(seen["seen_left_rad"]) < 1


def test_a_wall_cannot_be_driven_through_and_counts_once() -> None:
    run, robot = run_in(ACROSS), Pose(0.5, 0.0)
    scores = []
    for _ in range(200):
        step = run.advance(robot, 0.01)
        scores.append(step.score)
        robot = Pose(robot.x_m + 0.004 + step.pushed_m[0], robot.y_m + step.pushed_m[1])
    assert robot.x_m < 1.0 - 0.03 - 0.08
    assert [score for score in scores if score] == [WRONG_SCORE]
    assert run.result()["wrong_things"] == 1


def test_no_object_stands_in_a_wall() -> None:
    for seed in range(40):
        run = TASK.begin(FLAT, SETTING, np.random.default_rng(seed))
        gaps_m = Solids.of((), run.obstacles.walls).gaps_m(
            np.array([run.target.x_m, run.target.y_m])
        )
        assert gaps_m.min() >= FROM_WALLS_M


def test_played_it_is_a_flat_without_end() -> None:
    played = TASK.play(None, None, ends_on_failure=False)
    assert isinstance(played, FetchLesson)
    assert (played.name, played.objects, played.time_limit_s) == ("play", 0, FLAT.time_limit_s)
    assert TASK.begin(played, SETTING, np.random.default_rng(0)).obstacles.walls


def test_a_world_stops_who_drives_at_a_wall() -> None:
    world = world_of("hidden")
    world.episode = run_in(ACROSS, target=BEHIND)
    while not world.episode.ended:
        world.decide(1.0, 1.0)
    assert world.robot.x_m < 1.0


def test_its_guide_finds_everything() -> None:
    guide, standing = drives("hidden", "guide", 1000), drives("hidden", "standing")
    assert guide.counts == (10,) * len(guide.counts)
    assert guide.reward > 0.9 * guide.largest
    assert standing.reward < 0

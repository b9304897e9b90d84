import colorsys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium_env
from stable_baselines3.common.env_checker import check_env as check_sb3_env

from mbot_workstation.learn.worlds.robot_eye import RobotEye
from mbot_workstation.learn.worlds.task_env import ENV_ID, TaskEnv
from mbot_workstation.learn.worlds.world import World
from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.body_record import BODY
from mbot_workstation.sim.scene.object_mjcf import DISTRACTORS
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import Shape, TargetObject
from mbot_workstation.tasks.fetch.episode import Happening
from mbot_workstation.tasks.fetch.lessons import BLUR_LESSON, LESSONS, ROUGH_LESSON, FetchLesson

from .small_world import ROOMS, settings, steer_to_target, world

SPIN, STRAIGHT, STAND = (-1.0, 1.0), (1.0, 1.0), (0.0, 0.0)


@pytest.fixture(scope="module")
def nominal() -> Iterator[TaskEnv]:
    environment = TaskEnv(preset="nominal", lesson="10", rooms=ROOMS)
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def eye() -> Iterator[RobotEye]:
    with RobotEye(ROOMS) as result:
        yield result


def test_both_checkers_are_content(nominal: TaskEnv) -> None:
    check_gymnasium_env(nominal)
    check_sb3_env(nominal)


def test_is_made_by_its_name() -> None:
    environment = gymnasium.make(ENV_ID, preset="ideal", lesson="1", rooms=ROOMS)
    observation, info = environment.reset(seed=1)
    assert observation.shape == (64, 64, 3)
    assert info["lesson"] == "1"
    environment.close()


@pytest.mark.parametrize("preset", ["nominal", "randomised"])
def test_a_seed_fixes_everything(preset: str) -> None:
    environment = TaskEnv(preset=preset, lesson="1", rooms=ROOMS)
    environment.action_space.seed(0)
    actions = [environment.action_space.sample() for _ in range(12)]

    def run(seed: int) -> list[Any]:
        seen: list[Any] = [environment.reset(seed=seed)[0]]
        for action in actions:
            observation, reward, ended, _, info = environment.step(action)
            seen += [observation, reward, tuple(info.values())]
            if ended:
                seen.append(environment.reset()[0])
        return seen

    first, again, other = run(7), run(7), run(8)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])
    environment.close()


def where(robot: World) -> tuple[float, float]:
    info = robot.info()
    return info["target_ahead_m"], info["target_left_m"]


def drive(robot: World, decisions: int) -> list[tuple[float, str, bool]]:
    """Steer to objects until the episode ends."""
    outcomes = []
    for _ in range(decisions):
        outcome = robot.decide(*steer_to_target(robot))
        outcomes.append((outcome.reward, outcome.happening, outcome.ended))
        if outcome.ended:
            break
    return outcomes


def test_one_object_is_worth_up_to_three() -> None:
    robot = world("1")
    *before, (reward, happening, ended) = drive(robot, 20)
    assert (happening, ended, robot.info()["touches"]) == (Happening.TOUCH, True, 1)
    used_s = 66.8 - robot.info()["time_left_s"]
    assert (len(before) * 0.4) < used_s <= (len(before) + 1) * 0.4 + 1e-6
    assert reward == pytest.approx(1 + (1 - used_s / 66.8) + 1)
    assert all(reward == 0 for reward, _, _ in before)


def test_ten_objects_make_a_run_near_the_papers_score() -> None:
    robot = world("10", 1)
    outcomes = drive(robot, 400)
    assert robot.info()["touches"] == 10
    assert sum(reward for reward, _, _ in outcomes) > 19
    touched = [reward for reward, happening, _ in outcomes if happening == Happening.TOUCH]
    assert len(touched) == 10
    assert all(1 < reward <= 2 for reward in touched[:-1])
    assert 2 < touched[-1] <= 3, "the complete run is worth one more"


def test_the_border_ends_the_episode_with_a_penalty(nominal: TaskEnv) -> None:
    nominal.reset(seed=3)  # the object is not on the way
    ahead = np.array(STRAIGHT, np.float32)
    steps = iter(lambda: nominal.step(ahead), None)
    _, reward, _, truncated, info = next(step for step in steps if step[2])
    assert (reward, truncated) == (-1.0, False)
    assert info["border"]
    assert info["happening"] == "border"
    assert max(abs(nominal.world.robot.x_m), abs(nominal.world.robot.y_m)) == pytest.approx(
        2.9, abs=0.02
    )
    with pytest.raises(RuntimeError, match="ended"):
        nominal.step(ahead)


def test_time_out_terminates_after_167_decisions_with_a_penalty() -> None:
    robot = world("10")
    outcomes = [robot.decide(*STAND) for _ in range(167)]
    assert [outcome.ended for outcome in outcomes] == [False] * 166 + [True]
    assert (outcomes[-1].reward, outcomes[-1].happening) == (-1.0, Happening.TIME_OUT)
    assert robot.info()["time_left_s"] == pytest.approx(0, abs=0.01)


def test_a_touch_moves_the_object_turns_the_room_and_restarts_the_timer() -> None:
    robot = world("7", 2)
    room_before = robot.simulation.snapshot().moved_quat.copy()
    outcomes = drive(robot, 100)
    first = [happening for _, happening, _ in outcomes].index(Happening.TOUCH)
    assert first < len(outcomes) - 1
    assert not np.allclose(room_before, robot.simulation.snapshot().moved_quat)

    again = world("7", 2)
    for _ in range(first + 1):
        again.decide(*steer_to_target(again))
    assert again.info()["time_left_s"] > 66.8 - 0.4
    assert not again.episode.ended


@pytest.mark.parametrize("latency_ms", [0.0, 150.0, 600.0])
def test_camera_latency_shows_an_earlier_moment(latency_ms: float) -> None:
    prompt, late = world(), world(camera_latency_ms=latency_ms)
    prompt_s: list[float] = []
    for decision in range(8):
        prompt.decide(*SPIN)
        late.decide(*SPIN)
        prompt_s.append(prompt.glimpse.time_s)
        assert late.glimpse.time_s == pytest.approx(
            max(0.0, (decision + 1) * 0.4 - latency_ms / 1000), abs=0.011
        )
    assert prompt_s == pytest.approx([0.4 * (decision + 1) for decision in range(8)])


def test_a_late_picture_is_the_picture_of_that_moment(eye: RobotEye) -> None:
    prompt, late = world("10", 4), world("10", 4, camera_latency_ms=400.0)
    shown = [eye.observe(prompt)]
    for _ in range(4):
        prompt.decide(*SPIN)
        late.decide(*SPIN)
        assert np.array_equal(eye.observe(late), shown[-1])
        shown.append(eye.observe(prompt))
        assert not np.array_equal(shown[-1], shown[-2])


def test_action_latency_delays_the_wheels() -> None:
    prompt, late = world(), world(action_latency_ms=200.0)
    for robot in (prompt, late):
        robot.decide(*STRAIGHT)
    assert prompt.robot.x_m - late.robot.x_m == pytest.approx(0.2 * 0.4, abs=0.015)
    waiting = world(action_latency_ms=450.0)
    waiting.decide(*STRAIGHT)
    assert waiting.robot.x_m == pytest.approx(0, abs=1e-3)
    waiting.decide(*STRAIGHT)
    assert waiting.robot.x_m > 0.05


def test_blur_comes_with_turning_only(eye: RobotEye) -> None:
    def edges(action: tuple[float, float], **shutter: float) -> float:
        robot = world("10", 5, **shutter)
        robot.decide(*action)
        return float(np.abs(np.diff(eye.observe(robot).astype(float), axis=1)).mean())

    shutter = {"exposure_ms": 20.0, "readout_ms": 23.0}
    assert edges(STRAIGHT, **shutter) == edges(STRAIGHT)
    assert edges(SPIN, **shutter) < 0.8 * edges(SPIN)


def test_the_hidden_body_is_never_in_view() -> None:
    hidden, shown = world(), world()
    model = shown.simulation.model
    model.geom_group[:] = np.where(model.geom_group == 4, 0, model.geom_group)
    wheels = [i for i in range(model.ngeom) if model.geom(i).name.endswith("wheel")]
    bumper = model.geom("bumper").id
    model.geom_group[[*wheels, bumper]] = 4
    with RobotEye(ROOMS) as both:
        assert np.array_equal(both.observe(hidden), both.observe(shown))


def test_two_eyes_in_turns_see_what_each_sees_alone(eye: RobotEye) -> None:
    """Each has an OpenGL context, and the one that was made last is current."""
    robot = world("10", 6)
    seen = eye.observe(robot)
    black = [np.zeros_like(room) for room in ROOMS]
    with RobotEye(black) as other:
        assert not np.array_equal(other.observe(robot), seen)
        assert np.array_equal(eye.observe_all([robot, robot]), [seen, seen])


def test_gain_brightens_noise_roughens_and_drift_swings(eye: RobotEye) -> None:
    plain = eye.observe(world("10", 6)).astype(float)
    dim = eye.observe(world("10", 6, exposure_gain=0.5)).astype(float)
    assert np.abs(dim - plain / 2).max() <= 1
    warm = eye.observe(world("10", 6, red_gain=0.8)).astype(float)
    assert np.abs(warm[..., 0] - 0.8 * plain[..., 0]).max() <= 1
    assert np.array_equal(warm[..., 1:], plain[..., 1:])
    noisy = eye.observe(world("10", 6, noise=5.0)).astype(float)
    assert 1 < np.std(noisy - plain) < 3
    coded = eye.observe(world("10", 6, jpeg_quality=60.0)).astype(float)
    assert 0.3 < np.std(coded - plain) < 6

    robot = world("10", 6, exposure_drift=0.2)
    means = []
    for _ in range(50):  # 20 s
        robot.decide(*STAND)
        means.append(eye.observe(robot).mean() / plain.mean())
    assert min(means) < 0.85
    assert max(means) > 1.1 or plain.mean() > 200


def test_brightness_of_cube_and_floor(eye: RobotEye) -> None:
    plain, dark = (eye.observe(world("1", floor_brightness=b)).astype(float) for b in (1.0, 0.7))
    assert np.allclose(dark[60, :20], 0.7 * plain[60, :20], atol=3)
    lit = eye.observe(world("1", cube_brightness=0.7)).astype(float)
    cube = plain[..., 0] - plain[..., 1:].max(axis=2) > 100
    assert cube.sum() > 50
    assert lit[cube][:, 0].mean() == pytest.approx(0.7 * plain[cube][:, 0].mean(), rel=0.1)
    assert np.array_equal(lit[:10], plain[:10])


def test_mounting_and_view_move_the_picture(eye: RobotEye) -> None:
    def cube_at(**effects: float) -> tuple[float, float]:
        picture = eye.observe(world("1", 3, **effects)).astype(float)
        red = np.clip(picture[..., 0] - picture[..., 1:].max(axis=2) - 40, 0, None)
        rows, columns = np.mgrid[:64, :64]
        return float((red * columns).sum() / red.sum()), float((red * rows).sum() / red.sum())

    column, row = cube_at()
    px_per_deg = 64 / 55.3
    assert cube_at(camera_yaw_deg=2.0)[0] == pytest.approx(column + 2 * px_per_deg, abs=0.7)
    assert cube_at(camera_pitch_deg=2.0)[1] < row - 1.5
    assert cube_at(principal_right=0.02)[0] == pytest.approx(column + 0.02 * 64, abs=0.3)
    wider = cube_at(fov_scale=1.1)
    assert abs(wider[0] - 31.5) == pytest.approx(abs(column - 31.5) / 1.1, abs=0.3)


def test_uneven_motors_and_sagging_batteries_show_in_the_way_driven() -> None:
    weak, sagging, nominal = world(right_gain=0.85), world(battery_sag=0.2), world()
    for robot in (weak, sagging, nominal):
        for _ in range(3):
            robot.decide(*STRAIGHT)
    assert weak.robot.yaw_rad < -0.3
    assert abs(nominal.robot.yaw_rad) < 1e-3
    assert sagging.robot.x_m == pytest.approx(0.8 * nominal.robot.x_m, rel=0.03)


def test_a_robot_that_changes_on_the_way_turns_from_there_on_and_stands_where_it_stood() -> None:
    """A motor gives way in mid-drive; what drivers are told of the robot says so."""
    weak = (("right_gain", (0.5, 0.5)),)
    robot = world(
        FetchLesson("changing", 2.5, objects=10, changes=1.0, change_after=(3, 4), change_to=weak)
    )
    gain = BODY.index("right_gain")
    for _ in range(3):
        robot.decide(*STRAIGHT)
    before = robot.robot
    assert (abs(before.yaw_rad) < 1e-3, robot.body[gain]) == (True, 1.0)
    robot.decide(*STRAIGHT)
    assert robot.body[gain] == 0.5
    assert robot.robot.x_m - before.x_m == pytest.approx(before.x_m / 3, rel=0.5)  # no jump
    assert robot.robot.yaw_rad < -0.1
    robot.begin(FetchLesson("steady", 2.5, objects=10))
    for _ in range(5):
        robot.decide(*STRAIGHT)
    assert robot.body[gain] == 1.0


def test_only_rough_robots_change_and_see_lookalikes() -> None:
    """So that arenas of evaluation stay as they are."""
    lessons = (*LESSONS, BLUR_LESSON, ROUGH_LESSON)
    assert [stage.name for stage in lessons if stage.changes] == ["rough"]
    assert [stage.name for stage in lessons if stage.lookalikes] == ["rough"]


def test_a_lesson_with_lookalikes_shows_them() -> None:
    def orange_or_magenta(lookalikes: float) -> float:
        robot = world(scene_variety=1.0)
        hues: list[float] = []
        for _ in range(60):
            robot.begin(FetchLesson("any look", 2.5, objects=1, lookalikes=lookalikes))
            things = [robot.simulation.model.geom(name) for name in DISTRACTORS]
            shown = [thing.rgba[:3] for thing in things if thing.group[0] != HIDDEN_GROUP]
            hues += [colorsys.rgb_to_hsv(*rgb)[0] for rgb in shown]
        return float(np.mean([0.099 < hue < 0.181 or 0.799 < hue < 0.881 for hue in hues]))

    assert orange_or_magenta(1.0) == 1.0
    assert orange_or_magenta(0.0) < 0.3


def test_compensation_meets_the_dead_band() -> None:
    def way_m(**effects: float) -> float:
        robot = world(**effects)
        for _ in range(3):
            robot.decide(0.1, 0.1)
        return robot.robot.x_m

    assert way_m(dead_band_scale=1.0) == pytest.approx(0, abs=1e-3)
    full = way_m()
    assert way_m(dead_band_scale=1.0, compensation_scale=1.25) == pytest.approx(full, rel=0.1)


def test_the_blur_lesson_blurs_an_ideal_robot() -> None:
    made = settings(BLUR_LESSON)
    robot = World(made)
    robot.seed(np.random.default_rng(0))
    robot.begin(BLUR_LESSON)
    assert robot.camera.view(replace(robot.glimpse, turn_rate_rad_s=3.0)).focal_x_px < 60
    assert robot._effects is not None
    assert 10 <= robot._effects.exposure_ms <= 60


def test_the_robot_is_the_one_it_was_given() -> None:
    robot = replace(RobotParameters(), wheel_radius_m=0.030)
    environment = TaskEnv("ideal", "1", ROOMS, robot)
    environment.reset(seed=0)
    assert environment.world.simulation.robot.wheel_radius_m == 0.030
    environment.close()


def test_of_several_kinds_of_object_one_at_a_time_is_seen_and_touched_where_it_stands() -> None:
    kinds = (
        TargetObject("ball", Shape.BALL, 0.2, 0.2, (30, 200, 50)),
        TargetObject("post", Shape.CYLINDER, 0.04, 0.3, (25, 60, 220)),
    )
    made = replace(settings("1"), scene=SceneParameters(objects=kinds))
    driven = World(made)
    driven.seed(np.random.default_rng(0))
    touched_at_m: dict[int, list[float]] = {0: [], 1: []}
    grey = [np.full_like(room, 128) for room in ROOMS]
    with RobotEye(grey, scene=made.scene) as eye:
        for _ in range(8):
            driven.begin(made.lesson)
            (kind,), ended = driven.episode.places(), False
            while not ended:
                ahead_m, left_m = where(driven)
                picture = eye.observe(driven).astype(int)
                coloured = picture[..., 1 + kind] - picture[..., 2 - kind]
                if ahead_m > 0.3 and abs(left_m) < 0.3 * ahead_m:
                    assert (coloured > 60).sum() >= 3, "the kind that is due"
                assert (coloured < -80).sum() == 0, "and never the other"
                ended = driven.decide(*steer_to_target(driven)).ended
            if driven.info()["touches"]:
                ahead_m, left_m = where(driven)
                touched_at_m[kind].append(float(np.hypot(ahead_m, left_m)))
    radius_m = made.robot.touch_radius_m
    for kind, thing in enumerate(kinds):
        assert touched_at_m[kind], f"the {thing.name} was never fetched"
        assert np.max(touched_at_m[kind]) <= radius_m + thing.width_m / 2
        assert np.min(touched_at_m[kind]) >= radius_m + thing.width_m / 2 - 0.02

"""How many decisions a second the training environment gives, beside the obvious way to do it.

    python benchmarks/training_environment.py [--json]

One decision is 0.4 s of driving and one picture of 64 x 64. Measured in turns, so that a busy
machine treats all alike: `TaskVecEnv` with three presets; a Gymnasium environment written straight
from the documentation of MuJoCo and stable-baselines3 (`mujoco.Renderer` in a `SubprocVecEnv`) with
the same model and the same picture settings; and what physics and drawing alone would allow.
"""

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv

from mbot_workstation.learn.worlds.fast_physics import TRAINING_TIMESTEP_S
from mbot_workstation.learn.worlds.robot_camera import Glimpse
from mbot_workstation.learn.worlds.robot_eye import OBSERVATION, RobotEye
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.learn.worlds.world import World
from mbot_workstation.learn.worlds.world_settings import world_settings
from mbot_workstation.sim.body.robot_mjcf import ROBOT_CAMERA
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.scene.object_mjcf import object_name
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_mjcf import build_model
from mbot_workstation.sim.scene.scene_parameters import SceneParameters

PRESETS = ("ideal", "nominal", "randomised")
PLAIN = "plain SubprocVecEnv"
DECISION_S = 0.4


class PlainEnv(gymnasium.Env[Any, Any]):
    """The task as the documentation would have one write it: no effects, one room."""

    def __init__(self, room: Any) -> None:
        self.observation_space = Box(0, 255, (64, 64, 3), np.uint8)
        self.action_space = Box(-1, 1, (2,), np.float32)
        self.model = build_model(RobotParameters(), SceneParameters(), room)
        self.model.vis.quality.shadowsize = OBSERVATION.shadow_map_px
        self.model.vis.quality.offsamples = OBSERVATION.samples
        self.model.vis.global_.offwidth = self.model.vis.global_.offheight = 64
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, 64, 64)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self.renderer.scene.flags[flag] = False
        self.cube = self.model.body(object_name()).mocapid[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self._move_cube()
        self.left = 167
        return self._picture(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.data.ctrl[:2] = 3.7 * np.clip(action, -1, 1)
        reward, ended = 0.0, False
        self.left -= 1
        for _ in range(round(DECISION_S / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
            way = self.data.qpos[:2] - self.data.mocap_pos[self.cube, :2]
            if np.hypot(*way) < 0.15:
                reward += 1 + self.left / 167
                self._move_cube()
            ended = ended or np.abs(self.data.qpos[:2]).max() > 2.9
        return self._picture(), reward - ended, bool(ended or self.left == 0), False, {}

    def _move_cube(self) -> None:
        angle, distance = self.np_random.uniform(-np.pi, np.pi), self.np_random.uniform(0.45, 2.5)
        self.data.mocap_pos[self.cube, :2] = distance * np.cos(angle), distance * np.sin(angle)

    def _picture(self) -> Any:
        self.renderer.update_scene(self.data, camera=ROBOT_CAMERA)
        return self.renderer.render()


def drive(environment: VecEnv, decisions: int) -> float:
    """Decisions a second with random actions, changed every decision."""
    rounds = max(1, decisions // environment.num_envs)
    actions = np.random.default_rng(0).uniform(-1, 1, (rounds, environment.num_envs, 2))
    actions = actions.astype(np.float32)
    start_s = time.perf_counter()
    for action in actions:
        environment.step(action)
    return rounds * environment.num_envs / (time.perf_counter() - start_s)


def kernels(room: Any, decisions: int) -> dict[str, float]:
    """Milliseconds a decision takes one worker at least: physics, picture."""
    settings = world_settings("ideal", "10", [room])
    world = World(settings)
    world.seed(np.random.default_rng(0))
    world.begin(settings.lesson)
    model, simulation = world.simulation.model, world.simulation
    data = mujoco.MjData(model)
    steps = round(DECISION_S / TRAINING_TIMESTEP_S)
    actions = np.random.default_rng(0).uniform(-3.7, 3.7, (decisions, 2))

    start_s = time.perf_counter()
    for action in actions:
        data.ctrl[:2] = action
        mujoco.mj_step(model, data, steps)
    physics_s = time.perf_counter() - start_s

    moments = []
    for action in actions[:50]:
        simulation.set_duty(*action)
        simulation.step(DECISION_S)
        moments.append(Glimpse(simulation.snapshot(), 0.0, 0.0))
    with RobotEye(settings.rooms) as eye:
        eye.observe(world)
        start_s = time.perf_counter()
        for index in range(decisions):
            world.glimpse = moments[index % len(moments)]
            eye.observe(world)
        picture_s = time.perf_counter() - start_s
    return {"physics_ms": 1e3 * physics_s / decisions, "picture_ms": 1e3 * picture_s / decisions}


def measure(robots: int, workers: int, rounds: int, decisions: int) -> dict[str, Any]:
    """All of it, in turns."""
    rooms = [generate_room(seed, 512) for seed in range(6)]
    makers: dict[str, Callable[[], VecEnv]] = {
        name: lambda name=name: TaskVecEnv(robots, 0, name, "10", rooms, workers)
        for name in PRESETS
    }
    makers[PLAIN] = lambda: SubprocVecEnv([lambda: PlainEnv(rooms[0]) for _ in range(robots)])
    speeds: dict[str, list[float]] = {name: [] for name in makers}
    least: list[dict[str, float]] = []
    for name, make in makers.items():
        environment = make()
        environment.reset()
        drive(environment, 20 * robots)  # caches, first episodes
        makers[name] = lambda environment=environment: environment
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for _ in range(rounds):
            for name, get in makers.items():
                speeds[name].append(drive(get(), decisions))
            share = decisions // workers
            least += pool.map(kernels, [rooms[0]] * workers, [share] * workers)
    for get in makers.values():
        get().close()

    medians = {name: statistics.median(values) for name, values in speeds.items()}
    kernel = {key: statistics.median(one[key] for one in least) for key in least[0]}
    bound = workers * 1e3 / sum(kernel.values())
    return {
        "robots": robots,
        "workers": workers,
        "load_average": round(os.getloadavg()[0], 2),
        "decisions_per_s": {name: round(value) for name, value in medians.items()},
        "best_decisions_per_s": {name: round(max(values)) for name, values in speeds.items()},
        "times_plain": {name: round(medians[name] / medians[PLAIN], 2) for name in PRESETS},
        "kernels": {key: round(value, 3) for key, value in kernel.items()},
        "kernels_decisions_per_s": round(bound),
        "share_of_kernels": {name: round(medians[name] / bound, 2) for name in PRESETS},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="speed of the training environment")
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--decisions", type=int, default=960, help="a round and environment")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    result = measure(options.robots, options.workers, options.rounds, options.decisions)
    if options.json:
        print(json.dumps(result))
        return
    print(
        f"{options.robots} robots, {options.workers} workers, median of {options.rounds} rounds; "
        f"load {result['load_average']}"
    )
    for name, speed in result["decisions_per_s"].items():
        best = result["best_decisions_per_s"][name]
        times = result["times_plain"].get(name, 1.0)
        print(f"  {name:22} {speed:6} decisions/s (best {best}), {times:.2f} x plain")
    kernel = result["kernels"]
    print(
        f"  bare kernels: physics {kernel['physics_ms']:.3f} ms + picture "
        f"{kernel['picture_ms']:.3f} ms of a worker = {result['kernels_decisions_per_s']} "
        f"decisions/s; shares {result['share_of_kernels']}"
    )


if __name__ == "__main__":
    main()

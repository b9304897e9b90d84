"""The daemon's check for robots that are stuck, on what the simulation's cameras see."""

from collections.abc import Sequence

import numpy as np
import pytest

from mbot_agent.arming import Mode, Orders
from mbot_agent.camera.stuck import StuckCheck
from mbot_agent.tick import Tick
from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.learn.drivers.contestants import driver
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.camera_stream import NOISY, USUAL_SHUTTER

PERIOD_S = 0.4
ROBOTS = 16
EPISODES = 34
"""Of each of three presets: 102 in all."""

CAMERAS = {
    "no noise": IspSettings(),
    "noise": NOISY,
    "much noise": IspSettings(noise=5.0),
    "automatic": isp_settings(preset("automatic").low),
}


def beat(number: int, observation: Picture, action: Sequence[float]) -> Tick:
    at_ns = round(number * PERIOD_S * 1e9)
    told = WheelMaps().duties(to_steps(*action))
    orders = Orders(Mode.RUNNING)
    return Tick(number, at_ns, at_ns, 0, orders, observation=observation, duties=told)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize(("action", "heading_rad"), [((0.6, 0.6), 0.0), ((1.0, 1.0), 0.3)])
def test_a_robot_at_a_wall_is_found_stuck(
    camera: str, action: tuple[float, float], heading_rad: float
) -> None:
    simulation = Simulation()
    simulation.place_robot(Pose(2.6, 0.5, heading_rad))
    simulation.set_duty(*pwm_duties(WheelMaps().duties(to_steps(*action))))
    lens = CameraModel.from_field_of_view(
        320, 240, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg
    )
    observer, check = Observer(lens, FULL_VIEW), StuckCheck()
    arrived_s, found_s = None, None
    with CameraRenderer(
        simulation, 320, 240, shutter=USUAL_SHUTTER, isp=CAMERAS[camera]
    ) as renderer:
        for number in range(20):
            seen = renderer.picture(
                simulation.snapshot(), simulation.turn_rate_rad_s, simulation.time_s
            )
            if arrived_s is None and simulation.pose.x_m > 2.9:
                arrived_s = number * PERIOD_S
            if check.judge(beat(number, observer.observe(seen), action)) is not None:
                found_s = number * PERIOD_S
                break
            simulation.step(PERIOD_S)
    assert arrived_s is not None
    assert found_s is not None
    # Round the corner of a decision, and until an exposure of 0.4 s has settled.
    assert 2.8 <= found_s - arrived_s <= 4.4


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["nominal", "automatic", "any-room"])
def test_nobody_is_found_stuck_in_ordinary_episodes(name: str) -> None:
    ranges = preset(name)
    driven_by = driver("servo", ROBOTS, 7, ranges)
    checks = [StuckCheck() for _ in range(ROBOTS)]
    ended, driven = 0, 0
    with TaskVecEnv(ROBOTS, 7, ranges, lesson="10") as environment:
        pictures = np.asarray(environment.reset())
        number = 0
        while ended < EPISODES:
            actions = np.clip(driven_by.act(pictures, []), -1, 1)
            for check, picture, action in zip(checks, pictures, actions.tolist(), strict=True):
                assert check.judge(beat(number, picture, action)) is None
                driven += any(action)
            stepped, _, dones, _ = environment.step(actions)
            pictures, number = np.asarray(stepped), number + 1
            for robot in np.flatnonzero(dones):
                checks[robot], ended = StuckCheck(), ended + 1
    assert driven > EPISODES * 100, "wheels that hardly turn prove nothing"

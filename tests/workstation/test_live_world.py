import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from mbot_protocol.drive.mcore import Joystick
from mbot_workstation.sim.scene.scene_look import ObjectLook, SceneLook, Standing
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.episode import Setting
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.find import find_task
from mbot_workstation.virtual.live_world import SLICE_S, LiveWorld, setting_of
from mbot_workstation.virtual.mcore_board import BoardState

from ..until import until
from .small_world import ROOMS

FETCH = (TASK, TASK.play(None, None, ends_on_failure=True))
SETTING = Setting(contact_radius_m=0.09, border_m=2.9, footprints=(RED_CUBE.footprint,))

FORWARD = Joystick(-255, 255)


class Board:
    """Says what it is told to say; asked for the hundredth time, the machine stalls."""

    def __init__(self, since_s: float = 0.0) -> None:
        self._state, self._asked = BoardState(FORWARD, since_s, 1), 0

    @property
    def state(self) -> BoardState:
        self._asked += 1
        if self._asked == 100:
            time.sleep(0.1)
        return self._state


def test_a_run_is_played_among_the_things_that_a_look_shows() -> None:
    simulation = Simulation(room_picture=ROOMS[0])
    can = Standing("can", 1.0, 0.0, 0.04, 0.1)
    look = SceneLook(objects=(ObjectLook(scale=1.2),), standing=(can,))
    setting = setting_of(simulation, look)
    assert setting.standing == (can,)
    assert setting.footprints == (RED_CUBE.footprint.scaled(1.2),)


def test_a_slice_made_up_for_does_not_obey_commands_that_came_later() -> None:
    simulation = Simulation(room_picture=ROOMS[0])
    world = LiveWorld(simulation, Board(since_s=10.0), *FETCH, SETTING, seed=0, free_floor=True)
    for moment_s in (9.985, 9.990, 9.995):
        world.advance(moment_s)
    assert abs(simulation.wheel_speeds_rad_s[0]) < 0.2  # it settles on its wheels
    for moment_s in (10.000, 10.005):
        world.advance(moment_s)
    assert simulation.wheel_speeds_rad_s[0] > 0.5


def test_what_stands_in_the_way_stops_the_robot_and_no_way_is_counted() -> None:
    task = find_task("obstacles")
    simulation = Simulation(room_picture=ROOMS[0])
    bin_ahead = Standing("bin", 0.5, 0.0, 0.15, 0.3)
    lesson = replace(task.lessons[-1], things=(0, 0))
    setting = replace(SETTING, standing=(bin_ahead,))
    world = LiveWorld(simulation, Board(), task, lesson, setting, seed=0)
    for _ in range(400):  # two seconds; it is there after one
        world.advance(1.0)
    assert simulation.pose.x_m == pytest.approx(0.5 - 0.15 - 0.09, abs=0.004)
    assert world.status().result["distance_driven_m"] == pytest.approx(0.26, abs=0.02)
    assert world.events.get_nowait().happening == "wrong thing"
    assert world.events.empty()
    for _ in range(500):
        if not world.status().ended:
            world.advance(1.0)
    assert world.events.get_nowait().happening == "stuck"
    assert world.status().ended


def test_a_task_says_what_it_has_put_into_the_arena() -> None:
    simulation = Simulation(room_picture=ROOMS[0])
    assert LiveWorld(simulation, Board(), *FETCH, SETTING, seed=0).pieces() == ()
    line = find_task("line")
    one, same, other = (
        LiveWorld(simulation, Board(), line, line.lessons[0], SETTING, seed=seed).pieces()
        for seed in (0, 0, 1)
    )
    assert len(one) > 20
    assert one == same != other


def test_a_stall_of_the_machine_leaves_no_trace_in_the_history() -> None:
    world = LiveWorld(
        Simulation(room_picture=ROOMS[0]), Board(), *FETCH, SETTING, seed=0, free_floor=True
    )
    kept: list[float] = []
    add = world.history.add
    world.history.add = lambda time_s, state: (kept.append(time_s), add(time_s, state))[1]
    stop = threading.Event()
    thread = threading.Thread(target=world.run, args=(stop,))
    thread.start()
    enough = until(lambda: len(kept) >= 150)
    stop.set()
    thread.join()
    assert enough
    assert np.diff(kept) == pytest.approx(SLICE_S, abs=1e-6)
    assert kept[-1] <= time.monotonic()


def test_the_way_counts_on_a_free_floor_and_being_carried_does_not() -> None:
    simulation = Simulation(room_picture=ROOMS[0])
    world = LiveWorld(simulation, Board(), *FETCH, SETTING, seed=0, free_floor=True)
    for _ in range(400):
        world.advance(1.0)
    driven_m = world.status().result["distance_driven_m"]
    assert driven_m == pytest.approx(simulation.pose.x_m, rel=0.05)
    assert driven_m > 0.3
    world._board = Board()  # pyright: ignore[reportPrivateUsage]
    world._board._state = BoardState(Joystick(0, 0), 2.0, 2)  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
    for _ in range(400):
        world.advance(3.0)
    assert abs(simulation.pose.x_m) < 0.05, "it was carried back"
    assert world.status().result["distance_driven_m"] < driven_m + 0.1

"""The compiled firmware keeps a robot in MuJoCo's world on its table and off its walls."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from mbot_protocol.drive.mcore import ARM_REQUEST, Joystick, senses_request
from mbot_workstation.sim.body.feelers import Feelers
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.emulated.lockstep_board import LockstepBoard
from mbot_workstation.virtual.surroundings import Surroundings

from ..promised import promised
from .simulated_board import Simulator

TABLE_M = (1.2, 0.8)
WALL_M = 0.8
KIT = Feelers()
BEFORE_EACH_WHEEL = Feelers(pairs=tuple((0.06, left_m) for left_m in (0.0575, -0.0575)))
STEP_S = 0.005
AHEAD = Joystick(-255, 255)
EDGE = senses_request((2,), 3, 0.0, edge_stops=True)
ONLY_TOLD = senses_request((2,), 3, 0.0, edge_stops=False)


def on_a_table(feelers: Feelers) -> Surroundings:
    """Without walls to speak of."""
    return Surroundings(10.0, (), TABLE_M, feelers)


def has_fallen(around: Surroundings, _: Pose) -> bool:
    return around.has_fallen


def touches_a_wall(around: Surroundings, pose: Pose) -> bool:
    return max(map(abs, pose.point(*around.feelers.sonar))) >= around.wall_m


def starts(feelers: Feelers, count: int) -> list[Pose]:
    """Anywhere, whole on the table."""
    rng, table, found = np.random.default_rng(0), on_a_table(feelers), list[Pose]()
    half_m = table.track_m / 2
    while len(found) < count:
        x_m, y_m = (rng.uniform(-side / 2, side / 2) for side in TABLE_M)
        pose = Pose(float(x_m), float(y_m), float(rng.uniform(-math.pi, math.pi)))
        parts = ((0.0, half_m), (0.0, -half_m), *feelers.pairs)
        if all(table.has_floor(*pose.point(*one)) for one in parts):
            found.append(pose)
    return found


def ends_in(
    accident: Callable[[Surroundings, Pose], bool],
    simulation: Simulation,
    simulator: Simulator,
    request: bytes,
    start: Pose,
    around: Surroundings,
) -> bool:
    """Whether 4 s of full speed ahead from there do, as a daemon repeats it."""
    simulation.place_robot(start)
    with LockstepBoard(simulator.firmware, simulator.program) as board:
        board.run(0.02)
        around.tell(board, start, ())
        board.say(request)
        board.run(0.15)  # so that it has felt before it drives
        board.say(ARM_REQUEST)
        board.run(0.01)
        for step in range(round(4.0 / STEP_S)):
            if step % 20 == 0:
                board.say(AHEAD.to_bytes())
            around.tell(board, simulation.pose, ())
            board.run(STEP_S)
            simulation.set_duty(*pwm_duties(board.motors.duties))
            simulation.step(STEP_S)
            if accident(around, simulation.pose):
                return True
    return False


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation()


def test_with_pairs_before_each_wheel_none_goes_over_a_tables_edge(
    simulation: Simulation, simulator: Simulator
) -> None:
    for start in starts(BEFORE_EACH_WHEEL, 12):
        table = on_a_table(BEFORE_EACH_WHEEL)
        assert not ends_in(has_fallen, simulation, simulator, EDGE, start, table), start


@pytest.mark.parametrize("yaw_deg", [-15.0, 0.0, 15.0])
def test_the_kits_one_module_holds_a_robot_that_comes_straight(
    simulation: Simulation, simulator: Simulator, yaw_deg: float
) -> None:
    assert abs(yaw_deg) in (0, promised("edge-straight"))
    start = Pose(0.0, 0.0, math.radians(yaw_deg))
    assert not ends_in(has_fallen, simulation, simulator, EDGE, start, on_a_table(KIT))


def test_and_not_one_that_comes_at_a_slant(simulation: Simulation, simulator: Simulator) -> None:
    """docs/safety.md says so: the outer wheel is at the edge before the middle is."""
    start = Pose(0.0, 0.0, math.radians(60.0))
    assert ends_in(has_fallen, simulation, simulator, EDGE, start, on_a_table(KIT))
    straight = Pose(0.0, 0.0)
    assert ends_in(has_fallen, simulation, simulator, ONLY_TOLD, straight, on_a_table(KIT))


@pytest.mark.parametrize("yaw_deg", [25.0, 0.0, -25.0])
def test_a_wall_ahead_is_not_touched(
    simulation: Simulation, simulator: Simulator, yaw_deg: float
) -> None:
    assert abs(yaw_deg) in (0, promised("wall-straight"))
    request = senses_request((2,), 3, promised("wall-distance"), edge_stops=False)
    start, room = Pose(0.0, 0.0, math.radians(yaw_deg)), Surroundings(WALL_M, ())
    assert not ends_in(touches_a_wall, simulation, simulator, request, start, room)
    assert ends_in(touches_a_wall, simulation, simulator, ONLY_TOLD, start, room)

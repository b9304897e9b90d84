"""The compiled firmware keeps a robot in MuJoCo's world on its table and off its walls."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from mbot_protocol.drive.mcore import ARM_REQUEST, Joystick, senses_request
from mbot_workstation.sim.body.feelers import Feelers, Segment
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.emulated.lockstep_board import LockstepBoard

from ..promised import promised
from .simulated_board import Simulator

TABLE_M = (1.2, 0.8)
WHEELS = ((0.0, 0.0575), (0.0, -0.0575))
KIT = Feelers()
BEFORE_EACH_WHEEL = Feelers(
    pairs=((0.06, 0.0575), (0.06, 0.0575), (0.06, -0.0575), (0.06, -0.0575))
)
STEP_S = 0.005
AHEAD = Joystick(-255, 255)
EDGE = senses_request((2,), 3, 0.0, edge_stops=True)

Seen = Callable[[Simulation], bool]


def on_the_table(x_m: float, y_m: float) -> bool:
    return abs(x_m) <= TABLE_M[0] / 2 and abs(y_m) <= TABLE_M[1] / 2


def is_over(simulation: Simulation) -> bool:
    """Whether a wheel has left the table."""
    return not all(on_the_table(*simulation.pose.point(*wheel)) for wheel in WHEELS)


def starts(feelers: Feelers, count: int) -> list[Pose]:
    """Anywhere, whole on the table."""
    rng, found = np.random.default_rng(0), list[Pose]()
    while len(found) < count:
        x_m, y_m = (rng.uniform(-side / 2, side / 2) for side in TABLE_M)
        pose = Pose(float(x_m), float(y_m), float(rng.uniform(-math.pi, math.pi)))
        if all(on_the_table(*pose.point(*one)) for one in (*WHEELS, *feelers.pairs)):
            found.append(pose)
    return found


def drives_until(
    seen: Seen,
    simulation: Simulation,
    simulator: Simulator,
    request: bytes,
    start: Pose,
    feelers: Feelers,
    walls: Sequence[Segment] = (),
    *,
    for_s: float,
) -> bool:
    """Full speed ahead from there, as a daemon repeats it; whether that was seen meanwhile."""
    simulation.place_robot(start)
    floor = on_the_table if not walls else lambda *_: True
    with LockstepBoard(simulator.firmware, simulator.program) as board:
        board.run(0.02)
        board.feel(feelers.has_floor(start, floor), feelers.echo_m(start, walls))
        board.say(request)
        board.run(0.15)  # so that it has felt before it drives
        board.say(ARM_REQUEST)
        board.run(0.01)
        for step in range(round(for_s / STEP_S)):
            if step % 20 == 0:
                board.say(AHEAD.to_bytes())
            pose = simulation.pose
            board.feel(feelers.has_floor(pose, floor), feelers.echo_m(pose, walls))
            board.run(STEP_S)
            simulation.set_duty(*pwm_duties(board.motors.duties))
            simulation.step(STEP_S)
            if seen(simulation):
                return True
    return False


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation()


def test_with_pairs_before_each_wheel_none_goes_over_a_tables_edge(
    simulation: Simulation, simulator: Simulator
) -> None:
    over = [
        start
        for start in starts(BEFORE_EACH_WHEEL, 12)
        if drives_until(is_over, simulation, simulator, EDGE, start, BEFORE_EACH_WHEEL, for_s=4.0)
    ]
    assert not over


def test_the_kits_one_module_holds_a_robot_that_comes_straight(
    simulation: Simulation, simulator: Simulator
) -> None:
    slants_deg = (-15.0, 0.0, 15.0)
    assert max(slants_deg) == promised("edge-straight")
    for yaw_deg in slants_deg:
        start = Pose(0.0, 0.0, math.radians(yaw_deg))
        assert not drives_until(is_over, simulation, simulator, EDGE, start, KIT, for_s=4.0)


def test_and_not_one_that_comes_at_a_slant(simulation: Simulation, simulator: Simulator) -> None:
    """docs/safety.md says so: the outer wheel is at the edge before the middle is."""
    start = Pose(0.0, 0.0, math.radians(60.0))
    assert drives_until(is_over, simulation, simulator, EDGE, start, KIT, for_s=4.0)
    told = senses_request((2,), 3, 0.0, edge_stops=False)
    straight = Pose(0.0, 0.0)
    assert drives_until(is_over, simulation, simulator, told, straight, KIT, for_s=4.0)


@pytest.mark.parametrize("yaw_deg", [25.0, 0.0, -10.0])
def test_a_wall_ahead_is_not_touched(
    simulation: Simulation, simulator: Simulator, yaw_deg: float
) -> None:
    if yaw_deg > 0:
        assert yaw_deg == promised("wall-straight")
    request = senses_request((2,), 3, promised("wall-distance"), edge_stops=False)
    walls: list[Segment] = [((0.8, -2.0), (0.8, 2.0))]
    front_m = KIT.sonar[0]

    def touches(driven: Simulation) -> bool:
        return driven.pose.point(front_m, 0.0)[0] >= 0.8

    start = Pose(0.0, 0.0, math.radians(yaw_deg))
    assert not drives_until(touches, simulation, simulator, request, start, KIT, walls, for_s=4.0)
    told = senses_request((2,), 3, 0.0, edge_stops=False)
    assert drives_until(touches, simulation, simulator, told, start, KIT, walls, for_s=4.0)

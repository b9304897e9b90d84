"""What a virtual robot's sensors have around them."""

import math

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli import virtual_robot as command
from mbot_workstation.sim.body.feelers import Feelers
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.virtual.surroundings import Surroundings


class Felt:
    def __init__(self) -> None:
        self.floor, self.echo_m = (False, False), -1.0

    def feel(self, floor: tuple[bool, bool], echo_m: float) -> None:
        self.floor, self.echo_m = floor, echo_m


def felt(around: Surroundings, robot: Pose, *objects: tuple[int, Pose]) -> Felt:
    board = Felt()
    around.tell(board, robot, objects)
    return board


def test_on_the_floor_there_is_one_and_a_wall_answers() -> None:
    around = Surroundings(3.0, (0.07,))
    board = felt(around, Pose(2.0, 0.0))
    assert board.floor == (True, True)
    assert board.echo_m == pytest.approx(1.0 - Feelers().sonar[0])
    assert not around.has_fallen


def test_a_thing_in_front_answers_first() -> None:
    board = felt(Surroundings(3.0, (0.07,)), ORIGIN, (0, Pose(1.0, 0.0)), (0, Pose(-0.5, 0.0)))
    assert board.echo_m == pytest.approx(1.0 - 0.07 - Feelers().sonar[0], abs=0.01)


def test_a_table_ends_and_a_wheel_over_its_edge_has_fallen() -> None:
    around = Surroundings(3.0, (), table_m=(1.2, 0.8))
    assert felt(around, Pose(0.5, 0.0)).floor == (True, True)
    assert felt(around, Pose(0.55, 0.0)).floor == (False, False)
    assert felt(around, Pose(0.0, 0.33, math.pi)).floor == (True, True)
    assert not around.has_fallen
    felt(around, Pose(0.0, 0.35, 0.0))
    assert around.has_fallen
    felt(around, ORIGIN)
    assert around.has_fallen, "nobody gets up again"


@pytest.mark.parametrize("asked", ["1.2", "1.2x0", "axb", "1x2x3", "nanx1", "1.2x99"])
def test_no_table_is_made_of_that(asked: str) -> None:
    with pytest.raises(ConfigurationError, match="--table"):
        command._table(asked, "deadman")  # pyright: ignore[reportPrivateUsage]


def test_a_table_needs_a_board_that_feels() -> None:
    with pytest.raises(ConfigurationError, match="--firmware"):
        command._table("1.2x0.8", None)  # pyright: ignore[reportPrivateUsage]
    assert command._table("1.2x0.8", "deadman") == (1.2, 0.8)  # pyright: ignore[reportPrivateUsage]
    assert command._table(None, None) is None  # pyright: ignore[reportPrivateUsage]

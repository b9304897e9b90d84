"""`workstation use`: a kept model by its name."""

import pytest

from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Activate, Model
from mbot_protocol.wire.keys import ACTIVATE
from mbot_workstation.cli.models import use
from mbot_workstation.fleet.models.stored_models import StoredModel, newest_named

from .called import output_of
from .fake_robot import FakeRobot


def activations(robot: FakeRobot) -> list[str]:
    data = [data for name, data in robot.received if name == ACTIVATE.name]
    return [Activate.FromString(one).sha256 for one in data]


def test_a_model_that_the_robot_keeps_is_used_by_its_name(robot: FakeRobot) -> None:
    assert "older" in output_of(use, "older", "--robot", robot.address)
    assert activations(robot) == ["b" * 64]
    output_of(use, robot.active.name, "--robot", robot.address)
    assert activations(robot) == ["b" * 64], "that one is active already"
    with pytest.raises(RefusedError, match=r"no model 'odler', only .*did you mean older\?"):
        output_of(use, "odler", "--robot", robot.address)


def test_of_several_of_a_name_the_newest_is_meant() -> None:
    times_ns = {"1": 5, "2": 7, "3": 6}
    kept = [Model(name="a", sha256=x, stored_unix_time_ns=ns) for x, ns in times_ns.items()]
    assert newest_named([StoredModel.of(one) for one in kept], "a").sha256 == "2"

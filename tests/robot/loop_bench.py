"""The control loop among fakes: a camera with one picture, a board that obeys at once."""

import time

import numpy as np

from mbot_agent.arming import Mode, Orders
from mbot_agent.configuration import Configuration
from mbot_agent.control_loop import ControlLoop
from mbot_agent.faults import Fault
from mbot_agent.hardware import Delivery, Frame
from mbot_agent.helm import Helm, Press
from mbot_agent.models.pilot import Pilot
from mbot_agent.tick import Tick
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties, WheelCommand

HAND = Press(sender=7, number=1)
"""Somebody who has taken hold for the first time."""


class ObedientBoard:
    """Obeys at once and remembers.

    Attributes:
        fault: what the test says is wrong with it.
        commands: all that it was given.
        asked: their speeds and the stops, in order.
        resets, edges: as often as the test says.
        senses: what the test says that it feels.
        armed, disarmed: how often it was.
        answers: whether it acknowledges a stop.

    """

    version = "mbot-deadman 1"
    has_deadman = True

    def __init__(self) -> None:
        self.fault: Fault | None = None
        self.commands: list[WheelCommand] = []
        self.asked: list[Duties | str] = []
        self.resets = self.edges = 0
        self.senses: Senses | None = None
        self.armed = self.disarmed = 0
        self.answers = True

    @property
    def stops(self) -> int:
        return self.asked.count("stop")

    def drive(self, command: WheelCommand) -> int:
        self.commands.append(command)
        self.asked.append(command.duties)
        return len(self.commands)

    def delivery(self, ticket: int, timeout_s: float) -> Delivery | None:
        assert ticket == len(self.commands)
        assert timeout_s > 0
        return Delivery(time.monotonic_ns(), time.monotonic_ns())

    def stop(self) -> None:
        self.asked.append("stop")

    def arm(self) -> None:
        self.armed += 1

    def disarm(self) -> None:
        self.disarmed += 1

    def stands(self, timeout_s: float) -> bool:
        assert timeout_s > 0
        return self.answers


class StillCamera:
    """One picture, as fresh as the test says.

    Attributes:
        fault: what the test says is wrong with it.
        fresh: whether it may be driven on.
        age_ns: of the picture, whenever somebody looks.
        has_picture: whether there is one at all.
        driving: what it was told of the wheels.

    """

    def __init__(self) -> None:
        self.fault: Fault | None = None
        self.fresh = True
        self.interval_ns = 33_333_333
        self.age_ns = 10_000_000
        self.has_picture = True
        self.picture: Picture = np.full((240, 320, 3), 90, np.uint8)
        self.driving: list[bool] = []

    def latest(self) -> Frame | None:
        if not self.has_picture:
            return None
        return Frame(self.picture, time.monotonic_ns() - self.age_ns)

    def is_fresh(self) -> bool:
        return self.fresh

    def drives(self, driving: bool) -> None:
        self.driving.append(driving)

    light = "automatic"

    def forgive(self) -> None:
        if self.fault is not None and self.fault.kind == "camera-frozen":
            self.fault = None


class Bench:
    """A control loop among fakes; `tick` is one beat."""

    def __init__(self) -> None:
        self.board = ObedientBoard()
        self.camera = StillCamera()
        self.helm = Helm(self.board, Orders(Mode.IDLE))
        self.pilot = Pilot()
        configuration = Configuration(robot_id="mbot-1")
        self.link_fault: Fault | None = None
        self.loop = ControlLoop(
            configuration, self.camera, self.board, self.helm, self.pilot, lambda: self.link_fault
        )

    def run(self) -> None:
        """As a person does who has just looked."""
        self.helm.run(self.stops)

    def hold(self, duties: Duties, hold_ns: int = 10**9, press: Press = HAND) -> None:
        """As a hand does that has taken hold."""
        self.helm.steer_by_hand(duties, time.monotonic_ns() + hold_ns, self.stops, press)

    @property
    def stops(self) -> int:
        return self.helm.orders.stop.count

    def tick(self) -> Tick:
        return self.loop.tick(time.monotonic_ns())

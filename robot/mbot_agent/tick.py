"""One beat of the control loop as a value: what was seen, decided and done.

Each step of the loop makes a new one that knows more; who listens gets the last.
"""

from dataclasses import dataclass

from mbot_agent.arming import Driver, Mark, Orders, State, state_of
from mbot_agent.faults import Fault
from mbot_agent.hardware import Delivery
from mbot_protocol.drive.actions import Steps
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import STOP, Duties
from mbot_protocol.policy.policy_contract import FieldOfView, Memory


@dataclass(frozen=True, slots=True)
class Action:
    """The policy's answer: left and right wheel, 1 is full speed forward; not yet clipped."""

    left: float
    right: float


@dataclass(frozen=True, slots=True)
class Tick:
    """One beat. Times are monotonic; 0 or None where a stage did not happen.

    Attributes:
        sequence: counts from 0 since the daemon's start.
        due_ns, started_ns: when it should have begun, and when it did.
        missed_ticks: beats skipped so far since the start.
        orders: what was wanted when it began.
        faults: what is in the way.
        model_sha256: the model in use; empty: none.
        captured_ns: when the frame was taken.
        observation: what the policy sees, shape (64, 64, 3), uint8, RGB.
        observed_ns: when that was ready.
        memory: what the policy went on with, if it was asked; None: it started over.
        action: what the policy answered, if it was asked to drive.
        decided_ns: when it had.
        steps: the same in motor steps.
        duties: what the policy told the wheels; STOP if nothing.
        delivery: the board's acknowledgement.
        by_hand: what the wheels are told while a person drives; STOP otherwise.
        view: the field of view that the observation shows.
        senses: what the board feels; None: it tells nothing of it.
        driver: who drives by hand; None: nobody.
        would_have_done: what the policy answered while a person drove; nothing moves by it.
        mark: what somebody has said since the last beat of what came before.

    """

    sequence: int
    due_ns: int
    started_ns: int
    missed_ticks: int
    orders: Orders
    faults: tuple[Fault, ...] = ()
    model_sha256: str = ""
    captured_ns: int = 0
    observation: Picture | None = None
    observed_ns: int = 0
    memory: Memory | None = None
    action: Action | None = None
    decided_ns: int = 0
    steps: Steps | None = None
    duties: Duties = STOP
    delivery: Delivery | None = None
    by_hand: Duties = STOP
    view: FieldOfView | None = None
    senses: Senses | None = None
    driver: Driver | None = None
    would_have_done: Action | None = None
    mark: Mark | None = None

    @property
    def at_wheels(self) -> Duties:
        """What the wheels are told, by the policy or by a person's hand."""
        return self.duties if self.by_hand.is_stop else self.by_hand

    @property
    def stop_count(self) -> int:
        """How many stops there had been when it began."""
        return self.orders.stop.count

    @property
    def hand_let_go(self) -> bool:
        """Whether it stands because a hand's drive has ended."""
        return self.orders.let_go_ns != 0

    @property
    def state(self) -> State:
        """What the robot does."""
        return state_of(self.orders.mode, self.faults)

"""One beat of the control loop, as a robot tells of it: live, on its card, and read again."""

from dataclasses import dataclass
from math import isfinite

import msgspec
from google.protobuf.message import DecodeError
from msgspec import UNSET, UnsetType

from mbot_protocol.drive.actions import LEVELS, STEP_LIMIT, WheelMaps
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FieldOfView
from mbot_protocol.v1.messages_pb2 import Decision, LastStop, State

MOST_BYTES = 65_536
"""Of a decision: three hundred times one without faults."""

MOST_TOLD = 64
"""Faults and notices: the daemon knows some 20, and tells of each once. An empty one has 2 bytes,
and thirty times as many as an object.
"""

BeatKey = tuple[int, int]
"""The daemon's life, and the beat's number in it."""


class PolicyInput(msgspec.Struct, frozen=True):
    """What a policy goes on with besides its picture; the robot's own recordings have it only.

    The names are those of a recording's JSON.

    Attributes:
        armed: whether the wheels may turn without anybody saying more.
        began_anew: the policy was asked with its memory zeroed.
        told_left, told_right: what the policy was told that the wheels did before, [-1, 1].
        memory: its hidden state, float32, little endian, shape as the model's.
        view_horizontal_deg, view_vertical_deg: the field of view that its picture shows.

    """

    armed: bool
    began_anew: bool
    told_left: float
    told_right: float
    memory: bytes
    view_horizontal_deg: float | UnsetType = UNSET
    view_vertical_deg: float | UnsetType = UNSET


@dataclass(frozen=True, slots=True)
class Beat:
    """One beat of the loop, whether or not the policy drove.

    Attributes:
        decision: what telemetry says of it.
        policy_input: what a replay needs besides; None where nobody but the robot knows.
        last_stop: who or what stopped the robot last; None where nobody but the robot knows.
        encoded: what the policy saw, as PNG or JPEG; empty: nothing, or not encoded yet.
        is_exact: whether that is lossless.

    """

    decision: Decision
    policy_input: PolicyInput | None = None
    last_stop: LastStop | None = None
    encoded: bytes = b""
    is_exact: bool = False

    @property
    def key(self) -> BeatKey:
        """Which beat it is of all that the robot ever had."""
        return self.decision.session_id, self.decision.sequence

    @property
    def is_replayable(self) -> bool:
        """Whether the policy can be asked again: the robot's own recording, and what it saw."""
        return self.is_exact and self.policy_input is not None

    @property
    def told(self) -> tuple[float, float] | None:
        """What the policy was told that the wheels did before; None where it is not known."""
        known = self.policy_input
        return (known.told_left, known.told_right) if known is not None else None

    @property
    def view(self) -> FieldOfView | None:
        """What the policy's picture shows; None where the recording does not say.

        Raises:
            ConfigurationError: what it says is not a field of view.

        """
        known = self.policy_input
        if known is None or known.view_horizontal_deg is UNSET:
            return None
        try:
            return FieldOfView(known.view_horizontal_deg, known.view_vertical_deg or 0.0)
        except ValueError as error:
            raise ConfigurationError(
                f"beat {self.decision.sequence} of the recording: {error}"
            ) from None

    @property
    def decided(self) -> bool:
        """Whether the policy has answered."""
        return self.decision.HasField("action")

    @property
    def by_hand(self) -> bool:
        """Whether a person drove."""
        return self.decision.state == State.STATE_MANUAL

    def at_wheels(self, wheels: WheelMaps | None = None) -> tuple[float, float]:
        """What the wheels were told, left and right in [-1, 1], by a policy or a person.

        Args:
            wheels: how this robot's steps became duties. Without that a person's command is told
                as the duties: beyond the dead band, so somewhat larger.

        """
        decision = self.decision
        known = decision.duty.left, decision.duty.right
        if not decision.HasField("duty") and wheels is not None:  # by a release of before
            duties = wheels.of_levels(decision.board_m1, decision.board_m2)
            known = duties.left, duties.right
        is_steps = decision.HasField("steps") and not self.by_hand
        if is_steps and (any(known) or not decision.HasField("duty")):
            return decision.steps.left / STEP_LIMIT, decision.steps.right / STEP_LIMIT
        return known if wheels is None else wheels.steps(Duties(*known)).action


def read_decision(data: bytes) -> Decision:
    """A decision's bytes, as they stand in recordings of whatever origin.

    Raises:
        DecodeError: it is none, or none that a robot could have sent.

    """
    if len(data) > MOST_BYTES:
        raise DecodeError(f"{len(data)} bytes, expected at most {MOST_BYTES}")
    decision = Decision.FromString(data)
    if (told := len(decision.faults) + len(decision.notices)) > MOST_TOLD:
        raise DecodeError(f"{told} faults and notices, expected at most {MOST_TOLD}")
    if max(abs(decision.steps.left), abs(decision.steps.right)) > STEP_LIMIT:
        raise DecodeError(f"a step beyond {STEP_LIMIT}")
    if max(abs(decision.board_m1), abs(decision.board_m2)) > LEVELS:
        raise DecodeError(f"a motor beyond {LEVELS}")
    if not all(-1 <= duty <= 1 for duty in (decision.duty.left, decision.duty.right)):
        raise DecodeError("a duty beyond 1, or none")  # NaN too
    if not all(map(isfinite, (decision.would_have_done.left, decision.would_have_done.right))):
        raise DecodeError("an answer that is no number")
    return decision

"""What a robot says of itself when it is asked, in people's words."""

from dataclasses import dataclass
from typing import Self

from mbot_protocol.beat.fields import state_word
from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.wording import fault_lines, one_line, standing_words, stop_words


@dataclass(frozen=True, slots=True)
class RobotState:
    """How a robot is at one moment.

    Attributes:
        robot: its name.
        state: "idle" (never told to drive), "running" (its policy drives), "manual" (somebody
            drives by hand), "stopped", or "fault" (told to drive, but something is in the way).
        may_run: nothing is in the way of `run()`.
        faults: what is, each a line that says what to do.
        notices: what is worth knowing and in nobody's way, likewise.
        last_stop: who or what stopped it last and when, or that the hand has let go.
        model: what the active policy is called; empty without one.
        model_sha256: the digest of its file; empty without one.
        decisions_per_s: how often it decides, 2.5 unless its model wants otherwise.
        board: what the motor board's firmware calls itself; empty while it isn't connected.
        camera: where its pictures come from.
        release: of the robot's software.
        distance_m: of the nearest echo ahead; 4.0 is none. None where its board tells nothing.
        floor: whether either of its infrared pairs sees a floor, likewise.

    """

    robot: str
    state: str
    may_run: bool
    faults: tuple[str, ...]
    notices: tuple[str, ...]
    last_stop: str
    model: str
    model_sha256: str
    decisions_per_s: float
    board: str
    camera: str
    release: str
    distance_m: float | None = None
    floor: tuple[bool, bool] | None = None

    @classmethod
    def of(cls, status: Status) -> Self:
        """From the robot's own message."""
        felt = status.senses if status.HasField("senses") else None
        return cls(
            robot=status.robot_id,
            state=state_word(status.state),
            may_run=not status.faults,
            faults=tuple(fault_lines(status.faults)),
            notices=tuple(fault_lines(status.notices)),
            last_stop=standing_words(status),
            model=one_line(status.active_model.name),
            model_sha256=status.active_model.sha256,
            decisions_per_s=round(status.decision_rate_hz, 3),
            board=one_line(status.board_version),
            camera=one_line(status.camera),
            release=one_line(status.release or status.software_version),
            distance_m=round(felt.distance_m, 3) if felt is not None else None,
            floor=(felt.floor_1, felt.floor_2) if felt is not None else None,
        )


def look_again(control: RemoteControl, seen: Status) -> None:
    """Ask the robot for its last stop, before anything that sets it in motion (docs/arming.md).

    Args:
        control: what will command it.
        seen: how the program has last seen it.

    Raises:
        RefusedError: it was stopped or started again since, which the program doesn't know.
        UnreachableError: it doesn't answer.

    """
    now = control.synchronise()
    if (now.session_id, now.last_stop.count) == (seen.session_id, seen.last_stop.count):
        return
    again = now.session_id != seen.session_id
    raise RefusedError(
        f"robot {now.robot_id}: {'started again, ' if again else ''}{stop_words(now)}",
        kind="stopped-meanwhile",
        remedy="look with robot.state(), then do it again",
    )

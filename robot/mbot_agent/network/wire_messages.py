"""The daemon's own values as the messages of the contract: the one place where they meet."""

import time
from collections.abc import Iterable
from dataclasses import asdict

import numpy as np
from msgspec import UNSET

from mbot_agent.arming import State, Stop
from mbot_agent.faults import Fault, Notice
from mbot_agent.network.health import read_health
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat, PolicyInput
from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire.schema import SCHEMA_VERSION

WIRE_STATES = {
    State.IDLE: messages.STATE_IDLE,
    State.RUNNING: messages.STATE_RUNNING,
    State.STOPPED: messages.STATE_STOPPED,
    State.MANUAL: messages.STATE_MANUAL,
    State.FAULT: messages.STATE_FAULT,
}


def wire_faults(faults: Iterable[Fault]) -> list[messages.Fault]:
    """What is wrong."""
    return [messages.Fault(kind=fault.kind, detail=fault.detail) for fault in faults]


def wire_notices(notices: Iterable[Notice]) -> list[messages.Notice]:
    """What is worth knowing."""
    return [messages.Notice(kind=notice.kind, detail=notice.detail) for notice in notices]


def wire_motor(motor: MotorMap) -> messages.MotorMap:
    """One wheel's mapping."""
    return messages.MotorMap(
        reversed=bool(motor.reversed), trim=motor.trim, dead_band=motor.dead_band
    )


def wire_stop(stop: Stop) -> messages.LastStop:
    """The last stop."""
    return messages.LastStop(count=stop.count, by=stop.by, why=stop.why, monotonic_ns=stop.at_ns)


def wire_senses(senses: Senses) -> messages.Senses:
    """What the board feels."""
    floor_1, floor_2 = senses.floor
    return messages.Senses(
        distance_m=senses.distance_m,
        floor_1=floor_1,
        floor_2=floor_2,
        edge=senses.at_edge,
        obstacle=senses.at_obstacle,
        supply_v=senses.supply_v,
    )


def beat_of(
    tick: Tick, robot_id: str, session_id: int, notices: Iterable[Notice], wheels: WheelMaps
) -> Beat:
    """One tick, whether or not the policy drove; what it saw is not encoded yet."""
    duties = tick.at_wheels
    board_m1, board_m2 = wheels.levels(duties)
    decision = messages.Decision(
        schema_version=SCHEMA_VERSION,
        robot_id=robot_id,
        session_id=session_id,
        sequence=tick.sequence,
        state=WIRE_STATES[tick.state],
        faults=wire_faults(tick.faults),
        notices=wire_notices(notices),
        due_monotonic_ns=tick.due_ns,
        started_monotonic_ns=tick.started_ns,
        captured_monotonic_ns=tick.captured_ns,
        observed_monotonic_ns=tick.observed_ns,
        decided_monotonic_ns=tick.decided_ns,
        board_m1=board_m1,
        board_m2=board_m2,
        duty=messages.Wheels(left=duties.left, right=duties.right),
        missed_ticks=tick.missed_ticks,
        model_sha256=tick.model_sha256,
        stop_count=tick.stop_count,
        hand_let_go=tick.hand_let_go,
    )
    if tick.action is not None:
        decision.action.left, decision.action.right = tick.action.left, tick.action.right
    if tick.steps is not None:
        decision.steps.left, decision.steps.right = tick.steps.left, tick.steps.right
    if tick.delivery is not None:
        decision.written_monotonic_ns = tick.delivery.written_ns
        decision.acknowledged_monotonic_ns = tick.delivery.acknowledged_ns
    if tick.senses is not None:
        decision.senses.CopyFrom(wire_senses(tick.senses))
    if tick.driver is not None:
        decision.driven_by = tick.driver.name
        decision.held_ms = max(0, tick.started_ns - tick.driver.since_ns) // 1_000_000
    if (unheard := tick.would_have_done) is not None:
        decision.would_have_done.left, decision.would_have_done.right = unheard.left, unheard.right
    if tick.mark is not None:
        decision.wrong_ms, decision.wrong_says = tick.mark.back_ms, tick.mark.by
    # A field of Health is a field of Decision; None where this machine does not tell.
    for name, value in asdict(read_health()).items():
        if value is not None:
            setattr(decision, name, value)
    # The wall clock may jump, so the monotonic one says how long ago it was.
    decision.unix_time_ns = time.time_ns() - (time.monotonic_ns() - tick.started_ns)
    return Beat(decision, _policy_input(tick), wire_stop(tick.orders.stop))


def _policy_input(tick: Tick) -> PolicyInput:
    memory, view = tick.memory, tick.view
    told = memory.previous_action if memory is not None else (0.0, 0.0)
    return PolicyInput(
        armed=tick.orders.is_armed,
        began_anew=(tick.action or tick.would_have_done) is not None and memory is None,
        told_left=told[0],
        told_right=told[1],
        memory=memory.state.astype(np.dtype("<f4")).tobytes() if memory is not None else b"",
        view_horizontal_deg=view.horizontal_deg if view is not None else UNSET,
        view_vertical_deg=view.vertical_deg if view is not None else UNSET,
    )

"""A recording of a robot: the policy drove, a person took over, somebody marked it as wrong."""

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.beat.beat import Beat, PolicyInput
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.drive.actions import AS_BUILT, Steps
from mbot_protocol.v1.messages_pb2 import Decision, State
from mbot_protocol.v1.messages_pb2 import Steps as WireSteps

from .samples import SECOND_NS, START_UNIX_NS

BY_POLICY, BY_HAND = 4, 6
FACTS = RobotFacts("mbot-1", 42, "1", "x86", 2.5, AS_BUILT)
MODEL = "93277d5c321b" + "0" * 52


def hand_driven(folder: Path, seed: int = 1, rounds: int = 1) -> Path:
    """Four beats by the policy, six by anna's hand, one standing; written as a robot writes it."""
    folder.mkdir(parents=True)
    noise = np.random.default_rng(seed)
    with closing(BeatWriter(folder / "000.mcap", "mbot-1", "test", FACTS)) as writer:
        for number in range(rounds * (BY_POLICY + BY_HAND + 1)):
            picture = cv2.resize(
                noise.integers(0, 255, (8, 8, 3), np.uint8), (64, 64), interpolation=cv2.INTER_CUBIC
            )
            png = cv2.imencode(".png", picture)[1].tobytes()
            told = PolicyInput(True, False, 0.0, 0.0, b"", 55.3, 42.9)
            writer.write(Beat(_decision(number, seed), told, encoded=png, is_exact=True))
    return folder


def _decision(number: int, seed: int) -> Decision:
    began_ns = number * SECOND_NS * 2 // 5
    decision = Decision(
        schema_version=1,
        robot_id="mbot-1",
        session_id=42,
        sequence=number + 100 * seed,
        unix_time_ns=START_UNIX_NS + seed * 100 * SECOND_NS + began_ns,
        started_monotonic_ns=SECOND_NS + began_ns,
        model_sha256=MODEL,
        state=State.STATE_STOPPED,
        stop_count=1,
    )
    decision.duty.left = 0.0
    at = number % (BY_POLICY + BY_HAND + 1)
    if at < BY_POLICY:
        decision.state = State.STATE_RUNNING
        decision.action.left, decision.action.right = 0.5, 0.5
        decision.steps.CopyFrom(WireSteps(left=125, right=125))
        duties = AS_BUILT.duties(Steps(125, 125))
        decision.duty.left, decision.duty.right = duties.left, duties.right
    elif at < BY_POLICY + BY_HAND:
        decision.state = State.STATE_MANUAL
        decision.driven_by, decision.held_ms = "anna@desk", 400 * (at - BY_POLICY)
        duties = AS_BUILT.duties(Steps(100, -50))
        decision.duty.left, decision.duty.right = duties.left, duties.right
        decision.would_have_done.left, decision.would_have_done.right = 0.1 * at, 0.5
    else:
        decision.wrong_ms, decision.wrong_says = 3000, "max"
    return decision

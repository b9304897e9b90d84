"""`mbot-agent decide`: recorded pictures through the pilot that drives the robot.

For `workstation replay`, which starts it and talks to it by pipes. Nothing here can move anything.
"""

from typing import IO

import numpy as np

from mbot_agent.faults import Fault
from mbot_agent.models.pilot import Pilot
from mbot_agent.models.policy import Policy
from mbot_agent.tick import Memory
from mbot_protocol.drive.actions import to_steps
from mbot_protocol.errors import MbotError
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_protocol.policy.replay_step import ReplayAnswer, ReplayGreeting, ReplayStep, receive, send

_SHAPE = (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)
_NO_DEADLINE_NS = 1 << 62


def decide_again(policy: Policy, processor: str, asked: IO[bytes], answers: IO[bytes]) -> None:
    """Answer steps until there are no more.

    Args:
        policy: which model.
        processor: what computes here, as recordings name it.
        asked: where steps come from.
        answers: where answers go.

    Raises:
        MbotError: what came is not a step.

    """
    pilot = Pilot()
    pilot.use(policy)
    pilot.change_over()
    wants = policy.metadata
    view_deg = wants.view.horizontal_deg, wants.view.vertical_deg
    send(answers, ReplayGreeting(policy.sha256, wants.name, processor, view_deg))
    try:
        while (step := receive(asked, ReplayStep)) is not None:
            send(answers, _answer(pilot, policy, step))
    except ValueError as error:
        raise MbotError(f"what came is not a step of a replay: {error}") from None


def _answer(pilot: Pilot, policy: Policy, step: ReplayStep) -> ReplayAnswer:
    if step.began_anew:
        pilot.forget()
    elif step.memory:
        state = np.frombuffer(step.memory, np.dtype("<f4"))
        if state.size != policy.blank.state.size:
            pilot.forget()
        else:
            pilot.resume(Memory(state.reshape(policy.blank.state.shape), step.told))
    else:
        pilot.drove(*step.told)
    memory = pilot.memory.state.tobytes() if pilot.memory is not None else b""
    picture = np.frombuffer(step.observation, np.uint8).reshape(_SHAPE)
    found = pilot.decide(picture, _NO_DEADLINE_NS)
    if isinstance(found, Fault):
        return ReplayAnswer(memory=memory, failure=found.detail)
    steps = to_steps(found.left, found.right)
    return ReplayAnswer((found.left, found.right), (steps.left, steps.right), memory)

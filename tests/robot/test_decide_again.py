import io
from pathlib import Path

import numpy as np
import pytest

from mbot_agent.models.decide_again import decide_again
from mbot_agent.models.policy import Policy
from mbot_protocol.errors import MbotError
from mbot_protocol.policy.replay_step import ReplayAnswer, ReplayGreeting, ReplayStep, receive, send

from .tiny_models import constant_model, counting_model

PICTURE = np.full((64, 64, 3), 90, np.uint8).tobytes()


def answers(data: bytes, *steps: ReplayStep) -> tuple[ReplayGreeting, list[ReplayAnswer]]:
    asked, answered = io.BytesIO(), io.BytesIO()
    for step in steps:
        send(asked, step)
    asked.seek(0)
    decide_again(Policy(data), "a processor", asked, answered)
    answered.seek(0)
    greeting = receive(answered, ReplayGreeting)
    assert greeting is not None
    return greeting, [answer for _ in steps if (answer := receive(answered, ReplayAnswer))]


def test_it_greets_and_goes_on_with_its_own_memory_and_what_the_wheels_were_told() -> None:
    greeting, found = answers(
        counting_model(),
        ReplayStep(PICTURE, True, (0.0, 0.0)),
        ReplayStep(PICTURE, False, (0.5, -0.5)),
        ReplayStep(PICTURE, False, (0.25, 1.0)),
    )
    assert (greeting.name, greeting.processor) == ("counting", "a processor")
    assert greeting.view_deg == (55.3, 42.9)
    # Left: an eighth of the decisions remembered; right: what the left wheel was told.
    assert [answer.action for answer in found] == [(0.0, 0.0), (0.125, 0.5), (0.25, 0.25)]
    assert [answer.steps for answer in found] == [(0, 0), (31, 125), (62, 62)]
    assert [answer.memory for answer in found] == [
        b"",
        np.float32(1).tobytes(),
        np.float32(2).tobytes(),
    ]


def test_it_begins_anew_or_goes_on_from_what_was_recorded() -> None:
    _, found = answers(
        counting_model(),
        ReplayStep(PICTURE, False, (0.5, 0.0), np.float32(4).tobytes()),
        ReplayStep(PICTURE, True, (0.0, 0.0)),
        ReplayStep(PICTURE, False, (0.5, 0.0), b"of another model"),
    )
    assert [answer.action for answer in found] == [(0.5, 0.5), (0.0, 0.0), (0.0, 0.0)]


def test_a_model_that_fails_says_so_and_goes_on() -> None:
    steps = [ReplayStep(PICTURE, True, (0.0, 0.0))] * 4
    _, found = answers(constant_model(float("nan"), 0.0), *steps)
    assert len(found) == 4
    assert all("expected two finite numbers" in answer.failure for answer in found)


def test_what_is_no_step_is_one_line() -> None:
    with pytest.raises(MbotError, match="not a step of a replay"):
        decide_again(Policy(constant_model()), "", io.BytesIO(b"\x03\0\0\0abc"), io.BytesIO())


def test_a_message_that_was_cut_off_is_told(tmp_path: Path) -> None:
    whole = io.BytesIO()
    send(whole, ReplayAnswer((0.5, 0.25), (125, 62)))
    data = whole.getvalue()
    assert receive(io.BytesIO(data), ReplayAnswer) == ReplayAnswer((0.5, 0.25), (125, 62))
    assert receive(io.BytesIO(), ReplayAnswer) is None
    for size in range(1, len(data)):
        with pytest.raises(ValueError, match="cut off"):
            receive(io.BytesIO(data[:size]), ReplayAnswer)

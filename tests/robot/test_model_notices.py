"""What a person is told of the robot's models, though it drives."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from mbot_agent.models.activation import MOST_STARTS_PROVEN, Activation, Rollback
from mbot_agent.models.model_notices import model_notices

OLD, NEW = "a" * 64, "b" * 64


@dataclass
class Keys:
    """As much of `Trust` as the notices ask."""

    keys: tuple[str, ...] = ("anna",)
    accepts_unsigned: bool = False


@dataclass
class Case:
    kind: str
    words: str
    activation: Callable[[], Activation] = lambda: Activation(active=NEW)
    trust: Keys = field(default_factory=Keys)
    has_model: bool = True
    unusable: str = ""


def crashed() -> Activation:
    """Again and again, just now: crashes of long ago don't count."""
    starts = (time.time(),) * MOST_STARTS_PROVEN
    return Activation(active=NEW, proven=(NEW,), proven_starts=starts)


CASES = [
    Case("unsigned-models", "from anyone", trust=Keys(accepts_unsigned=True)),
    Case("no-trusted-key", "`workstation keys new`", trust=Keys(keys=())),
    Case(
        "model-rolled-back",
        "turner bbbbbbbbbbbb was rolled back to model aaaaaaaaaaaa: it crashed",
        lambda: Activation(active=OLD, rollback=Rollback(NEW, OLD, "it crashed")),
    ),
    Case("model-left-out", "turner bbbbbbbbbbbb is the only one, and", crashed, has_model=False),
    Case(
        "model-unusable",
        "turner bbbbbbbbbbbb cannot be used: no such file",
        has_model=False,
        unusable="no such file",
    ),
]


def notices(case: Case) -> list[tuple[str, str]]:
    names = {NEW: "turner"}
    found = model_notices(
        case.activation(),
        lambda sha256: names.get(sha256, ""),
        case.trust,  # pyright: ignore[reportArgumentType]
        has_model=case.has_model,
        unusable=case.unusable,
    )
    return [(notice.kind, notice.detail) for notice in found]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.kind)
def test_each_is_said_with_the_model_it_is_about(case: Case) -> None:
    ((kind, words),) = notices(case)
    assert kind == case.kind
    assert case.words in words


def test_a_robot_in_order_says_nothing() -> None:
    assert notices(Case("", "")) == []


def test_a_robot_without_any_model_is_a_fault_and_no_notice() -> None:
    assert notices(Case("", "", Activation, has_model=False)) == []

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.models.activation import MOST_STARTS, MOST_STARTS_PROVEN, Activation, Rollback

A, B, C = "a" * 64, "b" * 64, "c" * 64

NOW_S = 1_800_000_000.0


def test_a_person_goes_forth_and_back() -> None:
    first = Activation().activated(A, "")
    second = first.activated(B, A)
    assert (second.active, second.previous) == (B, A)
    assert second.activated(B, B) == second
    back = second.activated(A, B)
    assert (back.active, back.previous) == (A, B)


def test_what_is_really_in_use_becomes_the_previous_one() -> None:
    """The active one may be damaged, and the daemon got by with another."""
    damaged = Activation(active=A, previous=B)
    assert damaged.activated(C, B).previous == B
    assert damaged.activated(C, "").previous == B
    assert damaged.activated(B, "").previous == "", "nobody goes back to what runs"


def test_the_previous_model_is_gone_back_to_if_it_has_proven_itself() -> None:
    both = Activation(active=C, previous=A, proven=(A, B))
    assert both.successors(C) == (A, B)
    unproven = Activation(active=C, previous=A, proven=(B,))
    assert unproven.successors(C) == (B, A)
    assert Activation(active=C, previous=C).successors(C) == ()


def test_a_rejected_model_is_never_gone_back_to_until_a_person_wants_it() -> None:
    broken = Activation(active=B, previous=A, proven=(A, B)).rolled_back(B, A, "nonsense")
    assert (broken.active, broken.previous, broken.proven) == (A, "", (A,))
    assert B not in broken.successors(A)
    assert broken.rollback == Rollback(B, A, "nonsense")
    wanted = broken.activated(B, A)
    assert (wanted.rejected, wanted.rollback) == ((), None)
    assert wanted.successors(B) == (A,)
    third = Activation(active=C, previous=A, proven=(B,)).rolled_back(C, B, "nonsense")
    assert (third.active, third.previous) == (B, A), "a person may still go there"


def test_starts_are_counted_until_something_speaks_for_the_model() -> None:
    activation = Activation().activated(A, "")
    for _ in range(MOST_STARTS):
        assert not activation.crashes(A, NOW_S)
        activation = activation.started(A, NOW_S)
    assert activation.crashes(A, NOW_S)
    assert not activation.crashes(B, NOW_S)
    for better in (activation.survived(), activation.proved(A), activation.activated(A, "")):
        assert not better.crashes(A, NOW_S)


digests = st.sampled_from([A, B, C])
steps = st.one_of(
    st.builds(lambda d: lambda a: a.activated(d, a.active), digests),
    st.builds(lambda d: lambda a: a.started(d, NOW_S), digests),
    st.builds(lambda d: lambda a: a.proved(d), digests),
    st.just(lambda a: a.survived()),
    st.builds(lambda d: lambda a: a.rolled_back(a.active, d, "x") if d != a.active else a, digests),
)


@given(st.lists(steps, max_size=30))
def test_whatever_happens_nobody_is_proven_and_rejected_at_once(changes) -> None:
    activation = Activation().activated(A, "")
    for change in changes:
        activation = change(activation)
        assert activation.active
        assert activation.active != activation.previous
        successors = activation.successors(activation.active)
        assert not {activation.active, *activation.rejected} & set(successors)
        assert len(set(activation.proven)) == len(activation.proven)


def crashing(activation: Activation, times: int, apart_s: float) -> tuple[Activation, float]:
    """That many starts that ended badly; what is noted, and when the next one is."""
    now_s = NOW_S
    for _ in range(times):
        activation = activation.started(A, now_s)
        now_s += apart_s
    return activation, now_s


@pytest.mark.parametrize(
    ("times", "apart_s", "goes"), [(4, 10, False), (5, 10, True), (5, 119, True), (9, 151, False)]
)
def test_a_proven_model_goes_after_five_crashes_within_ten_minutes(
    times: int, apart_s: float, goes: bool
) -> None:
    activation = Activation().activated(A, "").proved(A)
    crashed, now_s = crashing(activation, times, apart_s)
    assert bool(crashed.crashes(A, now_s)) == goes
    for better in (crashed.survived(), crashed.activated(A, A), crashed.proved(A)):
        assert not better.crashes(A, now_s)


def crashed() -> Activation:
    """Again and again, just now: crashes of long ago don't count."""
    starts = (NOW_S,) * MOST_STARTS_PROVEN
    return Activation(active=B, proven=(B,), proven_starts=starts)


@pytest.mark.parametrize(
    ("kind", "words", "activation", "has_model", "unusable"),
    [
        (
            "model-rolled-back",
            "turner bbbbbbbbbbbb was rolled back to model aaaaaaaaaaaa: it crashed",
            Activation(active=A, rollback=Rollback(B, A, "it crashed")),
            True,
            "",
        ),
        ("model-left-out", "turner bbbbbbbbbbbb is the only one, and", crashed(), False, ""),
        (
            "model-unusable",
            "turner bbbbbbbbbbbb cannot be used: no such file",
            Activation(active=B),
            False,
            "no such file",
        ),
        ("", "", Activation(active=B), True, ""),
        ("", "", crashed(), True, ""),
        ("", "", Activation(), False, ""),
    ],
)
def test_what_a_person_should_know_is_said_with_the_model_it_is_about(
    kind: str, words: str, activation: Activation, has_model: bool, unusable: str
) -> None:
    found = activation.notice(
        lambda sha256: "turner" if sha256 == B else "",
        NOW_S,
        has_model=has_model,
        unusable=unusable,
    )
    assert (found.kind if found else "") == kind
    assert words in (found.detail if found else "")

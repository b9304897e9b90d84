import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.network.sender_numbers import MOST_SENDERS, SenderNumbers
from mbot_protocol.errors import RefusedError

ANNA, MAX = 17, 23


def test_what_comes_twice_or_out_of_order_is_refused() -> None:
    numbers = SenderNumbers()
    numbers.take(ANNA, 1)
    numbers.take(ANNA, 5)
    numbers.take(MAX, 1)
    for number in (5, 4, 1, 0):
        with pytest.raises(RefusedError, match="repeated or overtaken"):
            numbers.take(ANNA, number)
    numbers.take(ANNA, 6)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 20))))
def test_each_sender_is_obeyed_in_growing_order_only(commands: list[tuple[int, int]]) -> None:
    numbers = SenderNumbers()
    taken: dict[int, list[int]] = {}
    for sender, number in commands:
        try:
            numbers.take(sender, number)
        except RefusedError:
            continue
        taken.setdefault(sender, []).append(number)
    assert all(seen == sorted(set(seen)) and 0 not in seen for seen in taken.values())


def test_many_senders_cost_no_memory_and_the_latest_are_remembered() -> None:
    numbers = SenderNumbers()
    for sender in range(1, 10 * MOST_SENDERS):
        numbers.take(sender, 1)
    numbers.take(1, 1)  # forgotten
    for sender in range(9 * MOST_SENDERS + 1, 10 * MOST_SENDERS):
        with pytest.raises(RefusedError):
            numbers.take(sender, 1)

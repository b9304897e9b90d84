import time

import pytest

from mbot_agent.models.nonces import LIFETIME_S, MOST_OUTSTANDING, Nonces


def test_a_nonce_is_good_once() -> None:
    nonces = Nonces()
    nonce = nonces.issue()
    assert nonces.use(nonce)
    assert not nonces.use(nonce)
    assert not nonces.use("00" * 16)


def test_a_nonce_is_good_for_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    nonces = Nonces()
    early, late = nonces.issue(), nonces.issue()
    issued_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: issued_s + LIFETIME_S - 1)
    assert nonces.use(early)
    monkeypatch.setattr(time, "monotonic", lambda: issued_s + LIFETIME_S + 1)
    assert not nonces.use(late)


def test_asking_again_and_again_costs_no_memory() -> None:
    nonces = Nonces()
    first = nonces.issue()
    issued = [nonces.issue() for _ in range(10_000)]
    assert len(set(issued)) == len(issued)
    assert not nonces.use(first)
    assert [nonces.use(nonce) for nonce in issued].count(True) == MOST_OUTSTANDING


def test_another_start_of_the_daemon_knows_none_of_them() -> None:
    assert not Nonces().use(Nonces().issue())

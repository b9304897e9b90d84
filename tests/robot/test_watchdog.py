import time

import pytest

from mbot_agent.process import watchdog
from mbot_agent.process.watchdog import LONGEST_PAUSE_NS, Watchdog


def test_it_is_fed_only_while_every_part_makes_progress(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    told: list[str] = []
    monkeypatch.setattr(watchdog, "notify", told.append)
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    seen = {"motors": now_ns, "serve stop": now_ns}
    dog = Watchdog({name: lambda name=name: seen[name] for name in seen})
    assert dog.feed("running")
    assert told == ["WATCHDOG=1\nSTATUS=running"]
    now_ns += LONGEST_PAUSE_NS
    assert dog.feed("running")
    now_ns += 1
    seen["motors"] = now_ns
    for _ in range(2):
        assert not dog.feed("running")
    assert told[2:] == ["STATUS=running"] * 2
    seen["serve stop"] = now_ns
    for _ in range(2):
        assert dog.feed("stopped")
    assert told[4:] == ["WATCHDOG=1\nSTATUS=stopped"] * 2
    assert [record.getMessage() for record in caplog.records] == [
        "no progress: serve stop; the watchdog is not fed",
        "all parts make progress again",
    ]

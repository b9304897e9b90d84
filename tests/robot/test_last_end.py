from pathlib import Path

import pytest

from mbot_agent.arming import Mode
from mbot_agent.daemon import _orders_at_start  # pyright: ignore[reportPrivateUsage]
from mbot_agent.process import last_end
from mbot_agent.process.last_end import LastEnd


def test_the_first_start_and_one_after_an_orderly_end_are_clean(tmp_path: Path) -> None:
    for _ in range(2):
        with LastEnd(tmp_path) as last:
            assert not last.was_crash
    assert list(tmp_path.iterdir()) == []


def test_a_daemon_that_was_killed_or_fell_over_leaves_its_mark(tmp_path: Path) -> None:
    LastEnd(tmp_path).__enter__()  # and then SIGKILL
    last = LastEnd(tmp_path).__enter__()
    assert last.was_crash
    last.__exit__(RuntimeError, RuntimeError("fell over"), None)
    assert LastEnd(tmp_path).was_crash


def test_a_robot_that_was_switched_off_has_not_crashed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    LastEnd(tmp_path).__enter__()
    boot_id = tmp_path / "boot_id"
    boot_id.write_text("another boot\n")
    monkeypatch.setattr(last_end, "BOOT_ID", boot_id)
    assert not LastEnd(tmp_path).was_crash


def test_a_disk_that_refuses_keeps_nobody_from_starting_and_is_told_of(tmp_path: Path) -> None:
    with LastEnd(tmp_path / "missing") as last:
        assert not last.was_crash
        assert last.unmarked == "No such file or directory"


def test_without_a_mark_nothing_drives_by_itself(tmp_path: Path) -> None:
    """Else a daemon that crashes on a full disk would drive again and again."""
    with LastEnd(tmp_path) as marked, LastEnd(tmp_path / "missing") as unmarked:
        assert _orders_at_start("running", marked).mode is Mode.WAITING
        orders = _orders_at_start("running", unmarked)
    assert orders.mode is Mode.STOPPED
    assert "No such file or directory" in orders.stop.why
    with LastEnd(tmp_path / "missing") as unmarked:
        assert _orders_at_start("idle", unmarked).mode is Mode.IDLE

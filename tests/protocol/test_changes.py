from mbot_protocol.beat.changes import changes
from mbot_protocol.v1.messages_pb2 import Decision, LastStop, State

from ..workstation.samples import decision


def after(before: Decision, **new: object) -> Decision:
    now = Decision()
    now.CopyFrom(before)
    for name, value in new.items():
        setattr(now, name, value)
    return now


def test_the_first_beat_says_what_there_is() -> None:
    assert changes(None, decision()) == [("INFO", f"model {'a' * 12}"), ("INFO", "now running")]
    assert changes(None, Decision(state=State.STATE_IDLE))[0] == ("INFO", "model none")


def test_only_what_changes_is_said() -> None:
    before = decision()
    assert changes(before, decision(1)) == []
    stands = after(before, state=State.STATE_STOPPED, hand_let_go=True)
    assert changes(before, stands) == [("INFO", "now stopped (the hand let go)")]
    assert changes(before, after(before, missed_ticks=5)) == [("WARN", "2 beats missed")]


def test_a_fault_is_said_once_however_its_words_change() -> None:
    before = decision()
    faulty = after(before, state=State.STATE_FAULT)
    faulty.faults.add(kind="camera-lost", detail="no frame since 1 s")
    assert changes(before, faulty) == [
        ("WARN", "now fault"),
        ("ERROR", "camera-lost: no frame since 1 s"),
    ]
    later = after(faulty)
    later.faults[0].detail = "no frame since 2 s"
    assert changes(faulty, later) == []


def test_a_stop_is_told_as_far_as_it_is_known() -> None:
    before = decision()
    now = after(before, stop_count=1)
    assert changes(before, now) == [("WARN", "stopped")]
    assert changes(before, now, LastStop(by="anna")) == [("WARN", "stopped by anna")]
    assert changes(before, now, LastStop(why="stuck")) == [("WARN", "stopped: stuck")]


def test_another_life_of_the_daemon_starts_over() -> None:
    again = decision(0, session_id=2)
    again.missed_ticks = 0
    assert changes(decision(7), again) == changes(None, again)

"""The dead man's switch, with a clock that the test turns."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.by_hand import hand_drive
from mbot_workstation.fleet.by_hand.hand import FRESH_S, HELD_UP_S, Hand, HandRepeat
from mbot_workstation.fleet.by_hand.hand_drive import HOLD_MS, HandDrive
from mbot_workstation.look.console.page_messages import (
    LetGo,
    RunRequest,
    read_message,
)

from ..until import until

ANNA, MAX = 1, 2


RIGHT = 0.25


def said(press: int = 1, sent_s: float = 0.0, left: float = 0.5, seen_stops: int = 3) -> HandRepeat:
    return HandRepeat(press=press, left=left, right=RIGHT, seen_stops=seen_stops, sent_s=sent_s)


def test_a_hand_holds_while_repeats_come_and_no_longer() -> None:
    hand = Hand()
    for beat in range(10):
        assert not hand.repeat(ANNA, said(sent_s=beat / 10), 100 + beat / 10)
    assert hand.held(100.9 + FRESH_S) is not None
    assert hand.held(100.9 + FRESH_S + 0.001) is None
    assert "take hold again" in hand.repeat(ANNA, said(sent_s=1.2), 101.2)
    assert hand.held(101.2) is None
    assert not hand.repeat(ANNA, said(press=2, sent_s=1.3), 101.3)
    assert hand.held(101.3) is not None


def test_letting_go_is_final_for_that_press_also_when_overtaken() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(), 0)
    hand.let_go(ANNA, 1)
    assert hand.held(0) is None
    assert hand.repeat(ANNA, said(sent_s=0.1), 0.1)
    hand.let_go(ANNA, 2)  # before its first repeat
    assert hand.repeat(ANNA, said(press=2, sent_s=0.2), 0.2)
    assert not hand.repeat(ANNA, said(press=3, sent_s=0.3), 0.3)
    hand.let_go(ANNA, 2)  # late: of the one before
    assert hand.held(0.3) is not None
    hand.let_go(MAX, 9)  # somebody else: of nothing
    hand.let_go(MAX)
    assert hand.held(0.3) is not None


def test_a_late_word_of_an_old_press_does_not_take_over_a_new_one() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(), 0)
    assert not hand.repeat(ANNA, said(press=2, sent_s=0.1, left=-0.5), 0.1)
    assert hand.repeat(ANNA, said(sent_s=0.05), 0.11)
    held = hand.held(0.11)
    assert held is not None
    assert (held.press, held.left) == (2, -0.5)


def test_a_page_that_is_gone_leaves_nothing_to_the_next_of_its_number() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(), 0)
    hand.forget(ANNA)
    assert hand.held(0) is None
    assert not hand.repeat(ANNA, said(sent_s=-10.0), 0.1), "by a slower way, with its first press"


def test_stop_with_nobody_there_is_nothing() -> None:
    hand = Hand()
    hand.let_all_go()
    assert hand.held(0) is None
    assert not hand.repeat(ANNA, said(), 0)


def test_a_heap_of_old_repeats_after_a_tunnel_that_hung_counts_for_nothing() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(sent_s=0.0), 50.0)
    for beat in range(1, 20):
        refused = hand.repeat(ANNA, said(press=2, sent_s=beat / 10), 50 + 2.2 + HELD_UP_S)
        assert "held up" in refused
    assert hand.held(52.5) is None


def test_one_hand_at_a_time() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(), 0)
    assert "somebody else" in hand.repeat(MAX, said(left=-1), 0.05)
    held = hand.held(0.05)
    assert held is not None
    assert held.left == 0.5
    hand.forget(ANNA)
    assert hand.repeat(MAX, said(left=-1, sent_s=0.1), 0.1), "he held when it was not his turn"
    assert not hand.repeat(MAX, said(press=2, left=-1, sent_s=0.2), 0.2)


def test_the_stops_that_count_are_those_seen_on_taking_hold() -> None:
    hand = Hand()
    hand.repeat(ANNA, said(seen_stops=3), 0)
    hand.repeat(ANNA, said(seen_stops=4, sent_s=0.1), 0.1)
    held = hand.held(0.1)
    assert held is not None
    assert held.seen_stops == 3
    hand.repeat(ANNA, said(press=2, seen_stops=4, sent_s=0.2), 0.2)
    held = hand.held(0.2)
    assert held is not None
    assert held.seen_stops == 4


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["repeat", "let go", "look"]),
            st.sampled_from([ANNA, MAX]),
            st.integers(1, 3),
            st.floats(0, 0.5),
        )
    )
)
def test_whatever_happens_who_holds_said_so_a_moment_ago(steps: list[tuple]) -> None:
    hand, now_s, newest_s = Hand(), 0.0, {}
    let_go: set[tuple[int, int]] = set()
    for kind, owner, press, wait_s in steps:
        now_s += wait_s
        if kind == "repeat" and not hand.repeat(owner, said(press=press, sent_s=now_s), now_s):
            newest_s[owner, press] = now_s
        elif kind == "let go":
            hand.let_go(owner, press)
            let_go.add((owner, press))
        if (held := hand.held(now_s)) is not None:
            assert (held.owner, held.press) not in let_go
            assert now_s - newest_s[held.owner, held.press] <= FRESH_S


class Control:
    """Keeps what it was told; refuses and takes its time as told.

    Attributes:
        attempts: commands, also those that were refused.

    """

    def __init__(self, clock: "Clock") -> None:
        self.clock = clock
        self.told: list[tuple[object, ...]] = []
        self.stops = 3
        self.dead = False
        self.catch_up_takes_s = self.let_go_takes_s = 0.0
        self.attempts = 0

    def catch_up(self, seen_stops: int) -> Status:
        self.clock.now_s += self.catch_up_takes_s
        self._check(seen_stops)
        self.seen = seen_stops
        return Status()

    def drive(self, left: float, right: float, hold_ms: int, press: int) -> str:
        self._check(self.seen)
        self.told.append((left, right, hold_ms, press))
        return "manual"

    def let_go(self, press: int) -> None:
        time.sleep(self.let_go_takes_s)
        self._check(self.seen)
        self.told.append(("let go", press))

    def _check(self, seen_stops: int) -> None:
        self.attempts += 1
        if self.dead:
            raise UnreachableError("nobody there")
        if seen_stops != self.stops:
            raise RefusedError("stopped by max 0.4 s ago; look, then do it again")


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Bench:
    def __init__(self) -> None:
        self.clock = Clock()
        self.control = Control(self.clock)
        self.words: list[tuple[int, str]] = []
        self.drive = HandDrive(self.control, lambda *said: self.words.append(said), self.clock)

    def repeat(self, press: int = 1, left: float = 0.5) -> str:
        refused = self.drive.repeat(ANNA, said(press=press, sent_s=self.clock.now_s, left=left))
        self.drive.step()
        self.clock.now_s += 0.1
        return refused


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_whose_hand_it_is_that_drives(bench: Bench) -> None:
    assert not bench.drive.holds(ANNA)
    bench.repeat()
    assert (bench.drive.holds(ANNA), bench.drive.holds(MAX)) == (True, False)
    bench.drive.let_go(ANNA, 1)
    bench.drive.step()
    assert not bench.drive.holds(ANNA)


def test_each_repeat_is_one_command_and_none_is_made_up(bench: Bench) -> None:
    for _ in range(3):
        bench.repeat()
    bench.drive.step()
    assert bench.control.told == [(0.5, RIGHT, HOLD_MS, 1)] * 3


def test_without_repeats_the_robot_is_let_go_once(bench: Bench) -> None:
    bench.repeat()
    bench.clock.now_s += FRESH_S
    bench.drive.step()
    bench.drive.step()
    assert bench.control.told == [(0.5, RIGHT, HOLD_MS, 1), ("let go", 1)]
    assert bench.repeat(), "the same press does not begin again"
    assert len(bench.control.told) == 2


@pytest.mark.parametrize("end", ["let go", "forget", "stop"])
def test_however_it_ends_the_robot_is_let_go(bench: Bench, end: str) -> None:
    bench.repeat(press=7)
    {
        "let go": lambda: bench.drive.let_go(ANNA, 7),
        "forget": lambda: bench.drive.forget(ANNA),
        "stop": bench.drive.let_all_go,
    }[end]()
    bench.drive.step()
    assert bench.control.told[-1][0] == "let go"


def test_a_stop_by_anybody_ends_it_until_a_new_press_that_has_seen_it(bench: Bench) -> None:
    bench.repeat()
    bench.control.stops = 4
    bench.repeat()
    assert bench.words == [(ANNA, "stopped by max 0.4 s ago; look, then do it again")]
    bench.repeat()
    assert len(bench.control.told) == 1
    bench.repeat(press=2)  # has not seen it
    assert len(bench.words) == 2
    bench.drive.repeat(ANNA, said(press=3, seen_stops=4, sent_s=bench.clock.now_s))
    bench.drive.step()
    assert len(bench.control.told) == 2


def test_a_hand_that_lets_go_while_the_robot_is_asked_never_moves_it(bench: Bench) -> None:
    bench.control.catch_up_takes_s = FRESH_S + 0.01
    bench.repeat()
    assert bench.control.told == []


def test_a_robot_out_of_reach_ends_it_in_words(bench: Bench) -> None:
    bench.repeat()
    bench.control.dead = True
    bench.repeat()
    assert bench.words == [(ANNA, "nobody there")]
    told = bench.control.attempts
    bench.drive.step()
    assert bench.control.attempts == told, "what has ended there is not ended once more"


def test_the_end_of_the_console_lets_go(bench: Bench) -> None:
    bench.control.let_go_takes_s = 0.1
    with bench.drive:
        bench.drive.repeat(ANNA, said(sent_s=bench.clock.now_s))
        assert until(lambda: bool(bench.control.told))
        began_s = time.monotonic()
    assert bench.control.told[-1][0] == "let go"
    assert time.monotonic() - began_s < 1.0


def test_a_console_that_nobody_drove_from_ends_at_once(bench: Bench) -> None:
    with bench.drive:
        time.sleep(0.05)
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 0.5
    assert bench.control.attempts == 0


def test_the_thread_lets_go_by_itself_when_the_hand_falls_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It looks five times within what counts as silence, however long that be."""
    monkeypatch.setattr(hand_drive, "FRESH_S", 2.0)
    control = Control(Clock())
    with HandDrive(control, lambda *_: None) as drive:
        drive.repeat(ANNA, said(sent_s=time.monotonic()))
        assert until(lambda: ("let go", 1) in control.told, 5.0)


def test_the_thread_hands_on_at_once_that_a_hand_has_let_go(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hand_drive, "FRESH_S", 100.0)  # it does not look by itself
    with bench.drive as drive:
        drive.repeat(ANNA, said(sent_s=bench.clock.now_s))
        assert until(lambda: bool(bench.control.told))
        drive.let_go(ANNA, 1)
        assert until(lambda: ("let go", 1) in bench.control.told, 1.0)


def test_the_thread_does_not_spin(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[float] = []
    whole = bench.drive.step

    def step() -> None:
        steps.append(time.monotonic())
        whole()

    monkeypatch.setattr(bench.drive, "step", step)
    with bench.drive as drive:
        drive.repeat(ANNA, said(sent_s=bench.clock.now_s))
        assert until(lambda: bool(bench.control.told))
        time.sleep(0.3)
        assert len(steps) < 20


def test_what_the_page_says_is_read_as_what_it_is() -> None:
    text = '{"do":"hand","press":1,"left":1,"right":-1,"seen_stops":2,"sent_s":0.5}'
    assert read_message(text) == HandRepeat(press=1, left=1, right=-1, seen_stops=2, sent_s=0.5)
    assert read_message('{"do":"let-go","press":4}') == LetGo(press=4)
    assert read_message('{"do":"run","seen_stops":7}') == RunRequest(seen_stops=7)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"do":"fly"}',
        '{"do":"run"}',
        '{"do":"run","seen_stops":"7"}',
        '{"do":"hand","press":1,"left":1.1,"right":0,"seen_stops":2,"sent_s":0}',
        '{"do":"hand","press":1,"left":0,"right":-1.1,"seen_stops":2,"sent_s":0}',
        '{"do":"hand","press":1,"left":NaN,"right":0,"seen_stops":2,"sent_s":0}',
        '{"do":"hand","press":1,"left":1e999,"right":0,"seen_stops":2,"sent_s":0}',
        '{"do":"let-go","press":' + "9" * 5000 + "}",
    ],
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        read_message(text)


@given(st.text())
def test_no_text_does_more_than_be_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        read_message(text)

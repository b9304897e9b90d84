import io

import pytest
from rich.console import Console

from mbot_protocol.beat.fields import decision_fields
from mbot_protocol.v1.messages_pb2 import Decision, Fault, Notice, State
from mbot_workstation.fleet.telemetry.stream import LinkState, Sample
from mbot_workstation.fleet.telemetry.view import bar, plain_line, render
from mbot_workstation.fleet.telemetry.window import WINDOW, TelemetryWindow
from mbot_workstation.pictures.half_blocks import half_blocks
from mbot_workstation.pictures.picture_file import decode_picture

from .samples import decision, picture


def window_of(count: int) -> TelemetryWindow:
    window = TelemetryWindow()
    for sequence in range(count):
        window.add(Sample(picture(), 0.4 * sequence))
        window.add(Sample(decision(sequence), 0.4 * sequence))
    return window


def drawn(window: TelemetryWindow, link: LinkState = LinkState.LIVE, silence_s: float = 0) -> str:
    console = Console(width=120, file=io.StringIO(), record=True, force_terminal=True)
    console.print(render("mbot-1", window, link, silence_s))
    return console.export_text()


def test_a_robot_that_is_stuck_is_shown_as_stopped_and_why() -> None:
    window, stuck = TelemetryWindow(), decision(0)
    stuck.state = State.STATE_STOPPED
    stuck.faults.add(kind="stuck", detail="the picture stands still")
    window.add(Sample(stuck, 0.0))
    shown = drawn(window)
    assert "stopped" in shown
    assert "the picture stands still" in shown
    assert "the picture stands still" in plain_line("mbot-1", window, LinkState.LIVE, 0)


def test_the_window_knows_rate_and_latencies_of_the_last_hundred() -> None:
    window = window_of(WINDOW + 30)
    assert window.decisions_per_s == pytest.approx(10), "by the robot's clock"
    summaries = {summary.name: summary for summary in window.summaries()}
    assert summaries["decide"].count == WINDOW
    assert summaries["decide"].p50_ms == summaries["decide"].p99_ms == 10.0


def test_gaps_are_counted_and_a_new_session_starts_over() -> None:
    window = window_of(3)
    window.add(Sample(decision(6), 3.0))
    assert window.lost == 3
    window.add(Sample(decision(0, session_id=2), 9.0))
    assert (window.lost, window.restarts, window.decisions_per_s) == (0, 1, None)


def test_the_view_shows_everything_a_person_asks_for() -> None:
    text = drawn(window_of(20))
    for expected in (
        "mbot-1", "running", "+0.500", "step +125", "motor -147", "20, 10.00/s, missed 3",
        "lost 0, dropped by the robot 2", "aaaaaaaaaaaa", "52 °C", "load 0.75", "200 MiB",
        "p99 ms", "frame to motors", "60.0", "▀",
    ):  # fmt: skip
        assert expected in text, expected


def test_the_view_says_what_is_wrong_without_obeying_it() -> None:
    window = window_of(1)
    bad = decision(1)
    bad.state = State.STATE_FAULT
    bad.faults.append(Fault(kind="camera-stalled", detail="no frame [bold]since\x1b[2J 1 s"))
    window.add(Sample(bad, 1.0))
    text = drawn(window, LinkState.GONE, 12.4)
    assert "camera-stalled: no frame [bold]since [2J 1 s" in text
    assert "no telemetry since 12 s, the daemon is gone" in text


def test_the_view_draws_before_anything_arrives_and_without_policy() -> None:
    assert "waiting" in drawn(TelemetryWindow())
    window = TelemetryWindow()
    unknown = Decision.FromString(b"\x08\x01\x28\x4d")  # schema 1, state 77
    window.add(Sample(unknown, 0.0))
    text = drawn(window)
    assert "state-77" in text
    assert "no picture yet" in text


def test_a_picture_that_is_none_is_told() -> None:
    window = window_of(1)
    broken = picture()
    broken.data = b"none"
    window.add(Sample(broken, 0.0))
    assert "no readable picture (png)" in drawn(window)
    assert decode_picture(b"") is None


def test_half_blocks_have_two_pixels_each() -> None:
    pixels = decode_picture(picture().data)
    assert pixels is not None
    assert tuple(pixels[0, 0]) == (255, 0, 0)
    text = half_blocks(pixels, 8)
    assert text.plain == "\n".join(["▀" * 8] * 4)
    first, last = text.spans[0].style, text.spans[-1].style
    assert "#ff0000" in str(first)
    assert "#0000ff" in str(last)


def test_bars_grow_from_the_middle() -> None:
    assert bar(0) == " " * 10 + "│" + " " * 10
    assert bar(1) == " " * 10 + "│" + "█" * 10
    assert bar(-0.5) == " " * 5 + "█" * 5 + "│" + " " * 10
    assert bar(9) == bar(1)


def test_the_plain_line_is_one_line() -> None:
    line = plain_line("mbot-1", window_of(3), LinkState.SILENT, 4.0)
    assert line == (
        "mbot-1: running, decision 2, 10.00/s, steps +125 -62, missed 3, model aaaaaaaaaaaa, "
        "frame to motors p50 60.0 ms, no telemetry since 4 s, the daemon is there"
    )
    assert "waiting" in plain_line("mbot-1", TelemetryWindow(), LinkState.LIVE, 0.0)


def test_a_notice_is_shown_beside_the_faults_and_made_safe() -> None:
    window = window_of(3)
    noted = decision(3)
    noted.notices.append(Notice(kind="model-rolled-back", detail="new [bold]was\x1b[2J bad"))
    window.add(Sample(noted, 2.0))
    for text in (drawn(window), plain_line("mbot-1", window, LinkState.LIVE, 0)):
        assert "model-rolled-back: new [bold]was [2J bad" in text
    assert decision_fields(noted)["notices"] == [
        {"kind": "model-rolled-back", "detail": "new [bold]was\x1b[2J bad"}
    ]


def test_a_hand_that_let_go_is_no_stop_by_anybody() -> None:
    window = window_of(3)
    stands = decision(3)
    stands.state, stands.hand_let_go = State.STATE_STOPPED, True
    window.add(Sample(stands, 2.0))
    for text in (drawn(window), plain_line("mbot-1", window, LinkState.LIVE, 0)):
        assert "stopped (the hand let go)" in text
    stands.hand_let_go = False
    assert "hand" not in plain_line("mbot-1", window, LinkState.LIVE, 0)

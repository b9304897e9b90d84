"""Torn, garbled and invented frames on the compiled firmware, in simulated time."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.drive.mcore import RESET_REQUEST, STOP, VERSION_REQUEST, stop_burst

from .frames import ACKNOWLEDGED, ARMED, DRIVE, DRIVING, OFF, Event, joystick, motor, rx
from .simulated_board import Simulator

FRAMES = [DRIVE, joystick(200, -30), joystick(-1, -1), joystick(0, 255), motor(9, -200)]


@pytest.mark.parametrize("frame", FRAMES, ids=bytes.hex)
@pytest.mark.parametrize("stop", [STOP.to_bytes(), stop_burst()], ids=["plain", "burst"])
def test_a_stop_after_a_torn_frame_stops_at_once(
    simulator: Simulator, frame: bytes, stop: bytes
) -> None:
    """With stock firmware it is swallowed or sets full speed, (255, 7) or (-120, 255)."""
    driven = joystick(60, 70)
    for cut in range(1, len(frame)):
        trace = simulator.run(ARMED, rx(20, driven), rx(40, frame[:cut] + stop), end_ms=60)
        assert trace.speeds_since() == {OFF, (60, 70)}, f"cut after {cut}"
        assert trace.speeds_at(60) == OFF, f"cut after {cut}"


@pytest.mark.parametrize("frame", FRAMES, ids=bytes.hex)
def test_a_torn_frame_and_another_do_not_mix(simulator: Simulator, frame: bytes) -> None:
    for cut in range(1, len(frame)):
        for pause_ms in (0, 1, 10, 25):
            at_ms = 20 + cut * 0.1 + pause_ms
            trace = simulator.run(
                ARMED, rx(20, frame[:cut]), rx(at_ms, joystick(60, 70)), end_ms=60
            )
            assert trace.speeds_since() == {OFF, (60, 70)}, f"cut after {cut}, {pause_ms} ms"
            assert trace.replies(20) == ACKNOWLEDGED


@pytest.mark.parametrize("frame", FRAMES, ids=bytes.hex)
def test_a_pause_of_20_ms_inside_a_frame_voids_it(simulator: Simulator, frame: bytes) -> None:
    for cut in range(1, len(frame)):
        trace = simulator.run(ARMED, rx(20, frame[:cut]), rx(43, frame[cut:]), end_ms=80)
        assert trace.speeds_since() == {OFF}, f"cut after {cut}"
        assert trace.replies(20) == b""


@pytest.mark.parametrize("frame", FRAMES, ids=bytes.hex)
def test_a_shorter_pause_does_not(simulator: Simulator, frame: bytes) -> None:
    for cut in range(1, len(frame)):
        trace = simulator.run(ARMED, rx(20, frame[:cut]), rx(37, frame[cut:]), end_ms=80)
        assert trace.replies(20) == ACKNOWLEDGED, f"cut after {cut}"


@pytest.mark.parametrize("at", range(10))
def test_a_framing_error_voids_the_frame_it_is_in(simulator: Simulator, at: int) -> None:
    events: list[Event] = [ARMED]
    for i, byte in enumerate(DRIVE):
        verb = "broken" if i == at else "rx"
        events.append((20 + i * 0.1, verb, bytes((byte,))))
    trace = simulator.run(*events, rx(60, DRIVE), end_ms=80)
    assert trace.speeds_at(59) == OFF
    assert trace.speeds_at(80) == DRIVING


@pytest.mark.parametrize("head", [b"\x00\x55", b"\xfe\x55", b"\xff\x54", b"\x00\x00"])
def test_a_frame_with_another_beginning_is_none(simulator: Simulator, head: bytes) -> None:
    trace = simulator.run(ARMED, rx(20, head + DRIVE[2:]), end_ms=60)
    assert trace.speeds_since() == {OFF}
    assert trace.replies(20) == b""


@pytest.mark.parametrize("at", range(1, 10))
def test_so_does_one_between_two_of_its_bytes(simulator: Simulator, at: int) -> None:
    """Though all bytes of the frame have come."""
    events: list[Event] = [ARMED, rx(20, DRIVE[:at]), (21.5, "broken", b"\0")]
    trace = simulator.run(*events, rx(22, DRIVE[at:]), rx(60, DRIVE), end_ms=80)
    assert trace.speeds_at(59) == OFF
    assert trace.speeds_at(80) == DRIVING


def test_a_drive_command_with_something_behind_it_is_not_obeyed(simulator: Simulator) -> None:
    for follower in (b"\x00", b"\x55", b"\xfe", b"\x0d\x0a"):
        trace = simulator.run(ARMED, rx(20, DRIVE + follower), end_ms=60)
        assert trace.speeds_since() == {OFF}


def test_frames_without_a_pause_are_all_obeyed(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(20, DRIVE * 50), end_ms=120)
    assert trace.replies(20) == ACKNOWLEDGED * 50
    assert trace.speeds_since() == {OFF, DRIVING}


PIECES = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([DRIVE, STOP.to_bytes(), RESET_REQUEST, VERSION_REQUEST, motor(10, 255)]),
    st.sampled_from([b"\xff", b"\xff\x55", b"\xff\x55\x07\x00\x02\x05", b"\xff" * 8]),
    st.builds(lambda frame, cut: frame[:cut], st.sampled_from(FRAMES), st.integers(1, 9)),
)
GARBAGE = st.lists(PIECES, min_size=1, max_size=7).map(b"".join)  # 84 bytes, 7.9 ms at most
CASES = st.lists(GARBAGE, min_size=40, max_size=40)


@settings(max_examples=15)
@given(cases=CASES)
def test_garbage_and_then_a_stop_burst_ends_stopped(
    simulator: Simulator, cases: list[bytes]
) -> None:
    """600 cases, in few runs of the simulator."""
    events = [ARMED]
    for i, garbage in enumerate(cases):
        events += [rx(20 + 40 * i, garbage), rx(30 + 40 * i, stop_burst())]
    trace = simulator.run(*events, end_ms=20 + 40 * len(cases))
    for i, garbage in enumerate(cases):
        burst_ms, end_ms = 30 + 40 * i, 60 + 40 * i
        assert trace.speeds_at(burst_ms + 8) == trace.speeds_at(end_ms - 0.1) == OFF, garbage.hex()
        assert ACKNOWLEDGED in trace.replies(burst_ms, end_ms), garbage.hex()


@settings(max_examples=15)
@given(cases=CASES)
def test_after_garbage_and_a_pause_one_plain_stop_is_enough(
    simulator: Simulator, cases: list[bytes]
) -> None:
    events = [ARMED]
    for i, garbage in enumerate(cases):
        events += [rx(20 + 60 * i, garbage), rx(50 + 60 * i, STOP.to_bytes())]
    trace = simulator.run(*events, end_ms=20 + 60 * len(cases))
    for i, garbage in enumerate(cases):
        stop_ms, end_ms = 50 + 60 * i, 80 + 60 * i
        assert trace.replies(stop_ms, end_ms) == ACKNOWLEDGED, garbage.hex()
        assert trace.speeds_at(stop_ms + 3) == trace.speeds_at(end_ms - 0.1) == OFF, garbage.hex()


def test_nothing_of_a_frame_that_was_obeyed_is_part_of_the_next(simulator: Simulator) -> None:
    """A frame whose first byte is lost stays one, and the one before lends it none."""
    beheaded = joystick(50, -50)[1:]
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, beheaded), end_ms=80)
    assert trace.speeds_since(25) == {DRIVING}

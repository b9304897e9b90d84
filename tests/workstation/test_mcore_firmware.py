import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_protocol.drive.mcore import (
    RESET_REQUEST,
    STOP,
    VERSION_REQUEST,
    Acknowledgement,
    Joystick,
    ReplyParser,
    VersionReply,
    stop_burst,
)
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.virtual.mcore_firmware import McoreFirmware

DRIVE = Joystick(-120, -120)
speed = st.integers(-255, 255)
frame = st.one_of(
    st.builds(lambda a, b: Joystick(a, b).to_bytes(), speed, speed),
    st.just(VERSION_REQUEST),
    st.just(RESET_REQUEST),
)


def motor_frame(port: int, value: int) -> bytes:
    return bytes.fromhex("ff550600020a") + bytes([port]) + value.to_bytes(2, "little", signed=True)


@given(st.lists(frame, max_size=12), st.data())
def test_how_the_bytes_are_cut_does_not_matter(frames: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(frames)
    whole, cut = McoreFirmware(), McoreFirmware()
    expected = whole.feed(stream)
    found, rest = b"", stream
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        found += cut.feed(rest[:size])
        rest = rest[size:]
    assert found == expected
    assert cut.motors == whole.motors
    replies = list(ReplyParser().feed(found))
    assert len(replies) == len(frames)


@given(speed, speed)
def test_obeys_and_acknowledges_a_joystick_frame(m1: int, m2: int) -> None:
    board = McoreFirmware()
    assert board.feed(Joystick(m1, m2).to_bytes()) == b"\xff\x55\r\n"
    assert board.motors == Joystick(m1, m2)
    assert board.commands == 1


@given(st.binary(max_size=200))
def test_garbage_never_breaks_it_and_a_stop_burst_stops_it(garbage: bytes) -> None:
    board = McoreFirmware()
    board.feed(garbage)
    board.feed(stop_burst())
    assert board.motors == STOP


def test_speeds_clip_to_255() -> None:
    board = McoreFirmware()
    board.feed(bytes.fromhex("ff55070002052c01d4fe"))  # 300, -300
    assert board.motors == Joystick(255, -255)


def test_motor_frames_set_one_motor() -> None:
    board = McoreFirmware()
    board.feed(motor_frame(9, -80))
    board.feed(motor_frame(10, 90))
    assert board.motors == Joystick(-80, 90)
    board.feed(motor_frame(11, 200))
    assert board.motors == Joystick(-80, 90)


def test_says_its_version_and_stops_on_reset() -> None:
    board = McoreFirmware()
    assert list(ReplyParser().feed(board.feed(VERSION_REQUEST))) == [VersionReply("06.01.107")]
    board.feed(DRIVE.to_bytes())
    assert list(ReplyParser().feed(board.feed(RESET_REQUEST))) == [Acknowledgement()]
    assert board.motors == STOP


@pytest.mark.parametrize(
    ("torn_after", "first_stop", "second_stop"),
    [
        (2, DRIVE, DRIVE),
        (3, DRIVE, STOP),
        (4, DRIVE, STOP),
        (5, DRIVE, STOP),
        (6, Joystick(255, 7), STOP),
        (7, Joystick(-120, 255), STOP),
        (8, Joystick(-120, 255), STOP),
    ],
)
def test_torn_frames_do_what_was_measured(
    torn_after: int, first_stop: Joystick, second_stop: Joystick
) -> None:
    board = McoreFirmware()
    board.feed(DRIVE.to_bytes())
    board.feed(DRIVE.to_bytes()[:torn_after])
    board.feed(STOP.to_bytes())
    assert board.motors == first_stop
    board.feed(STOP.to_bytes())
    assert board.motors == second_stop


def test_a_bare_header_swallows_about_five_frames() -> None:
    board = McoreFirmware()
    board.feed(DRIVE.to_bytes() + b"\xff\x55")
    swallowed = 0
    while board.motors != STOP:
        board.feed(STOP.to_bytes())
        swallowed += 1
    assert 4 <= swallowed - 1 <= 6


def test_duty_counts_forward_positive_on_both_wheels() -> None:
    assert pwm_duties(STOP.duties) == (0, 0)
    assert pwm_duties(Joystick(-255, 255).duties) == (1, 1)
    assert pwm_duties(Joystick(255, 127).duties) == (-1, 0.5)
    assert pwm_duties(WheelMaps().duties(to_steps(1, -1))) == (1, -1)

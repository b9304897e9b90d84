"""The compiled firmware in an AVR simulator, in simulated time: the machine's load is no matter."""

from pathlib import Path

import pytest

from mbot_protocol.drive.actions import MotorMap, Steps, WheelMaps
from mbot_protocol.drive.mcore import (
    ARM_REQUEST,
    RESET_CAUSE_REQUEST,
    RESET_REQUEST,
    STOP,
    VERSION_REQUEST,
    Joystick,
    ReplyParser,
    Value,
    deadman_timeout_ms,
    has_deadman,
    reset_cause,
    stop_burst,
    wants_arming,
)
from mbot_workstation.fleet.firmware.flashing import read_image

from .frames import (
    ACKNOWLEDGED,
    ARMED,
    BANNER,
    DRIVE,
    DRIVING,
    NAME,
    OFF,
    UP_MS,
    VERSION_REPLY,
    Event,
    joystick,
    motor,
    rx,
    sent_us,
)
from .simulated_board import BYTE_US, Simulator

TIMEOUT_MS = 300
WATCHDOG_MS = 256
STOCK_LATENCY_US = 2300  # measured: first bit to pins takes the stock firmware 0.9 to 2.3 ms


def test_it_names_itself_after_a_reset_and_when_asked(simulator: Simulator) -> None:
    trace = simulator.run(rx(UP_MS, VERSION_REQUEST), end_ms=20)
    assert trace.replies() == BANNER + VERSION_REPLY
    assert has_deadman(NAME.decode())


def test_make_firmware_makes_an_image_that_can_be_flashed(firmware_folder: Path) -> None:
    image = read_image(firmware_folder / "mbot-deadman.hex")
    assert image.deadman_version == NAME.decode()
    assert len(image.content) < 3072


def test_motors_are_off_from_the_first_instructions_on(simulator: Simulator) -> None:
    trace = simulator.run(end_ms=500)
    assert trace.speeds_since() == {OFF}
    first = next(pins for pins in trace.pins if pins.ddrd)
    assert first.at_us <= 20
    assert first.portd == 0


def test_nothing_drives_before_it_is_armed(simulator: Simulator) -> None:
    trace = simulator.run(
        rx(20, DRIVE),
        rx(40, STOP.to_bytes()),
        rx(50, stop_burst()),
        rx(60, DRIVE),
        rx(80, ARM_REQUEST),
        rx(100, DRIVE),
        end_ms=120,
    )
    assert trace.speeds_at(99) == OFF
    assert trace.replies(UP_MS, 40) == trace.replies(58, 80) == b""
    assert trace.replies(80) == ACKNOWLEDGED * 2
    assert trace.speeds_at(120) == DRIVING


def test_it_tells_its_time_out_in_its_version(simulator: Simulator) -> None:
    assert deadman_timeout_ms(NAME.decode()) == TIMEOUT_MS
    assert wants_arming(NAME.decode())


@pytest.mark.parametrize(("event", "cause"), [("", "unknown"), ("hang", "watchdog")])
def test_it_tells_the_cause_of_its_last_reset(simulator: Simulator, event: str, cause: str) -> None:
    """simavr sets the flag of a watchdog's reset and no other."""
    events: list[Event] = [(100, event, b"")] if event else []
    trace = simulator.run(ARMED, *events, rx(600, RESET_CAUSE_REQUEST), end_ms=620)
    (reply,) = ReplyParser().feed(trace.replies(600))
    assert isinstance(reply, Value)
    assert reset_cause(reply.data[0]) == cause


def test_an_answer_names_its_question(simulator: Simulator) -> None:
    for question in (VERSION_REQUEST, RESET_CAUSE_REQUEST):
        named = question[:3] + b"\x2a" + question[4:]
        assert simulator.run(rx(20, named), end_ms=40).replies(20)[2] == 0x2A


def test_asking_for_the_cause_neither_arms_nor_stops(simulator: Simulator) -> None:
    trace = simulator.run(rx(20, RESET_CAUSE_REQUEST), rx(40, DRIVE), end_ms=60)
    assert trace.speeds_at(60) == OFF
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, RESET_CAUSE_REQUEST), end_ms=60)
    assert trace.speeds_at(60) == DRIVING


def test_every_speed_sets_its_direction_and_duty(simulator: Simulator) -> None:
    speeds = [(v, -v) for v in range(-255, 256)] + [(255, 255), (-255, -255), (7, 0), (0, 7)]
    speeds += [(-7, 0), (0, -7)]
    events = [rx(20 + 4 * i, joystick(*pair)) for i, pair in enumerate(speeds)]
    trace = simulator.run(ARMED, *events, end_ms=20 + 4 * len(speeds))
    for (ms, _, _), pair in zip(events, speeds, strict=True):
        assert trace.speeds_at(ms + 3.5) == pair
    assert trace.replies(UP_MS) == ACKNOWLEDGED * (1 + len(speeds))


def test_direction_is_high_at_zero_and_the_timer_lets_go_of_the_pins(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, STOP.to_bytes()), end_ms=60)
    driving = next(pins for pins in trace.pins if pins.speeds == DRIVING)
    assert (driving.ocr0a, driving.ocr0b, driving.tccr0a, driving.portd) == (100, 100, 0xA3, 0x10)
    assert (trace.pins[-1].tccr0a, trace.pins[-1].portd) == (0x03, 0x90)


@pytest.mark.parametrize(
    ("sent", "obeyed"),
    [
        ((256, -256), (255, -255)),
        ((32767, -32768), (255, -255)),
        ((-32768, 32767), (-255, 255)),
        ((-300, 1), (-255, 1)),
    ],
)
def test_speeds_are_clipped(
    simulator: Simulator, sent: tuple[int, int], obeyed: tuple[int, int]
) -> None:
    trace = simulator.run(ARMED, rx(20, joystick(*sent)), end_ms=30)
    assert trace.speeds_since() == {OFF, obeyed}


def test_a_command_for_one_motor_leaves_the_other_as_it_is(simulator: Simulator) -> None:
    trace = simulator.run(
        ARMED,
        rx(20, motor(9, -80)),
        rx(40, motor(10, 90)),
        rx(60, motor(9, 0)),
        rx(80, motor(11, 255)),  # no such port
        rx(100, STOP.to_bytes()),
        rx(120, motor(9, 30)),  # the other one is as the stop has left it
        end_ms=140,
    )
    at = [trace.speeds_at(ms) for ms in (35, 55, 75, 95, 115, 135)]
    assert at == [(-80, 0), (-80, 90), (0, 90), (0, 90), OFF, (30, 0)]
    assert trace.replies(UP_MS) == ACKNOWLEDGED * 6


def test_reset_stops_at_once_and_is_acknowledged(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, RESET_REQUEST), end_ms=60)
    assert trace.speeds_at(39) == DRIVING
    assert trace.stopped_us() <= sent_us(40, RESET_REQUEST) + BYTE_US
    assert trace.replies(UP_MS) == ACKNOWLEDGED * 3


def test_a_stop_waits_for_no_silence_behind_it(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, STOP.to_bytes()), end_ms=60)
    assert trace.stopped_us() <= sent_us(40, STOP.to_bytes()) + BYTE_US


def test_a_command_is_not_slower_than_on_stock_firmware(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(20, DRIVE), rx(40, STOP.to_bytes()), end_ms=60)
    started_us = next(pins.at_us for pins in trace.pins if pins.speeds == DRIVING)
    assert started_us - 20_000 <= STOCK_LATENCY_US
    assert trace.stopped_us() - 40_000 <= STOCK_LATENCY_US


@pytest.mark.parametrize(
    "frame",
    [
        b"\xff\x55\x02\x00\x05",  # START
        b"\xff\x55\x07\x00\x02\x22\x06\x01\xf4\x01",  # a tone
        b"\xff\x55\x04\x00\x01\x01\x03",  # the ultrasonic sensor
        b"\xff\x55\x09\x00\x02\x08\x07\x02\x00\x14\x14\x14",  # LEDs
        b"\xff\x55\x03\x00\x01\x33",  # a question, and an order, that nobody knows
        b"\xff\x55\x03\x00\x02\x33",
        b"\xff\x55\x00",
        b"\xff\x55\xff\x00\x02\x05\xff\x00\xff\x00",
    ],
)
def test_unknown_frames_are_ignored(simulator: Simulator, frame: bytes) -> None:
    trace = simulator.run(ARMED, rx(20, frame + DRIVE), end_ms=40)
    assert trace.replies(20) == ACKNOWLEDGED
    assert trace.speeds_since() == {OFF, DRIVING}


def test_silence_stops_the_motors_in_time_and_not_before(simulator: Simulator) -> None:
    repeated = [rx(ms, DRIVE) for ms in range(100, 2100, 100)]
    trace = simulator.run(ARMED, *repeated, end_ms=4000)
    silence_ms = (trace.stopped_us() - sent_us(2000, DRIVE)) / 1000
    assert TIMEOUT_MS <= silence_ms <= TIMEOUT_MS + 2
    ran_us = [pins.at_us for pins in trace.pins if pins.speeds == DRIVING]
    stopped_between = [
        pins
        for pins in trace.pins
        if ran_us[0] < pins.at_us < trace.stopped_us() and not any(pins.speeds)
    ]
    assert not stopped_between


def test_asking_for_the_version_does_not_keep_it_driving(simulator: Simulator) -> None:
    asking = (rx(ms, VERSION_REQUEST) for ms in range(150, 1000, 50))
    trace = simulator.run(ARMED, rx(100, DRIVE), *asking, end_ms=1000)
    assert trace.stopped_us() <= sent_us(100, DRIVE) + (TIMEOUT_MS + 2) * 1000


@pytest.mark.parametrize("frame", [DRIVE, motor(9, 50), motor(10, 0)], ids=bytes.hex)
@pytest.mark.parametrize(
    "stop", [STOP.to_bytes(), RESET_REQUEST, stop_burst()], ids=["stop", "reset", "burst"]
)
def test_after_silence_drive_commands_are_refused_until_it_is_armed(
    simulator: Simulator, frame: bytes, stop: bytes
) -> None:
    trace = simulator.run(
        ARMED,
        rx(100, DRIVE),
        *(rx(ms, frame) for ms in range(500, 1000, 100)),
        rx(1000, VERSION_REQUEST),
        rx(1100, stop),
        rx(1150, frame),
        rx(1200, ARM_REQUEST),
        rx(1250, DRIVE),
        end_ms=1300,
    )
    assert trace.speeds_at(99) == trace.speeds_at(450) == trace.speeds_at(1249) == OFF
    assert {pins.speeds for pins in trace.pins if 450_000 < pins.at_us < 1_250_000} <= {OFF}
    assert trace.replies(450, 1000) == b"", "a refused command must not be acknowledged"
    assert trace.replies(1000, 1100) == VERSION_REPLY
    assert trace.replies(1100, 1150) == ACKNOWLEDGED
    assert trace.replies(1155, 1200) == b"", "a stop does not arm"
    assert trace.replies(1200, 1250) == ACKNOWLEDGED
    assert trace.speeds_at(1300) == DRIVING


def test_standing_still_for_long_does_not_latch(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(3000, DRIVE), end_ms=3050)
    assert trace.speeds_at(3050) == DRIVING


def test_a_hung_program_is_reset_and_latched(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(100, DRIVE), (150, "hang", b""), rx(500, DRIVE), end_ms=700)
    assert trace.speeds_at(390) == DRIVING, "nothing but the watchdog can stop a hung program"
    assert trace.stopped_us() <= (150 + WATCHDOG_MS + 1) * 1000
    assert trace.replies(150) == BANNER


def test_the_reset_pin_stops_and_latches(simulator: Simulator) -> None:
    trace = simulator.run(ARMED, rx(100, DRIVE), (150, "reset", b""), rx(200, DRIVE), end_ms=300)
    assert trace.stopped_us() <= 150_100
    assert trace.replies(150) == BANNER


def test_it_outlives_more_questions_than_it_can_answer(simulator: Simulator) -> None:
    flood = VERSION_REQUEST * 200
    trace = simulator.run(ARMED, rx(20, flood), rx(200, STOP.to_bytes()), end_ms=220)
    answers = trace.replies(20, 200)
    assert answers.replace(VERSION_REPLY, b"") == b"", "an answer was torn"
    assert len(answers) > 30 * len(VERSION_REPLY)
    assert trace.replies(200) == ACKNOWLEDGED


def test_every_frame_that_the_daemon_can_send_is_obeyed(simulator: Simulator) -> None:
    """Of the 501 steps, both wheels; the same frames that tests/robot/test_what_leaves.py has."""
    wheels = WheelMaps(MotorMap(reversed=True), MotorMap(reversed=False))
    steps = [Steps(step, -step) for step in range(-250, 251)]
    told = [Joystick.of(wheels.at_motors(wheels.duties(one))) for one in steps]
    events = [rx(20 + 5 * at, one.to_bytes()) for at, one in enumerate(told)]
    trace = simulator.run(ARMED, *events, end_ms=20 + 5 * len(told))
    for at, one in enumerate(told):
        assert trace.speeds_at(20 + 5 * at + 4.5) == (one.m1, one.m2)

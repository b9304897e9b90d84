"""The firmware's senses and reflexes, in simulated time: pins of sensors in, motors out."""

import pytest

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.drive.mcore import (
    STOP,
    Joystick,
    ReplyParser,
    Value,
    senses_request,
    stop_burst,
)
from mbot_protocol.drive.senses import NO_ECHO_M, Senses

from ..promised import promised
from .frames import ACKNOWLEDGED, ARMED, NAME, OFF, UP_MS, Event, rx
from .simulated_board import Simulator, Trace

AHEAD = (-200, 200)
BACK = (200, -200)
LEFT = (100, 100)  # on the spot: M1, the left wheel, backward

ASKED_MS = UP_MS + 2
EDGE = senses_request((2,), 3, 0.0, edge_stops=True)
WALL = senses_request((2,), 3, 0.15, edge_stops=False)
ONLY_TOLD = senses_request((2,), 3, 0.0, edge_stops=False)


def asked(request: bytes) -> Event:
    return rx(ASKED_MS, request)


def floor(ms: float, pair: int, seen: bool) -> Event:
    return ms, f"{'high' if seen else 'low'} B{pair}", b""


def echo(ms: float, distance_m: float) -> Event:
    return ms, f"echo {round(distance_m * 1000)}", b""


def held(speeds: tuple[int, int], from_ms: int, to_ms: int) -> list[Event]:
    """As the daemon repeats a command."""
    return [rx(ms, Joystick(*speeds).to_bytes()) for ms in range(from_ms, to_ms, 100)]


def run(simulator: Simulator, *events: Event, end_ms: float) -> Trace:
    """In the order of time, armed."""
    return simulator.run(ARMED, *sorted(events, key=lambda event: event[0]), end_ms=end_ms)


def told(trace: Trace, from_ms: float = 0, to_ms: float = 1e9) -> list[Senses]:
    replies = ReplyParser().feed(trace.replies(from_ms, to_ms))
    values = [reply.senses for reply in replies if isinstance(reply, Value)]
    return [one for one in values if one is not None]


@pytest.mark.parametrize("pair", [1, 2])
@pytest.mark.parametrize("at_ms", [400.0, 401.3, 402.9, 404.4])
def test_no_floor_under_either_pair_cuts_forward(
    simulator: Simulator, pair: int, at_ms: float
) -> None:
    trace = run(
        simulator, asked(EDGE), *held(AHEAD, 100, 600), floor(at_ms, pair, False), end_ms=600
    )
    assert trace.speeds_at(at_ms) == AHEAD
    assert trace.stopped_us() / 1000 - at_ms <= promised("edge-cut")
    assert told(trace)[-1].over_an_edge


def test_a_speck_is_no_edge(simulator: Simulator) -> None:
    trace = run(
        simulator,
        asked(EDGE),
        *held(AHEAD, 100, 600),
        floor(400, 1, False),
        floor(403.5, 1, True),
        end_ms=600,
    )
    assert trace.speeds_since(110) == {AHEAD}


def test_at_an_edge_wheels_turn_backward_only(simulator: Simulator) -> None:
    away = floor(200, 2, False)
    back = run(simulator, asked(EDGE), away, *held(BACK, 300, 500), end_ms=500)
    assert back.speeds_since(310) == {BACK}
    turn = run(simulator, asked(EDGE), away, *held(LEFT, 300, 500), end_ms=500)
    assert turn.speeds_since(310) == {(100, 0)}, "a wheel that turned forward would swing over it"


def test_an_edge_is_over_when_the_robot_has_driven_away_from_it(simulator: Simulator) -> None:
    edge = [floor(200, 1, False), floor(300, 1, True)]
    stands = run(simulator, asked(EDGE), *edge, *held(AHEAD, 400, 2000), end_ms=2000)
    assert stands.speeds_since(210) == {OFF}, "it has not moved"
    leaves = run(
        simulator,
        asked(EDGE),
        *edge,
        *held(BACK, 400, 1100),
        *held(AHEAD, 1100, 1300),
        end_ms=1300,
    )
    assert leaves.speeds_at(1200) == AHEAD
    soon = run(
        simulator, asked(EDGE), *edge, *held(BACK, 400, 700), *held(AHEAD, 700, 900), end_ms=900
    )
    assert soon.speeds_since(710) == {OFF}


def test_a_floor_that_comes_and_goes_is_not_driven_away_from(simulator: Simulator) -> None:
    flickers = [
        floor(200, 1, False),
        floor(300, 1, True),
        floor(620, 1, False),
        floor(640, 1, True),
    ]
    events = [asked(EDGE), *flickers, *held(BACK, 320, 1000), *held(AHEAD, 1010, 1200)]
    trace = run(simulator, *events, end_ms=1200)
    assert trace.speeds_since(1020) == {OFF}, "0.3 s and 0.4 s are not 0.6 s in a row"


@pytest.mark.parametrize("request_", [EDGE, WALL])
def test_the_slowest_forward_is_forward(simulator: Simulator, request_: bytes) -> None:
    events = [asked(request_), floor(200, 1, False), echo(50, 0.05), *held((-1, 1), 300, 500)]
    assert run(simulator, *events, end_ms=500).speeds_since(210) == {OFF}


def test_armed_anew_with_a_floor_it_drives(simulator: Simulator) -> None:
    events = [asked(EDGE), floor(200, 1, False), (400.0, *ARMED[1:]), *held(AHEAD, 420, 600)]
    assert run(simulator, *events, end_ms=600).speeds_since(430) == {OFF}
    put_back = run(simulator, *events, floor(300, 1, True), end_ms=600)
    assert put_back.speeds_since(430) == {AHEAD}


@pytest.mark.parametrize("arm_ms", [400.0, 401.0, 402.0, 403.0])
def test_armed_anew_without_a_floor_no_wheel_twitches(simulator: Simulator, arm_ms: float) -> None:
    """Whenever it comes between two looks at the floor, and the command right behind it."""
    behind = rx(arm_ms + 0.7, Joystick(*AHEAD).to_bytes())
    events = [floor(200, 1, False), (arm_ms, *ARMED[1:]), behind]
    assert run(simulator, asked(EDGE), *events, end_ms=420).speeds_since(210) == {OFF}
    free = run(simulator, asked(ONLY_TOLD), *events, end_ms=420)
    assert free.speeds_at(arm_ms + 2.2) == AHEAD, "where no edge counts nothing holds it"


def test_another_request_forgets_what_held_it(simulator: Simulator) -> None:
    for request, then in ((EDGE, ONLY_TOLD), (WALL, ONLY_TOLD)):
        events = [floor(100, 1, False), echo(50, 0.05), rx(300, then), *held(AHEAD, 310, 500)]
        trace = run(simulator, asked(request), *events, end_ms=500)
        assert trace.speeds_at(312) == AHEAD, "at once"
        assert trace.speeds_since(312) == {AHEAD}


def test_a_thing_at_the_limit_does_not_make_it_tremble(simulator: Simulator) -> None:
    nearby = [echo(ms, distance_m) for ms, distance_m in ((50, 0.14), (300, 0.16), (500, 0.14))]
    trace = run(simulator, asked(WALL), *nearby, *held(AHEAD, 200, 700), end_ms=700)
    assert trace.speeds_since(210) == {OFF}


def test_one_sensor_alone_is_told(simulator: Simulator) -> None:
    for ports, sonar_port in (((), 3), ((2,), 0)):
        request = senses_request(ports, sonar_port, 0.0, edge_stops=False)
        assert told(run(simulator, asked(request), echo(30, 0.3), end_ms=200))


def test_nothing_drives_into_what_it_hears(simulator: Simulator) -> None:
    events = [asked(WALL), echo(50, 0.5), echo(400, 0.12), *held(AHEAD, 100, 700)]
    trace = run(simulator, *events, end_ms=700)
    assert trace.speeds_at(400) == AHEAD
    assert trace.stopped_us() / 1000 - 400 <= promised("obstacle-cut")
    last = told(trace)[-1]
    assert last.at_obstacle
    assert last.distance_m == pytest.approx(0.12, abs=0.004)
    around = run(simulator, asked(WALL), echo(50, 0.12), *held(LEFT, 300, 500), end_ms=500)
    assert around.speeds_since(310) == {LEFT}
    away = run(simulator, asked(WALL), echo(50, 0.12), *held(BACK, 300, 500), end_ms=500)
    assert away.speeds_since(310) == {BACK}


def test_it_goes_on_when_the_way_is_free(simulator: Simulator) -> None:
    trace = run(
        simulator, asked(WALL), echo(50, 0.1), echo(400, 0.0), *held(AHEAD, 200, 900), end_ms=900
    )
    assert trace.speeds_at(390) == OFF
    assert trace.speeds_at(400 + 200) == AHEAD


@pytest.mark.parametrize("distance_m", [0.03, 0.1, 0.42, 1.5, 3.9])
def test_a_distance_is_told_as_it_is(simulator: Simulator, distance_m: float) -> None:
    trace = run(simulator, asked(ONLY_TOLD), echo(30, distance_m), end_ms=400)
    heard = told(trace)[-1].distance_m
    assert heard == pytest.approx(distance_m, abs=0.006)


def test_without_an_echo_nothing_waits(simulator: Simulator) -> None:
    """What costs the stock firmware 0.88 s (measured)."""
    at_ms = [ms + 0.7 for ms in range(300, 420, 7)]
    events = [rx(ms, Joystick(*AHEAD).to_bytes()) for ms in at_ms]
    trace = run(simulator, asked(WALL), *events, rx(450, STOP.to_bytes()), end_ms=460)
    assert trace.stopped_us() <= 450_000 + 94 * 10 + 400
    assert told(trace)[-1].distance_m == NO_ECHO_M
    acknowledged = trace.replies(300).count(ACKNOWLEDGED)
    assert acknowledged == len(at_ms) + 1


def test_a_stop_burst_and_silence_end_as_before(simulator: Simulator) -> None:
    trace = run(simulator, asked(EDGE), *held(AHEAD, 100, 200), end_ms=600)
    assert 299_000 <= trace.stopped_us() - 101_000 <= 301_500
    trace = run(simulator, asked(WALL), *held(AHEAD, 100, 200), rx(150, stop_burst()), end_ms=200)
    assert trace.speeds_at(150 + 62 * 0.094 + 0.5) == OFF


def test_silence_at_an_edge_latches(simulator: Simulator) -> None:
    events = [floor(200, 1, False), floor(700, 1, True), *held(AHEAD, 100, 300)]
    trace = run(simulator, asked(EDGE), *events, *held(BACK, 800, 900), end_ms=900)
    assert trace.speeds_since(210) == {OFF}
    assert trace.replies(800, 830).count(ACKNOWLEDGED) == 0


def test_it_tells_twenty_times_a_second_where_asked_for(simulator: Simulator) -> None:
    trace = run(simulator, asked(ONLY_TOLD), end_ms=ASKED_MS + 1010)
    assert 19 <= len(told(trace)) <= 21
    assert all(one.floor == (True, True) for one in told(trace))
    assert told(trace)[-1].supply_v == pytest.approx(5.0, abs=0.05)
    assert not told(run(simulator, end_ms=500))


def test_it_tells_at_once_when_asked_once(simulator: Simulator) -> None:
    get = bytes.fromhex("ff5503000172")
    trace = run(simulator, rx(100, get), end_ms=103)
    assert len(told(trace, 100)) == 1


def test_what_it_runs_on_is_told(simulator: Simulator) -> None:
    trace = run(simulator, asked(ONLY_TOLD), (200.0, "supply 4300", b""), end_ms=500)
    assert told(trace)[-1].supply_v == pytest.approx(4.3, abs=0.05)


def test_what_only_tells_holds_nobody_back(simulator: Simulator) -> None:
    events = [floor(200, 1, False), echo(30, 0.05), *held(AHEAD, 300, 600)]
    trace = run(simulator, asked(ONLY_TOLD), *events, end_ms=600)
    assert trace.speeds_since(310) == {AHEAD}
    assert told(trace)[-1].floor == (False, True)


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize("right", [True, False])
def test_forward_is_what_the_wheels_say(simulator: Simulator, left: bool, right: bool) -> None:
    wheels = WheelMaps(MotorMap(reversed=left), MotorMap(reversed=right))
    request = senses_request((2,), 0, 0.0, wheels, edge_stops=True)
    m1 = -200 if left else 200
    m2 = -200 if right else 200
    events = [asked(request), floor(200, 1, False)]
    forward = run(simulator, *events, *held((m1, m2), 300, 500), end_ms=500)
    assert forward.speeds_since(210) == {OFF}
    backward = run(simulator, *events, *held((-m1, -m2), 300, 500), end_ms=500)
    assert backward.speeds_since(310) == {(-m1, -m2)}


@pytest.mark.parametrize(("port", "pins"), [(1, "B3 B4"), (2, "B1 B2"), (3, "C2 C3"), (4, "C0 C1")])
def test_pairs_at_any_port(simulator: Simulator, port: int, pins: str) -> None:
    request = senses_request((port,), 0, 0.0, edge_stops=True)
    light = [(15.0, f"high {pin}", b"") for pin in pins.split()]
    events = [*light, asked(request), *held(AHEAD, 100, 400)]
    assert run(simulator, *events, end_ms=400).speeds_at(300) == AHEAD
    for pin in pins.split():
        trace = run(simulator, *events, (250.0, f"low {pin}", b""), end_ms=400)
        assert trace.speeds_since(270) == {OFF}


def test_several_modules_count_together(simulator: Simulator) -> None:
    request = senses_request((1, 2), 3, 0.0, edge_stops=True)
    light = [(15.0, f"high B{bit}", b"") for bit in (3, 4)]
    events = [*light, asked(request), *held(AHEAD, 100, 400)]
    assert run(simulator, *events, end_ms=400).speeds_at(300) == AHEAD
    assert run(simulator, *events, (250.0, "low B3", b""), end_ms=400).speeds_since(270) == {OFF}


def test_a_reset_forgets_what_it_was_asked_for(simulator: Simulator) -> None:
    trace = run(simulator, asked(EDGE), (200.0, "reset", b""), end_ms=600)
    assert told(trace, to_ms=200)
    assert not told(trace, 205)
    assert NAME.startswith(b"mbot-deadman 3 ")

"""Commands as bytes, against the real loop, helm and arming among fakes."""

import time
from dataclasses import replace
from typing import Any

import pytest

from mbot_agent.arming import Mark, Mode, State
from mbot_agent.commands.command_service import (
    LONGEST_EXPIRY_NS,
    LONGEST_MARK_MS,
    CommandService,
)
from mbot_agent.commands.stop_service import StopService
from mbot_agent.configuration import Configuration
from mbot_agent.faults import Fault
from mbot_agent.helm import Press
from mbot_agent.network.requests import Request
from mbot_agent.network.wire_messages import beat_of
from mbot_protocol.drive.actions import AS_BUILT
from mbot_protocol.drive.wheel_command import STOP, Duties
from mbot_protocol.policy.policy import Policy
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire.schema import SCHEMA_VERSION

from ..promised import promised
from .loop_bench import Bench
from .tiny_models import constant_model

SESSION = 42


class Asked(Request):
    """A request that came over no network."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload


class Service:
    """A command service, and a person who sends what the test says."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.heard = 0
        self.numbers = 0
        self.presses = 0
        self.updating = False
        self.service = CommandService(
            Configuration(robot_id="mbot-1"),
            SESSION,
            self.bench.helm,
            self.bench.board,
            self.bench.loop,
            lambda: None,
            lambda: (),
            self._hear,
            lambda: self.updating,
        )
        self.stops = StopService(self.bench.helm, self.bench.board)

    def _hear(self) -> None:
        self.heard += 1

    def command(self, **changes: Any) -> messages.Command:
        self.numbers += 1
        fields: dict[str, Any] = {
            "schema_version": SCHEMA_VERSION,
            "robot_id": "mbot-1",
            "session_id": SESSION,
            "expires_monotonic_ns": time.monotonic_ns() + 10**9,
            "stop_count": self.bench.stops,
            "sender_id": 17,
            "number": self.numbers,
        }
        return messages.Command(**(fields | changes))

    def send(self, command: messages.Command) -> messages.CommandReply:
        return messages.CommandReply.FromString(self.service.command(command.SerializeToString()))

    def run(self, **changes: Any) -> messages.CommandReply:
        return self.send(self.command(run=messages.Run(), **changes))

    def drive(self, **changes: Any) -> messages.CommandReply:
        self.presses += 1
        return self.send(self.drive_command(300, self.presses, **changes))

    def drive_command(
        self, hold_ms: int, press: int, *, let_go: bool = False, **changes: Any
    ) -> messages.Command:
        """Good for as long as it holds."""
        wheels = messages.Wheels(left=0.5, right=0.5)
        drive = messages.Drive(wheels=wheels, hold_ms=hold_ms, press=press, let_go=let_go)
        good = {"expires_monotonic_ns": time.monotonic_ns() + hold_ms * 1_000_000}
        return self.command(drive=drive, **(good | changes))

    def stop(self, payload: bytes = b"") -> messages.CommandReply:
        """STOP, and what all who wait are answered then."""
        request = Asked(payload)
        self.stops.take(request)
        return self.stops.confirm()

    @property
    def status(self) -> messages.Status:
        return messages.Status.FromString(self.service.status(b""))


@pytest.fixture
def service() -> Service:
    service = Service()
    service.bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    service.bench.tick()
    return service


def test_status_tells_the_camera_and_what_its_automatics_do(service: Service) -> None:
    assert service.status.camera == "picamera2, light automatic"
    service.bench.camera.light = "unknown"
    assert service.status.camera == "picamera2"


def test_status_counts_decisions_and_missed_beats() -> None:
    service = Service()
    assert (service.status.decisions, service.status.missed_ticks) == (0, 0)
    for _ in range(2):
        service.bench.tick()
    assert (service.status.decisions, service.status.missed_ticks) == (2, 0)
    latest = service.bench.loop.latest
    assert latest is not None
    service.bench.loop.latest = replace(latest, missed_ticks=3)
    assert service.status.missed_ticks == 3


def test_an_update_takes_no_order_but_a_stop(service: Service) -> None:
    service.updating = True
    reply = service.run()
    assert not reply.accepted
    assert "an update of mbot-agent is under way" in reply.reason
    assert service.bench.helm.orders.mode is Mode.IDLE
    assert service.send(service.command(stop=messages.Stop())).accepted
    assert service.bench.helm.orders.mode is Mode.STOPPED
    service.updating = False
    assert service.run().accepted


@pytest.mark.parametrize("mode", ["idle", "run", "drive", "stop", "update"])
def test_a_mark_sets_nothing_in_motion_and_stops_nothing(service: Service, mode: str) -> None:
    {"run": service.run, "drive": service.drive, "stop": service.stop}.get(mode, list)()
    service.updating = mode == "update"
    orders, asked = service.bench.helm.orders, list(service.bench.board.asked)
    reply = service.send(service.command(mark=messages.Mark(back_ms=3000), sender="max\n"))
    assert reply.accepted == (mode not in ("idle", "update")), "there is a recording, or none"
    assert (service.bench.helm.orders, service.bench.board.asked) == (orders, asked)
    for wrong in (0, LONGEST_MARK_MS + 1):
        refused = service.send(service.command(mark=messages.Mark(back_ms=wrong)))
        assert "back_ms is" in refused.reason
    late = service.command(mark=messages.Mark(back_ms=3000), expires_monotonic_ns=1)
    assert "expired" in service.send(late).reason, "of other seconds than were meant"
    mark = service.bench.helm.take_mark()
    assert mark == (Mark("max", 3000) if reply.accepted else None)


def test_run_and_drive_that_know_the_last_stop_are_obeyed(service: Service) -> None:
    reply = service.run()
    assert (reply.accepted, reply.state) == (True, messages.STATE_RUNNING)
    reply = service.drive()
    assert (reply.accepted, reply.state) == (True, messages.STATE_MANUAL)
    assert service.heard == 2


@pytest.mark.parametrize("what", ["run", "drive"])
def test_nothing_that_was_sent_before_a_stop_moves_the_robot_after_it(
    service: Service, what: str
) -> None:
    early = (
        service.command(run=messages.Run())
        if what == "run"
        else service.drive_command(1000, press=1)
    )
    service.stop(messages.Command(sender="max").SerializeToString())
    reply = service.send(early)
    assert not reply.accepted
    assert reply.reason.startswith("stopped by max 0.")
    assert reply.reason.endswith("s ago; look, then run again")
    assert reply.stop_count == service.bench.stops == 2
    assert not service.bench.helm.orders.is_armed
    assert service.bench.board.commands == []


def test_no_hand_drives_on_through_somebodys_stop(service: Service) -> None:
    seen = service.bench.stops
    assert service.drive(stop_count=seen).accepted
    driven = len(service.bench.board.commands)
    service.stop()
    for _ in range(10):
        assert not service.drive(stop_count=seen).accepted
    assert len(service.bench.board.commands) == driven
    assert service.drive().accepted


def test_every_stop_counts_and_shows_everywhere(service: Service) -> None:
    for count in (2, 3, 4):
        reply = service.stop(messages.Command(sender="max").SerializeToString())
        assert (reply.accepted, reply.standing, reply.stop_count) == (True, True, count)
        assert service.status.last_stop.count == count
        assert service.status.last_stop.by == "max"
        assert service.bench.tick().stop_count == count


def test_a_hand_that_let_go_is_told_apart_from_an_older_stop(service: Service) -> None:
    service.stop(messages.Command(sender="max").SerializeToString())
    assert service.status.let_go_monotonic_ns == 0
    assert service.drive().accepted
    assert service.status.let_go_monotonic_ns == 0
    hand = Press(17, service.presses)
    service.bench.helm.steer_by_hand(STOP, 0, service.bench.stops, hand)  # as good as over
    tick = service.bench.loop.tick(time.monotonic_ns())
    status = service.status
    assert status.state == messages.STATE_STOPPED
    assert 0 < status.let_go_monotonic_ns <= status.now_monotonic_ns
    assert (status.last_stop.by, status.last_stop.count) == ("max", service.bench.stops)
    assert beat_of(tick, "mbot-1", SESSION, (), AS_BUILT).decision.hand_let_go
    service.stop(messages.Command(sender="anna").SerializeToString())
    assert service.status.let_go_monotonic_ns == 0
    tick = service.bench.loop.tick(time.monotonic_ns())
    assert not beat_of(tick, "mbot-1", SESSION, (), AS_BUILT).decision.hand_let_go


@pytest.mark.parametrize("payload", [b"", b"\xff\xff", b"\x4a\xff", bytes(4000)])
def test_a_damaged_stop_stops(service: Service, payload: bytes) -> None:
    service.run()
    before = service.status.last_stop.count
    assert service.stop(payload).stop_count - before == promised("stop-counted")
    assert service.bench.helm.orders.mode is Mode.STOPPED


def test_a_stop_by_the_command_key_never_expires(service: Service) -> None:
    service.run()
    late = service.command(stop=messages.Stop(), expires_monotonic_ns=1, session_id=7, stop_count=0)
    assert service.send(late).accepted
    assert service.bench.stops == 2


def test_a_senders_name_is_one_short_line(service: Service) -> None:
    name = "max\n\x1b[2J" + "x" * 1000
    service.stop(messages.Command(sender=name).SerializeToString())
    shown = service.status.last_stop.by
    assert shown.startswith("max[2Jxx")
    assert len(shown) == 48


def test_a_stop_is_confirmed_by_the_board_or_not_at_all(service: Service) -> None:
    assert service.stop().reason == ""
    service.bench.board.answers = False
    reply = service.stop()
    assert (reply.accepted, reply.standing) == (True, False)
    assert "not confirmed by the board" in reply.reason
    service.bench.board.fault = Fault("board-lost", "the cable is out")
    assert "the cable is out" in service.stop().reason


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"session_id": 7}, "before the robot's last start"),
        ({"expires_monotonic_ns": 1}, "expired"),
        ({"robot_id": "mbot-2"}, "for robot 'mbot-2'"),
        ({"number": 0}, "repeated or overtaken"),
        ({"stop_count": 0}, "upgrade the workstation"),
        ({"stop_count": 99}, "look, then run again"),
    ],
)
def test_what_was_meant_for_another_moment_is_refused(
    service: Service, changes: dict[str, Any], reason: str
) -> None:
    for reply in (service.run(**changes), service.drive(**changes)):
        assert not reply.accepted
        assert reason in reply.reason
    assert not service.bench.helm.orders.is_armed


def test_nobody_has_a_command_for_later_in_his_pocket(service: Service) -> None:
    now_ns = time.monotonic_ns()
    assert promised("longest-expiry") * 1e9 == LONGEST_EXPIRY_NS
    assert "at most 2 s" in service.run(expires_monotonic_ns=now_ns + 3 * 10**9).reason
    assert service.run(expires_monotonic_ns=now_ns + 19 * 10**8).accepted


def test_the_same_bytes_are_obeyed_once(service: Service) -> None:
    once = service.command(run=messages.Run())
    assert service.send(once).accepted
    assert "repeated or overtaken" in service.send(once).reason


@pytest.mark.parametrize("missing", ["model", "camera", "board"])
def test_run_with_a_fault_arms_nothing_and_says_why(missing: str) -> None:
    service = Service()
    if missing != "model":
        service.bench.pilot.use(Policy(constant_model()))
    if missing == "camera":
        service.bench.camera.fault = Fault("camera-lost", "the camera is gone")
    if missing == "board":
        service.bench.board.fault = Fault("board-lost", "the board is gone")
    service.bench.tick()
    reply = service.run()
    assert not reply.accepted
    assert reply.reason.startswith("not armed: ")
    assert {"model": "no model yet"}.get(missing, f"the {missing} is gone") in reply.reason
    assert not service.bench.helm.orders.is_armed
    # And nothing moves when it is mended.
    service.bench.pilot.use(Policy(constant_model()))
    service.bench.camera.fault = service.bench.board.fault = None
    service.bench.tick()
    assert service.bench.board.commands == []


def test_asked_to_wait_it_waits(service: Service) -> None:
    service.bench.camera.fault = Fault("camera-lost", "gone")
    command = service.command(run=messages.Run(when_ready=True))
    reply = service.send(command)
    assert (reply.accepted, reply.state) == (True, messages.STATE_FAULT)
    assert service.bench.helm.orders.mode is Mode.WAITING
    service.bench.camera.fault = None
    service.bench.tick()
    assert len(service.bench.board.commands) == 1


def test_run_believes_once_more_a_picture_that_stood_still(service: Service) -> None:
    service.bench.camera.fault = Fault("camera-frozen", "the same picture again and again")
    assert service.run().accepted


def test_run_waits_a_moment_for_the_picture_that_shows_it(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And looks for it now and then, not all the time."""
    service.bench.camera.fault = Fault("camera-lost", "gone")
    looks = 0
    faults = service.bench.loop.faults

    def counted(mode: Mode) -> tuple[Fault, ...]:
        nonlocal looks
        looks += 1
        if looks == 10:
            service.bench.camera.fault = None
        return faults(mode)

    monkeypatch.setattr(service.bench.loop, "faults", counted)
    began_s = time.monotonic()
    assert service.run().accepted
    assert 0.05 < time.monotonic() - began_s < 0.9
    assert looks <= 12


def test_a_command_that_says_nothing_known_is_refused(service: Service) -> None:
    """As one of a newer workstation may."""
    reply = service.send(service.command())
    assert not reply.accepted
    assert "upgrade mbot-agent" in reply.reason
    assert service.bench.helm.orders.mode is Mode.IDLE


def test_a_hand_turns_the_wheel_that_it_means(service: Service) -> None:
    command = service.drive_command(300, press=1)
    command.drive.wheels.left, command.drive.wheels.right = 1.0, -0.5
    assert service.send(command).accepted
    assert service.bench.board.commands[0].duties == Duties(1.0, -148 / 255)  # as a policy does


def test_a_hand_that_asks_for_no_number_moves_nothing(service: Service) -> None:
    command = service.drive_command(300, press=1)
    command.drive.wheels.left = float("nan")
    reply = service.send(command)
    assert (reply.accepted, "nan" in reply.reason) == (False, True)
    assert not service.bench.helm.orders.is_armed


def test_a_hand_is_told_that_the_board_is_gone(service: Service) -> None:
    service.bench.board.fault = Fault("board-lost", "the cable is out")
    reply = service.drive()
    assert (reply.accepted, reply.reason) == (False, "the cable is out")
    assert not service.bench.helm.orders.is_armed


def test_each_hand_counts_its_own_presses(service: Service) -> None:
    assert service.send(service.drive_command(300, press=1, let_go=True)).accepted
    other = service.drive_command(300, press=1, sender_id=5, number=1)
    assert service.send(other).accepted


@pytest.mark.parametrize("hold_ms", [0, 1001])
def test_a_hand_holds_for_a_second_at_most(service: Service, hold_ms: int) -> None:
    drive = service.drive_command(
        hold_ms, press=1, expires_monotonic_ns=time.monotonic_ns() + 10**9
    )
    assert "expected 1 to 1000" in service.send(drive).reason
    assert service.bench.board.commands == []


def test_a_hands_command_lives_no_longer_than_it_holds(service: Service) -> None:
    """One that was held up on its way would set a robot in motion whose hand has let go."""
    good = time.monotonic_ns() + 900_000_000
    long = service.drive_command(300, press=1, expires_monotonic_ns=good)
    assert "no longer than it holds" in service.send(long).reason
    assert service.bench.board.commands == []
    short = service.drive_command(
        300, press=1, expires_monotonic_ns=time.monotonic_ns() + 50_000_000
    )
    assert service.send(short).accepted
    [command] = service.bench.board.commands
    assert command.deadline_ns == short.expires_monotonic_ns
    late = service.drive_command(  # by a clock that differs a little
        300, press=1, expires_monotonic_ns=time.monotonic_ns() + 390_000_000
    )
    assert service.send(late).accepted
    assert service.bench.board.commands[-1].deadline_ns <= time.monotonic_ns() + 300_000_000
    assert "press from 1 on" in service.send(service.drive_command(300, press=0)).reason


def test_a_press_that_was_let_go_is_never_taken_again(service: Service) -> None:
    assert service.send(service.drive_command(300, press=1)).accepted
    late = service.drive_command(1000, press=1)
    assert service.send(service.drive_command(1, press=1, let_go=True)).accepted is True
    assert service.bench.helm.orders.mode is Mode.STOPPED
    late.number = service.numbers + 1  # as if it had overtaken nothing
    assert "take hold again" in service.send(late).reason
    assert service.bench.helm.orders.mode is Mode.STOPPED
    assert service.bench.tick().state is State.STOPPED
    service.numbers += 1
    assert service.send(service.drive_command(300, press=2)).accepted


def test_a_hand_may_let_go_of_what_never_arrived(service: Service) -> None:
    assert service.send(service.drive_command(1, press=1, let_go=True)).accepted
    assert "take hold again" in service.send(service.drive_command(300, press=1)).reason
    assert not service.bench.helm.orders.is_armed

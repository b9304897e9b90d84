"""What a board has told of its senses, through the motor thread and by itself."""

import itertools
import time

import pytest

from mbot_agent.board import told_senses
from mbot_agent.board.motors import Motors
from mbot_agent.board.told_senses import ToldSenses
from mbot_agent.configuration import BoardSettings, SensesSettings, decode
from mbot_agent.faults import fault_ahead
from mbot_protocol.drive.mcore import senses_request
from mbot_protocol.drive.senses import Senses
from mbot_protocol.errors import ConfigurationError

from ..until import until
from .fake_board import FakeBoard

STOPS = SensesSettings(edge="stop", distance_m=0.15)
NEW = "mbot-deadman 3 300ms"
FREE, EDGE, WALL = 0b11, 0b110, 0b1011
"""As a board tells it: floor under both, under the second only, and something ahead."""


def senses(floor: tuple[bool, bool], *, edge: bool = False, obstacle: bool = False) -> Senses:
    return Senses(0.12, floor, edge, obstacle)


def test_a_board_that_can_is_asked_and_heard() -> None:
    with FakeBoard(NEW) as board, Motors(BoardSettings(port=board.path), senses=STOPS) as motors:
        assert until(lambda: motors.fault is None)
        assert senses_request((2,), 3, 0.15, edge_stops=True) in board.received
        assert motors.senses is None
        board.feel(420, FREE)
        assert until(lambda: motors.senses is not None)
        assert motors.senses == Senses(0.42, (True, True), False, False, 5.0)
        for told, count in ((EDGE, 1), (EDGE | 8, 1), (FREE, 1), (EDGE, 2)):
            board.feel(420, told)
            assert until(lambda told=told: motors.senses.at_edge == bool(told & 4))  # type: ignore[union-attr]
            assert until(lambda count=count: motors.edges == count)
    assert motors.notices == ()


@pytest.mark.parametrize("version", ["06.01.107", "mbot-deadman 2 300ms"])
def test_firmware_that_cannot_is_not_asked_and_says_why(version: str) -> None:
    with FakeBoard(version) as board:
        settings = BoardSettings(port=board.path, accept_no_deadman=True)
        with Motors(settings, senses=STOPS) as motors:
            assert until(lambda: motors.fault is None)
            assert [notice.kind for notice in motors.notices] == ["senses-off"]
        assert b"\x02\x72" not in board.received
        with Motors(settings) as motors:
            assert until(lambda: motors.fault is None)
            assert motors.notices == ()


def test_a_board_that_falls_silent_is_not_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(told_senses, "SILENT_AFTER_NS", 200_000_000)
    with FakeBoard(NEW) as board, Motors(BoardSettings(port=board.path), senses=STOPS) as motors:
        assert until(lambda: motors.fault is None)
        assert until(lambda: motors.fault is not None and motors.fault.kind == "senses-silent")
        board.feel(4000, FREE)
        assert until(lambda: motors.fault is None)


def test_the_same_telling_twice_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = 10**12
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    told, felt = ToldSenses(STOPS), senses((True, True))
    told.connected(NEW, watched=True)
    told.take(felt)
    now_ns += told_senses.SILENT_AFTER_NS - 1
    told.take(felt)  # the motor thread looks more often than the board tells
    assert told.fault is None
    now_ns += 1
    assert told.fault is not None
    told.take(senses((True, True)))  # the same, and new
    assert told.fault is None


def test_nothing_is_missed_of_a_board_that_nobody_asked() -> None:
    told = ToldSenses(SensesSettings())
    told.connected(NEW, watched=False)
    assert (told.fault, told.notices, told.latest) == (None, (), None)


def test_a_lost_board_feels_nothing() -> None:
    told = ToldSenses(STOPS)
    told.connected(NEW, watched=True)
    told.take(senses((True, True)))
    told.lost()
    assert (told.latest, told.fault, told.notices) == (None, None, ())


@pytest.mark.parametrize(("supply_v", "kinds"), [(None, []), (4.9, []), (4.3, ["supply-low"])])
def test_a_low_supply_is_told_before_the_board_resets(
    supply_v: float | None, kinds: list[str]
) -> None:
    told = ToldSenses(STOPS)
    told.connected(NEW, watched=True)
    told.take(Senses(4.0, (True, True), False, False, supply_v))
    assert [notice.kind for notice in told.notices] == kinds


@pytest.mark.parametrize(
    ("felt", "kind"),
    [
        (None, None),
        (senses((True, True)), None),
        (senses((False, False)), None),  # told, and no reflex asked for
        (senses((True, False), edge=True), "edge"),
        (senses((True, True), edge=True), None),  # it is to back off a little more; `run` ends that
        (senses((True, True), obstacle=True), "obstacle"),
        (senses((False, True), edge=True, obstacle=True), "edge"),
    ],
)
def test_what_is_ahead_is_a_fault(felt: Senses | None, kind: str | None) -> None:
    fault = fault_ahead(felt)
    assert (fault.kind if fault is not None else None) == kind


@pytest.mark.parametrize(
    "text",
    [
        'edge = "stop"\nline_ports = []',
        "distance_m = 0.2\nultrasonic_port = 0",
        "distance_m = 2.6",
        "distance_m = nan",
        'edge = "yes"',
        "line_ports = [5]",
        "line_ports = [3]",
        "unknown = 1",
    ],
)
def test_settings_that_contradict_themselves_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="senses"):
        decode(f'robot_id = "rosa"\n[senses]\n{text}', "config.toml")


def test_sensors_are_read_where_anybody_wants_them() -> None:
    for edge, distance_m in itertools.product(("off", "tell", "stop"), (0.0, 0.2)):
        settings = decode(
            f'robot_id = "rosa"\nsenses = {{edge = "{edge}", distance_m = {distance_m}}}', "-"
        ).senses
        assert settings.are_read == (edge != "off" or distance_m > 0)


def test_nothing_is_read_unasked() -> None:
    with FakeBoard(NEW) as board, Motors(BoardSettings(port=board.path)) as motors:
        assert until(lambda: motors.fault is None)
        assert senses_request((), 0, 0.0, edge_stops=False) in board.received

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive import mcore
from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.drive.mcore import (
    Acknowledgement,
    Banner,
    Joystick,
    Reply,
    ReplyParser,
    Value,
    VersionReply,
)
from mbot_protocol.drive.senses import Senses

speeds = st.integers(-255, 255)

REPLIES = {
    b"\xff\x55\r\n": Acknowledgement(),
    b"\xff\x55\x00\x04\x0906.01.009\r\n": VersionReply("06.01.009"),
    b"Version: 06.01.107\r\n": Banner("06.01.107"),
    b"\xff\x55\x80\x01\x01\r\n": Value(0x80, b"\x01"),
}


def test_a_joystick_frame_is_the_measured_bytes() -> None:
    assert Joystick(-100, 100).to_bytes() == bytes.fromhex("ff55070002059cff6400")
    assert bytes.fromhex("ff55030001 00".replace(" ", "")) == mcore.VERSION_REQUEST


@given(speeds, speeds)
def test_joystick_bytes_carry_both_speeds(m1: int, m2: int) -> None:
    frame = Joystick(m1, m2).to_bytes()
    assert len(frame) == 10
    assert frame[2] == len(frame) - 3
    assert int.from_bytes(frame[6:8], "little", signed=True) == m1
    assert int.from_bytes(frame[8:10], "little", signed=True) == m2


@pytest.mark.parametrize("speed", [256, -256, 1.0, True, None])
def test_a_speed_out_of_range_or_of_another_type_is_refused(speed: object) -> None:
    with pytest.raises(ValueError, match="m2 is"):
        Joystick(0, speed)  # pyright: ignore[reportArgumentType]


def test_a_stop_burst_fits_the_boards_receive_buffer_and_ends_in_stop() -> None:
    burst = mcore.stop_burst()
    assert len(burst) <= 64
    assert burst.endswith(Joystick(0, 0).to_bytes())


@given(st.lists(st.sampled_from(sorted(REPLIES)), max_size=8), st.data())
def test_replies_are_found_however_they_are_cut(parts: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(parts)
    parser = ReplyParser()
    found: list[Reply] = []
    while stream:
        cut = data.draw(st.integers(1, len(stream)))
        found += parser.feed(stream[:cut])
        stream = stream[cut:]
    assert found == [REPLIES[part] for part in parts]
    assert parser.pending == 0


def test_only_our_own_firmware_has_a_deadman() -> None:
    assert mcore.has_deadman("mbot-deadman 1")
    assert not mcore.has_deadman("06.01.107")
    assert not mcore.has_deadman("")


def test_makeblocks_firmware_for_other_boards_is_told_from_an_mbots() -> None:
    for version in ("09.01.016", "10.01.002", "0e.01.018", "05.01.001"):
        assert mcore.is_of_another_board(version)
    for version in ("06.01.009", "06.01.107", "1.2.103", "mbot-deadman 2 300ms", "somebody's", ""):
        assert not mcore.is_of_another_board(version)


@given(st.integers(0, 65535), st.integers(0, 255), st.integers(0, 255))
def test_senses_are_told_from_any_other_value(distance_mm: int, told: int, supply: int) -> None:
    data = distance_mm.to_bytes(2, "little") + bytes((told, supply))
    senses = Value(0x72, data).senses
    assert senses is not None
    assert senses.distance_m == distance_mm / 1000
    assert (*senses.floor, senses.at_edge, senses.at_obstacle) == tuple(
        bool(told & 1 << bit) for bit in range(4)
    )
    assert senses.supply_v == (pytest.approx(supply * 0.02) if supply else None)
    assert Value(0x71, data).senses is Value(0x72, data[:2]).senses is None


@pytest.mark.parametrize(
    ("version", "can"),
    [("06.01.107", False), ("mbot-deadman 2 300ms", False), ("mbot-deadman 3 300ms", True)],
)
def test_which_firmware_tells_senses(version: str, can: bool) -> None:
    assert mcore.tells_senses(version) == can


def test_senses_are_asked_for_in_one_frame() -> None:
    assert mcore.senses_request((2,), 3, 0.15, edge_stops=True) == bytes.fromhex(
        "ff550700027201 02 03 0f"
    )
    turned = WheelMaps(MotorMap(reversed=False), MotorMap(reversed=True))
    assert mcore.senses_request((1, 4), 0, 9.0, turned, edge_stops=False) == bytes.fromhex(
        "ff550700027206 09 00 ff"
    )


def test_what_is_felt_reads_as_a_sentence() -> None:
    felt = Senses(0.424, (True, False), at_edge=True, at_obstacle=False, supply_v=4.96)
    assert felt.words == "infrared pairs see floor and no floor, ahead 0.42 m, supply 5.0 V"
    assert "no echo" in Senses(4.0, (True, True), at_edge=False, at_obstacle=False).words

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive import mcore
from mbot_protocol.drive.mcore import (
    Acknowledgement,
    Banner,
    Joystick,
    Reply,
    ReplyParser,
    Value,
    VersionReply,
)

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

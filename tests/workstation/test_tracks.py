"""Track files of every kind come out in one frame and unit; what is broken is named."""

import random
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.raw_track import from_euler, to_file_frame, to_our_frame
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_file import read_track, write_tum
from mbot_workstation.measure.tracks.track_format import (
    PRESETS,
    TrackFormat,
    read_track_format,
    track_format,
)
from mbot_workstation.measure.tracks.track_mcap import read_mcap
from mbot_workstation.measure.tracks.track_table import read_table

UPS = ("x", "y", "z", "-x", "-y", "-z")


def spiral(count: int = 60, turns: float = 1.5) -> Track:
    """To the left and outwards, level, the tracker's x ahead."""
    yaw = np.linspace(0, turns * 2 * np.pi, count)
    zero = np.zeros(count)
    position = np.stack([yaw * np.cos(yaw) / 9, yaw * np.sin(yaw) / 9, zero + 0.1], axis=1)
    quaternion = np.stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)], axis=1)
    return Track(np.arange(count) / 90 + 12.5, position, quaternion)


def same_attitudes(first: Array, second: Array) -> bool:
    return bool((np.abs(np.sum(first * second, axis=1)) > 1 - 1e-9).all())


def same(first: Track, second: Track) -> bool:
    return (
        np.allclose(first.time_s, second.time_s, atol=1e-6)
        and np.allclose(first.position_m, second.position_m, atol=1e-6)
        and same_attitudes(first.quaternion_wxyz, second.quaternion_wxyz)
    )


def write_csv(path: Path, header: str, table: Array, delimiter: str = ",") -> Path:
    np.savetxt(path, table, "%.9f", delimiter, header=header, comments="")
    return path


def rotation(quaternion: Array) -> Array:
    """Matrix of one quaternion, column by column, without the code under test."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


# Formats


def test_tum_reads_back_as_written(tmp_path: Path) -> None:
    write_tum(tmp_path / "a.tum", spiral())
    assert same(read_track(tmp_path / "a.tum"), spiral())
    (tmp_path / "a.tum").rename(tmp_path / "a.txt")
    assert same(read_track(tmp_path / "a.txt"), spiral())


def test_the_triad_openvr_preset(tmp_path: Path) -> None:
    track = spiral()
    x, y, z = track.position_m.T
    w, _, _, qz = track.quaternion_wxyz.T
    junk = np.zeros_like(x)
    # OpenVR: x right, y up, -z forward; ours turned so that y is up.
    table = np.column_stack([track.time_s, x, z, -y, junk, junk, junk, w, junk, qz, junk])
    path = write_csv(tmp_path / "v.csv", "time,x,y,z,yaw,pitch,roll,r_w,r_x,r_y,r_z", table)
    (tmp_path / "track.toml").write_text('preset = "triad-openvr"\n')
    assert same(read_track(path, read_track_format(tmp_path)), track)
    table[:, 1:4] *= 1000
    write_csv(path, "time,x,y,z,yaw,pitch,roll,r_w,r_x,r_y,r_z", table)
    (tmp_path / "track.toml").write_text('preset = "triad-openvr"\nposition_unit = "mm"\n')
    assert same(read_track(path, read_track_format(tmp_path)), track)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_by_number_and_other_delimiters(tmp_path: Path, delimiter: str) -> None:
    track = spiral()
    table = np.column_stack([track.quaternion_wxyz, track.position_m, track.time_s * 1000])
    np.savetxt(tmp_path / "a.csv", table, "%.9f", delimiter)
    form = track_format(
        {
            "time": 8,
            "time_unit": "ms",
            "position": [5, 6, 7],
            "quaternion": [1, 2, 3, 4],
            "quaternion_order": "w-first",
        }
    )
    assert same(read_track(tmp_path / "a.csv", form), track)


def test_spreadsheets_quotes_and_byte_order_marks_are_read(tmp_path: Path) -> None:
    rows = "".join(f'"{i / 50}", {i},0,0\r\n' for i in range(20))
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbf" + f'"t",x,"y",yaw\r\n{rows}'.encode())
    form = track_format(
        {"time": "t", "position": ["x", "y", "y"], "euler": ["yaw"], "euler_axes": "z"}
    )
    track = read_track(tmp_path / "a.csv", form)
    assert track.position_m[:3, 0].tolist() == [0, 1, 2]
    assert len(track) == 20


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_euler_angles_serve_where_there_is_no_quaternion(tmp_path: Path, unit: str) -> None:
    track = spiral()
    yaw = track.yaw_rad * (180 / np.pi if unit == "deg" else 1)
    table = np.column_stack([track.time_s, track.position_m, yaw, 0 * yaw, 0 * yaw])
    path = write_csv(tmp_path / "e.csv", "t,x,y,z,yaw,pitch,roll", table)
    form = track_format(
        {
            "time": "t",
            "position": ["x", "y", "z"],
            "euler": ["yaw", "pitch", "roll"],
            "euler_unit": unit,
        }
    )
    assert same(read_track(path, form), track)


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_euler_angles_are_intrinsic(angles: tuple[float, float, float]) -> None:
    yaw, pitch, roll = angles
    (quaternion,) = from_euler(np.array([angles]), "zyx")
    turns = [
        (np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])),
        np.array(
            [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
        ),
        np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]),
    ]
    assert np.allclose(rotation(quaternion), turns[0] @ turns[1] @ turns[2], atol=1e-9)


def test_an_axis_may_come_twice_in_a_row() -> None:
    twice, once = from_euler(np.array([[0.5, 0.7]]), "zz"), from_euler(np.array([[1.2]]), "z")
    assert np.allclose(twice, once)


def pose_message(track: Track, row: int) -> PoseInFrame:
    message = PoseInFrame(frame_id="world")
    message.timestamp.FromNanoseconds(round(track.time_s[row] * 1e9))
    place, turn = message.pose.position, message.pose.orientation
    place.x, place.y, place.z = track.position_m[row]
    turn.w, turn.x, turn.y, turn.z = track.quaternion_wxyz[row]
    return message


def transform_message(track: Track, row: int) -> FrameTransform:
    message = FrameTransform(parent_frame_id="world", child_frame_id="tracker")
    message.timestamp.FromNanoseconds(round(track.time_s[row] * 1e9))
    place, turn = message.translation, message.rotation
    place.x, place.y, place.z = track.position_m[row]
    turn.w, turn.x, turn.y, turn.z = track.quaternion_wxyz[row]
    return message


def write_mcap(
    path: Path, track: Track, topics: tuple[str, ...], make: Callable = pose_message
) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = register_schema(writer, type(make(track, 0)))
        channels = [writer.register_channel(topic, "protobuf", schema) for topic in topics]
        for row in range(len(track)):
            for channel in channels:
                data = make(track, row).SerializeToString()
                # The log's own times are of no interest: here they are all the same.
                writer.add_message(channel, 1, data, 1, row)
        writer.finish()


@pytest.mark.parametrize("make", [pose_message, transform_message])
def test_foxglove_poses_in_mcap(tmp_path: Path, make: Callable) -> None:
    write_mcap(tmp_path / "a.mcap", spiral(), ("/pose",), make)
    assert same(read_track(tmp_path / "a.mcap"), spiral())


@pytest.mark.parametrize("frame", ["", "map", "odom"])
def test_ros_poses_in_mcap(tmp_path: Path, frame: str) -> None:
    track = spiral()
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", b"")
        channel = writer.register_channel("/pose", "cdr", schema)
        for row in range(len(track)):
            nanoseconds = round(track.time_s[row] * 1e9)
            name = frame.encode() + b"\0"
            body = struct.pack("<iII", *divmod(nanoseconds, 10**9), len(name)) + name
            body += b"\0" * (-len(body) % 8)
            w, x, y, z = track.quaternion_wxyz[row]
            body += struct.pack("<7d", *track.position_m[row], x, y, z, w)
            writer.add_message(channel, nanoseconds, b"\0\1\0\0" + body, nanoseconds, row)
        writer.finish()
    assert same(read_track(tmp_path / "a.mcap"), track)


def test_a_topic_must_be_chosen_where_there_are_several(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", spiral(), ("/left", "/right"))
    with pytest.raises(ConfigurationError, match=r'/left, /right; choose .* topic = "/left"'):
        read_track(tmp_path / "a.mcap")
    assert same(read_track(tmp_path / "a.mcap", track_format({"topic": "/right"})), spiral())
    with pytest.raises(ConfigurationError, match="no poses on topic '/up'"):
        read_track(tmp_path / "a.mcap", track_format({"topic": "/up"}))


def small_chunks(path: Path, compression: CompressionType = CompressionType.ZSTD) -> list[int]:
    """Many of them, as a live recorder writes them; where each begins."""
    starts: list[int] = []
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=10**9, compression=compression)
        writer.start()
        schema = register_schema(writer, PoseInFrame)
        channel = writer.register_channel("/pose", "protobuf", schema)
        for row in range(60):
            writer.add_message(channel, row, pose_message(spiral(), row).SerializeToString(), row)
            if row % 6 == 5:
                starts.append(file.tell())
                writer.flush()
        writer.finish()
    return starts


@pytest.mark.parametrize("compression", CompressionType)
def test_a_bad_chunk_costs_its_own_poses(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, compression: CompressionType
) -> None:
    path = tmp_path / "a.mcap"
    name = "" if compression == CompressionType.NONE else compression.name.lower()
    size_at = small_chunks(path, compression)[2] + 9 + 32 + len(name)
    data = path.read_bytes()
    # As it was with a bit flipped behind; nonsense; a terabyte.
    for size in (data[size_at : size_at + 8], b"\xff" * 8, (1 << 40).to_bytes(8, "little")):
        broken = bytearray(data)
        broken[size_at : size_at + 8] = size
        broken[size_at + 28] ^= 16
        path.write_bytes(broken)
        caplog.clear()
        assert len(read_track(path)) == 54
        assert [len(record.getMessage().splitlines()) for record in caplog.records] == [1]
        assert "9 of 10 chunks" in caplog.text


@pytest.mark.parametrize("compression", CompressionType)
def test_no_damage_makes_the_reader_of_mcap_fail_otherwise(
    tmp_path: Path, compression: CompressionType
) -> None:
    path = tmp_path / "a.mcap"
    small_chunks(path, compression)
    data, noise = path.read_bytes(), random.Random(17)
    read = 0
    for _ in range(500):
        broken = bytearray(data)
        for _ in range(noise.choice((1, 1, 3, 20))):
            broken[noise.randrange(len(data))] = noise.randrange(256)
        path.write_bytes(broken[: noise.choice((len(data), noise.randrange(len(data))))])
        with suppress(ConfigurationError):
            read += len(read_track(path)) > 0
    assert read > 250


def test_a_cut_mcap_gives_what_is_whole(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.mcap"
    small_chunks(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert 10 <= len(read_track(path)) < 60
    assert "cut off" in caplog.text
    path.write_bytes(b"no mcap at all")
    with pytest.raises(ConfigurationError, match="is not an MCAP recording"):
        read_track(path)


# Frames


@given(st.sampled_from(UPS), st.sampled_from(["right", "left"]), st.integers(0, 2**32 - 1))
def test_every_frame_can_be_undone(up: str, handedness: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    position, quaternion = random.normal(size=(5, 3)), random.normal(size=(5, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    there = to_our_frame(position, quaternion, up, handedness)
    back = to_file_frame(*there, up, handedness)
    assert np.allclose(back[0], position)
    assert np.allclose(back[1], quaternion)
    assert np.allclose(np.linalg.norm(there[0], axis=1), np.linalg.norm(position, axis=1))


@given(st.sampled_from(UPS), st.sampled_from(["right", "left"]), st.integers(0, 2**32 - 1))
def test_up_becomes_z_and_attitudes_turn_along(up: str, handedness: str, seed: int) -> None:
    """A point fixed to the tracker must be where it was, seen in the new frame."""
    random = np.random.default_rng(seed)
    quaternion = random.normal(size=(1, 4))
    quaternion /= np.linalg.norm(quaternion)
    arm = random.normal(size=3)
    none = np.array([[1.0, 0, 0, 0]])
    axis = np.zeros((1, 3))
    axis[0, "xyz".index(up[-1])] = -1 if up.startswith("-") else 1
    assert np.allclose(to_our_frame(axis, none, up, handedness)[0], [[0, 0, 1]])
    world = (rotation(quaternion[0]) @ arm)[None]  # the arm's end, in the file's frame
    turned = to_our_frame(world, quaternion, up, handedness)
    own_arm = to_our_frame(arm[None], none, up, handedness)[0][0]
    assert np.allclose(rotation(turned[1][0]) @ own_arm, turned[0][0])


def test_only_a_left_handed_frame_turns_the_other_way() -> None:
    track = spiral()
    for up in UPS:
        raw = to_file_frame(track.position_m, track.quaternion_wxyz, up, "right")
        right = Track(track.time_s, *to_our_frame(*raw, up, "right"))
        left = Track(track.time_s, *to_our_frame(*raw, up, "left"))
        assert right.yaw_rad[-1] == pytest.approx(3 * np.pi)
        assert left.yaw_rad[-1] == pytest.approx(-3 * np.pi)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_yaw_is_the_same_for_any_mount(mount: tuple[float, float, float, float]) -> None:
    track = spiral()
    turned = track.attitudes * Rotation.from_quat(mount, scalar_first=True)
    quaternion = turned.as_quat(scalar_first=True)
    mounted = Track(track.time_s, track.position_m, quaternion)
    assert np.allclose(mounted.yaw_rad, track.yaw_rad, atol=1e-6)
    up = mounted.up_in_tracker
    assert np.allclose(up, up[0])
    assert np.allclose(up[0], rotation(quaternion[0]).T @ [0, 0, 1])


# Bad files


def bad(path: Path, form: TrackFormat | None = None) -> str:
    with pytest.raises(ConfigurationError) as caught:
        read_track(path, form)
    text = str(caught.value)
    assert "\n" not in text
    assert path.name in text
    return text


def tum(path: Path, rows: list[list[float | str]]) -> Path:
    path.write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
    return path


def rows(count: int = 20) -> list[list[float | str]]:
    return [[i / 90, i / 200, 0, 0, 0, 0, 0, 1] for i in range(count)]


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((5, 0), 0.0, "line 6: time is 0.000000 after 0.044444, expected to rise"),
        ((5, 0), 4 / 90, "expected to rise (1 such places)"),
        ((7, 3), "1,5", "expected a number with a decimal point"),
    ],
)
def test_a_bad_value_is_named_with_its_line(
    tmp_path: Path, place: tuple[int, int], value: float | str, words: str
) -> None:
    table = rows()
    table[place[0]][place[1]] = value
    assert words in bad(tum(tmp_path / "a.tum", table))


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((7, 1), "nan", "1 of 20 were lost, the first in line 8"),
        ((7, 3), "inf", "1 of 20 were lost, the first in line 8"),
        ((7, 7), 0.5, "1 of 20 have no quaternion of length 1, the first in line 8"),
    ],
)
def test_poses_that_are_none_are_left_out_and_counted(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    place: tuple[int, int],
    value: float | str,
    words: str,
) -> None:
    table = rows()
    table[place[0]][place[1]] = value
    track = read_track(tum(tmp_path / "a.tum", table))
    assert len(track) == 19
    assert not (track.time_s == float(rows()[7][0])).any()
    assert [record.getMessage().count(words) for record in caplog.records] == [1]


def test_wrong_columns_are_no_bad_poses(tmp_path: Path) -> None:
    table = [[*row[:7], 0.5] for row in rows()]
    assert "line 1: the quaternion's length is 0.500, expected 1" in bad(
        tum(tmp_path / "a.tum", table)
    )


def test_hardly_any_pose_left_is_refused_with_the_reason(tmp_path: Path) -> None:
    table = [[*row[:3], "nan", *row[4:]] for row in rows(12)] + rows(9)
    assert "holds 9 poses, expected at least 10; 12 of 21 were lost, the first in line 1" in bad(
        tum(tmp_path / "a.tum", table)
    )


MOTIVE = (
    "Format Version,1.23,Take Name,a,Capture Frame Rate,30\n\n,Type" + ",Rigid Body" * 7 + "\n"
    ",Name"
    + ",mbot" * 7
    + "\n,ID"
    + ",1" * 7
    + "\n,,"
    + "Rotation," * 4
    + "Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
)
VICON = (
    "\ufeffObjects\n30\n,,Global Angle mbot:mbot,,,,,,\n"
    "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n,,rad,rad,rad,mm,mm,mm\n"
)


def test_a_header_of_many_lines_and_lost_cells_are_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As Motive writes it: names that come twice, and nothing where the body was lost."""
    track, path = spiral(), tmp_path / "a.csv"
    lines = [
        f"{n},{t:.4f},"
        + ("," * 6 if n in (20, 21) else f"{q[1]},{q[2]},{q[3]},{q[0]},{p[0]},{p[1]},{p[2]}")
        for n, (t, p, q) in enumerate(
            zip(track.time_s, track.position_m, track.quaternion_wxyz, strict=True)
        )
    ]
    path.write_text(MOTIVE + "\n".join(lines) + "\n")
    form = track_format({"time": 2, "position": [7, 8, 9], "quaternion": [3, 4, 5, 6]})
    kept = np.isin(np.arange(len(track)), (20, 21), invert=True)
    assert same(read_track(path, form), track.where(kept))
    assert "2 of 60 were lost, the first in line 28" in caplog.text
    named = track_format({"time": "Time (Seconds)", "position": ["X", "Y", "Z"]})
    assert "line 7: column 'X' is twice or more" in bad(path, named)


def test_numbers_of_frames_are_no_time_until_it_is_said_how_many_there_are(tmp_path: Path) -> None:
    """As Vicon writes it: no time, a rotation vector, and units below the names."""
    track, path = spiral(), tmp_path / "a.csv"
    turns = track.attitudes.as_rotvec()
    table = np.column_stack([np.arange(1, 61), np.zeros(60), turns, 1000 * track.position_m])
    path.write_text(VICON + "\n".join(",".join(f"{v:.9f}" for v in row) for row in table) + "\n")
    settings: dict[str, object] = {
        "time": "Frame",
        "position": ["TX", "TY", "TZ"],
        "position_unit": "mm",
        "rotation_vector": ["RX", "RY", "RZ"],
        "euler_unit": "rad",
    }
    assert "no column of time: 'Frame' counts by one" in bad(path, track_format(settings))
    read = read_track(path, track_format(settings | {"frames_hz": 90}))
    shifted = Track(read.time_s - read.time_s[0] + track.time_s[0], *poses(read))
    assert same(shifted, track)


def poses(track: Track) -> tuple[Array, Array]:
    return track.position_m, track.quaternion_wxyz


def test_a_position_of_two_columns_is_on_the_floor(tmp_path: Path) -> None:
    track, path = spiral(), tmp_path / "a.csv"
    table = np.column_stack([track.time_s, track.position_m[:, :2], track.yaw_rad])
    write_csv(path, "t,x,y,yaw", table)
    settings: dict[str, object] = {
        "time": "t",
        "position": ["x", "y"],
        "euler": ["yaw"],
        "euler_axes": "z",
        "euler_unit": "rad",
    }
    read = read_track(path, track_format(settings))
    np.testing.assert_allclose(read.position_m[:, :2], track.position_m[:, :2], atol=1e-6)
    assert not read.position_m[:, 2].any()
    with pytest.raises(ValueError, match="on the floor and up is z, not y"):
        track_format(settings | {"up": "y"})


def test_a_short_line_is_named(tmp_path: Path) -> None:
    table = rows()
    table[-1] = table[-1][:4]
    assert "line 20: 4 fields, so there is no column 5; was the file cut off?" in bad(
        tum(tmp_path / "a.tum", table)
    )


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_in_another_unit_are_named(tmp_path: Path, unit: str, factor: float) -> None:
    table = [[float(row[0]) * factor, *row[1:]] for row in rows()]
    text = bad(tum(tmp_path / "a.tum", table))
    assert f'in {unit} it would be 90 a second: set time_unit = "{unit}"' in text
    assert len(read_track(tmp_path / "a.tum", track_format({"time_unit": unit}))) == 20


def test_seconds_declared_as_milliseconds_are_named(tmp_path: Path) -> None:
    text = bad(tum(tmp_path / "a.tum", rows()), track_format({"time_unit": "ms"}))
    assert 'set time_unit = "s"' in text


def test_files_that_are_none_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    assert "can't read" in bad(path)
    path.write_bytes(b"\xff\xfe\x00")
    assert "it is not text" in bad(path)
    path.write_text("# only a comment\n\n")
    assert "is empty" in bad(path)
    assert "ends in '.bag'" in bad(tmp_path / "a.bag")
    with pytest.raises(ConfigurationError, match=r"a\.tum"):
        read_table(path, TrackFormat())
    with pytest.raises(ConfigurationError, match=r"a\.tum"):
        read_mcap(path)


def test_a_csv_file_without_a_declaration_is_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", "time,x", np.zeros((20, 2)))
    assert "needs a track.toml beside it" in bad(path)
    assert "column 'r_w' is not among time, x" in bad(path, PRESETS["triad-openvr"]) or (
        "column 'y' is not among time, x" in bad(path, PRESETS["triad-openvr"])
    )
    path.write_text("1,2,3\n" * 20)
    assert "has no header" in bad(path, PRESETS["triad-openvr"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('preset = "vive"', "expected 'tum' or 'triad-openvr'"),
        ('colour = "red"', "colour"),
        ('up = "north"', "$.up"),
        ('position_unit = "km"', "$.position_unit"),
        ('quaternion_order = "wxyz"', "$.quaternion_order"),
        ('euler = ["yaw"]', "euler has 1 columns, euler_axes 'zyx' has 3 letters"),
        ('euler = ["yaw"]\neuler_axes = "q"', "$.euler_axes"),
        ("time = 0", "$.time"),
        ("time", "track.toml"),
    ],
)
def test_a_bad_declaration_is_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "track.toml").write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        read_track_format(tmp_path)
    assert words in str(caught.value)
    assert "track.toml" in str(caught.value)


@given(st.binary(max_size=400))
def test_no_bytes_make_a_reader_fail_otherwise(tmp_path_factory, data: bytes) -> None:
    folder = tmp_path_factory.mktemp("bytes")
    for name in ("a.tum", "a.csv", "a.mcap"):
        (folder / name).write_bytes(data)
        with pytest.raises(ConfigurationError):
            read_track(folder / name, PRESETS["tum"])


@given(
    st.lists(
        st.lists(st.sampled_from(["1", "0", "-2.5", "nan", "1e400", "", "x", "0.1"]), max_size=9),
        max_size=30,
    )
)
def test_no_table_makes_a_reader_fail_otherwise(tmp_path_factory, table: list[list[str]]) -> None:
    path = tmp_path_factory.mktemp("tables") / "a.csv"
    path.write_text("\n".join(",".join(row) for row in table))
    with pytest.raises(ConfigurationError):
        read_track(path, PRESETS["tum"])


def test_a_track_checks_itself() -> None:
    track = spiral()
    with pytest.raises(ValueError, match="expected at least 2"):
        track.where(np.arange(len(track)) == 3)
    with pytest.raises(ValueError, match="does not rise"):
        Track(track.time_s[::-1], track.position_m, track.quaternion_wxyz)
    with pytest.raises(ValueError, match="unit length"):
        Track(track.time_s, track.position_m, 2 * track.quaternion_wxyz)
    with pytest.raises(ValueError, match="not finite"):
        Track(track.time_s, np.full((60, 3), np.inf), track.quaternion_wxyz)
    with pytest.raises(ValueError, match="expected"):
        Track(track.time_s, track.position_m[:, :2], track.quaternion_wxyz)
    assert track.between(99, 100) is None

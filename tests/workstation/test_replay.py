"""A recorded drive is a test of the daemon: its own program has to decide the same again."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from mbot_protocol.beat.recorded_drive import (
    Beat,
    RecordedDrive,
    read_drive,
    read_drives,
)
from mbot_protocol.drive.actions import AS_BUILT, Steps
from mbot_protocol.errors import ConfigurationError, ContractError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView, PolicyMetadata
from mbot_workstation.cli.drives import DIFFERS
from mbot_workstation.cli.presenter import plain
from mbot_workstation.cli.subcommands import app
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.look.drives import replay_words
from mbot_workstation.look.drives.replayed_drive import TOLERANCE, Redecided, replay
from mbot_workstation.pictures.film_tile import TILE_PX, Bar, blank, caption_px, draw_tile
from mbot_workstation.pictures.picture_file import observation

from ..robot.tiny_models import constant_model, counting_model
from .hand_driven import BY_HAND, BY_POLICY, hand_driven
from .samples import decision, picture

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"
"""Driven on the virtual robot by `seeing_model`: a stop and a run, an acknowledgement that came too
late, and in the end the daemon was killed."""

MODEL = RECORDED / "seeing.onnx"


def test_a_recording_is_read_beat_by_beat(drive: RecordedDrive) -> None:
    assert (drive.robot_id, drive.name) == ("virtual", "recorded-drive")
    assert len(drive.beats) == 13
    assert len(drive.decided) == 12
    assert drive.words == ("000.mcap: 5 of 5 chunks read, it was never ended properly",)
    assert [words for _, words in drive.log][1:3] == ["now running", "now stopped"]
    assert drive.duration_s == pytest.approx(4.8, abs=0.1)
    assert drive.facts is not None
    assert drive.facts.decision_rate_hz == 2.5
    seen = observation(drive.beats[0])
    assert seen is not None
    assert seen.shape == (64, 64, 3)


def test_a_recording_of_before_duties_tells_the_same_speeds(drive: RecordedDrive) -> None:
    beat = drive.beats[10]
    assert not beat.decision.HasField("duty")
    assert (beat.decision.board_m1, beat.decision.board_m2) == (54, 255)
    assert drive.facts is not None
    assert drive.facts.wheels == AS_BUILT
    steps = beat.decision.steps
    told = AS_BUILT.duties(Steps(steps.left, steps.right))
    assert AS_BUILT.levels(told) == (54, 255)
    assert AS_BUILT.of_levels(54, 255) == told


def test_the_daemon_decides_the_same_again(drive: RecordedDrive) -> None:
    found = replay(drive, [MODEL])
    assert found.same_model
    assert len(found.decisions) == 12
    assert found.same_motor_bytes == 12
    assert found.largest_difference <= TOLERANCE
    assert found.is_as_expected or not found.same_processor


def test_a_memory_that_is_not_zeroed_where_the_robot_zeroed_it_is_found(
    drive: RecordedDrive,
) -> None:
    beats = []
    for beat in drive.beats:
        assert beat.policy_input is not None
        goes_on = msgspec.structs.replace(beat.policy_input, began_anew=False)
        beats.append(replace(beat, policy_input=goes_on))
    found = replay(replace(drive, beats=tuple(beats)), [MODEL])
    assert not found.is_as_expected
    assert found.largest_difference > 0.01
    assert any("differs by" in line for line in replay_words.lines(found))


def test_after_a_gap_it_goes_on_with_the_recorded_memory(drive: RecordedDrive) -> None:
    without_one = [beat for index, beat in enumerate(drive.beats) if index != 4]
    found = replay(replace(drive, beats=tuple(without_one)), [MODEL])
    assert len(found.decisions) == 11
    assert found.largest_difference <= TOLERANCE


def test_what_another_model_would_have_done(drive: RecordedDrive, tmp_path: Path) -> None:
    other = tmp_path / "other.onnx"
    other.write_bytes(constant_model(0.9, -0.9))
    found = replay(drive, [], other)
    assert not found.same_model
    assert found.is_as_expected
    assert found.largest_difference > 0.1
    lines = list(replay_words.lines(found))
    assert max(len(line) for line in lines) <= 80
    assert sum(" s  " in line for line in lines) == sum(
        one.difference > replay_words.NOTABLE for one in found.decisions
    )
    strip = replay_words.strip(found)
    assert strip.shape[1] == 8 + 6 * (TILE_PX + 8)
    assert len(np.unique(strip)) > 50


def with_view(drive: RecordedDrive, horizontal_deg: float, vertical_deg: float) -> RecordedDrive:
    """The same, by a robot that says which field of view its pictures show."""
    beats = [
        replace(
            beat,
            policy_input=msgspec.structs.replace(
                beat.policy_input,
                view_horizontal_deg=horizontal_deg,
                view_vertical_deg=vertical_deg,
            ),
        )
        for beat in drive.beats
        if beat.policy_input is not None
    ]
    return replace(drive, beats=tuple(beats))


@pytest.mark.slow
def test_a_model_that_wants_to_see_another_view_is_noticed(
    drive: RecordedDrive, tmp_path: Path
) -> None:
    other = tmp_path / "other.onnx"
    wide = PolicyMetadata("wide", FieldOfView(80.0, 60.0)).to_properties()
    other.write_bytes(constant_model(0.9, -0.9, metadata=wide))
    found = replay(with_view(drive, 55.3, 42.9), [], other)
    assert found.other_views == ((FULL_VIEW, FieldOfView(80.0, 60.0)),)
    lines = list(replay_words.lines(found))
    assert "  it wants to see 80 x 60 degrees, the pictures show 55.3 x 42.9 degrees:" in lines
    assert max(len(line) for line in lines) <= 80
    shown = {"shown_deg": [55.3, 42.9], "wanted_deg": [80.0, 60.0]}
    assert plain(replay_words.replay_answer(found).other_views) == [shown]

    assert replay(with_view(drive, 80, 60), [], other).other_views == ()
    assert replay(with_view(drive, 55.3, 42.9), [MODEL]).other_views == ()
    older = replay(drive, [], other)
    assert older.other_views == ((None, FieldOfView(80.0, 60.0)),)
    assert any("this older recording does not say" in line for line in replay_words.lines(older))
    assert replay(drive, [MODEL]).other_views == (), "what drove has made them"
    with pytest.raises(ConfigurationError, match="expected 1 to 170"):
        replay(with_view(drive, 900, 60), [], other)


def test_a_recording_that_cannot_be_replayed_says_why(drive: RecordedDrive, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"model 93277d5c321b drove, and none of 1 files"):
        replay(drive, [RECORDED / "000.mcap"])
    path = tmp_path / "telemetry.mcap"
    with TelemetryFile(path, "mbot-1") as recording:
        recording.write(picture(decision(0).unix_time_ns))
        recording.write(decision(0))
    with pytest.raises(ConfigurationError, match="fetch the robot's own recording"):
        replay(read_drives([path])[0], [MODEL])
    with pytest.raises(ConfigurationError, match="holds no recording"):
        read_drive(tmp_path / "..")
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ConfigurationError, match=r"nothing to be seen .*0 of . chunks"):
        read_drive(path)


def test_of_a_hands_drive_replay_says_that_it_was_one(tmp_path: Path) -> None:
    drive = read_drive(hand_driven(tmp_path / "drive"))
    with pytest.raises(ConfigurationError, match="a person drove it") as refused:
        replay(replace(drive, beats=drive.beats[BY_POLICY:]), [MODEL])
    assert "fetch" not in str(refused.value), "there is nothing more to be fetched"


def test_another_model_is_asked_beside_a_hand_too(tmp_path: Path) -> None:
    drive = read_drive(hand_driven(tmp_path / "drive"))
    other = tmp_path / "other.onnx"
    other.write_bytes(constant_model(0.9, -0.9))
    found = replay(drive, [], other)
    by_hand = [one for one in found.decisions if one.beat.by_hand]
    assert len(by_hand) == len(found.decisions) - BY_POLICY == BY_HAND
    assert {one.action_then for one in by_hand} == {(0.4, -0.2)}
    said = list(replay_words.summary(found))
    assert "      4 beats by policy: mean difference of a wheel 0.900" in said
    assert "      6 beats by hand: mean difference of a wheel 0.600" in said
    assert not any("no decision" in line for line in said)
    answer = replay_words.replay_answer(found)
    assert answer.mean_difference == pytest.approx({"policy": 0.9, "hand": 0.6})
    assert [one.by_hand for one in answer.differing].count(True) == BY_HAND


def test_beside_a_hand_another_model_goes_on_with_what_the_hand_did(tmp_path: Path) -> None:
    """Left: an eighth of the decisions remembered; right: what the left wheel was told."""
    drive = read_drive(hand_driven(tmp_path / "drive"))
    for beat in drive.beats:
        beat.decision.ClearField("would_have_done")  # who drove was not asked beside the hand
    other = tmp_path / "other.onnx"
    other.write_bytes(counting_model())
    answers = [one.action for one in replay(drive, [], other).decisions]
    assert [left for left, _ in answers] == [number / 8 for number in range(10)]
    assert [right for _, right in answers[5:]] == pytest.approx([0.4] * 5)
    alone = replace(drive, beats=(*drive.beats[:2], *drive.beats[5:]))
    lefts = [one.action[0] for one in replay(alone, [], other).decisions]
    assert lefts == [0, 1 / 8, 0, 1 / 8, 2 / 8, 3 / 8, 4 / 8], "after a gap it starts over"


def test_what_is_wrong_with_a_model_reaches_the_person(
    drive: RecordedDrive, tmp_path: Path
) -> None:
    path = tmp_path / "no.onnx"
    path.write_bytes(b"no")
    with pytest.raises(ContractError, match="not an ONNX model"):
        replay(drive, [], path)


def seen_by(
    drive: RecordedDrive, model: bytes, folder: Path, *beats: tuple[int, dict[str, object]]
) -> list[Redecided]:
    """A model that drove asked again, for the recording's first beats with these changes."""
    path = folder / "model.onnx"
    path.write_bytes(model)
    sha256 = hashlib.sha256(model).hexdigest()
    made: list[Beat] = []
    for beat, (sequence, changes) in zip(drive.decided, beats, strict=False):
        assert beat.policy_input is not None
        decision = type(beat.decision)()
        decision.CopyFrom(beat.decision)
        decision.model_sha256, decision.sequence = sha256, sequence
        known = msgspec.structs.replace(beat.policy_input, **changes)
        made.append(replace(beat, decision=decision, policy_input=known))
    return list(replay(replace(drive, beats=tuple(made)), [path]).decisions)


def test_it_goes_on_with_its_own_memory_and_what_the_wheels_were_told(
    drive: RecordedDrive, tmp_path: Path
) -> None:
    """Left: an eighth of the decisions remembered; right: what the left wheel was told."""
    first = (1, {"began_anew": True, "memory": None})
    second = (2, {"began_anew": False, "memory": np.float32(1).tobytes()})
    third = (9, {"began_anew": False, "memory": np.float32(4).tobytes()})
    lost = (11, {"began_anew": False, "memory": b"of another model"})
    found = seen_by(drive, counting_model(), tmp_path, first, second, third, lost)
    assert [one.action[0] for one in found] == [0.0, 0.125, 0.5, 0.0]
    told = [one.beat.told for one in found]
    assert [one.action[1] for one in found[1:3]] == [
        pytest.approx(one[0]) for one in told[1:3] if one
    ]
    assert [one.same_memory for one in found[1:]] == [True, True, False]


def test_a_model_that_fails_says_so_and_goes_on(drive: RecordedDrive, tmp_path: Path) -> None:
    found = seen_by(drive, constant_model(float("nan"), 0.0), tmp_path, *[(7, {})] * 4)
    assert len(found) == 4
    assert all("expected two finite numbers" in one.failure for one in found)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(MODEL, tmp_path)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["replay", str(RECORDED), "--strip", "out/strip.png"])
    assert "recorded-drive: 12 decisions" in result.stdout
    assert (tmp_path / "out" / "strip.png").is_file()
    result = CliRunner().invoke(app, ["replay", str(RECORDED / "000.mcap"), "--json"])
    found = json.loads(result.stdout)
    assert found["decisions"] == 12
    assert found["same_model"]
    assert result.exit_code == (0 if found["as_expected"] else DIFFERS)


def test_a_tile_shows_picture_and_wheels() -> None:
    area = blank(TILE_PX + caption_px(2), TILE_PX)
    draw_tile(area, np.zeros((64, 64, 3), np.uint8), "0.4 s", [Bar("L", 1.0), Bar("R", -2.0)])
    assert not area[:TILE_PX].any()
    colours = {tuple(pixel) for pixel in area[TILE_PX:].reshape(-1, 3).tolist()}
    assert {(20, 130, 60), (200, 90, 20)} <= colours

"""Fetched drives looked through: judged, labelled, split by drive, exported; strangers' too."""

import csv
import importlib
import json
import math
import os
import re
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from mbot_protocol.beat.beat import Beat, PolicyInput
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView
from mbot_protocol.v1.messages_pb2 import Decision, State
from mbot_workstation.cli.subcommands import app
from mbot_workstation.learn.evaluation.labelled_pictures import observations, read_labelled
from mbot_workstation.look.collect import exports
from mbot_workstation.look.collect.lerobot_set import episodes
from mbot_workstation.look.collect.moments import (
    SHAPE,
    differences,
    interventions,
    is_marked,
    marks,
)
from mbot_workstation.look.collect.review_page import review_page, reviewed
from mbot_workstation.look.collect.reviews import (
    Place,
    Review,
    drives_in,
    kept_for,
    read_review,
    review_file,
    split,
    write_review,
)
from mbot_workstation.pictures.picture_file import decode_picture, observation, read_picture

from .hand_driven import FACTS, hand_driven

SEVERAL = 5


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    for number in range(SEVERAL):
        hand_driven(tmp_path / "drives" / "mbot-1" / f"drive-{number:04d}", seed=number + 1)
    return tmp_path / "drives"


def said(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["drives", *map(str, arguments)])
    if result.exception is not None:
        raise result.exception
    return result.output


def one(drives: Path, number: int = 0) -> Path:
    return drives / "mbot-1" / f"drive-{number:04d}"


def test_what_is_worth_a_look_is_found(drives: Path) -> None:
    drive = read_drive(one(drives))
    (hand,) = interventions(drive)
    assert (hand.since_s, hand.until_s) == pytest.approx((1.6, 3.6))
    assert hand.words == "anna@desk drove by hand"
    (wrong,) = marks(drive)
    assert (wrong.since_s, wrong.until_s) == pytest.approx((1.0, 4.0))
    assert wrong.words == "max says that this was wrong"
    assert [is_marked(drive, [wrong], beat) for beat in drive.beats] == [False] * 3 + [True] * 8
    found = differences(drive, 3)
    assert [one.size for one in found] == sorted((one.size for one in found), reverse=True)
    assert found[0].hand == (0.4, -0.2)
    assert found[0].size == pytest.approx(0.7)


def test_a_persons_words_stand_beside_the_drive_and_not_in_it(drives: Path) -> None:
    path = one(drives)
    before = (path / "000.mcap").read_bytes()
    said("keep", path, "--for", "judging")
    said("label", path, 104, "--at", "0.25,0.75")
    said("label", path, 105, "--none")
    assert sorted(p.name for p in path.iterdir()) == ["000.mcap"]
    assert (path / "000.mcap").read_bytes() == before
    assert json.loads(review_file(path).read_text()) == {
        "verdict": "keep",
        "part": "judging",
        "labels": {"104": {"x": 0.25, "y": 0.75}, "105": None},
    }
    said("drop", path)
    assert read_review(path).labels["105"] is None, "nothing that was said is lost"
    assert read_review(one(drives, 1)) == Review()
    found = json.loads(said("list", drives, "--json"))
    assert [row["verdict"] for row in found] == ["drop"] + ["undecided"] * (SEVERAL - 1)
    assert (found[0]["labels"], found[0]["marks"], found[0]["by_hand_s"]) == (2, 1, 2.4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("label", "{one}", "104", "--at", "1.5,0"), "expected two shares"),
        (("label", "{one}", "104", "--at", "nan,0"), "expected two shares"),
        (("label", "{one}", "104", "--at", "0.5"), "expected two shares"),
        (("label", "{one}", "104"), "--at X,Y, --none"),
        (("label", "{one}", "104", "--none", "--at", "0,0"), "--at X,Y, --none"),
        (("label", "{one}", "9", "--none"), "0 pictures of beat 9; expected one of 100 to 110"),
        (("keep", "{one}/.."), "no drive"),
        (("keep", "{one}", "--for", "fun"), "expected training or judging"),
        (("list", "{one}/000"), "no drives in"),
        (("export", "{drives}", "--csv", "{drives}"), "no drive is kept"),
        (("export", "{drives}"), "at least one of"),
    ],
)
def test_what_cannot_be_is_one_line(drives: Path, arguments: tuple[str, ...], words: str) -> None:
    filled = [text.format(one=one(drives), drives=drives) for text in arguments]
    with pytest.raises(ConfigurationError, match=words):
        said(*filled)
    assert not list(drives.rglob("*.review.json"))


@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_a_review_is_read_or_refused(data: bytes) -> None:
    drive = Path("/dev/shm") / "mbot-review-test"
    review_file(drive).write_bytes(data)
    try:
        assert isinstance(read_review(drive), Review)
    except ConfigurationError as error:
        assert "review.json" in str(error)  # noqa: PT017
    finally:
        review_file(drive).unlink()


@pytest.mark.parametrize(
    "text",
    [
        '{"verdict": "burn"}',
        '{"labels": {"../x": null}}',
        '{"labels": {"²": null}}',
        '{"labels": {"1": {"x": 2, "y": 0}}}',
        '{"labels": {"1": {"x": 1e999, "y": 0}}}',
        '{"more": 1}',
        "[" * 5000,
        '{"labels": ' + "{" * 5000,
    ],
)
def test_a_strangers_review_is_refused(tmp_path: Path, text: str) -> None:
    review_file(tmp_path / "drive").write_text(text)
    with pytest.raises(ConfigurationError, match=r"drive\.review\.json"):
        read_review(tmp_path / "drive")


reviews = st.builds(
    Review,
    verdict=st.sampled_from(["undecided", "keep", "drop"]),
    part=st.sampled_from([None, "training", "judging"]),
)


@given(st.lists(reviews, max_size=12), st.floats(0.01, 0.99))
def test_a_split_is_by_drive_and_what_has_been_said_stays(
    given_: list[Review], share: float
) -> None:
    there = {Path(f"drive-{number}"): one for number, one in enumerate(given_)}
    changed = split(there, share)
    for drive, review in changed.items():
        assert there[drive].verdict == "keep"
        assert there[drive].part is None
        assert review.part is not None
    after = there | changed
    kept = [one for one in after.values() if one.verdict == "keep"]
    if kept and any(there[drive].part is None for drive in changed):
        assert any(one.part == "judging" for one in kept)
    assert split(after, share) == {}
    if kept:
        parts = kept_for(after, ("training", "judging"))
        assert not set(parts["training"]) & set(parts["judging"])


def test_labels_become_pictures_that_policies_are_judged_by(drives: Path, tmp_path: Path) -> None:
    for number in range(4):
        said("label", one(drives, number), 100 * (number + 1) + 4, "--at", "0.25,0.75")
        said("label", one(drives, number), 100 * (number + 1) + 5, "--none")
    said("keep", *(one(drives, number) for number in range(4)))
    said("drop", one(drives, 4))
    with pytest.raises(ConfigurationError, match="drives split"):
        said("export", drives, "--pictures", tmp_path / "labelled")
    assert said("split", drives) == "3 kept drives for training, 1 for judging\n"
    words = said("export", drives, "--pictures", tmp_path / "labelled")
    assert "6 for training, 2 for judging" in words
    assert f"workstation evaluate POLICY.onnx --pictures {tmp_path}/labelled/judging" in words
    found = read_labelled(tmp_path / "labelled" / "training")
    assert [one.seen for one in found] == [FieldOfView(55.3, 42.9)] * 6
    bearings = [one.bearing_left_deg for one in found]
    assert bearings == [pytest.approx(14.68, abs=0.01), None] * 3
    drive = read_drive(kept_for(reviews_of(drives), ("training",))["training"][0])
    same = observations(found, None, FULL_VIEW)[0]
    assert np.array_equal(same, shown_at(drive.beats[4])), "nothing is cut out of it again"
    narrow = observations(found, None, FieldOfView(27.65, 21.45))[0]
    assert not np.array_equal(narrow, same), "another policy's view is"
    with pytest.raises(ConfigurationError, match="not empty"):
        said("export", drives, "--pictures", tmp_path / "labelled")
    evaluated = CliRunner().invoke(
        app, ["evaluate", "servo", "--pictures", str(tmp_path / "labelled" / "judging")]
    )
    assert evaluated.exit_code == 0, evaluated.exception
    assert "2" in evaluated.output


def shown_at(beat: Beat) -> Picture:
    seen = observation(beat)
    assert seen is not None
    return seen


def reviews_of(drives: Path) -> dict[Path, Review]:
    return {path: read_review(path) for path in drives_in(drives)}


def test_where_a_click_points_is_where_the_camera_saw_it() -> None:
    view = FieldOfView(60, 40)
    assert exports.bearing_left_deg(Place(0, 0.5), view) == pytest.approx(30)
    assert exports.bearing_left_deg(Place(0.5, 0.9), view) == 0
    assert exports.bearing_left_deg(Place(1, 0.1), view) == pytest.approx(-30)
    half = 0.5 - math.tan(math.radians(15)) / math.tan(math.radians(30)) / 2
    assert exports.bearing_left_deg(Place(half, 0.5), view) == pytest.approx(15)


def test_tables_and_frames_are_of_all_kept_drives(drives: Path, tmp_path: Path) -> None:
    said("keep", one(drives, 0), one(drives, 1), "--for", "training")
    said("keep", one(drives, 2), "--for", "judging")
    said("export", drives, "--csv", tmp_path / "csv", "--frames", tmp_path / "frames")
    names = sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.csv"))
    assert names == [
        "csv/judging/mbot-1-drive-0002.csv",
        "csv/training/mbot-1-drive-0000.csv",
        "csv/training/mbot-1-drive-0001.csv",
    ]
    with (tmp_path / names[1]).open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 11
    assert [row["driven_by"] for row in rows] == [""] * 4 + ["anna@desk"] * 6 + [""]
    assert rows[0]["action_left"] == "0.5"
    assert rows[0]["would_have_done_left"] == ""
    assert rows[4]["action_left"] == ""
    assert float(rows[5]["would_have_done_left"]) == pytest.approx(0.5)
    assert rows[10]["wrong_ms"] == "3000"
    frame = read_picture(tmp_path / "frames/training/mbot-1-drive-0000/00000104.png")
    assert np.array_equal(frame, shown_at(read_drive(one(drives)).beats[4]))


def test_a_lerobot_set_holds_every_beat_that_somebody_drove(drives: Path, tmp_path: Path) -> None:
    said("keep", one(drives, 0), one(drives, 1), "--for", "training")
    words = said("export", drives, "--lerobot", tmp_path / "set")
    assert words == f"{tmp_path}/set: 2 episodes for training, 0 episodes for judging\n"
    there = tmp_path / "set" / "training"
    info = json.loads((there / "meta" / "info.json").read_text())
    file = {"chunk_index": 0, "file_index": 0}
    read: Any = importlib.import_module("pyarrow.parquet").read_table
    table = read(there / info["data_path"].format(**file))
    assert (info["codebase_version"], info["fps"], info["total_frames"]) == ("v3.0", 2.5, 20)
    assert set(table.column_names) == set(info["features"])
    rows = table.to_pylist()
    assert [row["by_hand"] for row in rows] == ([False] * 4 + [True] * 6) * 2
    assert [row["index"] for row in rows] == list(range(20))
    assert [row["episode_index"] for row in rows] == [0] * 10 + [1] * 10
    assert rows[5]["action"] == rows[6]["observation.state"] == pytest.approx([0.4, -0.2])
    assert rows[5]["policy_action"] == pytest.approx([0.5, 0.5])
    assert rows[10]["observation.state"] == [0, 0]
    assert rows[3]["timestamp"] == pytest.approx(3 / 2.5)
    seen = decode_picture(rows[4]["observation.image"]["bytes"])
    assert np.array_equal(seen, shown_at(read_drive(one(drives)).beats[4])), "lossless"  # type: ignore[arg-type]
    told = read(there / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    spans = [(row["dataset_from_index"], row["dataset_to_index"]) for row in told]
    assert spans == [(0, 10), (10, 20)]


@pytest.mark.skipif("MBOT_LEROBOT_PYTHON" not in os.environ, reason="no Python that has lerobot")
def test_lerobots_own_loader_reads_it(drives: Path, tmp_path: Path) -> None:
    """Its requirements clash with ours, so it is asked in an environment of its own."""
    said("keep", one(drives, 0), one(drives, 1), "--for", "training")
    said("export", drives, "--lerobot", tmp_path / "set")
    script = """
import sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
found = LeRobotDataset("mbot/drives", root=sys.argv[1], delta_timestamps={"action": [0, 0.4]})
one = found[5]
print(len(found), found.num_episodes, tuple(one["observation.image"].shape), one["by_hand"].item(),
      one["task"], one["action"].tolist())
"""
    command = [os.environ["MBOT_LEROBOT_PYTHON"], "-c", script, str(tmp_path / "set" / "training")]
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HOME": str(tmp_path)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout.startswith("20 2 (3, 64, 64) True as the robot was driven [[0.4"), (
        done.stderr
    )


def test_a_missing_beat_ends_an_episode(drives: Path) -> None:
    drive = read_drive(one(drives))
    gap = replace(drive, beats=drive.beats[:3] + drive.beats[4:])
    assert [len(one) for one in episodes(gap)] == [3, 6]
    assert [len(one) for one in episodes(drive)] == [10]


def test_without_pyarrow_it_is_one_line(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said("keep", one(drives), "--for", "training")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigurationError, match=r"needs pyarrow: .*\[lerobot\]"):
        said("export", drives, "--lerobot", tmp_path / "set")


def test_the_page_says_what_there_is_and_needs_nothing_else(drives: Path, tmp_path: Path) -> None:
    said("keep", one(drives))
    said("label", one(drives), 104, "--at", "0.25,0.75")
    broken = drives / "mbot-1" / "drive-0009"
    broken.mkdir()
    (broken / "000.mcap").write_bytes(b"no recording")
    page = tmp_path / "review.html"
    result = CliRunner().invoke(app, ["drives", "review", str(drives), "-o", str(page)])
    assert result.exit_code == 0
    assert f"wrote {page}: {SEVERAL} drives" in result.output
    text = page.read_text()
    assert text.count("<section") == SEVERAL
    assert "1 kept, 0 dropped, 4 undecided; 1 labels" in text
    assert "drive-0009/000.mcap is not an MCAP recording" in text, "what could not be read is said"
    assert "driven by hand by anna@desk for 2.4 s" in text
    assert "max says that this was wrong" in text
    assert 'cx="0.25" cy="0.75"' in text
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    with pytest.raises(ConfigurationError, match="exists already"):
        said("review", drives, "-o", page)


def test_a_strangers_drive_does_nothing_to_the_page_or_the_disk(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>\n=cmd|' /C calc'!A0"
    folder = tmp_path / "drives" / "..evil 'x' <b>"
    folder.mkdir(parents=True)
    huge = cv2.imencode(".png", np.zeros((640, 640, 3), np.uint8))[1].tobytes()
    small = cv2.imencode(".png", np.zeros((64, 64, 3), np.uint8))[1].tobytes()
    told = PolicyInput(True, False, 0.0, 0.0, b"", 9000.0, -1.0)
    with closing(BeatWriter(folder / "000.mcap", evil, "test", FACTS)) as writer:
        for number, encoded in enumerate((huge, small, small, b"none")):
            decision = Decision(
                schema_version=1,
                robot_id=evil,
                sequence=min(number, 2) * (2**64 - 1) // 2,
                unix_time_ns=(-1) ** number * (2**63 - 2 - number),
                started_monotonic_ns=(2**64 - 1) * (number % 2),
                state=State.STATE_MANUAL,
                driven_by=evil,
                wrong_ms=2**32 - 1,
                wrong_says=evil,
                board_m1=255,
            )
            decision.would_have_done.left = 3e38
            writer.write(Beat(decision, told, encoded=encoded, is_exact=True))
    drive = read_drive(folder)
    page = review_page([reviewed(folder, folder.name, drive, Review())], [evil])
    assert "<script>alert" not in page
    assert differences(drive, 9)[0].policy == (1.0, 0.0)
    numbers: dict[str, Place | None] = {
        str(beat.decision.sequence): Place(0.5, 0.5) for beat in drive.beats
    }
    write_review(folder, Review("keep", "training", numbers))
    labelled, notes = exports.write_pictures(tmp_path / "out", {"training": [folder]})
    assert labelled == {"training": 0}
    assert len(notes) == len(numbers), "a view of 9000 degrees is none"
    exports.write_tables(tmp_path / "csv", {"training": [folder]})
    exports.write_frames(tmp_path / "frames", {"training": [folder]})
    for path in tmp_path.rglob("*"):
        assert path.resolve().is_relative_to(tmp_path)
    (table,) = (tmp_path / "csv" / "training").iterdir()
    assert re.fullmatch(r"[\w-]+\.csv", table.name)
    assert all(read_picture(p).shape == SHAPE for p in tmp_path.rglob("*.png"))


def test_a_review_survives_as_it_was(tmp_path: Path) -> None:
    review = Review("keep", "judging").with_label(7, Place(0.1, 0.2)).with_label(8, None)
    write_review(tmp_path / "drive", review)
    assert read_review(tmp_path / "drive") == review
    assert msgspec.json.decode(review_file(tmp_path / "drive").read_bytes())["labels"]["8"] is None

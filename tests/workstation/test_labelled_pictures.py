import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.evaluate import evaluate
from mbot_workstation.learn.evaluation.labelled_pictures import Share, judge, read_labelled
from mbot_workstation.learn.evaluation.picture_report import picture_fields
from mbot_workstation.pictures.picture_file import read_picture

from .called import output_of

SIZE = (320, 240)


def write_folder(folder: Path, rows: Sequence[tuple[str, float | None, int]]) -> Path:
    """Pictures of a grey floor with a red square at a column, or none; and their truth."""
    lines = ["file,in_view,bearing_left_deg,distance_m"]
    for name, bearing, column in rows:
        picture = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
        if bearing is not None:
            picture[120:150, column : column + 30] = (35, 30, 200)
        cv2.imwrite(str(folder / name), picture)
        lines.append(f"{name},{int(bearing is not None)},{'' if bearing is None else bearing},1.0")
    (folder / "truth.csv").write_text("\n".join(lines) + "\n")
    return folder


ROWS = [("left.png", 15.0, 60), ("right.png", -15.0, 230), ("ahead.png", 0.5, 145)]


def test_the_servo_turns_the_right_way_and_is_not_fooled(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, [*ROWS, ("none.png", None, 0)])
    (score,) = json.loads(output_of(evaluate, "servo", "--pictures", folder, "--json"))
    assert [score[name]["of"] for name in ("wrong_way", "not_ahead", "fooled")] == [2, 1, 1]
    assert not any(score[name]["pictures"] for name in ("wrong_way", "not_ahead", "fooled"))
    words = output_of(evaluate, "servo", "--pictures", folder)
    assert "0 of 2" in words
    assert "drove on at nothing" in words


def test_another_object_is_refused_beside_pictures(tmp_path: Path) -> None:
    told = ("servo", "--pictures", tmp_path, "--object", "models/objects/green-ball.toml")
    with pytest.raises(ConfigurationError, match="--object does nothing with --pictures"):
        output_of(evaluate, *told)


EXTRA = "file,in_view,bearing_left_deg,distance_m,distractor,plain"


def test_mistakes_are_counted_by_what_is_in_the_picture(tmp_path: Path) -> None:
    rows = [
        "left.png,1,15.0,0.4,,",
        "right.png,1,-15.0,1.0,ball,",
        "ahead.png,1,2.0,0.3,,",
        "between.png,1,5.5,0.3,,",
        "bare.png,0,,,,",
        "carton.png,0,,,,carton",
        "can.png,0,,,can+furniture,",
        "sofa.png,0,,,furniture,carton",
        "slow.png,0,,,cup,",
    ]
    write_folder(tmp_path, [(row.partition(",")[0], None, 0) for row in rows])
    (tmp_path / "truth.csv").write_text("\n".join([EXTRA, *rows]))
    pictures = read_labelled(tmp_path)
    actions = np.array([[1, 0], [0, 1], [0.5, -0.5], [1, -1], *[[0.9, 0.8]] * 4, [0.6, -0.1]])
    score = judge(actions.astype(np.float32), pictures)
    assert score == {
        "wrong_way": Share(("left.png", "right.png"), 2),
        "wrong_way_near": Share(("left.png",), 1),
        "not_ahead": Share(("ahead.png",), 1),
        "fooled": Share(("bare.png", "carton.png", "can.png", "sofa.png"), 5),
        "fooled_bare_floor": Share(("bare.png",), 1),
        "fooled_other_colour": Share(("carton.png",), 1),
        "fooled_same_colour": Share(("can.png",), 2),
        "fooled_furniture": Share(("sofa.png",), 1),
    }
    told = picture_fields("x", score)["fooled_same_colour"]
    interval = list(score["fooled_same_colour"].interval)
    assert told == {"pictures": ["can.png"], "of": 2, "interval": interval}


def test_mistakes_are_drawn_by_kind(tmp_path: Path) -> None:
    folder, sheet = write_folder(tmp_path, ROWS), tmp_path / "sheet.png"
    truth = (folder / "truth.csv").read_text()
    output_of(evaluate, "servo", "--pictures", folder, "--contact-sheet", sheet)
    height_px = read_picture(sheet).shape[0]
    (folder / "truth.csv").write_text(truth.replace("15.0", "-15.0", 1))
    output_of(evaluate, "servo", "--pictures", folder, "--contact-sheet", sheet)
    assert read_picture(sheet).shape[0] > height_px
    with pytest.raises(ConfigurationError, match="give both"):
        output_of(evaluate, "servo", "--contact-sheet", sheet)


def test_intervals_hold_the_share_and_narrow_with_the_count() -> None:
    few, many = Share(("a",), 4), Share(tuple("a" * 100), 400)
    for share in (few, many):
        low, high = share.interval
        assert 0 <= low < 0.25 < high <= 1
    assert many.interval[1] - many.interval[0] < few.interval[1] - few.interval[0]
    assert Share((), 0).interval == (0.0, 1.0)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (None, "can't read"),
        ("file,in_view\na.png,1\n", "bearing_left_deg"),
        ("file,in_view,bearing_left_deg\n", "expected rows"),
        ("file,in_view,bearing_left_deg\nmissing.png,0,\n", "line 2: can't read .*missing.png"),
        ("file,in_view,bearing_left_deg\nleft.png,1,left\n", "expected 0 or 1, degrees"),
        ("file,in_view,bearing_left_deg\nleft.png,1,nan\n", "expected 0 or 1, degrees"),
        ("file,in_view,bearing_left_deg\nleft.png,1,361\n", "expected 0 or 1, degrees"),
        (EXTRA + "\nleft.png,1,9,near,,\n", "distance_m 'near'"),
        ("file,in_view,bearing_left_deg\nleft.png\n", "expected 0 or 1, degrees"),
        ("file,in_view,bearing_left_deg\n\0,1,5\n", "line 2"),
    ],
)
def test_what_is_wrong_with_the_labels_is_said(
    tmp_path: Path, table: str | None, words: str
) -> None:
    write_folder(tmp_path, ROWS)
    if table is None:
        (tmp_path / "truth.csv").unlink()
    else:
        (tmp_path / "truth.csv").write_text(table)
    with pytest.raises(ConfigurationError, match=words):
        read_labelled(tmp_path)

import json
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.beat.beat import Beat
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.look.demo.contact_sheet import contact_sheet, path_side_px
from mbot_workstation.look.demo.path_drawing import (
    BACKGROUND,
    PATH,
    RED,
    ObjectLain,
    draw_path,
    read_trajectory,
)

from .samples import picture


def trajectory(path: Path) -> Path:
    """Straight along +x for 2 m, past an object that is touched; another one waits."""
    lines: list[dict[str, object]] = [
        {"t": k / 10, "x": k / 10, "y": 0.0, "yaw": 0.0, "object": [2.0, 0.1, 0.0]}
        for k in range(21)
    ]
    lines.append({"t": 2.0, "event": "touch", "score": 1.9})
    lines.append({"t": 2.1, "x": 2.0, "y": 0.0, "yaw": 0.0, "object": [-1.0, -1.0, 0.0]})
    lines[-1]["colour"] = [30, 150, 50]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_a_trajectory_tells_path_and_touched_objects(tmp_path: Path) -> None:
    found = read_trajectory(trajectory(tmp_path / "t.jsonl"))
    assert found.path.shape == (22, 2)
    assert found.objects == [
        ObjectLain(2.0, 0.1, touched=True),
        ObjectLain(-1.0, -1.0, touched=False, rgb=(30, 150, 50)),
    ]


def test_the_path_is_drawn_where_the_robot_went(tmp_path: Path) -> None:
    picture = draw_path(read_trajectory(trajectory(tmp_path / "t.jsonl")), 620)
    scale = 100  # pixels a metre: 620 px are 6.2 m
    row, column = 310, 310 + round(1.5 * scale)
    assert tuple(picture[row, column]) == PATH
    assert tuple(picture[row + 40, column]) == BACKGROUND
    assert tuple(picture[310 - 10, 310 + 2 * scale]) == RED  # +y is up
    red, green, blue = picture[310 + scale, 310 - scale].tolist()
    assert green > max(red, blue) > 150, "one that was not touched is pale"


@pytest.mark.parametrize("count", [0, 1, 5, 24, 200])
def test_a_sheet_takes_any_number_of_moments(count: int) -> None:
    seen = [
        Beat(Decision(unix_time_ns=k * 400_000_000), encoded=picture().data) for k in range(count)
    ]
    sheet = contact_sheet(seen, np.zeros((path_side_px(), path_side_px(), 3), np.uint8), "title")
    assert sheet.shape[1] > sheet.shape[0]
    assert contact_sheet(seen, None, "").shape[0] == sheet.shape[0]

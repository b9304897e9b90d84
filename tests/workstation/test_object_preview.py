import json
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.objects import look_at_object
from mbot_workstation.learn.worlds.object_preview import HEIGHT_PX, WIDTH_PX, object_preview
from mbot_workstation.pictures.picture_file import read_picture
from mbot_workstation.sim.scene.object_file import read_objects

from .called import output_of

OBJECTS = Path(__file__).parents[2] / "models" / "objects"


def greens_px(picture: np.ndarray) -> int:
    shown = picture.astype(int)
    return int((shown[..., 1] - shown[..., [0, 2]].max(axis=-1) > 30).sum())


def test_a_ball_is_seen_from_all_sides_and_smaller_from_afar() -> None:
    picture = object_preview(read_objects(OBJECTS / "green-ball.toml"))
    sides, seen = picture[: -WIDTH_PX - 4], picture[-WIDTH_PX:]
    columns = [slice(number * (WIDTH_PX + 8), (number + 1) * (WIDTH_PX + 8)) for number in range(4)]
    assert all(greens_px(sides[:, column]) > 0.1 * WIDTH_PX * HEIGHT_PX for column in columns)
    near, middle, far, nothing = (greens_px(seen[:, column]) for column in columns)
    assert near > 4 * middle > 8 * far > 0
    assert nothing == 0


def test_the_command_draws_each_kind_and_says_how_large_it_is(tmp_path: Path) -> None:
    file, both = tmp_path / "look.png", OBJECTS / "ball-and-bottle.toml"
    told = json.loads(output_of(look_at_object, both, "-o", file, "--json"))
    assert [one["name"] for one in told["objects"]] == ["green ball", "blue bottle"]
    assert told["objects"][1]["height_m"] == pytest.approx(0.2)
    one = object_preview(read_objects(OBJECTS / "green-ball.toml"))
    assert read_picture(file).shape == (2 * one.shape[0], *one.shape[1:])
    assert f"--object {both}" in output_of(look_at_object, both, "-o", file)
    with pytest.raises(ConfigurationError, match="can't read"):
        output_of(look_at_object, tmp_path / "none.toml", "-o", file)

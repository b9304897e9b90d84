from pathlib import Path

import pytest

from mbot_agent.configuration import Camera, Configuration, Intrinsics, decode, load
from mbot_protocol.errors import ConfigurationError

EXAMPLE = Path(__file__).parents[2] / "deploy" / "config.toml"


def test_the_annotated_example_shows_the_defaults() -> None:
    assert load(EXAMPLE) == Configuration(robot_id="mbot-1")


def test_the_example_shows_every_setting() -> None:
    text = EXAMPLE.read_text()
    for section in (Camera, Intrinsics):
        for name in section.__struct_fields__:
            assert f"{name} = " in text or f".{name}]" in text, name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "missing required field `robot_id`"),
        ("robot_id = 3", "$.robot_id"),
        ('robot_id = "two words"', "expected 1 to 32"),
        ('robot_id = "a"\n[camera]\nsorce = "x"', "unknown field `sorce`"),
        ('robot_id = "a"\n[camera]\nstale_after_ms = 5000', "$.camera.stale_after_ms"),
        ('robot_id = "a"\n[camera]\nwidth_px = 320', "belong together"),
        ('robot_id = "a"\n[control]\ndecision_rate_hz = 50', "$.control.decision_rate_hz"),
        ('robot_id = "a"\n[motors.left]\ntrim = 0.5\ndead_band = 140', "motors.left: dead_band"),
        ('robot_id = "a"\n[network]\nlisten = ["tcp/0.0.0.0:7447"]', "anyone on the network"),
        ('robot_id = "a"\n[network]\nlisten = ["tcp/[::]:7447"]', "anyone on the network"),
        ('robot_id = "a"\n[network]\nlisten = ["tls/0.0.0.0:7447"]', "[network.tls]"),
        ('robot_id = "a"\n[network]\nlisten = ["udp/127.0.0.1:1"]', "not understood"),
        ("robot_id =", "no valid TOML"),
    ],
)
def test_a_mistake_is_named_in_one_line(text: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode(text, "robot.toml")
    message = str(caught.value)
    assert message.startswith("robot.toml")
    assert words in message
    assert "\n" not in message


def test_a_missing_file_says_where_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"copy deploy/config\.toml there"):
        load(tmp_path / "none.toml")


def test_a_motor_section_keeps_the_sides_own_direction() -> None:
    configuration = decode('robot_id = "a"\n[motors.left]\ntrim = 0.9', "x")
    assert configuration.motors.left.reversed
    assert not configuration.motors.right.reversed


def test_calibrated_intrinsics_are_scaled_to_the_frames() -> None:
    camera = Camera(
        intrinsics=Intrinsics(
            width_px=640,
            height_px=480,
            focal_x_px=600.0,
            focal_y_px=610.0,
            principal_x_px=319.5,
            principal_y_px=239.5,
            distortion=(-0.1, 0.01, 0.0, 0.0, 0.0),
        )
    )
    model = camera.model_at(320, 240)
    assert (model.focal_x_px, model.focal_y_px) == (300.0, 305.0)
    assert model.distortion[0] == -0.1

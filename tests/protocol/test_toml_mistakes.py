"""Each mistake in a TOML file by its key, its line, and what was expected."""

from typing import Annotated, Literal

import msgspec
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.toml_file import decode_toml
from mbot_protocol.files.toml_mistakes import line_number


class Wheel(msgspec.Struct, forbid_unknown_fields=True):
    radius_m: Annotated[float, msgspec.Meta(gt=0)]
    count: int = 1
    name: str | None = None


class Robot(msgspec.Struct, forbid_unknown_fields=True):
    wheel: Wheel
    spare: tuple[Wheel, ...] = ()
    gait: Literal["walk", "trot"] = "walk"
    light: bool | Literal["dim"] = False
    rights: dict[str, tuple[Literal["see", "go"], ...]] = {}


WHEEL = "[wheel]\nradius_m = 0.03\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "wheel is missing; add it"),
        ("# a word\n[wheel]\ncount = 2", "wheel.radius_m is missing; add it to [wheel] (line 2)"),
        (
            f"{WHEEL}radius = 1",
            "wheel.radius is unknown (line 3); did you mean radius_m?",
        ),
        ("wheel.radus_m = 1", "wheel.radus_m is unknown (line 1); did you mean radius_m?"),
        (f"{WHEEL}[whel]\nx = 1", "whel is unknown (line 3); did you mean wheel?"),
        (f"{WHEEL}[zebra]\nx = 1", "zebra is unknown (line 3)"),
        ("[wheel]\nradius_m = 'big'", "wheel.radius_m is 'big' (line 2), expected a number"),
        ("[wheel]\nradius_m = -1", "wheel.radius_m is -1 (line 2), expected a number > 0"),
        (f"{WHEEL}count = 1.5", "wheel.count is 1.5 (line 3), expected a whole number"),
        (f"{WHEEL}name = 3", "wheel.name is 3 (line 3), expected a text in quotes"),
        ("wheel = 3", "wheel is 3 (line 1), expected a section"),
        (f"spare = 'one'\n{WHEEL}", "spare is 'one' (line 1), expected a list in [ ]"),
        (
            f"{WHEEL}[[spare]]\nradius_m = 1\n[[spare]]\nradius_m = 0",
            "spare[1].radius_m is 0 (line 6), expected a number > 0",
        ),
        (
            f"gait = 'trott'\n{WHEEL}",
            "gait is 'trott' (line 1), expected one of trot, walk; did you mean trot?",
        ),
        (f"light = 'off'\n{WHEEL}", "light is 'off' (line 1), expected one of true, false, dim"),
        (
            f"{WHEEL}[rights]\nanna = ['see']\nbert = ['fly']",
            "rights.bert[0] is 'fly' (line 5), expected one of go, see",
        ),
    ],
)
def test_a_mistake_is_one_line_with_key_line_and_what_was_expected(text: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode_toml(text, Robot, "robot.toml")
    assert str(caught.value) == f"robot.toml: {said}"


def test_what_cannot_be_found_has_no_line() -> None:
    assert line_number('{"wheel" = 1}', ("wheel",)) is None

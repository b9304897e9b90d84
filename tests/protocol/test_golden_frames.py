import base64
import json
import resource

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.golden_frames import (
    MOST_FRAMES,
    PROPERTY,
    TOLERANCE,
    check_deviation,
    read_golden_frames,
)
from tests.workstation.bombs import png_that_says

PICTURE = np.random.default_rng(3).integers(0, 256, (64, 64, 3)).astype(np.uint8)


def png(picture: np.ndarray) -> str:
    return base64.b64encode(cv2.imencode(".png", picture[..., ::-1])[1].tobytes()).decode()


def entry(**changes: object) -> dict[str, object]:
    return {"name": "a", "png": png(PICTURE), "action": [0.25, -1.0]} | changes


def test_frames_are_read_as_rgb() -> None:
    (frame,) = read_golden_frames({PROPERTY: json.dumps([entry()])})
    assert (frame.name, frame.action) == ("a", (0.25, -1.0))
    np.testing.assert_array_equal(frame.picture, PICTURE)


def test_a_model_may_bring_none() -> None:
    assert read_golden_frames({"mbot.name": "x"}) == []


@pytest.mark.parametrize(
    "entries",
    [
        [],
        [entry()] * (MOST_FRAMES + 1),
        [entry(png="")],
        [entry(png="no base64!")],
        [entry(png=base64.b64encode(b"no picture").decode())],
        [entry(png=png(PICTURE[:32]))],
        [entry(action=[0.1])],
        [entry(action=["left", "right"])],
        [{"name": "a"}],
        {"a": 1},
    ],
)
def test_damaged_frames_are_refused(entries: object) -> None:
    with pytest.raises(ContractError, match="damaged"):
        read_golden_frames({PROPERTY: json.dumps(entries)})


def test_a_picture_of_another_size_is_refused_before_it_is_decoded() -> None:
    bomb = base64.b64encode(png_that_says(20_000, 20_000)).decode()
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ContractError, match="damaged"):
        read_golden_frames({PROPERTY: json.dumps([entry(png=bomb)])})
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 50_000


@given(st.text(max_size=100))
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(ContractError):
        read_golden_frames({PROPERTY: text})


def test_only_rounding_is_forgiven() -> None:
    assert check_deviation(TOLERANCE) == TOLERANCE
    for deviation in (2 * TOLERANCE, float("nan"), float("inf")):
        with pytest.raises(ContractError, match="golden frames are off"):
            check_deviation(deviation)

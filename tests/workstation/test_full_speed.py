from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from onnx import helper, numpy_helper

from mbot_workstation.learn.learning.full_speed import (
    full_speed_constants,
    full_speed_nodes,
    within_full_speed,
)

speeds = st.floats(-4, 4, width=32)


@given(speeds, speeds)
def test_a_turn_is_kept_as_far_as_the_wheels_reach(left: float, right: float) -> None:
    told = within_full_speed(torch.tensor([[left, right]]))[0].tolist()
    assert max(map(abs, told)) <= 1
    turn = max(-2.0, min(2.0, right - left))
    assert told[1] - told[0] == pytest.approx(turn, abs=1e-5)


@given(speeds, speeds)
def test_what_is_within_bounds_stays(left: float, right: float) -> None:
    asked = torch.tensor([[left, right]]) / 4
    assert within_full_speed(asked).tolist() == asked.tolist()


def test_the_graph_says_the_same() -> None:
    shape = ["n", 2]
    graph = helper.make_graph(
        full_speed_nodes("asked", "told"),
        "full_speed",
        [helper.make_tensor_value_info("asked", onnx.TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("told", onnx.TensorProto.FLOAT, shape)],
        [numpy_helper.from_array(value, name) for name, value in full_speed_constants().items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 10)], ir_version=8)
    session = onnxruntime.InferenceSession(model.SerializeToString())
    asked = np.random.default_rng(0).uniform(-4, 4, (500, 2)).astype(np.float32)
    told: Any = session.run(None, {"asked": asked})[0]
    expected = within_full_speed(torch.from_numpy(asked))
    np.testing.assert_allclose(told.clip(-1, 1), expected, rtol=0, atol=1e-6)

"""What onnxruntime 1.20 to 1.24 say (their exceptions' texts), in a person's words."""

import pytest

from mbot_protocol.policy.engine_words import LONGEST_REASON, engine_words

PLACE = (
    "/onnxruntime_src/onnxruntime/core/graph/model.cc:256 onnxruntime::Model::Model("
    "onnx::ModelProto&&, const onnxruntime::PathString&, const onnxruntime::logging::Logger&) "
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"[ONNXRuntimeError] : 1 : FAIL : {PLACE}Unsupported model IR version: 14, max "
            "supported IR version: 13",
            "IR version is 14, this onnxruntime reads up to 13: set model.ir_version = 10",
        ),
        (
            f"[ONNXRuntimeError] : 1 : FAIL : {PLACE}ONNX Runtime only *guarantees* support for "
            "models stamped with official released onnx opset versions. Opset 27 is under "
            "development and support for this is limited. Current official support for domain "
            "ai.onnx is till opset 26.",
            "operator set is 27, this onnxruntime knows up to 26: export with opset_version=21",
        ),
        (
            f"[ONNXRuntimeError] : 1 : FAIL : Load model from a.onnx failed:{PLACE}Wrong graph",
            "Wrong graph",
        ),
        (
            "[ONNXRuntimeError] : 10 : INVALID_GRAPH : This is an invalid model. In Node, x\n",
            "This is an invalid model. In Node, x",
        ),
    ],
)
def test_the_reason_comes_without_its_place(text: str, said: str) -> None:
    words = engine_words(RuntimeError(text))
    assert said in words
    assert not any(part in words for part in ("\n", "ONNXRuntimeError", ".cc:"))


def test_an_endless_reason_is_cut() -> None:
    assert len(engine_words(RuntimeError("x" * 5000))) == LONGEST_REASON

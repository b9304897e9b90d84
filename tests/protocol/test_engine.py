import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest

from mbot_protocol.errors import ContractError
from mbot_protocol.policy import engine
from mbot_protocol.policy.engine import (
    LONGEST_REASON,
    Engine,
    OnnxRuntime,
    OpenCvDnn,
    engine_words,
)
from mbot_protocol.policy.onnx_file import read_onnx
from mbot_protocol.policy.policy import Policy
from mbot_protocol.policy.policy_contract import PolicyMetadata, Tensor
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.learn.learning.policy_export import export_policy
from mbot_workstation.learn.learning.trained_policy import trained_policy

from ..ran import ran
from ..robot.tiny_models import constant_model, counting_model, seeing_model

CHECKOUT = Path(__file__).parents[2]
SHIPPED = CHECKOUT / "models/red-cube.onnx"

MODELS = {
    "constant": constant_model(),
    "any batch": constant_model(input_shape=("batch", 64, 64, 3)),
    "counting": counting_model(),
    "seeing": seeing_model(),
    "servo": servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString(),
    "shipped": SHIPPED.read_bytes(),
}


@pytest.fixture(scope="module")
def for_armv6() -> bytes:
    """The shipped policy in OpenCV's dialect."""
    model = export_policy(trained_policy(SHIPPED), "red-cube-armv6", for_armv6=True)
    return model.SerializeToString()


def as_contract(nodes: Sequence[Any]) -> list[Tensor]:
    kinds = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}
    return [Tensor(node.name, kinds[node.type], tuple(node.shape)) for node in nodes]


@pytest.mark.parametrize("name", MODELS)
def test_a_files_bytes_declare_what_onnxruntime_finds(name: str) -> None:
    declared = read_onnx(MODELS[name])
    found = onnxruntime.InferenceSession(MODELS[name], providers=["CPUExecutionProvider"])
    assert list(declared.inputs) == as_contract(found.get_inputs())
    assert list(declared.outputs) == as_contract(found.get_outputs())
    assert declared.properties == found.get_modelmeta().custom_metadata_map


def test_a_loaded_models_file_is_let_go() -> None:
    """4 MB of the shipped policy's would stay otherwise."""
    data = SHIPPED.read_bytes()
    mine_only = sys.getrefcount(data)
    loaded = engine.load_engine(data)
    assert sys.getrefcount(data) == mine_only
    assert loaded


LOADED = """
import ctypes, pathlib, sys
from mbot_protocol.policy import engine
from mbot_protocol.policy.engine import load_engine

def resident_kb():
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * 4

engine = load_engine(pathlib.Path(sys.argv[1]).read_bytes())
before = resident_kb()
ctypes.CDLL(None).malloc_trim(0)
print(before - resident_kb())
"""


def test_the_room_that_loading_took_is_given_back() -> None:
    """2.7 MB would stay, as long as nobody asks."""
    command = [sys.executable, "-c", LOADED, str(SHIPPED)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stdout) < 1000


def test_weights_among_the_inputs_are_no_inputs() -> None:
    """Files of ONNX's first versions list them there."""
    model = onnx.load_from_string(constant_model())
    names = ("zero", "answer")
    model.graph.input.extend(
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, (1, 2)) for name in names
    )
    declared = read_onnx(model.SerializeToString())
    assert [tensor.name for tensor in declared.inputs] == ["observation"]


def test_old_opencv_is_given_no_dense_layer_that_it_cannot_read(for_armv6: bytes) -> None:
    """`tests/pi/test_armv6.py` tries 4.6 itself, which wants the outputs first."""
    layers = [
        node for node in onnx.load_from_string(for_armv6).graph.node if node.op_type == "Gemm"
    ]
    assert len(layers) > 3
    for layer in layers:
        assert [one.i for one in layer.attribute if one.name == "transB"] == [1], layer.name


def test_opencv_remembers_as_onnxruntime_does(for_armv6: bytes) -> None:
    """The drive of 80 pictures that the policy brings, each from what the same engine left."""
    golden = Policy(SHIPPED.read_bytes()).golden_frames()
    assert (len(golden), sum(frame.fresh for frame in golden)) == (80, 2)

    def drive(one: Engine) -> np.ndarray:
        state, before, actions = np.zeros((1, 1, 128), np.float32), np.zeros((1, 2)), []
        for frame in golden:
            if frame.fresh:
                state, before = np.zeros_like(state), np.zeros((1, 2))
            feeds = {
                "observation": frame.picture[None],
                "previous_action": before.astype(np.float32),
                "state_in": state,
            }
            before, state = one.run(["action", "state_out"], feeds)
            actions.append(before)
        return np.array(actions)

    usual = drive(OnnxRuntime(engine.onnxruntime, SHIPPED.read_bytes()))
    again = drive(OnnxRuntime(engine.onnxruntime, for_armv6))
    other = drive(OpenCvDnn(cv2, for_armv6))
    assert usual.std() > 0.1
    assert np.abs(again - usual).max() <= 1e-5
    assert np.abs(other - usual).max() <= 1e-5


def test_what_opencv_does_not_know_is_refused_with_what_to_do() -> None:
    unknown = constant_model(extra_operator="Det")  # the structure's check would refuse it first
    with pytest.raises(ContractError, match=r"OpenCV cannot load .*--for-armv6") as caught:
        OpenCvDnn(cv2, unknown)
    assert "\n" not in str(caught.value)


WITHOUT_ONNXRUNTIME = """
import sys
from collections.abc import Sequence
from pathlib import Path
from mbot_protocol.policy import engine
from mbot_protocol.policy.dry_run import dry_run
report = dry_run(Path(sys.argv[1]).read_bytes(), 2.5)
print(engine.onnxruntime, report.golden_frames, report.confined)
"""


def test_where_onnxruntime_is_missing_a_dry_run_is_by_opencv(
    for_armv6: bytes, tmp_path: Path
) -> None:
    """In the child too, confined: its 80 golden frames come out right."""
    missing = tmp_path / "missing"
    missing.mkdir()
    (missing / "onnxruntime.py").write_text("raise ModuleNotFoundError('onnxruntime')\n")
    model = tmp_path / "model.onnx"
    model.write_bytes(for_armv6)
    path = os.pathsep.join([str(missing), os.environ.get("PYTHONPATH", "")])
    done = ran(
        sys.executable,
        "-c",
        WITHOUT_ONNXRUNTIME,
        str(model),
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.stdout == "None 80 True\n", done.stderr


# What onnxruntime 1.20 to 1.24 say, their exceptions' texts.
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

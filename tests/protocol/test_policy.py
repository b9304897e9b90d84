import math
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, numpy_helper

from mbot_protocol.errors import ContractError, NewerSchemaError
from mbot_protocol.policy import engine
from mbot_protocol.policy.policy import Policy, PolicyError
from mbot_protocol.policy.policy_contract import FULL_VIEW, Memory, PolicyMetadata

from ..robot.tiny_models import constant_model, counting_model

GREY = np.full((64, 64, 3), 128, np.uint8)

NEWER = PolicyMetadata("newer").to_properties() | {"mbot.contract_version": "99"}

BAD_MODELS = {
    "not ONNX": (b"this is not a model", ContractError),
    "empty": (b"", ContractError),
    "truncated": (constant_model()[:-40], ContractError),
    "wrong shape": (constant_model(input_shape=(1, 3, 64, 64)), ContractError),
    "wrong type": (constant_model(input_type=TensorProto.FLOAT), ContractError),
    "wrong name": (constant_model(input_name="image"), ContractError),
    "no metadata": (constant_model(metadata={}), ContractError),
    "newer contract": (constant_model(metadata=NEWER), NewerSchemaError),
    "too large": (bytes(17 * 2**20), ContractError),
    "forbidden operator": (constant_model(extra_operator="Range"), ContractError),
    "onnxruntime's own format": (b"\x08\x08\x12\x08ORTM1234", ContractError),
}


@pytest.fixture(params=["onnxruntime", "OpenCV"], autouse=True)
def an_engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "OpenCV":
        monkeypatch.setattr(engine, "onnxruntime", None)
        monkeypatch.setattr(engine, "cv2", cv2)


def act(policy: Policy) -> tuple[float, float]:
    answer = policy.decide(GREY, policy.blank)
    return answer.left, answer.right


def test_a_model_acts_and_says_what_it_is() -> None:
    policy = Policy(constant_model(0.25, -1.5, name="tiny"))
    assert act(policy) == (0.25, -1.5)
    assert policy.metadata == PolicyMetadata("tiny", FULL_VIEW, 2.5)
    assert len(policy.sha256) == 64


def test_a_symbolic_batch_is_accepted() -> None:
    assert act(Policy(constant_model(input_shape=("batch", 64, 64, 3)))) == (0.5, 0.5)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_an_answer_that_is_no_number_is_an_error(bad: float) -> None:
    policy = Policy(constant_model(0.1, bad))
    with pytest.raises(PolicyError, match="two finite numbers"):
        act(policy)


@pytest.mark.parametrize("name", BAD_MODELS)
def test_a_bad_model_is_refused_in_one_line(name: str) -> None:
    data, error = BAD_MODELS[name]
    with pytest.raises(error) as caught:
        Policy(data)
    assert "\n" not in str(caught.value)


def test_onnxruntimes_own_format_is_never_read() -> None:
    """Bytes that are both: as ONNX they were checked, so as ONNX they are read."""
    both = Policy(b"\x08\x08\x12\x08ORTM1234" + constant_model())
    assert act(both) == (0.5, 0.5)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ContractError, match=r"cannot read the model .*none\.onnx"):
        Policy.load(tmp_path / "none.onnx")


IMPORT_CHECK = """
import socket, sys
def refuse(*_):
    raise AssertionError("a socket was opened")
socket.getaddrinfo = refuse
import mbot_agent.daemon, mbot_agent.control_loop
import mbot_agent.network.zenoh_link, mbot_agent.models.model_service
import os
assert os.environ["ORT_DISABLE_TELEMETRY"] == "1"
assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
heavy = {"cryptography", "http.client", "ssl", "torch", "mujoco", "gymnasium", "onnx"}
heavy |= {"mbot_workstation", "rich", "typer"}
print(sorted(heavy & set(sys.modules)))
"""


def test_the_daemon_imports_nothing_of_the_workstation() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_CHECK], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


QUIET_CHECK = """
import os
from pathlib import Path
from mbot_protocol.policy import engine
from mbot_protocol.policy.policy import Policy
import numpy as np
policy = Policy.load(Path(%r))
policy.decide(np.zeros((64, 64, 3), np.uint8), policy.blank)
links = [os.readlink(f"/proc/self/fd/{fd}") for fd in os.listdir("/proc/self/fd")
         if os.path.islink(f"/proc/self/fd/{fd}")]
print([link for link in links if link.startswith("socket:")], len(os.listdir("/proc/self/task")))
"""


def test_inference_opens_no_socket_and_starts_no_thread(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(constant_model())
    done = subprocess.run(
        [sys.executable, "-c", QUIET_CHECK % str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[] 1"


def test_a_memory_that_is_not_finite_is_a_failure() -> None:
    growing = onnx.load_from_string(counting_model())
    growing.graph.node[0].op_type = "Mul"
    (factor,) = [one for one in growing.graph.initializer if one.name == "one"]
    factor.CopyFrom(numpy_helper.from_array(np.full((1, 1, 1), 10, np.float32), "one"))
    policy = Policy(growing.SerializeToString())
    answer = policy.decide(GREY, Memory(np.full((1, 1, 1), 2.0, np.float32), (0.5, 0.5)))
    assert (answer.left, answer.right, answer.state.item()) == (0.25, 0.5, 20.0)
    with pytest.raises(PolicyError, match="remembers what is not finite"):
        policy.decide(GREY, Memory(np.full((1, 1, 1), 1e38, np.float32)))

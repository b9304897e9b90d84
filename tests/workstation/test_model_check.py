import hashlib
from pathlib import Path

import pytest
from onnx import TensorProto, helper

from mbot_protocol.errors import ConfigurationError, ContractError, NewerSchemaError
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES, PolicyMetadata
from mbot_workstation.fleet.models.check import check_model

from .samples import small_policy

PROPERTIES = PolicyMetadata("new").to_properties()


def write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_a_policy_that_follows_the_contract_passes(tmp_path: Path) -> None:
    data = small_policy().SerializeToString()
    checked = check_model(write(tmp_path / "policy.onnx", data))
    assert checked.data == data
    assert checked.sha256 == hashlib.sha256(data).hexdigest()
    assert checked.metadata == PolicyMetadata("new")


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "empty"),
        (b"a text, not a model", "not an ONNX model"),
        (b"\x80\x02}q\x00", "not an ONNX model"),
        (small_policy().SerializeToString()[:-40], "truncated or damaged"),
        (small_policy().SerializeToString()[:20], "truncated|damaged"),
        (b"\x08\x08", "damaged"),
    ],
)
def test_a_damaged_file_is_told_in_one_line(tmp_path: Path, data: bytes, text: str) -> None:
    path = write(tmp_path / "policy.onnx", data)
    with pytest.raises(ContractError, match=text) as caught:
        check_model(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"input_shape": (1, 3, 64, 64)}, r"input is 'observation' uint8 \[1, 3, 64, 64\]"),
        ({"input_type": TensorProto.FLOAT}, r"input is 'observation' float32"),
        ({"output_shape": (1, 3)}, r"output is 'action' float32 \[1, 3\], expected .* \[1, 2\]"),
        ({"outputs": 2}, r"2 outputs \(action, colour\), expected 1: action"),
        ({"properties": {}}, "no mbot.contract_version"),
        ({"properties": PROPERTIES | {"mbot.decision_rate_hz": "99"}}, "decision_rate_hz is 99"),
    ],
)
def test_what_is_off_the_contract_is_named(
    tmp_path: Path, change: dict[str, object], text: str
) -> None:
    model = small_policy(**change)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ContractError, match=text):
        check_model(write(tmp_path / "policy.onnx", model.SerializeToString()))


def test_a_newer_contract_asks_for_an_upgrade(tmp_path: Path) -> None:
    model = small_policy(properties=PROPERTIES | {"mbot.contract_version": "3"})
    with pytest.raises(NewerSchemaError, match="contract 3"):
        check_model(write(tmp_path / "policy.onnx", model.SerializeToString()))


def test_weights_in_another_file_are_refused(tmp_path: Path) -> None:
    model = small_policy(weights_bytes=8)
    ballast = model.graph.initializer[-1]
    ballast.ClearField("raw_data")
    ballast.data_location = TensorProto.EXTERNAL
    ballast.external_data.add(key="location", value="weights.bin")
    with pytest.raises(ContractError, match="external_data=False"):
        check_model(write(tmp_path / "policy.onnx", model.SerializeToString()))


def test_what_a_robot_would_refuse_is_refused_here(tmp_path: Path) -> None:
    model = small_policy()
    model.graph.node.append(helper.make_node("NonZero", ["float"], ["where"]))
    with pytest.raises(ContractError, match="the operator 'NonZero', which a robot does not run"):
        check_model(write(tmp_path / "policy.onnx", model.SerializeToString()))


def test_a_file_of_absurd_size_is_not_even_read(tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    with path.open("wb") as file:
        file.truncate(LARGEST_MODEL_BYTES + 1)
    with pytest.raises(ContractError, match="at most 16 MiB"):
        check_model(path)


def test_a_missing_file_or_a_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        check_model(tmp_path / "none.onnx")
    with pytest.raises(ConfigurationError, match="not a file"):
        check_model(tmp_path)

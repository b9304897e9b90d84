import hashlib
from pathlib import Path

import pytest
from onnx import ModelProto, helper

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


def with_node(operator: str) -> ModelProto:
    model = small_policy()
    model.graph.node.append(helper.make_node(operator, ["float"], ["where"]))
    return model


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "empty"),
        (b"a text, not a model", "not an ONNX model"),
        (small_policy().SerializeToString()[:-40], "truncated or damaged"),
        (b"\x08\x08", "damaged"),
        (
            small_policy(input_shape=(1, 3, 64, 64)),
            r"input is 'observation' uint8 \[1, 3, 64, 64\]",
        ),
        (small_policy(outputs=2), r"2 outputs \(action, colour\), expected 1: action"),
        (small_policy(properties={}), "no mbot.contract_version"),
        (with_node("NonZero"), "the operator 'NonZero', which a robot does not run"),
    ],
)
def test_what_a_robot_would_refuse_is_told_in_one_line(
    tmp_path: Path, data: bytes | ModelProto, text: str
) -> None:
    path = tmp_path / "policy.onnx"
    write(path, data if isinstance(data, bytes) else data.SerializeToString())
    with pytest.raises(ContractError, match=text) as caught:
        check_model(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_newer_contract_asks_for_an_upgrade(tmp_path: Path) -> None:
    model = small_policy(properties=PROPERTIES | {"mbot.contract_version": "3"})
    with pytest.raises(NewerSchemaError, match="contract 3"):
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

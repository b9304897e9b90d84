"""Is this file a policy that a robot would take? Checked before anything is sent."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError, ContractError
from mbot_protocol.policy.model_structure import check_structure
from mbot_protocol.policy.policy_contract import (
    LARGEST_MODEL_BYTES,
    PolicyMetadata,
    check_signature,
)
from mbot_workstation.wording import one_line


@dataclass(frozen=True, slots=True)
class CheckedModel:
    """A model file that follows the policy contract.

    Attributes:
        data: the file's bytes.
        sha256: their digest, 64 hexadecimal digits.
        metadata: what the model says of itself.

    """

    data: bytes
    sha256: str
    metadata: PolicyMetadata


def check_model(path: Path) -> CheckedModel:
    """Read a model file and compare it with the policy contract.

    Raises:
        ConfigurationError: there is no such file, or it can't be read.
        ContractError: it is too large, truncated, no ONNX, or a tensor or property is off.
        NewerSchemaError: it follows a newer contract.

    """
    return check_model_data(_read(path), str(path))


def check_model_data(data: bytes, name: str) -> CheckedModel:
    """Compare what a model file holds with the policy contract.

    Raises:
        ContractError, NewerSchemaError: as `check_model`; `name` comes first in what they say.

    """
    try:
        metadata = _check_contents(data)
    except ContractError as error:
        raise type(error)(f"{name}: {error}") from None
    return CheckedModel(data, hashlib.sha256(data).hexdigest(), metadata)


def _read(path: Path) -> bytes:
    try:
        size_bytes = path.stat().st_size
        if not path.is_file():
            raise ConfigurationError(f"{path} is not a file; expected an ONNX model")
        if size_bytes > LARGEST_MODEL_BYTES:
            raise ContractError(
                f"{path} is {size_bytes / 2**20:.1f} MiB, a robot takes at most "
                f"{LARGEST_MODEL_BYTES / 2**20:g} MiB; is it the policy, exported without "
                "optimiser state?"
            )
    except OSError as error:
        raise ConfigurationError(
            f"can't read {path}: {error.strerror}; expected an ONNX model"
        ) from None
    return read_bytes(path)


def read_bytes(path: Path) -> bytes:
    """A file's bytes; raises ConfigurationError if it can't be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None


def _check_contents(data: bytes) -> PolicyMetadata:
    model = check_structure(data)
    if fault := graph_fault(data):
        raise ContractError(fault)
    metadata = PolicyMetadata.from_properties(model.properties)
    check_signature(model.inputs, model.outputs, metadata.contract_version)
    return metadata


def graph_fault(data: bytes) -> str:
    """What ONNX's own checker says of a file that is made of nothing forbidden; mostly nothing."""
    import onnx

    try:
        onnx.checker.check_model(data)
    except (onnx.checker.ValidationError, ValueError) as error:
        return f"the ONNX model is damaged: {one_line(str(error))}"
    return ""

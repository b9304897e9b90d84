"""Is this file a policy that a robot would take? Checked before anything is sent."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, ContractError
from mbot_protocol.policy.model_structure import check_structure
from mbot_protocol.policy.policy_contract import (
    LARGEST_MODEL_BYTES,
    PolicyMetadata,
    Tensor,
    check_signature,
)
from mbot_workstation.wording import one_line

if TYPE_CHECKING:
    import onnx

# An ONNX file begins with its field 1, ir_version, as a varint.
_ONNX_FIRST_BYTE = b"\x08"


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
    model = _parse(data)
    metadata = PolicyMetadata.from_properties({p.key: p.value for p in model.metadata_props})
    check_signature(*declared_tensors(model), metadata.contract_version)
    return metadata


def declared_tensors(model: "onnx.ModelProto") -> tuple[list[Tensor], list[Tensor]]:
    """A model's inputs and outputs as it declares them."""
    # Old exporters list the weights among the inputs.
    weights = {tensor.name for tensor in model.graph.initializer}
    inputs = [_tensor(value) for value in model.graph.input if value.name not in weights]
    return inputs, [_tensor(value) for value in model.graph.output]


def parse_model(data: bytes) -> "onnx.ModelProto":
    """An ONNX file read, whatever is in it; raises ContractError if it is none, or damaged."""
    import onnx
    from google.protobuf.message import DecodeError

    if not data:
        raise ContractError("the file is empty; was the export interrupted?")
    if not data.startswith(_ONNX_FIRST_BYTE):
        raise ContractError("this is not an ONNX model; export the policy to ONNX first")
    model = onnx.ModelProto()
    try:
        model.ParseFromString(data)
    except DecodeError:
        raise ContractError(
            "the ONNX data is truncated or damaged; copy or export the file again"
        ) from None
    return model


def _parse(data: bytes) -> "onnx.ModelProto":
    import onnx

    model = parse_model(data)
    for tensor in model.graph.initializer:
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise ContractError(
                f"the weights {tensor.name!r} are in another file; export with external_data=False"
            )
    try:
        onnx.checker.check_model(model)
    except onnx.checker.ValidationError as error:
        raise ContractError(f"the ONNX model is damaged: {one_line(str(error))}") from None
    check_structure(data)  # a robot would refuse it for that, too
    return model


def _tensor(value: "onnx.ValueInfoProto") -> Tensor:
    """As declared; a symbolic dimension is its name."""
    from onnx.helper import tensor_dtype_to_np_dtype

    tensor = value.type.tensor_type
    try:
        kind = str(tensor_dtype_to_np_dtype(tensor.elem_type))
    except KeyError:
        kind = f"element type {tensor.elem_type}"
    shape = tuple(
        dim.dim_value if dim.HasField("dim_value") else dim.dim_param or "?"
        for dim in tensor.shape.dim
    )
    return Tensor(value.name, kind, shape)

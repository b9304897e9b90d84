"""What runs a model: onnxruntime; OpenCV's dnn where that is missing (ARMv6: the first Pi Zero)."""

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.engine_words import engine_words
from mbot_protocol.policy.model_declaration import read_declaration
from mbot_protocol.policy.policy_contract import Tensor

# With this module: the dry run's limits count from what its imports have mapped, and once confined
# it can open no file.
try:
    import onnxruntime as untyped_onnxruntime  # pyright: ignore[reportMissingTypeStubs]
except ModuleNotFoundError:
    import cv2 as untyped_cv2

    onnxruntime, cv2 = None, cast(Any, untyped_cv2)
    cv2.setNumThreads(1)
else:
    onnxruntime, cv2 = cast(Any, untyped_onnxruntime), None
    onnxruntime.set_default_logger_severity(4)  # errors are exceptions, with our own words

Feeds = Mapping[str, NDArray[Any]]

_TYPES = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}


class Engine(Protocol):
    """A loaded model.

    Attributes:
        inputs, outputs: as it declares them.
        properties: its metadata.

    """

    inputs: list[Tensor]
    outputs: list[Tensor]
    properties: dict[str, str]

    def run(self, names: Sequence[str], feeds: Feeds) -> list[NDArray[Any]]:
        """The outputs of these names; raises whatever its library does."""
        ...


def load_engine(data: bytes) -> Engine:
    """Load a model with what there is.

    Args:
        data: the whole ONNX file, checked by `mbot_protocol.policy.model_structure`.

    Raises:
        ContractError: it can't be loaded.

    """
    return OpenCvDnn(cv2, data) if onnxruntime is None else OnnxRuntime(onnxruntime, data)


class OnnxRuntime:
    """onnxruntime on one thread."""

    def __init__(self, library: Any, data: bytes) -> None:
        """Load a model; raises ContractError if it can't be."""
        options = library.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.enable_cpu_mem_arena = False  # a megabyte, and not a microsecond slower
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # Or bytes that are both would be read in onnxruntime's own format, which nobody checked.
        options.add_session_config_entry("session.load_model_format", "ONNX")
        try:
            self._session = library.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise ContractError(
                f"onnxruntime cannot load the model: {engine_words(error)}"
            ) from None
        # Python's session holds on to the file, to make itself anew when a GPU fails: 4 MB.
        self._session._model_bytes = None
        _give_back()
        self.inputs = _tensors(self._session.get_inputs())
        self.outputs = _tensors(self._session.get_outputs())
        self.properties = cast(dict[str, str], self._session.get_modelmeta().custom_metadata_map)

    def run(self, names: Sequence[str], feeds: Feeds) -> list[NDArray[Any]]:
        """The outputs of these names."""
        return self._session.run(list(names), dict(feeds))


class OpenCvDnn:
    """OpenCV's dnn, from Debian 12's 4.6 on: fewer operators, one picture a batch."""

    def __init__(self, library: Any, data: bytes) -> None:
        """Load a model; raises ContractError if it can't be."""
        self._old = int(library.__version__.split(".")[0]) < 5
        try:
            self._net = library.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
        except library.error as error:
            raise ContractError(
                f"OpenCV cannot load the model: {engine_words(error)}; was it exported with "
                "`workstation export --for-armv6`?"
            ) from None
        declared = read_declaration(data)
        self.inputs, self.outputs = list(declared.inputs), list(declared.outputs)
        self.properties = declared.properties

    def run(self, names: Sequence[str], feeds: Feeds) -> list[NDArray[Any]]:
        """The outputs of these names."""
        for name, value in feeds.items():
            # OpenCV 4 takes the last of three dimensions for channels.
            plain = value[..., None] if self._old and value.ndim == 3 else value
            self._net.setInput(plain, name)
        return [np.asarray(one) for one in self._net.forward(list(names))]


def _give_back() -> None:
    """Return the room that loading took to the system, in half a millisecond.

    glibc would keep it: 2.7 MB of the shipped policy's (measured, x86-64).
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):  # glibc's
        libc.malloc_trim(0)


def _tensors(nodes: Any) -> list[Tensor]:
    return [
        Tensor(node.name, _TYPES.get(str(node.type), str(node.type)), tuple(node.shape))
        for node in nodes
    ]

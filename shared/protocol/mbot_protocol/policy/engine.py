"""What runs a model: onnxruntime; OpenCV's dnn where that is missing (ARMv6: the first Pi Zero)."""

import ctypes
import os
import platform
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import SAFE_IR_VERSION, SAFE_OPSET

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read once, when it is imported

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

LONGEST_REASON = 300
"""Characters of what an engine says of a model."""

# How onnxruntime's messages begin, with the place in its source where it noticed; longer than the
# reason.
_CODE = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ")
_PLACE = re.compile(r"(?:Load model from .*? failed:)?/\S+\.(?:cc|h):\d+ .*?\)\s+(?=[A-Z\"(])")
_IR_VERSION = re.compile(r"IR version: (\d+), max supported IR version: (\d+)")
_OPSET = re.compile(r"Opset (\d+) is under development.*till opset (\d+)", re.DOTALL)


class Engine(Protocol):
    """A loaded model. What it declares stands in its file: `onnx_file.py`."""

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
        # Python's session holds on to the file, to rebuild itself when a GPU fails: 4 MB.
        self._session._model_bytes = None
        _give_back()

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


def engine_words(error: Exception) -> str:
    """What onnxruntime's exception says, without places in its source; with the remedy if known."""
    text = str(error)
    if found := _IR_VERSION.search(text):
        return (
            f"the file's IR version is {found[1]}, this onnxruntime reads up to {found[2]}: set "
            f"model.ir_version = {SAFE_IR_VERSION} with onnx and save it again"
        )
    if found := _OPSET.search(text):
        return (
            f"the file's operator set is {found[1]}, this onnxruntime knows up to {found[2]}: "
            f"export with opset_version={SAFE_OPSET} or lower"
        )
    reason = _PLACE.sub("", _CODE.sub("", " ".join(text.split())))
    return reason if len(reason) <= LONGEST_REASON else reason[: LONGEST_REASON - 3] + "..."


def processor_name(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """What computes here: the architecture and, where Linux names it, the model:
    "aarch64 Cortex-A72". Another processor's float32 adds up in another order.
    """
    try:
        lines = cpuinfo.read_text().splitlines()
    except OSError:
        lines = []
    named = dict(line.split(":", 1) for line in reversed(lines) if ":" in line)
    words = {key.strip(): value.strip() for key, value in named.items()}
    model = words.get("model name") or words.get("CPU part", "")
    return f"{platform.machine()} {model}".strip()

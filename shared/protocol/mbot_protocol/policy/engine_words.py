"""Why onnxruntime does not take a model, in one line that a person can act on.

Its own messages begin with the place in its source where it noticed, longer than the reason.
"""

import re

from mbot_protocol.policy.policy_contract import SAFE_IR_VERSION, SAFE_OPSET

LONGEST_REASON = 300

_CODE = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ")
_PLACE = re.compile(r"(?:Load model from .*? failed:)?/\S+\.(?:cc|h):\d+ .*?\)\s+(?=[A-Z\"(])")
_IR_VERSION = re.compile(r"IR version: (\d+), max supported IR version: (\d+)")
_OPSET = re.compile(r"Opset (\d+) is under development.*till opset (\d+)", re.DOTALL)


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

"""All that is wrong with a policy file at once, each with its remedy; no robot is needed."""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError, ContractError, MbotError
from mbot_protocol.policy.golden_frames import PROPERTY, read_golden_frames
from mbot_protocol.policy.model_structure import structure_faults
from mbot_protocol.policy.policy_contract import (
    LARGEST_MODEL_BYTES,
    MISSING_PROPERTY,
    PREVIOUS_ACTION_NAME,
    SAFE_IR_VERSION,
    SAFE_OPSET,
    STATE_IN_NAME,
    PolicyMetadata,
    Tensor,
    signature_faults,
)
from mbot_protocol.policy.static_shapes import check_static_shapes
from mbot_workstation.fleet.models.check import declared_tensors, parse_model, read_bytes
from mbot_workstation.wording import one_line, size_words

if TYPE_CHECKING:
    import onnx

LARGEST_READ_BYTES = 16 * LARGEST_MODEL_BYTES
"""Of a larger file nothing but its size is told."""

PROVENANCE = "mbot.provenance"
"""What `workstation export` adds; robots pass over it."""

DRY_RUN = "mbot_agent.models.dry_run"
"""The robot's own program: the model through its standard input, decisions a second as argument."""
DRY_RUN_TIMEOUT_S = 60.0

CONVERT = "name them so, and scale or transpose inside the graph"

OK, WARNING, FAILED = "ok", "warning", "failed"


@dataclass(frozen=True, slots=True)
class ModelFinding:
    """The result of one check.

    Attributes:
        subject: what was looked at.
        verdict: "ok", "warning" (a robot may take it, but), or "failed" (none does).
        detail: what was found, what was expected, and what to do.

    """

    subject: str
    verdict: str
    detail: str

    @property
    def is_failure(self) -> bool:
        """Whether no robot takes the model because of it."""
        return self.verdict == FAILED


def examine_model(path: Path) -> list[ModelFinding]:
    """Check all that a robot would, and try the model by the robot's own dry run.

    Raises:
        ConfigurationError: there is no such file, or it can't be read.

    """
    size_bytes = _size(path)
    findings = [_size_finding(size_bytes)]
    if size_bytes > LARGEST_READ_BYTES:
        return findings
    data = read_bytes(path)
    try:
        model = parse_model(data)
    except ContractError as error:
        return [*findings, ModelFinding("format", FAILED, str(error))]
    properties = {entry.key: entry.value for entry in model.metadata_props}
    findings += _versions(model)
    findings += _verdicts(
        "graph",
        _graph_faults(model, data),
        "a plain network, whose sizes do not depend on the picture",
    )
    findings += _metadata(properties)
    inputs, outputs = declared_tensors(model)
    version = _version(properties, inputs)
    found = ", ".join(map(str, inputs)) + " -> " + ", ".join(map(str, outputs))
    faults = [f"{one}: {CONVERT}" for one in signature_faults(inputs, outputs, version)]
    findings += _verdicts("tensors", faults, found)
    findings.append(_golden_frames(properties))
    if any(one.is_failure for one in findings):
        words = "not tried: mend the above first"
        return [*findings, ModelFinding("dry run", WARNING, words)]
    return [*findings, _dry_run(data, PolicyMetadata.from_properties(properties))]


def _verdicts(subject: str, faults: Iterable[str], good: str) -> list[ModelFinding]:
    found = [ModelFinding(subject, FAILED, fault) for fault in faults]
    return found or [ModelFinding(subject, OK, good)]


def _size(path: Path) -> int:
    try:
        size_bytes = path.stat().st_size
    except OSError as error:
        raise ConfigurationError(
            f"can't read {path}: {error.strerror}; expected an ONNX model"
        ) from None
    if not path.is_file():
        raise ConfigurationError(f"{path} is not a file; expected an ONNX model")
    return size_bytes


def _size_finding(size_bytes: int) -> ModelFinding:
    if size_bytes <= LARGEST_MODEL_BYTES:
        return ModelFinding("size", OK, size_words(size_bytes))
    return ModelFinding(
        "size",
        FAILED,
        f"{size_words(size_bytes)}, a robot takes at most {size_words(LARGEST_MODEL_BYTES)}: "
        "export without optimiser state, or make the network smaller",
    )


def _versions(model: "onnx.ModelProto") -> Iterator[ModelFinding]:
    """IR version and operator set: what newer ones cost depends on a robot's onnxruntime."""
    doubt = "only a robot with a new enough onnxruntime takes it"
    if model.ir_version <= SAFE_IR_VERSION:
        yield ModelFinding("IR", OK, f"version {model.ir_version}")
    else:
        remedy = f"set model.ir_version = {SAFE_IR_VERSION} with onnx and save it again"
        yield ModelFinding(
            "IR",
            WARNING,
            f"version {model.ir_version}, expected {SAFE_IR_VERSION} or lower; {doubt}: {remedy}",
        )
    opset = max((entry.version for entry in model.opset_import if entry.domain == ""), default=0)
    if opset <= SAFE_OPSET:
        yield ModelFinding("opset", OK, f"operator set {opset}")
    else:
        yield ModelFinding(
            "opset",
            WARNING,
            f"operator set {opset}, expected {SAFE_OPSET} or lower; {doubt}: export with "
            f"opset_version={SAFE_OPSET}",
        )


def _graph_faults(model: "onnx.ModelProto", data: bytes) -> Iterator[str]:
    faults = structure_faults(data)
    yield from faults
    if faults:
        return  # what follows goes by the same bytes, and would stumble over the same parts
    import onnx

    try:
        onnx.checker.check_model(model)
    except onnx.checker.ValidationError as error:
        yield f"the ONNX model is damaged: {one_line(str(error))}"
    try:
        check_static_shapes(data)
    except ContractError as error:
        yield str(error)


def _metadata(properties: dict[str, str]) -> Iterator[ModelFinding]:
    """Each property by itself, the others taken for good."""
    good = PolicyMetadata("good").to_properties()
    faults = 0
    for key in good:
        tried = {name: value for name, value in good.items() if name != key}
        if key in properties:
            tried[key] = properties[key]
        try:
            PolicyMetadata.from_properties(tried)
        except MbotError as error:
            faults += 1
            yield ModelFinding("metadata", FAILED, _with_default(error, key, good[key]))
    known = [*good, PROPERTY, PROVENANCE]
    for key in properties.keys() - known:
        if key.startswith("mbot.") and (meant := did_you_mean(key, known)):
            yield ModelFinding("metadata", WARNING, f"{key} is unknown{meant}")
    if "mbot.name" not in properties:
        yield ModelFinding("metadata", WARNING, "no mbot.name: robots call it 'unnamed'")
    if not faults:
        named = [f"{key.removeprefix('mbot.')} {properties.get(key)}" for key in good]
        yield ModelFinding("metadata", OK, one_line(", ".join(named)))


def _with_default(fault: MbotError, key: str, usual: str) -> str:
    if fault.kind != MISSING_PROPERTY:
        return str(fault)
    return (
        f"no {key}: add it by onnx.helper.set_model_props, usually {usual!r} (docs/policy.md has "
        "a script)"
    )


def _version(properties: dict[str, str], inputs: list[Tensor]) -> int:
    """The contract's version that the model means, as far as that can be told.

    Other trainers' second inputs are masks and states of other shapes: only names tell a memory.
    """
    meant = properties.get("mbot.contract_version", "")
    remembers = any(one.name in (PREVIOUS_ACTION_NAME, STATE_IN_NAME) for one in inputs)
    return int(meant) if meant in ("1", "2") else 2 if remembers else 1


def _golden_frames(properties: dict[str, str]) -> ModelFinding:
    try:
        frames = read_golden_frames(properties)
    except ContractError as error:
        return ModelFinding("golden", FAILED, f"{error}; leave it out, or write it again")
    if not frames:
        return ModelFinding("golden", OK, "brings no golden frames, which are optional")
    return ModelFinding("golden", OK, f"brings {len(frames)} golden frames")


def _dry_run(data: bytes, metadata: PolicyMetadata) -> ModelFinding:
    """As the robot does it, in a child of the robot's own program."""
    import json

    rate_hz = metadata.decision_rate_hz
    command = [sys.executable, "-B", "-m", DRY_RUN, repr(rate_hz)]
    try:
        child = subprocess.run(
            command, input=data, capture_output=True, timeout=DRY_RUN_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        words = f"it does not answer within {DRY_RUN_TIMEOUT_S:.0f} s"
        return ModelFinding("dry run", FAILED, words)
    if child.returncode == 0:
        taken_ms = json.loads(child.stdout.lstrip(b"!"))["inference_ms"]
        return ModelFinding(
            "dry run",
            OK,
            f"{taken_ms:.1f} ms a decision here; on the robot it may take "
            f"{500 / rate_hz:.0f} ms ({rate_hz:g} decisions/s)",
        )
    if child.returncode < 0:
        words = f"it was ended by signal {-child.returncode}: too much memory or work"
        return ModelFinding("dry run", FAILED, words)
    lines = child.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
    return ModelFinding("dry run", FAILED, one_line(lines[-1]))

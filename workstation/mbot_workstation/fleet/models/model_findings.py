"""All that is wrong with a policy file at once, each with its remedy; no robot is needed."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError, ContractError, MbotError
from mbot_protocol.policy.dry_run import SHARE_OF_PERIOD, dry_run
from mbot_protocol.policy.golden_frames import PROPERTY, read_golden_frames
from mbot_protocol.policy.model_structure import structure_faults
from mbot_protocol.policy.onnx_file import OnnxFile, read_onnx
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
from mbot_workstation.fleet.models.check import graph_fault, read_bytes
from mbot_workstation.wording import one_line, size_words

LARGEST_READ_BYTES = 16 * LARGEST_MODEL_BYTES
"""Of a larger file nothing but its size is told."""

PROVENANCE = "mbot.provenance"
"""What `workstation export` adds; robots pass over it."""

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
        model = read_onnx(data)
    except ContractError as error:
        return [*findings, ModelFinding("format", FAILED, str(error))]
    properties = model.properties
    findings += _versions(model)
    findings += _verdicts(
        "graph",
        structure_faults(data) or filter(None, [graph_fault(data)]),
        "a plain network, whose sizes do not depend on the picture",
    )
    findings += _metadata(properties)
    inputs, outputs = model.inputs, model.outputs
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


def _versions(model: OnnxFile) -> Iterator[ModelFinding]:
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
    if model.opset <= SAFE_OPSET:
        yield ModelFinding("opset", OK, f"operator set {model.opset}")
    else:
        yield ModelFinding(
            "opset",
            WARNING,
            f"operator set {model.opset}, expected {SAFE_OPSET} or lower; {doubt}: export with "
            f"opset_version={SAFE_OPSET}",
        )


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


def _version(properties: dict[str, str], inputs: tuple[Tensor, ...]) -> int:
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
    """As the robot does it."""
    rate_hz = metadata.decision_rate_hz
    try:
        report = dry_run(data, rate_hz)
    except MbotError as error:
        return ModelFinding("dry run", FAILED, one_line(str(error)))
    return ModelFinding(
        "dry run",
        OK,
        f"{report.inference_ms:.1f} ms a decision here; on the robot it may take "
        f"{SHARE_OF_PERIOD * 1000 / rate_hz:.0f} ms ({rate_hz:g} decisions/s)",
    )

"""`workstation check-model`: everything that is wrong is said at once."""

import json
from pathlib import Path

import onnx
import pytest
from onnx import TensorProto, helper

from mbot_protocol.policy.golden_frames import PROPERTY
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_workstation.cli.models import check_model_file
from mbot_workstation.fleet.models.model_findings import FAILED, OK, WARNING, examine_model

from .samples import small_policy
from .test_commands import call

SHIPPED = Path(__file__).parents[2] / "models" / "red-cube.onnx"


def written(folder: Path, model: onnx.ModelProto) -> Path:
    path = folder / "policy.onnx"
    path.write_bytes(model.SerializeToString())
    return path


def verdicts(path: Path) -> dict[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = {}
    for finding in examine_model(path):
        found.setdefault(finding.subject, []).append((finding.verdict, finding.detail))
    return found


def test_what_ships_has_no_fault() -> None:
    found = verdicts(SHIPPED)
    assert {verdict for findings in found.values() for verdict, _ in findings} == {OK}
    assert "brings 80 golden frames" in found["golden"][0][1]
    assert "ms a decision here" in found["dry run"][0][1]


def test_all_mistakes_are_said_at_once(tmp_path: Path) -> None:
    properties = {
        "mbot.contract_version": "1",
        "mbot.decision_rate_hz": "99",
        "mbot.horizontal_fov": "55",
        PROPERTY: "no JSON",
    }
    model = small_policy(
        input_type=TensorProto.FLOAT,
        output_shape=(1, 3),
        properties=properties,
        weights_bytes=LARGEST_MODEL_BYTES,
    )
    for operator, domain in (("NonZero", ""), ("Resize", ""), ("Fused", "mine")):
        model.graph.node.append(helper.make_node(operator, ["float"], [operator], domain=domain))
    model.ir_version = 12
    model.opset_import[0].version = 22
    found = verdicts(written(tmp_path, model))
    failed = [
        (subject, detail)
        for subject, findings in found.items()
        for verdict, detail in findings
        if verdict == FAILED
    ]
    for subject, words in (
        ("size", "a robot takes at most 16.78 MB"),
        ("graph", "operator 'NonZero'"),
        ("graph", "operator 'Resize'"),
        ("graph", "operators of 'mine', expected ONNX's own"),
        ("metadata", "decision_rate_hz is 99, expected 0.5 to 20"),
        ("metadata", "no mbot.horizontal_fov_deg: add it by onnx.helper.set_model_props"),
        ("metadata", "no mbot.vertical_fov_deg: add"),
        ("tensors", "input is 'observation' float32 ['batch', 64, 64, 3], expected"),
        ("tensors", "output is 'action' float32 [1, 3], expected"),
        ("golden", f"{PROPERTY} is damaged"),
    ):
        assert [d for s, d in failed if s == subject and words in d], (subject, words)
    warned = dict(found["IR"] + found["opset"] + found["metadata"])[WARNING]
    assert "mbot.name" in warned
    assert "set model.ir_version = 10" in found["IR"][0][1]
    assert "opset_version=21" in found["opset"][0][1]
    assert "did you mean mbot.horizontal_fov_deg?" in str(found["metadata"])
    assert found["dry run"] == [(WARNING, "not tried: mend the above first")]


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        ("action_masks", "expected 1: observation:"),
        ("state_ins", "expected 1: observation:"),
        ("state_in", "expected 3: observation, previous_action, state_in:"),
    ],
)
def test_only_its_name_makes_a_second_input_a_memory(
    tmp_path: Path, second: str, expected: str
) -> None:
    model = small_policy()
    del model.metadata_props[:]
    shape = ["batch", 2]
    model.graph.input.append(helper.make_tensor_value_info(second, TensorProto.FLOAT, shape))
    (verdict, words) = verdicts(written(tmp_path, model))["tensors"][0]
    assert verdict == FAILED
    assert f"2 inputs (observation, {second}), {expected}" in words


def test_a_batch_of_any_size_is_taken_and_not_called_fixed(tmp_path: Path) -> None:
    found = verdicts(written(tmp_path, small_policy()))
    assert "'observation' uint8 ['batch', 64, 64, 3]" in found["tensors"][0][1]
    assert found["graph"][0][0] == OK
    assert "fixed" not in found["graph"][0][1]


def test_a_model_with_memory_is_held_to_its_own_contract(tmp_path: Path) -> None:
    model = onnx.load(SHIPPED)
    model.graph.output[1].name, state = "state", model.graph.output[1].name
    for node in model.graph.node:
        node.output[:] = ["state" if name == state else name for name in node.output]
    ((verdict, detail),) = verdicts(written(tmp_path, model))["tensors"]
    assert verdict == FAILED
    assert "expected 'state_out'" in detail


def test_the_robots_own_dry_run_has_the_last_word(tmp_path: Path) -> None:
    model = onnx.load(SHIPPED)
    (weights,) = (one for one in model.graph.initializer if one.name == "wheels.bias")
    values = onnx.numpy_helper.to_array(weights) + 0.5
    weights.CopyFrom(onnx.numpy_helper.from_array(values, weights.name))
    ((verdict, detail),) = verdicts(written(tmp_path, model))["dry run"]
    assert verdict == FAILED
    assert "golden frames are off" in detail


def test_a_shape_that_depends_on_the_picture_is_found(tmp_path: Path) -> None:
    model = small_policy()
    model.graph.node.append(helper.make_node("Cast", ["colour"], ["to_shape"], to=7))
    model.graph.node.append(helper.make_node("Reshape", ["float", "to_shape"], ["any"]))
    assert "may depend on the picture" in str(verdicts(written(tmp_path, model))["graph"])


@pytest.mark.parametrize("data", [b"", b"a text", b"\x08\x08", b"\x08\x08\x3a\xff\x01\x00"])
def test_what_is_no_model_ends_there(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "policy.onnx"
    path.write_bytes(data)
    assert FAILED in {finding.verdict for finding in examine_model(path)}


def test_the_command_tells_scripts_by_its_exit_code(tmp_path: Path) -> None:
    code, told = call(check_model_file, str(SHIPPED), "--json")
    assert (code, json.loads(told)["accepted"]) == (0, True)
    code, told = call(check_model_file, str(written(tmp_path, small_policy(properties={}))))
    assert code == 3
    assert told.splitlines()[-1].endswith("4 to mend; docs/policy.md has the contract")
    code, told = call(check_model_file, str(written(tmp_path, small_policy())))
    assert (code, "a robot takes it" in told) == (0, True)
    assert call(check_model_file, str(tmp_path / "none.onnx"))[0] == 2

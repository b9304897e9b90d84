import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ContractError, NewerSchemaError
from mbot_protocol.policy.policy_contract import (
    CONTRACT_VERSION,
    LARGEST_STATE,
    FieldOfView,
    MemoryShape,
    PolicyMetadata,
    Tensor,
    check_signature,
)

PICTURE = Tensor("observation", "uint8", (1, 64, 64, 3))
PREVIOUS = Tensor("previous_action", "float32", (1, 2))
ACTION = Tensor("action", "float32", (1, 2))


def state(name: str, *shape: object) -> Tensor:
    return Tensor(name, "float32", shape)


@given(st.text(max_size=30), st.floats(1, 170), st.floats(1, 170), st.floats(0.5, 20))
def test_metadata_survives_its_properties(name: str, h: float, v: float, rate: float) -> None:
    metadata = PolicyMetadata(name, FieldOfView(h, v), rate, contract_version=2)
    assert PolicyMetadata.from_properties(metadata.to_properties()) == metadata


@pytest.mark.parametrize(
    ("key", "value", "error"),
    [
        ("mbot.contract_version", str(CONTRACT_VERSION + 1), NewerSchemaError),
        ("mbot.contract_version", "one", ContractError),
        ("mbot.contract_version", "0", ContractError),
        ("mbot.contract_version", "1.5", ContractError),
        ("mbot.contract_version", "nan", ContractError),
        ("mbot.decision_rate_hz", "0.1", ContractError),
        ("mbot.decision_rate_hz", "nan", ContractError),
        ("mbot.horizontal_fov_deg", "200", ContractError),
        ("mbot.vertical_fov_deg", None, ContractError),
    ],
)
def test_bad_metadata_is_refused(key: str, value: str | None, error: type[Exception]) -> None:
    properties = PolicyMetadata("x").to_properties()
    if value is None:
        del properties[key]
    else:
        properties[key] = value
    with pytest.raises(error):
        PolicyMetadata.from_properties(properties)


@pytest.mark.parametrize("version", [1, 2])
def test_a_model_without_memory_follows_both_versions(version: int) -> None:
    batch = Tensor("observation", "uint8", ("batch", 64, 64, 3))
    assert check_signature([batch], [ACTION], version) == MemoryShape()


@pytest.mark.parametrize("batch", [1, "batch"])
def test_a_memory_is_found_whatever_the_order(batch: object) -> None:
    memory = check_signature(
        [state("state_in", 2, batch, 128), PICTURE, PREVIOUS],
        [state("state_out", 2, batch, 128), ACTION],
        version=2,
    )
    assert memory == MemoryShape(layers=2, units=128)


@pytest.mark.parametrize(
    ("inputs", "outputs", "version", "words"),
    [
        (
            [Tensor("observation", "uint8", (1, 3, 64, 64))],
            [ACTION],
            1,
            r"\[1, 3, 64, 64\], expected 'observation' uint8",
        ),
        ([PICTURE], [Tensor("action", "float16", (1, 2))], 1, "float16"),
        ([PICTURE, PREVIOUS], [ACTION], 1, r"2 inputs \(observation, previous_action\)"),
        ([PICTURE], [], 1, r"0 outputs \(none\), expected 1: action"),
        ([PICTURE, PREVIOUS], [ACTION], 2, "2 inputs .*expected 3: observation"),
        (
            [PICTURE, PREVIOUS, state("state_in", 1, 1, 8)],
            [ACTION, state("state_out", 1, 1, 9)],
            2,
            r"'state_out' float32 \[1, 1, 9\], expected 'state_out' float32 \[1, 1, 8\]",
        ),
        (
            [PICTURE, PREVIOUS, state("state_in", 1, 1, 8)],
            [ACTION],
            2,
            r"1 outputs \(action\), expected 2",
        ),
        (
            [PICTURE, PREVIOUS, state("hidden", 1, 1, 8)],
            [ACTION, state("state_out", 1, 1, 8)],
            2,
            "'hidden'.*expected 'state_in'",
        ),
        (
            [PICTURE, PREVIOUS, state("state_in", 1, 1, "units")],
            [ACTION, state("state_out", 1, 1, "units")],
            2,
            "state_in",
        ),
        (
            [PICTURE, PREVIOUS, state("state_in", 1, 1, LARGEST_STATE + 1)],
            [ACTION, state("state_out", 1, 1, LARGEST_STATE + 1)],
            2,
            f"expected 1 to {LARGEST_STATE} numbers",
        ),
    ],
)
def test_other_signatures_are_refused(
    inputs: list[Tensor], outputs: list[Tensor], version: int, words: str
) -> None:
    with pytest.raises(ContractError, match=words):
        check_signature(inputs, outputs, version)

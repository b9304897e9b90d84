import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ContractError, NewerSchemaError
from mbot_protocol.policy_contract import FieldOfView, PolicyMetadata, check_tensor


@given(st.text(max_size=30), st.floats(1, 170), st.floats(1, 170), st.floats(0.5, 20))
def test_metadata_survives_its_properties(name: str, h: float, v: float, rate: float) -> None:
    metadata = PolicyMetadata(name, FieldOfView(h, v), rate)
    assert PolicyMetadata.from_properties(metadata.to_properties()) == metadata


@pytest.mark.parametrize(
    ("key", "value", "error"),
    [
        ("mbot.contract_version", "2", NewerSchemaError),
        ("mbot.contract_version", "one", ContractError),
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


def test_tensors_are_compared_and_the_batch_may_be_symbolic() -> None:
    check_tensor("input", "observation", "uint8", ("batch", 64, 64, 3), is_input=True)
    check_tensor("output", "action", "float32", (1, 2), is_input=False)
    with pytest.raises(ContractError, match=r"\[1, 3, 64, 64\], expected 'observation' uint8"):
        check_tensor("input", "observation", "uint8", (1, 3, 64, 64), is_input=True)
    with pytest.raises(ContractError, match="float16"):
        check_tensor("output", "action", "float16", (1, 2), is_input=False)

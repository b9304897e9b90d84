import pytest

from mbot_protocol.beat.stages import percentile, span_ms, stage_ms
from mbot_protocol.v1.messages_pb2 import Decision

from ..workstation.samples import decision


def test_stages_are_relative_to_the_start() -> None:
    assert stage_ms(decision()) == {
        "captured": -30.0,
        "due": -1.0,
        "observed": 10.0,
        "decided": 20.0,
        "written": 30.0,
        "acknowledged": 40.0,
    }
    assert span_ms(decision())["frame to motors"] == 60.0


def test_a_stage_that_did_not_happen_is_left_out() -> None:
    idle = decision()
    idle.decided_monotonic_ns = 0
    assert stage_ms(idle)["decided"] is None
    assert "decide" not in span_ms(idle)
    assert set(stage_ms(Decision()).values()) == {None}


@pytest.mark.parametrize(
    ("share", "value"), [(0.5, 50), (0.99, 99), (1.0, 100), (0.001, 1), (0.501, 51)]
)
def test_percentiles_are_values_that_occurred(share: float, value: float) -> None:
    assert percentile(range(100, 0, -1), share) == value


def test_a_percentile_of_nothing_is_an_error() -> None:
    with pytest.raises(ValueError, match="0 values"):
        percentile([], 0.5)

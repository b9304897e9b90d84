import numpy as np
import pytest
import torch

from mbot_workstation.learn.learning.memory_graph import PARTS, gru, memory_parts, spelt_out_gru

CELL = torch.nn.GRU(5, 3)
WEIGHTS = {part: getattr(CELL, f"{part}_l0").detach().numpy().astype(np.float32) for part in PARTS}


@pytest.mark.parametrize("form", [gru, spelt_out_gru])
def test_the_weights_come_back_from_either_form(form: type) -> None:
    back = memory_parts(form(WEIGHTS).constants)
    assert back.keys() == WEIGHTS.keys()
    for part, weight in WEIGHTS.items():
        assert np.array_equal(back[part], weight)


def test_a_graph_without_memory_has_none() -> None:
    assert memory_parts({"first.weight": np.zeros((1, 1), np.float32)}) == {}

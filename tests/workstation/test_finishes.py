import numpy as np
import pytest

from mbot_workstation.sim.scene.finishes import FINISHES, SIDE_PX, finish


@pytest.mark.parametrize("index", range(1, FINISHES))
def test_a_finish_is_a_grey_picture_that_is_mostly_light_and_the_same_every_time(
    index: int,
) -> None:
    made = finish(index)
    assert made.shape == (SIDE_PX, SIDE_PX, 3)
    assert (made == made[..., :1]).all()
    assert 130 < made.mean() < 254
    assert made.std() > 2
    assert (made == finish(index)).all()


def test_clean_is_white() -> None:
    assert (finish(0) == 255).all()


def test_no_two_are_alike() -> None:
    made = [finish(index) for index in range(1, FINISHES)]
    for number, one in enumerate(made):
        for other in made[:number]:
            assert np.abs(one.astype(int) - other.astype(int)).mean() > 5

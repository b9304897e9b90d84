import numpy as np

from mbot_workstation.learn.evaluation.episode_film import SIDE_PX, Reel
from mbot_workstation.learn.evaluation.episodes import Trial
from mbot_workstation.learn.evaluation.pieces_above import draw_pieces
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.tasks.line import TASK

from .small_world import ROOMS


def test_a_box_is_as_large_and_as_far_away_as_it_says() -> None:
    area = np.zeros((100, 100, 3), np.uint8)
    box = Distractor("box", (0.2, 0.05, 0.1), (0.3, 0.1, 0.1), 0.0, (1.0, 0.0, 0.0))
    draw_pieces(area, [box], lambda x_m, y_m: (round(100 * x_m), round(100 * y_m)))
    rows, columns = np.nonzero(area[..., 0])
    assert (columns.min(), columns.max()) == (10, 50)
    assert (rows.min(), rows.max()) == (5, 15)
    assert not area[..., 1:].any()


def test_a_film_shows_what_the_task_has_put_there() -> None:
    reel = Reel("standing", "random", Trial(TASK.lessons[0], preset("ideal"), ROOMS, task="line"))
    above = reel.picture()[-SIDE_PX:].astype(int)
    reel.close()
    assert (above.sum(axis=2) < 90).sum() > SIDE_PX, "black tape, a pixel wide at least"

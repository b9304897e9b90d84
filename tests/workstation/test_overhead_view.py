import numpy as np
import pytest

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.overhead_view import PATH_RGB, OverheadView


def test_the_cube_is_drawn_where_the_map_says() -> None:
    simulation = Simulation(room_picture=generate_room(0, 64))
    cube = Pose(1.5, -0.8, 0.0)
    simulation.place_object(cube)
    with OverheadView(simulation, 480) as view:
        picture = view.draw(simulation.snapshot(), ORIGIN).astype(int)
        expected = view.to_pixel(cube.x_m, cube.y_m)
    red = (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 90)
    rows, columns = np.nonzero(red)
    assert (columns.mean(), rows.mean()) == pytest.approx(expected, abs=2)


def test_the_path_is_drawn_but_not_the_way_back_to_the_origin() -> None:
    simulation = Simulation(room_picture=generate_room(0, 64))
    path = [Pose(x, 1.0) for x in np.arange(0, 2, 0.1)]
    with OverheadView(simulation, 480) as view:
        pictures = [
            view.draw(simulation.snapshot(), pose) for pose in (*path, ORIGIN, Pose(0, -0.1))
        ]
        column, row = (round(v) for v in view.to_pixel(1.0, 1.0))
        between = [round(v) for v in view.to_pixel(1.0, 0.5)]
    picture = pictures[-1].astype(int)
    assert np.abs(picture[row - 1 : row + 2, column] - PATH_RGB).sum(axis=-1).min() < 120
    nearby = picture[between[1] - 5 : between[1] + 6, between[0] - 5 : between[0] + 6]
    assert np.abs(nearby - PATH_RGB).sum(axis=-1).min() > 120

import colorsys
import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.sim.body.robot_mjcf import ROBOT_CAMERA
from mbot_workstation.sim.camera.scene_renderer import Quality, SceneRenderer
from mbot_workstation.sim.effects.scene_looks import MADE_UP_FLOORS, draw_look, training_floors
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.floor_textures import made_up_floor, vinyl
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_look import (
    Distractor,
    ObjectLook,
    SceneDresser,
    SceneLook,
    nominal_look,
)
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import Rgb, Shape, TargetObject
from mbot_workstation.sim.simulation import Simulation

QUALITY = Quality(shadow_map_px=0, samples=4, reflections=False)
SIDE = 64


class Stage:
    """A robot 0.6 m before the cube, to be dressed and drawn."""

    def __init__(self) -> None:
        floors = training_floors()
        self.simulation = Simulation(room_picture=generate_room(0, 64), floors=floors)
        self.simulation.place_object(Pose(0.6, 0.0, 0.5))
        self.dresser = SceneDresser(self.simulation.model, 1 + len(floors))
        self.renderer = SceneRenderer(self.simulation, ROBOT_CAMERA, SIDE, SIDE, QUALITY)

    def picture(self, look: SceneLook) -> np.ndarray:
        self.dresser.wear(look)
        return self.renderer.draw(self.simulation.snapshot()).astype(int)


def test_looks_are_seen_and_the_nominal_one_comes_back_to_the_bit() -> None:
    stage = Stage()
    untouched = stage.renderer.draw(stage.simulation.snapshot()).astype(int)
    nominal = nominal_look(SceneParameters())
    assert (stage.picture(nominal) == untouched).all()
    changes = {
        "floor": replace(nominal, floor=3),
        "tint": replace(nominal, floor_tint=(0.5, 0.6, 0.7)),
        "walls": replace(nominal, wall_height_m=0.5, wall_rgb=(0.2, 0.4, 0.2)),
        "no walls": replace(nominal, wall_height_m=0.0),
        "foot": replace(nominal, foot_height_m=0.06),
        "size": replace(nominal, objects=(ObjectLook(scale=1.2),)),
        "red": replace(nominal, objects=(ObjectLook((0.9, 0.2, 0.0)),)),
        "worn": replace(nominal, objects=(ObjectLook(wear=1),)),
        "light": replace(nominal, light_direction=(-1.0, 0.0, -0.2)),
        "ambient": replace(nominal, ambient_rgb=(0.4, 0.4, 0.5)),
        "shadow": replace(nominal, shadow=0.5),
        "mirror": replace(nominal, floor_mirrors=0.4),
        "label": replace(nominal, objects=(ObjectLook(labelled=True),)),
        "room": replace(nominal, room_rgb=(1.0, 0.7, 0.5)),
    }
    for name, look in changes.items():
        assert (stage.picture(look) != untouched).any(), name
        assert (stage.picture(nominal) == untouched).all(), f"after {name}"


def test_distractors_come_and_go() -> None:
    stage = Stage()
    nominal = nominal_look(SceneParameters())
    before = stage.picture(nominal)
    for seed in range(20):
        look = draw_look(np.random.default_rng(seed))
        stage.picture(replace(nominal, distractors=look.distractors))
    assert (stage.picture(nominal) == before).all()


def test_distractors_are_drawn_where_they_stand() -> None:
    stage = Stage()
    nominal = nominal_look(SceneParameters())
    before = stage.picture(nominal)

    def changed_columns(x_m: float, y_m: float, yaw_rad: float = 0.0) -> list[int]:
        thing = Distractor("box", (0.02, 0.1, 0.2), (x_m, y_m, 0.2), yaw_rad, (0.0, 1.0, 0.0))
        picture = stage.picture(replace(nominal, distractors=(thing,)))
        return np.flatnonzero((picture != before).any(axis=(0, 2))).tolist()

    left, right = changed_columns(2.0, 0.6), changed_columns(2.0, -0.6)
    assert left
    assert max(left) < SIDE // 2 < min(right)
    assert len(left) < SIDE // 4 < len(changed_columns(0.5, 0.0)), "near things are large"
    assert len(changed_columns(2.0, 0.0, math.pi / 2)) < len(changed_columns(2.0, 0.0)), "edge on"
    assert changed_columns(-2.0, 0.0) == [], "it is behind the robot"


def test_what_a_task_lays_comes_before_what_else_stands_about() -> None:
    nominal = nominal_look(SceneParameters())
    assert nominal.furnished(()) is nominal
    behind = Distractor("ball", (0.1, 0.1, 0.1), (-2.0, 0.0, 0.1), 0.0, (0.0, 0.0, 1.0))
    mat = Distractor("box", (0.15, 0.15, 5e-4), (1.0, 0.0, 5e-4), 0.3, (0.0, 1.0, 0.0))
    crowded = replace(nominal, distractors=(behind,) * 200)
    assert crowded.furnished((mat,)).distractors == (mat, *(behind,) * 200)
    stage = Stage()
    before = stage.picture(crowded)
    laid = stage.picture(crowded.furnished((mat,)))
    assert ((laid - before)[..., 1] > 30).any(), "of too many things it is not left out"


def test_a_floor_that_mirrors_shows_things_upside_down() -> None:
    stage = Stage()
    dark = replace(nominal_look(SceneParameters()), wall_height_m=0.0, floor_mirrors=0.5)
    thing = Distractor("box", (0.05, 0.05, 0.3), (1.5, 0.6, 0.3), 0.0, (0.0, 1.0, 0.0))

    def green_rows(look: SceneLook) -> list[int]:
        picture = stage.picture(look)
        greener = picture[..., 1] - picture[..., [0, 2]].max(axis=2)
        return np.flatnonzero((greener > 30).any(axis=1)).tolist()

    matt = green_rows(replace(dark, floor_mirrors=0.0, distractors=(thing,)))
    mirrored = green_rows(replace(dark, distractors=(thing,)))
    assert green_rows(dark) == []
    assert max(mirrored) > max(matt) + 10, "below its foot"
    assert min(mirrored) == min(matt)


def test_a_shadow_falls_away_from_the_light() -> None:
    stage = Stage()
    dark = replace(nominal_look(SceneParameters()), shadow=0.6)

    def shadow_column(light_left: float) -> float:
        lit = replace(dark, light_direction=(0.0, light_left, -0.5))
        fallen, none = stage.picture(lit), stage.picture(replace(lit, shadow=0.0))
        return float(np.argwhere((fallen != none).any(axis=2))[:, 1].mean())

    assert shadow_column(1.0) < SIDE / 2 - 2
    assert shadow_column(-1.0) > SIDE / 2 + 2


@given(st.integers(0, 2**32))
def test_drawn_looks_stay_what_they_say(seed: int) -> None:
    look = draw_look(np.random.default_rng(seed))
    assert 0 <= look.floor <= MADE_UP_FLOORS
    (thing,) = look.objects
    assert 0.8 <= thing.scale <= 1.2
    red, green, blue = thing.rgb
    assert red > 2 * max(green, blue), "the object is red, whichever red"
    for thing in look.distractors:
        x, y, z = thing.centre_m
        stands_outside = max(abs(x), abs(y)) > 3.0
        lies_flat = z + thing.half_size_m[2] < 0.005
        assert stands_outside or lies_flat, "nothing is in a robot's way"
        assert stands_outside or thing.shape == "box"


def hue_of_red(colour: Rgb) -> float:
    """From -0.5 to 0.5, red in the middle."""
    return (colorsys.rgb_to_hsv(*colour)[0] + 0.5) % 1.0 - 0.5


def test_lookalikes_have_its_size_and_nearly_its_colour_as_often_as_asked() -> None:
    looks = [draw_look(np.random.default_rng(seed), lookalikes=0.3) for seed in range(1500)]
    things = [thing for look in looks for thing in look.distractors]
    near = [
        thing
        for thing in things
        if thing.shape in ("box", "ball")
        and len(set(thing.half_size_m)) == 1
        and 0.09 < abs(hue_of_red(thing.rgb)) < 0.21
    ]
    share = len(near) / len(things)
    assert 0.3 < share < 0.36, "and a few of those that may have any colour"
    saturations = [colorsys.rgb_to_hsv(*thing.rgb)[1] for thing in near]
    assert np.mean([saturation > 0.4 for saturation in saturations]) > 0.9
    for thing in near:
        assert max(map(abs, thing.centre_m[:2])) > 3.0, "outside the arena"


def test_coloured_boards_of_nearly_its_colour_are_oftener_with_lookalikes() -> None:
    def near(lookalikes: float) -> float:
        walls = [
            draw_look(np.random.default_rng(seed), lookalikes=lookalikes).wall_rgb
            for seed in range(1500)
        ]
        coloured = [wall for wall in walls if colorsys.rgb_to_hsv(*wall)[1] > 0.35]
        for wall in coloured:
            assert abs(hue_of_red(wall)) > 0.039, "no board is red"
        return float(np.mean([abs(hue_of_red(wall)) < 0.161 for wall in coloured]))

    assert near(0.0) < 0.35 < near(0.5)


def test_the_same_seed_makes_the_same_floor_and_its_edges_meet() -> None:
    for seed in range(12):
        tile = made_up_floor(seed)
        assert (tile.picture == made_up_floor(seed).picture).all()
        assert 0.1 <= tile.side_m <= 4.0
        assert tile.picture.shape == vinyl().picture.shape


BALL = TargetObject("ball", Shape.BALL, 0.1, 0.1, (30, 150, 50))
CAN = TargetObject("can", Shape.CYLINDER, 0.07, 0.12, (25, 60, 190))


def hue_apart(one: Rgb, other: Rgb) -> float:
    return abs((colorsys.rgb_to_hsv(*one)[0] - colorsys.rgb_to_hsv(*other)[0] + 0.5) % 1.0 - 0.5)


@given(st.integers(0, 2**32))
def test_looks_of_other_objects_are_told_from_what_is_around_them(seed: int) -> None:
    objects = (BALL, CAN)
    look = draw_look(np.random.default_rng(seed), objects)
    for thing, worn in zip(objects, look.objects, strict=True):
        assert hue_apart(worn.rgb, thing.rgb) < 0.04
        _, saturation, value = colorsys.rgb_to_hsv(*look.wall_rgb)
        if saturation > 0.25 and value > 0.1:
            assert hue_apart(look.wall_rgb, thing.rgb) > 0.03


def test_what_is_drawn_for_a_red_cube_is_drawn_for_another_object() -> None:
    """The same numbers, turned into its colour: floors, light and places are equal."""
    for seed in range(50):
        red = draw_look(np.random.default_rng(seed))
        green = draw_look(np.random.default_rng(seed), (BALL,))
        assert (red.floor, red.light_direction) == (green.floor, green.light_direction)
        assert [thing.centre_m for thing in red.distractors] == [
            thing.centre_m for thing in green.distractors
        ]
        assert red.objects[0].scale == green.objects[0].scale


def test_a_mesh_keeps_its_size_and_a_ball_does_not() -> None:
    ball = TargetObject("ball", Shape.BALL, 0.1, 0.1)
    mesh = TargetObject("mesh", Shape.MESH, 0.1, 0.1)
    looks = [draw_look(np.random.default_rng(seed), (ball, mesh)).objects for seed in range(20)]
    assert {mesh_look.scale for _, mesh_look in looks} == {1.0}
    scales = [ball_look.scale for ball_look, _ in looks]
    assert min(scales) < 0.9
    assert max(scales) > 1.1

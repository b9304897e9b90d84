import runpy
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.effects.scene_looks import SIZES
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.glb_file import MOST_TRIANGLES
from mbot_workstation.sim.scene.object_file import WIDEST_MM, read_objects
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import RED_CUBE, Footprint, Shape, TargetObject
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.fetch.rules import FetchRules

SHIPPED = Path("models/objects")


def written(folder: Path, text: str) -> Path:
    (folder / "object.toml").write_text(text)
    return folder / "object.toml"


def seen(*objects: TargetObject, kind: int = 0) -> np.ndarray:
    """What the camera shows of it, half a metre ahead; shape (240, 320, 3)."""
    simulation = Simulation(scene=SceneParameters(objects=objects))
    simulation.place_object(Pose(0.5, 0.0), kind)
    with CameraRenderer(simulation, 320, 240) as renderer:
        return renderer.picture(simulation.snapshot()).astype(int)


def area_px(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    """How many pixels are of about this hue: as far from grey as it is, the same way."""
    wanted = np.array(colour) - np.mean(colour)
    shown = picture - picture.mean(axis=2, keepdims=True)
    return int((shown @ (wanted / np.linalg.norm(wanted)) > 0.35 * np.linalg.norm(wanted)).sum())


def test_without_a_file_it_is_the_papers_red_cube() -> None:
    assert read_objects(None) == (RED_CUBE,)


def test_the_shipped_objects_are_what_they_are_called() -> None:
    (ball,) = read_objects(SHIPPED / "green-ball.toml")
    (bottle,) = read_objects(SHIPPED / "blue-bottle.toml")
    assert ball.footprint == Footprint(0, 0, 0.05)
    assert bottle.height_m == pytest.approx(0.2)
    assert bottle.footprint.half_ahead_m == pytest.approx(0.036, abs=1e-4)
    assert read_objects(SHIPPED / "ball-and-bottle.toml") == (ball, bottle)
    assert np.argmax(ball.colour_srgb) == 1
    assert np.argmax(bottle.colour_srgb) == 2
    for kind, thing in enumerate((ball, bottle)):
        picture = seen(ball, bottle, kind=kind)
        other = (bottle, ball)[kind]
        assert area_px(picture, thing.colour_srgb) > 2000
        assert area_px(picture, other.colour_srgb) == 0, "one at a time"


def test_the_bottles_surface_is_what_its_script_makes(tmp_path: Path) -> None:
    script = tmp_path / "blue_bottle.py"
    script.write_text((SHIPPED / "blue_bottle.py").read_text())
    runpy.run_path(str(script))
    made, shipped = (
        trimesh.load_mesh(folder / "blue-bottle.glb") for folder in (tmp_path, SHIPPED)
    )
    assert np.allclose(made.vertices, shipped.vertices)


def test_a_cylinder_is_as_wide_and_high_as_it_says() -> None:
    can = TargetObject("can", Shape.CYLINDER, 0.06, 0.12, (20, 160, 40))
    shown = seen(can)
    rows, columns = np.nonzero(shown[..., 1] - shown[..., 0] > 40)
    height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert height / width == pytest.approx(2, rel=0.1)
    assert can.footprint == Footprint(0, 0, 0.03)


@pytest.mark.slow
def test_a_texture_is_on_every_side(tmp_path: Path) -> None:
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::16] = stripes[:, 1::16] = (255, 255, 0)  # BGR
    cv2.imwrite(str(tmp_path / "stripes.png"), stripes)
    path = written(
        tmp_path,
        '[[object]]\nname = "box"\nshape = "cube"\nwidth_mm = 100\ntexture = "stripes.png"\n',
    )
    (box,) = read_objects(path)
    for yaw in (0.0, np.pi / 2, np.pi):
        simulation = Simulation(scene=SceneParameters(objects=(box,)))
        simulation.place_object(Pose(0.5, 0.0, yaw))
        with CameraRenderer(simulation, 320, 240) as renderer:
            middle = renderer.picture(simulation.snapshot())[110:130, 130:190].astype(int)
        assert np.ptp(middle[..., 1]) > 60, f"striped, turned by {yaw:.1f}"


def test_a_mesh_brings_its_own_texture(tmp_path: Path) -> None:
    surface = trimesh.creation.box((0.1, 0.3, 0.1))
    picture = np.full((8, 8, 3), (10, 200, 220), np.uint8)
    from PIL import Image

    surface.visual = TextureVisuals(
        uv=np.full((len(surface.vertices), 2), 0.5),
        material=PBRMaterial(baseColorTexture=Image.fromarray(picture)),
    )
    surface.export(tmp_path / "box.glb")
    text = '[[object]]\nname = "box"\nshape = "mesh"\nmesh = "box.glb"\nheight_mm = 150\n'
    (box,) = read_objects(written(tmp_path, text))
    assert (box.width_m, box.height_m) == pytest.approx((0.05, 0.15))
    assert area_px(seen(box), (10, 200, 220)) > 1000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "object is missing"),
        ('[[object]]\nname = "x"\nshape = "cone"', "expected one of cube, ball, cylinder, mesh"),
        ('[[object]]\nname = "x"\nshape = "ball"\ncolour = "#00ff00"', "width_mm is missing"),
        ('[[object]]\nname = "x"\nshape = "ball"\nwidth_mm = 100', "colour or texture is missing"),
        ('[[object]]\nname = "x"\nshape = "ball"\nwidth_mm = 5', "20"),
        ('[[object]]\nname = "x"\nshape = "cube"\nwidth_mm = 301', "300"),
        (
            '[[object]]\nname = "x"\nshape = "ball"\nwidth_mm = 90\ncolour = "#fff"',
            "colour is '#fff', expected such as \"#28a03c\"",
        ),
        (
            '[[object]]\nname = "x"\nshape = "ball"\nwidth_mm = 90\nheight_mm = 90',
            "height_mm has no meaning for a ball",
        ),
        ('[[object]]\nname = "x"\nshape = "ball"\nwidht_mm = 90', "did you mean width_mm"),
        (
            '[[object]]\nname = "x"\nshape = "cube"\nwidth_mm = 90\ntexture = "gone.png"',
            "gone.png: No such file",
        ),
        (
            '[[object]]\nname = "x"\nshape = "cube"\nwidth_mm = 90\ntexture = "object.toml"',
            "is not a picture",
        ),
        ('[[object]]\nname = "x"\nshape = "mesh"\nheight_mm = 90\nmesh = "gone.glb"', "can't read"),
        (
            '[[object]]\nname = "x"\nshape = "mesh"\nheight_mm = 90\nmesh = "object.toml"',
            "is not a GLB file",
        ),
    ],
)
def test_mistakes_are_one_line_that_says_what_to_do(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as mistake:
        read_objects(written(tmp_path, text))
    assert words in str(mistake.value)
    assert "\n" not in str(mistake.value)


@pytest.mark.parametrize("cut", [0, 4, 11, 100, 1000])
def test_a_cut_off_mesh_is_refused(tmp_path: Path, cut: int) -> None:
    whole = (SHIPPED / "blue-bottle.glb").read_bytes()
    (tmp_path / "cut.glb").write_bytes(whole[:cut])
    text = '[[object]]\nname = "x"\nshape = "mesh"\nheight_mm = 90\nmesh = "cut.glb"'
    with pytest.raises(ConfigurationError, match="is not a GLB file"):
        read_objects(written(tmp_path, text))


def test_a_mesh_that_is_too_wide_at_its_height_is_refused(tmp_path: Path) -> None:
    trimesh.creation.box((0.31, 0.1, 0.1)).export(tmp_path / "beam.glb")
    text = '[[object]]\nname = "x"\nshape = "mesh"\nheight_mm = {}\nmesh = "beam.glb"'
    read_objects(written(tmp_path, text.format(96)))
    with pytest.raises(ConfigurationError, match="'x' is 310 mm wide at that height, expected 20"):
        read_objects(written(tmp_path, text.format(100)))


def test_the_largest_object_is_not_touched_where_it_appears() -> None:
    largest = TargetObject("largest", Shape.CUBE, WIDEST_MM / 1000, 0.4)
    rules = FetchRules(footprints=(largest.footprint.scaled(SIZES[1]),))
    assert rules.footprints[0].reach_m + rules.touch_radius_m < rules.clearance_m


def test_a_mesh_of_too_many_triangles_is_refused(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=6).export(tmp_path / "fine.glb")
    text = '[[object]]\nname = "x"\nshape = "mesh"\nheight_mm = 90\nmesh = "fine.glb"'
    with pytest.raises(ConfigurationError, match=f"expected 4 to {MOST_TRIANGLES:,}; reduce"):
        read_objects(written(tmp_path, text))

"""How GLB files look once drawn: red above blue is red above blue, whatever made it so."""

import json
import struct
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.glb_file import MOST_PARTS
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import TargetObject
from mbot_workstation.sim.simulation import Simulation
from tests.workstation.bombs import png_that_says
from tests.workstation.glb_samples import BLUE, RED, Part, packed, pictured, plain, png, write_glb

WHITE, HALF_GREEN, LINEAR = (255, 255, 255), (0, 188, 0), (63, 124, 63)
LOWER, UPPER = partial(Part, 0, 0.5), partial(Part, 0.5, 1)
WHOLE = Part(material=0, uv=True)
EMPTY = {"componentType": 5121, "type": "SCALAR", "count": 0}
PRIMITIVE = {"attributes": {"POSITION": 0}, "indices": 1}


def read(path: Path, more: str = "") -> TargetObject:
    toml = path.with_suffix(".toml")
    toml.write_text(
        f'[[object]]\nname = "x"\nshape = "mesh"\nmesh = "{path.name}"\nheight_mm = 100\n{more}'
    )
    (thing,) = read_objects(toml)
    return thing


def drawn(*objects: TargetObject) -> np.ndarray:
    """The objects' middle column from above to below as it lies in the light; shape (n, 3)."""
    simulation = Simulation(scene=SceneParameters(objects=objects))
    simulation.place_object(Pose(0.4, 0.0))
    with CameraRenderer(simulation, 320, 240) as renderer:
        return renderer.picture(simulation.snapshot())[92:158, 160].astype(int)


def shade(colour: tuple[int, int, int]) -> np.ndarray:
    """What the side to the camera has of a colour: the nominal scene's ambient light."""
    return np.array(colour) * SceneParameters().light.ambient


@pytest.mark.parametrize(
    ("parts", "materials", "images", "above", "below"),
    [
        ([WHOLE], [pictured(0)], [png(RED, RED, BLUE, BLUE)], RED, BLUE),
        (
            [LOWER(material=0), UPPER(material=1)],
            [plain(1, 0, 0, 1), plain(0, 0.5, 0, 1)],
            [],
            HALF_GREEN,
            RED,
        ),
        (
            [LOWER(0, uv=True), UPPER(material=1, uv=True)],
            [pictured(0), pictured(1)],
            [png(RED), png(BLUE)],
            BLUE,
            RED,
        ),
        (
            [LOWER(0, uv=True), UPPER(material=1)],
            [pictured(0), plain(0, 0.5, 0, 1)],
            [png(RED)],
            HALF_GREEN,
            RED,
        ),
        ([LOWER(0, uv=True), UPPER()], [pictured(0)], [png(RED)], WHITE, RED),
        (
            [LOWER(0, uv=True), UPPER(colour=(0, 0, 1, 1))],
            [pictured(0)],
            [png(RED)],
            BLUE,
            RED,
        ),
        ([Part(colour=(1, 0, 0, 1))], [], [], RED, RED),
        ([Part(colour=(1, 0, 0, 1), material=0)], [plain(1, 1, 1, 1)], [], RED, RED),
        ([Part(material=0)], [plain(0.05, 0.2, 0.05, 1)], [], LINEAR, LINEAR),
        ([WHOLE], [pictured(0, 1, 0, 0, 1)], [png(WHITE)], RED, RED),
        ([WHOLE], [pictured(0, 0, 0.5, 0, 1)], [png(WHITE)], HALF_GREEN, HALF_GREEN),
    ],
    ids=[
        *("picture-red-above-blue", "two-plain-materials", "two-pictures", "picture-and-plain"),
        *("picture-and-no-material", "picture-and-vertex-colours", "vertex-colours"),
        *("vertex-colours-and-material", "linear-colour", "factor-times-picture"),
        "linear-factor-times-picture",
    ],
)
def test_it_is_drawn_as_the_format_means_it(
    tmp_path: Path, parts, materials, images, above, below
) -> None:
    column = drawn(read(write_glb(tmp_path / "x.glb", parts, materials, images)))
    np.testing.assert_allclose(column[4], shade(above), atol=2)
    np.testing.assert_allclose(column[-4], shade(below), atol=2)


def test_one_colour_given_stands_for_its_own_but_for_pictures(tmp_path: Path) -> None:
    parts = [LOWER(0, uv=True), UPPER(material=1)]
    path = write_glb(tmp_path / "x.glb", parts, [pictured(0), plain(1, 0, 0, 1)], [png(WHITE)])
    column = drawn(read(path, 'colour = "#0000ff"\n'))
    np.testing.assert_allclose(column[[4, -4]], [shade(BLUE)] * 2, atol=2)


def test_what_it_looks_like_from_afar_is_of_the_pictures_on_it(tmp_path: Path) -> None:
    parts = [LOWER(0, uv=True), UPPER(material=0)]
    thing = read(write_glb(tmp_path / "x.glb", parts[:1], [pictured(0)], [png(RED)]))
    assert not thing.is_plain
    assert thing.mean_hsv == pytest.approx((0, 1, 1))
    plain_one = read(write_glb(tmp_path / "y.glb", [Part(material=0)], [plain(0, 0, 1, 1)]))
    assert plain_one.is_plain
    assert plain_one.mean_hsv == pytest.approx((2 / 3, 1, 1))


def test_whole_numbers_of_corners_are_shares(tmp_path: Path) -> None:
    """UV of 16 bits, which the format allows: 65,535 is the picture's end."""
    path = write_glb(tmp_path / "x.glb", [WHOLE], [pictured(0)], [png(RED, RED, BLUE, BLUE)])
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    tree = json.loads(content[20 : 20 + length])
    blob = bytearray(content[28 + length :])
    told = tree["accessors"][tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]]
    at = tree["bufferViews"][told["bufferView"]]["byteOffset"]
    uv = np.frombuffer(bytes(blob[at : at + 8 * 24]), "<f4")
    blob[at : at + 4 * 24] = (uv * 65535).astype("<u2").tobytes()
    told |= {"componentType": 5123, "normalized": True}
    path.write_bytes(packed(tree, bytes(blob)))
    column = drawn(read(path))
    np.testing.assert_allclose(column[[4, -4]], [shade(RED), shade(BLUE)], atol=2)


def required(name: str) -> dict[str, list[str]]:
    return {"extensionsUsed": [name], "extensionsRequired": [name]}


MOVED = pictured(0)
MOVED["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {"KHR_texture_transform": {}}


@pytest.mark.parametrize(
    ("parts", "materials", "images", "more", "words"),
    [
        ([Part()], [], [], required("KHR_draco_mesh_compression"), "is compressed by KHR_draco"),
        ([Part()], [], [], required("EXT_meshopt_compression"), "is compressed by EXT_meshopt"),
        ([Part()], [], [], required("KHR_texture_basisu"), "needs KHR_texture_basisu"),
        ([WHOLE], [MOVED], [png(RED)], {}, "KHR_texture_transform"),
        (
            [WHOLE],
            [pictured(0)],
            [png_that_says(30_000, 30_000)],
            {},
            "more than 89,478,485 pixels",
        ),
        ([WHOLE], [pictured(0)], [b"no picture"], {}, "can't be decoded"),
        ([WHOLE], [pictured(0)], [], {"textures": [{}]}, "a kind that is not read"),
        (
            [WHOLE],
            [pictured(0)],
            [png(RED)],
            {"images": [{"uri": "skin.png"}]},
            "another file (skin.png)",
        ),
        (
            [Part(0, 1, 0, uv=True, colour=(1, 0, 0, 1))],
            [pictured(0)],
            [png(RED)],
            {},
            "colours of corne",
        ),
        ([Part(material=0)], [pictured(0)], [png(RED)], {}, "no UV"),
        (
            [Part(n, n + 1, n, uv=True) for n in range(9)],
            [pictured(0)] * 9,
            [png(RED)],
            {},
            "9 materials with a picture",
        ),
        ([Part()], [], [], {"nodes": [{"mesh": 0}] * 2000}, "24,000 triangles"),
        ([Part()], [], [], {"nodes": [{"mesh": 0}, *[{}] * MOST_PARTS]}, "20,009 nodes, meshes"),
        ([Part()], [], [], {"accessors": [EMPTY] * MOST_PARTS}, "nodes, meshes and"),
        ([Part()], [], [], {"meshes": [{"primitives": [PRIMITIVE] * MOST_PARTS}]}, "and other"),
        ([Part()], [], [], {"nodes": [{"children": [1] * MOST_PARTS}, {}]}, "and other parts"),
        (
            [Part()],
            [],
            [],
            {"accessors": [{"componentType": 5126, "type": "VEC4", "count": 10**10}] * 2},
            "640,000 MB",
        ),
    ],
)
def test_what_is_not_drawn_as_it_looks_is_refused_in_a_line(
    tmp_path: Path, parts, materials, images, more, words
) -> None:
    path = write_glb(tmp_path / "x.glb", parts, materials, images, more)
    with pytest.raises(ConfigurationError) as mistake:
        read(path)
    assert words in str(mistake.value)
    assert "\n" not in str(mistake.value)


def test_a_damaged_file_is_drawn_or_refused(tmp_path: Path) -> None:
    parts = [LOWER(0, uv=True), UPPER(colour=(0, 0, 1, 1))]
    whole = write_glb(tmp_path / "x.glb", parts, [pictured(0)], [png(RED)]).read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        (tmp_path / "x.glb").write_bytes(damaged)
        try:
            read(tmp_path / "x.glb")
        except ConfigurationError:
            refused += 1
    assert 20 < refused < 280

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.scene.glb_file import MOST_TRIANGLES, GlbMaterial, GlbSurface
from mbot_workstation.sim.scene.mesh_parts import made_mesh

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 4)], np.float64)
SIDE = np.array([[0, 1, 2], [1, 3, 2]], np.int32)


def surface(factor: float, vertices: np.ndarray = BOX, triangles: np.ndarray = SIDE) -> GlbSurface:
    return GlbSurface(vertices, triangles, GlbMaterial(np.full(3, factor)), None, None)


def test_it_stands_in_the_middle_as_high_as_it_shall() -> None:
    mesh, colour = made_mesh([surface(1)], 0.1)
    np.testing.assert_allclose(mesh.vertices_m.min(axis=0), [-0.1, -0.025, 0])
    np.testing.assert_allclose(mesh.vertices_m.max(axis=0), [0.1, 0.025, 0.1])
    assert colour == (255, 255, 255)


def test_every_triangle_of_a_palette_lies_on_its_colour() -> None:
    """As many colours as there may be triangles."""
    light = np.linspace(0, 1, 300)[:, None] * np.ones(3)
    colours = np.concatenate([light * share for share in ([1, 0, 0], [0, 1, 0], [1, 1, 1])])
    vertices = np.tile(BOX, (len(colours), 1))
    triangles = np.concatenate([SIDE[:1] + 8 * n for n in range(len(colours))]).astype(np.int32)
    of_corners = np.repeat(colours, 8, axis=0)
    surfaces = [GlbSurface(vertices, triangles, GlbMaterial(np.ones(3)), None, of_corners)]
    (part,) = made_mesh(surfaces, 0.1)[0].parts
    assert part.picture is not None
    assert part.corners_uv is not None
    rows, columns = part.picture.shape[:2]
    column, row = (part.corners_uv * (columns, rows)).astype(int).transpose(2, 0, 1)
    shown = part.picture[row, column] / 255
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear, np.repeat(colours[:, None], 3, axis=1), atol=0.005)
    assert len(colours) < MOST_TRIANGLES


def test_what_has_no_area_is_left_out() -> None:
    line = np.array([[0, 0, 0]], np.int32)
    mesh, _ = made_mesh([surface(0), surface(1, triangles=line)], 0.1)
    assert [len(part.triangles) for part in mesh.parts] == [2]
    with pytest.raises(ConfigurationError, match="flat"):
        made_mesh([surface(1, triangles=line)], 0.1)

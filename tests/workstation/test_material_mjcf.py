import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.scene.material_mjcf import add_material

PICTURE: Picture = np.random.default_rng(0).integers(0, 256, (8, 8, 3)).astype(np.uint8)


def test_a_picture_is_on_the_material_and_on_each_of_its_sides() -> None:
    spec = mujoco.MjSpec()
    add_material(spec, "flat", PICTURE, reflectance=0.25)
    add_material(spec, "box", PICTURE, on_sides=True)
    for name in ("flat", "box"):
        spec.worldbody.add_geom(name=name, size=[1, 1, 1], material=name)
    model = spec.compile()
    assert model.mat_reflectance[model.material("flat").id] == 0.25
    pixels = {
        name: model.tex_data[model.texture(name).adr[0] :][: sides * PICTURE.size]
        for name, sides in (("flat", 1), ("box", 6))
    }
    assert (pixels["flat"] == PICTURE.ravel()).all()
    assert (pixels["box"].reshape(6, -1) == PICTURE.ravel()).all()

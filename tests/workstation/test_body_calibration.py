import json
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.toml_file import read_toml
from mbot_workstation.measure.calibration.body.body_check import Finding, examine
from mbot_workstation.measure.calibration.body.body_drawing import (
    DOTS_PER_INCH,
    SHEET_MM,
    draw_body,
)
from mbot_workstation.measure.calibration.body.body_files import example_file
from mbot_workstation.measure.calibration.body.mass_properties import (
    MassProperties,
    mass_properties,
)
from mbot_workstation.sim.body.robot_mjcf import add_robot
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import (
    BodyCalibration,
    Component,
    MountCalibration,
    Weighing,
)
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    read_files,
    write_body,
)
from mbot_workstation.sim.engine import mujoco

from ..ran import WORKSTATION, ran
from .calibrations import BODY


def calibrate_body(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    return ran(*WORKSTATION, "calibrate", "body", *map(str, arguments))


def robot_of(body: BodyCalibration) -> RobotParameters:
    return CalibrationFiles(body=body).robot


def whole(body: BodyCalibration) -> MassProperties:
    return mass_properties(body, robot_of(body))


def findings(body: BodyCalibration) -> list[Finding]:
    return examine(Path("body.toml"), body, robot_of(body), whole(body))


def warnings(body: BodyCalibration) -> list[str]:
    return [finding.text for finding in findings(body) if finding.verdict == "warning"]


def changed(name: str, **fields: Any) -> BodyCalibration:
    """BODY with one component changed."""
    return msgspec.structs.replace(
        BODY,
        components=tuple(
            msgspec.structs.replace(part, **fields) if part.name == name else part
            for part in BODY.components
        ),
    )


def compiled(robot: RobotParameters) -> Any:
    spec = mujoco.MjSpec()
    add_robot(spec, robot)
    return spec.compile()


def mujocos(robot: RobotParameters) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it, as MuJoCo has them at the start."""
    model = compiled(robot)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    centre = data.subtree_com[1].copy()
    inertia = np.zeros((3, 3))
    for body in range(1, model.nbody):
        turn = data.ximat[body].reshape(3, 3)
        arm = data.xipos[body] - centre
        mass = model.body_mass[body]
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return float(model.body_mass.sum()), centre, inertia


edges = st.floats(0.006, 0.12)


@st.composite
def components(draw: st.DrawFn, name: str) -> Component:
    size = draw(st.tuples(edges, edges, edges))
    centre = (
        draw(st.floats(-0.1, 0.1)),
        draw(st.floats(-0.08, 0.08)),
        size[2] / 2 + draw(st.floats(0, 0.15)),
    )
    mass_kg = size[0] * size[1] * size[2] * draw(st.floats(500, 3000))
    uncertainty_kg = mass_kg * draw(st.floats(0, 0.2))
    return Component(
        name, mass_kg, uncertainty_kg, size, centre, "drawn", draw(st.floats(0, 0.005))
    )


bodies = st.integers(1, 5).flatmap(
    lambda count: st.tuples(*(components(f"part {n}") for n in range(count)))
)


@settings(max_examples=40)
@given(bodies, st.floats(0.01, 0.1), st.floats(0.02, 0.04))
def test_sums_agree_with_mujocos(
    parts: tuple[Component, ...], wheel_kg: float, radius_m: float
) -> None:
    body = BodyCalibration(parts, wheel_mass_kg=wheel_kg, wheel_radius_m=radius_m)
    ours = whole(body)
    mass, centre, inertia = mujocos(robot_of(body))
    assert ours.mass_kg == pytest.approx(mass)
    assert np.allclose(ours.centre_m, centre, atol=1e-9)
    assert np.allclose(ours.inertia_kg_m2, inertia, rtol=1e-6, atol=1e-10)


def test_uncertainties_are_those_of_many_weighings() -> None:
    body = changed("battery", mass_uncertainty_kg=0.02, centre_uncertainty_m=0.004)
    body = msgspec.structs.replace(body, wheel_mass_uncertainty_kg=0.004)
    rng = np.random.default_rng(0)
    masses, centres = [], []
    for _ in range(4000):  # 95 % is 1.96 standard deviations
        parts = tuple(
            msgspec.structs.replace(
                part,
                mass_kg=part.mass_kg + rng.normal() * part.mass_uncertainty_kg / 1.96,
                centre_m=tuple(
                    np.add(part.centre_m, rng.normal(size=3) * part.centre_uncertainty_m / 1.96)
                ),
            )
            for part in body.components
        )
        wheel_kg = BODY.wheel_mass_kg + rng.normal() * 0.004 / 1.96 if BODY.wheel_mass_kg else 0
        drawn = whole(msgspec.structs.replace(body, components=parts, wheel_mass_kg=wheel_kg))
        masses.append(drawn.mass_kg)
        centres.append(drawn.centre_m)
    ours = whole(body)
    assert ours.mass_uncertainty_kg == pytest.approx(1.96 * np.std(masses), rel=0.05)
    assert ours.centre_uncertainty_m == pytest.approx(1.96 * np.std(centres, axis=0), rel=0.06)


def test_the_example_is_the_nominal_robot(tmp_path: Path) -> None:
    (tmp_path / "components.toml").write_text(example_file())
    body = read_toml(tmp_path / "components.toml", BodyCalibration)
    assert robot_of(body) == RobotParameters()
    assert warnings(body) == []
    assert all(f"{name} = " in example_file() for name in Component.__struct_fields__)


def test_every_commented_line_of_the_example_can_be_used(tmp_path: Path) -> None:
    lines = example_file().splitlines()
    used = [
        line[2:] if line.startswith("# ") and (" = " in line or line == "# [[weighings]]") else line
        for line in lines
    ]
    content = tomllib.loads("\n".join(used))
    assert content["weighings"][1]["parts"] == ["camera"]
    body = msgspec.convert(content, BodyCalibration)
    assert body.caster_load_kg == 0.18
    assert warnings(body) == []


MISTAKES = [
    ("mass_kg", 420.0, "420 g would be 0.42"),
    ("mass_kg", 0.0, "mass_kg is 0.0"),
    ("mass_kg", float("nan"), "mass_kg is nan"),
    ("mass_kg", 4.2, "density of 1.09e\\+04|are these kilograms"),
    ("mass_uncertainty_kg", 2.0, "1 g is 0.001"),
    ("size_m", (160.0, 80.0, 30.0), "160 mm would be 0.16"),
    ("size_m", (0.16, 8.0, 0.03), "8 cm 0.08"),
    ("size_m", (0.00016, 0.08, 0.03), "size_m along x is 0.00016"),
    ("centre_m", (20.0, 0.0, 45.0), "20 mm would be 0.02"),
    ("centre_m", (0.02, 0.0, 0.0), "15.0 mm below the floor"),
    ("source", " ", "no source"),
    ("name", "", "name is ''"),
    ("name", "battery", "'battery' is there twice"),
    ("colour_rgb", (255, 0, 0), "colour_rgb is 255"),
]


@pytest.mark.parametrize(("key", "value", "words"), MISTAKES)
def test_a_wrong_unit_is_named(key: str, value: object, words: str, tmp_path: Path) -> None:
    document = msgspec.to_builtins(BODY)
    document["components"][0][key] = value
    if words.startswith("density"):
        document["components"][0]["size_m"] = (0.08, 0.04, 0.012)
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(document, BodyCalibration)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("wheel_mass_kg", 38.0, "38 g would be 0.038"),
        ("caster_ahead_m", 70.0, "70 mm would be 0.07"),
        ("touch_radius_m", 9.5, "9.5 cm 0.095"),
        ("weighings", (Weighing("both", 0.2, 0.001, ("wheels", "motor")),), "the part 'motor'"),
        ("components", (), "at least one"),
    ],
)
def test_a_wrong_measure_of_the_robot_is_named(key: str, value: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        msgspec.structs.replace(BODY, **{key: value})


def test_a_camera_that_stands_too_high_is_named() -> None:
    with pytest.raises(ValueError, match=r"75 mm would be 0\.075"):
        MountCalibration(height_m=75.0, ahead_m=0.06)


def test_parts_that_do_not_add_up_to_the_weighed_robot_are_named() -> None:
    heavier = msgspec.structs.replace(BODY, weighings=(Weighing("whole robot", 0.95, 0.01),))
    (warning,) = warnings(heavier)
    assert "add up to 896 g, the scale showed 950 g" in warning
    assert "54 g are missing" in warning
    lighter = msgspec.structs.replace(BODY, weighings=(Weighing("whole robot", 0.85, 0.01),))
    assert "46 g are too much" in warnings(lighter)[0]


def test_a_sub_assembly_counts_only_its_parts() -> None:
    pair = Weighing("camera and wheels", 0.226, 0.003, ("camera", "wheels"))
    assert warnings(msgspec.structs.replace(BODY, weighings=(pair,))) == []
    wrong = Weighing("camera and battery", 0.42, 0.003, ("camera", "battery"))
    assert "20 g are missing" in warnings(msgspec.structs.replace(BODY, weighings=(wrong,)))[0]


def test_parts_that_contradict_the_scale_are_refused() -> None:
    body = msgspec.structs.replace(BODY, weighings=(Weighing("whole robot", 1.4, 0.01),))
    with pytest.raises(ConfigurationError, match=r"body\.toml: whole robot: .* grams taken"):
        findings(body)


def test_the_load_on_the_caster_checks_the_centre_of_mass() -> None:
    body = msgspec.structs.replace(BODY, weighings=())
    ahead_m = whole(body).centre_m[0]
    right_kg = whole(body).mass_kg * ahead_m / 0.07
    assert warnings(msgspec.structs.replace(body, caster_load_kg=right_kg)) == []
    (warning,) = warnings(msgspec.structs.replace(body, caster_load_kg=right_kg * 2))
    assert f"by the parts {ahead_m * 1000:.1f} mm" in warning
    with pytest.raises(ConfigurationError, match="more than the whole robot"):
        findings(msgspec.structs.replace(body, caster_load_kg=1.2))


def test_a_part_behind_or_beside_is_noticed() -> None:
    assert "tip over, on its tail" in warnings(changed("frame", centre_m=(-0.06, 0, 0.045)))[0]
    assert "to the left" in warnings(changed("frame", centre_m=(0.02, 0.04, 0.045)))[0]
    assert "lens" in warnings(changed("camera", centre_m=(-0.04, 0, 0.1)))[0]
    light = changed("frame", mass_kg=0.01, mass_uncertainty_kg=0.0)
    assert any(
        "is a part missing" in text
        for text in warnings(msgspec.structs.replace(light, weighings=()))
    )


def test_a_part_in_front_of_the_lens_is_noticed() -> None:
    low = msgspec.structs.replace(
        BODY, camera_mount=MountCalibration(height_m=0.1, ahead_m=0.05, pitch_down_deg=20.0)
    )
    assert any("'frame' reaches into the camera's view" in text for text in warnings(low))


def test_overlaps_are_reported_and_twins_suspected() -> None:
    sunk = changed("battery", centre_m=(0.0, 0.0, 0.06))
    (note,) = findings(sunk)
    assert note.verdict == "note"
    assert "'frame' and 'battery' overlap by 11.0 mm along z, 50%" in note.text
    left = Component("left motor", 0.06, 0.001, (0.07, 0.02, 0.02), (0.0, 0.05, 0.02), "scale")
    right = msgspec.structs.replace(left, name="right motor")
    parts = msgspec.structs.replace(BODY, components=(left, right), weighings=())
    assert any("same place: is a sign missing" in text for text in warnings(parts))


def test_a_component_may_have_any_name_in_the_model() -> None:
    names = ("caster", "left wheel", "tail", "robot")
    parts = tuple(
        Component(name, 0.2, 0.001, (0.1, 0.05, 0.02), (0.01, 0.0, 0.03 + 0.02 * row), "scale")
        for row, name in enumerate(names)
    )
    assert compiled(robot_of(BodyCalibration(parts))).nbody == 4


def test_the_drawing_is_to_scale_and_names_everything(tmp_path: Path) -> None:
    """A bright component is as large on paper as the heading says, in the place it should be."""
    marker = Component(
        "marker", 0.1, 0.001, (0.1, 0.05, 0.03), (0.0, 0.0, 0.12), "ruler", 0.001, (0, 1, 0)
    )
    body = msgspec.structs.replace(BODY, components=(*BODY.components, marker), weighings=())
    draw_body(body, robot_of(body), whole(body), tmp_path / "body.png")
    picture = cv2.imread(str(tmp_path / "body.png"))
    assert picture is not None
    dots_per_mm = DOTS_PER_INCH / 25.4
    assert picture.shape[:2] == pytest.approx(
        [SHEET_MM[1] * dots_per_mm, SHEET_MM[0] * dots_per_mm], abs=1
    )
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    edge = ((green > 200) & (blue < 90) & (red < 90)).astype(np.uint8)
    edge = cv2.morphologyEx(edge, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))  # lines cross it
    _, _, boxes, _ = cv2.connectedComponentsWithStats(edge)
    sizes = [tuple(box[2:4] / dots_per_mm) for box in boxes[1:] if box[4] > 50]
    for width_m, height_m in ((0.1, 0.03), (0.05, 0.03), (0.1, 0.05)):
        expected = np.array([width_m, height_m]) * 1000 / 3
        assert any(np.allclose(size, expected, atol=0.6) for size in sizes), (width_m, height_m)
    draw_body(body, robot_of(body), whole(body), tmp_path / "body.svg")
    text = (tmp_path / "body.svg").read_text()
    assert "1 : 3 when printed" in text
    for part in body.components:
        assert f"<!-- {part.name} -->" in text  # matplotlib's comment beside each drawn text


def test_a_drawing_that_can_not_be_written_is_one_line(tmp_path: Path) -> None:
    for path in (tmp_path / "none" / "body.png", tmp_path / "body.xyz"):
        with pytest.raises(ConfigurationError, match=r"can't write .*body"):
            draw_body(BODY, robot_of(BODY), whole(BODY), path)


@pytest.mark.slow
def test_the_command_checks_draws_and_writes(tmp_path: Path) -> None:
    write_body(tmp_path, BODY)
    folder = tmp_path / "calibration" / "mbot-7"
    done = calibrate_body(
        tmp_path / "body.toml", "--calibration", folder, "--mjcf", tmp_path / "r.xml", "--json"
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["mass_kg"] == pytest.approx(0.896)
    assert read_files(folder).body == BODY
    assert (folder / "body.png").stat().st_size > 10_000
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "r.xml"))
    assert model.body_mass.sum() == pytest.approx(0.896)


@pytest.mark.slow
def test_the_command_refuses_and_writes_nothing(tmp_path: Path) -> None:
    text = example_file().replace("mass_kg = 0.24\n", "mass_kg = 240\n")
    (tmp_path / "components.toml").write_text(text)
    done = calibrate_body(tmp_path / "components.toml", "--calibration", tmp_path / "mbot-1")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "components.toml: components[4]: 'battery pack': mass_kg is 240.0" in done.stderr
    assert "240 g would be 0.24" in done.stderr
    too_light = example_file().replace(
        '# [[weighings]]\n# what = "whole robot"\n# mass_kg = 0.940\n# uncertainty_kg',
        '[[weighings]]\nwhat = "whole robot"\nmass_kg = 1.940\nuncertainty_kg',
    )
    assert "mass_kg = 1.940" in too_light
    (tmp_path / "components.toml").write_text(too_light)
    done = calibrate_body(tmp_path / "components.toml", "--calibration", tmp_path / "mbot-1")
    assert "the scale showed 1940 g" in done.stderr
    assert not (tmp_path / "mbot-1").exists()


@pytest.mark.slow
def test_the_printed_example_can_be_used_at_once(tmp_path: Path) -> None:
    (tmp_path / "components.toml").write_text(calibrate_body("--example").stdout)
    done = calibrate_body(tmp_path / "components.toml", "--calibration", tmp_path / "mbot-1")
    assert done.returncode == 0, done.stderr
    assert "940 +- 86 g" in done.stdout
    assert replace(read_files(tmp_path / "mbot-1").robot) == RobotParameters()
    nothing = calibrate_body()
    assert (nothing.returncode, "--example" in nothing.stderr) == (2, True)

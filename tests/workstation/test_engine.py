"""OpenGL that does not start is one line, whatever the library behind it raises."""

import os

import pytest

from mbot_workstation.sim.engine import mujoco, open_gl_context, open_renderer

from ..ran import WORKSTATION, ran

VIRTUAL = ("virtual-robot", "--seconds", "1", "--camera-port", "0")
EVALUATE = ("evaluate", "servo", "--episodes", "1", "--workers", "1")


@pytest.mark.parametrize("command", [VIRTUAL, pytest.param(EVALUATE, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("MUJOCO_GL", "gpu"),
        ("MUJOCO_GL", "glfw"),
        ("MUJOCO_EGL_DEVICE_ID", "abc"),
        pytest.param("MUJOCO_GL", "glx", marks=pytest.mark.slow),
        pytest.param("MUJOCO_GL", "osmesa", marks=pytest.mark.slow),
    ],
)
def test_a_setting_that_does_not_work_is_one_line(
    command: tuple[str, ...], name: str, value: str
) -> None:
    environment = os.environ | {name: value}
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        environment.pop(display, None)
    done = ran(*WORKSTATION, *command, env=environment)
    if value == "osmesa" and done.returncode == 0:
        pytest.skip("this machine has OSMesa")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert "off-screen OpenGL" in line
    assert value in line


def test_where_it_works_it_is_given_back() -> None:
    gl = open_gl_context(16, 16)
    gl.make_current()
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(size=[1, 1, 1])
    open_renderer(spec.compile()).free()
    gl.free()

"""MuJoCo, loaded once, with an off-screen OpenGL that works without a display.

Everything here imports MuJoCo through this module, for two reasons. The environment variables
that choose its OpenGL count only before its first import. And MuJoCo is compiled and ships no
type stubs, so its names are untyped; the aliases below at least say which thing is meant.
"""

import importlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from mbot_protocol.errors import ConfigurationError

TIMESTEP_S = 0.005
"""Against 1 ms, 6.5 s of maneuvers with full reversals end within 6 mm and 0.05 of 40 rad
(measured); a fifth of the work."""


MjSpec: TypeAlias = Any
"""mujoco.MjSpec, a model being written."""
MjModel: TypeAlias = Any
"""mujoco.MjModel, a compiled model."""
MjData: TypeAlias = Any
"""mujoco.MjData, the state of one simulation."""


_glfw_said: list[str] = []


def _load() -> Any:
    if sys.platform.startswith("linux"):
        # EGL draws without an X server; elsewhere MuJoCo's own choice is right.
        os.environ.setdefault("MUJOCO_GL", "egl")
        # Mesa's software rasteriser draws small pictures several times faster without threads
        # of its own (measured at 64 x 64), and leaves the other cores to other simulations.
        os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        with _glfw_heard():
            return importlib.import_module("mujoco")
    except ModuleNotFoundError:
        raise
    except Exception as error:  # what it loads for MUJOCO_GL raises whatever it likes
        raise _no_gl(error) from None


@contextmanager
def _glfw_heard() -> Iterator[None]:
    """GLFW only warns of what it can't do, and what comes of it is another's error."""
    with warnings.catch_warnings(record=True) as said:
        yield
    _glfw_said.extend(str(one.message) for one in said if one.category.__name__ == "GLFWError")


def _no_gl(error: Exception) -> ConfigurationError:
    backend = os.environ.get("MUJOCO_GL", "default")
    words = " ".join(str(error).split()) or type(error).__name__
    return ConfigurationError(
        f"off-screen OpenGL (MUJOCO_GL={backend}) does not start: {words}; unset MUJOCO_GL and "
        "MUJOCO_EGL_DEVICE_ID, on Debian or Ubuntu install libegl1 and libgl1-mesa-dri, or set "
        "MUJOCO_GL=glfw where there is a display"
    )


mujoco: Any = _load()


def open_gl_context(width_px: int, height_px: int) -> Any:
    """A new OpenGL context, to be freed by whoever asked for it.

    Raises:
        ConfigurationError: this machine has no working off-screen OpenGL.

    """
    try:
        with _glfw_heard():
            made = importlib.import_module("mujoco.gl_context").GLContext(width_px, height_px)
        if _glfw_said:
            raise RuntimeError(_glfw_said[0])
        return made
    except Exception as error:  # as in `_load`
        raise _no_gl(error) from None


def open_renderer(model: MjModel) -> Any:
    """MuJoCo's own part of it, in the OpenGL context that is current.

    Raises:
        ConfigurationError: there is none that works.

    """
    try:
        return mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
    except (mujoco.FatalError, RuntimeError) as error:
        raise _no_gl(error) from None

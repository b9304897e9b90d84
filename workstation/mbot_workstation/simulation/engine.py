"""MuJoCo, loaded once, with an off-screen OpenGL that works without a display.

Everything here imports MuJoCo through this module, for two reasons. The environment variables
that choose its OpenGL count only before its first import. And MuJoCo is compiled and ships no
type stubs, so its names are untyped; the aliases below at least say which thing is meant.
"""

import importlib
import os
import sys
from typing import Any, TypeAlias

from mbot_protocol.errors import ConfigurationError

MjSpec: TypeAlias = Any
"""mujoco.MjSpec, a model being written."""
MjModel: TypeAlias = Any
"""mujoco.MjModel, a compiled model."""
MjData: TypeAlias = Any
"""mujoco.MjData, the state of one simulation."""


def _load() -> Any:
    if sys.platform.startswith("linux"):
        # EGL draws without an X server; elsewhere MuJoCo's own choice is right.
        os.environ.setdefault("MUJOCO_GL", "egl")
        # Mesa's software rasteriser draws small pictures several times faster without threads
        # of its own (measured at 64 x 64), and leaves the other cores to other simulations.
        os.environ.setdefault("LP_NUM_THREADS", "0")
    return importlib.import_module("mujoco")


mujoco: Any = _load()


def open_gl_context(width_px: int, height_px: int) -> Any:
    """A new OpenGL context, to be freed by whoever asked for it.

    Raises:
        ConfigurationError: this machine has no working off-screen OpenGL.

    """
    try:
        return importlib.import_module("mujoco.gl_context").GLContext(width_px, height_px)
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        backend = os.environ.get("MUJOCO_GL", "default")
        raise ConfigurationError(
            f"off-screen OpenGL ({backend}) does not start: {error}; "
            "on Debian or Ubuntu install libegl1 and libgl1-mesa-dri, or set MUJOCO_GL=glfw "
            "where there is a display"
        ) from None

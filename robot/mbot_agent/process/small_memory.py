"""Memory that a small computer is spared: spare pools, and libraries that nothing here asks for."""

import ctypes
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader

M_ARENA_MAX = -8
"""See mallopt(3)."""

OPENSSL = ("_hashlib", "ssl")
"""Python's modules that load it where they can, though CPython has SHA-256 of its own and the
cameras read here speak plain http. 4 MB of resident memory (measured, x86-64)."""

UNUSED_NUMPY = ("numpy.fft", "numpy.ma", "numpy.polynomial", "numpy.random")
"""What numpy 1 (Debian 12's) imports with itself and the daemon never uses. 9.4 MB of resident
memory (measured, 1.26.4, x86-64); numpy 2 waits by itself."""


def share_one_pool() -> None:
    """Let all threads allocate from one pool; call it before there are any.

    glibc gives most of the daemon's twenty their own, for a speed that 2.5 decisions a second do
    not need: 1.4 MB (measured, x86-64).
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # glibc's
        libc.mallopt(M_ARENA_MAX, 1)


@contextmanager
def without_openssl() -> Generator[None]:
    """What is imported within does without. Later imports of `ssl` find it as ever."""
    names = [name for name in OPENSSL if name not in sys.modules]
    for name in names:
        sys.modules[name] = None  # pyright: ignore[reportArgumentType]: import's word for "none"
    try:
        yield
    finally:
        for name in names:
            del sys.modules[name]


def let_unused_numpy_wait() -> None:
    """Load parts of numpy when somebody uses them; call it before numpy is imported."""
    sys.meta_path.insert(0, _UnusedNumpy)


class _UnusedNumpy:
    """Finds modules; see `sys.meta_path`."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None, _target: object = None
    ) -> ModuleSpec | None:
        """Where the module is, if it is one that can wait."""
        spec = PathFinder.find_spec(name, path) if name in UNUSED_NUMPY else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec

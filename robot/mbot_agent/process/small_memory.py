"""Memory that a small computer is spared: OpenSSL, which nothing here asks for, and spare pools."""

import ctypes
import sys
from collections.abc import Generator
from contextlib import contextmanager

M_ARENA_MAX, M_MMAP_THRESHOLD = -8, -3
"""See mallopt(3)."""

LARGE_BYTES = 1 << 20
"""More than a camera's frame, which comes and goes all the time, and less than a model."""

OPENSSL = ("_hashlib", "ssl")
"""Python's modules that load it where they can, though CPython has SHA-256 of its own and the
cameras read here speak plain http. 4 MB of resident memory (measured, x86-64)."""


def share_one_pool() -> None:
    """Let all threads allocate from one pool; call it before there are any.

    glibc gives most of the daemon's twenty their own, for a speed that 2.5 decisions a second do
    not need: 1.4 MB (measured, x86-64). What is large stays out of it: between smaller blocks the
    room that a model's file has taken would not be given back, 2.3 MB (likewise).
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # glibc's
        libc.mallopt(M_ARENA_MAX, 1)
        libc.mallopt(M_MMAP_THRESHOLD, LARGE_BYTES)


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

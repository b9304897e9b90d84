"""Memory that a small computer is spared: OpenSSL, which nothing here asks for, and spare pools."""

import ctypes
import sys
from collections.abc import Generator
from contextlib import contextmanager

M_ARENA_MAX = -8
"""See mallopt(3)."""

OPENSSL = ("_hashlib", "ssl")
"""Python's modules that load it where they can, though CPython has SHA-256 of its own and the
cameras read here speak plain http. 4 MB of resident memory (measured, x86-64)."""


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

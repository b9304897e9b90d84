"""What an update makes of the processor and the memory that it runs on."""

import ctypes

import torch

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""See mallopt(3)."""

LARGEST_KEPT = 32 * 2**20
"""Bytes; glibc takes no more."""


def keep_freed_memory() -> None:
    """Let what is freed be used again instead of going back to the kernel.

    A layer's results are megabytes, and two threads that fetch such memory page by page for every
    batch wait for each other: 225 instead of 138 us for a sample, both directions (measured on an
    AMD EPYC, 2 cores).
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # glibc's
        libc.mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)
        libc.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)


def has_short_floats(device: torch.device) -> bool:
    """Whether it multiplies bfloat16 faster than float32: 105 instead of 138 us, likewise."""
    return device.type == "cpu" and bool(torch.cpu.get_capabilities().get("avx512_bf16"))

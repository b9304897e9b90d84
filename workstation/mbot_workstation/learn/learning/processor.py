"""What an update makes of the processor and the memory that it runs on."""

import ctypes
import warnings

import torch

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""See mallopt(3)."""

LARGEST_KEPT = 32 * 2**20
"""Bytes; glibc takes no more."""


def keep_freed_memory() -> None:
    """Let what is freed be used again instead of going back to the kernel.

    A layer's results are megabytes, and two threads that fetch such memory page by page for every
    batch wait for each other: 0.93 of the time of an update (`benchmarks/update.py`, best of 4 on 2
    cores of an AMD EPYC; some runs without it took half as long again).
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # glibc's
        libc.mallopt(M_MMAP_THRESHOLD, LARGEST_KEPT)
        libc.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)


def has_short_floats(device: torch.device) -> bool:
    """Whether it multiplies bfloat16 faster than float32: 0.72 of an update's time, likewise."""
    return device.type == "cpu" and bool(torch.cpu.get_capabilities().get("avx512_bf16"))


def prepare_gpu() -> None:
    """Let a GPU's convolutions and recurrences keep all of float32's digits.

    By torch's default they take ten bits of what they multiply. What the policy knows differed by
    0.0018 from what the processor makes of it, by 0.000007 without (an NVIDIA H100), and the policy
    is asked alone and in batches.
    """
    torch.backends.cudnn.allow_tf32 = False
    # The memory's weights are four parameters, which is not for whoever trains to mend.
    warnings.filterwarnings("ignore", "RNN module weights are not part of single contiguous chunk")

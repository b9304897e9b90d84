"""What a model's trial may ask of the kernel: to compute, and nothing else (seccomp).

From `confine` on this process opens no file and no socket, sends no signal to anybody else, starts
no program and no process. What it asks for is refused with EPERM, so that a library that can do
without does. Everything that a good model needs is open and loaded before.
"""

import ctypes
import errno
import platform
import struct

_PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS, _FILTER = 22, 38, 2
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM
_NO_SUCH_CALL = 0x00050000 | errno.ENOSYS

# Of a classic BPF program: load a word; jump if equal, if at least, if any bit is set; return.
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER_AT, _ARCHITECTURE_AT, _FIRST_ARGUMENT_AT = 0, 4, 16

_CLONE_THREAD = 0x00010000
_X32_BIT = 0x40000000

REFUSED = {
    "x86_64": (
        0xC000003E,
        {
            # files by name
            *(2, 85, 257, 437, 76, 82, 83, 84, 86, 87, 88, 90, 92, 94, 132, 133, 161, 165, 166),
            *(258, 259, 260, 263, 264, 265, 266, 268, 280, 303, 304, 316, 322, 428, 429, 430),
            # sockets
            *(41, 42, 49, 50, 53, 43, 288, 44, 46, 307),
            # signals, other processes, programs
            *(62, 200, 234, 129, 297, 424, 434, 438, 101, 310, 311, 57, 58, 59),
            # ways around: io_uring, bpf, perf, keys, namespaces, userfaultfd
            *(425, 426, 427, 321, 298, 248, 249, 250, 272, 308, 323),
        },
        56,
        435,
    ),
    "aarch64": (
        0xC00000B7,
        {
            *(56, 437, 45, 33, 34, 35, 36, 37, 38, 276, 39, 40, 49, 51, 53, 54, 88, 264, 265, 428),
            *(429, 430),
            *(198, 199, 200, 201, 202, 203, 242, 206, 211, 269),
            *(129, 130, 131, 138, 240, 424, 434, 438, 117, 270, 271, 221, 281),
            *(425, 426, 427, 280, 241, 217, 218, 219, 97, 268, 282),
        },
        220,
        435,
    ),
}
"""By machine: its audit number, the system calls refused, `clone` and `clone3` (the kernel's
asm/unistd.h). Tried on x86_64 only. abort() signals its own process and is refused too: libc then
ends it otherwise."""


def confine() -> bool:
    """Give up everything but computing; threads that there are already keep what they have.

    Returns:
        Whether the kernel has done so; false where it can't, or the machine is unknown to us.

    """
    known = REFUSED.get(platform.machine())
    if known is None:
        return False
    program = _program(*known)
    buffer = ctypes.create_string_buffer(program, len(program))
    header = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(buffer))
    libc = ctypes.CDLL(None, use_errno=True)
    return (
        libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
        and libc.prctl(_PR_SET_SECCOMP, _FILTER, ctypes.c_char_p(header), 0, 0) == 0
    )


def _program(architecture: int, refused: set[int], clone: int, clone3: int) -> bytes:
    """The filter: a list of questions, each of which ends it or goes on."""
    steps = [
        _step(_LOAD, _ARCHITECTURE_AT),
        _step(_EQUAL, architecture, 1, 0),
        _step(_RETURN, _REFUSE),
        _step(_LOAD, _NUMBER_AT),
        # On x86_64 the same calls have other numbers in the x32 ABI.
        _step(_AT_LEAST, _X32_BIT, 0, 1),
        _step(_RETURN, _REFUSE),
    ]
    for number in sorted(refused):
        steps += [_step(_EQUAL, number, 0, 1), _step(_RETURN, _REFUSE)]
    # Threads are allowed. clone3 hides its flags in memory; without it libc takes clone.
    steps += [_step(_EQUAL, clone3, 0, 1), _step(_RETURN, _NO_SUCH_CALL)]
    steps += [
        _step(_EQUAL, clone, 0, 3),
        _step(_LOAD, _FIRST_ARGUMENT_AT),
        _step(_ANY_BIT, _CLONE_THREAD, 1, 0),
        _step(_RETURN, _REFUSE),
        _step(_RETURN, _ALLOW),
    ]
    return b"".join(steps)


def _step(code: int, value: int, if_so: int = 0, if_not: int = 0) -> bytes:
    return struct.pack("HBBI", code, if_so, if_not, value)

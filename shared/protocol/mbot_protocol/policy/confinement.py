"""What a model's trial may ask of the kernel: to compute, and nothing else (seccomp).

Allowed is what a trial needs, by name; from `confine` on this process opens no file and no socket,
signals nobody, starts no program and no process, and changes no limit, affinity or mode. The rest
is refused with EPERM, so that a library that can do without does. Everything that a good model
needs is open and loaded before.
"""

import ctypes
import errno
import platform
import struct
from dataclasses import dataclass
from pathlib import Path

_PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS, _FILTER = 22, 38, 2
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EPERM
_NO_SUCH_CALL = 0x00050000 | errno.ENOSYS

# Of a classic BPF program: load a word; jump if equal, if at least; return.
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_NUMBER_AT, _ARCHITECTURE_AT, _ARGUMENTS_AT = 0, 4, 16

_THREAD = 0x003D0F00
"""The flags with which libc starts a thread, and no other: CLONE_VM, FS, FILES, SIGHAND, THREAD,
SYSVSEM, SETTLS, PARENT_SETTID, CHILD_CLEARTID (glibc's pthread_create)."""

_X32_BIT = 0x40000000
"""In the number of x86_64's calls in the x32 ABI, which are the same ones."""

_NEW = 435
"""clone3, which has its flags in memory, where no filter sees them. libc does without it and what
came after it (Linux 5.3) where they are not there, and is told so."""

ALLOWED = {
    # the pipes that are open
    "read": (0, 63),
    "readv": (19, 65),
    "write": (1, 64),
    "writev": (20, 66),
    "close": (3, 57),
    "fstat": (5, 80),
    "lseek": (8, 62),
    # memory
    "brk": (12, 214),
    "mmap": (9, 222),
    "mprotect": (10, 226),
    "mremap": (25, 216),
    "munmap": (11, 215),
    "madvise": (28, 233),
    "membarrier": (324, 283),
    # threads of its own, and their signals
    "futex": (202, 98),
    "set_robust_list": (273, 99),
    "rseq": (334, 293),
    "set_tid_address": (218, 96),
    "gettid": (186, 178),
    "getpid": (39, 172),
    "sched_yield": (24, 124),
    "sched_getaffinity": (204, 123),
    "getcpu": (309, 168),
    "rt_sigaction": (13, 134),
    "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139),
    "sigaltstack": (131, 132),
    "restart_syscall": (219, 128),
    "exit": (60, 93),
    "exit_group": (231, 94),
    # time, chance, and what the computer is like
    "clock_gettime": (228, 113),
    "clock_getres": (229, 114),
    "clock_nanosleep": (230, 115),
    "nanosleep": (35, 101),
    "gettimeofday": (96, 169),
    "getrandom": (318, 278),
    "getrusage": (98, 165),
    "sysinfo": (99, 179),
    "uname": (63, 160),
}
"""By name: the number on x86_64 and on aarch64 (the kernel's unistd_64.h and asm-generic/unistd.h).
A trial asks for nine of them (strace, seven models, numpy 1.26 and 2.4, onnxruntime 1.31, glibc
2.36); the rest is what Python, malloc and threads of other versions of glibc may want."""


@dataclass(frozen=True, slots=True)
class Machine:
    """A processor's numbers: its own for audit, and those of calls that are looked at closely."""

    audit: int
    column: int
    clone: int
    prlimit64: int


MACHINES = {
    "x86_64": Machine(0xC000003E, 0, 56, 302),
    "aarch64": Machine(0xC00000B7, 1, 220, 261),
}


def confine() -> bool:
    """Give up everything but computing.

    Returns:
        Whether the kernel has done so for all there is of this process; false where it can't, the
        machine is unknown to us, or there are other threads, which keep what they have.

    """
    machine = MACHINES.get(platform.machine())
    if machine is None:
        return False
    alone = len(list(Path("/proc/self/task").iterdir())) == 1
    program = bpf(machine)
    buffer = ctypes.create_string_buffer(program, len(program))
    header = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(buffer))
    libc = ctypes.CDLL(None)
    return (
        libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
        and libc.prctl(_PR_SET_SECCOMP, _FILTER, ctypes.c_char_p(header)) == 0
        and alone
    )


def bpf(machine: Machine) -> bytes:
    """The filter, a classic BPF program: questions, each of which ends it or goes on."""
    steps = [
        _step(_LOAD, _ARCHITECTURE_AT),
        _step(_EQUAL, machine.audit, 1, 0),
        _step(_RETURN, _REFUSE),
        _step(_LOAD, _NUMBER_AT),
        _step(_AT_LEAST, _X32_BIT, 0, 1),
        _step(_RETURN, _REFUSE),
        _step(_AT_LEAST, _NEW, 0, 1),
        _step(_RETURN, _NO_SUCH_CALL),
    ]
    for numbers in ALLOWED.values():
        steps += [_step(_EQUAL, numbers[machine.column], 0, 1), _step(_RETURN, _ALLOW)]
    steps += _if_arguments_are(machine.clone, {_low(0): _THREAD})
    # Its own limits are asked for, nobody's are set.
    steps += _if_arguments_are(machine.prlimit64, {_low(0): 0, _low(2): 0, _low(2) + 4: 0})
    return b"".join([*steps, _step(_RETURN, _REFUSE)])


def _if_arguments_are(number: int, words: dict[int, int]) -> list[bytes]:
    """Allow a call whose arguments are these, by where their words lie, and refuse it otherwise."""
    steps = [_step(_EQUAL, number, 0, 3 * len(words) + 1)]
    for place, word in words.items():
        steps += [_step(_LOAD, place), _step(_EQUAL, word, 1, 0), _step(_RETURN, _REFUSE)]
    return [*steps, _step(_RETURN, _ALLOW)]


def _low(argument: int) -> int:
    """Where the lower half of an argument lies; both machines are little-endian."""
    return _ARGUMENTS_AT + 8 * argument


def _step(code: int, value: int, if_so: int = 0, if_not: int = 0) -> bytes:
    return struct.pack("HBBI", code, if_so, if_not, value)

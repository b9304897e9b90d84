"""What a confined process may still do: tried out in one of its own, and for another processor by
the filter's own rules.
"""

import errno
import platform
import re
import struct
import sys
from pathlib import Path

import pytest

from mbot_protocol.policy.confinement import ALLOWED, MACHINES, Machine, bpf

from ..ran import ran
from .confined_attempts import FORBIDDEN, HARMLESS, outcome


@pytest.mark.parametrize("what", FORBIDDEN)
def test_it_is_refused_everything_but_computing(what: str) -> None:
    assert outcome(FORBIDDEN[what]) == "refused"


@pytest.mark.parametrize("what", HARMLESS)
def test_it_may_compute(what: str) -> None:
    assert outcome(HARMLESS[what]) == "done"


def test_other_threads_are_not_passed_over_in_silence() -> None:
    thread = "threading.Thread(target=threading.Event().wait, daemon=True).start()"
    assert answer_of(f"import threading; {thread}") == "False"


def answer_of(program: str) -> str:
    """What a process of its own says that confines itself."""
    program = f"{program}\nfrom mbot_protocol.policy.confinement import confine\n"
    program += "import os\nprint(confine(), flush=True)\nos._exit(0)"
    command = [sys.executable, "-c", program]
    return ran(*command).stdout.strip()


def test_a_machine_that_nobody_has_tried_is_not_confined() -> None:
    assert answer_of("import platform; platform.machine = lambda: 'riscv64'") == "False"


def test_no_program_gives_it_its_rights_back() -> None:
    """Without this promise the kernel takes a filter from root alone."""
    assert outcome("assert b'NoNewPrivs:\\t1' in os.read(status, 8192)") == "done"


def test_the_numbers_are_this_machines() -> None:
    assert platform.machine() in MACHINES
    assert outcome("os._exit(call('syscall', -1) or 0)") == "refused"


def answer(machine: Machine, number: int, *arguments: int, audit: int | None = None) -> int | None:
    """What the filter says of a call: None lets it pass, otherwise the error.

    An interpreter of as much of classic BPF as a filter may have (the kernel's seccomp_filter.rst).
    """
    words = (*arguments, *[0] * (6 - len(arguments)))
    audit = machine.audit if audit is None else audit
    data = struct.pack("<IIQ6Q", number & 0xFFFFFFFF, audit, 0, *words)
    program = list(struct.iter_unpack("HBBI", bpf(machine)))
    at = loaded = 0
    while True:
        code, if_so, if_not, value = program[at]
        at += 1
        if code == 0x20:  # load a word
            assert value % 4 == 0, "the kernel takes no such filter"
            (loaded,) = struct.unpack_from("<I", data, value)
        elif code in (0x15, 0x35):  # jump if equal, if at least
            at += if_so if (loaded == value if code == 0x15 else loaded >= value) else if_not
        elif code == 0x06:  # return
            assert value == 0x7FFF0000 or value >> 16 == 5
            return None if value == 0x7FFF0000 else value & 0xFFFF
        else:
            raise AssertionError(f"no such instruction: {code:#x}")


THREAD = 0x003D0F00
"""What `strace -e trace=clone` shows of a thread that is started."""


@pytest.mark.parametrize("name", MACHINES)
def test_just_the_list_is_allowed(name: str) -> None:
    machine = MACHINES[name]
    numbers = {both[machine.column] for both in ALLOWED.values()}
    assert len(numbers) == len(ALLOWED)
    everything = {number for number in range(2048) if answer(machine, number, 17) is None}
    assert everything == numbers
    of_nothing = {number for number in range(2048) if answer(machine, number) is None}
    assert of_nothing == {*numbers, machine.prlimit64}
    for number in numbers:
        assert answer(machine, number, audit=0x40000003) == errno.EPERM  # 32-bit x86
        assert answer(machine, number | 0x40000000) == errno.EPERM  # x32
        assert answer(machine, number - 2**31) == errno.EPERM


@pytest.mark.parametrize("name", MACHINES)
def test_threads_are_started_and_nothing_else(name: str) -> None:
    machine = MACHINES[name]
    assert answer(machine, machine.clone, THREAD) is None
    processes = [0, 17, 0x01200011, 0x00004111]  # fork, vfork
    new_namespaces = [THREAD | 1 << bit for bit in (7, 17, 25, 26, 27, 28, 29, 30)]
    for flags in (*processes, *new_namespaces, THREAD & ~0x00010000):
        assert answer(machine, machine.clone, flags) == errno.EPERM
    assert answer(machine, 435, THREAD) == errno.ENOSYS


@pytest.mark.parametrize("name", MACHINES)
def test_its_own_limits_are_asked_for_and_nobodys_are_set(name: str) -> None:
    machine = MACHINES[name]
    assert answer(machine, machine.prlimit64, 0, 7, 0, 0x7FFC0000) is None
    for pid, new in ((1, 0), (2**32 - 1, 0), (0, 0x7FFC0000), (0, 1 << 32), (1, 0x7FFC0000)):
        assert answer(machine, machine.prlimit64, pid, 7, new, 0) == errno.EPERM


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("x86_64", "/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
        ("aarch64", "/usr/include/asm-generic/unistd.h"),
    ],
)
def test_the_numbers_are_the_kernels(name: str, header: str) -> None:
    if not Path(header).exists():
        pytest.skip("linux-libc-dev is not installed")
    found = re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)", Path(header).read_text())
    numbers = {call: int(number) for call, number in found}
    machine = MACHINES[name]
    for call, both in ALLOWED.items():
        assert numbers[call] == both[machine.column]
    assert (numbers["clone"], numbers["prlimit64"]) == (machine.clone, machine.prlimit64)
    assert numbers["clone3"] == 435

"""What a confined process may still do, tried out in one of its own."""

import os
import platform
import socket
import subprocess
import sys

import pytest

from mbot_agent.models.confinement import REFUSED

PROGRAM = """
import ctypes, os, signal, socket, subprocess, sys, threading
from mbot_agent.models.confinement import confine
parent = os.getppid()
assert confine()
def attempt():
{body}
try:
    attempt()
except PermissionError:
    os.write(1, b"refused")
else:
    os.write(1, b"done")
"""

FORBIDDEN = {
    "read a file": "open('/etc/passwd')",
    "write a file": "open('/tmp/x', 'w')",
    "delete a file": "os.unlink('/tmp/nothing-of-this-name')",
    "make a folder": "os.mkdir('/tmp/x')",
    "rename": "os.rename('/tmp/a', '/tmp/b')",
    "change a mode": "os.chmod('/tmp', 0o700)",
    "truncate": "os.truncate('/etc/passwd', 0)",
    "open a socket": "socket.socket()",
    "open a Unix socket": "socket.socket(socket.AF_UNIX)",
    "signal the daemon": "os.kill(parent, 0)",
    "hold the daemon": "os.pidfd_open(parent)",
    "start a process": "os.fork()",
    "run a program": "os.execv('/bin/true', ['/bin/true'])",
}
ALLOWED = {
    "compute": "sum(range(1000))",
    "take memory": "bytearray(10_000_000)",
    "start a thread": "t = threading.Thread(target=lambda: None); t.start(); t.join()",
    "write to its pipe": "os.write(1, b'')",
}


def outcome(body: str) -> str:
    program = PROGRAM.format(body=f"    {body}")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=False
    )
    return done.stdout + done.stderr


@pytest.mark.parametrize("what", FORBIDDEN)
def test_it_is_refused_everything_but_computing(what: str) -> None:
    assert outcome(FORBIDDEN[what]) == "refused"


@pytest.mark.parametrize("what", ALLOWED)
def test_it_may_compute(what: str) -> None:
    assert outcome(ALLOWED[what]) == "done"


def test_the_numbers_are_this_machines() -> None:
    """Two calls that every machine of the list knows, by their own numbers."""
    assert platform.machine() in REFUSED
    assert outcome("socket.create_connection(('127.0.0.1', 1))") == "refused"
    with socket.create_server(("127.0.0.1", 0)):
        assert os.getpid() > 0

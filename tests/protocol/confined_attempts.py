"""What a confined process attempts, each time in one of its own. For any computer with Python: the
emulated arm64 of tests/pi has no pytest.
"""

import sys

from ..ran import ran

PROGRAM = """
import ctypes, os, resource, signal, socket, subprocess, sys, threading
from mbot_protocol.policy.confinement import confine
libc = ctypes.CDLL(None, use_errno=True)
def call(name, *arguments):
    if getattr(libc, name)(*arguments) == -1:
        raise OSError(ctypes.get_errno(), name)
parent = os.getppid()
file = os.open("/tmp", os.O_RDONLY)
status = os.open("/proc/self/status", os.O_RDONLY)
memory = ctypes.create_string_buffer(8)
vector = (ctypes.c_void_p * 2)(ctypes.addressof(memory), 8)
assert confine()
def attempt():
{body}
try:
    attempt()
except OSError as error:
    os.write(1, b"refused" if error.errno in (1, 38) else str(error).encode())
else:
    os.write(1, b"done")
"""

FORBIDDEN = {
    "read a file": "open('/etc/passwd')",
    "write a file": "open('/tmp/x', 'w')",
    "look at a file": "os.stat('/etc/passwd')",
    "list a folder": "os.listdir(file)",
    "delete a file": "os.unlink('/tmp/nothing-of-this-name')",
    "make a folder": "os.mkdir('/tmp/x')",
    "rename": "os.rename('/tmp/a', '/tmp/b')",
    "link": "os.symlink('/tmp/a', '/tmp/b')",
    "change a mode": "os.chmod('/tmp', 0o700)",
    "change a mode of what is open": "os.fchmod(file, 0o700)",
    "change an owner": "os.chown('/tmp', 0, 0)",
    "change an attribute": "os.setxattr('/tmp', 'user.x', b'')",
    "truncate": "os.truncate('/etc/passwd', 0)",
    "go elsewhere": "os.chdir('/')",
    "make a file of memory": "os.memfd_create('x')",
    "send to a device": "call('ioctl', 1, 0x5412, memory)",
    "open a socket": "socket.socket()",
    "open a Unix socket": "socket.socket(socket.AF_UNIX)",
    "open a pair of them": "socket.socketpair()",
    "signal the daemon": "os.kill(parent, 0)",
    "signal its thread": "call('tgkill', parent, parent, 0)",
    "signal everybody": "os.kill(-1, 0)",
    "hold the daemon": "os.pidfd_open(parent)",
    "trace the daemon": "call('ptrace', 16, parent, 0, 0)",
    "read the daemon's memory": "call('process_vm_readv', parent, vector, 1, vector, 1, 0)",
    "write the daemon's memory": "call('process_vm_writev', parent, vector, 1, vector, 1, 0)",
    "limit the daemon": "resource.prlimit(parent, resource.RLIMIT_CPU, (0, 0))",
    "read the daemon's limits": "resource.prlimit(parent, resource.RLIMIT_CPU)",
    "change its own limits": "call('setrlimit', resource.RLIMIT_NOFILE, bytes(16))",
    "choose the daemon's processor": "os.sched_setaffinity(parent, {0})",
    "choose its own processor": "os.sched_setaffinity(0, {0})",
    "change the scheduler": "os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))",
    "change the daemon's priority": "os.setpriority(os.PRIO_PROCESS, parent, 19)",
    "start a process": "os.fork()",
    "run a program": "os.execv('/bin/true', ['/bin/true'])",
    "start a session": "os.setsid()",
    "become somebody": "os.setuid(1000)",
    "leave a namespace": "call('unshare', 0x40000000)",
    "set itself free": "call('prctl', 22, 0, 0)",
    "share memory": "call('shmget', 0, 4096, 0o1777)",
    "mount": "call('mount', b'x', b'/tmp', b'tmpfs', 0, None)",
}
HARMLESS = {
    "compute": "sum(range(1000))",
    "take memory": "bytearray(10_000_000)",
    "start a thread": "t = threading.Thread(target=lambda: None); t.start(); t.join()",
    "write to its pipe": "os.write(1, b'')",
    "ask for its own limits": "resource.getrlimit(resource.RLIMIT_NOFILE)",
    "ask for processors": "os.sched_getaffinity(0)",
    "take time and chance": "import time; time.sleep(0.001); os.urandom(8)",
}


def outcome(body: str) -> str:
    """ "refused", "done", or what else has happened."""
    program = PROGRAM.format(body=f"    {body}")
    done = ran(sys.executable, "-c", program)
    return done.stdout + done.stderr

"""What the daemon's unit keeps from it, tried in the daemon's place; prints JSON.

Each trial has the name of the error it ended in, or "done".
"""

import errno
import json
import mmap
import os
import socket
from collections.abc import Callable


def main() -> None:
    trials: dict[str, Callable[[], object]] = {
        "camera": lambda: os.open("/dev/video0", os.O_RDWR),
        "board": lambda: os.open("/dev/ttyUSB0", os.O_RDWR | os.O_NOCTTY),
        "heap": lambda: os.open("/dev/dma_heap/system", os.O_RDWR),
        "null": lambda: os.open("/dev/null", os.O_RDWR),
        "tun": lambda: os.open("/dev/net/tun", os.O_RDWR),
        "fuse": lambda: os.open("/dev/fuse", os.O_RDWR),
        "own state": lambda: os.open("/var/lib/mbot-agent/probe", os.O_RDWR | os.O_CREAT),
        "others' state": lambda: os.open("/var/tmp/../lib/probe", os.O_RDWR | os.O_CREAT),
        "own program": lambda: os.open("/opt/mbot-agent/current/venv/bin/mbot-agent", os.O_RDWR),
        "neighbour": lambda: connect("10.0.2.2"),
        "internet": lambda: connect("192.0.2.1"),
        "code": lambda: mmap.mmap(-1, 4096, prot=mmap.PROT_WRITE | mmap.PROT_EXEC),
        "clock": lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)),
    }
    print(json.dumps({name: tried(trial) for name, trial in trials.items()}), flush=True)
    _ = bytearray(b"x") * (400 << 20)  # more than MemoryMax
    print("too much memory was given", flush=True)


def tried(trial: Callable[[], object]) -> str:
    try:
        trial()
    except OSError as error:
        return errno.errorcode[error.errno or 0]
    return "done"


def connect(address: str) -> None:
    """Send one datagram: nobody has to be there to hear it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.sendto(b"?", (address, 9))


if __name__ == "__main__":
    main()

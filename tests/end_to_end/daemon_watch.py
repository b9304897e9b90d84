"""Looking at a daemon from outside: its status without showing presence, its memory, its files."""

import threading
import time
from pathlib import Path
from typing import Self

import zenoh

from mbot_protocol.v1.messages_pb2 import Status
from mbot_protocol.wire.keys import STATUS
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.robot_session import open_session

from .processes import ROBOT_ID


class Observer:
    """Asks for the status over a bare session: the robot does not take it for a workstation."""

    def __init__(self, address: str) -> None:
        self._session = open_session(parse_address(address), None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    @property
    def session(self) -> zenoh.Session:
        return self._session

    def status(self) -> Status:
        for reply in self._session.get(STATUS.key(ROBOT_ID), timeout=10.0):
            if reply.ok is not None:
                return Status.FromString(reply.ok.payload.to_bytes())
        raise AssertionError("the daemon gave no status")

    def missed_in(self, seconds: float) -> int:
        """Decisions missed within a time; the bar is 0.

        On a machine that has no time some are missed whatever the network does, while a loop that
        waits for the network misses them all: whoever asks may try again.
        """
        before = self.status()
        time.sleep(seconds)
        after = self.status()
        missed = after.missed_ticks - before.missed_ticks
        assert after.decisions - before.decisions > missed
        return missed

    def sees_fault(self, kind: str) -> bool:
        """Whether the daemon names such a fault now."""
        return any(fault.kind == kind for fault in self.status().faults)


def resident_mb(pid: int, kind: str = "VmRSS") -> float:
    """A process's memory, in MB: all of it, or of one kind, as proc(5) names them."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{kind}:")) / 1000


def open_files(pid: int) -> int:
    """A process's descriptors."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def accepted_connections(port: int) -> int:
    """To a port of this machine, over IPv4: what a program holds, not what waits in its queue."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    established, queued = "01", "0"
    return sum(
        int(row[1].split(":")[1], 16) == port and row[3] == established and row[9] != queued
        for row in rows
    )


class PeakMemory:
    """The most memory a process held within a `with` block, looked at every 2 ms."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self.before_mb = self.peak_mb = resident_mb(pid)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def growth_mb(self) -> float:
        return self.peak_mb - self.before_mb

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(0.002):
            self.peak_mb = max(self.peak_mb, resident_mb(self._pid))

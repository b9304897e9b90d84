"""Why the daemon cannot listen at an address, and which program does."""

import errno
import os
import socket
from dataclasses import dataclass
from pathlib import Path

_LISTENING = "0A"
"""State of a socket in /proc/net/tcp (the kernel's net/tcp_states.h)."""

_AGENT = "mbot-agent"


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What keeps an address from us.

    Attributes:
        reason: in words, with what to do.
        is_agent: whether it is an mbot-agent that runs there.

    """

    reason: str
    is_agent: bool = False


def obstacle(endpoint: str) -> Obstacle | None:
    """What is in the way of listening at an endpoint such as "tcp/127.0.0.1:7447"; None if nothing.

    The address is tried, and given back at once.
    """
    host, _, port = endpoint.partition("/")[2].partition("#")[0].rpartition(":")
    host = host.strip("[]")
    if not port.isdecimal() or not 0 < int(port) < 1 << 16:
        return Obstacle(f"{port!r} is no port, expected 1 to 65535")
    try:
        (family, kind, protocol, _, address), *_ = socket.getaddrinfo(
            host, int(port), type=socket.SOCK_STREAM
        )
        with socket.socket(family, kind, protocol) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as Zenoh
            trial.bind(address)
    except socket.gaierror:
        return Obstacle(f"this computer does not know the name {host}")
    except OSError as error:
        return _explained(error, host, int(port))
    return None


def _explained(error: OSError, host: str, port: int) -> Obstacle:
    if error.errno == errno.EADDRINUSE:
        words = _holder(port)
        if words is None:
            return Obstacle(
                f"port {port} is taken by a program of another user (sudo ss -ltnp names it)"
            )
        process, name = words
        return Obstacle(f"port {port} is taken by {name} (process {process})", name == _AGENT)
    if error.errno == errno.EADDRNOTAVAIL:
        return Obstacle(f"this computer has no address {host} now (ip address shows those it has)")
    if error.errno == errno.EACCES:
        return Obstacle(f"port {port} is for root, as all below 1024 are")
    return Obstacle(f"port {port}: {error.strerror}")


def _holder(port: int) -> tuple[int, str] | None:
    """Who listens on a port, as far as this user may know: its number and its program's name."""
    sockets = {f"socket:[{inode}]" for inode in _listening_sockets(port)}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if any(str(file.readlink()) in sockets for file in (process / "fd").iterdir()):
                return int(process.name), _name(process)
        except OSError:  # another user's, or it has just ended
            continue
    return None


def _listening_sockets(port: int) -> list[str]:
    inodes: list[str] = []
    for table in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")):
        for line in table.read_text().splitlines()[1:] if table.exists() else ():
            _, local, _, state, _, _, _, _, _, inode, *_ = line.split()
            if state == _LISTENING and int(local.rpartition(":")[2], 16) == port:
                inodes.append(inode)
    return inodes


def _name(process: Path) -> str:
    """A program's, or the script's that an interpreter runs."""
    words = (process / "cmdline").read_bytes().split(b"\0")[:2]
    names = [os.fsdecode(word).rpartition("/")[2] for word in words]
    return _AGENT if _AGENT in names else names[0]

"""Somebody who may only look, and whose computer is gone from one moment to the next.

`vanished_viewer.py HOST:PORT ROBOT_ID SECONDS CA CERTIFICATE KEY`: nobody says that the connection
ends, and nothing is acknowledged any more, as when a laptop is shut or leaves the Wi-Fi. In four
sessions, again and again. Prints how often.
"""

import contextlib
import ctypes
import os
import socket
import struct
import sys
import threading
import time
from pathlib import Path

from mbot_protocol.wire.keys import DECISION
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.robot_session import open_session
from mbot_workstation.fleet.link.security import LinkSecurity

SESSIONS = 4
LOOKS_S = 0.3

NOTHING = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
"""A classic BPF program that keeps nothing of what comes in, acknowledgements included."""
ATTACH_FILTER = 26


class Tunnel:
    """One connection to the robot, byte for byte, until it is gone."""

    def __init__(self, robot: tuple[str, int]) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._robot = robot
        self._far: list[socket.socket] = []
        threading.Thread(target=self._run, daemon=True).start()

    def vanish(self) -> None:
        """Its sockets stay open: the robot hears nothing of it, not even that."""
        program = struct.pack("HxxxxxxP", 1, ctypes.addressof(NOTHING))
        self._server.close()
        for far in self._far:
            far.setsockopt(socket.SOL_SOCKET, ATTACH_FILTER, program)

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._server.accept()
                far = socket.create_connection(self._robot)
                self._far.append(far)
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=_pass_on, args=(one, other), daemon=True).start()


def _pass_on(one: socket.socket, other: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := one.recv(65536):
            other.sendall(data)


def main() -> None:
    address, robot_id, seconds, ca, certificate, key = sys.argv[1:]
    host, _, port = address.rpartition(":")
    security = LinkSecurity(Path(ca), Path(certificate), Path(key))
    until_s = time.monotonic() + float(seconds)
    gone = [0] * SESSIONS
    kept: list[object] = []

    def again_and_again(number: int) -> None:
        while time.monotonic() < until_s:
            tunnel = Tunnel((host, int(port)))
            kept.append(tunnel)
            with contextlib.suppress(Exception):
                session = open_session(Endpoint("tls", host, tunnel.port), security)
                session.declare_subscriber(DECISION.key(robot_id), lambda _: None)
                time.sleep(LOOKS_S)
                tunnel.vanish()
                gone[number] += 1
                kept.append(session)  # a close would say goodbye
            time.sleep(0.5)

    threads = [threading.Thread(target=again_and_again, args=(n,)) for n in range(SESSIONS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(float(seconds) + 20)
    print(gone, flush=True)
    os._exit(0 if all(gone) else 1)


if __name__ == "__main__":
    main()

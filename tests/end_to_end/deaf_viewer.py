"""Somebody who may only look, asks and asks, and never reads an answer.

`deaf_viewer.py HOST:PORT ROBOT_ID SECONDS [CA CERTIFICATE KEY]`. Zenoh's own client reads all there
is, so one speaks to the robot through a relay that stops reading the robot's side, and keeps the
client believing that the robot is there. Whenever it is shown out it comes again. Prints how often.
"""

import contextlib
import json
import select
import socket
import ssl
import sys
import threading
import time

import zenoh

from mbot_protocol.v1.recordings_pb2 import RecordingRead
from mbot_protocol.wire.keys import CHUNK_BYTES, RECORDING_READ, STATUS, STOP

KEEP_ALIVE = b"\x01\x00\x04"
"""A batch of one byte: Zenoh's KeepAlive."""

SESSIONS = 4

DRIVE, FILE = "drive-0001-20260101-120000", "000.mcap"
"""A recording that the robot has, of more than one piece."""


class Relay:
    """One connection to the robot, plain on this side; `deaf` from when it is told so."""

    def __init__(self, robot: tuple[str, int], context: ssl.SSLContext | None) -> None:
        self.deaf = threading.Event()
        self.over = threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        # Small from the beginning: what the robot's kernel takes for us is all that it sends.
        plain = socket.socket()
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plain.connect(robot)
        self._robot = context.wrap_socket(plain, server_hostname=robot[0]) if context else plain
        self._robot.settimeout(0.01)
        self._turn = threading.Lock()  # OpenSSL's connections are for one thread at a time
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        client, _ = self._server.accept()
        threading.Thread(target=self._down, args=(client,), daemon=True).start()
        with contextlib.suppress(OSError):
            while data := client.recv(65536):
                with self._turn:
                    self._robot.settimeout(None)
                    self._robot.sendall(data)
                    self._robot.settimeout(0.01)
        self.over.set()

    def _read(self) -> bytes:
        while True:
            select.select([self._robot], [], [], 1.0)
            with self._turn, contextlib.suppress(TimeoutError, ssl.SSLWantReadError):
                return self._robot.recv(4096)

    def _down(self, client: socket.socket) -> None:
        pending = b""
        with contextlib.suppress(OSError):
            while True:
                if self.deaf.is_set():
                    client.sendall(KEEP_ALIVE)
                    time.sleep(0.2)
                    continue
                while len(pending) < 2 or len(pending) < 2 + int.from_bytes(pending[:2], "little"):
                    pending += self._read()
                end = 2 + int.from_bytes(pending[:2], "little")
                client.sendall(pending[:end])
                pending = pending[end:]


def attack(
    robot: tuple[str, int], robot_id: str, context: ssl.SSLContext | None, until_s: float
) -> None:
    relay = Relay(robot, context)
    piece = RecordingRead(
        schema_version=1, robot_id=robot_id, drive=DRIVE, file=FILE, count_bytes=CHUNK_BYTES
    ).SerializeToString()
    config = zenoh.Config()
    for name, value in {"mode": "client", "connect/endpoints": [f"tcp/{relay.address}"]}.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        relay.deaf.set()
        asked: list[object] = []
        while time.monotonic() < until_s and not relay.over.is_set():
            for topic, payload in ((RECORDING_READ, piece), (STATUS, b""), (STOP, b"")):
                key = topic.key(robot_id)
                ring = zenoh.handlers.RingChannel(1)
                asked.append(session.get(key, ring, payload=payload, timeout=60.0))
            time.sleep(0.04)  # all four sessions together are below what counts as a flood


def main() -> None:
    address, robot_id, seconds, *files = sys.argv[1:]
    host, _, port = address.rpartition(":")
    context = None
    if files:
        context = ssl.create_default_context(cafile=files[0])
        context.load_cert_chain(files[1], files[2])
    until_s = time.monotonic() + float(seconds)
    times = [0] * SESSIONS

    def again_and_again(number: int) -> None:
        while time.monotonic() < until_s:
            with contextlib.suppress(Exception):
                times[number] += 1
                attack((host, int(port)), robot_id, context, until_s)
            time.sleep(0.05)

    threads = [threading.Thread(target=again_and_again, args=(n,)) for n in range(SESSIONS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(float(seconds) + 20)
    print(json.dumps(times), flush=True)


if __name__ == "__main__":
    main()

"""A network between a workstation and a robot that can be cut, frozen and throttled."""

import asyncio
import threading
from collections.abc import Callable
from typing import Self

CHUNK_BYTES = 4096


class NetworkProxy:
    """Forwards TCP connections to an address, on a thread of its own. A context manager.

    Attributes:
        address: where to connect to instead, HOST:PORT.

    """

    def __init__(self, target: str) -> None:
        self._host, _, port = target.rpartition(":")
        self._port = int(port)
        self.address = ""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._writers: set[asyncio.StreamWriter] = set()
        self._flowing = asyncio.Event()
        self._open = True
        self._bytes_per_s: float | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        starting = asyncio.run_coroutine_threadsafe(self._start(), self._loop)
        self.address = starting.result(10)
        return self

    def __exit__(self, *_: object) -> None:
        self._call(self._abort_all)
        self._call(self._server.close)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10)

    def cut(self) -> None:
        """End every connection and take no new one."""
        self._open = False
        self._call(self._abort_all)

    def freeze(self) -> None:
        """Let connections stand, half open: nothing goes through any more, nobody is told."""
        self._call(self._flowing.clear)

    def throttle(self, bytes_per_s: float) -> None:
        """Let so much through in each direction of each connection."""
        self._bytes_per_s = bytes_per_s

    def heal(self) -> None:
        """Be a good network again."""
        self._open, self._bytes_per_s = True, None
        self._call(self._flowing.set)

    def _call(self, act: Callable[[], object]) -> None:
        done = threading.Event()

        def run() -> None:
            act()
            done.set()

        self._loop.call_soon_threadsafe(run)
        assert done.wait(10)

    async def _start(self) -> str:
        self._flowing.set()
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        host, port = self._server.sockets[0].getsockname()
        return f"{host}:{port}"

    def _abort_all(self) -> None:
        for writer in self._writers:
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self._open:
            writer.transport.abort()
            return
        try:
            there, to_there = await asyncio.open_connection(self._host, self._port)
        except OSError:
            writer.transport.abort()
            return
        pair = {writer, to_there}
        self._writers |= pair
        await asyncio.gather(self._pump(reader, to_there), self._pump(there, writer))
        self._writers -= pair

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(CHUNK_BYTES):
                await self._flowing.wait()
                if self._bytes_per_s is not None:
                    await asyncio.sleep(len(data) / self._bytes_per_s)
                writer.write(data)
                await writer.drain()
        except OSError:
            pass
        finally:
            writer.transport.abort()

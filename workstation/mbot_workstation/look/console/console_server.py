"""Serves the console on loopback until it is interrupted."""

import asyncio
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.look.console.page_messages import LONGEST_BYTES

LOOPBACK = "127.0.0.1"
_END_WITHIN_S = 1


def listen(port: int) -> socket.socket:
    """A socket on loopback; port 0: any free one.

    Raises:
        ConfigurationError: the port is taken or not allowed.

    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise ConfigurationError(
            f"can't listen on {LOOPBACK}:{port}: {error.strerror}; is another console running? "
            "(--port)"
        ) from None
    return listener


def serve(app: ASGIApp, listener: socket.socket, on_ready: Callable[[], None]) -> None:
    """Serve until SIGINT or SIGTERM; `on_ready` is called once it answers."""
    configuration = uvicorn.Config(
        app,
        access_log=False,
        log_level="error",
        lifespan="off",
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=_END_WITHIN_S,
        ws_max_size=LONGEST_BYTES,
        ws_ping_interval=5.0,
        ws_ping_timeout=5.0,
    )
    asyncio.run(_serve(uvicorn.Server(configuration), listener, on_ready))


async def _serve(
    server: uvicorn.Server, listener: socket.socket, on_ready: Callable[[], None]
) -> None:
    serving = asyncio.create_task(server.serve([listener]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    if not serving.done():
        on_ready()
    await serving

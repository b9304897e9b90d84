"""An answer that grows: lines of JSON while the work goes on, the last says what came of it.

Work that takes long is asked for by a request of its own, so its progress needs no place in any
other conversation, and it ends with the page that asked for it.
"""

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import Executor
from typing import Any

from starlette.responses import StreamingResponse

from mbot_protocol.errors import MbotError

Line = dict[str, Any]
Tell = Callable[[Line], None]
"""Sends a line. Raises `PageGoneError` where nobody hears it any more: the work ends there."""


class PageGoneError(Exception):
    """Whoever has asked for it has closed the page."""


def progress(words: str, done: int, of: int) -> Line:
    """A line of how far it is; whatever is counted."""
    return {"kind": "progress", "words": words, "share": done / of if of else 1.0}


def in_lines(
    pool: Executor, work: Callable[[Tell], Line], headers: Mapping[str, str]
) -> StreamingResponse:
    """Have a thread of the pool do the work, and answer by what it tells and then returns.

    What it raises of ours becomes the last line, with `done` false.
    """
    loop = asyncio.get_running_loop()
    lines: asyncio.Queue[Line | None] = asyncio.Queue()
    gone = threading.Event()

    def hand_on(line: Line | None) -> None:
        if gone.is_set():
            raise PageGoneError
        try:
            loop.call_soon_threadsafe(lines.put_nowait, line)
        except RuntimeError:  # the console has ended
            raise PageGoneError from None

    def run() -> None:
        try:
            hand_on(outcome())
            hand_on(None)
        except PageGoneError:
            pass

    def outcome() -> Line:
        try:
            return work(hand_on)
        except MbotError as error:
            return _failed(str(error))
        except PageGoneError:
            raise
        except Exception as error:
            told = {"message": "a long errand failed", "exception": error}
            loop.call_soon_threadsafe(loop.call_exception_handler, told)  # into the terminal
            return _failed(f"internal error: {error}")

    async def sent() -> AsyncIterator[str]:
        try:
            pool.submit(run)
            while (line := await lines.get()) is not None:
                yield json.dumps(line) + "\n"
        finally:
            gone.set()

    return StreamingResponse(sent(), headers=headers, media_type="application/x-ndjson")


def _failed(words: str) -> Line:
    return {"kind": "answer", "done": False, "words": words}

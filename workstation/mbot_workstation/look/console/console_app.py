"""The console's web application: the page, one websocket a page, and STOP.

What the page asks for is carried out by threads, since a robot may take seconds to answer; a STOP
has threads of its own and waits for none of them.
"""

import asyncio
import itertools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from mbot_protocol.errors import MbotError
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_workstation.fleet.by_hand.hand import HandRepeat
from mbot_workstation.fleet.by_hand.hand_drive import HandDrive
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.look.collect.review_desk import ReviewDesk
from mbot_workstation.look.console.answer_lines import Line, Tell, in_lines
from mbot_workstation.look.console.door import Door
from mbot_workstation.look.console.errands import Errands
from mbot_workstation.look.console.long_errands import LongErrands
from mbot_workstation.look.console.page_messages import LONGEST_BYTES, LetGo, read_message
from mbot_workstation.look.console.robot_watch import RobotWatch

PAGE_FILES = {
    "": ("index.html", "text/html; charset=utf-8"),
    "console.css": ("console.css", "text/css; charset=utf-8"),
    "console.js": ("console.js", "text/javascript; charset=utf-8"),
}
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
REVIEW_POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
POLICY_PICTURE, CAMERA_PICTURE = b"p", b"c"
"""First byte of a binary message: whose eyes; a JPEG follows."""

BY_YOU = "You drive by hand"

_LOOK_EVERY_S = 0.04
_NO_ENTRY = 1008


class Console:
    """The application around an open link. A context manager."""

    def __init__(self, link: RobotLink, door: Door, drives: Path = Path("drives")) -> None:
        """Let in whom the door lets in; recordings that are fetched go into `drives`."""
        self._link = link
        self._owners = itertools.count(1)
        self._outboxes: dict[int, tuple[asyncio.AbstractEventLoop, asyncio.Queue[Any]]] = {}
        self._watch = RobotWatch(link)
        self._hand = HandDrive(RemoteControl(link), self._tell)
        self._errands = Errands(link)
        self._desk = ReviewDesk(drives)
        self._long = LongErrands(link, Path(), drives)
        self._saying = asyncio.Lock()
        self._stops = ThreadPoolExecutor(4, "stop")
        self._takes_long = ThreadPoolExecutor(2, "long errand")
        self._others = ThreadPoolExecutor(4, "errand")
        self._parts = ExitStack()
        routes = [
            Route("/{token}/stop", self._stop, methods=["POST"]),
            Route("/{token}/push", self._push, methods=["POST"]),
            Route("/{token}/fetch", self._fetch, methods=["POST"]),
            Route("/{token}/replay", self._replay, methods=["POST"]),
            Route("/{token}/drives", self._drives),
            Route("/{token}/review", self._review, methods=["POST"]),
            WebSocketRoute("/{token}/live", self._live),
            Route("/{token}/{name:path}", _page_file),
        ]
        self.app: ASGIApp = _Guarded(Starlette(routes=routes), door)

    def __enter__(self) -> Self:
        self._parts.callback(self._stops.shutdown, wait=False)
        self._parts.callback(self._others.shutdown, wait=False, cancel_futures=True)
        self._parts.enter_context(self._long)
        self._parts.callback(self._takes_long.shutdown, cancel_futures=True)
        self._parts.enter_context(self._watch)
        self._parts.enter_context(self._hand)
        return self

    def __exit__(self, *_: object) -> None:
        self._parts.close()

    async def _stop(self, _: Request) -> Response:
        """STOP, by a request of its own: it needs no websocket."""
        began_s = time.monotonic()
        self._hand.let_all_go()
        loop = asyncio.get_running_loop()
        try:
            # A remote control of its own, so that no other command's state is in the way.
            state = await loop.run_in_executor(self._stops, RemoteControl(self._link).stop)
            done, words = True, f"{state}, confirmed by the board"
        except MbotError as error:
            done, words = False, str(error)
        self._watch.look_now()
        took_ms = (time.monotonic() - began_s) * 1000
        return JSONResponse({"done": done, "words": words, "took_ms": round(took_ms, 1)})

    async def _push(self, request: Request) -> Response:
        """The body: a model file; it is signed, sent, and made active."""
        data = await _body(request, LARGEST_MODEL_BYTES)
        name = request.query_params.get("name", "")
        return self._lines(lambda tell: self._long.push(name, data, tell))

    async def _fetch(self, request: Request) -> Response:
        """A drive brought here."""
        drive = request.query_params.get("drive", "")
        return self._lines(lambda tell: self._long.fetch(drive, tell))

    async def _replay(self, request: Request) -> Response:
        """A drive decided again; the body: by this model, if it is not empty."""
        drive = request.query_params.get("drive", "")
        other = await _body(request, LARGEST_MODEL_BYTES)
        return self._lines(lambda tell: self._long.replay(drive, other, tell))

    async def _drives(self, _: Request) -> Response:
        """What has been fetched, as a page to look through."""
        loop = asyncio.get_running_loop()
        try:
            page, nonce = await loop.run_in_executor(self._takes_long, self._desk.page)
        except MbotError as error:
            return Response(f"{error}\n", 404, HEADERS, "text/plain")
        own = {"Content-Security-Policy": REVIEW_POLICY.format(nonce=nonce)}
        return Response(page, headers=HEADERS | own, media_type="text/html; charset=utf-8")

    async def _review(self, request: Request) -> Response:
        """What somebody says of a drive; one after another, so that nothing said is lost."""
        said = await _body(request, LONGEST_BYTES)
        async with self._saying:
            loop = asyncio.get_running_loop()
            try:
                words = await loop.run_in_executor(self._others, self._desk.change, said)
            except MbotError as error:
                return JSONResponse({"done": False, "words": str(error)}, headers=HEADERS)
        return JSONResponse({"done": True, "words": words}, headers=HEADERS)

    def _lines(self, work: Callable[[Tell], Line]) -> Response:
        return in_lines(self._takes_long, work, HEADERS)

    async def _live(self, socket: WebSocket) -> None:
        """One page: it hears what is new, and is obeyed as long as it is there."""
        await socket.accept()
        owner = next(self._owners)
        outbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._outboxes[owner] = (asyncio.get_running_loop(), outbox)
        talking = asyncio.create_task(self._talk(owner, socket, outbox))
        try:
            while True:
                self._obey(owner, await socket.receive_text(), outbox)
        except (WebSocketDisconnect, KeyError):  # KeyError: bytes where text was expected
            pass
        except MbotError as error:
            await socket.close(_NO_ENTRY, str(error)[:100])
        finally:
            self._hand.forget(owner)
            talking.cancel()
            del self._outboxes[owner]

    def _obey(self, owner: int, text: str, outbox: "asyncio.Queue[dict[str, Any]]") -> None:
        """One message of a page; raises ConfigurationError if it is none."""
        message = read_message(text)
        if isinstance(message, HandRepeat):
            if refusal := self._hand.repeat(owner, message):
                outbox.put_nowait(_hand_ended(refusal))
        elif isinstance(message, LetGo):
            self._hand.let_go(owner, message.press)
        else:

            def carry_out() -> dict[str, Any]:
                try:
                    return self._errands.carry_out(message)
                finally:
                    self._watch.look_now()

            errand = asyncio.get_running_loop().run_in_executor(self._others, carry_out)
            errand.add_done_callback(lambda done: _deliver(done, outbox))

    async def _talk(
        self, owner: int, socket: WebSocket, outbox: "asyncio.Queue[dict[str, Any]]"
    ) -> None:
        """Send answers at once, and the robot's state and pictures when they have changed."""
        shown, policy, camera = -1, b"", b""
        while True:
            try:
                answer = await asyncio.wait_for(outbox.get(), _LOOK_EVERY_S)
                await socket.send_json(answer)
            except TimeoutError:
                pass
            if self._watch.version == shown:
                continue
            view = self._watch.view()
            shown = view.version
            mine = view.state.get("state") == "manual" and self._hand.holds(owner)
            await socket.send_json(view.state | ({"headline": BY_YOU} if mine else {}))
            if view.policy_jpeg != policy:
                policy = view.policy_jpeg
                await socket.send_bytes(POLICY_PICTURE + policy)
            if view.camera_jpeg != camera:
                camera = view.camera_jpeg
                await socket.send_bytes(CAMERA_PICTURE + camera)

    def _tell(self, owner: int, words: str) -> None:
        """From the hand's thread: a page's drive has ended."""
        self._watch.look_now()
        if (found := self._outboxes.get(owner)) is not None:
            loop, outbox = found
            loop.call_soon_threadsafe(outbox.put_nowait, _hand_ended(words))


class _Guarded:
    """Lets nothing in, of whatever kind, that the door refuses."""

    def __init__(self, inner: Starlette, door: Door) -> None:
        self._inner = inner
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        acts = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        refusal = self._door.refusal(scope["path"], headers, acts=acts)
        if not refusal:
            await self._inner(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()  # the greeting, which has to be heard before it is refused
            await send({"type": "websocket.close", "code": _NO_ENTRY, "reason": refusal})
        else:
            response = Response(f"{refusal}\n", 403, HEADERS, "text/plain")
            await response(scope, receive, send)


async def _body(request: Request, most_bytes: int) -> bytes:
    """What a request brings along; raises HTTPException if it is too large."""
    gathered = bytearray()
    async for piece in request.stream():
        gathered += piece
        if len(gathered) > most_bytes:
            raise HTTPException(413, f"more than {most_bytes / 2**20:g} MiB", HEADERS)
    return bytes(gathered)


def _page_file(request: Request) -> Response:
    found = PAGE_FILES.get(request.path_params["name"])
    if found is None:
        return Response("there is no such page\n", 404, HEADERS, "text/plain")
    name, kind = found
    data = files("mbot_workstation.look.console").joinpath("page", name).read_bytes()
    return Response(data, headers=HEADERS | {"Content-Type": kind})


def _hand_ended(words: str) -> dict[str, Any]:
    return {"kind": "hand-ended", "words": words}


def _deliver(
    done: "asyncio.Future[dict[str, Any]]", outbox: "asyncio.Queue[dict[str, Any]]"
) -> None:
    if done.cancelled():
        return
    if (error := done.exception()) is not None:
        outbox.put_nowait({"kind": "answer", "done": False, "words": f"internal error: {error}"})
        raise error  # asyncio writes it into the terminal
    outbox.put_nowait(done.result())

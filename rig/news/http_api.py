"""The HTTP interface of a run, version 1. docs/news.md describes it.

Only programs of this computer reach the interface, because it is bound to 127.0.0.1. A page in a browser of
this computer is such a program, too. Therefore the header ``Host`` must be that of the interface, requests
from pages of other origins are refused, and an abort, a pause or an answer needs a token in the header
``Authorization``. A page of
another origin cannot send that header, because the interface never grants it (no CORS).
"""

import asyncio
import json
import secrets
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any, cast

import anyio
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rig.news import wording
from rig.news.bulletin import Bulletin
from rig.news.thumbnail import Format
from rig.news.wording import About

STREAMS_MAX = 16
"""Largest number of programs that may follow the events at the same time."""
_THUMBNAILS_WAITING_MAX = 8
_STREAM_POLL_S = 0.1
_EVENTS_AT_ONCE = 20
_TURN_S = 0.002
_WIDTH_PX = 320
_REASON_MAX = 200
_FIXED_HEADERS = (
    (b"cache-control", b"no-store"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"x-content-type-options", b"nosniff"),
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'"),
)


@dataclass(frozen=True)
class RunControl:
    """The functions by which another program controls a run. All return at once.

    A function that can refuse the request returns the reason, or an empty text.
    """

    abort: Callable[[str], None]  # requests the end of the run, for a reason
    pause: Callable[[str], str]  # requests a pause, for a reason
    go_on: Callable[[], str]  # ends the pause
    answer: Callable[[str], str]  # answers the question of the protocol with a word
    image: Callable[[], str]  # asks for an image of an acquisition
    end: Callable[[], str]  # ends the images of an acquisition


@dataclass(frozen=True)
class RunView:
    """The data that the HTTP interface shows of a run, and the functions that control the run."""

    about: About
    bulletin: Bulletin
    status: Callable[[], dict[str, Any]]  # returns the present status as a JSON object
    # returns a picture of a camera's newest image, given the camera's name, a width and a format. Returns
    # None before the first image.
    thumbnail: Callable[[str, int, Format], bytes | None]
    control: "RunControl"
    token: str
    port: int


def make_app(view: RunView) -> ASGIApp:
    """Return the interface as an ASGI application."""
    api = _Api(view)
    app = Starlette(
        routes=[
            Route("/v1/", api.index, methods=["GET"]),
            Route("/v1/status", api.status, methods=["GET"]),
            Route("/v1/events", api.events, methods=["GET"]),
            Route("/v1/cameras/{name}/thumbnail.{kind}", api.thumbnail, methods=["GET"]),
            Route("/v1/abort", api.abort, methods=["POST"]),
            Route("/v1/pause", api.pause, methods=["POST"]),
            Route("/v1/continue", api.go_on, methods=["POST"]),
            Route("/v1/answer", api.answer, methods=["POST"]),
            Route("/v1/image", api.image, methods=["POST"]),
            Route("/v1/end", api.end, methods=["POST"]),
        ],
        exception_handlers={HTTPException: api.refused, Exception: api.broken},
    )
    return _OnlyThisComputer(app, view)


class _Api:
    """The answers to all requests. All answers except thumbnails are made on the server's thread without
    waiting."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._streams = 0
        self._thumbnails_waiting = 0
        self._one_at_a_time = anyio.CapacityLimiter(1)

    async def index(self, _: Request) -> Response:
        places = ["status", "events", "events?since=N", "abort", "pause", "continue", "answer?word=WORD"]
        places += ["image", "end"]
        places += [f"cameras/{name}/thumbnail.png" for name in self._view.about.cameras]
        return self._json({"places": [f"/v1/{place}" for place in places]})

    async def status(self, _: Request) -> Response:
        return self._json(self._view.status())

    async def events(self, request: Request) -> Response:
        since = _whole_number(request, "since", 0)
        follow = request.query_params.get("follow", "false" if "since" in request.query_params else "true")
        if follow not in ("true", "false"):
            raise HTTPException(400, f"follow: expected true or false, got {follow!r}")
        if follow == "false":
            bulletin = self._view.bulletin
            found = bulletin.since(since)
            return self._json({"events": found, "last": bulletin.last, "ended": bulletin.closed})
        if self._streams >= STREAMS_MAX:
            raise HTTPException(503, f"{STREAMS_MAX} programs follow the events already; use since=N")
        return StreamingResponse(self._follow(since), media_type="application/x-ndjson")

    async def _follow(self, place: int) -> AsyncIterator[bytes]:
        """Yield the events of a run as they occur. If a client does not read, only its generator waits."""
        bulletin = self._view.bulletin
        self._streams += 1
        try:
            while True:
                closed = bulletin.closed
                found = bulletin.since(place, _EVENTS_AT_ONCE)
                if found:
                    place = found[-1]["n"]
                    yield b"".join(json.dumps(event, allow_nan=False).encode() + b"\n" for event in found)
                if closed and place >= bulletin.last:
                    return
                # Give other requests a turn here, because sending does not wait while the client's buffers
                # have room.
                await asyncio.sleep(_TURN_S if found else _STREAM_POLL_S)
        finally:
            self._streams -= 1

    async def thumbnail(self, request: Request) -> Response:
        view, name, kind = self._view, request.path_params["name"], request.path_params["kind"]
        if name not in view.about.cameras or kind not in ("png", "jpg"):
            raise HTTPException(404, f"expected one of {', '.join(view.about.cameras)}, as png or jpg")
        width_px = _whole_number(request, "width", _WIDTH_PX)
        if self._thumbnails_waiting >= _THUMBNAILS_WAITING_MAX:
            raise HTTPException(503, "too many thumbnails are asked for; ask again later")
        self._thumbnails_waiting += 1
        try:
            picture = await anyio.to_thread.run_sync(
                view.thumbnail, name, width_px, cast(Format, kind), limiter=self._one_at_a_time
            )
        finally:
            self._thumbnails_waiting -= 1
        if picture is None:
            raise HTTPException(404, f"camera {name} has taken no image yet")
        return Response(picture, media_type="image/png" if kind == "png" else "image/jpeg")

    async def abort(self, request: Request) -> Response:
        """End the run. The body of the request is never read, so a slow client cannot delay an abort."""
        self._require_token(request)
        reason = _text(request, "reason")
        self._view.control.abort("an abort by HTTP" + (f": {reason}" if reason else ""))
        return self._json(self._view.status(), 202)

    async def pause(self, request: Request) -> Response:
        """Hold the machine and let the images wait."""
        self._require_token(request)
        return self._accepted(self._view.control.pause(_text(request, "reason")))

    async def go_on(self, request: Request) -> Response:
        """Let a paused run go on. Its motion is commanded again."""
        self._require_token(request)
        return self._accepted(self._view.control.go_on())

    async def answer(self, request: Request) -> Response:
        """Answer the question of the protocol that waits for the operator."""
        self._require_token(request)
        word = _text(request, "word")
        if not word:
            raise HTTPException(400, "expected the word of the question, as in answer?word=done")
        return self._accepted(self._view.control.answer(word))

    async def image(self, request: Request) -> Response:
        """Take an image now, in an acquisition that takes images on request."""
        self._require_token(request)
        return self._accepted(self._view.control.image())

    async def end(self, request: Request) -> Response:
        """End the images of an acquisition. The run goes on with what follows them."""
        self._require_token(request)
        return self._accepted(self._view.control.end())

    def _require_token(self, request: Request) -> None:
        given = request.headers.get("authorization", "")
        if not secrets.compare_digest(given.encode(), f"Bearer {self._view.token}".encode()):
            raise HTTPException(401, "expected the header Authorization: Bearer TOKEN, as rig run printed it")

    def _accepted(self, refusal: str) -> Response:
        if refusal:
            raise HTTPException(409, refusal)
        return self._json(self._view.status(), 202)

    async def refused(self, _: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        return self._json({"error": error.detail}, error.status_code)

    async def broken(self, _: Request, error: Exception) -> Response:
        return self._json({"error": f"{type(error).__name__}: {error}"}, 500)

    def _json(self, table: dict[str, Any], status: int = 200) -> Response:
        return JSONResponse({**wording.head(self._view.about), **table}, status)


class _OnlyThisComputer:
    """Refuses requests for another host or from pages of other origins, and adds headers to every answer."""

    def __init__(self, app: ASGIApp, view: RunView) -> None:
        self._app = app
        self._head = wording.head(view.about)
        self._hosts = {f"{name}:{view.port}" for name in ("127.0.0.1", "localhost")}
        self._origins = {f"http://{host}" for host in self._hosts}
        simulated = b"true" if view.about.simulated else b"false"
        self._headers = [*_FIXED_HEADERS, (b"x-offaxis-simulated", simulated)]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *self._headers]
            await send(message)

        refusal = self._refusal(Headers(scope=scope))
        if refusal:
            await JSONResponse({**self._head, "error": refusal}, 403)(scope, receive, marked)
        else:
            await self._app(scope, receive, marked)

    def _refusal(self, headers: Headers) -> str:
        if headers.getlist("host") not in [[host] for host in self._hosts]:
            return f"expected the header Host to be one of {', '.join(sorted(self._hosts))}"
        origin = headers.get("origin")
        if origin is not None and origin not in self._origins:
            return "pages of other origins are refused; let the server of the console ask instead"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return "pages of other origins are refused; let the server of the console ask instead"
        return ""


def _text(request: Request, name: str) -> str:
    """Return a text of the query without control characters, cut off if it is long."""
    given = request.query_params.get(name, "")[:_REASON_MAX]
    return "".join(sign for sign in given if sign.isprintable())


def _whole_number(request: Request, name: str, default: int) -> int:
    text = request.query_params.get(name)
    if text is None:
        return default
    if not (text.isascii() and text.isdecimal() and len(text) < 12):
        raise HTTPException(400, f"{name}: expected a whole number, got {text[:20]!r}")
    return int(text)

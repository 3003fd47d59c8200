"""The panel's door: who may open its socket, what a browser is told to allow, where a sign-in may lead, and patience
with wrong passwords."""

import hashlib
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from urllib.parse import quote, urlsplit

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from opcua_skill.client import ClientError

PAGES = frozenset({"", "skill", "teach", "run", "recipes", "records", "audit"})
LONGEST_WAY = 2000
LARGEST_VERSION = 2**32 - 1
# Vue compiles templates in the browser, and NiceGUI writes its start into the page: without these two it stays empty.
POLICY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval'",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "worker-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'self'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)


def within(to: str) -> str:
    """Return a way into this panel that ``to`` names, "/" for anything else.

    Browsers read a backslash as a slash and leave out control characters, so that neither has a place in it.
    """
    if len(to) > LONGEST_WAY or any(not sign.isprintable() or sign in " \\" for sign in to):
        return "/"
    try:
        parts = urlsplit(to)
    except ValueError:
        return "/"
    steps = parts.path.split("/")
    here = not parts.scheme and not parts.netloc and parts.path.startswith("/") and steps[1] in PAGES
    if not here or any(step in {"", ".", ".."} for step in steps[2:]):
        return "/"
    query = f"?{quote(parts.query, safe='=&%+/:,')}" if parts.query else ""
    return quote(parts.path, safe="/%") + query


def way(request: Request) -> str:
    """Return where a request wants to go, to be quoted into another address."""
    query = f"?{request.url.query}" if request.url.query else ""
    return quote(within(quote(request.url.path, safe="/%") + query), safe="")


def version_number(text: str) -> str:
    """Return a version as an address names it: 0 for what is no number, and never more than there can be."""
    if not (text.isascii() and text.isdigit()):
        return "0"
    return str(min(int(text[:20]), LARGEST_VERSION))


def browser_mark(request: Request) -> str:
    """Return what a browser is known by beside its cookie: one that was copied to another does not open anything."""
    agent = request.headers.get("user-agent", "")
    address = request.client.host if request.client else ""
    return hashlib.sha256(f"{address}\0{agent}".encode()).hexdigest()


class TooManyTries(ClientError):
    """This browser has tried wrong passwords; the server was not asked, so that others may go on."""

    def __init__(self, seconds: int) -> None:
        super().__init__(f"too many wrong passwords at this browser: try again in {seconds} s")


@dataclass
class Tries:
    """Wrong passwords by browser. The server locks a name for the whole panel after five: a browser has fewer."""

    most: int = 3
    seconds: float = 60.0
    remembered: int = 1000
    _failed: OrderedDict[str, list[float]] = field(default_factory=OrderedDict)

    def check(self, browser: str) -> None:
        """Raise TooManyTries while a browser has to wait."""
        now = time.monotonic()
        recent = [at for at in self._failed.get(browser, []) if at > now - self.seconds]
        if len(recent) >= self.most:
            raise TooManyTries(max(1, round(recent[-self.most] + self.seconds - now)))

    def failed(self, browser: str) -> None:
        """Count a wrong password."""
        now = time.monotonic()
        recent = [at for at in self._failed.pop(browser, []) if at > now - self.seconds]
        self._failed[browser] = [*recent, now]
        while len(self._failed) > self.remembered:
            self._failed.popitem(last=False)

    def good(self, browser: str) -> None:
        """Forget what a browser got wrong before it got it right."""
        self._failed.pop(browser, None)


class Door:
    """ASGI middleware: adds the headers to every answer, and lets no page of somebody else open a socket or post."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or socket."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        if _foreign(scope):
            await _turn_away(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                told = list(message.get("headers", []))
                a_page = any(name == b"content-type" and value.startswith(b"text/html") for name, value in told)
                told += [*HEADERS, *([(b"cache-control", b"no-store")] if a_page else [])]
                message = {**message, "headers": told}
            await send(message)

        await self._app(scope, receive, with_headers if scope["type"] == "http" else send)


def _foreign(scope: Scope) -> bool:
    """Whether something that changes or listens is asked for by a page of another origin, or by none on a socket."""
    told = {name: value.decode("latin-1") for name, value in scope["headers"] if name in {b"origin", b"host"}}
    origin, host = told.get(b"origin"), told.get(b"host", "")
    if origin is None:
        return scope["type"] == "websocket"
    looks_only = scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}
    socket_by_http = scope["path"].startswith("/_nicegui_ws")
    if looks_only and not socket_by_http:
        return False
    try:
        return urlsplit(origin).netloc.lower() != host.lower()
    except ValueError:
        return True


async def _turn_away(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain"), *HEADERS]})
    await send({"type": "http.response.body", "body": b"This page of another origin may not ask the panel for that."})

"""The panel's process: pages, who may see them, and the web server under them."""

import asyncio
import logging
import os
import secrets
import tempfile
import uuid
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import RedirectResponse
from nicegui import app, ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from opcua_skill.panel.door import Door, browser_mark, version_number, way, within
from opcua_skill.panel.layout import STATIC, framed
from opcua_skill.panel.pages.audit import audit_page
from opcua_skill.panel.pages.library import library_page
from opcua_skill.panel.pages.recipes import recipes_page
from opcua_skill.panel.pages.records import records_page
from opcua_skill.panel.pages.run.page import run_page
from opcua_skill.panel.pages.sign_in import sign_in_page
from opcua_skill.panel.pages.skill.page import skill_page
from opcua_skill.panel.pages.teach import teach_page
from opcua_skill.panel.sessions import LONGEST, Sessions

log = logging.getLogger(__name__)

SHOWN_WITHIN = 30.0
# NiceGUI gives a page up after three seconds, with an error: a busy server may take longer.
page_at = partial(ui.page, response_timeout=SHOWN_WITHIN + 10.0)
LOOPBACK = ("127.0.0.1", "localhost", "[::1]", "::1")


@dataclass(frozen=True, slots=True)
class Address:
    """Where the page is served. Another host than this machine needs a certificate: passwords go over it."""

    host: str = "127.0.0.1"
    port: int = 8080
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if self.host not in LOOPBACK and not (self.certificate and self.key):
            raise ValueError(
                f"host {self.host} can be reached from other machines: give --certificate and --key (TLS) as well"
            )

    @property
    def url(self) -> str:
        """The address to open in a browser."""
        return f"{'https' if self.certificate else 'http'}://{self.host}:{self.port}"

    @property
    def names(self) -> list[str]:
        """The host names a browser may ask for: any other is a page of somebody else that was led here."""
        return ["*"] if self.host in ("0.0.0.0", "::") else sorted({self.host, *LOOPBACK})


def build(sessions: Sessions) -> None:
    """Register the pages. Nothing is shown to a browser at which nobody is signed in, but the sign-in page."""

    def signed_in(show: Callable[..., Awaitable[None]], here: str) -> Callable[..., Awaitable[Response | None]]:
        async def page(request: Request, **given: Any) -> Response | None:
            browser = request.session["id"]
            session = sessions.of(browser, browser_mark(request))
            if session is None:
                return RedirectResponse(f"/sign-in?to={way(request)}")
            sessions.page_opened(browser)
            ui.context.client.on_delete(lambda: sessions.page_closed(browser))
            frame = framed(session, here, way(request))
            try:
                async with asyncio.timeout(SHOWN_WITHIN):
                    await show(frame, **given)
            except TimeoutError:
                log.warning("%s took longer than %g s", request.url.path[:200], SHOWN_WITHIN)
                ui.label(frame.words("The server takes long to answer: open the page again.")).classes("check-bad")
            except Exception:
                log.exception("%s could not be shown", request.url.path[:200])
                ui.label(frame.words("This page could not be shown; the panel's log says why.")).classes("check-bad")
            return None

        return page

    @page_at("/sign-in")
    def sign_in(request: Request, to: str = "/") -> None:
        sign_in_page(sessions, request.session["id"], to, request.headers.get("accept-language", ""))

    @app.get("/enter")
    async def enter(request: Request, ticket: str = "", to: str = "/") -> Response:
        fresh = await sessions.enter(ticket, request.session["id"], browser_mark(request))
        if fresh is None:
            return RedirectResponse(f"/sign-in?to={quote(within(to), safe='')}")
        request.session["id"] = fresh
        return RedirectResponse(within(to))

    @page_at("/sign-out")
    async def sign_out(request: Request, to: str = "/") -> Response:
        await sessions.sign_out(request.session["id"])
        request.session["id"] = str(uuid.uuid4())
        return RedirectResponse(f"/sign-in?to={quote(within(to), safe='')}")

    library = signed_in(library_page, "Library")

    @page_at("/")
    async def _library(request: Request) -> Response | None:
        return await library(request)

    skill = signed_in(skill_page, "Library")

    @page_at("/skill/{name}")
    async def _skill(request: Request, name: str, version: str = "0") -> Response | None:
        return await skill(request, name=name, version=version_number(version))

    teach = signed_in(teach_page, "Teach")

    @page_at("/teach")
    async def _teach(request: Request) -> Response | None:
        return await teach(request)

    running = signed_in(run_page, "Run")

    @page_at("/run")
    async def _run(request: Request, skill: str = "", version: str = "0", recipe: str = "") -> Response | None:
        return await running(request, skill=skill, version=version_number(version), recipe=recipe)

    recipes = signed_in(recipes_page, "Run")

    @page_at("/recipes")
    async def _recipes(request: Request, skill: str = "") -> Response | None:
        return await recipes(request, skill=skill)

    records = signed_in(records_page, "Records")

    @page_at("/records")
    async def _records(request: Request) -> Response | None:
        return await records(request)

    trail = signed_in(audit_page, "Records")

    @page_at("/audit")
    async def _audit(request: Request) -> Response | None:
        return await trail(request)

    @app.get("/healthz")
    def healthy() -> dict[str, bool]:
        return {"ok": True}

    @app.get("/readyz")
    def ready() -> dict[str, bool]:
        return {"ready": True}

    app.add_static_files("/panel-static", STATIC)
    app.on_shutdown(sessions.close)


def _stayed(record: logging.LogRecord) -> bool:
    """Whether a logged fault is one: a browser that leaves in the middle of a request is none."""
    fault = record.exc_info[1] if record.exc_info else None
    return not (isinstance(fault, RuntimeError) and str(fault) == "No response returned.")


async def _once_it_listens(address: Address, on_ready: Callable[[str], None]) -> None:
    """Call ``on_ready`` when the port answers: the web server starts its pages first and listens afterwards."""
    here = address.host if address.host not in ("0.0.0.0", "::") else "127.0.0.1"
    while True:
        try:
            _, writer = await asyncio.open_connection(here.strip("[]"), address.port)
        except OSError:
            await asyncio.sleep(0.02)
            continue
        writer.close()
        on_ready(address.url)
        return


def run(server: str, address: Address, *, folder: Path | None = None, on_ready: Callable[[str], None]) -> None:
    """Serve the panel until Ctrl-C. ``on_ready`` is called with the page's address once it can be opened."""
    logging.getLogger("uvicorn.error").addFilter(_stayed)
    sessions = Sessions(server, folder)
    build(sessions)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=address.names)
    app.add_middleware(Door)
    waiting: list[asyncio.Task[None]] = []
    app.on_startup(lambda: waiting.append(asyncio.create_task(_once_it_listens(address, on_ready))))
    with tempfile.TemporaryDirectory(prefix="opcua-skill-panel-") as nothing_kept:
        os.environ["NICEGUI_STORAGE_PATH"] = nothing_kept
        tls: dict[str, Any] = {}
        if address.certificate:
            tls = {"ssl_certfile": str(address.certificate), "ssl_keyfile": str(address.key)}
        ui.run(
            host=address.host,
            port=address.port,
            title="opcua-skill",
            favicon=STATIC / "panel.svg",
            show=False,
            tailwind=False,  # it would look at every change of the page; panel.css has the few rules that are used
            reload=False,
            show_welcome_message=False,
            storage_secret=secrets.token_urlsafe(32),
            session_middleware_kwargs={
                "same_site": "strict",
                "https_only": bool(address.certificate),
                "max_age": int(LONGEST),
            },
            reconnect_timeout=10.0,
            **tls,
        )

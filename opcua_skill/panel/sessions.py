"""Who is signed in at which browser. Passwords and connections live in this process's memory only."""

import asyncio
import logging
import secrets
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path

from opcua_skill.client import NotSignedIn
from opcua_skill.panel.door import Tries
from opcua_skill.panel.session import PanelSession

log = logging.getLogger(__name__)

GRACE = 600.0
ENTERED_WITHIN = 30.0
LONGEST = 12 * 3600.0


@dataclass(frozen=True)
class _Seat:
    """Somebody signed in at a browser, known by ``mark`` beside its cookie, since ``since`` (monotonic s)."""

    session: PanelSession
    mark: str
    since: float


@dataclass
class Sessions:
    """The panel's signed-in browsers, by the id in their signed cookie.

    A session whose last page was closed ``grace`` s ago is signed out; a reload or a short walk does not end it. None
    is longer than ``longest`` s. A sign-in gets a new id, so that nobody who knew the old one comes in with it.
    """

    url: str
    folder: Path | None = None
    grace: float = GRACE
    longest: float = LONGEST
    tries: Tries = field(default_factory=Tries)
    _by_browser: dict[str, _Seat] = field(default_factory=dict)
    _waiting: dict[str, tuple[str, PanelSession]] = field(default_factory=dict)
    _pages: dict[str, int] = field(default_factory=dict)
    _leaving: dict[str, "asyncio.Task[None]"] = field(default_factory=dict)

    def of(self, browser: str, mark: str) -> PanelSession | None:
        """Return who is signed in at a browser, or None."""
        seat = self._by_browser.get(browser)
        if seat is None or seat.mark != mark or seat.session.ended:
            return None
        return seat.session if time.monotonic() - seat.since < self.longest else None

    async def sign_in(self, browser: str, user: str, password: str, language: str) -> str:
        """Sign somebody in and return a ticket, with which this browser enters once; raises ClientError."""
        self.tries.check(browser)
        session = PanelSession(self.url, user, password, self.folder, language=language)
        try:
            await session.open()
        except NotSignedIn as refused:
            if refused.wrong_user:
                self.tries.failed(browser)
            raise
        self.tries.good(browser)
        ticket = secrets.token_urlsafe(24)
        self._waiting[ticket] = (browser, session)
        self._leaving[ticket] = asyncio.create_task(self._miss(ticket))
        return ticket

    async def enter(self, ticket: str, browser: str, mark: str) -> str | None:
        """Return the new id of a browser that comes with its ticket; whoever was there before is signed out."""
        if ticket not in self._waiting or self._waiting[ticket][0] != browser:
            return None
        _, session = self._waiting.pop(ticket)
        self._leaving.pop(ticket).cancel()
        await self.sign_out(browser)
        fresh = str(uuid.uuid4())
        self._by_browser[fresh] = _Seat(session, mark, time.monotonic())
        log.info("%s signed in at the panel", session.user)
        return fresh

    async def sign_out(self, browser: str) -> None:
        """End a browser's session, if it has one."""
        if leaving := self._leaving.pop(browser, None):
            leaving.cancel()
        self._pages.pop(browser, None)
        if seat := self._by_browser.pop(browser, None):
            await seat.session.close()
            log.info("%s signed out of the panel", seat.session.user)

    def page_opened(self, browser: str) -> None:
        """Count a page that shows a browser's session."""
        self._pages[browser] = self._pages.get(browser, 0) + 1
        if leaving := self._leaving.pop(browser, None):
            leaving.cancel()

    def page_closed(self, browser: str) -> None:
        """Forget a page; the last one starts the grace."""
        if browser not in self._by_browser:
            return
        self._pages[browser] = max(0, self._pages.get(browser, 0) - 1)
        if self._pages[browser] == 0 and browser not in self._leaving:
            self._leaving[browser] = asyncio.create_task(self._leave(browser))

    async def _leave(self, browser: str) -> None:
        await asyncio.sleep(self.grace)
        del self._leaving[browser]
        await self.sign_out(browser)

    async def _miss(self, ticket: str) -> None:
        await asyncio.sleep(ENTERED_WITHIN)
        _, session = self._waiting.pop(ticket)
        del self._leaving[ticket]
        await session.close()

    async def close(self) -> None:
        """Sign everybody out: the panel ends."""
        for browser in list(self._by_browser):
            await self.sign_out(browser)
        for _, session in self._waiting.values():
            await session.close()

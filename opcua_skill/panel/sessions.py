"""Who is signed in at which browser. Passwords and connections live in this process's memory only."""

import asyncio
import logging
from dataclasses import dataclass, field
from pathlib import Path

from opcua_skill.panel.session import PanelSession

log = logging.getLogger(__name__)

GRACE = 600.0


@dataclass
class Sessions:
    """The panel's signed-in browsers, by the id in their signed cookie.

    A session whose last page was closed ``grace`` s ago is signed out; a reload or a short walk does not end it.
    """

    url: str
    folder: Path | None = None
    grace: float = GRACE
    _by_browser: dict[str, PanelSession] = field(default_factory=dict)
    _pages: dict[str, int] = field(default_factory=dict)
    _leaving: dict[str, "asyncio.Task[None]"] = field(default_factory=dict)

    def of(self, browser: str) -> PanelSession | None:
        """Return who is signed in at a browser, or None."""
        return self._by_browser.get(browser)

    async def sign_in(self, browser: str, user: str, password: str, language: str) -> PanelSession:
        """Sign somebody in at a browser; whoever was there before is signed out. Raises ClientError."""
        session = PanelSession(self.url, user, password, self.folder, language=language)
        await session.open()
        await self.sign_out(browser)
        self._by_browser[browser] = session
        log.info("%s signed in at the panel", user)
        return session

    async def sign_out(self, browser: str) -> None:
        """End a browser's session, if it has one."""
        if leaving := self._leaving.pop(browser, None):
            leaving.cancel()
        if session := self._by_browser.pop(browser, None):
            await session.close()
            log.info("%s signed out of the panel", session.user)

    def page_opened(self, browser: str) -> None:
        """Count a page that shows a browser's session."""
        self._pages[browser] = self._pages.get(browser, 0) + 1
        if leaving := self._leaving.pop(browser, None):
            leaving.cancel()

    def page_closed(self, browser: str) -> None:
        """Forget a page; the last one starts the grace."""
        self._pages[browser] = max(0, self._pages.get(browser, 0) - 1)
        if self._pages[browser] == 0 and browser in self._by_browser and browser not in self._leaving:
            self._leaving[browser] = asyncio.create_task(self._leave(browser))

    async def _leave(self, browser: str) -> None:
        await asyncio.sleep(self.grace)
        del self._leaving[browser]
        await self.sign_out(browser)

    async def close(self) -> None:
        """Sign everybody out: the panel ends."""
        for browser in list(self._by_browser):
            await self.sign_out(browser)

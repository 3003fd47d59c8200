"""A real server, a real panel and Debian's chromium, without any network: whatever leaves loopback fails the test."""

import asyncio
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, sync_playwright

from opcua_skill.client import Unreachable
from tests.conftest import SETTINGS, Plant

PASSWORD = "correct horse battery"
CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)
PANEL_PC = {"width": 1280, "height": 800}
TABLET = {"width": 768, "height": 1024}
TABLET_LYING = {"width": 1024, "height": 768}
FINGERS = {"has_touch": True, "is_mobile": True}
PATIENCE = 40_000
SECOND = """
[[workstations]]
name = "ws2"
driver = "kinematic"
realtime = true
arm = "xarm6"
"""
PICTURES = os.environ.get("OPCUA_SKILL_PICTURES", "")
"""Set to docs/pictures, the tests write there the pictures of the how-to page; else they are only looked at."""

Work = Callable[[], Coroutine[Any, Any, Any]]


def away_from_the_browser(work: Work, tries: int = 3) -> Any:
    """Run a client's coroutine in a thread of its own: playwright has a loop in this one.

    The client gives a connection up when the server is silent for a second, which a loaded machine is now and then.
    """
    with ThreadPoolExecutor(1) as thread:
        try:
            return thread.submit(lambda: asyncio.run(work())).result()
        except Unreachable:
            if tries == 1:
                raise
    return away_from_the_browser(work, tries - 1)


class Hand:
    """Fingers, a palm or a pen on the glass, as the operating system tells the browser of them."""

    def __init__(self, page: Page) -> None:
        self._browser = page.context.new_cdp_session(page)
        self._down: dict[int, dict[str, float]] = {}

    def put(self, x: float, y: float, finger: int = 0, *, broad: float = 10.0) -> None:
        """Put a finger down; ``broad`` is its radius in px: a palm has more than a finger."""
        self._down[finger] = {"x": x, "y": y, "id": finger, "radiusX": broad, "radiusY": broad}
        self._tell("touchStart", list(self._down.values()))

    def move(self, x: float, y: float, finger: int = 0) -> None:
        """Move a finger that is down."""
        self._down[finger] |= {"x": x, "y": y}
        self._tell("touchMove", list(self._down.values()))

    def lift(self, finger: int = 0) -> None:
        """Lift one finger; the others stay."""
        lifted = self._down.pop(finger)
        self._tell("touchEnd", [lifted] if self._down else [])

    def taken_away(self) -> None:
        """Let the operating system take the touch for itself, as it does for a gesture of its own."""
        self._down.clear()
        self._tell("touchCancel", [])

    def drag(self, points: Sequence[tuple[float, float]]) -> None:
        """Draw a line with one finger."""
        self.put(*points[0])
        for point in points[1:]:
            self.move(*point)
        self.lift()

    def pen(self, points: Sequence[tuple[float, float]], every: int = 0) -> None:
        """Draw a line with a pen; ``every`` is the pace of the hand, in ms between two points."""
        for number, (x, y) in enumerate(points):
            kind = "mousePressed" if number == 0 else "mouseMoved"
            self._tell_pen(kind, x, y, 1)
            time.sleep(every / 1000)
        self._tell_pen("mouseReleased", *points[-1], 0)

    def _tell(self, kind: str, points: list[dict[str, float]]) -> None:
        self._browser.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def _tell_pen(self, kind: str, x: float, y: float, down: int) -> None:
        told = {"type": kind, "x": x, "y": y, "button": "left", "buttons": down, "clickCount": 1, "pointerType": "pen"}
        self._browser.send("Input.dispatchMouseEvent", told)


@dataclass
class Screen:
    """One person at one browser."""

    page: Page
    base: str

    @cached_property
    def hand(self) -> Hand:
        """The hand at this screen, where it is one to touch."""
        return Hand(self.page)

    def go(self, path: str) -> "Screen":
        """Open a page of the panel and wait until it is alive."""
        self.page.goto(self.base + path)
        self.page.wait_for_selector(".stop-motion")
        return self

    def marked(self, name: str) -> Locator:
        """Return what the pages mark by a name of ours."""
        return self.page.locator(f"[data-mark='{name}']")

    def button(self, name: str) -> Locator:
        """Return a button by exactly what it says."""
        return self.page.get_by_role("button", name=name, exact=True)

    def says(self, pattern: str) -> None:
        """Wait until the page says something."""
        self.page.get_by_text(re.compile(pattern)).first.wait_for(timeout=PATIENCE)

    def chart(self) -> Locator:
        """Wait for the review chart to have drawn, and return it."""
        self.page.wait_for_selector(".chart[data-view] canvas", timeout=PATIENCE)
        return self.page.locator(".chart")

    def where(self, line: int, index: int) -> tuple[float, float]:
        """Return where on the screen a sample of a line of the review chart is; line -1 is the learned path."""
        number = self.chart().get_attribute("id")
        assert number is not None
        x, y = self.page.evaluate(f"getElement({number.removeprefix('c')}).where({line}, {index})")
        return x, y

    def on_plate(self, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return where on the screen points are; they are shares of the plate, from its lower left corner."""
        box = self.page.locator("canvas.plate").bounding_box()
        assert box is not None
        scale = box["height"] / (90.0 * 1.13)
        left, bottom = box["x"] + (box["width"] - 65.0 * scale) / 2, box["y"] + box["height"] - 0.065 * 90.0 * scale
        return [(left + 65.0 * scale * x, bottom - 90.0 * scale * y) for x, y in points]

    def draw(self, points: list[tuple[float, float]]) -> None:
        """Draw a stroke on the plate with the mouse."""
        on_screen = self.on_plate(points)
        self.page.mouse.move(*on_screen[0])
        self.page.mouse.down()
        for point in on_screen[1:]:
            self.page.mouse.move(*point, steps=3)
        self.page.mouse.up()

    def picture(self, name: str, tmp_path: Path) -> None:
        """Keep a picture of the page as it is."""
        folder = Path(PICTURES) if PICTURES else tmp_path
        folder.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=folder / f"panel-{name}.png")


@dataclass
class Screens:
    """Opens browsers for people, and watches what they ask for."""

    browser: Browser
    base: str
    known: dict[tuple[str, str], Any]
    contexts: list[BrowserContext] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def blank(self, locale: str = "en-US", viewport: Any = None, **more: Any) -> Screen:
        """Return a browser at which nobody has signed in."""
        context = self.browser.new_context(viewport=viewport or PANEL_PC, locale=locale, **more)
        context.set_default_timeout(PATIENCE)
        self.contexts.append(context)
        context.on("request", lambda request: self.asked.append(request.url))
        page = context.new_page()
        page.on("websocket", lambda socket: self.asked.append(socket.url))
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        return Screen(page, self.base)

    def sign_in(self, user: str, to: str = "/", locale: str = "en-US", **more: Any) -> Screen:
        """Return a browser at which somebody has signed in and sees a page.

        Signing in is the slow part: who has done so in an earlier test comes back with the same cookie, as long as the
        panel keeps a session at which nobody looks.
        """
        if (user, locale) in self.known:
            screen = self.blank(locale, storage_state=self.known[user, locale], **more)
            screen.page.goto(self.base + to)
            screen.page.locator(".stop-motion, .sign-in").first.wait_for()
            if urlsplit(screen.page.url).path != "/sign-in":
                return screen
        else:
            screen = self.blank(locale, **more)
            screen.page.goto(f"{self.base}/sign-in?to={quote(to, safe='/')}")
        screen.page.locator("input").nth(0).fill(user)
        screen.page.locator("input").nth(1).fill(PASSWORD)
        screen.page.locator("button").click()
        screen.page.wait_for_selector(".stop-motion")
        self.known[user, locale] = screen.page.context.storage_state()
        return screen


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Debian's chromium, for one module: playwright's loop would be in the way of tests with a loop of their own."""
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="session")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """A server whose kinematic arm takes as long as a real one; one for all these tests, its start is the slow part."""
    settings = SETTINGS.format(driver="kinematic", realtime="true") + SECOND
    made = Plant(tmp_path_factory.mktemp("plant"), settings)
    with ThreadPoolExecutor(1) as thread:  # setting up runs a loop for a moment, and playwright has one here
        thread.submit(made.set_up).result()
    try:
        made.start()
        yield made
    finally:
        made.stop()


@pytest.fixture(scope="session")
def panel(plant: Plant) -> Iterator[str]:
    """Return the address of a panel for the plant, in a process of its own."""
    port = plant.port + 1 if plant.port < 60000 else plant.port - 1
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "NICEGUI"))}
    environment["OPCUA_SKILL_CLIENT_DIR"] = str(plant.client_folder)
    log = plant.folder / "panel.log"
    command = [sys.executable, "-m", "opcua_skill.cli", "panel", "--server", plant.url, "--port", str(port)]
    with log.open("w", encoding="utf-8") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        assert line.startswith("panel on "), log.read_text(encoding="utf-8")
        yield line.removeprefix("panel on ").strip()
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()
    said = log.read_text(encoding="utf-8")
    assert "Traceback" not in said, said


@pytest.fixture(scope="session")
def known() -> dict[tuple[str, str], Any]:
    """Who has signed in already, with the cookie they were given."""
    return {}


@pytest.fixture
def screens(browser: Browser, panel: str, known: dict[tuple[str, str], Any]) -> Iterator[Screens]:
    """Return what opens browsers; afterwards nothing has left loopback, and no page had a fault."""
    made = Screens(browser, panel, known)
    yield made
    for context in made.contexts:
        context.close()
    host = panel.removeprefix("http://")
    elsewhere = [url for url in made.asked if not re.match(rf"(https?|wss?)://{re.escape(host)}/|data:|blob:", url)]
    assert not elsewhere, f"left loopback: {elsewhere}"
    assert not made.faults, made.faults

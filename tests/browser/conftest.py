"""A real server, a real panel and Debian's chromium, without any network: whatever leaves loopback fails the test."""

import asyncio
import os
import re
import subprocess
import sys
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
PATIENCE = 20_000
SECOND = """
[[workstations]]
name = "ws2"
driver = "kinematic"
realtime = true
arm = "xarm6"
"""
PICTURES = os.environ.get("OPCUA_SKILL_PICTURES", "")
"""Set to docs/pictures, the tests write there the pictures of the how-to page; else they are only looked at."""

TOUCH = """(canvas, [points, pointer, every]) => {
  const box = canvas.getBoundingClientRect(), scale = box.height / (90 * 1.13);
  const left = box.left + (box.width - 65 * scale) / 2, bottom = box.bottom - 0.065 * scale * 90;
  const tell = (name, [x, y], down) => canvas.dispatchEvent(new PointerEvent(name, {
    bubbles: true, isPrimary: true, pointerId: 7, pointerType: pointer, button: 0, buttons: down ? 1 : 0,
    clientX: left + 65 * scale * x, clientY: bottom - 90 * scale * y }));
  canvas.setPointerCapture = () => {};  // there is no such pointer: these events are made here
  tell("pointerdown", points[0], true);
  let i = 1;
  return new Promise((done) => {
    const step = () => {
      if (i === points.length) { tell("pointerup", points[i - 1], false); done(); return; }
      tell("pointermove", points[i], true);
      i += 1;
      setTimeout(step, every);
    };
    step();
  });
}"""

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


@dataclass
class Screen:
    """One person at one browser."""

    page: Page
    base: str

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

    def draw(self, points: list[tuple[float, float]]) -> None:
        """Draw a stroke on the plate; points are shares of its width and height, from the lower left corner."""
        box = self.page.locator("canvas.plate").bounding_box()
        assert box is not None
        scale = box["height"] / (90.0 * 1.13)
        left, bottom = box["x"] + (box["width"] - 65.0 * scale) / 2, box["y"] + box["height"] - 0.065 * 90.0 * scale
        on_screen = [(left + 65.0 * scale * x, bottom - 90.0 * scale * y) for x, y in points]
        self.page.mouse.move(*on_screen[0])
        self.page.mouse.down()
        for point in on_screen[1:]:
            self.page.mouse.move(*point, steps=3)
        self.page.mouse.up()

    def touch(self, points: list[tuple[float, float]], pointer: str, every: int = 4) -> None:
        """Draw a stroke with a finger or a pen, as the browser tells it: ``touch`` or ``pen``; a point ``every`` ms."""
        self.page.locator("canvas.plate").evaluate(TOUCH, [points, pointer, every])

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

        Signing in is the slow part: who has done so in an earlier test comes back with the same cookie.
        """
        if (user, locale) in self.known:
            return self.blank(locale, storage_state=self.known[user, locale], **more).go(to)
        screen = self.blank(locale, **more)
        screen.page.goto(f"{self.base}/sign-in?to={to}")
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

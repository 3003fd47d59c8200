"""How long an operator waits: for the review page of 20 × 1500 points, and from a click to what it struck on screen.

The peer of the page is an empty page of the same framework in the same browser; the peer of the click is the 150 ms
within which a tool feels direct. Both on whatever machine this runs on: ratios within a run mean something.
"""

import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from models.demonstration import Demonstration
from models.synthetic import simulated_people
from opcua_skill.client import LearningOptions
from opcua_skill.demo.plant import Plant, free_port, running_plant

CHROMIUM = "/usr/bin/chromium"
FLAGS = ("--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
POINTS = 1500
CLICKS = 20
LOADS = 3
PAINT_GOAL = 150.0
EMPTY = """
from nicegui import ui
@ui.page("/")
def empty() -> None:
    ui.label("empty").classes("ready")
ui.run(host="127.0.0.1", port={port}, show=False, reload=False, show_welcome_message=False)
"""


def people() -> list[Demonstration]:
    """Return twenty demonstrations of 1500 points each."""
    made = []
    for one in simulated_people(20, seed=1)[0]:
        times = np.linspace(one.times[0], one.times[-1], POINTS)
        columns = [np.interp(times, one.times, one.points[:, k]) for k in range(2)]
        made.append(Demonstration(one.demonstration_id, times, np.stack(columns, axis=1), np.ones(POINTS, dtype=bool)))
    return made


@contextmanager
def process(command: list[str], environment: dict[str, str]) -> Iterator[None]:
    """Run a web server while the block lasts."""
    with tempfile.TemporaryFile() as said:
        started = subprocess.Popen(command, stdout=said, stderr=said, env=os.environ | environment)
        try:
            yield
        finally:
            started.terminate()
            started.wait(20)


def load_time(page: Page, url: str, ready: str) -> float:
    """Return how many s a page takes until what it is for is there."""
    began = time.perf_counter()
    page.goto(url)
    page.wait_for_selector(ready)
    return time.perf_counter() - began


def opened(page: Page, url: str, ready: str) -> None:
    """Open a page as soon as its server answers."""
    deadline = time.monotonic() + 90.0
    while True:
        try:
            page.goto(url)
            page.wait_for_selector(ready)
            return
        except Exception:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.5)


def click_times(page: Page) -> tuple[list[float], list[float]]:
    """Return the ms from mouse-up on a sample to two frames after the cross is drawn, and after the answer is drawn."""
    chart = page.locator(".chart").get_attribute("id")
    assert chart is not None
    element = f"getElement({chart.removeprefix('c')})"
    page.evaluate(
        """() => {
            const chart = document.querySelector(".chart");
            window.painted = [];
            window.marked = [];
            chart.addEventListener("pointerup", () => { window.from = performance.now(); }, true);
            chart.addEventListener("mouseup", () => { window.from = performance.now(); }, true);
            for (const what of ["marked", "painted"])
                new MutationObserver(() => window[what].push(performance.now() - window.from))
                    .observe(chart, { attributes: true, attributeFilter: [`data-${what}`] });
        }"""
    )
    for number in range(CLICKS):
        before = page.evaluate("window.painted.length")
        place = page.evaluate(f"{element}.where({number % 20}, {20 + 12 * number})")
        page.mouse.click(*place)
        page.wait_for_function(f"window.painted.length > {before}")
        page.wait_for_timeout(150)
    return page.evaluate("window.marked")[:CLICKS], page.evaluate("window.painted")[:CLICKS]


def measured(url: str, empty_url: str, password: str) -> tuple[float, float, list[float], list[float]]:
    """Return the load times in s of the review page and the empty page, and the ms of clicks to cross and answer."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        opened(page, empty_url, ".ready")
        opened(page, f"{url}/sign-in", "button")
        page.locator("input").nth(0).fill("teacher")
        page.locator("input").nth(1).fill(password)
        page.locator("button").click()
        page.wait_for_selector(".stop-motion")
        ours, theirs = [], []
        for _ in range(LOADS):
            theirs.append(load_time(page, empty_url, ".ready"))
            ours.append(load_time(page, f"{url}/skill/bench", ".chart[data-view] canvas"))
        marked, painted = click_times(page)
        browser.close()
    return median(ours), median(theirs), marked, painted


async def learned(plant: Plant) -> None:
    """Have the skill learned that is looked at."""
    async with plant.sign_in("teacher") as client:
        options = LearningOptions(reject_outliers=False)
        await client.learn_to_the_end("bench", people(), semantic_type="Gluing", options=options)


async def all_measured() -> tuple[float, float, list[float], list[float]]:
    """Set up server, panel and empty page, and measure in a thread, where playwright may have its own loop."""
    async with running_plant("panda", realtime=True) as plant:
        await learned(plant)
        port, empty_port = free_port(), free_port()
        with tempfile.TemporaryDirectory() as folder:
            script = Path(folder) / "empty.py"
            script.write_text(EMPTY.format(port=empty_port), encoding="utf-8")
            panel = [sys.executable, "-m", "opcua_skill.cli", "panel", "--server", plant.url, "--port", str(port)]
            trusted = {"OPCUA_SKILL_CLIENT_DIR": str(plant.client_folder)}
            with process(panel, trusted), process([sys.executable, str(script)], {}), ThreadPoolExecutor(1) as thread:
                urls = f"http://127.0.0.1:{port}", f"http://127.0.0.1:{empty_port}"
                work = thread.submit(measured, *urls, plant.passwords["teacher"])
                return await asyncio.wrap_future(work)


def rows() -> Iterator[dict[str, Any]]:
    """Yield the rows of `opcua-skill bench panel`."""
    page, empty, marked, painted = asyncio.run(all_measured())
    yield {
        "name": "review page, 20 × 1500 points: load (s)",
        "ours": page,
        "peer": "an empty page of the same framework",
        "theirs": empty,
        "ratio": page / empty,
        "goal": "at most 1.5 × the empty page + 3 s",
        "holds": page <= 1.5 * empty + 3.0,
        "runs": LOADS,
    }
    said = (("cross is painted", marked), ("server's answer is painted", painted))
    for what, clicks in said:
        yield {
            "name": f"strike a sample: mouse-up until the {what}, median (ms)",
            "ours": median(clicks),
            "peer": "what feels direct",
            "theirs": PAINT_GOAL,
            "ratio": median(clicks) / PAINT_GOAL,
            "goal": "under 150 ms",
            "holds": median(clicks) < PAINT_GOAL,
            "runs": len(clicks),
        }

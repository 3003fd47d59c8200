"""Teaching without a mouse: finger and pen, files that leave something open, and a tracker seen while it records."""

import asyncio
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from models.synthetic import simulated_people
from tests.browser.conftest import FINGERS, TABLET, TABLET_LYING, Screen, Screens, away_from_the_browser
from tests.browser.test_run import stroke

pytestmark = pytest.mark.browser


def counted(screen: Screen, number: int) -> None:
    said = f"{number} demonstration" if number == 1 else f"{number} demonstrations"
    screen.page.locator("[data-mark='count']", has_text=said).wait_for()


def lengths(screen: Screen) -> list[float]:
    """Return how long the drawn strokes are as listed, mm."""
    rows = screen.page.locator(".demo").all_inner_texts()
    return [float(row.split("\n")[1].split("\xa0")[0]) for row in rows]


@pytest.mark.parametrize("viewport", [TABLET_LYING, TABLET], ids=["lying", "standing"])
def test_fingers_palm_and_pen_draw_whole_strokes_on_a_tablet(
    screens: Screens, viewport: dict[str, int], tmp_path: Path
) -> None:
    screen = screens.sign_in("teacher", "/teach", viewport=viewport, **FINGERS)
    screen.page.wait_for_selector("canvas.plate")
    screen.page.evaluate("scrollTo(0, 0)")
    hand, path = screen.hand, screen.on_plate(stroke(0.0))
    hand.drag(path)
    counted(screen, 1)

    hand.put(*path[0])
    for number, point in enumerate(path[1:], start=1):
        hand.move(*point)
        if number == 10:
            hand.put(point[0] + 90, point[1] + 60, finger=1)  # another finger joins, moves and leaves
        if number == 15:
            hand.move(point[0] + 40, point[1] + 90, finger=1)
        if number == 20:
            hand.lift(finger=1)
    hand.lift()
    counted(screen, 2)

    hand.put(path[0][0] + 80, path[0][1] + 120, finger=2, broad=60.0)  # the hand lies down before the pen
    hand.pen(path)
    hand.lift(finger=2)
    counted(screen, 3)
    whole = lengths(screen)
    assert max(whole) - min(whole) <= 2.0, whole

    hand.put(*path[0])
    hand.move(*path[5])
    hand.taken_away()
    screen.says("the stroke was interrupted: draw it again")
    counted(screen, 3)
    assert screen.page.evaluate("[scrollY, visualViewport.scale]") == [0, 1], "drawing moves the stroke, not the page"
    screen.picture("tablet-lying" if viewport is TABLET_LYING else "tablet", tmp_path)
    screen.marked("discard-all").tap()
    counted(screen, 0)
    screen.marked("bring-back").tap()
    counted(screen, 3)
    screen.marked("discard-all").tap()
    counted(screen, 0)


def nexus(folder: Path) -> Path:
    """Write a file as Vicon Nexus does, with two markers."""
    lines = [
        "Trajectories",
        "100",
        ",,Subject:tip,,,Subject:hand,,",
        "Frame,Sub Frame,X,Y,Z,X,Y,Z",
        ",,mm,mm,mm,mm,mm,mm",
    ]
    for frame in range(200):
        x, y = 10 + 0.2 * frame, 40 + 20 * math.sin(frame / 30)
        lines.append(f"{frame + 1},0,{x:.3f},{y:.3f},5.0,{x + 30:.3f},{y:.3f},90.0")
    file = folder / "two-markers.csv"
    file.write_text("\n".join(lines) + "\n\n", encoding="utf-8")
    return file


def test_a_file_that_leaves_something_open_asks_and_a_wrong_one_is_told_with_its_line(
    screens: Screens, tmp_path: Path
) -> None:
    screen = screens.sign_in("teacher", "/teach")
    screen.page.wait_for_selector("canvas.plate")
    files = screen.marked("upload").locator("input[type=file]")
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("t,x_mm,y_mm\n0,1,2\n0.1,1,two\n0.2,1,3\n", encoding="utf-8")
    files.set_input_files(wrong)
    refusal = screen.marked("upload-refusal")
    refusal.get_by_text("wrong.csv, line 3").wait_for()
    assert "/tmp" not in refusal.inner_text()
    files.set_input_files(nexus(tmp_path))
    asked = screen.marked("upload-choice")
    asked.get_by_text("two-markers.csv").wait_for()
    screen.picture("choice", tmp_path)
    screen.marked("choice").click()
    screen.page.get_by_role("option", name="tip").click()
    screen.page.locator("[data-mark='count']", has_text="1 demonstration").wait_for()
    screen.marked("flatten").click()
    screen.says("Laid into their plane; they were away from it by 0.00.mm")
    screen.marked("discard-all").click()


async def feed(plant: Any, pieces: int, pause: float = 0.0) -> None:
    """Send what a tracker would: some people, the button pressed while each shows the movement; ``pause`` in s."""
    async with plant.sign_in("teacher") as client:
        recorder = client.workstation("ws1").recorder
        recording = await recorder.start(2, "Tina", "test tracker")
        clock = 0.0
        for one in simulated_people(pieces, seed=9)[0]:
            for first in range(0, len(one.times), 200):
                part = slice(first, first + 200)
                pressed = np.ones(len(one.times[part]), dtype=bool)
                await recorder.append(recording, clock + one.times[part], one.points[part], pressed)
                await asyncio.sleep(pause)
            clock += float(one.times[-1])
            after = clock + np.array([0.1, 0.2, 0.3])
            await recorder.append(recording, after, np.repeat(one.points[-1:], 3, axis=0), [False] * 3)
            clock = float(after[-1]) + 0.1
        # the connection ends here: the recording is closed, and stays


def test_a_tracker_is_seen_while_it_records_and_a_skill_is_learned_from_it(
    plant: Any, screens: Screens, tmp_path: Path
) -> None:
    screen = screens.sign_in("teacher", "/teach")
    screen.page.wait_for_selector("canvas.plate")
    screen.marked("record-start").click()
    screen.marked("recorder-state").get_by_text("● recording").wait_for()
    screen.draw(stroke(0.0))
    screen.page.wait_for_function("parseInt(document.querySelector('canvas.plate').dataset.pressed) > 8")
    screen.marked("recorder-told").get_by_text("1 demonstration").wait_for()
    screen.marked("record-discard").click()
    screen.marked("record-discard-yes").click()
    screen.marked("recorder-state").get_by_text("○ nothing is being recorded").wait_for()

    with ThreadPoolExecutor(1) as tracker:
        fed = tracker.submit(away_from_the_browser, lambda: feed(plant, 3, pause=0.3))
        screen.marked("recorded").get_by_text("● demonstration-02").wait_for()
        button, told = screen.page.get_by_label("Discard demonstration-01").element_handle(), screen.marked("recorded")
        before = told.text_content() or ""
        expect(told).not_to_have_text(before)
        assert button is not None
        assert button.evaluate("it => it.isConnected"), "samples came: a press on its way to it would have been lost"
        fed.result()
    screen.marked("recorder-told").get_by_text("3 demonstrations").wait_for()
    screen.page.wait_for_function("parseInt(document.querySelector('canvas.plate').dataset.pressed) > 1000")
    screen.page.get_by_label("Discard demonstration-03").click()
    screen.marked("recorder-told").get_by_text("2 demonstrations").wait_for()
    screen.picture("recorder", tmp_path)
    screen.page.get_by_label("Name of the skill").fill("tracked")
    screen.marked("learn-recorded").click()
    screen.page.wait_for_url("**/skill/tracked**", timeout=60_000)
    screen.chart()
    screen.says("2 demonstrations used")

"""A skill's page in a real browser: strike, undo, leave out, learn again, judge."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from models.synthetic import simulated_people
from opcua_skill.client import LearningOptions
from tests.browser.conftest import FINGERS, PATIENCE, TABLET, TABLET_LYING, Screen, Screens, away_from_the_browser

pytestmark = pytest.mark.browser
BUMP = 0.012


def teach(
    plant: Any, name: str, user: str = "teacher", *, odd: bool = False, options: LearningOptions | None = None
) -> None:
    """Have a skill learned from six simulated people; with ``odd``, one of them leaves the line by 12 mm."""
    people = list(simulated_people(6, seed=3)[0])
    if odd:
        share = np.linspace(0.0, 1.0, len(people[2].times))
        people[2].points[:, 0] += BUMP * np.exp(-(((share - 0.35) / 0.06) ** 2))

    async def learn() -> None:
        async with plant.sign_in(user) as client:
            how = options or LearningOptions(reject_outliers=False)
            report = await client.learn_to_the_end(name, people, semantic_type="Gluing", options=how)
            assert report.state == "Completed", report.message

    away_from_the_browser(learn)


def struck(screen: Screen) -> int:
    """Return how many samples the page says are struck."""
    words = screen.marked("draft").inner_text()
    return int(words.split()[0]) if "samples struck" in words else 0


def choose_tool(screen: Screen, name: str) -> None:
    screen.button(name).click()
    screen.page.wait_for_selector(f".chart[data-tool='{name.lower()}']")


def wait_for_draft(screen: Screen, text: str) -> None:
    screen.page.locator("[data-mark='draft']", has_text=text).wait_for()


def test_striking_a_stretch_and_undoing_it(plant: Any, screens: Screens, tmp_path: Path) -> None:
    teach(plant, "strike")
    screen = screens.sign_in("teacher", "/skill/strike")
    screen.chart()
    screen.page.mouse.click(*screen.where(2, 120))
    wait_for_draft(screen, "samples struck (not learned yet)")
    screen.page.wait_for_selector(".chart[data-marked='1']")  # the cross was there before the server was asked
    one = struck(screen)
    screen.page.keyboard.down("Shift")
    screen.page.mouse.click(*screen.where(2, 150))
    screen.page.keyboard.up("Shift")
    screen.page.wait_for_function(
        f"parseInt(document.querySelector('[data-mark=draft]').textContent) > {10 * one}", timeout=20_000
    )
    screen.picture("strike", tmp_path)
    screen.page.keyboard.press("u")
    wait_for_draft(screen, f"{one} samples struck")
    screen.page.keyboard.press("u")
    wait_for_draft(screen, "Nothing is taken out (as learned)")
    screen.page.keyboard.press("Shift+U")
    wait_for_draft(screen, f"{one} samples struck")
    screen.page.reload()
    screen.chart()
    wait_for_draft(screen, f"{one} samples struck (not learned yet)")
    screen.button("Learn again").click()
    screen.says(r"strike · version 2")
    wait_for_draft(screen, f"{one} samples struck (as learned)")
    edits = screen.page.evaluate("1") and away_from_the_browser(lambda: provenance(plant, "strike"))
    assert sum(len(indices) for indices in edits["struck"].values()) == one


async def provenance(plant: Any, name: str) -> dict[str, Any]:
    async with plant.sign_in("visitor") as client:
        return dict((await client.skill(name)).document["provenance"])


def test_leaving_out_an_odd_demonstration_moves_the_path(plant: Any, screens: Screens, tmp_path: Path) -> None:
    teach(plant, "odd", odd=True)
    screen = screens.sign_in("teacher", "/skill/odd")
    screen.chart()
    worst = screen.page.locator(".demo").first
    assert "person-03" in worst.inner_text(), "the worst one stands first"
    worst.locator(".q-checkbox").click()
    wait_for_draft(screen, "1 demonstration left out (not learned yet)")
    screen.button("Learn again").click()
    screen.says(r"odd · version 2")
    screen.says(r"before \(version 1, grey dashes\): the path moved by at most [1-9]")
    screen.says(r"5 demonstrations used")
    screen.picture("before-after", tmp_path)


def test_nobody_approves_what_they_taught_and_both_browsers_see_the_approval(
    plant: Any, screens: Screens, tmp_path: Path
) -> None:
    teach(plant, "four-eyes", "engineer")
    author = screens.sign_in("engineer", "/skill/four-eyes")
    author.chart()
    author.page.get_by_label("Reason, kept in the records").fill("it is mine")
    author.marked("why-judge").get_by_text("who taught a version cannot approve it").wait_for()
    expect(author.button("Approve")).to_be_disabled()
    author.picture("refused", tmp_path)
    assert "Learned" in author.marked("state").inner_text()

    second = screens.sign_in("engineer-2", "/skill/four-eyes")
    second.chart()
    second.marked("why-judge").get_by_text("Write a reason first").wait_for()
    expect(second.button("Approve")).to_be_disabled()
    card = second.marked("card")
    card.get_by_role("img", name=re.compile("The run seen from above: Start x .* End x ")).wait_for()
    for words in ("Start", "End", "nozzle speed", "It slows down nowhere."):
        card.get_by_text(words).first.wait_for()
    card.get_by_text("valve opens").first.wait_for(state="attached")  # the title of the mark on the drawing
    second.marked("since-approved").get_by_text("No version of this skill was approved before").wait_for()
    second.picture("card", tmp_path)
    second.page.get_by_label("Reason, kept in the records").fill("path looked at, ends are right")
    second.button("Approve").click()
    second.page.locator("[data-mark='state']", has_text="Approved").wait_for()
    author.page.locator("[data-mark='state']", has_text="Approved").wait_for()
    author.says("engineer-2 – path looked at, ends are right")
    second.button("Deploy").click()
    second.page.locator("[data-mark='deployed']", has_text="Runs on: ws1").wait_for()
    author.page.locator("[data-mark='deployed']", has_text="Runs on: ws1").wait_for()
    second.picture("approved", tmp_path)


def test_what_others_do_to_another_version_takes_nothing_out_of_the_hand(plant: Any, screens: Screens) -> None:
    teach(plant, "kept")
    screen = screens.sign_in("engineer", "/skill/kept")
    screen.chart()
    screen.page.get_by_label("Reason, kept in the records").fill("half written")
    export = screen.marked("export").element_handle()
    shown = screen.page.locator("[data-mark='versions'] > *").first.element_handle()
    assert export is not None and shown is not None
    teach(plant, "kept")
    screen.says("teacher: version 2 is newer")
    assert screen.page.get_by_label("Reason, kept in the records").input_value() == "half written"
    assert export.evaluate("button => button.isConnected"), "a press on its way to the button would have been lost"
    assert not shown.evaluate("line => line.isConnected"), "the list has a new line, so it was drawn again"
    screen.button("Reject").click()
    screen.page.locator("[data-mark='state']", has_text="Rejected").wait_for()
    screen.says("Rejected: engineer – half written")


def test_the_page_says_at_once_that_edits_are_not_part_of_what_is_judged(screens: Screens, boxed: str) -> None:
    screen = screens.sign_in("teacher", f"/skill/{boxed}")
    screen.chart()
    undo_all(screen)
    assert not screen.marked("unlearned").is_visible()
    screen.page.mouse.click(*screen.where(2, 150))
    screen.marked("unlearned").wait_for()
    screen.page.keyboard.press("u")
    screen.marked("unlearned").wait_for(state="hidden")


@pytest.fixture(scope="module")
def boxed(plant: Any) -> str:
    """A skill from which nobody learns again."""
    teach(plant, "boxed")
    return "boxed"


def test_a_box_and_the_learned_path_strike_samples_of_all(screens: Screens, boxed: str) -> None:
    screen = screens.sign_in("teacher", f"/skill/{boxed}")
    screen.chart()
    choose_tool(screen, "Box")
    (left, top), (right, bottom) = screen.where(-1, 200), screen.where(-1, 240)
    margin = 12
    screen.page.mouse.move(min(left, right) - margin, min(top, bottom) - margin)
    screen.page.mouse.down()
    screen.page.mouse.move(max(left, right) + margin, max(top, bottom) + margin, steps=4)
    screen.page.mouse.up()
    wait_for_draft(screen, "samples struck (not learned yet)")
    assert struck(screen) > 100, "samples of several demonstrations lie in the box"
    screen.marked("undo").click()
    wait_for_draft(screen, "Nothing is taken out (as learned)")
    screen.marked("target").click()
    screen.page.get_by_role("option", name="of all, along the path").click()
    choose_tool(screen, "Point")
    screen.page.wait_for_selector(".chart[data-target='all']")
    screen.page.mouse.click(*screen.where(-1, 120))
    wait_for_draft(screen, "samples struck (not learned yet)")
    assert struck(screen) >= 6, "one sample or more of each of six demonstrations"


@pytest.mark.parametrize("viewport", [TABLET_LYING, TABLET], ids=["lying", "standing"])
def test_fingers_strike_scroll_and_zoom_without_taking_one_for_another(
    screens: Screens, boxed: str, viewport: dict[str, int]
) -> None:
    screen = screens.sign_in("teacher", f"/skill/{boxed}", viewport=viewport, **FINGERS)
    screen.chart().scroll_into_view_if_needed()
    undo_all(screen)
    screen.page.touchscreen.tap(*screen.where(2, 150))
    wait_for_draft(screen, "samples struck (not learned yet)")
    one, hand = struck(screen), screen.hand

    x, y = screen.where(-1, 250)
    hand.drag([(x, y - 20 * step) for step in range(12)])
    screen.page.wait_for_function("scrollY > 50")
    assert struck(screen) == one, "a finger that scrolls strikes nothing"

    choose_tool(screen, "Box")
    before, (x, y) = screen.where(-1, 100), screen.where(-1, 250)
    hand.put(x - 30, y)
    hand.put(x + 30, y, finger=1)
    for step in range(1, 8):
        hand.move(x - 30 - 6 * step, y)
        hand.move(x + 30 + 6 * step, y, finger=1)
    hand.lift(finger=1)
    hand.lift()
    screen.page.wait_for_function(
        "([id, x]) => Math.abs(getElement(id).where(-1, 100)[0] - x) > 5", arg=[chart_id(screen), before[0]]
    )
    assert struck(screen) == one, "two fingers zoom"
    assert screen.page.evaluate("visualViewport.scale") == 1, "the chart is zoomed, not the page"

    x, y = screen.where(-1, 250)
    hand.drag([(x - 40 + 8 * step, y - 40 + 8 * step) for step in range(11)])
    screen.page.wait_for_function(
        f"parseInt(document.querySelector('[data-mark=draft]').textContent) > {one}", timeout=20_000
    )
    screen.marked("undo").click()  # a tap within 0.1 s of a drag elsewhere is none to the browser
    wait_for_draft(screen, f"{one} samples struck")


def undo_all(screen: Screen) -> None:
    """Take every step back: drafts are kept for who comes again."""
    said = screen.marked("draft")
    while "Nothing is taken out" not in (before := said.inner_text()):
        screen.marked("undo").click()
        expect(said).not_to_have_text(before, timeout=PATIENCE)


def chart_id(screen: Screen) -> int:
    return int((screen.chart().get_attribute("id") or "").removeprefix("c"))


def test_versions_stand_side_by_side_and_go_out_and_come_back(plant: Any, screens: Screens, tmp_path: Path) -> None:
    teach(plant, "compared")
    teach(plant, "compared", options=LearningOptions(preset="paper"))
    screen = screens.sign_in("engineer", "/skill/compared")
    screen.chart()
    screen.page.get_by_role("button", name="Compare").click()
    table = screen.marked("comparison")
    better = table.locator("tr", has_text="path against mean of people, RMS").get_by_text("✓ better: −")
    better.wait_for()
    table.scroll_into_view_if_needed()
    screen.picture("side-by-side", tmp_path)

    screen.page.get_by_label("Reason, kept in the records").fill("as published is not good enough")
    screen.button("Reject").click()
    screen.page.locator("[data-mark='state']", has_text="Rejected").wait_for()
    with screen.page.expect_download() as download:
        screen.marked("export").click()
    assert download.value.suggested_filename == "compared-2.json"
    exported = tmp_path / "exported.json"
    download.value.save_as(exported)
    screen.marked("retire").click()
    screen.marked("retire-reason").locator("visible=true").fill("replaced")
    screen.marked("retire-now").locator("visible=true").click()
    screen.page.locator("[data-mark='state']", has_text="Retired").wait_for()

    screen.go("/")
    wrong = tmp_path / "wrong.json"
    wrong.write_text('{"name": 3}', encoding="utf-8")
    screen.marked("import").locator("input[type=file]").set_input_files(wrong)
    screen.marked("import-refusal").get_by_text("wrong.json").wait_for()
    screen.marked("import").locator("input[type=file]").set_input_files(exported)
    screen.says("Imported: compared version 3")


def test_a_wrong_password_is_said_in_a_sentence(screens: Screens, tmp_path: Path) -> None:
    screen = screens.blank()
    screen.page.goto(f"{screen.base}/skill/strike")
    screen.page.locator("input").nth(0).fill("teacher")
    screen.page.locator("input").nth(1).fill("not this one at all")
    screen.page.locator("button").click()
    screen.says("user name or the password is wrong")
    screen.picture("sign-in", tmp_path)

"""Every page on panel PC and tablet: it fits, fingers hit what they want, Stop motion is there; the audit trail."""

from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe

from tests.browser.conftest import PANEL_PC, PASSWORD, TABLET, Screen, Screens
from tests.browser.test_review import teach

pytestmark = pytest.mark.browser
FINGER = 44
WCAG = {"resultTypes": ["violations"], "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}
PRESSED = "a, button, input:not([type=file]), [role=button], [role=checkbox], .q-field__control, [role=combobox]"
TOO_SMALL = """(pressed) => {
  const inside = (one) => one.closest('.q-field__control') || one.closest('.q-uploader');
  const seen = (one) => one.offsetParent && getComputedStyle(one).visibility !== 'hidden';
  const size = (one) => (one.closest('.q-checkbox') || one.closest('.q-slider') || one).getBoundingClientRect();
  return [...document.querySelectorAll(pressed)].filter((one) => seen(one) && !inside(one))
    .map((one) => [one, size(one)]).filter(([, box]) => box.width > 0 && Math.min(box.width, box.height) < 43.5)
    .map(([one, box]) => `${one.className} ${one.textContent.slice(0, 20)} ${box.width} x ${box.height}`);
}"""


def barriers(screen: Screen) -> list[str]:
    """Return what axe-core finds against WCAG 2.1 A and AA, a line an element.

    The head of the file chooser is Quasar's own, a link with a button's role around an input: only Quasar can mend it.
    """
    context = {"exclude": [[".q-uploader__header"]]}
    found = Axe().run(screen.page, context=context, options=WCAG).response["violations"]
    return [f"{one['id']}: {node['html'][:110]} {node['target']}" for one in found for node in one["nodes"]]


def narrow(screen: Screen, path: str, viewport: dict[str, int]) -> list[str]:
    """Return whether Stop motion leaves the screen, or the page grows wider than it, down to 360 px."""
    found = []
    for width in (390, 360):
        screen.page.set_viewport_size({"width": width, "height": 700})
        stop = screen.page.locator(".stop-motion").bounding_box()
        wide = screen.page.evaluate("document.documentElement.scrollWidth")
        if stop is None or stop["x"] < 0 or stop["x"] + stop["width"] > width or stop["y"] > 60 or wide > width:
            found.append(f"{path} at {width} px: {wide} px wide, Stop motion at {stop}")
    screen.page.set_viewport_size(viewport)  # type: ignore[arg-type]
    return found


@pytest.fixture(scope="module")
def skill(plant: Any) -> str:
    teach(plant, "every-page")
    return "every-page"


@pytest.mark.parametrize(
    ("viewport", "locale", "connected"),
    [(PANEL_PC, "en-US", "connected"), (TABLET, "de-DE", "verbunden")],
    ids=["panel-pc", "german-tablet"],
)
def test_every_page_fits_and_a_finger_hits_what_it_wants(
    screens: Screens, skill: str, viewport: dict[str, int], locale: str, connected: str, tmp_path: Path
) -> None:
    screen = screens.sign_in("engineer", "/", locale, viewport=viewport, has_touch=True)
    found: list[str] = []
    for path in (
        "/",
        f"/skill/{skill}",
        "/teach",
        f"/run?skill={skill}",
        f"/recipes?skill={skill}",
        "/records",
        "/audit",
    ):
        screen.go(path)
        screen.page.locator("[data-mark='connection']", has_text=connected).wait_for()
        if path.startswith("/skill"):
            screen.chart()
            screen.picture(f"skill-{viewport['width']}", tmp_path)
        if path.startswith(("/run", "/recipes")) and viewport is TABLET:
            screen.page.wait_for_timeout(500)
            screen.picture(f"{'recipe' if 'recipes' in path else 'run'}-tablet", tmp_path)
        wide = screen.page.evaluate("document.documentElement.scrollWidth")
        if wide > viewport["width"]:
            found.append(f"{path} is {wide} px wide")
        stop = screen.page.locator(".stop-motion").bounding_box()
        assert stop is not None
        if stop["x"] < 0 or stop["x"] + stop["width"] > viewport["width"] or stop["y"] > 100:
            found.append(f"Stop motion is out of sight on {path}")
        screen.page.mouse.wheel(0, 2000)
        assert screen.page.locator(".stop-motion").bounding_box() == stop, "Stop motion stays where it is"
        found += [f"{path}: {one}" for one in screen.page.evaluate(TOO_SMALL, PRESSED)]
        found += [f"{path}: {one}" for one in barriers(screen)]
        heads = screen.page.get_by_role("heading", level=1).count(), screen.page.get_by_role("heading", level=2).count()
        if heads[0] != 1 or not heads[1]:
            found.append(f"{path} has {heads} headings of the first and second level")
        found += narrow(screen, path, viewport)
        pressed = screen.page.locator(PRESSED).count()
        assert pressed > 6, f"only {pressed} things to press on {path}?"
    assert not found, "\n".join(found)


def test_who_did_what_is_read_by_engineers_and_refused_to_others_in_words(
    screens: Screens, skill: str, tmp_path: Path
) -> None:
    screen = screens.sign_in("engineer", "/audit")
    line = screen.marked("audit").locator("tr", has_text="LearnFromDemonstration").first
    line.get_by_text("teacher").first.wait_for()
    line.get_by_text("✓ done").wait_for()
    screen.picture("audit", tmp_path)
    other = screens.sign_in("mes", "/audit")
    other.marked("audit-refusal").get_by_text("The audit trail is for engineers and administrators").wait_for()
    assert other.marked("audit").locator("td").count() == 0


def test_each_workstation_is_chosen_and_stopped_by_itself(screens: Screens, tmp_path: Path) -> None:
    screen = screens.sign_in("engineer", "/run")
    arm = screen.marked("arm-state")

    def choose(station: str) -> None:
        screen.page.locator(".station-choice").click()
        screen.page.get_by_role("option", name=station).click()
        arm.get_by_text(f"{station}:").wait_for()

    choose("ws2")
    screen.button("Stop motion ws2").click()
    arm.get_by_text("ws2: protective stop").wait_for()
    choose("ws1")
    arm.get_by_text("ws1: at rest").wait_for()
    choose("ws2")
    screen.marked("held").get_by_text("QUEUE HELD: protective stop, by engineer").wait_for()
    screen.marked("reset-arm").click()
    arm.get_by_text("ws2: at rest").wait_for()
    screen.page.locator("[data-mark='release-queue']:not([disabled])").click()
    screen.marked("held").wait_for(state="hidden")
    choose("ws1")


SLOW_TO_CONNECT = """Object.defineProperty(window, 'did_handshake', {
  get() { return this.shaken && performance.now() > 2500; }, set(done) { this.shaken = done; },
})"""


def test_what_is_typed_before_the_page_is_connected_signs_in(screens: Screens) -> None:
    screen = screens.blank()
    screen.page.add_init_script(SLOW_TO_CONNECT)
    screen.page.goto(f"{screens.base}/sign-in?to=/")
    screen.page.locator("input").nth(0).fill("mes")
    screen.page.locator("input").nth(1).fill(PASSWORD)
    screen.page.locator("button").click()
    screen.page.wait_for_selector(".stop-motion")

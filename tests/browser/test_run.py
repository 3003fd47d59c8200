"""The story in a real browser: three strokes become a skill that moves an arm; and Stop motion in every state."""

import contextlib
import itertools
import math
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import TimeoutError as PlaywrightTimeout
from playwright.sync_api import expect

from tests.browser.conftest import FINGERS, PATIENCE, TABLET, TABLET_LYING, Screen, Screens, away_from_the_browser

pytestmark = pytest.mark.browser
CORNERS = ((0.15, 0.75), (0.35, 0.25), (0.5, 0.7), (0.65, 0.25), (0.85, 0.75))


def stroke(shake: float) -> list[tuple[float, float]]:
    """Return a drawn W, each time a little different."""
    points = []
    for (x, y), (u, v) in itertools.pairwise(CORNERS):
        for k in range(12):
            share = k / 12
            wobble = shake * math.sin(9.0 * (x + share) + 40.0 * shake)
            points.append((x + share * (u - x) + wobble, y + share * (v - y) + shake))
    return [*points, (CORNERS[-1][0], CORNERS[-1][1] + shake)]


async def approve_and_deploy(plant: Any, name: str) -> None:
    """Do what an engineer does."""
    async with plant.sign_in("engineer") as client:
        skill = await client.skill(name)
        await client.approve(name, skill.version, skill.model_digest, "as drawn")
        await client.deploy(name, skill.version, "ws1")


def chosen(name: str) -> str:
    """Return the run page with a skill and its own recipe chosen."""
    return f"/run?skill={name}&recipe={name}-default"


def run(screen: Screen) -> None:
    """Press Run as soon as it can be had: one press, one run."""
    screen.page.locator("[data-mark='run-production']:not([disabled])").click(timeout=60_000)


def slow_down(plant: Any, fraction: float) -> None:
    """Let the arm take its time: on a busy machine nobody sees a run of six seconds begin, let alone pauses it."""

    async def ask() -> None:
        async with plant.sign_in("mes") as client:
            await client.workstation("ws1").set_speed_override(fraction)

    away_from_the_browser(ask)


async def jobs_of(plant: Any) -> list[Any]:
    async with plant.sign_in("visitor") as client:
        return await client.workstation("ws1").jobs()


async def newest_job(plant: Any) -> Any:
    async with plant.sign_in("visitor") as client:
        return (await client.workstation("ws1").jobs(limit=1))[0]


def arm_says(screen: Screen, words: str) -> None:
    screen.page.locator("[data-mark='arm-state']", has_text=words).wait_for(timeout=60_000)


@pytest.fixture(scope="module")
def drawn(plant: Any) -> str:
    """The name of a skill that is deployed on ws1 once the first test has drawn it."""
    return "drawn"


def test_three_strokes_are_learned_approved_by_another_and_run(
    plant: Any, screens: Screens, drawn: str, tmp_path: Path
) -> None:
    teacher = screens.sign_in("teacher", "/teach")
    teacher.page.wait_for_selector("canvas.plate")
    for number, shake in enumerate((0.0, 0.012, -0.01), start=1):
        if number == 1:
            teacher.draw(stroke(shake))
        else:
            teacher.hand.pen(teacher.on_plate(stroke(shake)), every=40)
        said = f"{number} demonstration" if number == 1 else f"{number} demonstrations"
        teacher.page.locator("[data-mark='count']", has_text=said).wait_for()
    teacher.page.get_by_label("Name of the skill").fill(drawn)
    teacher.says("Ready to learn")
    teacher.picture("teach", tmp_path)
    teacher.button("Learn").click()
    teacher.page.wait_for_url(f"**/skill/{drawn}**", timeout=60_000)
    teacher.chart()
    teacher.says("3 demonstrations used")
    teacher.button("Try it in simulation").click()
    teacher.page.wait_for_url("**/run**")
    teacher.says(r"Version 1 \(newest\)")
    teacher.marked("why-production").get_by_text("not deployed").wait_for(timeout=60_000)
    expect(teacher.button("Run")).to_be_disabled()
    teacher.page.locator("[data-mark='run-simulation']:not([disabled])").click(timeout=60_000)
    teacher.page.wait_for_selector("[data-mark='player'][data-loaded^='run-']", timeout=60_000)
    replay = teacher.marked("replay")
    replay.get_by_text("simulated, nothing moved").wait_for()
    expect(teacher.marked("play")).to_have_text("▶ Play the replay")  # it waits until somebody plays it
    teacher.picture("simulated", tmp_path)
    teacher.marked("end-replay").click()
    replay.wait_for(state="detached")

    away_from_the_browser(lambda: approve_and_deploy(plant, drawn))
    operator = screens.sign_in("mes", chosen(drawn))
    operator.says(r"Version 1 \(deployed\)")
    slow_down(plant, 0.1)
    operator.page.locator("[data-mark='override-told']", has_text="10").wait_for()
    expect(operator.page.get_by_role("slider", name="Speed override")).to_have_attribute(
        "aria-valuenow", "10", timeout=PATIENCE
    )
    expect(operator.marked("run-simulation")).to_be_enabled(timeout=60_000)
    operator.marked("why-test").get_by_text("needs the role engineer").wait_for(timeout=60_000)
    operator.marked("run-production").dblclick()
    arm_says(operator, "moving")
    assert len(away_from_the_browser(lambda: jobs_of(plant))) == 2, "one simulation and one run: two presses are one"
    operator.marked("job-mode").get_by_text("PRODUCTION (AUTO)").wait_for()
    operator.button("Pause").click()
    arm_says(operator, "paused")
    operator.picture("paused", tmp_path)
    operator.button("Go on").click()
    arm_says(operator, "moving")
    operator.picture("run", tmp_path)
    slow_down(plant, 1.0)
    arm_says(operator, "at rest")
    operator.marked("jobs").get_by_text("Completed").nth(1).wait_for()
    job = away_from_the_browser(lambda: newest_job(plant))
    assert (job.mode, job.state) == ("production", "Completed")
    operator.go("/records").says("ExecuteSkill by mes: done")
    operator.picture("records", tmp_path)


def go_to_the_start(screen: Screen) -> None:
    """Bring the arm back to where every run starts, and let the next job begin."""
    screen.page.locator("[data-mark='home']:not([disabled])").click()
    with contextlib.suppress(PlaywrightTimeout):  # the way there may be over before a busy page shows it
        screen.page.locator("[data-mark='arm-state']", has_text="moving").wait_for(timeout=15_000)
    arm_says(screen, "at rest")
    screen.page.locator("[data-mark='release-queue']:not([disabled])").click(timeout=60_000)
    screen.marked("held").wait_for(state="hidden")


def stop_and_reset(screen: Screen, *, by_key: bool = False) -> None:
    """Press Stop motion as a person does (nothing may lie over it), see the arm halted, and reset it."""
    if by_key:
        screen.page.keyboard.press("Escape")
    else:
        screen.page.locator(".stop-motion").click()
    arm_says(screen, "protective stop")
    screen.page.locator("[data-mark='protective-stop']").wait_for()
    screen.button("Reset: the arm may move again").click()
    with contextlib.suppress(PlaywrightTimeout):
        screen.page.locator("[data-mark='arm-state']", has_text="at rest").wait_for(timeout=15_000)
        return
    # A Stop has a way of its own: pressed on a stopped arm it may arrive after the reset that was pressed next.
    screen.button("Reset: the arm may move again").click()
    arm_says(screen, "at rest")


def test_stop_motion_is_in_reach_in_every_state(plant: Any, screens: Screens, drawn: str, tmp_path: Path) -> None:
    screen = screens.sign_in("engineer", chosen(drawn))
    screen.says(r"Version 1 \(deployed\)")
    slow_down(plant, 0.25)
    stop_and_reset(screen)
    screen.marked("release-queue").click()

    run(screen)
    arm_says(screen, "moving")
    screen.page.locator(".stop-motion").click()
    arm_says(screen, "protective stop")
    screen.marked("held").get_by_text("QUEUE HELD: protective stop, by engineer").wait_for()
    screen.marked("why-production").get_by_text("the arm waits for a reset").wait_for()
    expect(screen.marked("release-queue")).to_be_disabled()
    screen.picture("stopped", tmp_path)
    stop_and_reset(screen)
    screen.marked("release-queue").click()  # the arm is not where runs begin: the server says so
    screen.says("Release the queue: .*BadInvalidState")
    go_to_the_start(screen)
    aborted = screen.marked("jobs").locator("tr", has_text="Aborted").first
    aborted.get_by_text("Replay").click()
    screen.marked("replay").get_by_text("measured on the arm").wait_for()

    run(screen)
    arm_says(screen, "moving")
    screen.marked("replay").wait_for(state="detached")  # what is live goes before what was
    stop_and_reset(screen, by_key=True)
    go_to_the_start(screen)

    run(screen)
    arm_says(screen, "moving")
    screen.button("Pause").click()
    arm_says(screen, "paused")
    screen.page.locator("[data-mark='recipe']").click()
    screen.page.locator(".q-menu").wait_for()
    stop_and_reset(screen)

    for path in (f"/skill/{drawn}", "/teach", "/records", f"/recipes?skill={drawn}", "/"):
        screen.go(path)
        stop_and_reset(screen)
    screen.go("/").page.keyboard.press("Escape")
    screen.page.wait_for_timeout(600)
    arm_says(screen, "at rest")
    slow_down(plant, 1.0)
    go_to_the_start(screen.go(chosen(drawn)))


def test_a_finger_stops_the_arm_as_soon_as_it_presses(plant: Any, screens: Screens, drawn: str) -> None:
    for viewport in (TABLET_LYING, TABLET):
        screen = screens.sign_in("mes", chosen(drawn), viewport=viewport, **FINGERS)
        screen.says(r"Version 1 \(deployed\)")
        if viewport is TABLET_LYING:
            screen.page.locator("[data-mark='run-production']:not([disabled])").tap(timeout=60_000)
            arm_says(screen, "moving")
        box = screen.page.locator(".stop-motion").bounding_box()
        assert box is not None
        screen.hand.put(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        arm_says(screen, "protective stop")
        screen.hand.move(box["x"] - 200, box["y"] + 300)  # it slides off
        screen.hand.lift()
        screen.button("Reset: the arm may move again").tap()
        arm_says(screen, "at rest")
    go_to_the_start(screen)


def test_who_has_the_arm_is_told_to_everybody_and_keeps_others_from_moving_it(
    plant: Any, screens: Screens, drawn: str, tmp_path: Path
) -> None:
    mine = screens.sign_in("engineer", chosen(drawn))
    other = screens.sign_in("mes", chosen(drawn))
    mine.says(r"Version 1 \(deployed\)")
    mine.marked("take-lock").click()
    mine.marked("lock").get_by_text("You have this arm for yourself").wait_for()
    other.marked("lock").get_by_text("This arm is kept by engineer (panel of engineer)").wait_for()
    other.says(r"Version 1 \(deployed\)")
    other.marked("why-production").get_by_text("This arm is kept by engineer").wait_for(timeout=60_000)
    expect(other.marked("run-production")).to_be_disabled()
    other.picture("locked", tmp_path)
    mine.marked("give-lock").click()
    other.marked("lock").get_by_text("Nobody has this arm for themselves").wait_for()


def test_jobs_queue_and_a_run_is_seen_in_space_over_time_and_as_csv(
    plant: Any, screens: Screens, drawn: str, tmp_path: Path
) -> None:
    screen = screens.sign_in("engineer", chosen(drawn))
    screen.says(r"Version 1 \(deployed\)")
    slow_down(plant, 0.1)
    run(screen)
    arm_says(screen, "moving")
    expect(screen.marked("run-production")).to_be_disabled()
    for number in (1, 2):
        screen.page.locator("[data-mark='queue-another']:not([disabled])").click()
        screen.marked("asked-another").get_by_text("It begins by itself when its turn comes").wait_for()
        screen.marked("queue-production").click()
        screen.marked("queue").get_by_text(f"{number}. {drawn} 1 · production").wait_for()
    queue = screen.marked("queue")
    queue.get_by_role("button").last.click()
    queue.get_by_text(f"2. {drawn} 1 · production").wait_for(state="detached")
    screen.button("Abort").click()
    held = screen.marked("held")
    held.get_by_text("QUEUE HELD: a job was aborted, by engineer").wait_for()
    arm_says(screen, "at rest")
    slow_down(plant, 1.0)
    screen.picture("held", tmp_path)
    queue.get_by_role("button").click()
    queue.get_by_text(f"1. {drawn} 1 · production").wait_for(state="detached")
    go_to_the_start(screen)
    slow_down(plant, 1.0)
    run(screen)
    arm_says(screen, "moving")
    arm_says(screen, "at rest")
    screen.marked("jobs").get_by_text("Completed").first.wait_for()
    screen.marked("play-run").first.click()
    screen.page.wait_for_selector("[data-mark='player'][data-loaded^='run-']", timeout=60_000)
    play = screen.marked("play")
    screen.page.get_by_label("speed of the animation").select_option("0.25")
    expect(play).to_have_text("▶ Play the replay")
    play.click()
    screen.page.locator("body").click(position={"x": 5, "y": 300})
    screen.page.keyboard.press("Space")
    play.get_by_text("▶ Play the replay").wait_for()
    screen.page.keyboard.press("Space")
    play.get_by_text("Hold the replay").wait_for()
    screen.button("In space").click()
    space = screen.marked("space")
    space.wait_for()
    box = space.bounding_box()
    assert box is not None
    screen.page.mouse.move(box["x"] + 100, box["y"] + 100)
    screen.page.mouse.down()
    screen.page.mouse.move(box["x"] + 160, box["y"] + 110, steps=3)
    screen.page.mouse.up()
    player = screen.page.locator("[data-mark='player'][data-turned]")
    expect(player).to_have_attribute("data-links", re.compile("^[1-9]"), timeout=PATIENCE)
    number = (player.get_attribute("id") or "").removeprefix("c")
    by_links, recorded = screen.page.evaluate(f"getElement({number}).tips()")
    assert by_links == pytest.approx(recorded, abs=0.01), "the links hold the nozzle where the record has it"
    screen.picture("space", tmp_path)
    screen.page.mouse.wheel(0, -200)
    screen.page.wait_for_selector("[data-mark='player'][data-zoomed]")
    screen.marked("whole").click()
    screen.marked("whole").get_by_text("Whole arm").wait_for()
    screen.button("Over time").click()
    screen.page.wait_for_selector("[data-mark='player'][data-view='time']")
    screen.picture("over-time", tmp_path)
    with screen.page.expect_download() as download:
        screen.marked("csv").first.click()
    saved = tmp_path / "trace.csv"
    download.value.save_as(saved)
    lines = saved.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("time_s,commanded_x_m,commanded_y_m,commanded_z_m,measured_x_m")
    assert len(lines) > 100 and len(lines[1].split(",")) == 8


def test_german_and_an_observer_who_may_only_look(plant: Any, screens: Screens, drawn: str, tmp_path: Path) -> None:
    screen = screens.sign_in("visitor", f"/skill/{drawn}", locale="de-DE")
    screen.chart()
    screen.says("Vorführungen")
    screen.page.locator("[data-mark='deployed']", has_text="Läuft auf: ws1").wait_for()
    assert screen.button("Bereitstellen").count() == 0
    assert not screen.button("Neu lernen").is_visible()
    assert screen.page.locator("html").get_attribute("lang") == "de"
    screen.picture("german", tmp_path)
    screen.page.locator(".stop-motion").click()
    screen.says("STOPP HAT NICHT ERREICHT.*die Rolle observer darf ProtectiveStop nicht aufrufen.*BadUserAccessDenied")


def test_a_recipe_is_checked_in_the_form_and_by_the_server(
    plant: Any, screens: Screens, drawn: str, tmp_path: Path
) -> None:
    screen = screens.sign_in("engineer", f"/recipes?skill={drawn}")
    name = screen.page.get_by_label("Name of the recipe")
    name.wait_for()
    name.fill("slow")
    step = screen.page.get_by_label("Time step (ms)")
    step.fill("0.1")
    screen.says(r"allowed: 1 … 20.ms")
    screen.picture("recipe", tmp_path)
    step.fill("4")
    screen.page.get_by_label("Turned about z (°)").fill("90")
    screen.page.get_by_label("Rounding of corners (mm)").fill("0.5")
    name.fill("slow/er")
    screen.marked("save-recipe").click()
    screen.marked("recipe-refusal").get_by_text("✕").wait_for()
    name.fill("slow")
    screen.marked("save-recipe").click()
    screen.button("▸ slow").wait_for()
    saved = away_from_the_browser(lambda: recipe_of(plant, "slow"))
    assert saved.time_step == pytest.approx(0.004)
    assert saved.frame[3:] == pytest.approx((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
    assert dict(saved.parameters) == {"BlendRadius": pytest.approx(0.0005)}
    screen.marked("defaults").click()
    expect(screen.page.get_by_label("Time step (ms)")).to_have_value("8", timeout=PATIENCE)


async def recipe_of(plant: Any, recipe_id: str) -> Any:
    async with plant.sign_in("engineer") as client:
        return await client.recipe(recipe_id)

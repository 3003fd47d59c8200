"""The server dies and comes back: the panel says so, says that nothing is true meanwhile, and goes on by itself."""

import contextlib
import os
import re
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import TimeoutError as PlaywrightTimeout
from playwright.sync_api import expect

from tests.browser.conftest import Screen, Screens
from tests.browser.test_review import teach, wait_for_draft

pytestmark = pytest.mark.browser
LOADED = 3.0
"""What a loaded machine may take on top, in s, to draw what the panel knows."""


def close_where_it_may_be_drawn_anew(screen: Screen) -> None:
    """Close the banner about a stop as a person does: press again where the page was drawn anew under the finger."""
    told = screen.marked("stop-told")
    for _ in range(4):
        told.get_by_role("button").click()
        with contextlib.suppress(PlaywrightTimeout):
            return told.wait_for(state="hidden", timeout=10_000)
    return told.wait_for(state="hidden")


def test_a_killed_server_is_told_and_the_panel_recovers(plant: Any, screens: Screens, tmp_path: Path) -> None:
    teach(plant, "recovers")
    screen = screens.sign_in("teacher", "/skill/recovers")
    screen.chart()
    screen.page.mouse.click(*screen.where(1, 100))
    wait_for_draft(screen, "samples struck (not learned yet)")
    screen.marked("reason").fill("the bow is as drawn")
    leaver, asked_to_leave = screens.sign_in("visitor", "/records"), []
    leaver.page.route(re.compile("/sign-out"), lambda route: asked_to_leave.append(route))
    plant.kill()
    leaver.marked("lost").get_by_text("No connection to the server").wait_for()
    leaver.marked("next-person").dispatch_event("click")
    screen.marked("lost").get_by_text("No connection to the server").wait_for()
    screen.page.locator("[data-mark='arm-state']", has_text="state unknown").wait_for()
    screen.page.locator(".stop-motion").click()
    screen.says("STOP MOTION DID NOT REACH ws1! Use the emergency stop")
    screen.picture("lost", tmp_path)
    plant.start()
    screen.marked("recovered").get_by_text("All of this page was read anew").wait_for(timeout=60_000)
    screen.page.locator("[data-mark='arm-state']", has_text="at rest").wait_for()
    wait_for_draft(screen, "samples struck (not learned yet)")
    expect(screen.marked("reason")).to_have_value("the bow is as drawn")
    asked_to_leave[0].continue_()  # while it waited all pages were drawn anew, but one that is being left
    leaver.page.wait_for_selector(".sign-in")
    told = screen.marked("stop-told")
    told.get_by_text("STOP MOTION DID NOT REACH").wait_for()  # it stays until somebody says that it was read
    close_where_it_may_be_drawn_anew(screen)
    screen.button("Learn again").click()
    screen.says(r"recovers · version 2")


def test_a_server_that_does_not_answer_is_told_within_two_seconds(plant: Any, screens: Screens, tmp_path: Path) -> None:
    screen = screens.sign_in("engineer", "/run")
    screen.page.locator("[data-mark='connection']", has_text="connected").wait_for()
    assert plant.process is not None
    group = os.getpgid(plant.process.pid)
    os.killpg(group, signal.SIGSTOP)
    stopped = time.monotonic()
    try:
        screen.page.locator("[data-mark='connection']", has_text="NOT ANSWERING").wait_for()
        assert time.monotonic() - stopped < 2.0 + LOADED
        screen.page.locator("[data-mark='arm-state']", has_text="state unknown").wait_for()
        screen.marked("lost").get_by_text("The server does not answer").wait_for()
        for name in ("Pause", "Abort", "Go to the start", "Run"):
            expect(screen.button(name)).to_be_disabled()
        assert screen.marked("lost").get_attribute("role") == "alert"
        expect(screen.page.locator(".stop-motion")).to_be_enabled()
        screen.page.locator(".stop-motion").click()
        screen.marked("stop-told").get_by_text("Stop motion is sent, no answer yet").wait_for()
        screen.picture("silent", tmp_path)
        screen.marked("stop-told").get_by_text("STOP MOTION DID NOT REACH ws1").wait_for()
    finally:
        os.killpg(group, signal.SIGCONT)
    screen.page.locator("[data-mark='connection']", has_text="connected").wait_for(timeout=60_000)
    screen.marked("protective-stop").wait_for()  # it arrived after all, late
    screen.marked("reset-arm").click()
    screen.page.locator("[data-mark='release-queue']:not([disabled])").click()
    screen.marked("held").wait_for(state="hidden")


def test_a_server_that_protects_less_than_it_should_is_seen_to(plant: Any, screens: Screens, tmp_path: Path) -> None:
    screen = screens.sign_in("engineer", "/run")
    banner = screen.marked("insecure")
    assert not banner.is_visible()
    configuration, patience = plant.folder / "plant.toml", 60_000
    as_it_was = configuration.read_text(encoding="utf-8")
    try:
        plant.stop()
        configuration.write_text(f"{as_it_was}\n[security]\nallow_anonymous = true\n", encoding="utf-8")
        plant.start()
        banner.get_by_text("anonymous sessions are accepted, as observers").wait_for(timeout=patience)
        screen.picture("insecure", tmp_path)
    finally:
        plant.stop()
        configuration.write_text(as_it_was, encoding="utf-8")
        plant.start()
    banner.wait_for(state="hidden", timeout=patience)

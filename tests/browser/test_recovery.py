"""The server dies and comes back: the panel says so, says that nothing is true meanwhile, and goes on by itself."""

from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import Screens
from tests.browser.test_review import teach, wait_for_draft

pytestmark = pytest.mark.browser


def test_a_killed_server_is_told_and_the_panel_recovers(plant: Any, screens: Screens, tmp_path: Path) -> None:
    teach(plant, "recovers")
    screen = screens.sign_in("teacher", "/skill/recovers")
    screen.chart()
    screen.page.mouse.click(*screen.where(1, 100))
    wait_for_draft(screen, "samples struck (not learned yet)")
    plant.kill()
    screen.marked("lost").get_by_text("No connection to the server").wait_for()
    screen.page.locator("[data-mark='arm-state']", has_text="state unknown").wait_for()
    screen.page.locator(".stop-motion").click()
    screen.says("STOP MOTION DID NOT REACH ws1! Use the emergency stop")
    screen.picture("lost", tmp_path)
    plant.start()
    screen.marked("recovered").get_by_text("The connection is back since").wait_for(timeout=60_000)
    screen.page.locator("[data-mark='arm-state']", has_text="at rest").wait_for()
    wait_for_draft(screen, "samples struck (not learned yet)")
    told = screen.marked("stop-told")
    told.get_by_text("STOP MOTION DID NOT REACH").wait_for()  # it stays until somebody says that it was read
    told.get_by_role("button").click()
    told.wait_for(state="hidden")
    screen.button("Learn again").click()
    screen.says(r"recovers · version 2")


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

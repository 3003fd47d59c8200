"""A stranger's arm, and a cell that is not ours, by configuration alone: run through the server like any other."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from random_orders import ROBOTS
from small_corner import small_corner

from opcua_skill.commands.arms import Arms
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.configuration.settings import Settings, ToolTip, Workstation
from opcua_skill.jobs.station import model_of
from sim.robots import load

if TYPE_CHECKING:
    from tests.conftest import Plant

SETTINGS = f"""
[[workstations]]
name = "bench"
arm = "{ROBOTS / "scara"}"
driver = "kinematic"
realtime = false

[[workstations]]
name = "beside"
driver = "kinematic"
realtime = false
workspace_low = [-0.4, -0.7, 0.005]
workspace_high = [0.7, 0.7, 0.8]
"""
LIMIT = 120.0


@pytest.mark.slow
async def test_the_same_skill_runs_on_an_arm_from_a_folder_and_beside_a_shipped_one(
    make_plant: Callable[..., "Plant"],
) -> None:
    plant = await asyncio.to_thread(make_plant, SETTINGS)
    async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as engineer:
        await teacher.learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
        [recipe] = await engineer.recipes("corner")
        elsewhere = replace(recipe, recipe_id="beside", frame=(0.0, 0.45, 0.1, 0.0, 0.0, 0.0, 1.0))
        await engineer.put_recipe(elsewhere)
        for station, recipe_id in (("bench", recipe.recipe_id), ("beside", "beside")):
            started = await teacher.workstation(station).execute("corner", recipe_id=recipe_id, mode="simulation")
            report = await teacher.follow(started.job_id, on=station, limit=LIMIT)
            assert (report.state, report.failure) == ("Completed", "None"), report
        assert len((await teacher.workstation("bench").arm()).position) == 4


def station(**changes: object) -> Workstation:
    return Workstation.model_validate({"name": "ws1", "driver": "kinematic"} | changes)


def test_a_workstation_whose_arm_cannot_be_used_is_refused_when_the_server_starts(tmp_path) -> None:
    for kind in ("urdf", "toml"):
        text = (ROBOTS / f"gantry.{kind}").read_text("utf-8")
        (tmp_path / f"bare.{kind}").write_text(text.split("[hull]")[0], "utf-8")
    for changes, words in (
        ({"arm": "robot9"}, "there is no arm 'robot9': known are panda, xarm6, iiwa14"),
        ({"arm": str(tmp_path)}, "bare has no hull"),
        ({"home": (0.0, 0.0)}, "7 moving joints and 2 at its configured home"),
        ({"workspace_low": (0.9, 0.0, 0.0)}, "every upper number has to be more than the lower one"),
    ):
        with pytest.raises(Fault) as caught:
            Arms(Settings(workstations=(station(**changes),)))
        assert "workstation ws1" in str(caught.value)
        assert words in str(caught.value)
    Arms(Settings(workstations=(station(arm=str(tmp_path), collisions="not checked"),)))
    with pytest.raises(Fault, match="panda has no tool 'needle': its limits file names none"):
        Arms(Settings(workstations=(station(tool={"name": "needle"}),)))


def test_what_a_workstation_changes_is_in_its_arms_digest() -> None:
    plain = load("panda")
    home = (0.1, *plain.home[1:])
    changed = [
        model_of(station(**change))
        for change in (
            {"home": home},
            {"workspace_high": (0.7, 0.7, 0.9)},
            {"tool": ToolTip(offset=(0.0, 0.0, 0.02)).model_dump()},
            {"collisions": "not checked"},
        )
    ]
    assert len({plain.digest, *(model.digest for model in changed)}) == 5
    assert model_of(station()) == plain
    assert np.allclose(changed[0].home, home)

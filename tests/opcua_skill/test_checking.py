"""A run is looked at before it is stored, approved or started: CheckRun plans as ExecuteSkill does, and no more."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from models.synthetic import simulated_people
from opcua_skill.client import Recipe, Refused, SkillClient
from sim.planning.clearance import part_box
from tests.conftest import Plant

PEOPLE, _ = simulated_people(6)


@pytest.fixture
async def recipe(teacher: SkillClient, engineer: SkillClient) -> Recipe:
    """A recipe of a skill that nobody has approved; learned once for all tests here."""
    found = await engineer.find_skills(name_prefix="looked-at")
    if not found:
        report = await teacher.learn_to_the_end("looked-at", PEOPLE, semantic_type="Gluing")
        assert report.state == "Completed", report
    return (await engineer.recipes("looked-at"))[0]


async def test_a_check_is_the_plan_that_runs_and_leaves_nothing(mes: SkillClient, plant: Plant, recipe: Recipe) -> None:
    workstation = mes.workstation("ws1")
    before = await asyncio.to_thread(plant.counts)
    check = await workstation.check(recipe)
    assert await asyncio.to_thread(plant.counts) == before
    assert check.can_run and check.version == 1
    path = await mes.path("looked-at", 1)
    ends = check.points[[0, -1]] - [0.0, 0.0, recipe.standoff]
    assert np.abs(ends[:, :2] - path.points[[0, -1], :2]).max() < 1e-4
    assert np.abs(ends[:, 2]).max() < 1e-4
    assert len(check.times) == len(check.speeds) == len(check.dispense) == len(check.covariances)
    assert check.facts["length"] == pytest.approx(np.linalg.norm(np.diff(path.points, axis=0), axis=1).sum(), rel=0.01)
    assert check.refused["simulation"] == ""
    assert "only an approved one runs" in check.refused["test"] and "not deployed" in check.refused["production"]
    job = await mes.follow((await workstation.execute("looked-at")).job_id, on="ws1")
    assert check.facts["planDigest"] in job.message


async def test_what_cannot_run_says_by_how_much_and_where(mes: SkillClient, recipe: Recipe) -> None:
    check = await mes.workstation("ws1").check(replace(recipe, frame=(1.2, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)))
    first = check.findings[0]
    assert not check.can_run and not len(check.points)
    assert first.code in {"WorkspaceLimit", "NoIkSolution"} and first.unit == "mm" and first.fatal
    assert first.size is not None and first.size > 10.0
    assert first.place is not None and 0.0 <= first.place <= 1.0


async def test_the_plate_is_the_recipes_own_and_kept_clear(mes: SkillClient, recipe: Recipe) -> None:
    workstation = mes.workstation("ws1")
    assert (await workstation.check(recipe)).facts["plate"] is None
    sized = replace(recipe, parameters={"PartX": -0.01, "PartY": -0.02, "PartLength": 0.2, "PartWidth": 0.15})
    assert (await workstation.check(sized)).facts["plate"] == [-0.01, -0.02, 0.2, 0.15]
    frame, path = (0.4, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0), np.array([[0.42, 0.0, 0.1], [0.45, 0.03, 0.1]])
    assert part_box(path, frame, 0.0, (-0.01, -0.02, 0.2, 0.15)).size == pytest.approx((0.2, 0.15, 0.1))
    assert part_box(path, frame, 0.0).size == pytest.approx((0.07, 0.07, 0.1)), "20 mm around the path"


async def test_who_may_not_run_may_not_have_plans_made(teacher: SkillClient, plant: Plant, recipe: Recipe) -> None:
    async with plant.sign_in("visitor") as visitor:
        with pytest.raises(Refused) as refused:
            await visitor.workstation("ws1").check(recipe)
        assert refused.value.status == "BadUserAccessDenied"
    with pytest.raises(Refused, match="BadNotFound"):
        await teacher.workstation("ws1").check(replace(recipe, skill_name="none"))
    with pytest.raises(Refused, match="BadNotFound"):
        await teacher.workstation("ws1").check(recipe, 9)

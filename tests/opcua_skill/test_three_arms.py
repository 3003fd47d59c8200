"""One server, three kinds of arm: the same learned skill is deployed and run on all of them unchanged."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import pytest_asyncio
from scipy.spatial.transform import Rotation
from small_corner import small_corner

from opcua_skill.client import ArmLinks, JobReport, JobTrace, Mode, Recipe, Skill, SkillClient
from sim.order import MotionOrder
from sim.robots import load

if TYPE_CHECKING:
    from tests.conftest import Plant

ARMS = ("panda", "xarm6", "iiwa14")
LINE_ERROR = 1e-5
"""Samples of the learned path 1 ms apart are up to 0.05 mm apart: their chords cut a bend of 0.1 mm by 3 µm."""
SETTINGS = "".join(f'[[workstations]]\nname = "{name}"\narm = "{name}"\nrealtime = false\n\n' for name in ARMS)
LIMIT = 120.0
pytestmark = [pytest.mark.slow, pytest.mark.asyncio(loop_scope="module")]


@dataclass(frozen=True)
class Cell:
    """The plant with the skill `corner` on all three workstations, its one recipe, and everybody signed in."""

    plant: "Plant"
    people: Mapping[str, SkillClient]
    skill: Skill
    recipe: Recipe

    async def run(self, arm: str, recipe_id: str, mode: Mode = "production") -> JobReport:
        user = {"simulation": "teacher", "test": "engineer", "production": "mes"}[mode]
        station = self.people[user].workstation(arm)
        started = await station.execute("corner", recipe_id=recipe_id, mode=mode)
        return await self.people[user].follow(started.job_id, on=arm, limit=LIMIT)

    async def trace(self, arm: str, report: JobReport) -> JobTrace:
        return await self.people["mes"].workstation(arm).trace(report.job_id)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def cell(make_plant: Callable[..., "Plant"]) -> AsyncIterator[Cell]:
    plant = await asyncio.to_thread(make_plant, SETTINGS)
    async with contextlib.AsyncExitStack() as stack:
        names = ("teacher", "engineer", "mes")
        people = {name: await stack.enter_async_context(plant.sign_in(name)) for name in names}
        await people["teacher"].learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
        skill = await people["engineer"].skill("corner")
        [recipe] = await people["engineer"].recipes("corner")
        yield Cell(plant, people, skill, recipe)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def deployed(cell: Cell) -> Cell:
    engineer = cell.people["engineer"]
    await engineer.approve("corner", 1, cell.skill.model_digest)
    for arm in ARMS:
        await engineer.deploy("corner", 1, arm)
    return cell


async def test_a_simulation_needs_no_approval_and_tells_what_was_found(cell: Cell) -> None:
    before = await cell.people["mes"].workstation("panda").arm()
    slowed = replace(cell.recipe, recipe_id="slowed", timing="constant_speed", speed=0.15)
    await cell.people["engineer"].put_recipe(slowed)
    report = await cell.run("panda", "slowed", "simulation")
    assert (await cell.people["engineer"].skill("corner")).state == "Learned"
    assert (report.state, report.failure, report.mode) == ("Completed", "None", "simulation")
    assert "mm/s" in report.message, "where it slows down is told"
    assert "% of the path" in report.message
    after = await cell.people["mes"].workstation("panda").arm()
    assert np.array_equal(before.position, after.position), "a simulation moved the arm"
    assert len((await cell.trace("panda", report)).times) == report.samples


@pytest.mark.parametrize("name", ARMS)
async def test_the_address_space_tells_the_truth_about_each_arm(name: str, cell: Cell) -> None:
    session, model = cell.people["mes"].session, load(name)
    place = f"Machines/{name}/Equipment/Arm"
    names = {
        "Manufacturer": model.manufacturer,
        "Model": model.model,
        "JointPositionMinimum": list(model.limits.lower),
        "JointPositionMaximum": list(model.limits.upper),
        "JointVelocityMaximum": list(model.limits.velocity),
        "JointAccelerationMaximum": list(model.limits.acceleration),
        "JointJerkMaximum": list(model.limits.jerk),
        "AtomicSkills": ["MoveTo", "FollowPath"],
    }
    assert await session.read(*(f"{place}/{one}" for one in names)) == list(names.values())
    given = await session.read(f"Machines/{name}/Equipment/Dispenser/AtomicSkills")
    assert given == [["Dispense"]]
    folder = session._client.get_node(session.node(f"Machines/{name}/AtomicSkills"))
    offered = await folder.get_children()
    assert {str(one.nodeid.Identifier).rsplit("/", 1)[-1] for one in offered} == {"MoveTo", "FollowPath", "Dispense"}
    position, pose = await session.read(f"Machines/{name}/Arm/Position", f"Machines/{name}/Arm/ToolPose")
    assert len(position) == model.dof
    assert np.allclose(position, model.home, atol=2e-3)
    assert len(pose) == 7


async def test_the_same_skill_and_recipe_run_on_all_three_unchanged(deployed: Cell) -> None:
    models = [await deployed.people["mes"].workstation(arm).model("corner") for arm in ARMS]
    for model in models:
        assert model.model_digest == deployed.skill.model_digest
        assert np.array_equal(model.means, deployed.skill.means)
        assert np.array_equal(model.covariances, deployed.skill.covariances)
    reports = await asyncio.gather(*(deployed.run(arm, deployed.recipe.recipe_id) for arm in ARMS))
    path = await deployed.people["mes"].path("corner", time_step=0.001)
    # The recipe's frame is not turned: in the arm's base the path is moved, and lifted by the standoff.
    lifted = np.column_stack([path.points, np.full(len(path.points), deployed.recipe.standoff)])
    wanted = lifted + np.array(deployed.recipe.frame[:3])
    # Each arm has its own pace in corners, so its samples cut them elsewhere: by no more than the recipe allows.
    assert all(
        0.0 < rms <= largest <= MotionOrder().chord_tolerance for rms, largest in (one.path_error for one in reports)
    )
    for arm, report in zip(ARMS, reports, strict=True):
        assert (report.state, report.failure, report.mode) == ("Completed", "None", "production")
        assert 0.0 < report.tracking_error[0] <= report.tracking_error[1] <= 5e-5, arm
        trace = await deployed.trace(arm, report)
        assert len(trace.times) == report.samples
        first, last = (int(np.argmin(np.linalg.norm(trace.commanded - end, axis=1))) for end in (wanted[0], wanted[-1]))
        away = off_the_line(trace.commanded[first : last + 1], wanted)
        assert away.max() < LINE_ERROR, "every arm follows the very same path, at its own pace"
        apart = np.linalg.norm(trace.measured - trace.commanded, axis=1)
        assert (np.sqrt(np.mean(apart**2)), apart.max()) == pytest.approx(report.tracking_error)


def off_the_line(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return how far points (n, 3) are from a line through points (m, 3), m."""
    starts, along = line[:-1], np.diff(line, axis=0)
    squared = np.maximum((along**2).sum(axis=1), 1e-30)
    share = np.clip(((points[:, None] - starts) * along).sum(axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - starts - share[..., None] * along, axis=2).min(axis=1)


def tip_by_the_links(links: ArmLinks, joints: np.ndarray) -> np.ndarray:
    """Return where the nozzle's tip is (n, 3), as a client reckons that knows nothing but what the server tells."""
    at, turn, moving = np.zeros((len(joints), 3)), Rotation.from_rotvec(np.zeros((len(joints), 3))), 0
    for origin, axis in zip(links.origins, links.axes, strict=True):
        at, turn = at + turn.apply(origin[:3]), turn * Rotation.from_quat(origin[3:])
        if axis.any():
            turn, moving = turn * Rotation.from_rotvec(np.outer(joints[:, moving], axis)), moving + 1
    assert moving == joints.shape[1]
    return at


async def test_the_links_told_put_the_nozzle_where_the_record_has_it(deployed: Cell) -> None:
    for arm in ARMS:
        report = await deployed.run(arm, deployed.recipe.recipe_id, "simulation")
        station = deployed.people["mes"].workstation(arm)
        trace, joints = await station.trace(report.job_id), await station.joint_trace(report.job_id)
        links, reading = await station.links(), await station.arm()
        assert np.array_equal(joints.times, trace.times)
        assert np.abs(tip_by_the_links(links, joints.commanded) - trace.commanded).max() < 1e-9
        assert np.abs(tip_by_the_links(links, joints.measured) - trace.measured).max() < 1e-9
        assert np.abs(tip_by_the_links(links, reading.position[None]) - reading.tool_pose[:3]).max() < 1e-9
        covered = set(links.capsules[:, 0])
        assert covered <= set(range(-1, len(links.names)))
        assert len(covered) > load(arm).dof, "every link that moves can be drawn, and the base"
        assert (links.capsules[:, 7] > 0.0).all()


async def test_what_was_dry_run_is_what_runs(deployed: Cell) -> None:
    recipe_id = deployed.recipe.recipe_id
    dry = await deployed.run("xarm6", recipe_id, "simulation")
    wet = await deployed.run("xarm6", recipe_id)
    assert dry.plan_digest == wet.plan_digest != "", "the plan that ran is not the one that was simulated"
    commanded = [(await deployed.trace("xarm6", report)).commanded for report in (dry, wet)]
    assert np.array_equal(*commanded)
    folder = deployed.plant.data / "traces"
    kept = [await written(folder / f"{report.job_id}.plan.json") for report in (dry, wet)]
    assert kept[0] == kept[1]
    assert kept[1]["planDigest"] == wet.plan_digest
    assert kept[1]["skillDigest"] == deployed.skill.model_digest.hex()
    assert kept[1]["samples"] == wet.samples
    other = replace(deployed.recipe, recipe_id="lower", standoff=deployed.recipe.standoff - 0.001)
    await deployed.people["engineer"].put_recipe(other)
    assert (await deployed.run("xarm6", "lower")).plan_digest != wet.plan_digest


async def written(file: Path) -> dict[str, object]:
    """Return what stands in a file that is written beside the job."""
    async with asyncio.timeout(LIMIT):
        while not await asyncio.to_thread(file.exists):
            await asyncio.sleep(0.02)
    return json.loads(await asyncio.to_thread(file.read_text, "utf-8"))


async def test_test_mode_moves_at_no_more_than_a_quarter_of_full_speed(deployed: Cell) -> None:
    recipe_id = deployed.recipe.recipe_id
    full, slow = await asyncio.gather(deployed.run("iiwa14", recipe_id), deployed.run("panda", recipe_id, "test"))
    assert slow.mode == "test"
    speeds = []
    for arm, report in (("iiwa14", full), ("panda", slow)):
        trace = await deployed.trace(arm, report)
        speeds.append(np.linalg.norm(np.diff(trace.measured, axis=0), axis=1) / np.diff(trace.times))
    on_path = deployed.recipe.standoff + deployed.recipe.frame[2] + 1e-4
    below = [
        speed[(await deployed.trace(arm, report)).measured[1:, 2] < on_path]
        for (arm, report), speed in zip((("iiwa14", full), ("panda", slow)), speeds, strict=True)
    ]
    assert np.median(below[1]) == pytest.approx(0.25 * np.median(below[0]), rel=0.02)
    assert below[1].max() <= 0.25 * below[0].max() * 1.02
    assert speeds[1].max() <= 0.25 * load("panda").path_limits.speed


@pytest.mark.parametrize("time_step", [0.001, 0.004, 0.008, 0.02])
async def test_every_time_step_from_1_to_20_ms_ends_exactly_at_the_end(time_step: float, deployed: Cell) -> None:
    name = f"every-{1000 * time_step:g}-ms"
    await deployed.people["engineer"].put_recipe(replace(deployed.recipe, recipe_id=name, time_step=time_step))
    report = await deployed.run("panda", name)
    assert report.state == "Completed", report
    trace = await deployed.trace("panda", report)
    assert len(trace.times) == report.samples
    assert np.allclose(np.diff(trace.times), time_step)
    learned = await deployed.people["mes"].path("corner")
    end = np.append(learned.points[-1], deployed.recipe.standoff) + np.array(deployed.recipe.frame[:3])
    assert np.linalg.norm(trace.commanded - end, axis=1).min() < 1e-8
    assert report.tracking_error[1] <= 1e-4
    assert report.path_error[1] <= 5e-5


async def test_a_turned_frame_and_a_process_parameter_are_obeyed(deployed: Cell) -> None:
    half = np.sqrt(0.5)
    turned = replace(
        deployed.recipe,
        recipe_id="turned",
        frame=(0.45, 0.05, 0.1, 0.0, 0.0, half, half),
        parameters={"BlendRadius": 0.002, "TubeSigmas": 3.0, "TubePolicy": "flag"},
    )
    await deployed.people["engineer"].put_recipe(turned)
    assert (await deployed.people["mes"].recipe("turned")).parameters == turned.parameters
    report = await deployed.run("iiwa14", "turned")
    assert report.state == "Completed", report
    trace = await deployed.trace("iiwa14", report)
    learned = (await deployed.people["mes"].path("corner")).points
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    ends = learned[[0, -1]] @ quarter.T + np.array([0.45, 0.05])
    for end in ends:
        assert np.linalg.norm(trace.commanded[:, :2] - end, axis=1).min() < 1e-8
    plan = await written(deployed.plant.data / "traces" / f"{report.job_id}.plan.json")
    order = plan["order"]
    assert isinstance(order, dict)
    assert (order["blend_radius"], order["tube_sigmas"], order["tube_policy"]) == (0.002, 3.0, "flag")

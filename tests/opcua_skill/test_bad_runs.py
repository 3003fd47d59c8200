"""Runs that must not be: each a named refusal or failure, the arm at rest, the server alive.

The first half is refused before anything moves; the second half goes wrong while a paced arm moves.
"""

import asyncio
import contextlib
import os
import re
import signal
import sqlite3
import time
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pytest_asyncio
from small_corner import small_corner

from opcua_skill.client import ArmReading, JobReport, Recipe, Refused, SkillClient
from opcua_skill.client.workstation import Workstation
from opcua_skill.wire import to_server
from sim.robots import load

if TYPE_CHECKING:
    from tests.conftest import Plant

SETTINGS = """
[[workstations]]
name = "still"
driver = "kinematic"
realtime = false

[[workstations]]
name = "walled"
driver = "kinematic"
realtime = false
[[workstations.fixtures]]
name = "clamp 7"
pose = [0.435, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0]
size = [0.01, 0.2, 0.1]

[[workstations]]
name = "paced"
driver = "pybullet"
"""
LIMIT = 90.0
NAN = float("nan")
PLACE = re.compile(r"at \d+\.\d\d s, \d+\.\d % of the path")
HOME = np.array(load("panda").home)
pytestmark = [pytest.mark.slow, pytest.mark.asyncio(loop_scope="module")]


@dataclass(frozen=True)
class World:
    """The plant with `corner` deployed everywhere, its recipe, and everybody signed in."""

    plant: "Plant"
    people: Mapping[str, SkillClient]
    recipe: Recipe

    @property
    def mes(self) -> SkillClient:
        return self.people["mes"]

    @property
    def paced(self) -> Workstation:
        return self.mes.workstation("paced")

    async def started(self) -> str:
        """Start a run on the paced arm; return its job once the arm is well off its start."""
        job_id = (await self.paced.execute("corner", recipe_id="quick", mode="production")).job_id
        async with asyncio.timeout(LIMIT):
            while np.abs((await self.paced.arm()).position - HOME).max() < 0.05:
                await asyncio.sleep(0.005)
        return job_id

    async def ended(self, job_id: str, on: str = "paced") -> JobReport:
        return await self.mes.follow(job_id, on=on, limit=LIMIT)

    async def at_rest(self) -> ArmReading:
        async with asyncio.timeout(LIMIT):
            while not (reading := await self.paced.arm()).at_rest or reading.mode in ("running", "stopping"):
                await asyncio.sleep(0.01)
        return reading

    async def is_paused(self) -> None:
        async with asyncio.timeout(LIMIT):
            while (await self.paced.arm()).mode != "paused":
                await asyncio.sleep(0.01)

    async def is_home(self) -> None:
        async with asyncio.timeout(LIMIT):
            while np.abs((await self.paced.arm()).position - HOME).max() > 2e-3:
                await asyncio.sleep(0.05)
        await self.at_rest()

    async def still_serves(self) -> None:
        """Show that other clients are served and that the next job runs, from wherever the arm stands."""
        assert [skill.name for skill in await self.people["visitor"].find_skills()] == ["corner"]
        report = await self.ended((await self.paced.execute("corner", recipe_id="quick", mode="production")).job_id)
        assert (report.state, report.failure) == ("Completed", "None"), report


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def world(make_plant: Callable[..., "Plant"]) -> AsyncIterator[World]:
    plant = await asyncio.to_thread(make_plant, SETTINGS)
    async with contextlib.AsyncExitStack() as stack:
        names = ("teacher", "engineer", "mes", "visitor")
        people = {name: await stack.enter_async_context(plant.sign_in(name)) for name in names}
        await people["teacher"].learn_to_the_end("corner", small_corner(), semantic_type="Gluing")
        engineer = people["engineer"]
        await engineer.approve("corner", 1, (await engineer.skill("corner")).model_digest)
        for station in ("still", "walled", "paced"):
            await engineer.deploy("corner", 1, station)
        [recipe] = await engineer.recipes("corner")
        low = {"approach_height": 0.02, "retract_height": 0.02}
        await engineer.put_recipe(replace(recipe, recipe_id="quick", timing="time_optimal", **low))
        yield World(plant, people, recipe)


def tipped(x: float, y: float, z: float, degrees: float) -> tuple[float, ...]:
    """Return a frame that is tipped about its y axis."""
    half = np.radians(degrees) / 2.0
    return (x, y, z, 0.0, float(np.sin(half)), 0.0, float(np.cos(half)))


NOT_STORED: dict[str, dict[str, Any]] = {
    "NaN in the frame": {"frame": (0.4, NAN, 0.1, 0.0, 0.0, 0.0, 1.0)},
    "NaN in the quaternion": {"frame": (0.4, 0.0, 0.1, NAN, 0.0, 0.0, 1.0)},
    "a quaternion of zero": {"frame": (0.4, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0)},
    "a quaternion of length 2": {"frame": (0.4, 0.0, 0.1, 0.0, 0.0, 0.0, 2.0)},
    "a time step of 0": {"time_step": 0.0},
    "a time step of 1 s": {"time_step": 1.0},
    "a time step below 1 ms": {"time_step": 0.0009},
    "a time step above 20 ms": {"time_step": 0.0201},
    "a negative time step": {"time_step": -0.008},
    "a negative speed": {"timing": "constant_speed", "speed": -0.05},
    "a constant speed of 0": {"timing": "constant_speed", "speed": 0.0},
    "an infinite speed": {"timing": "constant_speed", "speed": float("inf")},
    "a negative duration": {"duration": -1.0},
    "an override of 0": {"speed_override": 0.0},
    "an override of 200 %": {"speed_override": 2.0},
    "a negative override": {"speed_override": -0.5},
    "a standoff below the part": {"standoff": -0.001},
    "a largest deviation of NaN": {"max_deviation": NAN},
    "corners in a word of its own": {"parameters": {"Corners": "somehow"}},
    "a blend radius of a metre": {"parameters": {"BlendRadius": 1.0}},
    "a parameter nobody knows": {"parameters": {"Presure": 2.0}},
}


@pytest.mark.parametrize("case", NOT_STORED)
async def test_a_recipe_that_makes_no_sense_is_not_stored(case: str, world: World) -> None:
    before = await asyncio.to_thread(world.plant.counts)
    bad = replace(world.recipe, recipe_id="bad", **NOT_STORED[case])
    with pytest.raises(Refused) as refused:
        await world.people["engineer"].put_recipe(bad)
    assert (refused.value.status, refused.value.argument) == ("BadInvalidArgument", "Recipe")
    assert refused.value.argument_status == "BadOutOfRange"
    *_, (field, value) = NOT_STORED[case].items()
    named = next(iter(value)) if isinstance(value, dict) else field
    assert named in refused.value.reason, "the reason has to name the field"
    assert await asyncio.to_thread(world.plant.counts) == before


@dataclass(frozen=True)
class Impossible:
    """A recipe that can be stored and cannot be run: where, with what failure, and what its report has to say."""

    changes: Mapping[str, Any]
    failures: frozenset[str]
    says: str
    station: str = "still"
    placed: bool = True


REACH = frozenset({"NoIkSolution", "WorkspaceLimit"})
IMPOSSIBLE = {
    "a plate out of reach": Impossible({"frame": (0.83, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)}, REACH, r"by up to \d+\.\d mm"),
    "a plate behind the arm's base": Impossible({"frame": (2.5, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)}, REACH, r"\d mm"),
    "a tilt that no posture holds": Impossible(
        {"frame": tipped(0.5, 0.0, 0.3, 75.0)}, frozenset({"NoIkSolution"}), r"by up to \d+\.\d mm", placed=False
    ),
    "a corner at an impossible speed": Impossible(
        {"timing": "constant_speed", "speed": 0.5, "parameters": {"Corners": "refuse"}},
        frozenset({"SpeedLimit"}),
        r"mm/s",
    ),
    "a duration nothing can keep": Impossible(
        {"duration": 0.05}, frozenset({"SpeedLimit"}), r"needs at least \d\.\d+ s", placed=False
    ),
    "a fixture in the way": Impossible({}, frozenset({"Collision"}), "clamp 7", "walled", placed=False),
    "a run of more samples than can be checked": Impossible(
        {"duration": 3600.0, "time_step": 0.001}, frozenset({"ParameterInvalid"}), "at most 500000", placed=False
    ),
    "a crawl that never ends": Impossible(
        {"timing": "constant_speed", "speed": 1e-9}, frozenset({"ParameterInvalid"}), "time steps", placed=False
    ),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
@pytest.mark.parametrize("mode", ["production", "simulation"])
async def test_a_run_that_cannot_be_is_refused_with_place_and_size_in_its_report(
    case: str, mode: Any, world: World
) -> None:
    given = IMPOSSIBLE[case]
    await world.people["engineer"].put_recipe(replace(world.recipe, recipe_id="impossible", **given.changes))
    station = world.people["teacher" if mode == "simulation" else "mes"].workstation(given.station)
    before, arm = await asyncio.to_thread(world.plant.counts), await station.arm()
    with pytest.raises(Refused) as refused:
        await station.execute("corner", recipe_id="impossible", mode=mode)
    assert refused.value.status == "BadOutOfRange", refused.value
    newest = (await station.jobs(limit=1))[0]
    assert (newest.state, newest.recipe_id, newest.mode) == ("Failed", "impossible", mode)
    assert newest.failure in given.failures, newest
    assert re.search(given.says, newest.message), newest.message
    assert PLACE.search(newest.message) or not given.placed, newest.message
    assert newest.start_time is None, "it never ran"
    after = await asyncio.to_thread(world.plant.counts)
    assert after == {**before, "jobs": before["jobs"] + 1}
    assert np.array_equal((await station.arm()).position, arm.position)


async def test_a_corner_too_fast_is_slowed_down_visibly_unless_that_is_refused(world: World) -> None:
    fast = {"timing": "constant_speed", "speed": 0.15}
    await world.people["engineer"].put_recipe(replace(world.recipe, recipe_id="fast", **fast))
    station = world.mes.workstation("still")
    report = await world.ended((await station.execute("corner", recipe_id="fast", mode="production")).job_id, "still")
    assert report.state == "Completed"
    assert re.search(r"\d mm/s", report.message), report.message
    assert PLACE.search(report.message)


@pytest.mark.parametrize("fraction", [0.0, 0.005, 2.0, -0.5, NAN, float("inf")])
async def test_an_override_that_is_none_is_refused(fraction: float, world: World) -> None:
    with pytest.raises(Refused) as refused:
        await world.paced.set_speed_override(fraction)
    assert refused.value.status == "BadOutOfRange"
    assert (await world.paced.arm()).speed_override == 1.0


async def test_two_runs_at_once_are_one_after_the_other(world: World) -> None:
    first, second = [await world.paced.execute("corner", recipe_id="quick", mode="production") for _ in range(2)]
    assert second.state == "Queued"
    reports = [await world.ended(one.job_id) for one in (first, second)]
    assert [report.state for report in reports] == ["Completed", "Completed"]
    assert reports[0].end_time <= reports[1].start_time  # pyright: ignore[reportOptionalOperand]


async def test_an_abort_during_the_approach_leaves_the_arm_at_rest_until_somebody_sends_it_home(world: World) -> None:
    job_id = await world.started()
    assert await world.paced.abort(job_id, "hand in the cell") == "Stopping"
    report = await world.ended(job_id)
    assert (report.state, report.failure, report.message) == ("Aborted", "Aborted", "hand in the cell")
    rest = await world.at_rest()
    assert rest.mode == "idle"
    trace = await world.paced.trace(job_id)
    assert trace.measured[:, 2].min() > world.recipe.frame[2] + world.recipe.standoff + 1e-3, "it was at the part"
    assert np.abs(rest.position - HOME).max() > 0.02
    assert (report.cause, report.held_queue) == ("Aborted", True)
    assert np.isnan(report.place), "it had not come to the path"
    queue = await world.paced.queue()
    assert (queue.state, queue.because, queue.by, queue.waiting) == ("Held", "Aborted", "mes", 0)
    waiting = (await world.paced.execute("corner", recipe_id="quick", mode="production")).job_id
    assert (await world.paced.job(waiting)).held_queue
    with pytest.raises(Refused) as refused:
        await world.paced.release_queue()
    assert (refused.value.status, "GoHome" in refused.value.reason) == ("BadInvalidState", True)
    assert np.array_equal((await world.paced.arm()).position, rest.position), "it moved and nobody had asked for it"
    await world.paced.go_home()
    asked_on_the_way = (await world.paced.execute("corner", recipe_id="quick", mode="production")).job_id
    with pytest.raises(Refused, match="BadInvalidState"):
        await world.paced.release_queue()
    await world.is_home()
    assert [(await world.paced.job(one)).state for one in (waiting, asked_on_the_way)] == ["Queued", "Queued"]
    assert await world.paced.release_queue("looked at it") == "Released"
    assert [(await world.ended(one)).state for one in (waiting, asked_on_the_way)] == ["Completed", "Completed"]
    await world.still_serves()


async def test_an_arm_that_is_not_at_its_start_runs_nothing_until_somebody_sends_it_home(world: World) -> None:
    job_id = await world.started()
    await world.paced.protective_stop("light curtain")
    report = await world.ended(job_id)
    assert (report.state, report.failure, report.message) == ("Aborted", "ProtectiveStop", "light curtain")
    with pytest.raises(Refused) as refused:
        await world.paced.execute("corner", recipe_id="quick", mode="production")
    assert refused.value.status == "BadInvalidState"
    await world.paced.reset("curtain is clear")
    before = (await world.at_rest()).position
    waiting = (await world.paced.execute("corner", recipe_id="quick", mode="production")).job_id
    with pytest.raises(Refused) as refused:
        await world.paced.release_queue()
    assert refused.value.status == "BadInvalidState"
    assert ((await world.paced.job(waiting)).state, (await world.paced.queue()).because) == ("Queued", "ProtectiveStop")
    assert np.array_equal((await world.paced.arm()).position, before), "it moved without having been looked at"
    await world.paced.go_home()
    await world.is_home()
    await world.paced.release_queue()
    assert (await world.ended(waiting)).state == "Completed"
    await world.still_serves()


def simulation_of(plant: "Plant") -> int:
    """Return the process of the plant's PyBullet arm."""
    assert plant.process is not None
    found = []
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            if entry.name.isdigit() and b"pybullet.worker" in (entry / "cmdline").read_bytes():
                parent = (entry / "stat").read_text().rsplit(")", 1)[1].split()[1]
                if int(parent) == plant.process.pid:
                    found.append(int(entry.name))
    [process] = found
    return process


async def test_a_simulation_killed_in_mid_motion_fails_its_job_within_a_second(world: World) -> None:
    process = await asyncio.to_thread(simulation_of, world.plant)
    job_id = await world.started()
    died = datetime.now(UTC)
    os.kill(process, signal.SIGKILL)
    report = await world.ended(job_id)
    assert (report.state, report.failure) == ("Failed", "Interrupted"), report
    assert report.end_time is not None
    assert report.end_time.astimezone(UTC) - died < timedelta(seconds=1.0), "it took the server longer to tell"
    visitor = world.people["visitor"]
    assert not (await visitor.session.read("Machines/paced/Arm/Known"))[0], "the arm is shown after its job"
    assert ((await world.paced.queue()).because, report.cause) == ("ArmLost", "ArmLost")
    reading = await visitor.workstation("paced").arm()
    assert (reading.mode, reading.at_rest) == ("fault", True)
    assert reading.fault
    with pytest.raises(Refused) as refused:
        await world.paced.execute("corner", recipe_id="quick", mode="production")
    assert refused.value.status == "BadInvalidState"
    still = world.mes.workstation("still")
    assert (await world.ended((await still.execute("corner", mode="production")).job_id, "still")).state == "Completed"
    await world.paced.reset("looked at it")
    async with asyncio.timeout(LIMIT):
        while not (await visitor.session.read("Machines/paced/Arm/Known"))[0]:
            await asyncio.sleep(0.01)
        kept = 0
        while not kept:
            with contextlib.suppress(Refused):  # it is written down after the job's end
                kept = len((await world.paced.trace(job_id)).times)
    again = await visitor.workstation("paced").arm()
    assert np.allclose(again.position, reading.position, atol=1e-9), "the reset moved the arm"
    await world.paced.go_home()
    await world.is_home()
    await world.paced.release_queue()
    await world.still_serves()


async def test_a_locked_database_does_not_keep_the_arm_from_stopping(world: World) -> None:
    job_id = await world.started()
    with contextlib.closing(sqlite3.connect(world.plant.database, isolation_level=None, timeout=20.0)) as other:
        other.execute("BEGIN IMMEDIATE")
        asked = time.monotonic()
        watching = world.people["visitor"].workstation("paced")
        assert await world.paced.pause(job_id, "look") == "Paused"
        await world.is_paused()
        assert await world.paced.abort(job_id, "stop") == "Stopping"
        assert time.monotonic() - asked < 10.0, "the answer waited for the database"
        while not (await watching.arm()).at_rest:
            assert time.monotonic() - asked < 15.0, "the arm still moves while the database is locked"
            await asyncio.sleep(0.01)
        assert (await watching.job(job_id)).state == "Running", "told before it was written"
        assert (await watching.queue()).state == "Held"
        other.execute("ROLLBACK")
    assert (await world.ended(job_id)).state == "Aborted"
    await world.paced.go_home()
    await world.is_home()
    await world.paced.release_queue()


async def test_a_run_that_somebody_else_marked_as_ended_is_told_as_it_is_paused_resumed_and_aborted(
    world: World,
) -> None:
    job_id = await world.started()
    with contextlib.closing(sqlite3.connect(world.plant.database, isolation_level=None, timeout=20.0)) as other:
        other.execute("UPDATE jobs SET state = 'Failed' WHERE job_id = ?", (job_id,))
    assert (await world.paced.job(job_id)).state == "Running"
    assert await world.paced.pause(job_id, "look") == "Paused"
    assert (await world.paced.job(job_id)).state == "Paused"
    await world.is_paused()
    assert await world.paced.resume(job_id) == "Running"
    assert await world.paced.abort(job_id, "stop") == "Stopping"
    assert (await world.ended(job_id)).state == "Failed", "what somebody else wrote is not written over"
    async with asyncio.timeout(LIMIT):
        while True:
            with contextlib.suppress(Refused):  # the arm is at rest, its lane ends the run
                await world.paced.go_home()
                break
    await world.is_home()
    await world.paced.release_queue()


async def test_a_job_whose_skill_was_withdrawn_while_it_waited_does_not_run(world: World) -> None:
    engineer = world.people["engineer"]
    assert await world.paced.hold_queue("not yet") == "Held"
    started = await world.paced.execute("corner", recipe_id="quick", mode="production")
    await engineer.withdraw("corner", 1, "paced")
    try:
        assert await world.paced.release_queue() == "Released"
        report = await world.ended(started.job_id)
        assert (report.state, report.failure, report.start_time) == ("Failed", "NotDeployed", None)
        assert (await world.paced.queue()).because == "Failed"
        await world.paced.release_queue()
    finally:
        await engineer.deploy("corner", 1, "paced")


DAMAGE = {
    "a recipe": (
        "UPDATE recipes SET content = '{'",
        "SkillLibrary",
        "GetRecipe",
        lambda w: {"RecipeId": "corner-default"},
    ),
    "the recipes": (
        "UPDATE recipes SET content = '{}'",
        "SkillLibrary",
        "ListRecipes",
        lambda w: {"SkillName": "corner"},
    ),
    "a job": ("UPDATE jobs SET report = '[]'", "Machines/still", "ListJobs", None),
}


@pytest.mark.parametrize("case", DAMAGE)
async def test_a_stored_row_that_cannot_be_read_is_a_fault_inside_with_an_id_in_the_log(
    case: str, world: World
) -> None:
    statement, place, method, given = DAMAGE[case]
    still = world.mes.workstation("still")
    if not await still.jobs(limit=1):
        await world.ended((await still.execute("corner", mode="simulation")).job_id, "still")
    table = statement.split()[1]
    arguments = (
        {name: to_server.string(value) for name, value in given(world).items()}
        if given
        else {
            "State": to_server.string(""),
            "Limit": to_server.uint32(1),
        }
    )
    with contextlib.closing(sqlite3.connect(world.plant.database, timeout=20.0)) as other:
        other.execute(f"CREATE TABLE kept AS SELECT * FROM {table}")
        other.execute(statement)
        other.commit()
        try:
            with pytest.raises(Refused) as refused:
                await world.mes.session.call(place, method, **arguments)
        finally:
            column = statement.split()[3]
            key = {"recipes": "recipe_id", "jobs": "job_id"}[table]
            other.execute(f"UPDATE {table} SET {column} = (SELECT {column} FROM kept WHERE kept.{key} = {table}.{key})")
            other.execute("DROP TABLE kept")
            other.commit()
    assert refused.value.status == "BadInternalError"
    ids = re.findall(r"\b[0-9a-f]{6,}\b", refused.value.reason)
    log = await asyncio.to_thread(world.plant.log)
    assert ids, refused.value.reason
    assert any(found in log for found in ids)
    assert "Damaged" in log


async def test_a_server_stopped_while_the_arm_moves_ends_well_and_its_jobs_say_so(world: World) -> None:
    await world.paced.set_speed_override(0.3)  # so that it still moves when a busy machine gets round to stopping
    running = await world.started()
    waiting = (await world.paced.execute("corner", recipe_id="quick", mode="production")).job_id
    await asyncio.to_thread(world.plant.stop)
    with contextlib.closing(sqlite3.connect(world.plant.database)) as other:
        ends = dict(other.execute("SELECT job_id, state || ' ' || report FROM jobs").fetchall())
    for job_id in (running, waiting):
        assert ends[job_id].startswith("Failed")
        assert "Interrupted" in ends[job_id]
        assert "the server stopped" in ends[job_id]
    assert "Traceback" not in (await asyncio.to_thread(world.plant.log)).split("stopping")[-1]

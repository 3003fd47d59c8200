"""The job engine: durable jobs, named failures, nothing that moves before it is checked."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from scripted_arm import ScriptedArm
from small_corner import small_corner

from library.description import Cause, Failure, JobReport, JobState, Recipe, SkillDescription
from library.errors import LibraryUnusable, Trouble
from library.store import SkillLibrary
from models.demonstration import Edits
from models.options import LearningOptions
from opcua_skill.configuration.settings import Equipment, Learning, Limits, Settings, Workstation
from opcua_skill.jobs import (
    ArmNotReady,
    JobEngine,
    LacksAtomicSkill,
    LearningFailed,
    LearningRequest,
    MotionNotPossible,
    NotExecutable,
    QueueFull,
)

LIMIT = 60.0
PEOPLE = small_corner(4)
GRIPPER = Equipment(name="Gripper", atomic_skills=("Grip",))


class Plant:
    """An engine on a library of its own, with scripted arms, and what it told."""

    def __init__(self, library: SkillLibrary, settings: Settings) -> None:
        self.library = library
        self.arms: dict[tuple[str, bool], ScriptedArm] = {}
        self.told: list[JobReport] = []
        self.versions: list[SkillDescription] = []
        models = {one.name: ScriptedArm().model for one in settings.workstations}
        self.engine = JobEngine(library, settings, models, self._arm, self._tell, self._tell_version)

    def _arm(self, station: str, simulation: bool) -> ScriptedArm:
        return self.arms.setdefault((station, simulation), ScriptedArm())

    async def _tell(self, report: JobReport) -> None:
        self.told.append(report)

    async def _tell_version(self, description: SkillDescription, _actor: str, _comment: str) -> None:
        self.versions.append(description)

    def request(self, options: LearningOptions | None = None, *, people: int = 4) -> LearningRequest:
        return LearningRequest(
            skill_name="glue",
            semantic_type="Gluing",
            required_atomic_skills=("MoveTo", "FollowPath", "Dispense"),
            recordings=PEOPLE[:people],
            edits=Edits(),
            options=options or LearningOptions(),
            actor="tina",
        )

    async def learned(self) -> SkillDescription:
        outcome = await self.engine.learn(self.request(), answer_within=LIMIT)
        assert outcome.description is not None
        return outcome.description

    async def approved(self, *stations: str) -> SkillDescription:
        description = await self.learned()
        digest = bytes.fromhex(description.model_digest)
        await self.library.approve("glue", description.version, digest, "eve", "")
        for station in stations:
            await self.library.deploy("glue", description.version, station, "eve")
        return description

    async def recipe(self) -> Recipe:
        return await self.library.recipe(await self.library.default_recipe_id("glue"))


@asynccontextmanager
async def plant_with(folder: Path, *, silent: str = "", **settings: object) -> AsyncIterator[Plant]:
    library = await SkillLibrary.open(folder / "skills.db")
    made = Plant(library, Settings(data=folder, **settings))  # type: ignore[arg-type]
    if silent:
        made.arms[silent, False].be_silent("no cable")
    await made.engine.start()
    try:
        yield made
    finally:
        for arm in made.arms.values():
            arm.finish.set()
        await made.engine.stop()
        await library.close()


@pytest.fixture
async def plant(tmp_path: Path) -> AsyncIterator[Plant]:
    async with plant_with(
        tmp_path, workstations=(Workstation(), Workstation(name="bare", equipment=(GRIPPER,)))
    ) as made:
        yield made


async def test_a_learned_version_is_told_after_its_job(plant: Plant) -> None:
    description = await plant.learned()
    assert [report.state for report in plant.told] == [JobState.RUNNING, JobState.COMPLETED]
    assert plant.told[-1].skill_version == description.version == 1
    assert plant.versions == [description]


@pytest.mark.parametrize("stored", [False, True], ids=["nothing stored", "stored, and the answer lost"])
async def test_what_was_learned_waits_for_a_database_server_that_is_away(
    plant: Plant, stored: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    add, asked = plant.library.add_version, 0

    async def away(**given: Any) -> SkillDescription:
        nonlocal asked
        asked += 1
        if asked > 1:
            return await add(**given)
        if stored:
            await add(**given)
        raise LibraryUnusable("db", "connection refused", "start it", Trouble.UNREACHABLE)

    monkeypatch.setattr(plant.library, "add_version", away)
    description = await plant.learned()
    assert asked == 2
    assert [one.version for one in await plant.library.versions("glue")] == [description.version] == [1]
    assert plant.versions == [description]


async def test_a_slow_learning_job_answers_running_and_goes_on(plant: Plant) -> None:
    outcome = await plant.engine.learn(plant.request(), answer_within=0.001)
    assert outcome.description is None
    assert outcome.report.state in {JobState.QUEUED, JobState.RUNNING}
    async with asyncio.timeout(LIMIT):
        while (await plant.library.job(outcome.report.job_id)).state is not JobState.COMPLETED:
            await asyncio.sleep(0.02)
    assert (await plant.library.description("glue")).version == 1


async def test_a_job_that_ends_while_its_row_is_read_answers_what_came_of_it(
    plant: Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = plant.library.job

    async def read_late(job_id: str) -> JobReport:
        async with asyncio.timeout(LIMIT):
            while (report := await read(job_id)).state is not JobState.COMPLETED:
                await asyncio.sleep(0.01)
        return report

    monkeypatch.setattr(plant.library, "job", read_late)
    outcome = await plant.engine.learn(plant.request(), answer_within=0.001)
    assert outcome.report.state is JobState.COMPLETED
    assert outcome.learned is not None
    assert outcome.description is not None


async def test_demonstrations_that_cannot_be_learned_fail_the_job_with_the_remedy(plant: Plant) -> None:
    with pytest.raises(LearningFailed, match="record more"):
        await plant.engine.learn(plant.request(people=1), answer_within=LIMIT)
    (report,) = await plant.library.jobs(state="Failed")
    assert report.failure is Failure.PARAMETER_INVALID


async def test_learning_that_takes_too_long_is_a_timeout(tmp_path: Path) -> None:
    async with plant_with(tmp_path, learning=Learning(timeout=0.001)) as plant:
        with pytest.raises(RuntimeError, match="took longer than"):
            await plant.engine.learn(plant.request(), answer_within=LIMIT)
        (report,) = await plant.library.jobs(state="Failed")
        assert report.failure is Failure.TIMEOUT


async def test_more_learning_jobs_than_the_limit_are_refused(tmp_path: Path) -> None:
    async with plant_with(tmp_path, limits=Limits(max_queued_jobs=1)) as plant:
        await plant.engine.learn(plant.request(), answer_within=0.001)
        with pytest.raises(QueueFull):
            await plant.engine.learn(plant.request(), answer_within=0.001)


async def test_what_a_crash_left_running_is_interrupted_at_the_next_start(tmp_path: Path) -> None:
    async with await SkillLibrary.open(tmp_path / "skills.db") as library:
        await library.add_job(JobReport(job_id="old", kind="Execution", workstation="ws1", mode="production"))
        await library.move_job("old", JobState.RUNNING)
    async with plant_with(tmp_path) as plant:
        report = await plant.library.job("old")
        assert (report.state, report.failure) == (JobState.FAILED, Failure.INTERRUPTED)


async def test_the_override_is_kept_over_a_restart_and_a_reset_and_does_not_rise_by_itself(tmp_path: Path) -> None:
    async with plant_with(tmp_path) as plant:
        await plant.engine.stations["ws1"].set_override(0.35)
    async with plant_with(tmp_path) as plant:
        station, arm = plant.engine.stations["ws1"], plant.arms["ws1", False]
        assert (station.speed_override, arm.state().override) == (0.35, 0.35)
        await station.reset()
        assert arm.state().override == 0.35
        await arm.set_override(1.0)
        async with asyncio.timeout(LIMIT):
            while arm.state().override > 0.35:
                await asyncio.sleep(0.01)


async def test_jobs_that_a_crash_left_hold_the_queue_of_their_arm_alone_until_somebody_releases_it(
    tmp_path: Path,
) -> None:
    async with await SkillLibrary.open(tmp_path / "skills.db") as library:
        for job_id, station, mode in (("arm", "ws1", "production"), ("beside", "ws2", "simulation")):
            await library.add_job(JobReport(job_id=job_id, kind="Execution", workstation=station, mode=mode))
    both = (Workstation(), Workstation(name="ws2"))
    async with plant_with(tmp_path, workstations=both) as plant:
        first, second = (plant.engine.stations[name].queue for name in ("ws1", "ws2"))
        assert (first.status.because, first.status.by) == (Cause.UNFINISHED_AT_START, "server")
        assert not second.held
    async with plant_with(tmp_path, workstations=both) as plant:
        station = plant.engine.stations["ws1"]
        assert station.queue.held, "a second start releases nothing"
        await station.queue.release("olga", station.check_ready_for_release)
    async with plant_with(tmp_path, workstations=both) as plant:
        assert not plant.engine.stations["ws1"].queue.held


async def test_production_needs_a_deployment_and_test_an_approval(plant: Plant) -> None:
    await plant.learned()
    recipe = await plant.recipe()
    with pytest.raises(NotExecutable) as refused:
        await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
    assert refused.value.failure is Failure.NOT_DEPLOYED
    with pytest.raises(NotExecutable) as refused:
        await plant.engine.execute("ws1", "glue", recipe, "test", "eve")
    assert refused.value.failure is Failure.NOT_APPROVED
    report = await plant.engine.execute("ws1", "glue", recipe, "simulation", "tina")
    assert report.state is JobState.QUEUED
    assert plant.arms["ws1", False].runs == 0


async def test_test_mode_is_slow_and_production_is_not(plant: Plant) -> None:
    await plant.approved("ws1")
    recipe = await plant.recipe()
    slow = await plant.engine.execute("ws1", "glue", recipe, "test", "eve")
    fast = await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
    assert slow.samples > 2 * fast.samples


async def test_equipment_without_the_skill_cannot_run_it(plant: Plant) -> None:
    await plant.approved()
    with pytest.raises(LacksAtomicSkill, match="Dispense"):
        await plant.engine.execute("bare", "glue", await plant.recipe(), "simulation", "tina")


async def test_an_unreachable_part_leaves_a_report_and_moves_nothing(plant: Plant) -> None:
    await plant.approved("ws1")
    recipe = (await plant.recipe()).model_copy(update={"frame": (2.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)})
    with pytest.raises(MotionNotPossible) as refused:
        await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
    report = await plant.library.job(refused.value.report.job_id)
    assert (report.state, report.start_time) == (JobState.FAILED, None)
    assert report.failure in {Failure.WORKSPACE_LIMIT, Failure.NO_IK_SOLUTION}
    assert "% of the path" in report.message
    assert plant.arms["ws1", False].runs == 0


async def test_an_arm_in_protective_stop_takes_no_job_until_it_is_reset(plant: Plant) -> None:
    await plant.approved("ws1")
    arm, recipe = plant.arms["ws1", False], await plant.recipe()
    await arm.protective_stop("light curtain")
    with pytest.raises(ArmNotReady, match="waits for a reset"):
        await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
    await arm.reset()
    assert (await plant.engine.execute("ws1", "glue", recipe, "production", "mes")).state is JobState.QUEUED


async def test_an_arm_that_does_not_answer_keeps_no_other_from_being_served(tmp_path: Path) -> None:
    both = (Workstation(), Workstation(name="ws2"))
    async with plant_with(tmp_path, silent="ws2", workstations=both) as plant:
        await plant.approved("ws1", "ws2")
        recipe, broken = await plant.recipe(), plant.engine.stations["ws2"]
        assert (await plant.engine.execute("ws1", "glue", recipe, "production", "mes")).state is JobState.QUEUED
        with pytest.raises(ArmNotReady, match="waits for a reset: closed"):
            await plant.engine.execute("ws2", "glue", recipe, "production", "mes")
        with pytest.raises(ArmNotReady, match="does not answer: no cable"):
            await broken.reset()
        plant.arms["ws2", False].silent = ""
        await broken.reset()
        assert (await plant.engine.execute("ws2", "glue", recipe, "production", "mes")).state is JobState.QUEUED


async def test_a_full_queue_refuses_and_stores_nothing(tmp_path: Path) -> None:
    async with plant_with(tmp_path, limits=Limits(max_queued_jobs=1)) as plant:
        await plant.approved("ws1")
        recipe = await plant.recipe()
        await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
        await asyncio.wait_for(plant.arms["ws1", False].running.wait(), LIMIT)
        await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
        before = len(await plant.library.jobs())
        with pytest.raises(QueueFull):
            await plant.engine.execute("ws1", "glue", recipe, "production", "mes")
        assert len(await plant.library.jobs()) == before

"""Execution jobs: checked completely before they are queued, and run on a lane exactly as they were checked."""

import math
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from typing import Literal

from library.description import Cause, Failure, JobReport, JobState, Recipe, SkillDescription, VersionState
from library.errors import Damaged, ServedElsewhere
from library.store import SkillLibrary
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs.errors import LacksAtomicSkill, MotionNotPossible, NotExecutable, QueueFull
from opcua_skill.jobs.ids import new_job_id
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.jobs.motion.run import NoLongerExecutable, QueuedMotion, slowed_to
from opcua_skill.jobs.planning import Planning
from opcua_skill.jobs.station import Station
from opcua_skill.jobs.worker_tasks import PlanRefused
from sim.findings import Finding

Mode = Literal["simulation", "test", "production"]
MODES: tuple[Mode, ...] = ("simulation", "test", "production")
TEST_SPEED = 0.25
TOLD_FINDINGS = 5


class ExecutionJobs:
    """The jobs that move an arm, or a simulation of it."""

    def __init__(
        self,
        library: SkillLibrary,
        settings: Settings,
        planning: Planning,
        tell: Callable[[JobReport], Awaitable[None]],
    ) -> None:
        self._library = library
        self._settings = settings
        self._planning = planning
        self._tell = tell

    async def execute(
        self, station: Station, skill_name: str, recipe: Recipe, mode: Mode, actor: str, job_id: str = ""
    ) -> JobReport:
        """Check a run completely, then queue it. Nothing has moved when this returns.

        While the arm's queue is held, a run is taken and waits: it begins once somebody has released the queue.
        Raises QueueFull, NotExecutable, LacksAtomicSkill, MotionNotPossible, and the library's NotFound and Damaged.
        """
        lane = station.simulation if mode == "simulation" else station.lane
        description = await self.version_for(station, skill_name, recipe, mode)
        if description.computed_digest() != description.model_digest:
            raise Damaged(f"{skill_name} version {description.version}", "its model is not the one its digest names")
        self.check_equipment(station, description)
        if lane is station.lane:
            station.check_ready()
        self._room_on(lane)
        planned = await self._planning.plan(station, description, recipe, TEST_SPEED if mode == "test" else 1.0)
        report = JobReport(
            job_id=job_id or new_job_id("run"),
            kind="Execution",
            skill_name=skill_name,
            skill_version=description.version,
            recipe_id=recipe.recipe_id,
            mode=mode,
            workstation=station.name,
            actor=actor,
        )
        if isinstance(planned, PlanRefused):
            raise MotionNotPossible(await self._refused(report, recipe, planned.findings))
        self._room_on(lane)
        notes = "; ".join(text for text in (_words(planned.findings), f"plan {planned.digest}") if text)
        told = {
            "path_error": planned.path_error,
            "samples": planned.samples,
            "plan_digest": planned.digest,
            "message": notes,
            "slowed_to": slowed_to(planned),
        }
        report = report.model_copy(update=told)
        lane.reserve()
        try:
            await self._library.add_job(report, recipe)
        except BaseException:
            lane.release()
            raise
        await self._tell(report)
        lane.put(QueuedMotion(report.job_id, planned, notes))
        return report

    @staticmethod
    def check_equipment(station: Station, description: SkillDescription) -> None:
        """Raise LacksAtomicSkill if a station cannot do all that a skill is made of."""
        missing = set(description.required_atomic_skills) - station.atomic_skills
        if missing:
            raise LacksAtomicSkill(f"{station.name} lacks the atomic skill {', '.join(sorted(missing))}")

    def _room_on(self, lane: MotionQueue) -> None:
        if lane.waiting >= self._settings.limits.max_queued_jobs:
            raise QueueFull(f"as many jobs as may wait do, {lane.waiting}: try again when one has ended")

    async def _refused(self, report: JobReport, recipe: Recipe, findings: Sequence[Finding]) -> JobReport:
        """Write down a refused run: a failed job that never moved, so that its reason and place can be read."""
        await self._library.add_job(report, recipe)
        failed = await self._library.move_job(
            report.job_id,
            JobState.FAILED,
            failure=Failure(findings[0].code),
            message=_words(findings),
            cause=Cause.FAILED,
            path_phase=findings[0].phase if math.isfinite(findings[0].phase) else None,
            end_time=datetime.now(UTC),
        )
        await self._tell(failed)
        return failed

    async def version_for(self, station: Station, skill_name: str, recipe: Recipe, mode: Mode) -> SkillDescription:
        """Return the version a run is of, or say why none may run in this mode."""
        await self._library.description(skill_name)
        deployed = await self._library.deployed(skill_name, station.name)
        if mode == "production":
            if deployed is None:
                raise NotExecutable(
                    Failure.NOT_DEPLOYED, f"{skill_name} is not deployed on {station.name}: deploy it first"
                )
            if recipe.skill_version not in (0, deployed):
                raise NotExecutable(
                    Failure.NOT_DEPLOYED,
                    f"recipe {recipe.recipe_id} is for version {recipe.skill_version}, deployed is version {deployed}",
                )
            return await self._library.description(skill_name, deployed)
        description = await self._library.description(skill_name, recipe.skill_version or deployed or 0)
        if mode == "test" and description.state is not VersionState.APPROVED:
            raise NotExecutable(
                Failure.NOT_APPROVED,
                f"{skill_name} version {description.version} is {description.state.value}: only an approved one runs",
            )
        return description

    async def may_still_run(self, station: Station, report: JobReport) -> None:
        """Raise NotAnyMore if a job whose turn has come may not run now: much can be decided while it waits."""
        if report.mode == "simulation":
            return
        name, version = report.skill_name, report.skill_version
        try:
            await self._library.check_lease(station.name)
        except ServedElsewhere as taken:
            raise NoLongerExecutable(Failure.INTERRUPTED, str(taken)) from taken
        if report.mode == "production" and await self._library.deployed(name, station.name) != version:
            reason = f"{name} version {version} is not deployed on {station.name} any more"
            raise NoLongerExecutable(Failure.NOT_DEPLOYED, reason)
        state = (await self._library.description(name, version)).state
        if state is not VersionState.APPROVED:
            raise NoLongerExecutable(Failure.NOT_APPROVED, f"{name} version {version} is {state.value} by now")


def _words(findings: Sequence[Finding]) -> str:
    return "; ".join(finding.text for finding in findings[:TOLD_FINDINGS])[:3900]

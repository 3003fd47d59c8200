"""The one job engine under every face: durable jobs, learning in workers, one motion at a time per arm.

Every change of state is written to the library before anybody is told.
"""

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from library.description import Failure, JobReport, JobState, Parameter, Recipe, SkillDescription, VersionState
from library.errors import InvalidValue
from library.store import SkillLibrary
from models.demonstration import Demonstration, Edits
from models.learning import LearnedMotion, LearningOptions
from models.motion import Trajectory
from opcua_skill.computations import (
    LearningRefused,
    PlanRefused,
    learn_skill,
    plan_skill,
    plan_way_home,
    ready,
    trajectory_as_learned,
    trajectory_of_plan,
    write_trace,
)
from opcua_skill.lane import Lane, Order
from opcua_skill.settings import Settings, Workstation
from opcua_skill.workers import WorkerDied, Workers, WorkerTimeout
from sim.arm import Arm, ArmMode, ArmModel, ArmState, StartRefused, Trace
from sim.clearance import Box, Cell
from sim.plan import Finding, MotionOrder, MotionPlan

Mode = Literal["simulation", "test", "production"]
TEST_SPEED = 0.25
MOTION_PARAMETERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "BlendRadius": ("blend_radius", ()),
    "Corners": ("corners", ("refuse", "slow")),
    "ChordTolerance": ("chord_tolerance", ()),
    "TubeSigmas": ("tube_sigmas", ()),
    "TubePolicy": ("tube_policy", ("flag", "stop")),
}
PLANNING_SECONDS = 30.0
START_TOLERANCE = 2e-3

_log = logging.getLogger(__name__)


class QueueFull(Exception):
    """Too many jobs are waiting."""


class NotExecutable(Exception):
    """The version may not run in this mode: not approved, or not deployed here."""

    def __init__(self, failure: Failure, reason: str) -> None:
        super().__init__(reason)
        self.failure = failure


class LacksAtomicSkill(Exception):
    """The workstation's equipment cannot do what the skill needs."""


class LearningFailed(Exception):
    """A learning job that ended without a version while its caller still waited."""

    def __init__(self, argument: str, reason: str) -> None:
        super().__init__(reason)
        self.argument = argument


class ArmNotReady(Exception):
    """The arm cannot move until somebody acknowledges what stopped it."""


class MotionNotPossible(Exception):
    """A motion refused before anything moved; ``report`` is the failed job that says where on the path."""

    def __init__(self, report: JobReport) -> None:
        super().__init__(report.message)
        self.report = report


@dataclass(frozen=True)
class LearningRequest:
    """What a learning job is to do."""

    skill_name: str
    semantic_type: str
    required_atomic_skills: tuple[str, ...]
    recordings: Sequence[Demonstration]
    edits: Edits
    options: LearningOptions
    actor: str
    comment: str = ""
    based_on: int | None = None


@dataclass(frozen=True)
class LearningOutcome:
    """A learning job as its caller sees it; ``learned`` and ``description`` are None while it goes on."""

    report: JobReport
    learned: LearnedMotion | None = None
    description: SkillDescription | None = None


@dataclass
class Station:
    """A workstation as the engine sees it: its arm, what it can do, and its two lanes of jobs."""

    name: str
    model: ArmModel
    arm: Arm
    atomic_skills: frozenset[str]
    lane: Lane
    simulation: Lane
    stopped_unasked: bool = False


Tell = Callable[[JobReport], Awaitable[None]]
TellVersion = Callable[[SkillDescription, str, str], Awaitable[None]]
ArmFactory = Callable[[str, bool], Arm]
"""Makes the arm of a workstation by name; True: a fresh simulation beside it, as fast as possible."""


def new_job_id(kind: str) -> str:
    """Return an id that sorts by time and cannot be guessed."""
    return f"{kind}-{datetime.now(UTC):%Y%m%d%H%M%S%f}-{secrets.token_hex(4)}"


class JobEngine:
    """Learning jobs and execution jobs of one server."""

    def __init__(
        self,
        library: SkillLibrary,
        settings: Settings,
        models: Mapping[str, ArmModel],
        arm_factory: ArmFactory,
        tell: Tell,
        tell_version: TellVersion,
    ) -> None:
        self._library = library
        self._settings = settings
        self._tell = tell
        self._tell_version = tell_version
        self._learners = Workers(settings.learning.workers, "learning")
        self._planners = Workers(1, "planning")
        self._learning_slots = asyncio.Semaphore(settings.learning.workers)
        self._learning: dict[str, asyncio.Task[LearningOutcome]] = {}
        self._progress: dict[str, float] = {}
        self._warm_up: asyncio.Task[None] | None = None
        self._cells = {one.name: cell_of(one) for one in settings.workstations}
        self.stations: dict[str, Station] = {}
        for station in settings.workstations:
            arm = arm_factory(station.name, False)
            skills = {"MoveTo", "FollowPath"} | {skill for item in station.equipment for skill in item.atomic_skills}
            self.stations[station.name] = Station(
                name=station.name,
                model=models[station.name],
                arm=arm,
                atomic_skills=frozenset(skills),
                lane=Lane(
                    f"{station.name} arm",
                    library,
                    lambda arm=arm: arm,
                    self.tell,
                    keeps_arm_open=True,
                    keep_trace=self._keep_trace,
                    come_home=lambda name=station.name: self._come_home(name),
                ),
                simulation=Lane(
                    f"{station.name} simulation",
                    library,
                    lambda name=station.name: arm_factory(name, True),
                    self.tell,
                    keeps_arm_open=False,
                    keep_trace=self._keep_trace,
                ),
            )

    async def tell(self, report: JobReport) -> None:
        """Pass a change on; a listener's fault must not stop a job."""
        station = self.stations.get(report.workstation)
        ended_badly = report.state is JobState.FAILED or report.failure is Failure.PROTECTIVE_STOP
        if station is not None and ended_badly and report.mode != "simulation" and report.start_time is not None:
            station.stopped_unasked = True
        try:
            await self._tell(report)
        except Exception:
            _log.exception("telling of job %s failed", report.job_id)

    async def start(self) -> None:
        """Fail the jobs a crash left behind, open the arms, start the lanes."""
        for report in await self._library.interrupt_unfinished():
            _log.warning("job %s was interrupted by the last stop", report.job_id)
        for station in self.stations.values():
            await station.arm.open()
            station.lane.start()
            station.simulation.start()
        self._warm_up = asyncio.create_task(self._warm(), name="warm up workers")

    async def _warm(self) -> None:
        await self._planners.warm_up(ready)
        await self._learners.warm_up(ready)

    async def stop(self) -> None:
        """Stop every motion, end every worker; jobs that did not finish are Failed, Interrupted."""
        if self._warm_up:
            self._warm_up.cancel()
        for station in self.stations.values():
            await station.lane.stop()
            await station.simulation.stop()
        for task in list(self._learning.values()):
            task.cancel()
        await asyncio.gather(*self._learning.values(), return_exceptions=True)
        self._learners.close()
        self._planners.close()
        for station in self.stations.values():
            await station.arm.close()
        await self._library.interrupt_unfinished()

    # Learning

    async def learn(self, request: LearningRequest, *, answer_within: float) -> LearningOutcome:
        """Start a learning job; return its outcome, or the running job when that takes longer than ``answer_within`` s.

        Raises QueueFull, and LearningFailed when the job ends without a version in that time.
        """
        if len(self._learning) >= self._settings.limits.max_queued_jobs:
            raise QueueFull(f"{len(self._learning)} learning jobs are waiting: try again when one has ended")
        job_id = new_job_id("learn")
        report = JobReport(job_id=job_id, kind="Learning", skill_name=request.skill_name, actor=request.actor)
        await self._library.add_job(report)
        task = asyncio.create_task(self._learn(job_id, request), name=f"job {job_id}")
        self._learning[job_id] = task
        task.add_done_callback(lambda _: (self._learning.pop(job_id, None), self._progress.pop(job_id, None)))
        task.add_done_callback(_log_unexpected)
        await asyncio.wait({task}, timeout=answer_within)
        if task.done():
            return task.result()
        return LearningOutcome(await self._library.job(job_id))

    async def _learn(self, job_id: str, request: LearningRequest) -> LearningOutcome:
        failure, argument, reason = Failure.INTERNAL, "", "the job ended without a result"
        try:
            async with self._learning_slots:
                await self.tell(await self._library.move_job(job_id, JobState.RUNNING, start_time=datetime.now(UTC)))
                learned = await self._learners.run(
                    f"learning {request.skill_name}",
                    learn_skill,
                    list(request.recordings),
                    request.edits,
                    request.options,
                    seconds=self._settings.learning.timeout,
                    on_progress=lambda fraction: self._progress.__setitem__(job_id, fraction),
                )
            if not isinstance(learned, LearningRefused):
                description = await self._library.add_version(
                    name=request.skill_name,
                    semantic_type=request.semantic_type,
                    required_atomic_skills=request.required_atomic_skills,
                    recordings=request.recordings,
                    edits=request.edits,
                    options=request.options,
                    learned=learned,
                    actor=request.actor,
                    job_id=job_id,
                    based_on=request.based_on,
                    parameters=MOTION_PARAMETER_RANGES,
                    default_recipe=self.default_recipe(request.skill_name),
                )
                report = await self._library.job(job_id)
                await self.tell(report)
                await self._tell_version(description, request.actor, request.comment)
                return LearningOutcome(report, learned, description)
            failure, argument, reason = Failure.PARAMETER_INVALID, learned.argument, learned.reason
        except WorkerTimeout as late:
            failure, reason = Failure.TIMEOUT, str(late)
        except WorkerDied as died:
            failure, reason = Failure.INTERNAL, str(died)
        except asyncio.CancelledError:
            await self._end(job_id, JobState.FAILED, Failure.INTERRUPTED, "the server stopped")
            raise
        except Exception as fault:
            await self._end(job_id, JobState.FAILED, Failure.INTERNAL, f"{type(fault).__name__}: {fault}")
            raise
        await self._end(job_id, JobState.FAILED, failure, reason)
        if failure is Failure.PARAMETER_INVALID:
            raise LearningFailed(argument, reason)
        raise RuntimeError(reason)

    def default_recipe(self, skill_name: str) -> Recipe:
        """Return the recipe a new skill starts with: the part where the first workstation's cell has its plate."""
        station = next(iter(self.stations.values()))
        return Recipe(recipe_id=f"{skill_name}-default", skill_name=skill_name, frame=station.model.part_frame)

    async def _end(self, job_id: str, state: JobState, failure: Failure, message: str) -> JobReport:
        report = await self._library.move_job(
            job_id, state, failure=failure, message=message[:4000], end_time=datetime.now(UTC)
        )
        await self.tell(report)
        return report

    def learning_progress(self, job_id: str) -> float | None:
        """Return how far a learning job under way is, 0..1, or None if it is not."""
        return self._progress.get(job_id)

    # Execution

    async def execute(self, station_name: str, skill_name: str, recipe: Recipe, mode: Mode, actor: str) -> JobReport:
        """Check a run completely, then queue it. Nothing has moved when this returns.

        Raises QueueFull, NotExecutable, LacksAtomicSkill, MotionNotPossible, and the library's NotFound.
        """
        station = self.stations[station_name]
        lane = station.simulation if mode == "simulation" else station.lane
        description = await self._version_for(station, skill_name, recipe, mode)
        missing = set(description.required_atomic_skills) - station.atomic_skills
        if missing:
            raise LacksAtomicSkill(f"{station_name} lacks the atomic skill {', '.join(sorted(missing))}")
        if lane is station.lane:
            _check_ready(station)
        self._room_on(lane)
        planned = await self.plan(station, description, recipe, TEST_SPEED if mode == "test" else 1.0)
        report = JobReport(
            job_id=new_job_id("run"),
            kind="Execution",
            skill_name=skill_name,
            skill_version=description.version,
            recipe_id=recipe.recipe_id,
            mode=mode,
            workstation=station_name,
            actor=actor,
        )
        if isinstance(planned, PlanRefused):
            raise MotionNotPossible(await self._refused(report, planned.findings))
        self._room_on(lane)
        notes = "; ".join(finding.text for finding in planned.findings[:5])[:4000]
        told = {"path_error": planned.path_error, "samples": planned.samples, "message": notes}
        report = report.model_copy(update=told)
        lane.reserve()
        try:
            await self._library.add_job(report)
        except BaseException:
            lane.release()
            raise
        await self.tell(report)
        lane.put(Order(report.job_id, planned, notes))
        return report

    def _room_on(self, lane: Lane) -> None:
        if lane.waiting >= self._settings.limits.max_queued_jobs:
            raise QueueFull(f"{lane.waiting} jobs are waiting: try again when one has ended")

    async def _refused(self, report: JobReport, findings: Sequence[Finding]) -> JobReport:
        """Write down a refused run: a failed job that never moved, so that its reason and place can be read."""
        first = findings[0]
        await self._library.add_job(report)
        return await self._end(
            report.job_id,
            JobState.FAILED,
            Failure(first.code),
            "; ".join(finding.text for finding in findings[:5]),
        )

    async def _version_for(self, station: Station, skill_name: str, recipe: Recipe, mode: Mode) -> SkillDescription:
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

    async def plan(
        self, station: Station, description: SkillDescription, recipe: Recipe, speed_fraction: float = 1.0
    ) -> MotionPlan | PlanRefused:
        """Plan a run in a worker process."""
        order = MotionOrder(
            time_step=recipe.time_step,
            timing=recipe.timing,
            duration=recipe.duration,
            speed=recipe.speed,
            speed_override=recipe.speed_override,
            frame=recipe.frame,
            standoff=recipe.standoff,
            approach_height=recipe.approach_height,
            retract_height=recipe.retract_height,
            dispense_lead=recipe.dispense_lead,
            max_deviation=recipe.max_deviation,
            speed_fraction=speed_fraction,
            **motion_parameters(recipe),
        )
        return await self._planners.run(
            f"planning {description.name}",
            plan_skill,
            description.motion(),
            order,
            station.model.name,
            description.model_digest,
            recipe.recipe_id,
            self._cells[station.name],
            seconds=PLANNING_SECONDS,
        )

    async def _come_home(self, name: str) -> None:
        """Bring an arm that was aborted on its way slowly to where every run starts, as the first part of its next job.

        After a protective stop or a fault it stays where it is: then a person has to look first, and send it home.
        Raises StartRefused when the way is not free; what stops the arm stops this motion too.
        """
        station = self.stations[name]
        away = np.abs(np.array(station.arm.state().joints) - np.array(station.model.home)).max()
        if away <= START_TOLERANCE:
            station.stopped_unasked = False
        if away <= START_TOLERANCE or station.stopped_unasked or not ready_to_move(station.arm.state()):
            return
        planned = await self.plan_home(station)
        if isinstance(planned, PlanRefused):
            first = planned.findings[0]
            raise StartRefused(first.code, f"the way to the start is not free: {first.text}")
        _log.info("the arm of %s goes to the start first", name)
        await station.arm.run(planned, lambda _: None)

    async def plan_home(self, station: Station) -> MotionPlan | PlanRefused:
        """Plan the way from where an arm stands to where every run starts, in a worker process."""
        joints = tuple(station.arm.state().joints)
        what = f"planning the way home on {station.name}"
        return await self._planners.run(
            what, plan_way_home, station.model.name, joints, self._cells[station.name], seconds=PLANNING_SECONDS
        )

    async def trajectory(self, description: SkillDescription, time_step: float) -> Trajectory:
        """Return the path with the people's own timing, at ``time_step`` s (0: the learned one)."""
        what = f"reproducing {description.name}"
        return await self._planners.run(
            what, trajectory_as_learned, description.motion(), time_step, seconds=PLANNING_SECONDS
        )

    async def recipe_trajectory(self, description: SkillDescription, recipe: Recipe) -> Trajectory | PlanRefused:
        """Return the path in the part's frame with a recipe's timing, as the first workstation's arm would run it."""
        station = next(iter(self.stations.values()))
        planned = await self.plan(station, description, recipe)
        if isinstance(planned, PlanRefused):
            return planned
        motion = description.motion()
        what = f"reproducing {description.name}"
        return await self._planners.run(what, trajectory_of_plan, motion, planned, seconds=PLANNING_SECONDS)

    async def _keep_trace(self, job_id: str, trace: Trace) -> None:
        """Write the whole trace of a run into files: joints, valve and override too."""
        formats = self._settings.trace_files
        if formats:
            folder = self._settings.data / "traces"
            what = f"writing the trace of {job_id}"
            await self._planners.run(what, write_trace, trace, folder, job_id, formats, seconds=PLANNING_SECONDS)

    def lane_of(self, job_id: str) -> Lane | None:
        """Return the lane on which a job waits or runs, or None when it does neither."""
        for station in self.stations.values():
            for lane in (station.lane, station.simulation):
                if lane.holds(job_id):
                    return lane
        return None


MOTION_PARAMETER_RANGES = (
    Parameter(name="BlendRadius", description="rounds corners", unit="m", default=0.0, minimum=0.0, maximum=0.1),
    Parameter(name="Corners", description="where constant speed is impossible: refuse or slow", default="slow"),
    Parameter(
        name="ChordTolerance",
        description="the most by which straight lines between time steps may cut the path",
        unit="m",
        default=5e-5,
        minimum=1e-6,
        maximum=1e-2,
    ),
    Parameter(
        name="TubeSigmas",
        description="watch the skill's own spread: so many standard deviations; 0: not watched",
        default=0.0,
        minimum=0.0,
        maximum=100.0,
    ),
    Parameter(name="TubePolicy", description="outside the tube: flag or stop", default="flag"),
)


def motion_parameters(recipe: Recipe) -> dict[str, Any]:
    """Return what a recipe's process parameters say about the motion, as fields of a MotionOrder.

    Raises InvalidValue for a word that is none, or a text where a number has to be; ranges are the plan's to check.
    """
    found: dict[str, Any] = {}
    for name, (field, words) in MOTION_PARAMETERS.items():
        value = recipe.parameters.get(name)
        if value is None:
            continue
        if words and value not in words:
            raise InvalidValue(f"parameters.{name}", value, f"it has to be {' or '.join(words)}")
        if not words and isinstance(value, str):
            raise InvalidValue(f"parameters.{name}", value, "it has to be a number")
        found[field] = value
    return found


def cell_of(workstation: Workstation) -> Cell:
    """Return what surrounds a workstation's arm, as configured."""
    boxes = tuple(Box(one.name, one.pose, one.size) for one in workstation.fixtures)
    return Cell(boxes, workstation.table_height)


def ready_to_move(state: ArmState) -> bool:
    """Return whether an arm may be given something to do, rather than wait for a reset."""
    return state.known and not state.protective_stop and state.mode is not ArmMode.FAULT


def _check_ready(station: Station) -> None:
    """Raise ArmNotReady while the arm waits for a reset: a new command must not be what sets it going again."""
    state = station.arm.state()
    if not ready_to_move(state):
        what = state.fault or state.mode.value
        raise ArmNotReady(f"the arm of {station.name} waits for a reset: {what}")


def _log_unexpected(task: asyncio.Task[LearningOutcome]) -> None:
    if task.cancelled():
        return
    error = task.exception()
    if error is not None and not isinstance(error, LearningFailed):
        _log.error("%s failed", task.get_name(), exc_info=error)

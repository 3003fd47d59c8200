"""The job engine: its parts put together, started in order and stopped in order."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping

from library.description import JobReport, Recipe, SkillDescription
from library.errors import LibraryUnusable
from library.store import SkillLibrary
from models.motion import Trajectory
from opcua_skill.configuration.settings import Settings, Workstation
from opcua_skill.jobs.checking import RunCheck, RunChecks
from opcua_skill.jobs.execution import ExecutionJobs, Mode
from opcua_skill.jobs.learning import LearningJobs, LearningOutcome, LearningRequest, Tell, TellVersion
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.jobs.motion.release import ArmQueue, QueueStatus
from opcua_skill.jobs.planning import Planning
from opcua_skill.jobs.station import ArmFactory, Station, atomic_skills_of, cell_of
from opcua_skill.jobs.worker_tasks import DocumentRefused, PlanRefused
from sim.arm_model import ArmModel
from sim.plan import MotionPlan

_log = logging.getLogger(__name__)


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
        tell_queue: Callable[[str, QueueStatus], Awaitable[None]] | None = None,
        planning: Planning | None = None,
    ) -> None:
        self._library = library
        self._tell = tell
        self._tell_queue = tell_queue or _told_nobody
        self._arm_factory = arm_factory
        self._planning = planning or Planning(settings)
        self._learning = LearningJobs(library, settings, self.tell, tell_version, self.default_recipe)
        self._execution = ExecutionJobs(library, settings, self._planning, self.tell)
        self._checks = RunChecks(self._execution, self._planning)
        self._warm_up: asyncio.Task[None] | None = None
        self.stations = {one.name: self._station(one, models[one.name]) for one in settings.workstations}

    def _station(self, settings: Workstation, model: ArmModel) -> Station:
        name, arm = settings.name, self._arm_factory(settings.name, False)
        queue = ArmQueue(name, self._library, self._tell_queue)
        lane = MotionQueue(
            f"{name} arm",
            self._library,
            lambda: arm,
            self.tell,
            keep_trace=self._planning.keep_trace,
            queue=queue,
            trouble=lambda: self.stations[name].trouble(),
            keep_override=lambda: self.stations[name].keep_override(),
            may_still_run=lambda report: self._execution.may_still_run(self.stations[name], report),
        )
        simulation = MotionQueue(
            f"{name} simulation",
            self._library,
            lambda: self._arm_factory(name, True),
            self.tell,
            keep_trace=self._planning.keep_trace,
        )
        skills = atomic_skills_of(settings, model)
        return Station(name, self._library, model, cell_of(settings), arm, skills, queue, lane, simulation)

    async def tell(self, report: JobReport) -> None:
        """Pass a change on; a listener's fault must not stop a job."""
        try:
            await self._tell(report)
        except Exception:
            _log.exception("telling of job %s failed", report.job_id)

    async def start(self) -> None:
        """Fail the jobs a crash left behind, open the arms, start the lanes; what was left unfinished holds queues."""
        for report in await self._library.interrupt_unfinished():
            _log.warning("job %s was interrupted by the last stop", report.job_id)
        await asyncio.gather(*(station.open() for station in self.stations.values()))
        for station in self.stations.values():
            station.queue.start()
            station.lane.start()
            station.simulation.start()
        self._warm_up = asyncio.create_task(self._warm(), name="warm up workers")

    async def _warm(self) -> None:
        await asyncio.to_thread(self._planning.sweep)
        await self._planning.warm_up()
        await self._learning.warm_up()

    async def stop(self) -> None:
        """Stop every motion, end every worker; jobs that did not finish are Failed, Interrupted."""
        if self._warm_up:
            self._warm_up.cancel()
        lanes = [lane for station in self.stations.values() for lane in (station.lane, station.simulation)]
        await asyncio.gather(*(lane.stop() for lane in lanes))
        await self._learning.stop()
        self._planning.close()
        await asyncio.gather(*(station.arm.close() for station in self.stations.values()))
        await asyncio.gather(*(station.queue.stop() for station in self.stations.values()))
        try:
            await self._library.interrupt_unfinished()
        except LibraryUnusable as unusable:
            _log.warning("jobs that did not end are marked at the next start: %s", unusable)

    async def learn(self, request: LearningRequest, *, answer_within: float) -> LearningOutcome:
        """Start a learning job; see ``LearningJobs.learn``."""
        return await self._learning.learn(request, answer_within=answer_within)

    def learning_progress(self, job_id: str) -> float | None:
        """Return how far a learning job under way is, 0..1, or None if it is not."""
        return self._learning.progress_of(job_id)

    def default_recipe(self, skill_name: str) -> Recipe:
        """Return the recipe a new skill starts with: the part where the first workstation's cell has its plate."""
        station = next(iter(self.stations.values()))
        return Recipe(recipe_id=f"{skill_name}-default", skill_name=skill_name, frame=station.model.part_frame)

    async def execute(
        self, station_name: str, skill_name: str, recipe: Recipe, mode: Mode, actor: str, job_id: str = ""
    ) -> JobReport:
        """Check a run completely, then queue it; see ``ExecutionJobs.execute``."""
        return await self._execution.execute(self.stations[station_name], skill_name, recipe, mode, actor, job_id)

    async def check(self, station_name: str, recipe: Recipe, version: int) -> RunCheck:
        """Plan a run without queueing it; see ``RunChecks.check``."""
        return await self._checks.check(self.stations[station_name], recipe, version)

    async def plan_home(self, station: Station) -> MotionPlan | PlanRefused:
        """Plan the way from where an arm stands to where every run starts."""
        return await self._planning.plan_home(station)

    async def trajectory(self, description: SkillDescription, time_step: float) -> Trajectory:
        """Return the path with the people's own timing, at ``time_step`` s (0: the learned one)."""
        return await self._planning.trajectory(description, time_step)

    async def read_document(self, content: str, longest: float) -> SkillDescription | DocumentRefused:
        """Return the version in a document, or why it cannot be run; its path may take ``longest`` s."""
        return await self._planning.read_document(content, longest)

    async def recipe_trajectory(self, description: SkillDescription, recipe: Recipe) -> Trajectory | PlanRefused:
        """Return the path in the part's frame with a recipe's timing, as the first workstation's arm would run it."""
        return await self._planning.recipe_trajectory(next(iter(self.stations.values())), description, recipe)


async def _told_nobody(_workstation: str, _status: QueueStatus) -> None:
    """Be told for nobody."""

"""Learning jobs: a worker process learns, the library stores the version and the job's end in one transaction."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TypeVar

from library.description import Failure, JobReport, JobState, Recipe, SkillDescription
from library.errors import AWAY, LibraryUnusable, NotAllowedInState, NotFound
from library.store import SkillLibrary
from library.turns import BUSY_SECONDS, waiting_at_most
from models.demonstration import Demonstration, Edits
from models.options import LearningOptions
from models.report import LearnedMotion, Previous, mean_repeatability
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs.errors import LearningFailed, QueueFull
from opcua_skill.jobs.ids import new_job_id
from opcua_skill.jobs.motion_parameters import MOTION_PARAMETER_RANGES
from opcua_skill.jobs.process_pool import WorkerDied, Workers, WorkerTimeout
from opcua_skill.jobs.worker_tasks import LearningRefused, learn_skill, ready

_log = logging.getLogger(__name__)

ASK_AGAIN = 0.5
"""s after which a library whose database server is away is asked again."""
Answer = TypeVar("Answer")
Tell = Callable[[JobReport], Awaitable[None]]
TellVersion = Callable[[SkillDescription, str, str], Awaitable[None]]


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
    brought_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class LearningOutcome:
    """A learning job as its caller sees it; ``learned`` and ``description`` are None while it goes on."""

    report: JobReport
    learned: LearnedMotion | None = None
    description: SkillDescription | None = None


class LearningJobs:
    """The learning jobs of one server. ``start_recipe`` makes the recipe a new skill begins with."""

    def __init__(
        self,
        library: SkillLibrary,
        settings: Settings,
        tell: Tell,
        tell_version: TellVersion,
        start_recipe: Callable[[str], Recipe],
    ) -> None:
        self._library = library
        self._settings = settings
        self._tell = tell
        self._tell_version = tell_version
        self._start_recipe = start_recipe
        self._workers = Workers(settings.learning.workers, "learning")
        self._slots = asyncio.Semaphore(settings.learning.workers)
        self._tasks: dict[str, asyncio.Task[LearningOutcome]] = {}
        self._progress: dict[str, float] = {}

    async def warm_up(self) -> None:
        """Let the workers import what the first learning needs."""
        await self._workers.warm_up(ready)

    async def stop(self) -> None:
        """End every job and every worker; jobs that did not finish are Failed, Interrupted."""
        for task in list(self._tasks.values()):
            task.cancel()
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)
        self._workers.close()

    def progress_of(self, job_id: str) -> float | None:
        """Return how far a job under way is, 0..1, or None if it is not."""
        return self._progress.get(job_id)

    async def learn(self, request: LearningRequest, *, answer_within: float) -> LearningOutcome:
        """Start a learning job; return its outcome, or the running job when that takes longer than ``answer_within`` s.

        Raises QueueFull, and LearningFailed when the job ends without a version in that time.
        """
        if len(self._tasks) >= self._settings.limits.max_queued_jobs:
            raise QueueFull(f"as many learning jobs as may wait do, {len(self._tasks)}: try again when one has ended")
        job_id = new_job_id("learn")
        report = JobReport(job_id=job_id, kind="Learning", skill_name=request.skill_name, actor=request.actor)
        await self._library.add_job(report)
        with waiting_at_most(BUSY_SECONDS):  # the job has more patience than who asked for it
            task = asyncio.create_task(self._learn(job_id, request), name=f"job {job_id}")
        self._tasks[job_id] = task
        task.add_done_callback(lambda _: (self._tasks.pop(job_id, None), self._progress.pop(job_id, None)))
        task.add_done_callback(_log_unexpected)
        await asyncio.wait({task}, timeout=answer_within)
        if not task.done():
            report = await self._library.job(job_id)
            if report.state in (JobState.QUEUED, JobState.RUNNING):
                return LearningOutcome(report)
        # it has ended, if only while its row was read: then its outcome is told, not that of a job under way
        await asyncio.wait({task})
        return task.result()

    async def _learn(self, job_id: str, request: LearningRequest) -> LearningOutcome:
        failure, argument, reason = Failure.INTERNAL, "", "the job ended without a result"
        try:
            async with self._slots:
                await self._tell(await self._library.move_job(job_id, JobState.RUNNING, start_time=datetime.now(UTC)))
                learned = await self._workers.run(
                    f"learning {request.skill_name}",
                    learn_skill,
                    list(request.recordings),
                    request.edits,
                    request.options,
                    await self._previous(request),
                    seconds=self._settings.learning.timeout,
                    on_progress=lambda fraction: self._progress.__setitem__(job_id, fraction),
                )
            if not isinstance(learned, LearningRefused):
                return await self._store(job_id, request, learned)
            failure, argument, reason = Failure.PARAMETER_INVALID, learned.argument, learned.reason
        except WorkerTimeout as late:
            failure, reason = Failure.TIMEOUT, str(late)
        except WorkerDied as died:
            failure, reason = Failure.INTERNAL, str(died)
        except asyncio.CancelledError:
            await self._end(job_id, Failure.INTERRUPTED, "the server stopped")
            raise
        except Exception as fault:
            await self._end(job_id, Failure.INTERNAL, f"{type(fault).__name__}: {fault}")
            raise
        await self._end(job_id, failure, reason)
        if failure is Failure.PARAMETER_INVALID:
            raise LearningFailed(argument, reason)
        raise RuntimeError(reason)

    async def _previous(self, request: LearningRequest) -> Previous | None:
        """Return what the new version is to be compared with: the version it is based on, else the newest."""
        try:
            before = await self._library.description(request.skill_name, request.based_on or 0)
        except NotFound:
            return None
        return Previous(before.version, before.motion(), mean_repeatability(before.report))

    async def _store(self, job_id: str, request: LearningRequest, learned: LearnedMotion) -> LearningOutcome:
        try:
            description = await _once_reachable(lambda: self._add_version(job_id, request, learned))
        except NotAllowedInState:  # its answer was lost and it was tried again, or the job has been ended meanwhile
            stored = await self._library.job(job_id)
            if stored.state is not JobState.COMPLETED:
                raise
            description = await self._library.description(request.skill_name, stored.skill_version)
        report = await _once_reachable(lambda: self._library.job(job_id))
        await self._tell(report)
        await self._tell_version(description, request.actor, request.comment)
        return LearningOutcome(report, learned, description)

    async def _add_version(self, job_id: str, request: LearningRequest, learned: LearnedMotion) -> SkillDescription:
        return await self._library.add_version(
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
            default_recipe=self._start_recipe(request.skill_name),
            brought_by=request.brought_by,
        )

    async def _end(self, job_id: str, failure: Failure, message: str) -> None:
        report = await self._library.move_job(
            job_id, JobState.FAILED, failure=failure, message=message[:4000], end_time=datetime.now(UTC)
        )
        await self._tell(report)


async def _once_reachable(ask: Callable[[], Awaitable[Answer]]) -> Answer:
    """Return the library's answer, which may wait for its database server: what was learned must not be lost to it."""
    while True:
        try:
            return await ask()
        except LibraryUnusable as unusable:
            if unusable.trouble not in AWAY:
                raise
            _log.warning("what was learned is not stored yet: %s", unusable)
            await asyncio.sleep(ASK_AGAIN)


def _log_unexpected(task: asyncio.Task[LearningOutcome]) -> None:
    if task.cancelled():
        return
    error = task.exception()
    if error is not None and not isinstance(error, LearningFailed):
        _log.error("%s failed", task.get_name(), exc_info=error)

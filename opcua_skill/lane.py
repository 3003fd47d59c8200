"""A lane: jobs that share one arm, one after another. It ends every motion at rest, whatever happens.

Stopping never waits for the database: first the arm is told, then the change of state is written down and told.
"""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from library.description import Failure, JobReport, JobState
from library.errors import NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.endings import End, Endings, in_background
from sim.arm import Arm, ArmFault, ArmMode, Progress, StartRefused, Stopped, Trace
from sim.plan import MotionPlan

TELL_EVERY = 0.5
UNDER_WAY = frozenset({JobState.RUNNING, JobState.PAUSED})

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """A job and the plan that was checked for it: what was checked is what runs.

    ``notes`` says what is worth knowing of a plan that may run, such as where it slows down.
    """

    job_id: str
    plan: MotionPlan
    notes: str = ""


class NotAnyMore(Exception):
    """A job whose turn has come may not run any more: what it was checked for has changed meanwhile."""

    def __init__(self, failure: Failure, reason: str) -> None:
        super().__init__(reason)
        self.failure = failure


@dataclass
class _Running:
    order: Order
    arm: Arm
    stop_because: str = ""
    stop_failure: Failure = Failure.ABORTED
    progress: float = 0.0
    told_at: float = 0.0

    def stop(self, because: str, failure: Failure) -> None:
        """Note who wants the job to end, and why; the first reason counts, but a protective stop is said."""
        if not self.stop_because or failure is Failure.PROTECTIVE_STOP:
            self.stop_because, self.stop_failure = because, failure

    def check_wanted(self) -> None:
        """Raise _StoppedBefore if the job was aborted while the arm stood still and there was nothing to stop."""
        if self.stop_because:
            raise _StoppedBefore


class _StoppedBefore(Exception):
    """A job was aborted after its turn had come and before the arm moved."""


class Lane:
    """Runs orders one at a time. A lane that does not keep its arm open gets a fresh one from ``arm_of`` each time."""

    def __init__(
        self,
        name: str,
        library: SkillLibrary,
        arm_of: Callable[[], Arm],
        tell: Callable[[JobReport], Awaitable[None]],
        *,
        keeps_arm_open: bool,
        keep_trace: Callable[[Order, Trace], Awaitable[None]],
        may_still_run: Callable[[JobReport], Awaitable[None]] | None = None,
        way_home: Callable[[], Awaitable[MotionPlan | None]] | None = None,
    ) -> None:
        """Make a lane. ``may_still_run`` raises NotAnyMore, ``way_home`` plans what has to be driven first, if any."""
        self._name = name
        self._library = library
        self._arm_of = arm_of
        self._tell = tell
        self._keeps_arm_open = keeps_arm_open
        self._keep_trace = keep_trace
        self._may_still_run = may_still_run
        self._way_home = way_home
        self._keeping: set[asyncio.Task[None]] = set()
        self._orders: OrderedDict[str, Order] = OrderedDict()
        self._reserved = 0
        self._arrived = asyncio.Event()
        self._running: _Running | None = None
        self._task: asyncio.Task[None] | None = None
        self._finishing: asyncio.Task[None] | None = None
        self._closing = asyncio.Event()
        self._moves = asyncio.Lock()
        self._ends = Endings(library, tell, self._moves, self._closing)

    @property
    def waiting(self) -> int:
        """How many jobs wait, with those that are about to."""
        return len(self._orders) + self._reserved

    def holds(self, job_id: str) -> bool:
        """Whether the job waits or runs here."""
        return job_id in self._orders or (self._running is not None and self._running.order.job_id == job_id)

    def progress_of(self, job_id: str) -> float | None:
        """Return how far the running job is, or None if it does not run here."""
        running = self._running
        return running.progress if running and running.order.job_id == job_id else None

    def reserve(self) -> None:
        """Keep a place for an order that is being written down."""
        self._reserved += 1

    def release(self) -> None:
        """Give a reserved place back."""
        self._reserved -= 1

    def put(self, order: Order) -> None:
        """Queue an order whose place was reserved and whose job is stored."""
        self._reserved -= 1
        self._orders[order.job_id] = order
        self._arrived.set()

    def start(self) -> None:
        """Begin to serve."""
        self._task = asyncio.create_task(self._serve(), name=f"lane {self._name}")

    async def stop(self) -> None:
        """Stop the motion, leave the rest of the queue to be marked as interrupted."""
        if self._task is None:
            return
        self._closing.set()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        if self._finishing is not None:
            await asyncio.gather(self._finishing, return_exceptions=True)
        await asyncio.gather(*self._keeping, return_exceptions=True)
        self._task = None

    async def _serve(self) -> None:
        while not self._closing.is_set():
            while not self._orders:
                self._arrived.clear()
                await self._arrived.wait()
            _, order = self._orders.popitem(last=False)
            try:
                await self._run(order)
            except Exception:
                _log.exception("job %s on lane %s failed", order.job_id, self._name)

    async def _run(self, order: Order) -> None:
        arm = self._arm_of()
        running = self._running = _Running(order, arm)
        end = End(JobState.FAILED, Failure.INTERNAL, "the run ended without a result")
        try:
            async with self._moves:
                report = await self._library.job(order.job_id)
                if report.state is not JobState.QUEUED:
                    return
                if self._may_still_run is not None:
                    await self._may_still_run(report)
                await self._move(order.job_id, JobState.RUNNING, start_time=datetime.now(UTC))
            end = End(JobState.COMPLETED, Failure.NONE, order.notes, await self._driven(running))
        except _StoppedBefore:
            end = End(JobState.ABORTED, running.stop_failure, running.stop_because)
        except Stopped as stopped:
            because = running.stop_because or stopped.because
            end = End(JobState.ABORTED, running.stop_failure, because, stopped.trace)
        except NotAnyMore as refused:
            end = End(JobState.FAILED, refused.failure, str(refused))
        except StartRefused as refused:
            end = End(JobState.FAILED, Failure(refused.failure), refused.text)
        except ArmFault as fault:
            end = End(JobState.FAILED, Failure(fault.failure), fault.text, fault.trace)
            if running.stop_because and end.failure is Failure.PROTECTIVE_STOP:
                end = End(JobState.ABORTED, running.stop_failure, running.stop_because, fault.trace)
        except asyncio.CancelledError:
            end = End(JobState.FAILED, Failure.INTERRUPTED, "the server stopped")
            raise
        except Exception as fault:
            end = End(JobState.FAILED, Failure.INTERNAL, f"{type(fault).__name__}: {fault}")
            raise
        finally:
            self._finishing = asyncio.create_task(self._finish(running, end), name=f"end of {order.job_id}")
            await asyncio.shield(self._finishing)

    async def _driven(self, running: _Running) -> Trace:
        """Run the job's plan, after the way to where it begins if the arm does not stand there."""
        if not self._keeps_arm_open:
            await running.arm.open()
        way = await self._way_home() if self._way_home is not None else None
        if way is not None:
            running.check_wanted()
            await running.arm.run(way, lambda _: None)
        running.check_wanted()
        return await running.arm.run(running.order.plan, self._on_progress)

    async def _finish(self, running: _Running, end: End) -> None:
        """Bring the arm to rest, write the job's end and its trace down, then tell."""
        try:
            if end.failure in {Failure.INTERRUPTED, Failure.INTERNAL}:
                await running.arm.stop(end.message)
            if not self._keeps_arm_open:
                await running.arm.close()
        finally:
            try:
                await self._ends.write(running.order.job_id, end, lambda: running.progress)
            finally:
                self._running = None
        if end.trace is not None:
            task = in_background(self._keep_trace(running.order, end.trace))
            self._keeping.add(task)
            task.add_done_callback(self._keeping.discard)

    async def _move(self, job_id: str, to: JobState, **fields: object) -> JobReport:
        report = await self._library.move_job(job_id, to, **fields)
        await self._tell(report)
        return report

    def _on_progress(self, progress: Progress) -> None:
        running = self._running
        if running is None:
            return
        running.progress = min(1.0, max(0.0, progress.fraction))
        now = asyncio.get_running_loop().time()
        if now - running.told_at >= TELL_EVERY:
            running.told_at = now
            in_background(self._tell_progress(running.order.job_id, running.progress))

    async def _tell_progress(self, job_id: str, fraction: float) -> None:
        await self._library.set_progress(job_id, fraction)
        async with self._moves:
            if not self.progress_of(job_id):
                return
            report = await self._library.job(job_id)
            if report.state in {JobState.RUNNING, JobState.PAUSED}:
                await self._tell(report)

    async def pause(self, job_id: str, because: str) -> JobReport:
        """Stop on the path; the job can be resumed."""
        async with self._moves:
            running = self._at_work(job_id, await self._library.job(job_id), "running", frozenset({JobState.RUNNING}))
            await running.arm.pause(because)
            if running.arm.state().mode is not ArmMode.PAUSED:
                raise NotAllowedInState(f"job {job_id}", "at its end", "it has to be running")
            return await self._move(job_id, JobState.PAUSED, progress=running.progress)

    async def resume(self, job_id: str) -> JobReport:
        """Go on where the arm paused."""
        async with self._moves:
            running = self._at_work(job_id, await self._library.job(job_id), "paused", frozenset({JobState.PAUSED}))
            report = await self._move(job_id, JobState.RUNNING)
            await running.arm.resume()
            return report

    async def abort(self, job_id: str, because: str, failure: Failure = Failure.ABORTED) -> JobReport:
        """Take a job out of the queue, or stop its motion: then it is Stopping until the arm is at rest."""
        running = self._running
        if running is not None and running.order.job_id == job_id:
            running.stop(because, failure)
            in_background(running.arm.stop(because))
        async with self._moves:
            report = await self._library.job(job_id)
            if report.state is JobState.QUEUED:
                self._orders.pop(job_id, None)
                return await self._move(
                    job_id, JobState.ABORTED, failure=failure, message=because[:4000], end_time=datetime.now(UTC)
                )
            self._at_work(job_id, report, "running or paused", UNDER_WAY)
            return await self._move(job_id, JobState.STOPPING)

    def _at_work(self, job_id: str, report: JobReport, wanted: str, states: frozenset[JobState]) -> _Running:
        running = self._running
        if running is None or running.order.job_id != job_id or report.state not in states:
            raise NotAllowedInState(f"job {job_id}", report.state.value, f"it has to be {wanted}")
        return running

    async def protective_stop(self, because: str) -> JobReport | None:
        """Stop the arm at once and refuse every motion until a reset; return the job that was stopped, or None."""
        running, arm = self._running, self._arm_of()
        if running is not None:
            running.stop(because, Failure.PROTECTIVE_STOP)
        stopping = asyncio.create_task(arm.protective_stop(because), name=f"protective stop on {self._name}")
        try:
            if running is None:
                return None
            async with self._moves:
                job_id = running.order.job_id
                self._at_work(job_id, await self._library.job(job_id), "under way", UNDER_WAY)
                return await self._move(job_id, JobState.STOPPING)
        except NotAllowedInState:
            return None
        finally:
            await asyncio.shield(stopping)

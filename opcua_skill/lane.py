"""A lane: jobs that share one arm, one after another. It ends every motion at rest, whatever happens."""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from library.description import Failure, JobReport, JobState
from library.errors import NotAllowedInState
from library.records import JobTrace
from library.store import SkillLibrary
from sim.arm import Arm, ArmFault, ArmMode, Progress, StartRefused, Stopped, Trace
from sim.plan import MotionPlan

TELL_EVERY = 0.5
TRACE_COLUMNS = ("x (m)", "y (m)", "z (m)")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Order:
    """A job and the plan that was checked for it: what was checked is what runs.

    ``notes`` says what is worth knowing of a plan that may run, such as where it slows down.
    """

    job_id: str
    plan: MotionPlan
    notes: str = ""


@dataclass
class _Running:
    order: Order
    arm: Arm
    stop_because: str = ""
    stop_failure: Failure = Failure.ABORTED
    progress: float = 0.0
    told_at: float = 0.0


class Lane:
    """Runs orders one at a time. ``arm_of`` gives the arm; a lane that does not keep it open gets a fresh one a job."""

    def __init__(
        self,
        name: str,
        library: SkillLibrary,
        arm_of: Callable[[], Arm],
        tell: Callable[[JobReport], Awaitable[None]],
        *,
        keeps_arm_open: bool,
        keep_trace: Callable[[str, Trace], Awaitable[None]],
        come_home: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        self._name = name
        self._library = library
        self._arm_of = arm_of
        self._tell = tell
        self._keeps_arm_open = keeps_arm_open
        self._keep_trace = keep_trace
        self._come_home = come_home
        self._keeping: set[asyncio.Task[None]] = set()
        self._orders: OrderedDict[str, Order] = OrderedDict()
        self._reserved = 0
        self._arrived = asyncio.Event()
        self._running: _Running | None = None
        self._task: asyncio.Task[None] | None = None
        self._moves = asyncio.Lock()

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
        self._task.cancel()
        await asyncio.gather(self._task, *self._keeping, return_exceptions=True)
        self._task = None

    async def _serve(self) -> None:
        while True:
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
        state, failure, message, trace = JobState.FAILED, Failure.INTERNAL, "the run ended without a result", None
        try:
            async with self._moves:
                if (await self._library.job(order.job_id)).state is not JobState.QUEUED:
                    return
                await self._move(order.job_id, JobState.RUNNING, start_time=datetime.now(UTC))
            if not self._keeps_arm_open:
                await arm.open()
            if self._come_home is not None:
                await self._come_home()
            trace = await arm.run(order.plan, self._on_progress)
            state, failure, message = JobState.COMPLETED, Failure.NONE, order.notes
        except Stopped as stopped:
            trace = stopped.trace
            state, failure = JobState.ABORTED, running.stop_failure
            message = running.stop_because or stopped.because
        except StartRefused as refused:
            failure, message = Failure(refused.failure), refused.text
        except ArmFault as fault:
            trace = fault.trace
            failure, message = Failure(fault.failure), fault.text
        except asyncio.CancelledError:
            failure, message = Failure.INTERRUPTED, "the server stopped"
            raise
        except Exception as fault:
            message = f"{type(fault).__name__}: {fault}"
            raise
        finally:
            await asyncio.shield(self._finish(running, state, failure, message, trace))

    async def _finish(
        self, running: _Running, state: JobState, failure: Failure, message: str, trace: Trace | None
    ) -> None:
        """Bring the arm to rest, write the job's end and its trace down, then tell."""
        try:
            if failure is Failure.INTERRUPTED:
                await running.arm.stop("the server stopped")
            if not self._keeps_arm_open:
                await running.arm.close()
        finally:
            job_id = running.order.job_id
            async with self._moves:
                self._running = None
                report = await self._library.job(job_id)
                if report.state not in {JobState.QUEUED, JobState.ABORTED}:
                    fields = {} if trace is None else {"tracking_error": trace.tracking_error()}
                    if trace is not None:
                        stored = JobTrace(trace.times, trace.tool_commanded, trace.tool_measured, TRACE_COLUMNS)
                        await self._library.save_trace(job_id, stored)
                        task = _background(self._keep_trace(job_id, trace))
                        self._keeping.add(task)
                        task.add_done_callback(self._keeping.discard)
                    if state is JobState.ABORTED and report.state in {JobState.RUNNING, JobState.PAUSED}:
                        await self._move(job_id, JobState.STOPPING)
                    await self._move(
                        job_id,
                        state,
                        failure=failure,
                        message=message[:4000],
                        end_time=datetime.now(UTC),
                        progress=1.0 if state is JobState.COMPLETED else running.progress,
                        **fields,
                    )

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
            _background(self._tell_progress(running.order.job_id, running.progress))

    async def _tell_progress(self, job_id: str, fraction: float) -> None:
        async with self._moves:
            if not self.progress_of(job_id):
                return
            await self._library.set_progress(job_id, fraction)
            report = await self._library.job(job_id)
            if report.state in {JobState.RUNNING, JobState.PAUSED}:
                await self._tell(report)

    async def pause(self, job_id: str, because: str) -> JobReport:
        """Stop on the path; the job can be resumed."""
        async with self._moves:
            running = self._at_work(job_id, await self._library.job(job_id), "running", {JobState.RUNNING})
            await running.arm.pause(because)
            if running.arm.state().mode is not ArmMode.PAUSED:
                raise NotAllowedInState(f"job {job_id}", "at its end", "it has to be running")
            return await self._move(job_id, JobState.PAUSED, progress=running.progress)

    async def resume(self, job_id: str) -> JobReport:
        """Go on where the arm paused."""
        async with self._moves:
            running = self._at_work(job_id, await self._library.job(job_id), "paused", {JobState.PAUSED})
            report = await self._move(job_id, JobState.RUNNING)
            await running.arm.resume()
            return report

    async def abort(self, job_id: str, because: str, failure: Failure = Failure.ABORTED) -> JobReport:
        """Take a job out of the queue, or stop its motion: then it is Stopping until the arm is at rest."""
        async with self._moves:
            report = await self._library.job(job_id)
            if job_id in self._orders and report.state is JobState.QUEUED:
                del self._orders[job_id]
                return await self._move(
                    job_id, JobState.ABORTED, failure=failure, message=because[:4000], end_time=datetime.now(UTC)
                )
            running = self._at_work(job_id, report, "running or paused", {JobState.RUNNING, JobState.PAUSED})
            running.stop_because, running.stop_failure = because, failure
            report = await self._move(job_id, JobState.STOPPING)
            _background(running.arm.stop(because))
            return report

    def _at_work(self, job_id: str, report: JobReport, wanted: str, states: set[JobState]) -> _Running:
        running = self._running
        if running is None or running.order.job_id != job_id or report.state not in states:
            raise NotAllowedInState(f"job {job_id}", report.state.value, f"it has to be {wanted}")
        return running

    async def protective_stop(self, because: str) -> JobReport | None:
        """Stop whatever runs here at once, and say so in its job; return that job, or None if nothing ran."""
        running = self._running
        if running is None:
            return None
        try:
            return await self.abort(running.order.job_id, because, Failure.PROTECTIVE_STOP)
        except NotAllowedInState:
            return None


_tasks: set[asyncio.Task[None]] = set()


def _background(work: Awaitable[None]) -> asyncio.Task[None]:
    """Let something run beside its caller; what goes wrong in it is logged."""

    async def guarded() -> None:
        try:
            await work
        except Exception:
            _log.exception("background work failed")

    task = asyncio.create_task(guarded())
    _tasks.add(task)
    task.add_done_callback(_tasks.discard)
    return task

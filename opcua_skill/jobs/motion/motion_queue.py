"""A lane: jobs that share one arm, one after another. It ends every motion at rest, whatever happens.

The lane of an arm has a queue: while that is held, or the arm does not stand ready at home, no job begins. A lane
without one runs simulations beside the arm, where nothing can move that nobody asked for.
"""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime

from library.description import Cause, Failure, JobReport, JobState
from library.errors import LibraryError, NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.jobs.motion.completion import End, Endings, how_it_ended, in_background, is_lost
from opcua_skill.jobs.motion.homing import WayHome
from opcua_skill.jobs.motion.release import PATIENCE, ArmQueue
from opcua_skill.jobs.motion.run import NoLongerExecutable, QueuedMotion, Run, StoppedBefore, place_at
from opcua_skill.jobs.motion.steering import ARM_SIDE, SERVER_SIDE, Steering
from sim.arm import Arm, ArmError, Progress, Stopped, Trace
from sim.plan import MotionPlan

TELL_EVERY = 0.5
LOOK_EVERY, LOOK_EVERY_AT_REST = 0.02, 0.1

_log = logging.getLogger(__name__)


class _HeldBefore(Exception):
    """The queue was held after a job's turn had come and before the arm moved."""


class MotionQueue:
    """Runs orders one at a time. A lane without a ``queue`` gets a fresh arm from ``arm_of`` each time."""

    def __init__(
        self,
        name: str,
        library: SkillLibrary,
        arm_of: Callable[[], Arm],
        tell: Callable[[JobReport], Awaitable[None]],
        *,
        keep_trace: Callable[[QueuedMotion, Trace], Awaitable[None]],
        queue: ArmQueue | None = None,
        trouble: Callable[[], Cause] = lambda: Cause.NONE,
        keep_override: Callable[[], Awaitable[None]] | None = None,
        may_still_run: Callable[[JobReport], Awaitable[None]] | None = None,
    ) -> None:
        """Make a lane. ``may_still_run`` raises NotAnyMore; ``trouble`` says why nothing may begin on the arm now."""
        self._name = name
        self._library = library
        self._arm_of = arm_of
        self._tell = tell
        self._keep_trace = keep_trace
        self._queue = queue
        self._trouble = trouble
        self._keep_override = keep_override
        self._may_still_run = may_still_run
        self._keeping: set[asyncio.Task[None]] = set()
        self._orders: OrderedDict[str, QueuedMotion] = OrderedDict()
        self._reserved = 0
        self._changed = asyncio.Event()
        self._running: Run | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._finishing: asyncio.Task[None] | None = None
        self._closing = asyncio.Event()
        self._moves = asyncio.Lock()
        self._ends = Endings(library, tell, self._moves, self._closing)
        self._steering = Steering(library, tell, self._moves, queue)
        self._home = WayHome(name, arm_of, self.hold, self._changed.set)
        self.stops = 0
        if queue is not None:
            queue.on_change = self._changed.set

    @property
    def waiting(self) -> int:
        """How many jobs wait, with those that are about to."""
        return len(self._orders) + self._reserved

    @property
    def busy_with(self) -> str:
        """What is under way on the arm, in words; empty: nothing."""
        if self._running is not None:
            return f"busy with job {self._running.order.job_id}"
        return "on its way home" if self._home.under_way else ""

    def holds(self, job_id: str) -> bool:
        """Whether the job waits or runs here."""
        return job_id in self._orders or self._run_of(job_id) is not None

    def progress_of(self, job_id: str) -> float | None:
        """Return how far the running job is, or None if it does not run here."""
        run = self._run_of(job_id)
        return run.progress if run else None

    def place_of(self, job_id: str) -> tuple[float | None, float | None]:
        """Return where on the path the running job is, as `place_at`; None off it, or where it does not run here."""
        run = self._run_of(job_id)
        return (None, None) if run is None or run.order.plan is None else place_at(run.order.plan, run.path_time)

    def state_of(self, job_id: str) -> JobState | None:
        """Return what the run of a job does, whatever is written of it; None where it does not run here."""
        run = self._run_of(job_id)
        if run is None or run.over.is_set() or run.state is JobState.QUEUED:
            return None
        return JobState.STOPPING if run.stop_because else run.state

    def reserve(self) -> None:
        """Keep a place for an order that is being written down."""
        self._reserved += 1

    def release(self) -> None:
        """Give a reserved place back."""
        self._reserved -= 1

    def put(self, order: QueuedMotion) -> None:
        """Queue an order whose place was reserved and whose job is stored."""
        self._reserved -= 1
        self._orders[order.job_id] = order
        self._count()

    def start(self) -> None:
        """Begin to serve."""
        self._tasks = [asyncio.create_task(self._serve(), name=f"lane {self._name}")]
        if self._queue is not None:
            self._tasks.append(asyncio.create_task(self._watch(), name=f"watch {self._name}"))

    async def stop(self) -> None:
        """Stop the motion, leave the rest of the queue to be marked as interrupted."""
        if not self._tasks:
            return
        self._closing.set()
        under_way = [*self._tasks, *(one for one in (self._home.task, self._steering.noting) if one)]
        for task in under_way:
            task.cancel()
        await asyncio.gather(*under_way, return_exceptions=True)
        if self._finishing is not None:
            await asyncio.gather(self._finishing, return_exceptions=True)
        await asyncio.gather(*self._keeping, return_exceptions=True)
        self._tasks = []

    def hold(self, because: Cause, by: str) -> None:
        """Let no further job begin, if this is the lane of an arm."""
        if self._queue is not None:
            self._queue.hold(because, by)

    def _count(self) -> None:
        if self._queue is not None:
            self._queue.count(len(self._orders))
        self._changed.set()

    def _run_of(self, job_id: str) -> Run | None:
        run = self._running
        return run if run is not None and run.order.job_id == job_id else None

    async def _serve(self) -> None:
        while not self._closing.is_set():
            while not self._may_begin():
                self._changed.clear()
                await self._changed.wait()
            _, order = self._orders.popitem(last=False)
            # Nothing is awaited between the question and this: a hold finds the job waiting, or under way.
            self._running = Run(order, self._arm_of())
            self._count()
            try:
                await self._run(self._running)
            except Exception:
                _log.exception("job %s on lane %s failed", order.job_id, self._name)

    def _may_begin(self) -> bool:
        """Return whether the first job that waits may begin; an arm that is not ready at home holds the queue."""
        if not self._orders or self._home.under_way:
            return False
        if self._queue is None:
            return True
        trouble = Cause.NONE if self._queue.held else self._trouble()
        if trouble is not Cause.NONE:
            self._queue.hold(trouble, ARM_SIDE)
        return not self._queue.held

    async def _run(self, run: Run) -> None:
        end = End(JobState.FAILED, Failure.INTERNAL, "the run ended without a result", cause=Cause.FAILED)
        try:
            if not await self._begun(run):
                return
            trace = await self._driven(run)
            end = End(JobState.COMPLETED, Failure.NONE, run.order.notes, trace)
        except _HeldBefore:
            text = "the queue was held before the arm moved: ask for the job again"
            end = End(JobState.ABORTED, Failure.ABORTED, text, cause=self._held_because())
        except (StoppedBefore, Stopped, NoLongerExecutable, ArmError) as ended:
            end = how_it_ended(run, ended, lost=self._queue is not None and is_lost(run.arm))
        except asyncio.CancelledError:
            end = End(JobState.FAILED, Failure.INTERRUPTED, "the server stopped", cause=Cause.UNFINISHED_AT_START)
            raise
        except Exception as fault:
            end = End(JobState.FAILED, Failure.INTERNAL, f"{type(fault).__name__}: {fault}", cause=Cause.FAILED)
            raise
        finally:
            if self._running is run:
                if end.trace is None and run.order.plan is not None:
                    end = replace(end, trace=run.seen.trace(run.order.plan), seen_only=True)
                if end.cause is not Cause.NONE:
                    self.hold(end.cause, ARM_SIDE if end.by_arm else SERVER_SIDE)
                self._finishing = asyncio.create_task(self._finish(run, end), name=f"end of {run.order.job_id}")
                await asyncio.shield(self._finishing)

    async def _begun(self, run: Run) -> bool:
        """Write down that a job runs; return False where it is not to begin: dropped, or put back into a held queue."""
        async with self._moves:
            report = await self._library.job(run.order.job_id)
            if report.state is not JobState.QUEUED:
                self._running = None
                return False
            if self._may_still_run is not None:
                await self._may_still_run(report)
            run.check_wanted()
            if self._queue is not None and self._queue.held:
                self._running = None
                self._orders[run.order.job_id] = run.order
                self._orders.move_to_end(run.order.job_id, last=False)
                self._count()
                return False
            await self._steering.move(run, JobState.RUNNING, start_time=run.moment())
        return True

    async def _driven(self, run: Run) -> Trace:
        """Run the job's plan, if that is still wanted now."""
        if self._queue is None:
            await run.arm.open()
        if self._keep_override is not None:
            await self._keep_override()
        run.check_wanted()
        if self._queue is not None and self._queue.held:
            raise _HeldBefore
        return await run.arm.run(run.order.plan, lambda progress: self._on_progress(run, progress))

    def _held_because(self) -> Cause:
        return Cause.REQUESTED if self._queue is None else self._queue.status.because

    async def _finish(self, run: Run, end: End) -> None:
        """Bring the arm to rest, write the job's end and its trace down, then tell."""
        try:
            if end.failure in {Failure.INTERRUPTED, Failure.INTERNAL}:
                await run.arm.stop(end.message)
            if self._queue is None:
                await run.arm.close()
        finally:
            run.over.set()
            run.note_going_on()
            try:
                await self._ends.write(run.order.job_id, end, lambda: run.progress, self._where(run, end))
            except LibraryError as unreadable:
                self.hold(Cause.FAILED, SERVER_SIDE)
                _log.error("the end of job %s cannot be written down: %s", run.order.job_id, unreadable)
            finally:
                self._running = None
                self._changed.set()
        if end.trace is not None:
            task = in_background(self._keep_trace(run.order, end.trace))
            self._keeping.add(task)
            task.add_done_callback(self._keeping.discard)

    def _where(self, run: Run, end: End) -> dict[str, object]:
        """Return the fields of a report that say where a run ended, whether that held the queue, and when it paused."""
        fields: dict[str, object] = {**run.pauses, "end_time": run.moment()}
        if end.cause is Cause.NONE:
            return fields
        if end.trace is not None and len(end.trace.path_times) and run.order.plan is not None:
            run.path_time = float(end.trace.path_times[-1])
        if run.state is not JobState.QUEUED and run.order.plan is not None:
            fields["path_phase"], fields["place"] = place_at(run.order.plan, run.path_time)
        return {**fields, "cause": end.cause, "held_queue": self._queue is not None}

    def _on_progress(self, run: Run, progress: Progress) -> None:
        run.progress = min(1.0, max(0.0, progress.fraction))
        run.path_time = progress.time
        run.seen.note(progress.time, run.arm.state())
        now = asyncio.get_running_loop().time()
        if now - run.told_at >= TELL_EVERY:
            run.told_at = now
            in_background(self._tell_progress(run.order.job_id, run.progress))

    async def _tell_progress(self, job_id: str, fraction: float) -> None:
        await self._library.set_progress(job_id, fraction)
        async with self._moves:
            if not self.progress_of(job_id):
                return
            report = await self._library.job(job_id)
            if report.state in {JobState.RUNNING, JobState.PAUSED}:
                await self._tell(report)

    async def _watch(self) -> None:
        """See what the arm does by itself: pauses, goes on, is lost, stands where nobody has sent it."""
        at_fault = ""
        while True:
            await asyncio.sleep(LOOK_EVERY if self._running is not None else LOOK_EVERY_AT_REST)
            try:
                await self._look()
                at_fault = ""
            except Exception as fault:
                if str(fault) != at_fault:
                    _log.exception("watching the arm of lane %s", self._name)
                at_fault = str(fault)

    async def _look(self) -> None:
        if self._keep_override is not None:
            await self._keep_override()
        run = self._running
        if run is not None:
            self._steering.follow(run)
        elif not self._home.under_way:
            trouble = self._trouble()
            if trouble is not Cause.NONE and self._queue is not None:
                self._queue.hold(trouble, ARM_SIDE)

    async def pause(self, job_id: str, because: str) -> JobState:
        """Stop on the path; the job can be resumed. Never in vain while the arm moves for it."""
        return await self._steering.pause(await self._at_work(job_id, JobState.RUNNING), because)

    async def resume(self, job_id: str) -> JobState:
        """Go on where the arm paused."""
        return await self._steering.resume(await self._at_work(job_id, JobState.PAUSED))

    async def _at_work(self, job_id: str, wanted: JobState) -> Run:
        run = self._run_of(job_id)
        if run is None or run.over.is_set():
            state = (await self._library.job(job_id)).state
            raise NotAllowedInState(f"job {job_id}", state.value, f"it has to be {wanted.value.lower()}")
        return run

    async def abort(self, job_id: str, because: str, by: str = "") -> JobState:
        """Take a job out of the queue, or stop its motion and hold the queue; return what becomes of it.

        What an arm runs is stopped whatever the database does or says: it is Stopping until the arm is at rest.
        """
        run = self._run_of(job_id)
        if run is not None and not run.over.is_set():
            return await self._abort_running(run, because, by, Cause.ABORTED)
        end = End(JobState.ABORTED, Failure.ABORTED, because)
        if self._orders.pop(job_id, None) is not None:
            self._count()
            writing = in_background(self._ends.write(job_id, end, lambda: 0.0, {"cause": Cause.ABORTED}))
            done, _ = await asyncio.wait({writing}, timeout=PATIENCE)
            return JobState.ABORTED if done else JobState.STOPPING
        async with self._moves:
            report = await self._library.job(job_id)
            if report.state is not JobState.QUEUED or run is not None:
                raise NotAllowedInState(f"job {job_id}", report.state.value, "it has to be running or paused")
            fields = {"failure": Failure.ABORTED, "cause": Cause.ABORTED, "end_time": datetime.now(UTC)}
            report = await self._library.move_job(job_id, JobState.ABORTED, message=because[:4000], **fields)
            await self._tell(report)
        return JobState.ABORTED

    async def stop_motion(self, because: str, by: str = "") -> None:
        """Bring whatever moves the arm to rest on its path and hold the queue; no reset is needed afterwards."""
        self.stops += 1
        self.hold(Cause.STOPPED, by)
        run = self._running
        if run is not None and not run.over.is_set():
            await self._abort_running(run, because, by, Cause.STOPPED)
        else:
            await self._home.stop(because)

    async def _abort_running(self, run: Run, because: str, by: str, cause: Cause) -> JobState:
        run.stop(because, cause)
        self.hold(cause, by)
        await asyncio.wait({self._steering.stop(run)}, timeout=PATIENCE)
        return JobState.STOPPING

    async def protective_stop(self, because: str, by: str = "") -> None:
        """Stop the arm at once, hold the queue, and refuse every motion until a reset."""
        run, arm = self._running, self._arm_of()
        self.stops += 1
        if run is not None:
            run.stop(because, Cause.PROTECTIVE_STOP)
        self.hold(Cause.PROTECTIVE_STOP, by)
        stopping = asyncio.create_task(arm.protective_stop(because), name=f"protective stop on {self._name}")
        if run is not None and not run.over.is_set():
            in_background(self._steering.write_stopping(run))
        await asyncio.shield(stopping)

    def check_at_rest(self, what: str) -> None:
        """Raise NotAllowedInState while a job or the way home is under way."""
        if self.busy_with:
            raise NotAllowedInState(what, self.busy_with, "wait for its end or abort it")

    def go_home(self, plan: MotionPlan) -> None:
        """Begin the way to where every run starts; jobs wait meanwhile."""
        self.check_at_rest(f"the arm of lane {self._name}")
        self._home.begin(plan)

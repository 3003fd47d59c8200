"""Steering a run that is under way: pause, resume, stop, and following what the arm's own side does.

Stopping never waits for the database: first the arm is told, then the change of state is written down and told.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable

from library.description import Cause, JobReport, JobState
from library.errors import LibraryError, LibraryUnusable, NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.jobs.motion.completion import in_background
from opcua_skill.jobs.motion.release import PATIENCE, ArmQueue
from opcua_skill.jobs.motion.run import Run
from sim.arm import ArmError, ArmMode

STOP_AGAIN = 0.05
ARM_SIDE, SERVER_SIDE = "arm", "server"
UNDER_WAY = frozenset({JobState.RUNNING, JobState.PAUSED})

_log = logging.getLogger(__name__)


class Steering:
    """What may be done to the run of one lane. ``moves`` guards changes of state; ``queue`` is None beside the arm."""

    def __init__(
        self,
        library: SkillLibrary,
        tell: Callable[[JobReport], Awaitable[None]],
        moves: asyncio.Lock,
        queue: ArmQueue | None,
    ) -> None:
        self._library = library
        self._tell = tell
        self._moves = moves
        self._queue = queue
        self._at_fault = ""
        self.noting: asyncio.Task[None] | None = None

    async def move(self, run: Run, to: JobState, **fields: object) -> JobReport:
        """Write down another state of a run's job, then tell."""
        report = await self._library.move_job(run.order.job_id, to, **fields)
        run.state = to
        await self._tell(report)
        return report

    async def _keep_up(self, run: Run, to: JobState, **fields: object) -> None:
        """Write down what became of a run under way; where its job is gone or says it has ended, the arm's word counts.

        Only a store that cannot be used now is in the way: it is asked again.
        """
        try:
            await self.move(run, to, **fields)
        except LibraryUnusable:
            raise
        except LibraryError as differs:
            _log.error("job %s is %s, but that cannot be written down: %s", run.order.job_id, to.value, differs)
            run.state = to

    async def pause(self, run: Run, because: str) -> JobState:
        """Stop on the path; the job can be resumed. What moves pauses at once, whatever the database does or says."""
        if run.arm.state().mode is ArmMode.RUNNING:
            self._check_wanted(run, JobState.RUNNING)
            await self._pause(run, because)
        else:
            async with self._moves:
                self._check(run, JobState.RUNNING)
                await self._pause(run, because)
        await asyncio.wait({in_background(self._note(run))}, timeout=PATIENCE)
        return JobState.PAUSED

    async def _pause(self, run: Run, because: str) -> None:
        run.pause_wanted, run.pauses_asked = True, run.pauses_asked + 1
        try:
            await run.arm.pause(because)
        except ArmError:
            run.pause_wanted = False
            raise
        if run.arm.state().mode is not ArmMode.PAUSED:
            run.pause_wanted = False
            raise NotAllowedInState(f"job {run.order.job_id}", "at its end", "it has to be running")

    async def resume(self, run: Run) -> JobState:
        """Go on where the arm paused, whoever paused it."""
        async with self._moves:
            self._check_wanted(run, JobState.PAUSED)
            mode = run.arm.state().mode
            if mode is not ArmMode.PAUSED:
                self._check(run, JobState.PAUSED)
                raise NotAllowedInState(f"the arm of job {run.order.job_id}", mode.value, "it has to be paused")
            run.note_going_on()
            if run.state is not JobState.RUNNING:  # a pause that was not written down yet
                await self._keep_up(run, JobState.RUNNING, cause=Cause.NONE, **run.pauses)
            if run.stop_because:
                raise NotAllowedInState(f"job {run.order.job_id}", JobState.STOPPING.value, "it has to be paused")
            asked = run.pauses_asked
            await run.arm.resume()
            if run.pauses_asked == asked:
                run.pause_wanted = False
            return JobState.RUNNING

    def stop(self, run: Run) -> asyncio.Task[None]:
        """Bring the arm to rest, asking again until the run is over; return the task that writes Stopping down."""
        in_background(self._bring_to_rest(run))
        return in_background(self.write_stopping(run))

    async def write_stopping(self, run: Run) -> None:
        """Write down that a run is being stopped, unless it has ended meanwhile."""
        async with self._moves:
            if run.over.is_set():
                return
            if (await self._library.job(run.order.job_id)).state in UNDER_WAY:
                await self.move(run, JobState.STOPPING)

    async def _bring_to_rest(self, run: Run) -> None:
        """Stop the arm, again and again: a run that begins in the moment it is stopped must not get away."""
        while not run.over.is_set():
            try:
                await run.arm.stop(run.stop_because)
            except (ArmError, OSError) as fault:
                _log.error("stopping job %s: %s", run.order.job_id, fault)
            try:
                async with asyncio.timeout(STOP_AGAIN):
                    await run.over.wait()
            except TimeoutError:
                continue

    def follow(self, run: Run) -> None:
        """See what the arm's own side did to a run: paused it, or let it go on; who watches never waits for the disk.

        A pause that nobody asked for holds the queue at once; the job's state is written down beside.
        """
        mode = self._differs(run)
        if mode is ArmMode.PAUSED and not run.pause_wanted and self._queue is not None:
            self._queue.hold(Cause.UNASKED_PAUSE, ARM_SIDE)
        if mode is not None and (self.noting is None or self.noting.done()):
            self.noting = asyncio.create_task(self._note(run), name=f"what the arm did to {run.order.job_id}")

    def _differs(self, run: Run) -> ArmMode | None:
        """Return what the arm does where that is not what a run's job says, if nobody wants the run to end."""
        mode = run.arm.state().mode
        if run.over.is_set() or run.stop_because or (mode, run.state) not in {
            (ArmMode.PAUSED, JobState.RUNNING), (ArmMode.RUNNING, JobState.PAUSED)
        }:  # fmt: skip
            return None
        return mode

    async def _note(self, run: Run) -> None:
        try:
            async with self._moves:
                mode = self._differs(run)
                if mode is ArmMode.PAUSED:
                    await self._found_paused(run)
                elif mode is ArmMode.RUNNING:
                    await self._found_running(run)
            self._at_fault = ""
        except Exception as fault:
            if str(fault) != self._at_fault:
                _log.exception("what the arm did to job %s is not written down", run.order.job_id)
            self._at_fault = str(fault)

    async def _found_paused(self, run: Run) -> None:
        unasked = not run.pause_wanted
        if unasked:
            _log.warning("job %s is paused by the arm's own side", run.order.job_id)
        run.note_pause()
        cause = Cause.UNASKED_PAUSE if unasked else Cause.NONE
        await self._keep_up(run, JobState.PAUSED, progress=run.progress, cause=cause, **run.pauses)

    async def _found_running(self, run: Run) -> None:
        if run.pause_wanted:
            _log.error("job %s went on although it is paused: it is paused again", run.order.job_id)
            await run.arm.pause("it went on although it is paused")
            return
        run.note_going_on()
        await self._keep_up(run, JobState.RUNNING, cause=Cause.NONE, **run.pauses)

    def _check(self, run: Run, wanted: JobState) -> None:
        """Raise NotAllowedInState unless the run is in a state, and nobody wants it to end."""
        self._check_wanted(run, wanted)
        if run.state is not wanted:
            raise NotAllowedInState(f"job {run.order.job_id}", run.state.value, f"it has to be {wanted.value.lower()}")

    def _check_wanted(self, run: Run, wanted: JobState) -> None:
        """Raise NotAllowedInState if the run is over, or somebody wants it to end."""
        if run.stop_because or run.over.is_set():
            state = JobState.STOPPING if run.stop_because else run.state
            raise NotAllowedInState(f"job {run.order.job_id}", state.value, f"it has to be {wanted.value.lower()}")

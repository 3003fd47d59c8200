"""How a job's end is written down: as often as it takes, whatever becomes of the disk meanwhile."""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from library.description import Cause, Failure, JobReport, JobState
from library.errors import AWAY, LibraryUnusable
from library.lifecycle import FINAL_JOB_STATES
from library.records import JobTrace
from library.store import SkillLibrary
from opcua_skill.jobs.motion.run import NoLongerExecutable, Run, StoppedBefore
from sim.arm import Arm, ArmError, ArmFault, ArmMode, Stopped, Trace

WRITE_AGAIN = 0.1
WRITE_AGAIN_AT_MOST = 5.0
TRACE_TRIES = 10
TRACE_COLUMNS = ("x (m)", "y (m)", "z (m)")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class End:
    """How a job ended; the arm is at rest. ``by_arm``: the arm's own side ended it.

    ``seen_only``: the trace is what the server saw, not the arm's own: too coarse to say how well it was followed.
    """

    state: JobState
    failure: Failure
    message: str
    trace: Trace | None = None
    cause: Cause = Cause.NONE
    by_arm: bool = False
    seen_only: bool = False


def how_it_ended(run: Run, ended: Exception, *, lost: bool) -> End:
    """Return how a run ended that did not end by itself: who stopped it, or what the arm's fault was."""
    asked = run.stop_cause
    match ended:
        case StoppedBefore():
            return End(JobState.ABORTED, run.stop_failure, run.stop_because, cause=asked)
        case Stopped() if run.stop_because:
            return End(JobState.ABORTED, run.stop_failure, run.stop_because, ended.trace, asked)
        case Stopped():
            text = ended.because
            return End(JobState.ABORTED, Failure.ABORTED, text, ended.trace, Cause.UNASKED_STOP, by_arm=True)
        case NoLongerExecutable():
            return End(JobState.FAILED, ended.failure, str(ended), cause=Cause.FAILED)
        case ArmFault():
            failure = Failure(ended.failure)
            if failure is Failure.PROTECTIVE_STOP and run.stop_because:
                return End(JobState.ABORTED, run.stop_failure, run.stop_because, ended.trace, asked)
            cause = Cause.PROTECTIVE_STOP if failure is Failure.PROTECTIVE_STOP else Cause.FAILED
            return End(
                JobState.FAILED, failure, ended.text, ended.trace, Cause.ARM_LOST if lost else cause, by_arm=True
            )
        case ArmError():
            return End(JobState.FAILED, Failure(ended.failure), ended.text, cause=Cause.FAILED, by_arm=True)
    raise ended


def is_lost(arm: Arm) -> bool:
    """Return whether contact with an arm is lost: where it is and what it does is not known."""
    state = arm.state()
    return not state.known or state.mode in {ArmMode.FAULT, ArmMode.CLOSED}


class Endings:
    """Writes the ends of one lane's jobs. ``moves`` guards changes of state, ``closing`` says the server stops."""

    def __init__(
        self,
        library: SkillLibrary,
        tell: Callable[[JobReport], Awaitable[None]],
        moves: asyncio.Lock,
        closing: asyncio.Event,
    ) -> None:
        self._library = library
        self._tell = tell
        self._moves = moves
        self._closing = closing

    async def write(
        self, job_id: str, end: End, progress: Callable[[], float], fields: Mapping[str, object] | None = None
    ) -> None:
        """Write trace and state, then tell; a full or locked disk must not lose them, nor the next job run meanwhile.

        ``fields`` are further ones of the report.
        Until then the job stays as it was, because nothing is told that is not written. A trace that cannot be stored
        for long is given up, and its job says so. A server that stops does not wait: its next start marks the job.
        """
        stored, tries, pause = end.trace is None, 0, WRITE_AGAIN
        while True:
            tries += 1
            try:
                if end.trace is not None and not stored and tries <= TRACE_TRIES:
                    await self._save(job_id, end.trace)
                    stored = True
                async with self._moves:
                    await self._write_state(job_id, end, stored, progress(), fields or {})
                return
            except LibraryUnusable as unusable:
                if unusable.trouble in AWAY:
                    tries -= 1  # nothing is wrong with the trace: it waits as long as the database server is away
                _log.warning("the end of job %s is not written yet: %s", job_id, unusable)
                if self._closing.is_set():
                    return
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(pause):
                        await self._closing.wait()
                pause = min(2.0 * pause, WRITE_AGAIN_AT_MOST)

    async def _save(self, job_id: str, trace: Trace) -> None:
        joints = tuple(f"joint{k + 1} (rad)" for k in range(trace.joints_commanded.shape[1]))
        stored = JobTrace(
            trace.times,
            np.hstack([trace.tool_commanded, trace.joints_commanded]),
            np.hstack([trace.tool_measured, trace.joints_measured]),
            TRACE_COLUMNS + joints,
        )
        await self._library.save_trace(job_id, stored)

    async def _write_state(
        self, job_id: str, end: End, trace_stored: bool, progress: float, more: Mapping[str, object]
    ) -> None:
        report = await self._library.job(job_id)
        if report.state in FINAL_JOB_STATES:
            return
        if end.state is JobState.ABORTED and report.state in {JobState.RUNNING, JobState.PAUSED}:
            await self._tell(await self._library.move_job(job_id, JobState.STOPPING))
        if end.state is JobState.COMPLETED and report.state is JobState.PAUSED:  # it went on before that was written
            await self._tell(await self._library.move_job(job_id, JobState.RUNNING))
        fields = {"end_time": datetime.now(UTC), "cause": end.cause, **more}
        if end.trace is not None and not end.seen_only:
            fields["tracking_error"] = end.trace.tracking_error()
        lost = "" if trace_stored else "its trace could not be stored"
        report = await self._library.move_job(
            job_id,
            end.state,
            failure=end.failure,
            message="; ".join(words for words in (end.message, lost) if words)[:4000],
            progress=1.0 if end.state is JobState.COMPLETED else progress,
            **fields,
        )
        await self._tell(report)


_tasks: set[asyncio.Task[None]] = set()


def in_background(work: Awaitable[Any]) -> asyncio.Task[None]:
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

"""A lane writes states down before it tells, runs one job at a time, and leaves the arm at rest on every way out."""

import asyncio
import contextlib
import sqlite3
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from scripted_arm import STILL, ScriptedArm, trace

from library.description import Cause, Failure, JobReport, JobState
from library.errors import LibraryUnusable, NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.jobs.motion.completion import is_lost
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.jobs.motion.release import ArmQueue, QueueStatus
from opcua_skill.jobs.motion.run import NoLongerExecutable, QueuedMotion
from sim.arm import ArmFault, ArmMode, StartRefused, Trace
from sim.plan import MotionPlan
from sim.planning.planner import plan_home

LIMIT = 10.0
NO_PLAN = cast(MotionPlan, None)


@dataclass
class Bench:
    """A lane with a scripted arm on a library of its own, its queue, and what both told."""

    library: SkillLibrary
    arm: ScriptedArm
    told: list[tuple[JobState, JobState]] = field(default_factory=list)
    queues: list[QueueStatus] = field(default_factory=list)
    queue: Any = None
    lane: Any = None
    kept: dict[str, Trace] = field(default_factory=dict)
    at_check: "asyncio.Event" = field(default_factory=asyncio.Event)
    checked: "asyncio.Event" = field(default_factory=asyncio.Event)
    not_any_more: str = ""
    looks: int = 0

    def __post_init__(self) -> None:
        self.checked.set()
        self.queue = ArmQueue("ws1", self.library, self.tell_queue)
        self.lane = MotionQueue(
            "test",
            self.library,
            lambda: self.arm,
            self.tell,
            keep_trace=self.keep,
            queue=self.queue,
            trouble=self.trouble,
            keep_override=self.keep_override,
            may_still_run=self.may_still_run,
        )

    def trouble(self) -> Cause:
        if self.arm.state().protective_stop:
            return Cause.PROTECTIVE_STOP
        return Cause.ARM_LOST if is_lost(self.arm) else Cause.NONE

    async def keep_override(self) -> None:
        self.looks += 1

    async def may_still_run(self, _: JobReport) -> None:
        self.at_check.set()
        await self.checked.wait()
        if self.not_any_more:
            raise NoLongerExecutable(Failure.NOT_DEPLOYED, self.not_any_more)

    async def tell_queue(self, _: str, status: QueueStatus) -> None:
        self.queues.append(status)

    async def release(self) -> None:
        """Release the queue as soon as nothing is under way."""
        async with asyncio.timeout(LIMIT):
            while self.lane.busy_with:
                await asyncio.sleep(0.01)
        await self.queue.release("olga", lambda: self.lane.check_at_rest("the arm"))

    async def keep(self, order: QueuedMotion, trace: Trace) -> None:
        self.kept[order.job_id] = trace

    async def tell(self, report: JobReport) -> None:
        self.told.append((report.state, (await self.library.job(report.job_id)).state))

    async def ask(self, job_id: str, plan: MotionPlan = NO_PLAN) -> None:
        await self.library.add_job(JobReport(job_id=job_id, kind="Execution", workstation="ws1", mode="production"))
        self.lane.reserve()
        self.lane.put(QueuedMotion(job_id, plan))

    async def state(self, job_id: str, *wanted: JobState) -> JobReport:
        async with asyncio.timeout(LIMIT):
            while (report := await self.library.job(job_id)).state not in wanted:
                await asyncio.sleep(0.01)
        return report


class FullDisk:
    """Writes of a library that fail while ``full``, as SQLite's do."""

    def __init__(self, library: SkillLibrary, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self.refused = asyncio.Event()
        self.gate, self.at_gate = asyncio.Event(), asyncio.Event()
        self.gate.set()
        for name in ("move_job", "save_trace", "set_progress", "change_station"):
            monkeypatch.setattr(library, name, self._guarded(getattr(library, name)))

    def _guarded(self, write: Any) -> Any:
        async def written(*arguments: Any, **fields: Any) -> Any:
            if self.full:
                self.refused.set()
                raise LibraryUnusable("skills.db", "database or disk is full", "free space")
            if not self.gate.is_set():
                self.at_gate.set()
                await self.gate.wait()
            return await write(*arguments, **fields)

        return written


@pytest.fixture
def full_disk(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> FullDisk:
    return FullDisk(bench.library, monkeypatch)


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    library = await SkillLibrary.open(tmp_path / "skills.db")
    made = Bench(library, ScriptedArm())
    made.queue.start()
    made.lane.start()
    yield made
    made.arm.finish.set()
    await made.lane.stop()
    await made.queue.stop()
    await library.close()


async def test_a_run_completes_with_its_trace_and_tracking_error(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    bench.arm.finish.set()
    report = await bench.state("one", JobState.COMPLETED)
    assert report.progress == 1.0
    assert report.failure is Failure.NONE
    assert report.tracking_error == pytest.approx((1e-4, 1e-4))
    assert report.start_time is not None
    assert report.end_time is not None
    tip_and_joints = (await bench.library.trace("one")).measured
    assert tip_and_joints.shape == (3, 3 + 7)
    await bench.lane.stop()
    assert bench.kept["one"].joints_measured.shape == (3, 7)


async def test_what_is_told_was_written_before(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.pause("one", "look")
    await bench.lane.resume("one")
    bench.arm.finish.set()
    await bench.state("one", JobState.COMPLETED)
    async with asyncio.timeout(LIMIT):
        while not bench.told or bench.told[-1][0] is not JobState.COMPLETED:
            await asyncio.sleep(0.01)
    assert all(told is written for told, written in bench.told)
    states = [told for told, _ in bench.told]
    assert list(dict.fromkeys(states)) == [JobState.RUNNING, JobState.PAUSED, JobState.COMPLETED]


async def test_one_job_runs_at_a_time_in_the_order_of_arrival(bench: Bench) -> None:
    for name in ("one", "two", "three"):
        await bench.ask(name)
    await bench.state("one", JobState.RUNNING)
    assert [(await bench.library.job(name)).state for name in ("two", "three")] == [JobState.QUEUED, JobState.QUEUED]
    assert bench.lane.waiting == 2
    bench.arm.finish.set()
    for name in ("one", "two", "three"):
        await bench.state(name, JobState.COMPLETED)
    reports = [await bench.library.job(name) for name in ("one", "two", "three")]
    ends = [report.end_time for report in reports]
    assert ends == sorted(ends)  # type: ignore[type-var]
    assert bench.arm.runs == 3


async def test_aborting_a_running_job_is_stopping_until_the_arm_rests(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    assert await bench.lane.abort("one", "operator pressed stop", "olga") is JobState.STOPPING
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.message) == (Failure.ABORTED, "operator pressed stop")
    assert bench.arm.state().at_rest
    assert (await bench.library.trace("one")).times.shape == (2,)


async def test_aborting_a_waiting_job_never_runs_it(bench: Bench) -> None:
    await bench.ask("one")
    await bench.ask("two")
    await bench.state("one", JobState.RUNNING)
    assert await bench.lane.abort("two", "not needed") is JobState.ABORTED
    assert not bench.queue.held, "what has not begun is no motion that was stopped"
    bench.arm.finish.set()
    await bench.state("one", JobState.COMPLETED)
    assert bench.arm.runs == 1
    assert bench.lane.waiting == 0


async def test_a_paused_job_is_not_started_by_the_next_one(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.pause("one", "look")
    await bench.ask("two")
    await asyncio.sleep(0.05)
    assert (await bench.library.job("one")).state is JobState.PAUSED
    assert (await bench.library.job("two")).state is JobState.QUEUED


async def test_a_fault_names_itself_and_the_next_job_waits_for_a_release(bench: Bench) -> None:
    bench.arm.fault = ArmFault("Internal", "the simulation process died", trace(1))
    bench.arm.finish.set()
    await bench.ask("one")
    report = await bench.state("one", JobState.FAILED)
    assert (report.failure, report.message) == (Failure.INTERNAL, "the simulation process died")
    assert (report.cause, report.held_queue) == (Cause.FAILED, True)
    bench.arm.fault = None
    await bench.ask("two")
    assert (await bench.library.station("ws1")).held_because is Cause.FAILED
    await bench.release()
    await bench.state("two", JobState.COMPLETED)
    assert bench.arm.runs == 2


async def test_of_an_arm_that_is_lost_with_its_trace_what_the_server_saw_is_kept(bench: Bench) -> None:
    home = bench.arm.model.home
    plan = plan_home(bench.arm.model, (home[0] + 0.1, *home[1:]))
    bench.arm.fault = ArmFault("Interrupted", "no answer from the controller")
    await bench.ask("one", plan)
    await bench.state("one", JobState.RUNNING)
    bench.arm.finish.set()
    report = await bench.state("one", JobState.FAILED)
    seen = await bench.library.trace("one")
    assert seen.measured == pytest.approx(np.array([[*STILL.tool_pose[:3], *STILL.joints]]))
    there = [np.interp(1.0, plan.times, column) for column in plan.joints.T]
    assert seen.commanded[0, 3:] == pytest.approx(np.array(there))
    assert report.tracking_error == (0.0, 0.0), "states that were told now and then do not say how well it followed"
    async with asyncio.timeout(LIMIT):
        while "one" not in bench.kept:
            await asyncio.sleep(0.01)
    assert bench.kept["one"].source.startswith("as the server saw it")


async def test_a_stopped_motion_needs_no_reset_and_says_that_it_was_stopped(bench: Bench) -> None:
    await bench.ask("one")
    await bench.ask("two")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await bench.lane.stop_motion("somebody walks in", "olga")
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.cause, report.message) == (Failure.ABORTED, Cause.STOPPED, "somebody walks in")
    assert (bench.queue.status.because, bench.queue.status.by) == (Cause.STOPPED, "olga")
    assert not bench.arm.state().protective_stop
    await bench.release()
    await bench.state("two", JobState.RUNNING, JobState.COMPLETED)


@pytest.mark.parametrize("begun", [True, False])
async def test_the_way_home_is_stopped_too_even_in_the_moment_it_begins(bench: Bench, begun: bool) -> None:
    home = bench.arm.model.home
    bench.arm.begins.clear()
    bench.lane.go_home(plan_home(bench.arm.model, (home[0] + 0.1, *home[1:])))
    await asyncio.wait_for(bench.arm.asked.wait(), LIMIT)
    if begun:
        bench.arm.begins.set()
        await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    stopping = asyncio.create_task(bench.lane.stop_motion("somebody walks in", "olga"))
    await asyncio.sleep(0)
    bench.arm.begins.set()
    await asyncio.wait_for(stopping, LIMIT)
    assert not bench.lane.busy_with
    assert (bench.queue.status.because, bench.queue.status.by) == (Cause.STOPPED, "olga")


async def test_a_refused_start_fails_the_job_by_name(bench: Bench) -> None:
    bench.arm.refusal = StartRefused("ParameterInvalid", "the arm is not where the plan begins")
    await bench.ask("one")
    report = await bench.state("one", JobState.FAILED)
    assert report.failure is Failure.PARAMETER_INVALID
    assert "where the plan begins" in report.message


async def test_stopping_the_server_interrupts_the_run_at_rest(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.stop()
    report = await bench.library.job("one")
    assert (report.state, report.failure) == (JobState.FAILED, Failure.INTERRUPTED)
    assert bench.arm.state().at_rest


async def test_a_protective_stop_says_so_in_the_job(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.protective_stop("light curtain")
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.message) == (Failure.PROTECTIVE_STOP, "light curtain")


async def test_a_protective_stop_without_a_job_still_stops_the_arm(bench: Bench) -> None:
    await bench.lane.protective_stop("light curtain")
    assert bench.arm.state().protective_stop


async def test_a_job_aborted_before_the_arm_moves_never_moves_it(bench: Bench) -> None:
    bench.checked.clear()
    await bench.ask("one")
    await bench.at_check.wait()
    assert await bench.lane.abort("one", "not needed") is JobState.STOPPING
    bench.checked.set()
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.cause, report.message) == (Failure.ABORTED, Cause.ABORTED, "not needed")
    assert bench.arm.runs == 0
    assert bench.queue.held


async def test_a_job_that_may_not_run_any_more_fails_without_having_started(bench: Bench) -> None:
    bench.not_any_more = "glue is not deployed any more"
    await bench.ask("one")
    report = await bench.state("one", JobState.FAILED)
    assert (report.failure, report.message) == (Failure.NOT_DEPLOYED, "glue is not deployed any more")
    assert (report.start_time, bench.arm.runs) == (None, 0)


async def test_a_queue_held_while_a_job_s_turn_comes_keeps_the_job_waiting(bench: Bench) -> None:
    bench.checked.clear()
    await bench.ask("one")
    await bench.ask("two")
    await bench.at_check.wait()
    bench.queue.hold(Cause.REQUESTED, "olga")
    bench.checked.set()
    async with asyncio.timeout(LIMIT):
        while bench.lane.waiting < 2:
            await asyncio.sleep(0.01)
    assert [(await bench.library.job(name)).state for name in ("one", "two")] == [JobState.QUEUED] * 2
    assert bench.arm.runs == 0
    bench.arm.finish.set()
    await bench.release()
    for name in ("one", "two"):
        await bench.state(name, JobState.COMPLETED)
    first, second = [await bench.library.job(name) for name in ("one", "two")]
    assert first.end_time <= second.start_time  # type: ignore[operator]


async def test_after_an_abort_the_next_job_waits_until_somebody_releases_the_queue(bench: Bench) -> None:
    await bench.ask("one")
    await bench.ask("two")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await bench.lane.abort("one", "stop", "olga")
    report = await bench.state("one", JobState.ABORTED)
    assert (report.cause, report.held_queue) == (Cause.ABORTED, True)
    await bench.queue.written(LIMIT)
    assert (bench.queue.status.because, bench.queue.status.by) == (Cause.ABORTED, "olga")
    assert (await bench.library.station("ws1")).held_because is Cause.ABORTED
    assert (bench.arm.runs, bench.queue.status.waiting) == (1, 1)
    await bench.release()
    await bench.state("two", JobState.RUNNING, JobState.COMPLETED)
    assert (await bench.library.station("ws1")).held_because is Cause.NONE
    async with asyncio.timeout(LIMIT):
        while not any(told.held for told in bench.queues) or bench.queues[-1].held:
            await asyncio.sleep(0.01)


async def test_a_hold_that_comes_while_a_release_is_written_down_wins(bench: Bench, full_disk: FullDisk) -> None:
    bench.queue.hold(Cause.ABORTED, "olga")
    await bench.queue.written(LIMIT)
    full_disk.gate.clear()
    releasing = asyncio.create_task(bench.release())
    await full_disk.at_gate.wait()
    bench.queue.hold(Cause.PROTECTIVE_STOP, "otto")
    full_disk.gate.set()
    with pytest.raises(NotAllowedInState):
        await releasing
    assert bench.queue.status.because is Cause.PROTECTIVE_STOP
    assert await bench.queue.written(LIMIT)
    assert (await bench.library.station("ws1")).held_because is Cause.PROTECTIVE_STOP


async def test_the_arm_is_watched_and_its_pause_holds_the_queue_while_the_disk_does_not_answer(
    bench: Bench, full_disk: FullDisk
) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.gate.clear()
    await bench.arm.pause("pendant")
    await asyncio.wait_for(full_disk.at_gate.wait(), LIMIT)
    assert bench.queue.status.because is Cause.UNASKED_PAUSE
    seen = bench.looks
    async with asyncio.timeout(LIMIT):
        while bench.looks < seen + 3:
            await asyncio.sleep(0.01)
    full_disk.gate.set()
    assert (await bench.state("one", JobState.PAUSED)).cause is Cause.UNASKED_PAUSE


async def test_a_release_that_cannot_be_written_down_releases_nothing(bench: Bench, full_disk: FullDisk) -> None:
    bench.queue.hold(Cause.ABORTED, "olga")
    await bench.queue.written(LIMIT)
    full_disk.full = True
    with pytest.raises(LibraryUnusable):
        await bench.release()
    assert bench.queue.held
    full_disk.full = False
    assert await bench.queue.written(LIMIT)
    assert (await bench.library.station("ws1")).held_because is Cause.ABORTED


async def test_a_hold_counts_and_is_told_while_the_disk_is_full(bench: Bench, full_disk: FullDisk) -> None:
    full_disk.full = True
    bench.queue.hold(Cause.REQUESTED, "olga")
    async with asyncio.timeout(LIMIT):
        while not bench.queues:
            await asyncio.sleep(0.01)
    assert bench.queues[-1].held
    full_disk.full = False
    assert await bench.queue.written(LIMIT)
    assert (await bench.library.station("ws1")).held_because is Cause.REQUESTED


async def test_a_pause_by_the_arm_s_own_side_pauses_the_job_holds_the_queue_and_can_be_resumed(bench: Bench) -> None:
    await bench.ask("one")
    await bench.ask("two")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await bench.arm.pause("pendant")
    report = await bench.state("one", JobState.PAUSED)
    assert report.cause is Cause.UNASKED_PAUSE
    assert (len(report.paused_from), len(report.paused_until)) == (1, 0)
    assert (bench.queue.status.because, bench.queue.status.by) == (Cause.UNASKED_PAUSE, "arm")
    await bench.lane.resume("one")
    assert bench.arm.state().mode is ArmMode.RUNNING
    bench.arm.finish.set()
    report = await bench.state("one", JobState.COMPLETED)
    assert report.cause is Cause.NONE
    assert report.paused_from[0] < report.paused_until[0] <= report.end_time  # type: ignore[operator]
    assert (bench.queue.held, bench.arm.runs) == (True, 1)


async def test_an_arm_that_goes_on_by_its_own_side_is_followed_if_its_own_side_had_paused_it(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await bench.arm.pause("pendant")
    await bench.state("one", JobState.PAUSED)
    await bench.arm.resume()
    assert (await bench.state("one", JobState.RUNNING)).cause is Cause.NONE
    await bench.lane.pause("one", "look")
    await bench.arm.resume()
    async with asyncio.timeout(LIMIT):
        while bench.arm.state().mode is not ArmMode.PAUSED:
            await asyncio.sleep(0.01)
    assert (await bench.library.job("one")).state is JobState.PAUSED


async def test_a_stop_nobody_asked_for_ends_the_job_by_that_name(bench: Bench) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await bench.arm.stop("door")
    report = await bench.state("one", JobState.ABORTED)
    assert (report.cause, report.message) == (Cause.UNASKED_STOP, "door")
    assert bench.queue.status.because is Cause.UNASKED_STOP


async def test_an_arm_lost_while_it_stands_holds_the_queue(bench: Bench) -> None:
    bench.arm.be_silent("no cable")
    async with asyncio.timeout(LIMIT):
        while not bench.queue.held:
            await asyncio.sleep(0.01)
    assert (bench.queue.status.because, bench.queue.status.by) == (Cause.ARM_LOST, "arm")


STORED = {
    "damaged": "UPDATE jobs SET report = '[]'",
    "marked by somebody else": "UPDATE jobs SET state = 'Failed'",
    "gone": "DELETE FROM jobs",
}


def tamper(database: Path, statement: str) -> None:
    """Change what is stored past the library, as somebody else might."""
    with contextlib.closing(sqlite3.connect(database, isolation_level=None, timeout=LIMIT)) as other:
        other.execute(statement)


@pytest.mark.parametrize("case", STORED)
async def test_an_abort_of_what_the_arm_runs_is_never_refused_whatever_the_database_says(
    case: str, bench: Bench, tmp_path: Path
) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await asyncio.to_thread(tamper, tmp_path / "skills.db", STORED[case])
    assert await bench.lane.abort("one", "stop", "olga") is JobState.STOPPING
    async with asyncio.timeout(LIMIT):
        while bench.lane.busy_with:
            await asyncio.sleep(0.01)
    assert bench.arm.state().at_rest
    assert bench.queue.status.because is Cause.ABORTED


@pytest.mark.parametrize("case", STORED)
async def test_what_the_arm_runs_can_be_paused_and_resumed_whatever_the_database_says(
    case: str, bench: Bench, tmp_path: Path
) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    await asyncio.to_thread(tamper, tmp_path / "skills.db", STORED[case])
    for _ in range(2):
        assert await bench.lane.pause("one", "look") is JobState.PAUSED
        assert (bench.arm.state().mode, bench.lane.state_of("one")) == (ArmMode.PAUSED, JobState.PAUSED)
        assert await bench.lane.resume("one") is JobState.RUNNING
        assert (bench.arm.state().mode, bench.lane.state_of("one")) == (ArmMode.RUNNING, JobState.RUNNING)
    assert not bench.queue.held, "a pause that was asked for holds nothing"
    bench.arm.finish.set()
    async with asyncio.timeout(LIMIT):
        while bench.lane.busy_with:
            await asyncio.sleep(0.01)
    assert bench.lane.state_of("one") is None


async def test_a_pause_counts_while_the_disk_is_full_and_is_written_down_once_it_is_not(
    bench: Bench, full_disk: FullDisk
) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.full = True
    assert await bench.lane.pause("one", "look") is JobState.PAUSED
    assert bench.arm.state().mode is ArmMode.PAUSED
    assert (await bench.library.job("one")).state is JobState.RUNNING
    full_disk.full = False
    report = await bench.state("one", JobState.PAUSED)
    assert (report.cause, bench.queue.held) == (Cause.NONE, False)


async def test_a_stop_that_comes_before_the_arm_has_begun_is_asked_again(bench: Bench) -> None:
    bench.arm.begins = asyncio.Event()
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await bench.arm.asked.wait()
    await bench.lane.abort("one", "stop", "olga")
    bench.arm.begins.set()
    assert (await bench.state("one", JobState.ABORTED)).cause is Cause.ABORTED
    assert bench.arm.state().at_rest


async def test_an_end_is_never_before_its_start(bench: Bench) -> None:
    late = datetime.now(UTC) + timedelta(days=1)
    await bench.library.add_job(JobReport(job_id="one", kind="Execution", workstation="ws1", mode="production"))
    await bench.library.move_job("one", JobState.RUNNING, start_time=late)
    (report,) = await bench.library.interrupt_unfinished()
    assert report.end_time == report.start_time == late


async def test_what_a_full_disk_did_not_take_is_told_once_it_is_back(bench: Bench, full_disk: FullDisk) -> None:
    await bench.ask("one")
    await bench.ask("two")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.full = True
    bench.arm.finish.set()
    async with asyncio.timeout(LIMIT):
        await full_disk.refused.wait()
    assert bench.arm.state().at_rest
    assert (await bench.library.job("one")).state is JobState.RUNNING
    assert bench.arm.runs == 1, "the next job has to wait until this one is written down"
    full_disk.full = False
    await bench.state("one", JobState.COMPLETED)
    assert (await bench.library.trace("one")).times.shape == (3,)
    await bench.state("two", JobState.COMPLETED)
    assert all(told is written for told, written in bench.told)


async def test_a_full_disk_does_not_keep_the_arm_from_stopping(bench: Bench, full_disk: FullDisk) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.full = True
    assert await bench.lane.abort("one", "operator pressed stop") is JobState.STOPPING
    async with asyncio.timeout(LIMIT):
        while not bench.arm.state().at_rest:
            await asyncio.sleep(0.01)
    full_disk.full = False
    report = await bench.state("one", JobState.ABORTED)
    assert report.message == "operator pressed stop"


async def test_a_server_that_stops_does_not_wait_for_a_full_disk(bench: Bench, full_disk: FullDisk) -> None:
    await bench.ask("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.full = True
    await asyncio.wait_for(bench.lane.stop(), LIMIT)
    assert bench.arm.state().at_rest
    full_disk.full = False
    (report,) = await bench.library.interrupt_unfinished()
    assert (report.state, report.failure) == (JobState.FAILED, Failure.INTERRUPTED)


@pytest.mark.parametrize("command", ["pause", "resume", "abort"])
async def test_commands_to_a_job_that_has_ended_are_refused(bench: Bench, command: str) -> None:
    bench.arm.finish.set()
    await bench.ask("one")
    await bench.state("one", JobState.COMPLETED)
    arguments = ("one",) if command == "resume" else ("one", "why")
    with pytest.raises(NotAllowedInState):
        await getattr(bench.lane, command)(*arguments)


async def test_a_fresh_arm_is_opened_and_closed_for_every_job(tmp_path: Path) -> None:
    library = await SkillLibrary.open(tmp_path / "skills.db")
    made = Bench(library, ScriptedArm())
    made.arm.finish.set()
    made.lane = MotionQueue("test", library, lambda: made.arm, made.tell, keep_trace=made.keep)
    made.lane.start()
    for name in ("one", "two"):
        await made.ask(name)
        await made.state(name, JobState.COMPLETED)
    await made.lane.stop()
    await library.close()
    assert (made.arm.opened, made.arm.closed) == (2, 2)


@pytest.mark.parametrize("turns", range(12))
async def test_a_queue_ends_though_it_is_stopped_in_the_moment_in_which_its_state_is_written(turns: int) -> None:
    class Instant:
        async def change_station(self, *_: Any, **__: Any) -> None:
            for _ in range(3):
                await asyncio.sleep(0)

    async def tell(*_: Any) -> None:
        await asyncio.sleep(0)

    queue = ArmQueue("ws1", Instant(), tell)  # type: ignore[arg-type]
    queue.start()
    for _ in range(3):
        await asyncio.sleep(0)
    queue.hold(Cause.REQUESTED, "olga")
    for _ in range(turns):
        await asyncio.sleep(0)
    ending = asyncio.create_task(queue.stop())
    done, _ = await asyncio.wait({ending}, timeout=LIMIT)
    assert done, "a keeper went on after it was told to end"

"""A lane writes states down before it tells, runs one job at a time, and leaves the arm at rest on every way out."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest
from scripted_arm import ScriptedArm, trace

from library.description import Failure, JobReport, JobState
from library.errors import NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.lane import Lane, Order
from sim.arm import ArmFault, StartRefused, Trace
from sim.plan import MotionPlan

LIMIT = 10.0
NO_PLAN = cast(MotionPlan, None)


@dataclass
class Bench:
    """A lane with a scripted arm on a library of its own, and what it told."""

    library: SkillLibrary
    arm: ScriptedArm
    told: list[tuple[JobState, JobState]] = field(default_factory=list)
    lane: Any = None
    kept: dict[str, Trace] = field(default_factory=dict)

    async def keep(self, job_id: str, trace: Trace) -> None:
        self.kept[job_id] = trace

    async def tell(self, report: JobReport) -> None:
        self.told.append((report.state, (await self.library.job(report.job_id)).state))

    async def queue(self, job_id: str) -> None:
        await self.library.add_job(JobReport(job_id=job_id, kind="Execution", workstation="ws1", mode="production"))
        self.lane.reserve()
        self.lane.put(Order(job_id, NO_PLAN))

    async def state(self, job_id: str, *wanted: JobState) -> JobReport:
        async with asyncio.timeout(LIMIT):
            while (report := await self.library.job(job_id)).state not in wanted:
                await asyncio.sleep(0.01)
        return report


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    library = await SkillLibrary.open(tmp_path / "skills.db")
    made = Bench(library, ScriptedArm())
    made.lane = Lane("test", library, lambda: made.arm, made.tell, keeps_arm_open=True, keep_trace=made.keep)
    made.lane.start()
    yield made
    made.arm.finish.set()
    await made.lane.stop()
    await library.close()


async def test_a_run_completes_with_its_trace_and_tracking_error(bench: Bench) -> None:
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    bench.arm.finish.set()
    report = await bench.state("one", JobState.COMPLETED)
    assert report.progress == 1.0
    assert report.failure is Failure.NONE
    assert report.tracking_error == pytest.approx((1e-4, 1e-4))
    assert report.start_time is not None
    assert report.end_time is not None
    assert (await bench.library.trace("one")).measured.shape == (3, 3)
    await bench.lane.stop()
    assert bench.kept["one"].joints_measured.shape == (3, 7)


async def test_what_is_told_was_written_before(bench: Bench) -> None:
    await bench.queue("one")
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
        await bench.queue(name)
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
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    assert (await bench.lane.abort("one", "operator pressed stop")).state is JobState.STOPPING
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.message) == (Failure.ABORTED, "operator pressed stop")
    assert bench.arm.state().at_rest
    assert (await bench.library.trace("one")).times.shape == (2,)


async def test_aborting_a_waiting_job_never_runs_it(bench: Bench) -> None:
    await bench.queue("one")
    await bench.queue("two")
    await bench.state("one", JobState.RUNNING)
    assert (await bench.lane.abort("two", "not needed")).state is JobState.ABORTED
    bench.arm.finish.set()
    await bench.state("one", JobState.COMPLETED)
    assert bench.arm.runs == 1
    assert bench.lane.waiting == 0


async def test_a_paused_job_is_not_started_by_the_next_one(bench: Bench) -> None:
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.pause("one", "look")
    await bench.queue("two")
    await asyncio.sleep(0.05)
    assert (await bench.library.job("one")).state is JobState.PAUSED
    assert (await bench.library.job("two")).state is JobState.QUEUED


async def test_a_fault_names_itself_and_the_next_job_still_runs(bench: Bench) -> None:
    bench.arm.fault = ArmFault("Internal", "the simulation process died", trace(1))
    bench.arm.finish.set()
    await bench.queue("one")
    report = await bench.state("one", JobState.FAILED)
    assert (report.failure, report.message) == (Failure.INTERNAL, "the simulation process died")
    bench.arm.fault = None
    await bench.queue("two")
    await bench.state("two", JobState.COMPLETED)


async def test_a_refused_start_fails_the_job_by_name(bench: Bench) -> None:
    bench.arm.refusal = StartRefused("ParameterInvalid", "the arm is not where the plan begins")
    await bench.queue("one")
    report = await bench.state("one", JobState.FAILED)
    assert report.failure is Failure.PARAMETER_INVALID
    assert "where the plan begins" in report.message


async def test_stopping_the_server_interrupts_the_run_at_rest(bench: Bench) -> None:
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.stop()
    report = await bench.library.job("one")
    assert (report.state, report.failure) == (JobState.FAILED, Failure.INTERRUPTED)
    assert bench.arm.state().at_rest


async def test_a_protective_stop_says_so_in_the_job(bench: Bench) -> None:
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    await bench.lane.protective_stop("light curtain")
    report = await bench.state("one", JobState.ABORTED)
    assert (report.failure, report.message) == (Failure.PROTECTIVE_STOP, "light curtain")


@pytest.mark.parametrize("command", ["pause", "resume", "abort"])
async def test_commands_to_a_job_that_has_ended_are_refused(bench: Bench, command: str) -> None:
    bench.arm.finish.set()
    await bench.queue("one")
    await bench.state("one", JobState.COMPLETED)
    arguments = ("one",) if command == "resume" else ("one", "why")
    with pytest.raises(NotAllowedInState):
        await getattr(bench.lane, command)(*arguments)


async def test_a_fresh_arm_is_opened_and_closed_for_every_job(tmp_path: Path) -> None:
    library = await SkillLibrary.open(tmp_path / "skills.db")
    made = Bench(library, ScriptedArm())
    made.arm.finish.set()
    made.lane = Lane("test", library, lambda: made.arm, made.tell, keeps_arm_open=False, keep_trace=made.keep)
    made.lane.start()
    for name in ("one", "two"):
        await made.queue(name)
        await made.state(name, JobState.COMPLETED)
    await made.lane.stop()
    await library.close()
    assert (made.arm.opened, made.arm.closed) == (2, 2)

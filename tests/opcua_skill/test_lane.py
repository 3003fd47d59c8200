"""A lane writes states down before it tells, runs one job at a time, and leaves the arm at rest on every way out."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest
from scripted_arm import ScriptedArm, trace

from library.description import Failure, JobReport, JobState
from library.errors import LibraryUnusable, NotAllowedInState
from library.store import SkillLibrary
from opcua_skill.lane import Lane, NotAnyMore, Order
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

    async def keep(self, order: Order, trace: Trace) -> None:
        self.kept[order.job_id] = trace

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


class FullDisk:
    """Writes of a library that fail while ``full``, as SQLite's do."""

    def __init__(self, library: SkillLibrary, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self.refused = asyncio.Event()
        for name in ("move_job", "save_trace", "set_progress"):
            monkeypatch.setattr(library, name, self._guarded(getattr(library, name)))

    def _guarded(self, write: Any) -> Any:
        async def written(*arguments: Any, **fields: Any) -> Any:
            if self.full:
                self.refused.set()
                raise LibraryUnusable("skills.db", "database or disk is full", "free space")
            return await write(*arguments, **fields)

        return written


@pytest.fixture
def full_disk(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> FullDisk:
    return FullDisk(bench.library, monkeypatch)


@dataclass
class Guarded(Bench):
    """A lane whose jobs are asked for once more when their turn comes, and whose arm has to be brought home first."""

    asked_for_way: asyncio.Event = field(default_factory=asyncio.Event)
    way: "asyncio.Future[MotionPlan | None]" = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    not_any_more: str = ""

    async def may_still_run(self, _: JobReport) -> None:
        if self.not_any_more:
            raise NotAnyMore(Failure.NOT_DEPLOYED, self.not_any_more)

    async def way_home(self) -> MotionPlan | None:
        self.asked_for_way.set()
        return await self.way


@asynccontextmanager
async def lane_on(folder: Path) -> AsyncIterator[Guarded]:
    library = await SkillLibrary.open(folder / "skills.db")
    made = Guarded(library, ScriptedArm())
    made.lane = Lane(
        "test",
        library,
        lambda: made.arm,
        made.tell,
        keeps_arm_open=True,
        keep_trace=made.keep,
        may_still_run=made.may_still_run,
        way_home=made.way_home,
    )
    made.lane.start()
    yield made
    await made.lane.stop()
    await library.close()


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
    tip_and_joints = (await bench.library.trace("one")).measured
    assert tip_and_joints.shape == (3, 3 + 7)
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
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
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


async def test_a_protective_stop_without_a_job_still_stops_the_arm(bench: Bench) -> None:
    assert await bench.lane.protective_stop("light curtain") is None
    assert bench.arm.state().protective_stop


async def test_a_job_aborted_before_the_arm_moves_never_moves_it(tmp_path: Path) -> None:
    async with lane_on(tmp_path) as made:
        await made.queue("one")
        await made.asked_for_way.wait()
        assert (await made.lane.abort("one", "not needed")).state is JobState.STOPPING
        made.way.set_result(NO_PLAN)
        report = await made.state("one", JobState.ABORTED)
        assert (report.failure, report.message) == (Failure.ABORTED, "not needed")
        assert made.arm.runs == 0


async def test_a_job_that_may_not_run_any_more_fails_without_having_started(tmp_path: Path) -> None:
    async with lane_on(tmp_path) as made:
        made.not_any_more = "glue is not deployed any more"
        await made.queue("one")
        report = await made.state("one", JobState.FAILED)
        assert (report.failure, report.message) == (Failure.NOT_DEPLOYED, "glue is not deployed any more")
        assert (report.start_time, made.arm.runs) == (None, 0)


async def test_what_a_full_disk_did_not_take_is_told_once_it_is_back(bench: Bench, full_disk: FullDisk) -> None:
    await bench.queue("one")
    await bench.queue("two")
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
    await bench.queue("one")
    await bench.state("one", JobState.RUNNING)
    await asyncio.wait_for(bench.arm.running.wait(), LIMIT)
    full_disk.full = True
    with pytest.raises(LibraryUnusable):
        await bench.lane.abort("one", "operator pressed stop")
    async with asyncio.timeout(LIMIT):
        while not bench.arm.state().at_rest:
            await asyncio.sleep(0.01)
    full_disk.full = False
    report = await bench.state("one", JobState.ABORTED)
    assert report.message == "operator pressed stop"


async def test_a_server_that_stops_does_not_wait_for_a_full_disk(bench: Bench, full_disk: FullDisk) -> None:
    await bench.queue("one")
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

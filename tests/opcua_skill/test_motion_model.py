"""No motion begins without a request that is still wanted, and nothing that stops the arm is refused while it moves.

A model of a plant's day, played against the job engine and the methods in front of it: people ask, take back, pause and
release; the arm's own side pauses, fails, is lost and is pushed; the database is locked, full, or says something else;
the server is killed. Calls run at the same time, interleaved as hypothesis likes; nobody really waits, and the same
choices give the same day again. `tests/faults/test_motion_server.py`
plays the same day, slower, through real clients against a real server.
"""

import asyncio
import contextlib
import itertools
import os
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deployed_skill import seed
from drawn_motion import DrawnMotion
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from jumping_loop import JumpingLoop
from motion_ledger import Beginning, Call, Ledger
from pendant_arm import AWAY, PendantArm

from library.description import Cause, JobState
from library.errors import LibraryError, LibraryUnusable
from library.store import SkillLibrary
from opcua_skill.configuration.settings import Limits, Settings, Workstation
from opcua_skill.jobs import JobEngine
from opcua_skill.jobs.motion import completion, motion_queue, release, steering
from opcua_skill.jobs.planning import Planning
from opcua_skill.jobs.station import Station
from opcua_skill.security.access import Caller, Role, calling_as
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.features.homing import HomingMethods
from opcua_skill.server.features.queue import QueueMethods
from opcua_skill.server.features.workstation import WorkstationMethods
from opcua_skill.stack.services.calls import Refused
from sim.arm import ArmError
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.planner import plan_home, plan_motion
from sim.robots import load

STEPS = int(os.environ.get("OPCUA_SKILL_MOTION_STEPS", "5000"))
STEPS_A_DAY = 50
LIMIT = 20.0
ARM = load("panda")
MEMORY = Path("/dev/shm")
OLGA = Caller("olga", Role.ENGINEER, "session", "here")
REFUSALS = (Refused, LibraryError, ArmError)
SOON = st.sampled_from([0, 1, 2, 5, 20, None])
"""How many turns of the event loop pass before the next thing happens; None: until everything has come to rest."""


@lru_cache(maxsize=1)
def a_plan() -> MotionPlan:
    order = MotionOrder(time_step=0.02, timing="time_optimal", chord_tolerance=1e-3)
    return plan_motion(DrawnMotion(corners=((0.0, 0.0), (0.0, 0.03))), order, ARM, skill_digest="ab" * 32)


@lru_cache(maxsize=2)
def a_way_home(away: float) -> MotionPlan:
    return plan_home(ARM, (ARM.home[0] + away, *ARM.home[1:]))


class QuickPlanning(Planning):
    """Plans that differ in their name alone, without processes that work them out."""

    made = itertools.count()

    def __init__(self) -> None:
        pass

    async def warm_up(self) -> None:
        await asyncio.Event().wait()

    def close(self) -> None:
        pass

    async def plan(self, *_: object) -> MotionPlan:  # type: ignore[override]
        made = replace(a_plan(), recipe_id=f"r{next(self.made)}")
        await asyncio.sleep(0)
        return replace(made, digest=made.content_digest())

    async def plan_home(self, station: Station) -> MotionPlan:
        await asyncio.sleep(0)
        joints = station.arm.state().joints
        return a_way_home(AWAY if np.abs(np.array(joints) - np.array(ARM.home)).max() > 0.1 else 0.0)

    async def keep_trace(self, *_: object) -> None:
        await asyncio.sleep(0)


def remembered(look: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
    """Return a reader of what no day changes, such as the skill: it looks once and then remembers."""
    found: dict[Any, Any] = {}

    async def reader(*arguments: Any) -> Any:
        if arguments not in found:
            found[arguments] = await look(*arguments)
        await asyncio.sleep(0)
        return found[arguments]

    return reader


class Nobody:
    """Tidings for nobody."""

    async def protective_stop(self, *_: str) -> None:
        await asyncio.sleep(0)


async def nothing_to_tell(*_: object) -> None:
    await asyncio.sleep(0)


class Shift:
    """One server's life on a database: engine, methods and a disk that can be locked or full."""

    def __init__(self, folder: Path, arm: PendantArm) -> None:
        self.folder = folder
        self.arm = arm
        self.disk = "well"
        self.unlocked = asyncio.Event()
        self.unlocked.set()
        self.library: SkillLibrary
        self.engine: JobEngine

    async def start(self) -> None:
        self.library = await SkillLibrary.open(self.folder / "skills.db")
        database = self.library._database
        write = database.write

        async def guarded(work: Any) -> Any:
            await self.unlocked.wait()
            if self.disk == "full":
                raise LibraryUnusable("skills.db", "database or disk is full", "free space")
            return await write(work)

        database.write = guarded  # type: ignore[method-assign]
        for name in ("description", "deployed", "recipe", "default_recipe_id"):
            setattr(self.library, name, remembered(getattr(self.library, name)))
        plant = Settings(
            data=self.folder, workstations=(Workstation(driver="kinematic"),), limits=Limits(max_queued_jobs=6)
        )
        self.engine = JobEngine(
            self.library, plant, {"ws1": ARM}, lambda *_: self.arm, nothing_to_tell, nothing_to_tell,
            planning=QuickPlanning(),
        )  # fmt: skip
        await self.engine.start()
        self.station, lock = self.engine.stations["ws1"], ArmLock("ws1")
        self.work = WorkstationMethods(
            self.library, self.engine, self.station, lock, plant, Nobody(), nothing_to_tell  # type: ignore[arg-type]
        )  # fmt: skip
        self.queue = QueueMethods(self.station, lock)
        self.homing = HomingMethods(self.engine, self.station, lock)

    def mend(self) -> None:
        self.disk = "well"
        self.unlocked.set()

    async def stop(self) -> None:
        self.mend()
        await self.engine.stop()
        await self.library.close()


class Day(RuleBasedStateMachine):
    """A day at one workstation."""

    def __init__(self) -> None:
        super().__init__()
        self.patience = pytest.MonkeyPatch()
        for place, name, value in (
            (release, "PATIENCE", 0.01),
            (motion_queue, "PATIENCE", 0.01),
            (motion_queue, "LOOK_EVERY", 0.002),
            (motion_queue, "LOOK_EVERY_AT_REST", 0.002),
            (steering, "STOP_AGAIN", 0.002),
            (completion, "WRITE_AGAIN", 0.002),
            (completion, "WRITE_AGAIN_AT_MOST", 0.01),
            (release, "WRITE_AGAIN", 0.002),
            (release, "WRITE_AGAIN_AT_MOST", 0.01),
        ):
            self.patience.setattr(place, name, value)
        self.loop = JumpingLoop()
        self.ledger = Ledger()
        self.faults: list[str] = []
        self.pending: set[asyncio.Task[None]] = set()
        self.job_ids: list[str] = []
        self.recipe: Any = None
        self.day = Path(tempfile.mkdtemp(dir=MEMORY if MEMORY.is_dir() else None))
        self.scratch = Path(tempfile.mkdtemp(dir=self.day))
        self.shift: Shift

    def run(self, work: Awaitable[Any]) -> Any:
        async def limited() -> Any:
            async with asyncio.timeout(LIMIT):
                return await work

        return self.loop.run_until_complete(limited())

    def begins(self, kind: str, digest: str) -> None:
        self.ledger.began.append(Beginning(Call("").started, kind, digest, self.arm.handed if kind == "run" else 0))
        if kind == "run" and self.arm.state().override > self.shift.station.speed_override:
            self.faults.append("a run began faster than anybody asked for")

    @property
    def arm(self) -> PendantArm:
        return self.shift.arm

    @initialize(turns=st.sampled_from([0, 1, 4, 15]))
    def morning(self, turns: int) -> None:
        self.loop.turns = turns
        (self.scratch / "skills.db").write_bytes(seed())
        self.shift = Shift(self.scratch, PendantArm(ARM, self.begins))
        self.run(self.shift.start())
        self.recipe = self.run(self._recipe())

    async def _recipe(self) -> Any:
        return await self.shift.library.recipe(await self.shift.library.default_recipe_id("glue"))

    def launch(
        self,
        what: str,
        ask: Callable[[], Awaitable[Any]],
        soon: int | None,
        job_id: str = "",
        *,
        urgent: bool = False,
        excused: Callable[[], bool] = lambda: False,
    ) -> None:
        """Ask for something and go on after so many turns; ``urgent``: it may not be refused while the arm moves.

        ``excused`` is asked after a refusal: it was right all the same.
        """

        async def asking() -> None:
            call = self.ledger.call(what, job_id)
            motion = self.arm._motion
            digest = motion.plan.digest if motion is not None else ""
            runs = bool(digest) and job_id in ("", self.ledger.jobs.get(digest))
            must = urgent and runs
            hold = self.ledger.call("abort of what runs", job_id) if what == "abort" and must else None
            try:
                with calling_as(OLGA):
                    answer = await ask()
            except REFUSALS as refused:
                call.done(good=False)
                if must and not excused():
                    self.faults.append(f"{what} {job_id} was refused while the arm moved: {refused}")
                return
            if what == "execute":
                call.job_id = answer[0]
                self.job_ids.append(call.job_id)
                self.ledger.jobs[(await self.shift.library.job(call.job_id)).plan_digest] = call.job_id
            for one in filter(None, (call, hold)):
                one.done(good=True)

        task = self.loop.create_task(asking())
        self.pending.add(task)
        task.add_done_callback(self.pending.discard)
        self.go_on(soon)

    def go_on(self, soon: int | None) -> None:
        async def turns(count: int) -> None:
            for _ in range(count):
                await asyncio.sleep(0)

        self.run(self._settled() if soon is None else turns(soon))

    async def _settled(self) -> None:
        """Wait until every call has been answered, and the lane has done what it can; a locked disk is unlocked."""
        self.shift.unlocked.set()
        if self.pending:
            await asyncio.wait(set(self.pending))
        await asyncio.sleep(0.006)

    def until(self, what: str, true: Callable[[], bool]) -> None:
        async def wait() -> None:
            while not true():
                await asyncio.sleep(0.001)

        try:
            self.run(wait())
        except TimeoutError:
            raise AssertionError(f"within {LIMIT} s this did not come true: {what}") from None

    def a_job(self, pick: int) -> str:
        """Return one of the last jobs, or the one that runs."""
        motion = self.arm._motion
        running = self.ledger.jobs.get(motion.plan.digest) if motion is not None else None
        if pick % 2 and running:
            return running
        return self.job_ids[-1 - pick % min(len(self.job_ids), 4)] if self.job_ids else "none"

    def under_way(self, wanted: bool) -> None:
        """See to it that one job runs and another waits, if that is wanted: what follows then happens to them.

        A call that still goes on from earlier may pause the job in the moment it begins.
        """
        if not wanted or self.arm._motion is not None:
            return
        self.put_right()
        if not self.shift.station.queue.held:
            self.execute(None, 0)
            self.until("a job begins", lambda: self.arm._motion is not None or self.shift.station.queue.held)
            self.execute(None, 0)

    # What people ask for

    @rule(soon=SOON, latency=st.sampled_from([0, 1, 3, 30]))
    def execute(self, soon: int | None, latency: int) -> None:
        self.arm.latency = latency
        self.launch("execute", lambda: self.shift.work.execute_skill("glue", "", 2), soon)

    @rule(pick=st.integers(0, 9), soon=SOON, busy=st.booleans())
    def pause(self, pick: int, soon: int | None, busy: bool) -> None:
        self.under_way(busy)
        job_id = self.a_job(pick)
        lane = self.shift.station.lane

        def ends() -> bool:
            run = lane._running
            return run is None or run.over.is_set() or bool(run.stop_because) or not self.arm.moves

        self.launch(
            "pause", lambda: self.shift.work.pause_job(job_id, ""), soon, job_id, urgent=self.arm.moves, excused=ends
        )

    @rule(pick=st.integers(0, 9), soon=SOON, busy=st.booleans())
    def resume(self, pick: int, soon: int | None, busy: bool) -> None:
        self.under_way(busy)
        job_id = self.a_job(pick)
        self.launch("resume", lambda: self.shift.work.resume_job(job_id, ""), soon, job_id)

    @rule(pick=st.integers(0, 9), soon=SOON, busy=st.booleans())
    def abort(self, pick: int, soon: int | None, busy: bool) -> None:
        self.under_way(busy)
        job_id = self.a_job(pick)
        self.launch("abort", lambda: self.shift.work.abort_job(job_id, ""), soon, job_id, urgent=True)

    @rule(soon=SOON, busy=st.booleans(), gently=st.booleans())
    def stop_motion(self, soon: int | None, busy: bool = False, gently: bool = False) -> None:
        self.under_way(busy)
        stop = self.shift.homing.stop_motion if gently else self.shift.work.protective_stop
        self.launch("stop", lambda: stop(""), soon, urgent=True)

    @rule(soon=SOON)
    def reset(self, soon: int | None) -> None:
        self.launch("reset", lambda: self.shift.work.reset(""), soon)

    @rule(soon=SOON)
    def go_home(self, soon: int | None) -> None:
        self.launch("go home", lambda: self.shift.homing.go_home(""), soon)

    @rule(soon=SOON)
    def release(self, soon: int | None) -> None:
        self.launch("release", lambda: self.shift.queue.release_queue(""), soon)

    @rule(soon=SOON, busy=st.booleans())
    def hold(self, soon: int | None, busy: bool = False) -> None:
        self.under_way(busy)
        self.launch("hold", lambda: self.shift.queue.hold_queue(""), soon, urgent=True)

    @rule()
    def put_right(self) -> None:
        """Do what a person does who wants to go on: look, reset, send home, release."""
        self.shift.mend()
        self.arm.mend()
        for ask in (self.reset, self.go_home, self.arrive, self.release):
            ask(None)

    @rule(fraction=st.sampled_from([0.1, 0.5, 1.0]), soon=SOON)
    def override(self, fraction: float, soon: int | None) -> None:
        self.launch("override", lambda: self.shift.station.set_override(fraction), soon)

    # What the arm's own side does

    @rule(soon=SOON)
    def arrive(self, soon: int | None) -> None:
        self.arm.arrive()
        self.go_on(soon)

    @rule(busy=st.booleans())
    def pendant_pause(self, busy: bool) -> None:
        self.under_way(busy)
        if not self.arm.moves or self.shift.disk == "full" or not self.shift.unlocked.is_set():
            return
        homing = not self.arm._motion.plan.skill_digest  # type: ignore[union-attr]
        self.run(self._settled())
        if not self.arm.moves:
            return
        self.arm.pendant_pause()
        if not homing:
            self.until("a pause at the pendant holds the queue", lambda: self.shift.station.queue.held)
            self.ledger.hold("pendant pause")

    @rule(soon=SOON)
    def pendant_resume(self, soon: int | None) -> None:
        self.arm.pendant_resume()
        self.go_on(soon)

    @rule(how=st.sampled_from(["pendant_stop", "fault", "lose"]), soon=SOON, busy=st.booleans())
    def end_badly(self, how: str, soon: int | None, busy: bool) -> None:
        self.under_way(busy)
        moved = self.arm.moves and not self.arm._motion.ended.done()  # type: ignore[union-attr]
        getattr(self.arm, how)()
        if moved:
            self.ledger.hold(how)
        self.go_on(soon)

    @rule()
    def mend_the_cable(self) -> None:
        self.arm.mend()

    @rule()
    def push(self) -> None:
        self.run(self._settled())
        if self.shift.station.lane.busy_with or self.arm.state().at_rest is False:
            return
        self.arm.push()
        self.until("an arm that is pushed away holds the queue", lambda: self.shift.station.queue.held)
        self.ledger.hold("push")

    @rule()
    def forget_the_override(self) -> None:
        self.arm.let_override_rise()
        self.until("the override falls again", lambda: self.arm.state().override <= self.shift.station.speed_override)

    # What the disk and the machine do

    @rule(how=st.sampled_from(["locked", "full", "well"]), busy=st.booleans())
    def disk(self, how: str, busy: bool) -> None:
        self.under_way(busy)
        self.shift.mend()
        self.shift.disk = how
        if how == "locked":
            self.shift.unlocked.clear()

    @rule(
        statement=st.sampled_from(
            ["UPDATE jobs SET report = '[]'", "UPDATE jobs SET state = 'Failed'", "DELETE FROM jobs"]
        )
    )
    def somebody_writes_into_the_database(self, statement: str) -> None:
        self.under_way(True)
        motion = self.arm._motion
        job_id = self.ledger.jobs.get(motion.plan.digest) if motion is not None else None
        if job_id is None:
            return

        def write() -> None:
            with contextlib.closing(sqlite3.connect(self.shift.folder / "skills.db", timeout=LIMIT)) as other:
                other.execute(f"{statement} WHERE job_id = ?", (job_id,))
                other.commit()

        self.run(asyncio.to_thread(write))

    @rule(busy=st.booleans())
    def kill_the_server(self, busy: bool) -> None:
        self.under_way(busy)
        before = self.shift
        self.scratch = Path(tempfile.mkdtemp(dir=self.day))
        for name in ("skills.db", "skills.db-wal"):
            if (before.folder / name).exists():
                shutil.copy(before.folder / name, self.scratch / name)
        unfinished = self.arm._motion is not None
        after = Shift(self.scratch, self.arm.survivor(self.begins))
        for task in self.pending:
            task.cancel()
        self.run(before.stop())
        self.pending.clear()
        with contextlib.closing(sqlite3.connect(self.scratch / "skills.db")) as other:
            left = other.execute("SELECT count(*) FROM jobs WHERE state NOT IN ('Completed', 'Failed', 'Aborted')")
            unfinished = unfinished or left.fetchone()[0] > 0
            other.commit()
        self.shift = after
        self.run(after.start())
        assert not unfinished or after.station.queue.held, "what was unfinished does not hold the queue"
        if unfinished:
            self.ledger.hold("start with something unfinished")

    # What always holds

    @invariant()
    def every_motion_was_wanted(self) -> None:
        for began in self.ledger.began[-3:]:
            self.ledger.check(began)
        assert not self.faults, self.faults

    def teardown(self) -> None:
        try:
            if sys.exc_info()[0] is None:  # what failed in the day is told, not what it leaves for the evening
                self._evening()
        finally:
            self.run(self.shift.stop())
            self.loop.close()
            shutil.rmtree(self.day)
            self.patience.undo()

    def _evening(self) -> None:
        """Every motion of the day was wanted; put right what went wrong, and the next job runs."""
        self.shift.mend()
        self.arm.mend()
        self.run(self._settled())
        for began in self.ledger.began:
            self.ledger.check(began)
        self.arm.pendant_resume()
        self.stop_motion(None)
        self.until("the arm comes to rest", lambda: not self.shift.station.lane.busy_with)
        self.run(self._all_waiting_aborted())
        self.put_right()
        assert not self.shift.station.queue.held, self.shift.station.queue.status
        self.execute(None, 0)
        self.until("a job begins after the queue was released", lambda: self.arm.moves)
        self.arrive(None)
        self.until("it ends", lambda: not self.shift.station.lane.busy_with)
        assert self.run(self.shift.library.job(self.job_ids[-1])).state is JobState.COMPLETED
        assert self.shift.station.queue.status.because is Cause.NONE
        with contextlib.closing(sqlite3.connect(self.shift.folder / "skills.db")) as other:
            left = other.execute(
                "SELECT job_id, state FROM jobs WHERE state IN ('Running', 'Paused', 'Stopping') AND report != '[]'"
            ).fetchall()
        assert not left, left

    async def _all_waiting_aborted(self) -> None:
        with calling_as(OLGA), contextlib.suppress(*REFUSALS):
            for job_id in list(self.shift.station.lane._orders):
                await self.shift.work.abort_job(job_id, "")


TestDay = Day.TestCase
TestDay.settings = settings(
    max_examples=max(1, STEPS // STEPS_A_DAY),
    stateful_step_count=STEPS_A_DAY,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
TestDay.pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def test_one_reset_and_one_release_are_enough_where_the_cable_was_cut_when_the_server_started() -> None:
    day = Day()
    day.morning(0)
    day.end_badly("lose", None, False)
    day.kill_the_server(False)
    day.teardown()

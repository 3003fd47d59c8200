"""What every arm must do, as tests to inherit from: see docs/how-to/write-an-arm.md.

    class TestMyArm(ArmConformance):
        def make_arm(self): return MyArm(...)

Needs pytest with pytest-asyncio in its automatic mode. The plans are one straight line of 30 mm at 3 mm/s, 1 mm above
the plate of the arm's ``part_frame``, with its travel; the arm has to stand at home when it is opened. Where making
contact is slow, one arm can serve all tests: see ``keep_open``.
"""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import lru_cache

import numpy as np

from models.motion import Motion
from sim.arm import (
    Arm,
    ArmError,
    ArmFault,
    ArmMode,
    CommandRefused,
    Progress,
    StartRefused,
    Stopped,
    Trace,
    angles_between,
)
from sim.arm_model import ArmModel
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_home, plan_motion

LINE = 0.03


def straight_line(length: float = LINE, duration: float = 20.0) -> Motion:
    """Return a motion that is one straight line along x: a single component whose regression is exactly linear."""
    spread = np.array([1.0, duration, length, 0.0]) / math.sqrt(12.0)
    covariance = np.outer(spread, spread) + np.diag([0.0, 0.0, 1e-8, 1e-8])
    mean = np.array([0.5, 0.5 * duration, 0.5 * length, 0.0])
    return Motion(mean[None], covariance[None], "path", 2, duration, ((0.0, 1.0),), 0.01, "within")


def slanted_line(length: float = LINE, duration: float = 20.0, slant: float = math.radians(30.0)) -> Motion:
    """Return the straight line with a tool that leans more and more, up to ``slant`` about the part's y axis."""
    plain = straight_line(length, duration)
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    leaning = np.array([0.0, math.sin(0.5 * slant), 0.0, math.cos(0.5 * slant)])
    spread = np.concatenate([np.array([1.0, duration, length, 0.0]), leaning - upright]) / math.sqrt(12.0)
    covariance = np.outer(spread, spread) + np.diag([0.0, 0.0, *[1e-8] * 6])
    mean = np.concatenate([plain.means[0], 0.5 * (upright + leaning)])
    return replace(plain, means=mean[None], covariances=covariance[None])


@lru_cache(maxsize=8)
def slanted_plan(model: ArmModel) -> MotionPlan:
    """Return the plan of the line with a leaning tool on an arm, at 20 mm/s."""
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.02, frame=model.part_frame)
    return plan_motion(slanted_line(), order, model, skill_digest="1" * 64, recipe_id="conformance")


@lru_cache(maxsize=8)
def line_plan(model: ArmModel, speed: float = 0.003) -> MotionPlan:
    """Return the plan of the straight line on an arm."""
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=speed, frame=model.part_frame)
    return plan_motion(straight_line(), order, model, skill_digest="0" * 64, recipe_id="conformance")


class ArmConformance:
    """Inherit, give ``make_arm``, and loosen ``tracking`` or ``patience`` if the arm is a real one."""

    tracking = 1e-4
    """Largest distance in m of the measured nozzle from the commanded one."""
    turning = 1e-3
    """Largest angle in rad between the measured nozzle and the commanded one."""
    off_path = 1e-5
    """Largest distance in m by which pause, resume, override and stop may leave the path."""
    patience = 60.0
    """Longest time in s to wait for anything."""
    speed = 0.003
    """Speed in m/s along the line: the slower, the more time there is to do something to a running arm."""
    keep_open = False
    """Whether one arm is kept open for all tests of the class, brought home between them.

    The tests then have to share an event loop (``pytest.mark.asyncio(loop_scope="class")``) and ``let_go`` has to be
    called at their end.
    """
    _kept: Arm | None = None

    def make_arm(self) -> Arm:
        """Return an arm that is not open yet."""
        raise NotImplementedError

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Arm]:
        """Give an open arm at home and close it afterwards, or keep it, whatever happens."""
        cls = type(self)
        arm = cls._kept or self.make_arm()
        await arm.open()
        cls._kept = arm if cls.keep_open else None
        try:
            yield arm
        finally:
            if cls._kept is None or arm.state().mode is ArmMode.CLOSED:
                cls._kept = None
                await arm.close()
            else:
                await self.bring_home(arm)

    @classmethod
    async def let_go(cls) -> None:
        """Close the arm that was kept open, if there is one."""
        arm, cls._kept = cls._kept, None
        if arm is not None:
            await arm.close()

    async def bring_home(self, arm: Arm) -> None:
        """Stop an arm, acknowledge what is to be acknowledged, and bring it home at full speed."""
        await arm.stop("the test is over")
        if arm.state().mode is not ArmMode.IDLE:
            await arm.reset()
        await arm.set_override(1.0)
        if away(arm, np.array(arm.model.home)) > 1e-3:
            await arm.run(plan_home(arm.model, arm.state().joints), lambda _: None)

    def plan(self, arm: Arm) -> MotionPlan:
        """Return the plan of the straight line for an arm."""
        return line_plan(arm.model, self.speed)

    async def test_opening_and_closing_twice_is_as_good_as_once(self) -> None:
        arm = self.make_arm()
        assert arm.state().mode is ArmMode.CLOSED
        for _ in range(2):
            await arm.open()
        state = arm.state()
        assert (state.mode, state.at_rest, state.known) == (ArmMode.IDLE, True, True)
        assert np.abs(np.array(state.joints) - arm.model.home).max() < 2e-3
        for _ in range(2):
            await arm.close()
        assert arm.state().mode is ArmMode.CLOSED

    async def test_a_run_goes_through_every_sample_and_ends_at_rest_at_the_plans_end(self) -> None:
        async with self.opened() as arm:
            plan = self.plan(arm)
            trace = await arm.run(plan, lambda _: None)
            assert len(trace.times) == plan.samples
            assert np.abs(trace.joints_commanded - plan.joints).max() < 1e-9
            assert trace.tracking_error()[1] <= self.tracking
            assert angles_between(trace.orientation_commanded, plan.orientations).max() < 1e-6
            assert trace.orientation_error()[1] <= self.turning
            assert np.array_equal(trace.dispense, plan.dispense)
            assert trace.source
            state = arm.state()
            assert state.at_rest
            assert state.mode is ArmMode.IDLE
            assert np.abs(np.array(state.joints) - plan.joints[-1]).max() < 2e-3

    async def test_a_tool_that_leans_is_held_as_it_was_shown(self) -> None:
        async with self.opened() as arm:
            plan = slanted_plan(arm.model)
            trace = await arm.run(plan, lambda _: None)
            on_path = plan.orientations[plan.path_rows[0] : plan.path_rows[1] + 1]
            lean = angles_between(on_path, np.tile(on_path[0], (len(on_path), 1)))
            # An arm with fewer axes than that takes holds the nozzle as it can, and its plan tells so.
            told = any(finding.code == "NoIkSolution" for finding in plan.findings)
            assert told or abs(lean.max() - math.radians(30.0)) < 1e-3
            assert angles_between(trace.orientation_commanded, plan.orientations).max() < 1e-6
            assert trace.orientation_error()[1] <= self.turning
            assert trace.tracking_error()[1] <= self.tracking

    async def test_progress_rises_to_one_and_comes_at_most_twenty_times_a_second(self) -> None:
        async with self.opened() as arm:
            told: list[tuple[float, Progress]] = []
            began = time.monotonic()
            await arm.run(self.plan(arm), lambda progress: told.append((time.monotonic(), progress)))
            took = time.monotonic() - began
            fractions = [progress.fraction for _, progress in told]
            assert fractions == sorted(fractions)
            assert fractions[-1] == 1.0
            assert len(told) <= 20 * took + 3

    async def test_a_closed_arm_refuses(self) -> None:
        arm = self.make_arm()
        error = await refusal(arm.run(self.plan(arm), lambda _: None))
        assert isinstance(error, StartRefused)

    async def test_a_plan_that_is_not_whole_or_not_for_this_arm_is_refused_and_nothing_moves(self) -> None:
        async with self.opened() as arm:
            plan = self.plan(arm)
            broken = plan.joints.copy()
            broken[len(broken) // 2, 0] = np.nan
            poisoned = replace(plan, joints=broken)
            shifted = replace(plan, joints=plan.joints + 1e-6)
            bad = {
                "NaN, digest made to fit": replace(poisoned, digest=poisoned.content_digest()),
                "changed after it was checked": shifted,
                "without a digest": replace(plan, digest=""),
                "made for another arm": line_plan(replace(arm.model, name=f"not {arm.model.name}"), self.speed),
                "made for this arm as it was once": line_plan(replace(arm.model, digest="0" * 64), self.speed),
            }
            before = arm.state().joints
            for what, plan in bad.items():
                error = await refusal(arm.run(plan, lambda _: None))
                assert isinstance(error, StartRefused), what
                assert error.failure == "ParameterInvalid", what
                assert arm.state().joints == before, what
                assert arm.state().mode is ArmMode.IDLE, what

    async def test_two_runs_at_once_are_refused(self) -> None:
        async with self.running() as (arm, run):
            error = await refusal(arm.run(self.plan(arm), lambda _: None))
            assert isinstance(error, StartRefused)
            assert error.failure == "Busy"
            assert not run.done()

    async def test_a_pause_rests_on_the_path_and_only_resume_ends_it(self) -> None:
        async with self.running() as (arm, run):
            await arm.pause("a look")
            state = arm.state()
            assert (state.mode, state.at_rest) == (ArmMode.PAUSED, True)
            error = await refusal(arm.run(self.plan(arm), lambda _: None))
            assert isinstance(error, StartRefused)
            await arm.set_override(0.9)
            assert arm.state().mode is ArmMode.PAUSED
            await arm.set_override(1.0)
            await arm.resume()
            trace = await asyncio.wait_for(run, self.patience)
            assert left_path(trace, self.plan(arm), arm.model) <= self.off_path
            slower = (trace.override < 1.0 - 1e-6) | (trace.override == 0.0)
            assert slower.any()
            assert not trace.dispense[slower].any(), "the valve was open while the nozzle slowed for a pause"
            assert (np.diff(trace.path_times) >= 0.0).all(), "the arm went back on its path"
            assert trace.tracking_error()[1] <= self.tracking
            assert arm.state().at_rest

    async def test_a_stop_rests_on_the_path_and_says_who_wished_it(self) -> None:
        async with self.running() as (arm, run):
            await arm.stop("operator pressed stop")
            assert arm.state().at_rest
            ended = await outcome(run)
            assert isinstance(ended, Stopped)
            assert ended.because == "operator pressed stop"
            assert left_path(ended.trace, self.plan(arm), arm.model) <= self.off_path
            assert not ended.trace.dispense[ended.trace.override < 1.0 - 1e-6].any()
            assert not ended.trace.dispense[-1]
            assert arm.state().mode is ArmMode.IDLE

    async def test_a_stop_ends_a_pause(self) -> None:
        async with self.running() as (arm, run):
            await arm.pause("a look")
            await arm.stop("that was enough")
            assert isinstance(await outcome(run), Stopped)
            assert arm.state().mode is ArmMode.IDLE

    async def test_a_stop_in_the_approach_rests_too(self) -> None:
        async with self.opened() as arm:
            plan = self.plan(arm)
            run = asyncio.create_task(arm.run(plan, lambda _: None))
            await self.until(lambda: away(arm, plan.joints[0]) > 1e-3)
            await arm.stop("changed my mind")
            ended = await outcome(run)
            assert isinstance(ended, Stopped)
            assert ended.trace.path_times[-1] < plan.duration
            assert arm.state().at_rest

    async def test_after_a_stop_the_arm_asks_to_be_brought_home_first(self) -> None:
        async with self.running() as (arm, run):
            await arm.stop("operator pressed stop")
            await outcome(run)
            error = await refusal(arm.run(self.plan(arm), lambda _: None))
            assert isinstance(error, StartRefused)
            await arm.run(plan_home(arm.model, arm.state().joints), lambda _: None)
            assert away(arm, np.array(arm.model.home)) < 2e-3
            await arm.run(line_plan(arm.model, 0.02), lambda _: None)

    async def test_cancelling_stops_the_arm(self) -> None:
        async with self.running() as (arm, run):
            run.cancel()
            assert isinstance(await outcome(run), asyncio.CancelledError)
            await self.until(lambda: arm.state().at_rest and arm.state().mode is ArmMode.IDLE)

    async def test_closing_in_mid_motion_ends_the_run(self) -> None:
        async with self.running() as (arm, run):
            await arm.close()
            assert isinstance(await outcome(run), Stopped | ArmFault)
            assert arm.state().mode is ArmMode.CLOSED

    async def test_an_override_out_of_range_is_refused_and_changes_nothing(self) -> None:
        async with self.opened() as arm:
            for fraction in (0.0, -0.5, 2.0, math.nan, math.inf):
                error = await refusal(arm.set_override(fraction))
                assert isinstance(error, CommandRefused), fraction
                assert error.failure == "ParameterInvalid"
                assert arm.state().override == 1.0

    async def test_an_override_slows_the_run_down_on_the_same_path(self) -> None:
        async with self.running() as (arm, run):
            plan = self.plan(arm)
            await arm.set_override(0.5)
            trace = await asyncio.wait_for(run, self.patience)
            assert trace.times[-1] > plan.duration * 1.05
            assert trace.override.min() >= 0.5 - 1e-9
            assert abs(float(trace.path_times[-1]) - plan.duration) < 1e-6
            assert left_path(trace, plan, arm.model) <= self.off_path
            await arm.set_override(1.0)

    async def test_a_protective_stop_holds_until_it_is_reset(self) -> None:
        async with self.running() as (arm, run):
            await arm.protective_stop("somebody reached in")
            state = arm.state()
            assert (state.at_rest, state.protective_stop, state.mode) == (True, True, ArmMode.PROTECTIVE_STOP)
            ended = await outcome(run)
            assert isinstance(ended, ArmFault)
            assert ended.failure == "ProtectiveStop"
            error = await refusal(arm.run(plan_home(arm.model, state.joints), lambda _: None))
            assert isinstance(error, StartRefused)
            assert error.failure == "ProtectiveStop"
            await arm.reset()
            assert arm.state().mode is ArmMode.IDLE
            assert away(arm, np.array(state.joints)) < 1e-3
            await arm.run(plan_home(arm.model, arm.state().joints), lambda _: None)

    async def test_commands_without_a_run_are_refused_and_a_stop_at_rest_changes_nothing(self) -> None:
        async with self.opened() as arm:
            await arm.stop("nothing to stop")
            assert arm.state().mode is ArmMode.IDLE
            for command in (arm.pause("nothing to pause"), arm.resume()):
                assert isinstance(await refusal(command), CommandRefused)

    @asynccontextmanager
    async def running(self) -> "AsyncIterator[tuple[Arm, asyncio.Task[Trace]]]":
        """Give an arm in the middle of the learned path, with its run."""
        async with self.opened() as arm:
            plan = self.plan(arm)
            middle = plan.joints[sum(plan.path_rows) // 4]
            seen: list[float] = []
            run = asyncio.create_task(arm.run(plan, lambda progress: seen.append(progress.time)))
            start = float(plan.times[plan.path_rows[0]])
            await self.until(lambda: bool(seen and seen[-1] > start) or away(arm, middle) < 5e-3 or run.done())
            assert not run.done(), "the run was over before anything could be tried: make the arm slower"
            try:
                yield arm, run
            finally:
                await arm.stop("the test is over")
                await asyncio.wait({run}, timeout=self.patience)

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for a condition, with a limit."""
        limit = time.monotonic() + self.patience
        while not condition():
            assert time.monotonic() < limit, "waited in vain"
            await asyncio.sleep(0.001)


def away(arm: Arm, joints: np.ndarray) -> float:
    """Return how far in rad the arm's joints are from others, the worst joint."""
    return float(np.abs(np.array(arm.state().joints) - joints).max())


def left_path(trace: Trace, plan: MotionPlan, model: ArmModel) -> float:
    """Return how far in m the commanded nozzle ever was from the plan's own way on this arm."""
    tool = kinematics(model).forward(trace.joints_commanded)[0]
    rows = np.clip(np.searchsorted(plan.times, trace.path_times) - 1, 0, plan.samples - 2)
    start, chord = plan.tool[rows], plan.tool[rows + 1] - plan.tool[rows]
    size = np.maximum((chord**2).sum(axis=1), 1e-30)
    part = np.clip(((tool - start) * chord).sum(axis=1) / size, 0.0, 1.0)
    return float(np.sqrt(((tool - start - part[:, None] * chord) ** 2).sum(axis=1)).max())


async def refusal(command: Awaitable[object]) -> ArmError:
    """Return the error with which a command was refused."""
    try:
        await command
    except ArmError as error:
        return error
    raise AssertionError("it was not refused")


async def outcome(run: "asyncio.Task[Trace]") -> BaseException:
    """Return the exception with which a run ended."""
    await asyncio.wait({run}, timeout=60.0)
    assert run.done(), "the run did not end"
    if run.cancelled():
        return asyncio.CancelledError()
    error = run.exception()
    assert error is not None, "the run ended as if nothing had happened"
    return error

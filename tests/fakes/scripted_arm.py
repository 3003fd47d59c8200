"""An arm that does what a test tells it to: the smallest thing that fits ``sim.arm.Arm``."""

import asyncio
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim.arm import ArmFault, ArmMode, ArmState, CommandRefused, Progress, StartRefused, Stopped, Trace
from sim.arm_model import ArmModel
from sim.plan import MotionPlan
from sim.robots import load

STILL = ArmState(load("panda").home, (0.4, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0), True, ArmMode.IDLE, False, "", True)


def trace(samples: int = 3, off: float = 1e-4) -> Trace:
    """Return a trace whose measured nozzle is ``off`` m beside the commanded one."""
    times = np.arange(samples) * 0.01
    joints, tool = np.zeros((samples, 7)), np.zeros((samples, 3))
    return Trace(
        times,
        times,
        joints,
        joints,
        tool,
        tool + np.array([off, 0.0, 0.0]),
        np.zeros(samples, dtype=bool),
        np.ones(samples),
    )


class ScriptedArm:
    """Runs until ``finish`` is set; ``fault`` makes the run end with it, ``refusal`` keeps it from starting.

    A run that was asked for begins once ``begins`` is set, which it is unless a test clears it.
    """

    def __init__(self) -> None:
        self.model: ArmModel = load("panda")
        self.now = STILL
        self.runs = 0
        self.opened = 0
        self.closed = 0
        self.finish = asyncio.Event()
        self.running = asyncio.Event()
        self.fault: ArmFault | None = None
        self.refusal: StartRefused | None = None
        self.silent = ""
        self.asked, self.begins = asyncio.Event(), asyncio.Event()
        self.begins.set()
        self._stop_because = ""

    def be_silent(self, because: str) -> None:
        """Be an arm that does not answer until ``silent`` is empty again."""
        self.silent, self.now = because, replace(STILL, mode=ArmMode.CLOSED)

    async def open(self) -> None:
        if self.silent:
            raise ArmFault("Timeout", self.silent)
        self.opened += 1
        self.now = STILL

    async def close(self) -> None:
        self.closed += 1

    def state(self) -> ArmState:
        return self.now

    async def run(self, plan: MotionPlan, on_progress: Callable[[Progress], None]) -> Trace:
        if self.refusal is not None:
            raise self.refusal
        self.asked.set()
        await self.begins.wait()
        self.runs += 1
        self._stop_because = ""
        self.now = replace(STILL, mode=ArmMode.RUNNING, at_rest=False)
        self.running.set()
        on_progress(Progress(0.5, 1.0, "dispense"))
        try:
            await self.finish.wait()
        finally:
            self.now = STILL
            self.running.clear()
        if self.fault is not None:
            raise self.fault
        if self._stop_because:
            raise Stopped(self._stop_because, trace(2))
        return trace()

    async def pause(self, because: str) -> None:
        if self.now.mode is not ArmMode.RUNNING:
            raise CommandRefused("Busy", "nothing runs")
        self.now = replace(self.now, mode=ArmMode.PAUSED, at_rest=True)

    async def resume(self) -> None:
        self.now = replace(self.now, mode=ArmMode.RUNNING, at_rest=False)

    async def stop(self, because: str) -> None:
        if self.running.is_set():
            self._stop_because = because
            self.finish.set()

    async def protective_stop(self, because: str) -> None:
        await self.stop(because)
        self.now = replace(STILL, mode=ArmMode.PROTECTIVE_STOP, protective_stop=True)

    async def set_override(self, fraction: float) -> None:
        self.now = replace(self.now, override=fraction)

    async def reset(self) -> None:
        self.now = STILL

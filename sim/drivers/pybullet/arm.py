"""The PyBullet arm as the job engine sees it. PyBullet lives in a process of its own and never blocks this one."""

import asyncio
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from sim.arm import ArmFault, ArmMode, ArmState, CommandRefused, Progress, StartRefused, Stopped, Trace
from sim.arm_model import ArmModel
from sim.drivers.execution import Recorder
from sim.drivers.preconditions import check_override, check_start
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics
from sim.pose import pose_of
from sim.testing.disturbances import Imperfection

OPENING = 60.0
SILENCE = 15.0
PATIENCE = 5.0


class PyBulletArm:
    """An ``Arm`` simulated by PyBullet. ``realtime`` paces it like a real one; else it runs as fast as it can.

    When its process dies, the run fails at once, with the trace of what was told until then, and the arm is unknown
    until ``reset``, which starts a new one: the arm stands where it was last known to be.
    """

    def __init__(self, model: ArmModel, realtime: bool = True, imperfection: Imperfection | None = None) -> None:
        self.model = model
        self._realtime = realtime
        self._imperfection = imperfection
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None
        self._sending = asyncio.Lock()
        self._finished: asyncio.Future[tuple[Any, ...]] | None = None
        self._on_progress: Callable[[Progress], None] | None = None
        self._plan: MotionPlan | None = None
        self._kept: Recorder | None = None
        self._heard = 0.0
        self._turn = asyncio.Event()
        self._closing = False
        self._now = ArmState(
            joints=model.home, tool_pose=pose_of(kinematics(model), kinematics(model).seed), at_rest=True,
            mode=ArmMode.CLOSED, protective_stop=False, fault="", known=True,
        )  # fmt: skip

    @property
    def process_id(self) -> int | None:
        """Return the id of the simulating process, None while there is none."""
        return self._process.pid if self._process is not None else None

    async def open(self) -> None:
        """Start the process; the arm stands where it was left, at home the first time."""
        if self._process is not None:
            return
        self._closing = False
        loop = asyncio.get_running_loop()
        opened: asyncio.Future[tuple[Any, ...]] = loop.create_future()
        self._finished = opened
        process, pipe = await asyncio.to_thread(self._start)
        self._process, self._pipe = process, pipe
        threading.Thread(target=self._listen, args=(loop, process, pipe), daemon=True).start()
        try:
            _, joints = await asyncio.wait_for(asyncio.shield(opened), OPENING)
        except TimeoutError:
            await self._end_process()
            raise ArmFault("Timeout", f"PyBullet did not start within {OPENING:.0f} s") from None
        finally:
            self._finished = None
        await self._send("override", self._now.override)
        self._set(mode=ArmMode.IDLE, joints=joints, at_rest=True, known=True, fault="", protective_stop=False)

    async def close(self) -> None:
        """Stop, then end the process; may be called at any time."""
        if self._process is None:
            return
        self._closing = True
        if self._finished is not None:
            await self.stop("the arm was closed")
        await self._end_process()
        self._set(mode=ArmMode.CLOSED)

    def state(self) -> ArmState:
        """Return the latest known state at once."""
        return self._now

    async def run(self, plan: MotionPlan, on_progress: Callable[[Progress], None]) -> Trace:
        """Run a plan to its end; see ``Arm.run``."""
        check_start(self.model, self._now, plan)
        if self._process is None:
            raise StartRefused("Internal", f"{self.model.name} is not connected: open it first")
        self._plan, self._on_progress = plan, on_progress
        finished = self._finished = asyncio.get_running_loop().create_future()
        how = f", {self._imperfection.label()}" if self._imperfection else ""
        source = f"{self.model.name}, simulated by PyBullet until its process ended{how}"
        kept = self._kept = Recorder(self.model, source)
        self._set(mode=ArmMode.RUNNING, at_rest=False)
        self._heard = time.monotonic()
        try:
            await self._send("run", plan)
            ended = await self._end_of(finished)
        except ArmFault as fault:
            trace = await asyncio.to_thread(kept.trace) if len(kept) else None
            raise ArmFault(fault.failure, fault.text, trace) from None
        except asyncio.CancelledError:
            await asyncio.shield(self.stop("the run was cancelled"))
            raise
        finally:
            if finished.done():
                self._finished = None
            self._kept = None
            self._tell()
        _, failure, reason, trace, _ = ended
        if failure:
            raise ArmFault(failure, reason, trace)
        if reason:
            raise Stopped(reason, trace)
        on_progress(Progress(1.0, plan.duration, plan.segments[-1].stage))
        return trace

    async def pause(self, because: str) -> None:
        """Slow down to rest on the path; return when at rest."""
        self._need_run("pause")
        await self._send("pause")
        await self._until(ArmMode.PAUSED)

    async def resume(self) -> None:
        """Go on after a pause."""
        self._need_run("resume")
        if self._now.mode is not ArmMode.PAUSED:
            raise CommandRefused("ParameterInvalid", f"{self.model.name} is not paused")
        await self._send("resume")
        await self._until(ArmMode.RUNNING)

    async def stop(self, because: str) -> None:
        """Come to rest on the path and end the run; return when at rest."""
        await self._stop(because, "")

    async def protective_stop(self, because: str) -> None:
        """Come to rest and refuse to move until reset."""
        self._set(protective_stop=True, fault=because)
        if self._finished is None:
            self._set(mode=ArmMode.PROTECTIVE_STOP)
        await self._stop(because, "ProtectiveStop")

    async def set_override(self, fraction: float) -> None:
        """Run slower, or at full speed again."""
        check_override(fraction)
        self._set(override=fraction)
        if self._process is not None:
            await self._send("override", fraction)

    async def reset(self) -> None:
        """Acknowledge a protective stop; after the process died start a new one, where the arm was last."""
        if self._finished is not None:
            raise CommandRefused("Busy", f"{self.model.name} is {self._now.mode}: stop it before a reset")
        if not self._now.known:
            await self._end_process()
            await self.open()
        elif self._now.mode is ArmMode.PROTECTIVE_STOP:
            self._set(protective_stop=False, fault="", mode=ArmMode.IDLE)

    def _start(self) -> tuple[subprocess.Popen[bytes], Connection]:
        ours, theirs = socket.socketpair()
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-m", "sim.drivers.pybullet.worker", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        pipe = Connection(ours.detach())
        pipe.send((self.model, self._now.joints, self._realtime, self._imperfection))
        return process, pipe

    def _listen(self, loop: asyncio.AbstractEventLoop, process: subprocess.Popen[bytes], pipe: Connection) -> None:
        """Bring messages of the process to the event loop, on a thread of its own, until it ends."""
        try:
            while True:
                message = pipe.recv()
                loop.call_soon_threadsafe(self._take, process, message)
        except (EOFError, OSError, pickle.UnpicklingError):
            try:
                code = process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._lost, process, code)

    def _take(self, process: subprocess.Popen[bytes], message: tuple[Any, ...]) -> None:
        if process is not self._process:
            return
        self._heard = time.monotonic()
        match message:
            case ("progress", float(at), joints, rows):
                self._set(joints=joints)
                if self._kept is not None:
                    self._kept.extend(rows)
                if self._plan is not None and self._on_progress is not None and self._finished is not None:
                    self._on_progress(Progress(at / self._plan.duration, at, self._plan.stage_at(at)))
            case ("phase", "paused", joints):
                self._set(mode=ArmMode.PAUSED, joints=joints, at_rest=True)
            case ("phase", "running", _):
                self._set(mode=ArmMode.RUNNING, at_rest=False)
            case ("finished", failure, reason, _, joints):
                protective = self._now.protective_stop or failure == "ProtectiveStop"
                known = bool(joints)
                mode = ArmMode.PROTECTIVE_STOP if protective else ArmMode.IDLE if known else ArmMode.FAULT
                self._set(
                    mode=mode, joints=joints or self._now.joints, at_rest=True, known=known,
                    protective_stop=protective, fault=reason if protective or not known else "",
                )  # fmt: skip
                self._settle(message)
            case _:
                self._settle(message)
        self._tell()

    def _lost(self, process: subprocess.Popen[bytes], code: int) -> None:
        if process is not self._process:
            return
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
        text = f"the arm's process ended ({how}): the arm's position is unknown until it is reset"
        if not self._closing:
            self._set(mode=ArmMode.FAULT, known=False, fault=text, at_rest=True)
        if self._finished is not None and not self._finished.done():
            self._finished.set_exception(ArmFault("Interrupted", text))
        self._tell()

    async def _end_of(self, finished: "asyncio.Future[tuple[Any, ...]]") -> tuple[Any, ...]:
        """Wait for the end of a run; a process that says nothing for long is ended, which fails the run by name."""
        while True:
            done, _ = await asyncio.wait({finished}, timeout=1.0)
            if done:
                return finished.result()
            silent = time.monotonic() - self._heard
            if silent > SILENCE and self._now.mode is not ArmMode.PAUSED and self._process is not None:
                self._process.kill()

    async def _stop(self, because: str, failure: str) -> None:
        finished = self._finished
        if finished is None or finished.done():
            return
        if self._now.mode is not ArmMode.STOPPING:
            self._set(mode=ArmMode.STOPPING)
            await self._send("stop", because, failure)
        await asyncio.wait({finished})
        if not finished.cancelled():
            finished.exception()
        self._finished = None

    async def _send(self, *message: Any) -> None:
        """Send a message; big ones are packed and written off the event loop."""
        async with self._sending:
            pipe = self._pipe
            if pipe is None:
                return
            try:
                if message[0] == "run":
                    await asyncio.to_thread(pipe.send, message)
                else:
                    pipe.send(message)
            except OSError:
                return

    async def _end_process(self) -> None:
        process, pipe = self._process, self._pipe
        if process is None or pipe is None:
            return
        await self._send("close")
        try:
            await asyncio.to_thread(process.wait, PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            await asyncio.to_thread(process.wait)
        self._process = self._pipe = None
        pipe.close()

    async def _until(self, mode: ArmMode) -> None:
        """Wait until the run has ended or the arm is in a mode."""
        finished = self._finished
        while finished is not None and not finished.done() and self._now.mode is not mode:
            await self._turn.wait()

    def _need_run(self, command: str) -> None:
        if self._finished is None:
            raise CommandRefused("ParameterInvalid", f"{self.model.name} runs nothing: there is nothing to {command}")

    def _settle(self, message: tuple[Any, ...]) -> None:
        if self._finished is not None and not self._finished.done():
            self._finished.set_result(message)

    def _set(self, **changes: Any) -> None:
        if "joints" in changes:
            changes["joints"] = tuple(float(value) for value in changes["joints"])
            changes["tool_pose"] = pose_of(kinematics(self.model), np.array(changes["joints"]))
        self._now = replace(self._now, **changes)

    def _tell(self) -> None:
        """Wake everybody who waits for a change."""
        self._turn.set()
        self._turn = asyncio.Event()

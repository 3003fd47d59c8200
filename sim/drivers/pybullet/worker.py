"""The PyBullet arm's own process: takes plans and commands from a pipe, simulates, tells what happens.

Started as ``python -m sim.drivers.pybullet.worker DESCRIPTOR``. It ends when the pipe does, or when its parent is gone,
so nothing is left behind by a parent that was killed.
"""

import os
import queue
import sys
import threading
import time
import traceback
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import scipy.interpolate  # noqa: F401 - used by what runs here: not loaded while something moves
import scipy.ndimage  # noqa: F401

from sim.arm_model import ArmModel, Floats
from sim.drivers.execution import Execution, Phase, Recorder
from sim.drivers.monitor import Monitor
from sim.drivers.pybullet.world import AT_REST, BulletWorld
from sim.plan import MotionPlan
from sim.testing.disturbances import Imperfection

PARENT_PERIOD = 0.5
PROGRESS_PERIOD = 0.06
AHEAD = 0.002
SETTLE = 0.3
Message = tuple[Any, ...]


class Worker:
    """Runs one plan at a time. Commands come in on a thread of their own; the simulation has the main one."""

    def __init__(
        self, pipe: Connection, model: ArmModel, joints: Floats, realtime: bool, imperfection: Imperfection | None
    ) -> None:
        self._pipe = pipe
        self._world = BulletWorld(model)
        self._world.place(joints)
        self._model = model
        self._realtime = realtime
        self._imperfection = imperfection
        self._override = 1.0
        self._commands: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._source = f"{model.name}, simulated by PyBullet" + (
            f", {imperfection.label()}" if imperfection else ": says nothing about a real arm"
        )

    def listen(self, parent: int) -> None:
        """Take commands from the pipe until it ends; then end the process, whatever it is doing."""
        try:
            while True:
                if self._pipe.poll(PARENT_PERIOD):
                    self._commands.put(self._pipe.recv())
                elif os.getppid() != parent:
                    os._exit(0)
        except (EOFError, OSError):
            os._exit(0)

    def serve(self) -> None:
        """Obey commands until told to close."""
        self._pipe.send(("opened", tuple(self._world.measure()[0])))
        while True:
            command, *values = self._commands.get()
            if command == "close":
                self._world.close()
                return
            if command == "run":
                self._run(values[0])
            elif command == "override":
                self._override = values[0]

    def _run(self, plan: MotionPlan) -> None:
        execution = Execution(plan, self._model, self._override)
        recorder = Recorder(self._model, self._source)
        try:
            self._simulate(execution, recorder)
        except Exception as error:
            traceback.print_exc()
            self._pipe.send(("finished", "Internal", f"the simulation failed: {error}", recorder.trace(), ()))
            return
        joints, _ = self._world.measure()
        self._pipe.send(
            ("finished", execution.failure, execution.stop_reason, recorder.trace(), tuple(joints.tolist()))
        )

    def _simulate(self, execution: Execution, recorder: Recorder) -> None:
        world, dt = self._world, execution.dt
        faults = self._imperfection.begin(execution.plan.joints[0], dt) if self._imperfection else None
        monitor = Monitor(execution.plan, recorder)
        world.begin(execution.plan.joints[0], dt)
        now = execution.plan.joints[0]
        recorder.add(execution, now, world.measure()[0])
        began, told, ticks = time.monotonic(), 0.0, 0
        while execution.phase is not Phase.ENDED:
            self._obey(execution, recorder)
            if execution.phase is Phase.ENDED:
                break
            before, now = now, execution.tick()
            if faults is None:
                world.step(before, now, dt)
            else:
                world.step(*faults.command(before, now), dt)
            ticks += 1
            if ticks % execution.ticks_a_row == 0 or execution.phase is Phase.ENDED:
                measured, _ = world.measure()
                if not np.isfinite(measured).all():
                    raise ValueError("the simulated joints are not numbers any more")
                recorder.add(execution, now, measured if faults is None else faults.measure(measured))
                monitor.look(execution)
            wall = time.monotonic()
            if wall - told > PROGRESS_PERIOD:
                told = wall
                self._tell(execution, recorder)
            ahead = execution.clock - (wall - began)
            if self._realtime and ahead > AHEAD:
                time.sleep(ahead)
        for _ in range(int(SETTLE / dt)):
            world.step(now, now, dt)
            if np.abs(world.measure()[1]).max() < AT_REST:
                break

    def _tell(self, execution: Execution, recorder: Recorder) -> None:
        """Tell where the arm is, and what was recorded since: the trace of a run outlives this process."""
        at = tuple(recorder.measured().tolist())
        self._pipe.send(("progress", execution.path_time, at, recorder.new_rows()))

    def _obey(self, execution: Execution, recorder: Recorder) -> None:
        """Take what has been commanded; wait while paused."""
        joints = execution.joints()
        paused = execution.phase is Phase.PAUSED
        if paused:
            recorder.add(execution, joints, self._world.measure()[0])
            self._tell(execution, recorder)
        began = time.monotonic()
        while execution.phase is Phase.PAUSED or not self._commands.empty():
            if execution.phase is Phase.PAUSED and self._commands.empty():
                self._pipe.send(("phase", "paused", tuple(self._world.measure()[0].tolist())))
            command, *values = self._commands.get()
            if command == "pause":
                execution.pause()
            elif command == "resume":
                execution.resume()
                self._pipe.send(("phase", "running", ()))
            elif command == "stop":
                execution.stop(values[0], values[1])
            elif command == "override":
                self._override = values[0]
                execution.set_override(values[0])
            elif command == "close":
                execution.stop("the arm was closed")
                self._commands.put(("close",))
                break
        if paused:
            execution.rest(time.monotonic() - began)
            recorder.add(execution, joints, self._world.measure()[0])


def main() -> None:
    """Serve the pipe whose descriptor is the first argument; the model comes as its first message."""
    pipe = Connection(int(sys.argv[1]))
    parent = os.getppid()
    try:
        model, joints, realtime, imperfection = pipe.recv()
        worker = Worker(pipe, model, np.array(joints), realtime, imperfection)
        threading.Thread(target=worker.listen, args=(parent,), daemon=True).start()
        worker.serve()
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        os._exit(0)


if __name__ == "__main__":
    main()

"""What the server itself saw of a run: stands in for the arm's own trace where that was lost with the arm."""

import time
from dataclasses import dataclass, field

import numpy as np

from sim.arm import ArmState, Trace
from sim.plan import MotionPlan

SOURCE = "as the server saw it: the arm's own record was lost"


@dataclass
class OwnRecord:
    """States of the arm as they were told: s of the machine's clock, s along the plan, and what was measured then."""

    _times: list[float] = field(default_factory=list)
    _path_times: list[float] = field(default_factory=list)
    _states: list[ArmState] = field(default_factory=list)

    def note(self, path_time: float, state: ArmState) -> None:
        """Note where the arm is; a state that is not known is none."""
        if state.known:
            self._times.append(time.monotonic())
            self._path_times.append(path_time)
            self._states.append(state)

    def trace(self, plan: MotionPlan) -> Trace | None:
        """Return what was seen beside what the plan commands at the same place; None if nothing was seen."""
        if not self._times:
            return None
        path_times = np.array(self._path_times)

        def planned(columns: np.ndarray) -> np.ndarray:
            return np.column_stack([np.interp(path_times, plan.times, column) for column in columns.T])

        rows = np.clip(np.searchsorted(plan.times, path_times, side="right") - 1, 0, plan.samples - 1)
        return Trace(
            times=np.array(self._times) - self._times[0],
            path_times=path_times,
            joints_commanded=planned(plan.joints),
            joints_measured=np.array([state.joints for state in self._states]),
            tool_commanded=planned(plan.tool),
            tool_measured=np.array([state.tool_pose[:3] for state in self._states]),
            dispense=plan.dispense[rows],
            override=np.array([state.override for state in self._states]),
            source=SOURCE,
        )

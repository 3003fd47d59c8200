"""Watching a run: is the nozzle where it was sent, and inside what the people who showed the skill did themselves?"""

import numpy as np

from sim.drivers.execution import Execution, Recorder
from sim.plan import MotionPlan

EVERY = 0.01
# A spread of zero across the plate, or between identical demonstrations, must not make any deviation infinite: 0.05 mm.
FLOOR = (5e-5) ** 2


class Monitor:
    """Looks at a run about every 10 ms and stops it, or tells, when the order's tolerances are left."""

    def __init__(self, plan: MotionPlan, recorder: Recorder) -> None:
        self._plan = plan
        self._recorder = recorder
        self._order = plan.order
        self._rows = max(1, round(EVERY / plan.order.time_step))
        self._seen = 0
        self._outside = False
        first, last = plan.path_rows
        self._span = (plan.times[first], plan.times[last]) if last > first else (1.0, 0.0)
        self._inverse = np.linalg.inv(plan.covariances + FLOOR * np.eye(3)) if plan.order.tube_sigmas else np.empty(0)

    def look(self, execution: Execution) -> None:
        """Look at what is new, if it is enough to be worth it."""
        new = len(self._recorder) - self._seen
        if new < self._rows or not (self._order.max_deviation or self._order.tube_sigmas):
            return
        self._seen = len(self._recorder)
        times, commanded, measured = self._recorder.last(new)
        away = measured - commanded
        distance = np.sqrt((away**2).sum(axis=1))
        if self._order.max_deviation and distance.max() > self._order.max_deviation:
            execution.stop(
                f"the nozzle was {distance.max() * 1e3:.3f} mm from where it was sent, "
                f"{self._order.max_deviation * 1e3:.3f} mm are allowed",
                "ToleranceExceeded",
            )
            return
        inside = (times >= self._span[0]) & (times <= self._span[1])
        if not self._order.tube_sigmas or not inside.any():
            return
        rows = np.rint((times[inside] - self._span[0]) / self._order.time_step).astype(int)
        shape = self._inverse[np.clip(rows, 0, len(self._inverse) - 1)]
        sigmas = float(np.sqrt(np.einsum("ni,nij,nj->n", away[inside], shape, away[inside]).max()))
        if sigmas <= self._order.tube_sigmas:
            self._outside = False
            return
        text = f"the nozzle left the skill's tube: {sigmas:.1f} sigma, {self._order.tube_sigmas:g} are allowed"
        if self._order.tube_policy == "stop":
            execution.stop(text, "ToleranceExceeded")
        elif not self._outside:
            self._recorder.events.append((execution.clock, text))
        self._outside = True

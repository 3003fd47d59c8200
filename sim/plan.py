"""A motion plan: every sample an arm will be sent, checked, hashed and never changed.

What was dry-run is what runs.
"""

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np

from sim.arm_model import Bools, Floats, Stage
from sim.findings import Finding
from sim.order import MotionOrder


@dataclass(frozen=True, slots=True)
class Segment:
    """Samples ``first`` to ``last`` of a plan, both included; neighbours share a sample."""

    stage: Stage
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class ValveEvent:
    """The valve opens or closes.

    At ``time`` in s of the plan, lead included, for the place ``arc_length`` m along the path.
    """

    opens: bool
    time: float
    arc_length: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionPlan:
    """All an arm needs to run a skill once, from home to home.

    One row every ``order.time_step`` seconds: ``times`` (n,), ``joints`` and ``velocities`` (n, dof), ``tool`` (n, 3)
    nozzle tip in the base frame, ``orientations`` (n, 4) the nozzle's unit quaternions x y z w there (z out of the
    tip), ``phases`` (n,) along the learned path, NaN off it, ``dispense`` (n,) valve open, lead included. Between
    samples an arm follows the cubic through positions and velocities. ``valve`` (v, 2) holds plan times of opening
    and closing without lead. ``covariances`` (m, 3, 3) belong to the samples of ``path_rows``.

    ``path_error`` is the RMS and largest distance in m of the exact learned path from straight lines between the
    samples. ``digest`` covers everything else here.
    """

    arm: str
    arm_digest: str
    skill_digest: str
    recipe_id: str
    order: MotionOrder
    times: Floats
    joints: Floats
    velocities: Floats
    tool: Floats
    orientations: Floats
    phases: Floats
    dispense: Bools
    segments: tuple[Segment, ...]
    valve: Floats
    valve_events: tuple[ValveEvent, ...]
    path_rows: tuple[int, int]
    covariances: Floats
    path_error: tuple[float, float]
    findings: tuple[Finding, ...]
    report: dict[str, float] = field(repr=False)
    digest: str = ""

    @property
    def samples(self) -> int:
        """Number of time steps commanded."""
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time in s from the first sample to the last."""
        return float(self.times[-1])

    def stage_at(self, time: float) -> Stage:
        """Return what is being done at a time in s of the plan."""
        row = int(np.searchsorted(self.times, time))
        for segment in self.segments:
            if row <= segment.last:
                return segment.stage
        return self.segments[-1].stage

    def content_digest(self) -> str:
        """Return the SHA-256 over the plan's content in hex; a plan whose ``digest`` differs has been changed."""
        told = hashlib.sha256()
        for entry in fields(self):
            if entry.name != "digest":
                value = getattr(self, entry.name)
                content = (
                    np.ascontiguousarray(value).tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
                )
                told.update(f"{entry.name}:{len(content)}:".encode() + content)
        return told.hexdigest()


def valve_open(valve: Floats, times: Floats, lead: Floats | float) -> Bools:
    """Return whether the valve is open at plan times (n,), opening and closing ``lead`` s early."""
    ahead = times + lead
    inside = np.zeros(len(times), dtype=bool)
    for opens, closes in valve:
        inside |= (ahead >= opens - 1e-9) & (ahead < closes - 1e-9)
    return inside

"""What the joints really do between the samples of a plan: the cubic through positions and velocities, row by row.

The velocities are those of the spline with continuous acceleration through the samples (clamped at rest). So velocity
is largest at a sample or where the acceleration is zero, acceleration at a sample, and jerk is constant in each row.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from sim.arm_model import Floats, Limits

# Rows from which an end of the spline is felt at the other by less than the last bit.
FELT = 48


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """The largest size of velocity, acceleration and jerk of every joint in every row of a plan: each (n - 1, dof).

    Rad or m, by s, s² and s³.
    """

    velocity: Floats
    acceleration: Floats
    jerk: Floats

    def shares(self, limits: Limits) -> tuple[Floats, Floats, Floats]:
        """Return which share of its limit each is: three times (n - 1, dof)."""
        return (
            self.velocity / np.array(limits.velocity),
            self.acceleration / np.array(limits.acceleration),
            self.jerk / np.array(limits.jerk),
        )

    def excess(self, limits: Limits) -> Floats:
        """Return by what factor each row (n - 1,) is too fast: run so much slower, it keeps every limit."""
        velocity, acceleration, jerk = (share.max(axis=1, initial=0.0) for share in self.shares(limits))
        return np.maximum(np.maximum(velocity, np.sqrt(acceleration)), np.cbrt(jerk))


def spline_velocities(joints: Floats, step: float) -> Floats:
    """Return the velocities (n, dof) at samples ``step`` s apart, at rest at both ends."""
    if len(joints) < 3:
        return np.zeros_like(joints)
    times = np.arange(len(joints), dtype=np.float64) * step
    found = scipy.interpolate.CubicSpline(times, joints, bc_type="clamped")(times, 1)
    found[0] = found[-1] = 0.0
    return found


def rates(joints: Floats, velocities: Floats, step: float) -> Rates:
    """Return what the joints do in every row between samples (n, dof) with velocities (n, dof)."""
    way = np.diff(joints, axis=0) / step
    before, after = velocities[:-1], velocities[1:]
    first = (6.0 * way - 4.0 * before - 2.0 * after) / step
    last = (2.0 * before + 4.0 * after - 6.0 * way) / step
    jerk = (last - first) / step
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = np.where((first * last < 0.0), np.abs(before - 0.5 * first**2 / jerk), 0.0)
    velocity = np.maximum(np.maximum(np.abs(before), np.abs(after)), inside)
    return Rates(velocity, np.maximum(np.abs(first), np.abs(last)), np.abs(jerk))


def eased(joints: Floats, step: float) -> Floats:
    """Return samples (n, dof) whose spline begins and ends without acceleration: rows 1 and n - 2 give way for it."""
    n = len(joints)
    if n < 5:
        return joints
    times = np.arange(n, dtype=np.float64) * step
    ends = scipy.interpolate.CubicSpline(times, joints, bc_type="clamped")(times[[0, -1]], 2)
    short = min(n, FELT)
    unit = np.zeros((short, 2))
    unit[1, 0] = unit[-2, 1] = 1.0
    clock = times[:short]
    answer = scipy.interpolate.CubicSpline(clock, unit, bc_type="clamped")(clock[[0, -1]], 2)
    if short < n:
        answer[0, 1] = answer[1, 0] = 0.0
    moved = joints.copy()
    moved[[1, -2]] -= np.linalg.solve(answer, ends)
    return moved

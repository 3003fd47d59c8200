"""Which time law an order asks for along a learned path, and what has to be slowed or refused for an arm to keep it."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim import checks
from sim.arm import ArmModel, Floats
from sim.checks import Finding, MotionRefused
from sim.holding import Holding
from sim.kinematics import kinematics
from sim.path import ToolPath
from sim.timing import JointPath, SteadyLaw, TimeLaw, fastest, law_speed, steady

if TYPE_CHECKING:
    from sim.plan import MotionOrder

STEADY_SHARE = 0.98
LATER = 1.1
# Slower than this share of the speed asked for is no constant speed any more: refused whatever the order says.
SLOWEST_SHARE = 0.2
CORNER_SHARE = 0.25
TRIALS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A path as an arm follows it, on a grid of arc lengths (g,).

    Phases, the people's times in s, joints, speed ceiling.
    """

    path: ToolPath
    lengths: Floats
    phases: Floats
    shown: Floats
    joints: JointPath
    ceiling: Floats


def law_for(
    path: ToolPath, order: "MotionOrder", arm: ArmModel, held: Holding, step: float
) -> tuple[TimeLaw | SteadyLaw, list[Finding]]:
    """Return the time law an order asks for, and what was slowed down for it. ``step`` is one sample's time on the law.

    Constant speed runs straight into the path and out of it, so that the speed is the same from its first point to
    its last. Every other law begins and ends at rest at the path's own ends. Raises ``MotionRefused``.
    """
    if order.timing == "constant_speed":
        return _constant(path, order, arm, held, step)
    followed = _follow(path, 0.0, order, arm, held, step)
    if order.timing == "time_optimal":
        return _quickest(followed, np.full(len(followed.lengths), math.inf), arm), []
    return _demonstrated(followed, order, arm)


def _follow(path: ToolPath, extra: float, order: "MotionOrder", arm: ArmModel, held: Holding, step: float) -> Followed:
    """Return an arm's way along a path and ``extra`` m straight on before and after it.

    Refuses what cannot be reached.
    """
    spacing = path.length / (len(path.lengths) - 1)
    lengths = np.linspace(-extra, path.length + extra, len(path.lengths) + 2 * math.ceil(extra / spacing))
    points, phases = path.points(lengths), path.phases_at(lengths)
    shown = path.motion.times_at(phases)
    solved = kinematics(arm).inverse(points, held.at_lengths(lengths))
    paced = shown * ((order.duration or path.motion.duration) / path.motion.duration)
    found = checks.check_reach(arm, points, solved, paced, phases)
    if held.as_shown and any(finding.code == "NoIkSolution" for finding in found):
        lost = ~solved.reached
        if kinematics(arm).inverse(points[lost], held.upright).reached.all():
            found[0] = checks.blame_tilt(arm, found[0], float(held.tilts(phases[lost][:1])[0]))
    found = found or checks.check_posture(arm, solved.joints, paced, phases)
    if found:
        raise MotionRefused(found)
    joints = JointPath(lengths, solved.joints)
    ceiling = joints.ceiling(arm.limits)
    with np.errstate(divide="ignore"):
        by_chord = 0.95 * np.sqrt(8.0 * order.chord_tolerance / curvature(path, lengths)) / step
        for i, angle in sharp_corners(path, lengths):
            allowed = (CORNER_SHARE * np.array(arm.limits.acceleration) / (joints.first[i] * angle)).min() * step
            ceiling[i] = min(ceiling[i], float(allowed))
    return Followed(path, lengths, phases, shown, joints, np.minimum(ceiling, by_chord))


def _quickest(followed: Followed, wanted: Floats, arm: ArmModel) -> TimeLaw:
    return fastest(followed.joints, arm.limits, arm.path_limits, wanted, followed.ceiling)[0]


def _demonstrated(followed: Followed, order: "MotionOrder", arm: ArmModel) -> tuple[TimeLaw, list[Finding]]:
    """Return the people's own pace, scaled to the time asked for; told where an arm cannot keep it."""
    shown, path = followed.shown, followed.path
    pace = np.diff(followed.lengths) / np.maximum(np.diff(shown), 1e-9)
    natural = np.minimum(np.concatenate([[pace[0]], pace]), np.concatenate([pace, [pace[-1]]]))
    wanted = order.duration or (path.length / order.speed if order.speed > 0.0 else float(shown[-1]))
    scale = float(shown[-1]) / wanted
    law = _quickest(followed, natural * scale, arm)
    for _ in range(TRIALS):
        if abs(law.duration - wanted) < 1e-3 * wanted:
            break
        better = scale * law.duration / wanted
        trial = _quickest(followed, natural * better, arm)
        if trial.duration > law.duration - 1e-6 and law.duration > wanted:
            break
        scale, law = better, trial
    if law.duration > LATER * wanted and (order.duration or order.speed):
        text = f"the path cannot be run in {wanted:.3g} s: {arm.name} needs at least {law.duration:.3g} s"
        raise MotionRefused([Finding("SpeedLimit", math.nan, math.nan, law.duration - wanted, "s", text)])
    top = np.minimum(followed.ceiling, arm.path_limits.speed)
    excess = natural * scale / top
    if excess.max() <= 1.01:
        return law, []
    i = int(excess.argmax())
    text = (
        f"slowed to {top[i] * 1e3:.0f} mm/s at {100 * followed.phases[i]:.1f} % of the path, where the people's "
        f"pace is {natural[i] * scale * 1e3:.0f} mm/s: {arm.name} cannot turn faster there"
    )
    place = float(shown[i]), float(followed.phases[i])
    return law, [Finding("SpeedLimit", *place, float(top[i]) * 1e3, "mm/s", text, fatal=False)]


def _constant(
    path: ToolPath, order: "MotionOrder", arm: ArmModel, held: Holding, step: float
) -> tuple[TimeLaw | SteadyLaw, list[Finding]]:
    """Return constant speed over the whole path.

    Refuse it, or slow down in corners and tell, where it is impossible.
    """
    bounds = arm.path_limits
    asked = order.speed * 1e3
    if order.speed > bounds.speed:
        most = bounds.speed * 1e3
        text = f"speed is {asked:.0f} mm/s: the nozzle of {arm.name} may go {most:.0f} mm/s at most"
        raise MotionRefused([Finding("SpeedLimit", 0.0, 0.0, asked - most, "mm/s", text)])
    law = steady(path.length, order.speed, step, bounds)
    followed = _follow(path, -law.start, order, arm, held, step)
    grid = np.linspace(0.0, law.duration, int(np.clip(law.duration / 5e-4, 200, 200_000)))
    at, factor = followed.joints.excess(law, arm.limits, grid)
    highest = STEADY_SHARE * order.speed / np.maximum(factor, 1e-9)
    for corner, _ in sharp_corners(path, followed.lengths):
        here = np.abs(at - followed.lengths[corner]).argmin()
        highest[here] = min(highest[here], followed.ceiling[corner])
    i = int(np.argmin(np.where((at >= 0.0) & (at <= path.length), highest, math.inf)))
    if highest[i] >= order.speed and factor.max() <= 1.0:
        return law, []
    phase = float(path.phases_at(at[i : i + 1])[0])
    time, allowed = float(grid[i]) - law.ramp, float(highest[i])
    what = f"at {time:.2f} s, {100 * phase:.1f} % of the path, a corner allows {allowed * 1e3:.0f} mm/s"
    short = asked - allowed * 1e3
    if order.corners == "slow":
        followed = _follow(path, 0.0, order, arm, held, step)
        slower = _quickest(followed, np.full(len(followed.lengths), order.speed), arm)
        inner = (followed.phases > 0.02) & (followed.phases < 0.98)
        lowest = float(law_speed(slower, followed.lengths)[inner].min()) * 1e3
        if lowest >= SLOWEST_SHARE * asked:
            text = f"slowed from {asked:.0f} to {lowest:.0f} mm/s in corners, begun and ended at rest: {what}"
            return slower, [Finding("SpeedLimit", time, phase, short, "mm/s", text, fatal=False)]
    text = f"constant {asked:.0f} mm/s is impossible: {what}: lower the speed, or give a blend radius"
    raise MotionRefused([Finding("SpeedLimit", time, phase, short, "mm/s", text)])


def curvature(path: ToolPath, lengths: Floats) -> Floats:
    """Return the curvature (g,) in 1/m of the nozzle's way."""
    points = path.points(lengths)
    first = np.gradient(points, lengths, axis=0)
    second = np.gradient(first, lengths, axis=0)
    return np.sqrt((np.cross(first, second) ** 2).sum(axis=1))


def sharp_corners(path: ToolPath, lengths: Floats) -> list[tuple[int, float]]:
    """Return grid indices at which the path has a corner without radius, and the angle in rad it turns there."""
    points = path.points(lengths)
    way = np.diff(points, axis=0)
    way /= np.maximum(np.sqrt((way**2).sum(axis=1, keepdims=True)), 1e-15)
    turn = np.arccos(np.clip((way[1:] * way[:-1]).sum(axis=1), -1.0, 1.0))
    spacing = float(lengths[1] - lengths[0])
    found: list[tuple[int, float]] = []
    for i in np.flatnonzero(turn > 0.1) + 1:
        fine = path.points(np.linspace(lengths[i] - spacing, lengths[i] + spacing, 65))
        short = np.diff(fine, axis=0)
        short /= np.maximum(np.sqrt((short**2).sum(axis=1, keepdims=True)), 1e-15)
        sudden = np.arccos(np.clip((short[2:] * short[:-2]).sum(axis=1), -1.0, 1.0)).max()
        if sudden > 0.5 * turn[i - 1]:
            found.append((int(i), float(sudden)))
    return found

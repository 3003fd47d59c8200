"""What is looked at before anything moves. A finding names the place on the path, by how much, and what to do."""

import math

import numpy as np

from sim.arm_model import ArmModel, Floats
from sim.findings import Finding
from sim.order import MotionOrder
from sim.planning.kinematics import InverseResult, kinematics
from sim.planning.rates import Rates

SHORTEST_STEP, LONGEST_STEP = 1e-3, 20e-3
NOZZLE_TURNS = ("shown", "free")
TIMINGS = ("demonstrated", "constant_speed", "time_optimal")
OF_THE_LIMIT = "of the limit"
# Smallest singular value of the Jacobian (m and rad): below it a slow nozzle needs joints some thirty times faster.
SINGULAR = 0.03
HIGHEST_LIFT = 0.5
LARGEST_PART = 5.0
UNIT = 1e-3
POSTURE_JUMP = 0.5
# In degrees: from what lean on an arm of few axes tells that it cannot hold the nozzle so, and refuses.
TOLD_LEAN, MOST_LEAN = 0.1, 45.0
MOST_SAMPLES = 1_000_000


def invalid(name: str, value: object, allowed: str, size: float = math.nan, unit: str = "") -> Finding:
    """Return the finding that a field of the order is out of range."""
    return Finding("ParameterInvalid", math.nan, math.nan, size, unit, f"{name} is {value}: it has to be {allowed}")


def check_order(order: MotionOrder) -> list[Finding]:
    """Return every field of an order that is not a number or out of its range, in the order of the fields."""
    found: list[Finding] = []

    def need(name: str, value: float, low: float, high: float, allowed: str) -> None:
        if not (math.isfinite(value) and low <= value <= high):
            found.append(invalid(name, value, allowed, value))

    if not (math.isfinite(order.time_step) and SHORTEST_STEP * (1 - 1e-9) <= order.time_step <= LONGEST_STEP):
        found.append(invalid("time step", f"{order.time_step} s", "from 0.001 s to 0.020 s", order.time_step, "s"))
    if order.timing not in TIMINGS:
        found.append(invalid("timing", repr(order.timing), f"one of {', '.join(TIMINGS)}"))
    need("duration", order.duration, 0.0, 3600.0, "from 0 s (as learned) to 3600 s")
    need("speed", order.speed, 0.0, 1.0, "from 0 to 1 m/s")
    if order.timing == "constant_speed" and order.speed == 0.0:
        found.append(invalid("speed", "0 m/s", "more than 0 m/s for a constant speed", 0.0, "m/s"))
    for name, value in (("speed override", order.speed_override), ("speed fraction", order.speed_fraction)):
        if not (math.isfinite(value) and 0.0 < value <= 1.0):
            found.append(invalid(name, value, "more than 0 and at most 1", value))
    need("standoff", order.standoff, 0.0, HIGHEST_LIFT, f"from 0 m to {HIGHEST_LIFT} m")
    need("approach height", order.approach_height, 0.0, HIGHEST_LIFT, f"from 0 m to {HIGHEST_LIFT} m")
    need("retract height", order.retract_height, 0.0, HIGHEST_LIFT, f"from 0 m to {HIGHEST_LIFT} m")
    need("dispense lead", order.dispense_lead, -1.0, 1.0, "from -1 s to 1 s")
    need("largest deviation", order.max_deviation, 0.0, 1.0, "from 0 (not watched) to 1 m")
    need("chord tolerance", order.chord_tolerance, 1e-6, 1.0, "from 0.001 mm to 1 m")
    need("blend radius", order.blend_radius, 0.0, 0.1, "from 0 m to 0.1 m")
    for name, value in (("part's x", order.part_x), ("part's y", order.part_y)):
        need(name, value, -LARGEST_PART, LARGEST_PART, f"from {-LARGEST_PART:g} m to {LARGEST_PART:g} m")
    for name, value in (("part's length", order.part_length), ("part's width", order.part_width)):
        need(name, value, 0.0, LARGEST_PART, f"from 0 (not known) to {LARGEST_PART:g} m")
    need("tube", order.tube_sigmas, 0.0, 100.0, "from 0 (not watched) to 100 standard deviations")
    if order.nozzle_turn not in NOZZLE_TURNS:
        found.append(invalid("nozzle turn", repr(order.nozzle_turn), f"one of {', '.join(NOZZLE_TURNS)}"))
    if len(order.frame) != 7 or not all(math.isfinite(value) for value in order.frame):
        found.append(invalid("frame", list(order.frame), "seven finite numbers: x y z in m, then a quaternion x y z w"))
    else:
        norm = math.sqrt(sum(value**2 for value in order.frame[3:]))
        if abs(norm - 1.0) > UNIT:
            found.append(invalid("frame's quaternion", f"of length {norm:.6g}", "of length 1", norm))
    return found


def check_reach(model: ArmModel, points: Floats, solved: InverseResult, times: Floats, phases: Floats) -> list[Finding]:
    """Return whether every point (n, 3) is inside the workspace box, reached, and reached within the joints' limits."""
    found: list[Finding] = []
    low, high = np.array(model.workspace_low), np.array(model.workspace_high)
    outside = np.maximum(np.maximum(low - points, points - high), 0.0).max(axis=1)
    if outside.max(initial=0.0) > 1e-9:
        i = int(np.argmax(outside > 1e-9))
        worst = float(outside.max()) * 1e3
        x, y, z = points[i] * 1e3
        text = (
            f"the nozzle leaves the workspace of {model.name} {_place(times[i], phases[i])}, at x {x:.1f} y {y:.1f} "
            f"z {z:.1f} mm, by up to {worst:.1f} mm: move the part's frame"
        )
        found.append(Finding("WorkspaceLimit", float(times[i]), float(phases[i]), worst, "mm", text))
    lost = ~solved.reached
    if lost.any():
        i = int(np.argmax(lost))
        miss = float(solved.position_error.max()) * 1e3
        turn = math.degrees(float(solved.angle_error.max()))
        text = (
            f"{model.name} cannot reach {int(lost.sum())} of {len(lost)} points of the path, the first "
            f"{_place(times[i], phases[i])} (point {i}), and misses by up to {miss:.1f} mm and {turn:.1f} degrees: "
            "move the part's frame nearer"
        )
        return [Finding("NoIkSolution", float(times[i]), float(phases[i]), miss, "mm", text, limit=0.0), *found]
    found += check_joints(model, solved.joints, times, phases)
    return found


def blame_tilt(model: ArmModel, lost: Finding, tilt: float) -> Finding:
    """Return what is told instead of a miss where the same points are reached with the nozzle upright: the tilt."""
    degrees = math.degrees(tilt)
    text = (
        f"{model.name} reaches the path with the nozzle upright, but not tilted by {degrees:.0f} degrees as it was "
        f"shown {_place(lost.time, lost.phase)}: move or turn the part's frame, let the nozzle turn freely about its "
        "axis, or teach with less tilt"
    )
    return Finding("NoIkSolution", lost.time, lost.phase, degrees, "degrees", text, asked=degrees)


def check_posture(model: ArmModel, joints: Floats, times: Floats, phases: Floats) -> list[Finding]:
    """Return whether an arm would have to jump to another posture between two places next to each other.

    ``joints`` (n, dof) belong to places a tenth of a millimetre apart: no way that an arm can follow turns a joint by
    much in between.
    """
    jumps = np.abs(np.diff(joints, axis=0))
    if jumps.max(initial=0.0) < POSTURE_JUMP:
        return []
    i, joint = (int(k) for k in np.unravel_index(int(jumps.argmax()), jumps.shape))
    size = math.degrees(float(jumps[i, joint]))
    text = (
        f"{model.name} would have to change its posture {_place(times[i], phases[i])}, where joint {joint + 1} "
        f"jumps by {size:.0f} degrees: move or turn the part's frame, or tilt the nozzle less"
    )
    return [Finding("Singularity", float(times[i]), float(phases[i]), size, "degrees", text, joint=joint + 1)]


def check_joints(model: ArmModel, joints: Floats, times: Floats, phases: Floats) -> list[Finding]:
    """Return the joint that leaves its range first, if any, over joints (n, dof)."""
    over = np.maximum(np.array(model.limits.lower) - joints, joints - np.array(model.limits.upper))
    if over.max(initial=-1.0) <= 0.0:
        return []
    i = int(np.argmax((over > 0.0).any(axis=1)))
    joint = int(np.argmax(over[i]))
    row = int(over[:, joint].argmax())
    value, low, high = float(joints[row, joint]), model.limits.lower[joint], model.limits.upper[joint]
    slides = bool(kinematics(model).slides[joint])
    scale, unit = (1e3, "mm") if slides else (math.degrees(1.0), "degrees")
    worst = float(over[row, joint]) * scale
    text = (
        f"joint {joint + 1} of {model.name} leaves its range {_place(times[i], phases[i])} by up to {worst:.2f} "
        f"{unit}: move or turn the part's frame"
    )
    limit = scale * (high if value > high else low)
    place = float(times[i]), float(phases[i])
    return [Finding("JointLimit", *place, worst, unit, text, asked=scale * value, limit=limit, joint=joint + 1)]


def singular_values(model: ArmModel, joints: Floats) -> Floats:
    """Return the smallest singular value (n,) of the Jacobian at joints (n, dof)."""
    values = np.linalg.svd(kinematics(model).jacobian(joints), compute_uv=False)
    return np.asarray(values[:, -1], dtype=np.float64)


def check_singularity(model: ArmModel, joints: Floats, times: Floats, phases: Floats) -> tuple[list[Finding], float]:
    """Return whether joints (n, dof) come near a singular position, and the smallest singular value.

    It matters where the nozzle has to follow a line in space; a joint move may pass such a position at any speed.
    """
    if not len(joints):
        return [], math.inf
    smallest = singular_values(model, joints)
    i = int(np.argmin(smallest))
    least = float(smallest[i])
    if least >= SINGULAR:
        return [], least
    text = (
        f"{model.name} is stretched out or folded {_place(times[i], phases[i])}: its smallest singular value is "
        f"{least:.4f}, at least {SINGULAR} is needed: move the part's frame"
    )
    place = float(times[i]), float(phases[i])
    return [Finding("Singularity", *place, least, "", text, asked=least, limit=SINGULAR)], least


def check_rates(model: ArmModel, rates: Rates, times: Floats, phases: Floats) -> tuple[list[Finding], dict[str, float]]:
    """Return whether the joints keep velocity, acceleration and jerk in every row, and the largest shares used."""
    found: list[Finding] = []
    used: dict[str, float] = {}
    for name, share in zip(("velocity", "acceleration", "jerk"), rates.shares(model.limits), strict=True):
        used[name] = float(share.max(initial=0.0))
        if used[name] > 1.0:
            i, joint = (int(k) for k in np.unravel_index(int(share.argmax()), share.shape))
            text = (
                f"joint {joint + 1} of {model.name} would need {used[name]:.2f} times its {name} limit "
                f"{_place(times[i], phases[i])}: go slower, or give the corners a blend radius"
            )
            place = float(times[i]), float(phases[i])
            share, joint = used[name], joint + 1
            found.append(Finding("SpeedLimit", *place, share, OF_THE_LIMIT, text, asked=share, limit=1.0, joint=joint))
    return found, used


def slowed_whole(model: ArmModel, factor: float) -> Finding:
    """Return what is told where a path had to be run slower as a whole."""
    text = (
        f"the whole path is run {factor:.2f} times slower than its timing: {model.name} needs that between two samples"
    )
    return Finding("SpeedLimit", math.nan, math.nan, factor, "times", text, fatal=False, asked=1.0, limit=1.0 / factor)


def check_lean(model: ArmModel, wanted: Floats, held: Floats, phases: Floats) -> list[Finding]:
    """Return by how much a nozzle leans that few axes cannot hold as it should be held: told, or refused if too much.

    ``wanted`` and ``held`` are rotations (n, 3, 3) at ``phases`` (n,).
    """
    cosine = np.clip((wanted[:, :, 2] * held[:, :, 2]).sum(axis=1), -1.0, 1.0)
    i = int(cosine.argmin())
    lean = math.degrees(math.acos(float(cosine[i])))
    if lean < TOLD_LEAN:
        return []
    axes = kinematics(model).dof
    text = (
        f"{model.name} has {axes} axes: its nozzle leans by up to {lean:.1f} degrees from how it should be held "
        f"at {100 * phases[i]:.1f} % of the path"
    )
    fatal = lean > MOST_LEAN
    return [
        Finding(
            "NoIkSolution", math.nan, float(phases[i]), lean, "degrees", text, fatal=fatal, asked=lean, limit=MOST_LEAN
        )
    ]


def check_samples(count: float) -> list[Finding]:
    """Return whether a path takes more time steps than can be planned: it crawls through a corner, say."""
    if count <= MOST_SAMPLES:
        return []
    text = (
        f"the path would take {count:.3g} time steps: it has to be at most {MOST_SAMPLES}, go faster or use longer "
        "steps"
    )
    many = Finding("ParameterInvalid", math.nan, math.nan, count, "time steps", text, asked=count, limit=MOST_SAMPLES)
    return [many]


def check_hull(model: ArmModel) -> list[Finding]:
    """Return whether nothing is known of an arm's shape though nobody said that collisions are not to be checked."""
    if model.capsules or not model.collisions_checked:
        return []
    text = (
        f"{model.name} has no hull: nothing would keep it from touching itself, the table or the part: give its limits "
        "file a [hull] with capsules, or say in the workstation's configuration that collisions are not checked"
    )
    return [Finding("ParameterInvalid", math.nan, math.nan, math.nan, "", text)]


def check_confirmed(model: ArmModel) -> list[Finding]:
    """Return whether anything in an arm's files was proposed and nobody has looked at it yet."""
    if not model.unconfirmed:
        return []
    text = (
        f"of {model.name} nobody has confirmed {', '.join(model.unconfirmed)}: look at each in its limits file and "
        "take its name out of to_confirm"
    )
    return [Finding("ParameterInvalid", math.nan, math.nan, len(model.unconfirmed), "", text)]


def _place(time: float, phase: float) -> str:
    if math.isnan(phase):
        return "on the way to or from the path"
    return f"at {time:.2f} s, {100 * phase:.1f} % of the path"

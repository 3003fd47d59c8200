"""From a checked plan to a program that has been read back and compared with it, or to the reason why there is none."""

import math
import re
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from opcua_skill.programs.following import Followed, as_lines, as_splines, switches
from opcua_skill.programs.registry import LANGUAGES
from opcua_skill.programs.values import Comparison, Header, Language, Lines, Options, ProgramRefused, Splines
from sim.arm_model import ArmModel, Floats
from sim.plan import MotionPlan
from sim.planning.kinematics import kinematics

# Of a plan's duration, and for the valve of the time a nozzle takes for the tolerance at its largest speed.
TIMING = 0.01
FINEST, COARSEST = 1e-6, 1e-3
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}\Z")


def program_of(
    plan: MotionPlan, arm: ArmModel, header: Header, language: Language, options: Options
) -> tuple[str, Comparison]:
    """Return a program's text and how it compares with its plan. Raises ``ProgramRefused``."""
    _check(plan, arm, language, options)
    followed = Followed.of(plan, arm)
    own = (1.0 - language.rounding) * options.tolerance
    make = as_lines if language.form == "lines" else as_splines
    # What the digits of the text take away is kept back.
    commanded = make(followed, language, 0.9 * own, 0.9 * options.turn_tolerance)
    if language.turns == "about z":
        _check_turns(commanded, options)
    text = language.write(commanded, header, options, tuple(plan.joints[0]))
    _check_size(text, language, len(commanded.times))
    try:
        read = language.read(text)
    except (ValueError, IndexError, KeyError) as wrong:
        raise ProgramRefused("NotReadBack", f"the program could not be read back: {wrong}") from wrong
    found = compared(followed, read, text, language.quantum)
    _check_comparison(found, plan, replace(options, tolerance=own), language)
    return text, found


def _check(plan: MotionPlan, arm: ArmModel, language: Language, options: Options) -> None:
    if plan.arm_digest != arm.digest or plan.content_digest() != plan.digest:
        raise ProgramRefused("NotReadBack", "the plan is not the one that was checked for this arm")
    if arm.dof not in language.axes:
        spoken = " or ".join(str(one) for one in language.axes)
        text = f"{language.name} speaks of {spoken} axes and {arm.name} has {arm.dof}: choose another language"
        raise ProgramRefused("AxesNotSpoken", text)
    if not (math.isfinite(options.tolerance) and FINEST <= options.tolerance <= COARSEST):
        text = f"the tolerance is {options.tolerance} m: it has to be from {FINEST:g} m to {COARSEST:g} m"
        raise ProgramRefused("ToleranceInvalid", text)
    if not (math.isfinite(options.turn_tolerance) and 1e-5 <= options.turn_tolerance <= 0.1):
        text = f"the tolerance of the orientation is {options.turn_tolerance} rad: it has to be from 0.00001 to 0.1 rad"
        raise ProgramRefused("ToleranceInvalid", text)
    if not NAME.match(options.name):
        text = (
            f"the program's name is {options.name!r}: controllers take a letter, then up to 23 letters, digits or "
            "underscores"
        )
        raise ProgramRefused("NameInvalid", text)


def _check_turns(commanded: Lines | Splines, options: Options) -> None:
    assert isinstance(commanded, Lines)
    held = Rotation.from_quat(commanded.turns)
    across = (held * held[0].inv()).apply([0.0, 0.0, 1.0])
    lean = float(np.arccos(np.clip(across[:, 2], -1.0, 1.0)).max())
    if lean > options.turn_tolerance:
        text = (
            f"the nozzle leans by up to {math.degrees(lean):.1f} degrees on the way: G-code of this form turns it "
            "about the vertical only; teach without tilt, or choose a robot's language"
        )
        raise ProgramRefused("OrientationTurns", text)


def _check_size(text: str, language: Language, rows: int) -> None:
    lines = text.splitlines()
    longest = max(map(len, lines))
    if longest > language.longest_line:
        text = f"a line would have {longest} letters, {language.name} takes {language.longest_line}: use a shorter name"
        raise ProgramRefused("LineTooLong", text)
    if len(lines) > language.most_lines:
        text = (
            f"the program would have {len(lines)} lines for {rows} places, {language.name} takes {language.most_lines} "
            f"({language.limits}): allow a larger tolerance"
        )
        raise ProgramRefused("ProgramTooLong", text)


def _check_comparison(found: Comparison, plan: MotionPlan, options: Options, language: Language) -> None:
    if found.path > options.tolerance or found.turn > options.turn_tolerance:
        text = (
            f"read back, the program is off its plan by up to {1e3 * found.path:.4f} mm and "
            f"{math.degrees(found.turn):.3f} degrees, {1e3 * options.tolerance:.4f} mm and "
            f"{math.degrees(options.turn_tolerance):.3f} degrees are allowed: allow more, or plan with a shorter step"
        )
        raise ProgramRefused("ToleranceLost", text)
    if found.duration > TIMING * plan.duration:
        text = (
            f"read back, the program takes {found.duration:.3f} s more or less than its plan of {plan.duration:.3f} s"
        )
        raise ProgramRefused("TimingLost", text)
    if found.switching > max(language.quantum, 1e-4):
        text = f"read back, the valve switches {1e3 * found.switching:.2f} ms from where it has to"
        raise ProgramRefused("ValveLost", text)


def compared(followed: Followed, read: Lines | Splines, text: str, quantum: float) -> Comparison:
    """Return how a program that was read back compares with its plan."""
    plan = followed.plan
    moments = followed.moments()
    places, turns = followed.at(moments)
    inside = np.clip(moments, read.times[0], read.times[-1])
    tip, held = along_lines(read, inside) if isinstance(read, Lines) else along_splines(read, inside, followed.arm)
    wanted = switches(plan, 0.0)
    same = [one.opens for one in wanted] == [one.opens for one in read.switches]
    late = (abs(one.time - other.time) for one, other in zip(wanted, read.switches, strict=True)) if same else ()
    lines = text.splitlines()
    return Comparison(
        path=float(np.sqrt(((tip - places) ** 2).sum(axis=1)).max()),
        turn=float((held.inv() * turns).magnitude().max()),
        duration=abs(float(read.times[-1] - read.times[0]) - plan.duration),
        switching=max(late, default=0.0) if same else math.inf,
        lines=len(lines),
        longest_line=max(map(len, lines)),
        rows=len(read.times),
    )


def along_lines(read: Lines, times: Floats) -> tuple[Floats, Rotation]:
    """Return where lines have the tip at times (n,), and how it is held."""
    row = np.clip(np.searchsorted(read.times, times, side="right") - 1, 0, len(read.times) - 2)
    share = (times - read.times[row]) / np.maximum(read.times[row + 1] - read.times[row], 1e-12)
    points = read.points[row] + share[:, None] * (read.points[row + 1] - read.points[row])
    held, then = Rotation.from_quat(read.turns[row]), Rotation.from_quat(read.turns[row + 1])
    way = (held.inv() * then).as_rotvec()
    return points, held * Rotation.from_rotvec(share[:, None] * way)


def along_splines(read: Splines, times: Floats, arm: ArmModel) -> tuple[Floats, Rotation]:
    """Return where cubics of the joints have the tip at times (n,), and how it is held."""
    cubic = CubicHermiteSpline(read.times, read.joints, read.velocities)
    tip, held = kinematics(arm).forward(np.asarray(cubic(times), dtype=np.float64))
    return tip, Rotation.from_matrix(held)


def language_of(name: str) -> Language:
    """Return a language by its name. Raises ``ProgramRefused``."""
    if name not in LANGUAGES:
        raise ProgramRefused("NameInvalid", f"there is no language {name!r}: known are {', '.join(LANGUAGES)}")
    return LANGUAGES[name]

"""What every arm asks before it starts: is this plan whole, for me, from where I stand, and am I free?"""

import math

import numpy as np

from sim.arm import ArmMode, ArmState, CommandRefused, StartRefused
from sim.arm_model import ArmModel
from sim.plan import MotionPlan

START_TOLERANCE = 2e-3
LOWEST_OVERRIDE = 0.01


def check_start(model: ArmModel, state: ArmState, plan: MotionPlan) -> None:
    """Raise ``StartRefused`` with a word and a sentence unless the arm may start this plan now."""
    if state.mode in {ArmMode.RUNNING, ArmMode.PAUSED, ArmMode.STOPPING}:
        raise StartRefused("Busy", f"{model.name} is {state.mode}: it runs one motion at a time")
    if state.protective_stop:
        raise StartRefused("ProtectiveStop", f"{model.name} stands in a protective stop: reset it first")
    if state.mode is ArmMode.CLOSED:
        raise StartRefused("Internal", f"{model.name} is not connected: open it first")
    if not state.known or state.mode is ArmMode.FAULT:
        raise StartRefused("Interrupted", f"{model.name}'s position is unknown ({state.fault}): reset it first")
    check_plan(model, plan)
    away = np.abs(np.array(state.joints) - plan.joints[0])
    if away.max() > START_TOLERANCE:
        joint = int(away.argmax())
        raise StartRefused(
            "ParameterInvalid",
            f"{model.name} does not stand where the plan begins: joint {joint + 1} is {math.degrees(away[joint]):.2f} "
            "degrees away: move it home first",
        )


def check_plan(model: ArmModel, plan: MotionPlan) -> None:
    """Raise ``StartRefused`` unless the plan is whole, unchanged since it was checked, and made for this arm."""
    if plan.arm != model.name or plan.arm_digest != model.digest:
        raise StartRefused("ParameterInvalid", f"the plan was made for another arm ({plan.arm}), this is {model.name}")
    numbers = (plan.times, plan.joints, plan.velocities, plan.valve)
    if not all(np.isfinite(values).all() for values in numbers):
        raise StartRefused("ParameterInvalid", "the plan holds NaN or infinity: nothing has moved")
    if not plan.digest or plan.content_digest() != plan.digest:
        raise StartRefused("ParameterInvalid", "the plan has been changed since it was checked: its digest differs")


def check_override(fraction: float) -> None:
    """Raise ``CommandRefused`` unless the override is a number from 1 % to 100 %."""
    if not (math.isfinite(fraction) and LOWEST_OVERRIDE <= fraction <= 1.0):
        raise CommandRefused(
            "ParameterInvalid",
            f"override is {100 * fraction:.4g} %: it has to be from {100 * LOWEST_OVERRIDE:.0f} % to 100 %; "
            "pause to stand still",
        )

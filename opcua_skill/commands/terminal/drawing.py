"""A run drawn where it was asked for: planned from what the server told, pictures by a worker process."""

import asyncio
import dataclasses
from typing import Any

from library.description import Recipe as StoredRecipe
from library.description import SkillDescription
from opcua_skill.client import Recipe, Skill
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.jobs import motion_parameters
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.planner import plan_motion
from sim.rendering.picture import PictureFailed, operator_card, still
from sim.robots import load


def order_of(recipe: Recipe) -> MotionOrder:
    """Return what a recipe asks of an arm."""
    names = {field.name for field in dataclasses.fields(MotionOrder)}
    given: dict[str, Any] = dataclasses.asdict(recipe)
    plain = {name: value for name, value in given.items() if name in names}
    return MotionOrder(**plain, **motion_parameters(StoredRecipe(**given)))


def planned(skill: Skill, recipe: Recipe, arm: str) -> MotionPlan:
    """Return the plan of a run, as the server would make it; a fault says why it cannot be run."""
    try:
        model = load(arm)
        motion = SkillDescription.model_validate(dict(skill.document)).motion()
        return plan_motion(
            motion, order_of(recipe), model, skill_digest=skill.model_digest.hex(), recipe_id=recipe.recipe_id
        )
    except (MotionRefused, ValueError) as error:
        raise Fault(f"recipe {recipe.recipe_id} on {arm}: {error}") from None


def drawn(skill: Skill, recipe: Recipe, arm: str, view: str) -> bytes:
    """Return a PNG: the whole arm (``arm``), the nozzle at work (``work``), or the operator's card (``card``)."""
    plan, model = planned(skill, recipe, arm), load(arm)
    try:
        if view == "card":
            return asyncio.run(operator_card(model, plan))
        return asyncio.run(still(model, plan, "arm" if view == "arm" else "work"))
    except PictureFailed as error:
        raise Fault(str(error)) from None

"""A recipe as a program for a closed controller: planned here, written, read back and compared before it is there."""

import dataclasses
import hashlib
import json
from pathlib import Path

from library.description import SkillDescription
from opcua_skill.client import Recipe, Skill
from opcua_skill.commands.terminal.drawing import order_of
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import plain
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs.station import cell_of, model_of
from opcua_skill.programs.making import language_of, program_of
from opcua_skill.programs.values import Comparison, Header, Language, Options, ProgramRefused
from sim.arm_model import ArmModel
from sim.findings import MotionRefused
from sim.planning.clearance import Cell
from sim.planning.planner import plan_motion
from sim.robots import load


def place_of(arm: str, config: Path | None, workstation: str) -> tuple[ArmModel, Cell | None]:
    """Return the arm that is to run a program, and what surrounds it: of a configured workstation, or by its name."""
    try:
        if config is None:
            return load(arm), None
        stations = {station.name: station for station in Settings.load(config).workstations}
    except ValueError as wrong:
        raise Fault(" ".join(str(wrong).split())) from None
    name = workstation or next(iter(stations))
    if name not in stations:
        raise Fault(f"{config} has no workstation {name!r}: it has {', '.join(stations)}")
    try:
        return model_of(stations[name]), cell_of(stations[name])
    except ValueError as wrong:
        raise Fault(f"workstation {name}: {wrong}") from None


def programmed(
    skill: Skill, recipe: Recipe, place: tuple[ArmModel, Cell | None], language: str, options: Options
) -> tuple[str, Comparison, Language]:
    """Return a program's text, how it compares with its plan, and its language; a fault says why there is none."""
    model, cell = place
    try:
        spoken = language_of(language)
        approved = _approved(skill)
        motion = SkillDescription.model_validate(dict(skill.document)).motion()
        digest = skill.model_digest.hex()
        order = order_of(recipe)
        plan = plan_motion(motion, order, model, skill_digest=digest, recipe_id=recipe.recipe_id, cell=cell)
        content = json.dumps(plain(dataclasses.asdict(recipe)), sort_keys=True, ensure_ascii=False)
        header = Header(
            skill=skill.name,
            skill_version=skill.version,
            skill_digest=digest,
            recipe=recipe.recipe_id,
            recipe_digest=hashlib.sha256(content.encode()).hexdigest(),
            plan_digest=plan.digest,
            arm=f"{model.name} {model.digest[:16]}",
            approved_by=approved,
        )
        return (*program_of(plan, model, header, spoken, options), spoken)
    except (MotionRefused, ValueError) as error:
        raise Fault(f"recipe {recipe.recipe_id} on {model.name}: {error}") from None
    except ProgramRefused as refused:
        raise Fault(f"no program ({refused.reason}): {refused}") from None


def _approved(skill: Skill) -> str:
    """Return who approved a version. Raises ``ProgramRefused`` if nobody has, or if it was taken back since."""
    made = [one for one in skill.document.get("decisions") or () if one.get("state") == "Approved"]
    if skill.state != "Approved" or not made:
        text = f"version {skill.version} of {skill.name} is {skill.state}: only what is approved leaves the house"
        raise ProgramRefused("NotApproved", text)
    return ", ".join(dict.fromkeys(f"{one['actor']}" for one in made))

"""What may be said in a job order: a recipe's own numbers, what the skill declares, and what only goes along."""

from dataclasses import dataclass
from typing import Any

from annotated_types import Ge, Gt, Le
from pydantic_core import PydanticUndefined

from library.description import Parameter, Recipe, SkillDescription
from opcua_skill.jobs.execution import MODES, Mode
from opcua_skill.server.faces.jobs.states import Bit, OrderRefused
from opcua_skill.server.units import METRE, ONE, SECOND, SLIDING, Unit

RECIPE_ID, EXECUTION_MODE, RUNS_PLANNED = "RecipeId", "JobExecutionMode", "RunsPlanned"
OF_RECIPE: dict[str, tuple[str, Unit | None, str]] = {
    "Timing": ("timing", None, "demonstrated, constant_speed or time_optimal"),
    "Duration": ("duration", SECOND, "of the path with the people's timing; 0: as learned"),
    "Speed": ("speed", SLIDING[1], "of the nozzle with constant speed"),
    "SpeedOverride": ("speed_override", ONE, "fraction of the planned speed"),
    "TimeStep": ("time_step", SECOND, "between two commanded points"),
    "Standoff": ("standoff", METRE, "of the nozzle from the part"),
    "ApproachHeight": ("approach_height", METRE, "above the path's begin"),
    "RetractHeight": ("retract_height", METRE, "above the path's end"),
    "DispenseLead": ("dispense_lead", SECOND, "by which the valve opens earlier"),
    "MaxDeviation": ("max_deviation", METRE, "from the learned path; 0: not checked"),
}
CARRIED = frozenset(
    {"JobName", "OrderNumbers", "Customers", "CustomerOrderNumbers", "ReasonForStateChange", "PlannedProductionTime"}
)
"""Parameters of OPC 40001-3 that say nothing about the motion: kept with the order."""
BY_SYMBOL = {unit.symbol: unit for unit in (METRE, SECOND, SLIDING[1])}


@dataclass(frozen=True, slots=True)
class OrderParameter:
    """A parameter as a work master lists it; without unit and range it is a word."""

    name: str
    description: str
    default: float | int | str
    unit: Unit | None = None
    low: float | None = None
    high: float | None = None


def parameters_of(description: SkillDescription, recipe: Recipe) -> tuple[OrderParameter, ...]:
    """Return what an order for a version may say, with the values of its default recipe."""
    return (
        OrderParameter(RECIPE_ID, "recipe that is run", recipe.recipe_id),
        OrderParameter(EXECUTION_MODE, "0 simulation, 1 test, 2 production", MODES.index("production")),
        *(_of_recipe(name, recipe) for name in OF_RECIPE),
        *(_of_skill(one, recipe) for one in description.parameters),
    )


def _of_recipe(name: str, recipe: Recipe) -> OrderParameter:
    """Return a parameter with the range that the recipe itself checks."""
    field, unit, told = OF_RECIPE[name]
    edges = Recipe.model_fields[field].metadata
    lows = [float(one.ge if isinstance(one, Ge) else one.gt) for one in edges if isinstance(one, Ge | Gt)]  # type: ignore[arg-type]
    highs = [float(one.le) for one in edges if isinstance(one, Le)]  # type: ignore[arg-type]
    return OrderParameter(name, told, getattr(recipe, field), unit, *(lows or [None]), *(highs or [None]))


def _of_skill(declared: Parameter, recipe: Recipe) -> OrderParameter:
    default = recipe.parameters.get(declared.name, declared.default)
    unit = BY_SYMBOL.get(declared.unit, Unit("", declared.unit, declared.unit)) if declared.unit else None
    return OrderParameter(declared.name, declared.description, default, unit, declared.minimum, declared.maximum)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What an order asks for: a skill, the recipe with the order's own numbers in it, and the mode."""

    skill_name: str
    recipe_id: str
    mode: Mode
    of_recipe: dict[str, Any]
    of_skill: dict[str, float | str]

    def applied(self, recipe: Recipe, version: int) -> Recipe:
        """Return a recipe with what the order says, for the version it names; 0: whichever the recipe says."""
        changed = {**self.of_recipe, "parameters": {**recipe.parameters, **self.of_skill}}
        if version:
            changed["skill_version"] = version
        return Recipe(**{**recipe.model_dump(), **changed})


def read(skill_name: str, given: dict[str, Any], description: SkillDescription) -> Wanted:
    """Return what the parameters of an order say; one that nobody would obey is refused, not passed over."""
    mode = given.get(EXECUTION_MODE, MODES.index("production"))
    if not isinstance(mode, int) or not 0 <= mode < len(MODES):
        raise OrderRefused(f"{EXECUTION_MODE} is {mode!r}: it is 0, 1 or 2", Bit.INVALID_REQUEST)
    if given.get(RUNS_PLANNED, 1) != 1:
        raise OrderRefused(f"{RUNS_PLANNED} is {given[RUNS_PLANNED]}: an order is one run", Bit.INVALID_REQUEST)
    declared = {one.name: one for one in description.parameters}
    of_recipe: dict[str, Any] = {}
    of_skill: dict[str, float | str] = {}
    for name, value in given.items():
        if name in {RECIPE_ID, EXECUTION_MODE, RUNS_PLANNED} or name in CARRIED:
            continue
        if name in OF_RECIPE:
            field = OF_RECIPE[name][0]
            of_recipe[field] = _like(name, value, Recipe.model_fields[field].default)
        elif name in declared:
            of_skill[name] = _like(name, value, declared[name].default)
        else:
            raise OrderRefused(f"{description.name} has no parameter {name!r}", Bit.INVALID_REQUEST)
    recipe_id = given.get(RECIPE_ID, "")
    return Wanted(skill_name, _like(RECIPE_ID, recipe_id, ""), MODES[mode], of_recipe, of_skill)


def _like(name: str, value: Any, pattern: Any) -> Any:
    """Return a value of the kind of another: a number or a text."""
    if pattern is PydanticUndefined or isinstance(pattern, str):
        fits = isinstance(value, str)
    else:
        fits = isinstance(value, int | float) and not isinstance(value, bool)
    if not fits:
        raise OrderRefused(f"{name} is {value!r}: that is of the wrong kind", Bit.INVALID_REQUEST)
    return value

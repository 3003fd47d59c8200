"""The process parameters of a recipe that shape its motion: declared by every skill, read into the plan's order."""

from typing import Any

from library.description import Parameter, Recipe
from library.errors import InvalidValue
from sim.order import MotionOrder

MOTION_PARAMETERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "BlendRadius": ("blend_radius", ()),
    "Corners": ("corners", ("refuse", "slow")),
    "ChordTolerance": ("chord_tolerance", ()),
    "TubeSigmas": ("tube_sigmas", ()),
    "TubePolicy": ("tube_policy", ("flag", "stop")),
    "NozzleTurn": ("nozzle_turn", ("free", "shown")),
    "PartX": ("part_x", ()),
    "PartY": ("part_y", ()),
    "PartLength": ("part_length", ()),
    "PartWidth": ("part_width", ()),
}
MOTION_PARAMETER_RANGES = (
    Parameter(name="BlendRadius", description="rounds corners", unit="m", default=0.0, minimum=0.0, maximum=0.1),
    Parameter(name="Corners", description="where constant speed is impossible: refuse or slow", default="slow"),
    Parameter(
        name="ChordTolerance",
        description="the most by which straight lines between time steps may cut the path",
        unit="m",
        default=5e-5,
        minimum=1e-6,
        maximum=1e-2,
    ),
    Parameter(
        name="TubeSigmas",
        description="watch the skill's own spread: so many standard deviations; 0: not watched",
        default=0.0,
        minimum=0.0,
        maximum=100.0,
    ),
    Parameter(name="TubePolicy", description="outside the tube: flag or stop", default="flag"),
    Parameter(
        name="NozzleTurn",
        description="where the tool's orientation was shown, its turn about its own axis: shown or free",
        default="shown",
    ),
    *(
        Parameter(name=name, description=told, unit="m", default=0.0, minimum=least, maximum=5.0)
        for name, told, least in (
            ("PartX", "where the part begins in its frame, along x", -5.0),
            ("PartY", "where the part begins in its frame, along y", -5.0),
            ("PartLength", "how long the part is along x; 0: not known, 20 mm around the path are kept clear", 0.0),
            ("PartWidth", "how wide the part is along y; 0: not known, 20 mm around the path are kept clear", 0.0),
        )
    ),
)


def motion_parameters(recipe: Recipe) -> dict[str, Any]:
    """Return what a recipe's process parameters say about the motion, as fields of a MotionOrder.

    Raises InvalidValue for a word that is none, or a text where a number has to be; ranges are the plan's to check.
    """
    found: dict[str, Any] = {}
    for name, (field, words) in MOTION_PARAMETERS.items():
        value = recipe.parameters.get(name)
        if value is None:
            continue
        if words and value not in words:
            raise InvalidValue(f"parameters.{name}", value, f"it has to be {' or '.join(words)}")
        if not words and isinstance(value, str):
            raise InvalidValue(f"parameters.{name}", value, "it has to be a number")
        found[field] = value
    return found


def motion_order(recipe: Recipe, speed_fraction: float) -> MotionOrder:
    """Return what a recipe asks of an arm; ``speed_fraction`` slows the whole plan."""
    return MotionOrder(
        time_step=recipe.time_step,
        timing=recipe.timing,
        duration=recipe.duration,
        speed=recipe.speed,
        speed_override=recipe.speed_override,
        frame=recipe.frame,
        standoff=recipe.standoff,
        approach_height=recipe.approach_height,
        retract_height=recipe.retract_height,
        dispense_lead=recipe.dispense_lead,
        max_deviation=recipe.max_deviation,
        speed_fraction=speed_fraction,
        **motion_parameters(recipe),
    )

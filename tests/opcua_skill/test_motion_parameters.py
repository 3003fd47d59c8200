"""A recipe's process parameters that steer the motion reach the order, or are refused by name."""

import pytest
from small_corner import small_corner

from library.description import Recipe
from library.errors import InvalidValue
from models.learning import learn
from opcua_skill.jobs.motion_parameters import motion_order, motion_parameters
from opcua_skill.jobs.worker_tasks import MOST_TIME_STEPS, time_steps
from sim.order import MotionOrder
from sim.planning.checks import check_order


def recipe(**parameters: float | str) -> Recipe:
    return Recipe(recipe_id="r", skill_name="s", parameters=parameters)


def test_known_names_become_fields_and_others_are_left_to_the_process() -> None:
    given = recipe(BlendRadius=0.002, Corners="slow", TubeSigmas=3.0, TubePolicy="stop", Pressure=2.5)
    assert motion_parameters(given) == {
        "blend_radius": 0.002,
        "corners": "slow",
        "tube_sigmas": 3.0,
        "tube_policy": "stop",
    }
    assert motion_parameters(recipe()) == {}


@pytest.mark.parametrize(
    ("name", "value"), [("Corners", "fast"), ("Corners", 1.0), ("TubePolicy", "ignore"), ("BlendRadius", "wide")]
)
def test_what_cannot_be_meant_is_refused_by_name(name: str, value: float | str) -> None:
    with pytest.raises(InvalidValue, match=f"parameters.{name}"):
        motion_parameters(recipe(**{name: value}))


NUMBERS = ("time_step", "duration", "speed", "speed_override", "standoff", "approach_height", "retract_height")
MORE_NUMBERS = ("dispense_lead", "max_deviation")


def ends(field: str) -> list[float]:
    """Return the ends of a recipe field's range, as its metadata says them."""
    limits = Recipe.model_fields[field].metadata
    found = [getattr(limit, name) for limit in limits for name in ("ge", "gt", "le") if hasattr(limit, name)]
    return [value for value in found if value is not None]


@pytest.mark.parametrize("field", [*NUMBERS, *MORE_NUMBERS])
def test_a_recipe_can_be_stored_exactly_where_its_motion_can_be_planned(field: str) -> None:
    low, high = ends(field)
    span = high - low
    for value in (low - 0.01 * span, low, low + 0.01 * span, high, high + 0.01 * span):
        try:
            stored = motion_order(Recipe(recipe_id="r", skill_name="s", **{field: value}), 1.0)
        except InvalidValue:
            refused = True
        else:
            refused = False
            assert check_order(stored) == []
        assert refused == bool(check_order(MotionOrder(**{field: value}))), (field, value)


@pytest.mark.parametrize(
    ("order", "too_long"),
    [
        (MotionOrder(), False),
        (MotionOrder(duration=3600.0, time_step=0.008), False),
        (MotionOrder(duration=3600.0, time_step=0.001), True),
        (MotionOrder(duration=600.0, speed_override=0.001), True),
        (MotionOrder(duration=3600.0, time_step=0.008, speed_fraction=0.25), True),
        (MotionOrder(timing="constant_speed", speed=1e-9), True),
        (MotionOrder(timing="constant_speed", speed=0.01), False),
    ],
)
def test_a_run_of_more_steps_than_can_be_checked_is_known_before_it_is_planned(
    order: MotionOrder, too_long: bool
) -> None:
    motion = learn(small_corner(2)).motion
    assert (time_steps(motion, order) > MOST_TIME_STEPS) == too_long

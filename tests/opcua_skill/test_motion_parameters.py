"""A recipe's process parameters that steer the motion reach the order, or are refused by name."""

import pytest

from library.description import Recipe
from library.errors import InvalidValue
from opcua_skill.jobs import motion_parameters


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

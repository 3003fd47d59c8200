"""Which recipes are taken, as a table; what is refused names field, value and range."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.errors import InvalidValue
from library.recipe import Recipe

GOOD: dict[str, Any] = {"recipe_id": "r1", "skill_name": "glue"}
HALF = math.sqrt(0.5)

TAKEN = [
    {},
    {"time_step": 0.001},
    {"time_step": 0.02},
    {"timing": "constant_speed", "speed": 0.05},
    {"timing": "time_optimal"},
    {"duration": 12.5},
    {"speed_override": 0.01},
    {"frame": (0.3, -0.1, 0.02, 0.0, 0.0, HALF, HALF)},
    {"parameters": {"pressure": 2.5, "nozzle": "fine"}},
    {"skill_version": 3, "product": "door, left"},
    {"recipe_id": "x" * 160, "skill_name": "ä" * 128},
    {"dispense_lead": -0.05},
]
REFUSED = [
    ({"recipe_id": ""}, "recipe_id", "1"),
    ({"recipe_id": "a/b"}, "recipe_id", "'/'"),
    ({"recipe_id": " r1"}, "recipe_id", "no space at either end"),
    ({"recipe_id": "r\n1"}, "recipe_id", "control characters"),
    ({"recipe_id": "x" * 161}, "recipe_id", "160"),
    ({"skill_name": "glue\x00"}, "skill_name", "control characters"),
    ({"skill_name": "glue\ud800"}, "skill_name", "unicode"),
    ({"skill_version": -1}, "skill_version", "at least 0"),
    ({"time_step": 0.0}, "time_step", "at least 0.001 and at most 0.02"),
    ({"time_step": 0.021}, "time_step", "at least 0.001 and at most 0.02"),
    ({"time_step": math.nan}, "time_step", "finite"),
    ({"timing": "fast"}, "timing", "'demonstrated', 'constant_speed' or 'time_optimal'"),
    ({"timing": ""}, "timing", "'demonstrated', 'constant_speed' or 'time_optimal'"),
    ({"timing": "constant_speed"}, "speed", "above 0 and at most 1 m/s"),
    ({"speed": -0.1}, "speed", "at least 0 and at most 1"),
    ({"speed": 6.0}, "speed", "at least 0 and at most 1"),
    ({"duration": -1.0}, "duration", "at least 0 and at most 3600"),
    ({"duration": math.inf}, "duration", "finite"),
    ({"speed_override": 0.0}, "speed_override", "above 0 and at most 1"),
    ({"speed_override": 1.1}, "speed_override", "above 0 and at most 1"),
    ({"frame": ()}, "frame", "field required"),
    ({"frame": (0.0,) * 8}, "frame", "at most 7"),
    ({"frame": (0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9)}, "frame", "unit quaternion"),
    ({"frame": (0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)}, "frame", "unit quaternion"),
    ({"frame": (400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, "frame", "within 10 m"),
    ({"frame": (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, "frame", "finite"),
    ({"standoff": -0.001}, "standoff", "at least 0"),
    ({"approach_height": 0.6}, "approach_height", "at most 0.5"),
    ({"retract_height": -0.1}, "retract_height", "at least 0"),
    ({"dispense_lead": 6.0}, "dispense_lead", "at most 1"),
    ({"max_deviation": -1e-6}, "max_deviation", "at least 0"),
    ({"parameters": {"pressure": math.nan}}, "parameters", "finite"),
    ({"parameters": {"a/b": 1.0}}, "parameters", "'/'"),
    ({"product": "x\x00"}, "product", "NUL"),
    ({"colour": "red"}, "colour", "not permitted"),
]


@pytest.mark.parametrize("changes", TAKEN, ids=str)
def test_a_sensible_recipe_is_taken_and_comes_back_from_json_equal(changes: dict[str, Any]) -> None:
    recipe = Recipe(**{**GOOD, **changes})
    assert Recipe.from_json(recipe.to_json()) == recipe


@pytest.mark.parametrize(("changes", "field", "words"), REFUSED, ids=lambda value: ascii(value)[:60])
def test_a_refusal_names_field_value_and_range(changes: dict[str, Any], field: str, words: str) -> None:
    with pytest.raises(InvalidValue) as refusal:
        Recipe(**{**GOOD, **changes})
    assert refusal.value.field.startswith(field)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_recipe_cannot_be_changed() -> None:
    recipe = Recipe(**GOOD)
    with pytest.raises(ValueError, match="frozen"):
        recipe.speed = 1.0  # pyright: ignore[reportAttributeAccessIssue]


@given(value=st.floats(allow_nan=False, allow_infinity=False, min_value=0.001, max_value=0.02))
@settings(deadline=None)
def test_a_number_in_a_recipe_survives_json_bit_for_bit(value: float) -> None:
    recipe = Recipe(**GOOD, time_step=value)
    assert Recipe.from_json(recipe.to_json()).time_step.hex() == value.hex()

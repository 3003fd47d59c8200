"""Values survive the way over the wire, and leave as flat arrays."""

import types
from dataclasses import asdict, replace
from datetime import UTC, datetime

import numpy as np
import pytest
from asyncua import ua
from hypothesis import given, settings
from hypothesis import strategies as st

from library.description import Failure as StoredFailure
from library.description import Recipe as StoredRecipe
from models.demonstration import Demonstration
from opcua_skill.client import Failure, Recipe
from opcua_skill.wire import to_server
from opcua_skill.wire.values import MODES


def structures(name: str) -> type:
    """Stand for a server's structure classes: takes any field."""
    return types.SimpleNamespace


samples = st.integers(1, 40)


@settings(deadline=None)
@given(samples, st.sampled_from([2, 3]), st.integers(0, 2**32), st.booleans())
def test_a_demonstration_comes_back_as_it_was_sent(n: int, dimension: int, seed: int, dated: bool) -> None:
    random = np.random.default_rng(seed)
    sent = Demonstration(
        "a",
        np.cumsum(random.uniform(0.001, 0.1, n)),
        random.normal(size=(n, dimension)),
        random.random(n) > 0.5,
        operator="Jo",
        recorded_at=datetime(2026, 3, 1, tzinfo=UTC) if dated else None,
    )
    back = to_server.demonstration_in(to_server.demonstration_out(structures, sent))
    assert np.array_equal(back.times, sent.times)
    assert np.array_equal(back.points, sent.points)
    assert np.array_equal(back.triggers, sent.triggers)
    assert (back.demonstration_id, back.operator, back.recorded_at) == ("a", "Jo", sent.recorded_at)


def test_arrays_leave_flat_and_row_major() -> None:
    sent = Demonstration("a", np.array([0.0, 1.0]), np.array([[1.0, 2.0], [3.0, 4.0]]), np.ones(2, bool))
    out = to_server.demonstration_out(structures, sent)
    assert out.Positions == [1.0, 2.0, 3.0, 4.0]
    assert out.Triggers == []


@pytest.mark.parametrize("parameters", [{}, {"Pressure": 2.5, "Glue": "UV-17"}])
def test_a_recipe_comes_back_as_it_was_sent(parameters: dict[str, float | str]) -> None:
    sent = replace(Recipe("r", "s", speed=0.05, frame=(0.1, 0.2, 0.3, 0, 0, 0, 1)), parameters=parameters)
    assert to_server.recipe_in(to_server.recipe_out(structures, sent)) == sent


def test_the_null_date_is_no_date() -> None:
    assert to_server.moment(datetime(1601, 1, 1)) is None
    assert to_server.moment(datetime(2026, 1, 1)) == datetime(2026, 1, 1, tzinfo=UTC)


def test_errors_not_measured_are_not_zero() -> None:
    assert all(np.isnan(to_server.pair([])))


def test_modes_and_failures_have_the_order_of_the_interface() -> None:
    assert MODES == ("simulation", "test", "production")
    assert [one.value for one in Failure] == [one.value for one in StoredFailure]
    assert not Failure.NONE and all(one for one in Failure if one is not Failure.NONE)


def test_no_indices_are_still_an_array_of_uint32() -> None:
    variant = to_server.uint32_array([])
    assert (variant.VariantType, variant.is_array) == (ua.VariantType.UInt32, True)


def test_a_recipe_left_short_has_the_defaults_of_the_library() -> None:
    ours, theirs = asdict(Recipe("r", "s")), StoredRecipe(recipe_id="r", skill_name="s").model_dump()
    assert ours == theirs

"""How a fitted path is measured against the mean it is fitted to."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.evaluation import resampled
from models.experts import NARROW_WINDOW, WINDOW, retimed
from models.people import ZIGZAG


@pytest.mark.parametrize("window", [WINDOW, NARROW_WINDOW])
def test_a_stroke_gone_over_twice_is_not_taken_for_its_way_back(window: float) -> None:
    """Where the way back lies upon the way there, each point is nearest to both."""
    mean = resampled(np.array([[10.0, 80.0], [10.0, 10.0], [10.0, 80.0], [50.0, 80.0]]) * 1e-3, 300)
    beside = mean + np.array([0.1e-3, 0.0])
    assert np.abs(retimed(beside, mean, window) - np.arange(300)).max() < 1.0


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(-2.0, 2.0))
def test_a_path_ahead_of_its_mean_is_found_as_far_ahead(seed: int, ahead: float) -> None:
    generator = np.random.default_rng(seed)
    mean = resampled(ZIGZAG + generator.normal(0.0, 2e-3, ZIGZAG.shape), 300)
    index = np.arange(300.0)
    shown = np.clip(index + ahead * np.sin(np.pi * index / 299.0) ** 2, 0.0, 299.0)
    path = np.column_stack([np.interp(shown, index, column) for column in mean.T])
    found = retimed(path, mean)
    assert (np.diff(found) >= 0.0).all()
    assert np.abs(found - shown).max() < 0.1

"""What is stored of people: their path, by how much the next one will differ from it, and what is said of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.alignment.aligned import AlignedDemonstrations
from models.demonstration import Floats
from models.evaluation import resampled
from models.learning import LearningOptions, learn
from models.mixture.fitting import fit_path, mixture_of, timing
from models.mixture.gmr import CovarianceRule
from models.motion import Motion
from models.synthetic import ZIGZAG, simulated_people
from models.yardstick import retimed

WITHIN: CovarianceRule = "within"
DRAWN = [ZIGZAG, np.column_stack([np.linspace(0.0, 0.1, 50), 0.01 * np.sin(np.linspace(0.0, 6.0, 50))])]


def drawn_by(truth: Floats, number: int, generator: np.random.Generator) -> AlignedDemonstrations:
    """Return people, already aligned, who each miss the truth (n, d) by a place and slow waves of their own."""
    way = np.linspace(0.0, 1.0, len(truth))
    points = truth + generator.normal(0.0, 1e-3, (number, 1, 2))
    for wave in range(1, 5):
        sizes, others = generator.normal(0.0, 0.7e-3, (2, number, 1, 2))
        points += sizes * np.sin(np.pi * wave * way)[:, None] + others * np.cos(np.pi * wave * way)[:, None]
    times = np.broadcast_to(10.0 * way, points.shape[:2]).copy()
    return AlignedDemonstrations(points, times, np.ones_like(times), None, np.ones_like(times))


def learned(people: AlignedDemonstrations) -> Motion:
    fit, aligned, _ = fit_path(people, LearningOptions())
    duration, times = timing(aligned)
    mixture = mixture_of(fit, aligned, times, "path", duration)
    return Motion(mixture.means, mixture.covariances, "path", 2, duration, (), 0.008, WITHIN)


@pytest.mark.parametrize("number", [3, 6, 20])
def test_a_new_person_lies_within_one_two_and_three_deviations_as_often_as_foretold(number: int) -> None:
    generator = np.random.default_rng(number)
    shares: list[Floats] = []
    for turn in range(max(6, 120 // number)):
        truth = resampled(DRAWN[turn % 2], 200)
        people = drawn_by(truth, number, generator)
        points, covariances = learned(people).at_phases(np.linspace(0.0, 1.0, 200))
        others = drawn_by(truth, 20, generator).at_instants(retimed(points, people.points.mean(axis=0)))
        offsets = others.points - points
        squares = (offsets * np.linalg.solve(covariances[None], offsets[..., None])[..., 0]).sum(axis=2)
        shares.append(np.array([(squares <= limit).mean() for limit in (1.0, 4.0, 9.0)]))
    one, two, three = 100.0 * np.mean(shares, axis=0)
    assert one == pytest.approx(39.3, abs=5.0)
    assert two == pytest.approx(86.5, abs=4.0)
    assert three == pytest.approx(98.9, abs=4.0)


@settings(deadline=None, max_examples=6)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0 * np.pi))
def test_covariances_turn_with_the_plate(seed: int, angle: float) -> None:
    people = drawn_by(resampled(DRAWN[1], 200), 4, np.random.default_rng(seed))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = AlignedDemonstrations(people.points @ turn.T, people.times, people.triggers, None, people.weights)
    phases = np.linspace(0.0, 1.0, 50)
    (one, spread), (other, turned_spread) = (learned(group).at_phases(phases) for group in (people, turned))
    np.testing.assert_allclose(other, one @ turn.T, atol=2e-4)
    sizes = np.trace(spread, axis1=1, axis2=2)
    np.testing.assert_allclose(np.trace(turned_spread, axis1=1, axis2=2), sizes, rtol=0.1)


def test_a_path_made_simpler_than_the_people_agreed_on_says_so() -> None:
    people, _ = simulated_people(6, 1)
    assert not [one for one in learn(people, compare=False).report.findings if one.code == "path-simplified"]
    told = learn(people, options=LearningOptions(components=2), compare=False).report.findings
    found = next(one for one in told if one.code == "path-simplified")
    assert "2 components" in found.sentence
    assert found.size is not None
    assert found.size > 3e-3
    assert found.place is not None

"""Means and covariances are the whole motion."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.errors import InvalidModel
from models.learning import LearningOptions, learn
from models.motion import Motion
from models.synthetic import ZIGZAG_IN_SPACE, simulated_people

DEMONSTRATIONS, TRUTH = simulated_people(8, 1)
LEARNED = {
    "recommended": learn(DEMONSTRATIONS),
    "recommended over time": learn(DEMONSTRATIONS, options=LearningOptions(clock="time")),
    "paper": learn(DEMONSTRATIONS, options=LearningOptions(preset="paper")),
    "paper over the path": learn(DEMONSTRATIONS, options=LearningOptions(preset="paper", clock="path")),
    "in space": learn(simulated_people(6, 2, corners=ZIGZAG_IN_SPACE)[0]),
}
MOTIONS = {name: learned.motion for name, learned in LEARNED.items()}
every_motion = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())


@every_motion
def test_a_round_trip_through_json_gives_the_same_bits(motion: Motion) -> None:
    text = json.dumps([motion.means.tolist(), motion.covariances.tolist()])
    means, covariances = (np.array(part) for part in json.loads(text))
    again = Motion(
        means,
        covariances,
        motion.clock,
        motion.dimension,
        motion.duration,
        motion.dispense,
        motion.time_step,
        motion.covariance_rule,
    )
    one, other = motion.as_learned(), again.as_learned()
    for name in ("times", "phases", "points", "covariances", "dispense"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@every_motion
def test_the_path_as_learned_has_the_step_asked_for_and_ends_at_the_end(motion: Motion) -> None:
    path = motion.as_learned()
    assert path.times[0] == 0.0
    assert path.times[-1] == motion.duration
    np.testing.assert_allclose(np.diff(path.times)[:-1], motion.time_step)
    assert path.phases[0] == 0.0
    assert path.phases[-1] == 1.0
    assert (np.diff(path.phases) > 0).all()
    assert path.points.shape == (len(path.times), motion.dimension)
    assert path.covariances.shape == (len(path.times), motion.dimension, motion.dimension)


@every_motion
def test_times_rise_with_phase_and_phases_at_is_the_inverse(motion: Motion) -> None:
    phases = np.linspace(0.0, 1.0, 1777)
    times = motion.times_at(phases)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(motion.duration, abs=1e-12)
    assert (np.diff(times) > 0).all()
    np.testing.assert_allclose(motion.phases_at(times), phases, atol=1e-9)


@every_motion
def test_covariances_are_symmetric_and_positive(motion: Motion) -> None:
    _, covariances = motion.at_phases(np.linspace(0.0, 1.0, 200))
    np.testing.assert_array_equal(covariances, covariances.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariances).min() > 0


@every_motion
def test_points_alone_are_the_points_with_covariances(motion: Motion) -> None:
    phases = np.linspace(0.0, 1.0, 5000)
    np.testing.assert_array_equal(motion.points_at(phases), motion.at_phases(phases)[0])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40))
@settings(deadline=None, max_examples=40)
def test_a_point_does_not_depend_on_which_others_are_asked_for(phases: list[float]) -> None:
    motion = MOTIONS["recommended"]
    together = motion.points_at(np.array(phases))
    alone = np.concatenate([motion.points_at(np.array([phase])) for phase in phases])
    np.testing.assert_allclose(together, alone, atol=1e-15)


@pytest.mark.parametrize("rule", ["paper", "within", "full"])
def test_the_covariance_rules_agree_where_one_component_speaks_alone(rule: str) -> None:
    motion = MOTIONS["recommended"]
    alone = Motion(motion.means[:1], motion.covariances[:1], "path", 2, 1.0, (), 0.01, "within")
    ruled = Motion(motion.means[:1], motion.covariances[:1], "path", 2, 1.0, (), 0.01, rule)  # type: ignore[arg-type]
    phases = np.linspace(0.0, 1.0, 7)
    np.testing.assert_allclose(ruled.at_phases(phases)[1], alone.at_phases(phases)[1], rtol=1e-12, atol=1e-20)


@every_motion
def test_a_motion_crosses_a_process(motion: Motion) -> None:
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.points_at(np.linspace(0, 1, 9)), motion.points_at(np.linspace(0, 1, 9)))


@pytest.mark.parametrize("name", LEARNED)
def test_what_was_learned_crosses_a_process(name: str) -> None:
    again = pickle.loads(pickle.dumps(LEARNED[name]))
    assert again.verdicts == LEARNED[name].verdicts
    assert again.report.as_dict() == LEARNED[name].report.as_dict()
    json.dumps(again.report.as_dict(), allow_nan=False)


def test_a_model_that_is_no_mixture_is_refused() -> None:
    good = MOTIONS["recommended"]
    with pytest.raises(InvalidModel, match="columns"):
        Motion(good.means[:, :3], good.covariances, "path", 2, 1.0, (), 0.01, "within")
    with pytest.raises(InvalidModel, match="belongs"):
        Motion(good.means, good.covariances[:-1], "path", 2, 1.0, (), 0.01, "within")
    with pytest.raises(InvalidModel, match="NaN"):
        Motion(good.means * np.nan, good.covariances, "path", 2, 1.0, (), 0.01, "within")
    with pytest.raises(InvalidModel, match="extent"):
        Motion(good.means, -good.covariances, "path", 2, 1.0, (), 0.01, "within")


def test_dispensing_is_on_within_its_intervals() -> None:
    good = MOTIONS["recommended"]
    motion = Motion(good.means, good.covariances, "path", 2, 1.0, ((0.1, 0.4), (0.6, 1.0)), 0.01, "within")
    phases = np.array([0.0, 0.1, 0.2, 0.4, 0.5, 0.7, 1.0])
    np.testing.assert_array_equal(motion.dispense_at(phases), [False, True, True, True, False, True, True])

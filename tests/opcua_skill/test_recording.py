"""What a tracker sends is cut into demonstrations by its push button, the same however it is cut into appends."""

import itertools
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.demonstration import Bools, Floats
from opcua_skill.server.recording import Bounds, InvalidSamples, LimitExceeded, Recording

NONE = np.zeros(0)
RATE = 100.0


def recording(dimension: int = 2, bounds: Bounds = Bounds(50, 10_000)) -> Recording:  # noqa: B008 - it is frozen
    return Recording("r", dimension, "Ada", "a test", datetime(2026, 1, 1, tzinfo=UTC), bounds)


def add(
    to: Recording, times: Any, triggers: Any = None, *, positions: Floats | None = None, orientations: Floats = NONE
) -> None:
    times = np.asarray(times, dtype=np.float64)
    places = np.outer(np.arange(len(times)), np.ones(to.dimension)).ravel() / 1000 if positions is None else positions
    pressed = None if triggers is None else np.asarray(triggers, dtype=np.bool_)
    to.append(times, places, pressed, orientations, button=True)


def pressed(*lengths: int) -> Bools:
    """Return a button that is released for the first number of samples, pressed for the second, and so on."""
    return np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)


def at_100_hz(count: int, start: float = 0.0) -> Floats:
    return start + np.arange(count) / RATE


def test_each_press_is_a_demonstration() -> None:
    made = recording()
    button = pressed(10, 30, 20, 40, 10)
    add(made, at_100_hz(110, start=1000.0), button)
    assert [(one.demonstration_id, one.first, one.end) for one in made.presses] == [
        ("demonstration-01", 10, 40),
        ("demonstration-02", 60, 100),
    ]
    made.close()
    shown = made.demonstration(made.presses[1])
    assert shown.times[0] == 0.0
    np.testing.assert_allclose(shown.times, np.arange(40) / RATE, atol=1e-12)
    np.testing.assert_allclose(shown.points[:, 0], np.arange(60, 100) / 1000)
    assert shown.triggers.all()
    assert (shown.operator, shown.source, shown.recorded_at) == ("Ada", "a test", made.started_at)


def test_a_button_that_is_never_told_is_always_on() -> None:
    made = recording()
    add(made, at_100_hz(50))
    assert made.going_on is not None
    made.close()
    assert [(one.first, one.end) for one in made.presses] == [(0, 50)]


@pytest.mark.parametrize(("count", "rate"), [(4, 100.0), (2, 10.0), (45, 1000.0)])
def test_a_touch_of_the_button_is_told_and_is_no_demonstration(count: int, rate: float) -> None:
    made = recording()
    add(made, np.arange(count + 200) / rate, pressed(50, count, 150))
    assert made.presses == ()
    assert made.button.ignored == 1
    assert f"{count} samples, is no demonstration" in made.button.last_ignored


def test_a_bouncing_button_does_not_cut_a_demonstration_in_two() -> None:
    made = recording()
    add(made, at_100_hz(100), pressed(10, 30, 3, 47, 10))
    assert [(one.first, one.end) for one in made.presses] == [(10, 90)]


def test_a_demonstration_that_is_being_shown_counts_and_ends_with_the_recording() -> None:
    made = recording()
    add(made, at_100_hz(20), pressed(10, 10))
    assert made.presses == ()
    assert [(one.first, one.end) for one in made.all_presses] == [(10, 20)]
    made.close()
    assert [(one.first, one.end) for one in made.presses] == [(10, 20)]


def test_a_discarded_demonstration_leaves_its_number_unused() -> None:
    made = recording()
    add(made, at_100_hz(60), pressed(10, 20, 10, 20))
    made.discard("demonstration-01")
    add(made, at_100_hz(40, start=0.6), pressed(20, 20))
    made.close()
    assert [one.demonstration_id for one in made.presses] == ["demonstration-02", "demonstration-03"]


def test_the_clock_of_the_tracker_may_begin_anywhere() -> None:
    made = recording()
    add(made, at_100_hz(50, start=1.7e9))
    add(made, at_100_hz(50, start=1.7e9 + 0.5))
    np.testing.assert_allclose(made.after(0).times, np.arange(100) / RATE, atol=1e-6)


WRONG: list[tuple[str, dict[str, Any], str, str]] = [
    ("times fall", {"times": [0.0, 0.2, 0.1]}, "Times", "time 2"),
    ("times stand", {"times": [0.0, 0.1, 0.1]}, "Times", "time 2"),
    ("not after the append before", {"times": [-1.0, 3.0]}, "Times", "from append to append"),
    ("NaN time", {"times": [0.0, np.nan]}, "Times", "NaN"),
    ("infinite time", {"times": [0.0, np.inf]}, "Times", "infinite"),
    ("times too far apart", {"times": [-1e308, 1e308]}, "Times", "infinite"),
    ("NaN position", {"positions": np.array([0.0, 0.0, np.nan, 0.0])}, "Positions", "sample 1"),
    ("a value is missing", {"positions": np.zeros(3)}, "Positions", "4 values"),
    ("millimetres", {"positions": np.array([0.0, 0.0, 210.0, 0.0])}, "Positions", "metres"),
    ("a trigger is missing", {"triggers": [True]}, "Triggers", "2 triggers or none"),
    ("orientations in the plane", {"orientations": np.tile([0, 0, 0, 1.0], 2)}, "Orientations", "three dimensions"),
]


@pytest.mark.parametrize(("what", "given_", "argument", "words"), WRONG, ids=[row[0] for row in WRONG])
def test_a_wrong_append_is_refused_whole(what: str, given_: dict[str, Any], argument: str, words: str) -> None:
    made = recording()
    if "append before" in what:
        add(made, at_100_hz(10))
    before = (made.samples, made.button, made.presses)
    with pytest.raises(InvalidSamples, match=words) as refusal:
        add(made, **{"times": np.array([2.0, 2.1]), **given_})
    assert refusal.value.argument == argument
    assert (made.samples, made.button, made.presses) == before


def test_orientations_come_with_every_append_or_with_none() -> None:
    turned = np.tile([0.0, 0.0, 0.7071, 0.7071], (3, 1))
    made = recording(3)
    add(made, [0.0, 0.1, 0.2], orientations=turned.ravel())
    with pytest.raises(InvalidSamples, match="with all or with none"):
        add(made, [0.3, 0.4, 0.5])
    with pytest.raises(InvalidSamples, match="length 1"):
        add(made, [0.3, 0.4, 0.5], orientations=2 * turned.ravel())
    with pytest.raises(InvalidSamples, match="12 values"):
        add(made, [0.3, 0.4, 0.5], orientations=turned.ravel()[:8])
    made.close()
    shown = made.demonstration(made.presses[0]).orientations
    assert shown is not None
    np.testing.assert_allclose(np.linalg.norm(shown, axis=1), 1.0, rtol=1e-12)
    plain = recording(3)
    add(plain, [0.0, 0.1, 0.2])
    with pytest.raises(InvalidSamples, match="no orientations"):
        add(plain, [0.3, 0.4, 0.5], orientations=turned.ravel())


def test_limits_refuse_the_append_that_would_break_them() -> None:
    made = recording(bounds=Bounds(2, 30))
    add(made, at_100_hz(30), pressed(10, 20))
    with pytest.raises(LimitExceeded, match="31 samples"):
        add(made, at_100_hz(11, start=0.3), np.ones(11))
    add(made, at_100_hz(30, start=0.3), pressed(10, 20))
    with pytest.raises(LimitExceeded, match="2 demonstrations"):
        add(made, at_100_hz(30, start=0.6), pressed(10, 20))
    assert made.samples == 60
    made.close()
    assert len(made.presses) == 2


@given(
    lengths=st.lists(st.integers(1, 25), min_size=1, max_size=14),
    cuts=st.lists(st.integers(0, 200), max_size=8),
    steps=st.lists(st.sampled_from([0.004, 0.01, 0.03]), min_size=1, max_size=5),
)
@settings(deadline=None)
def test_how_samples_are_cut_into_appends_changes_nothing(
    lengths: list[int], cuts: list[int], steps: list[float]
) -> None:
    button = pressed(*lengths)
    times = np.cumsum(np.resize(steps, len(button)))
    whole, pieces = recording(), recording()
    add(whole, times, button)
    edges = sorted({0, *(cut % (len(button) + 1) for cut in cuts), len(button)})
    for start, end in itertools.pairwise(edges):
        add(pieces, times[start:end], button[start:end])
    assert pieces.all_presses == whole.all_presses
    whole.close()
    pieces.close()
    assert pieces.presses == whole.presses
    assert pieces.button == whole.button


@given(lengths=st.lists(st.integers(1, 25), min_size=1, max_size=14))
@settings(deadline=None)
def test_every_pressed_sample_is_in_one_demonstration_or_in_a_press_that_was_ignored(lengths: list[int]) -> None:
    button = pressed(*lengths)
    made = recording()
    add(made, at_100_hz(len(button)), button)
    made.close()
    covered = np.zeros(len(button), dtype=int)
    for one in made.presses:
        assert button[one.first]
        assert button[one.end - 1]
        covered[one.first : one.end] += 1
    assert covered.max(initial=0) <= 1
    lost = int((button & (covered == 0)).sum())
    assert lost == 0 or made.button.ignored > 0
    assert lost <= 5 * made.button.ignored + 5

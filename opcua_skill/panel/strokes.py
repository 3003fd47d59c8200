"""Strokes drawn on the plate, as demonstrations: metres and seconds, and a sentence for one that cannot be used."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from models.demonstration import Bools, Demonstration, Floats

PLATE_MM = (65.0, 90.0)
SHORTEST_MM = 5.0
FEWEST = 8
PAUSE = 0.2


class NotADemonstration(ValueError):
    """The sentence says what was wrong with the stroke, and what to do."""


def drawn(name: str, operator: str, t: Sequence[float], x_mm: Sequence[float], y_mm: Sequence[float]) -> Demonstration:
    """Return a stroke as a demonstration; raises NotADemonstration for a dot, a short dash or a broken one."""
    times, points = np.asarray(t, dtype=np.float64), np.array([x_mm, y_mm], dtype=np.float64).T / 1000.0
    if len(times) != len(points) or not (np.isfinite(times).all() and np.isfinite(points).all()):
        raise NotADemonstration("the stroke is broken: draw it again")
    if len(times) < FEWEST:
        raise NotADemonstration("the stroke has too few points: draw it in one slow movement")
    length = 1000.0 * float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum())
    if length < SHORTEST_MM:
        raise NotADemonstration("the stroke is shorter than 5 mm: keep the button or finger down while drawing")
    if not (np.diff(times) > 0).all():
        raise NotADemonstration("the stroke's times do not rise: draw it again")
    return Demonstration(
        demonstration_id=name,
        times=times - times[0],
        points=points,
        triggers=np.ones(len(times), dtype=bool),
        operator=operator,
        source="drawn at the panel",
        recorded_at=datetime.now(UTC),
    )


def free_name(taken: Sequence[str], stem: str = "stroke") -> str:
    """Return a name that nobody has: the stem and the next number."""
    number = 1
    while f"{stem}-{number:02d}" in taken:
        number += 1
    return f"{stem}-{number:02d}"


def appended(stroke: Demonstration, clock: float) -> tuple[Floats, Floats, Bools]:
    """Return a stroke as samples of a tracker after ``clock`` s: times (n,), points (n, 2), and the button (n,).

    The button is released at the end for long enough that nobody takes it for a bounce.
    """
    times = clock + PAUSE + stroke.times
    after = times[-1] + PAUSE * np.array([0.5, 1.0])
    points = np.concatenate([stroke.points, np.repeat(stroke.points[-1:], 2, axis=0)])
    pressed = np.concatenate([np.ones(len(times), dtype=bool), np.zeros(2, dtype=bool)])
    return np.concatenate([times, after]), points, pressed

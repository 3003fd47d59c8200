"""Groups of people whose right answer is known, on shapes of many kinds: what a learning should make of them."""

# pyright: reportAttributeAccessIssue=false, reportUnknownVariableType=false, reportUnknownMemberType=false

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from models.demonstration import Bools, Demonstration, Floats
from models.evaluation import resampled

POINTS = 2000
RATE = 100.0
WANDERS = 3  # slow waves of a hand along one drawing


@dataclass(frozen=True, slots=True, eq=False)
class KnownGroup:
    """People who drew ``path`` (n, d) in m, and what has to be said of them.

    ``expected``: ``path`` (that path and no remark), ``odd`` (that path without the people of ``others``), ``places``
    (two groups, told apart: refused, or noted, or the smaller one left out), ``disagree`` (nobody can tell), ``loop``
    (that ring, begun anywhere on it), ``part`` (that path, ``others`` used in part). ``size`` in m: how far the others
    are off. ``error`` in m: how far a right path may be from the true one.
    """

    kind: str
    people: list[Demonstration]
    path: Floats
    expected: str
    error: float
    others: frozenset[str] = frozenset()
    size: float = 0.0


def shape(name: str) -> Floats:
    """Return a shape's path (n, 2) in m, about 0.1 m wide."""
    turn = np.linspace(0.0, 1.0, POINTS)
    corners = {
        "zigzag": [[5, 5], [60, 25], [5, 45], [60, 65], [5, 85]],
        "frame": [[0, 0], [80, 0], [80, 60], [0, 60]],
        "ell": [[0, 0], [0, 70], [60, 70]],
        "line": [[0, 0], [90, 30]],
        "rectangle": [[0, 0], [80, 0], [80, 50], [0, 50], [0, 0]],
        "triangle": [[0, 0], [90, 10], [30, 70], [0, 0]],
    }
    if name in corners:
        return resampled(np.array(corners[name]) * 1e-3, POINTS)
    angle = 2.0 * np.pi * turn
    curves = {
        "wave": np.column_stack([100.0 * turn, 15.0 * np.sin(2.0 * angle)]),
        "arc": np.column_stack([40.0 * np.cos(0.6 * angle), 40.0 * np.sin(0.6 * angle)]),
        "spiral": np.column_stack([(15 + 30 * turn) * np.cos(1.5 * angle), (15 + 30 * turn) * np.sin(1.5 * angle)]),
        "ell-shaped bow": np.column_stack([90.0 * turn**2, 60.0 * turn]),
        "ellipse": np.column_stack([45.0 * np.cos(angle), 30.0 * np.sin(angle)]),
        "circle": np.column_stack([30.0 * np.cos(angle), 30.0 * np.sin(angle)]),
        "bean": np.column_stack(
            [(35.0 + 8.0 * np.cos(2 * angle)) * np.cos(angle), (30.0 + 6 * np.sin(angle)) * np.sin(angle)]
        ),
        "stadium": _stadium(),
    }
    return resampled(curves[name] * 1e-3, POINTS)


def _stadium() -> Floats:
    half = np.linspace(-np.pi / 2, np.pi / 2, 200)
    right = np.column_stack([30.0 + 20.0 * np.cos(half), 20.0 * np.sin(half)])
    return np.concatenate([right, -right, right[:1]])


OPEN = ("zigzag", "frame", "ell", "line", "wave", "arc", "spiral", "ell-shaped bow")
RINGS = ("ellipse", "circle", "bean", "stadium", "rectangle", "triangle")


def hand(
    generator: np.random.Generator, path: Floats, name: str, error: float, pressed: Bools | None = None
) -> Demonstration:
    """Return how a hand that errs by ``error`` m draws a path (n, 2): placed, turned, wavering, at its own pace."""
    middle, size = path.mean(axis=0), float(np.sqrt(12.0 * ((path - path.mean(axis=0)) ** 2).sum(axis=1).mean()))
    count = len(path)
    turn = generator.normal(0.0, error / size)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = (path - middle) @ rotation.T * (1.0 + generator.normal(0.0, error / size)) + middle
    points = points + generator.normal(0.0, error, 2)
    along = np.linspace(0.0, 1.0, count)
    for axis in range(2):
        for wave in range(1, WANDERS + 1):
            phase = generator.uniform(0.0, 2.0 * np.pi)
            points[:, axis] += (
                error / np.sqrt(WANDERS) * np.sin(np.pi * wave * generator.uniform(0.7, 1.4) * along + phase)
            )
    seconds = float(generator.uniform(5.0, 12.0))
    samples = round(seconds * RATE)
    clock = np.linspace(0.0, 1.0, samples)
    pace = np.ones(samples)
    for wave in (1, 2, 3):
        pace += 0.25 / wave * np.sin(2.0 * np.pi * (wave * clock + generator.uniform()))
    gone = np.concatenate([[0.0], np.cumsum(np.maximum(pace[1:], 0.15))])
    where = gone / gone[-1] * (count - 1)
    index = np.arange(count, dtype=np.float64)
    taken = np.column_stack([np.interp(where, index, axis) for axis in points.T])
    taken += generator.normal(0.0, 0.1e-3, taken.shape)
    button = np.ones(samples, dtype=bool) if pressed is None else pressed[np.round(where).astype(np.int64)]
    return Demonstration(name, np.arange(samples) / RATE, taken, button, operator=name)


def known_group(seed: int) -> KnownGroup:
    """Return the group of this seed: kinds take turns, the rest is drawn at random."""
    generator = np.random.default_rng([14, seed])
    makers = (_faultless, _two_places, _odd, _loop, _loop_with_approach, _lifts, _missing)
    return makers[seed % len(makers)](generator)


def _error(generator: np.random.Generator) -> float:
    return float(generator.uniform(0.3e-3, 1.2e-3))


def _faultless(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice([*OPEN, "ellipse", "rectangle"]))), _error(generator)
    count = int(generator.choice([2, 3, 5, 6, 12, 20]))
    people = [hand(generator, path, f"p{i:02d}", error) for i in range(count)]
    return KnownGroup("faultless", people, path, "path", 4.0 * error)


def _off(generator: np.random.Generator, size: float, low: float, high: float) -> Floats:
    angle, far = generator.uniform(0.0, 2.0 * np.pi), generator.uniform(low, high) * size
    return far * np.array([np.cos(angle), np.sin(angle)])


def _two_places(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice(OPEN))), float(generator.uniform(0.3e-3, 0.8e-3))
    count = int(generator.choice([4, 5, 6, 8, 12, 20]))
    there = int(generator.integers(2, count // 2 + 1))
    shift = _off(generator, 0.1, 0.1, 0.3)
    moved = set(generator.permutation(count)[:there].tolist())
    people = [hand(generator, path + (shift if i in moved else 0.0), f"p{i:02d}", error) for i in range(count)]
    others = frozenset(f"p{i:02d}" for i in moved)
    return KnownGroup("two places", people, path, "places", 4.0 * error, others, float(np.hypot(*shift)))


def _odd(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice(OPEN))), float(generator.uniform(0.3e-3, 0.8e-3))
    count = int(generator.choice([2, 3, 5]))
    one = int(generator.integers(count))
    if count == 2 or generator.random() < 0.5:
        off = _off(generator, 0.1, 0.15, 0.35)
        wrong, size = path + off, float(np.hypot(*off))
    else:
        place, size = generator.uniform(0.25, 0.75), float(generator.uniform(0.012, 0.025))
        bump = size * np.exp(-(((np.linspace(0.0, 1.0, POINTS) - place) / 0.06) ** 2))
        middle = np.abs(np.linspace(0.0, 1.0, POINTS) - place) < 0.2
        wrong = np.where(middle[:, None], path + bump[:, None] * _normal(path, place), path)
        size = float(cKDTree(path).query(wrong)[0].max())
    people = [hand(generator, wrong if i == one else path, f"p{i:02d}", error) for i in range(count)]
    expected = "disagree" if count == 2 else "odd"
    return KnownGroup(f"odd of {count}", people, path, expected, 4.0 * error, frozenset({f"p{one:02d}"}), size)


def _normal(path: Floats, place: float) -> Floats:
    index = round(place * (len(path) - 1))
    ahead = path[min(index + 20, len(path) - 1)] - path[max(index - 20, 0)]
    return np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)


def _begun(path: Floats, at: float) -> Floats:
    ring = path[:-1]
    turned = np.roll(ring, -round(at * len(ring)), axis=0)
    return np.concatenate([turned, turned[:1]])


def _loop(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice(RINGS))), float(generator.uniform(0.3e-3, 0.9e-3))
    count = int(generator.choice([3, 5, 6, 12]))
    starts = generator.choice(["anywhere", "two", "mostly"])
    at = {
        "anywhere": generator.uniform(0.0, 1.0, count),
        "two": np.where(np.arange(count) % 2 == 0, 0.0, 0.5),
        "mostly": np.where(generator.random(count) < 0.7, 0.1, generator.uniform(0.0, 1.0, count)),
    }[str(starts)]
    people = [hand(generator, _begun(path, float(a)), f"p{i:02d}", error) for i, a in enumerate(at)]
    return KnownGroup(f"loop, {starts}", people, path, "loop", 4.0 * error)


def _loop_with_approach(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice(RINGS))), float(generator.uniform(0.3e-3, 0.9e-3))
    count = int(generator.choice([3, 5, 6, 12]))
    people: list[Demonstration] = []
    for i in range(count):
        ring = _begun(path, float(generator.uniform(0.0, 1.0)) if generator.random() < 0.5 else 0.1)
        away = ring[0] + _off(generator, 0.1, 0.4, 1.0)
        approach = np.linspace(away, ring[0], 500)
        leaving = np.linspace(ring[-1], ring[-1] + _off(generator, 0.1, 0.3, 0.8), 300)
        whole = np.concatenate([approach[:-1], ring, leaving[1:]])
        pressed = np.zeros(len(whole), dtype=bool)
        pressed[499 : 499 + len(ring)] = True
        people.append(hand(generator, whole, f"p{i:02d}", error, pressed))
    return KnownGroup("loop with approach", people, path, "loop", 4.0 * error)


def _lifts(generator: np.random.Generator) -> KnownGroup:
    beads = [shape("line") * 0.6, shape("arc") * 0.5 + [0.1, 0.02], shape("wave") * 0.5 + [0.02, 0.09]]
    beads = beads[: int(generator.choice([2, 3]))]
    count, error = int(generator.choice([3, 5, 8])), float(generator.uniform(0.3e-3, 0.8e-3))
    people: list[Demonstration] = []
    for i in range(count):
        parts, pressed = [beads[0]], [np.ones(POINTS, dtype=bool)]
        for before, after in pairwise(beads):
            share = np.linspace(0.0, 1.0, 600)[1:-1, None]
            bow = _off(generator, 0.1, 0.0, 0.5)
            parts += [before[-1] + share * (after[0] - before[-1]) + np.sin(np.pi * share) * bow, after]
            pressed += [np.zeros(598, dtype=bool), np.ones(POINTS, dtype=bool)]
        whole, button = np.concatenate(parts), np.concatenate(pressed)
        if generator.random() < 0.4:
            chatter = int(generator.uniform(0.1, 0.9) * POINTS)
            button[chatter : chatter + 25] = False
        people.append(hand(generator, whole, f"p{i:02d}", error, button))
    return KnownGroup("lifts", people, np.concatenate(beads), "beads", 4.0 * error)


def _missing(generator: np.random.Generator) -> KnownGroup:
    path, error = shape(str(generator.choice(OPEN))), float(generator.uniform(0.3e-3, 0.8e-3))
    count = int(generator.choice([5, 6, 10]))
    people = [hand(generator, path, f"p{i:02d}", error) for i in range(count)]
    lost = int(generator.integers(count))
    first = generator.uniform(0.15, 0.6)
    points = people[lost].points.copy()
    points[int(first * len(points)) : int((first + generator.uniform(0.12, 0.25)) * len(points))] = np.nan
    people[lost] = replace(people[lost], points=points)
    return KnownGroup("missing stretch", people, path, "part", 4.0 * error, frozenset({f"p{lost:02d}"}))

"""The path of K straight lines handing over to each other that lies nearest to the people's mean.

Where each component lives on the clock, how wide it hands over and its line are found together, by Levenberg's and
Marquardt's steps on the distance across the path, counted in standard errors of the mean. Which point of the path
belongs to which of the mean is found anew after each step (orthogonal distance regression): what slides along the
path changes when, not where.
"""

from dataclasses import dataclass

import numpy as np

from models.demonstration import Floats
from models.geometry import dots, norms
from models.mixture.handover import ALONG, Fit, Handover, local_lines
from models.yardstick import WINDOW, MeanPath

STEPS = 12  # the quickest settle in three, the slowest gain nothing after ten
SETTLED = 0.01  # a step that gains less than this share of the squared misfit is the last one
PULL = 1e-3  # squared standard errors for a component moved by its own extent: holds what no data hold
ENDS = 100.0  # points that either end counts as: both are held, exactly in the end
FAR, NEARING, NEAR = 500.0, 3.0, 2.0  # squared standard errors: who is not near, and nears less than threefold a step


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """What is to be met: ``values`` (n, m), the first ``dimension`` of them a place in m, at clock values ``clock``
    (n,); each counts by ``weights`` (n, m), one over its standard error. ``ahead`` (n, d): where the mean moves.
    """

    clock: Floats
    values: Floats
    weights: Floats
    ahead: Floats
    dimension: int
    length: float


def target_of(people: MeanPath) -> Target:
    """Return the people's mean, and how they hold the tool, as a target."""
    count, dimension = people.points.shape
    values, errors = people.points, np.repeat(people.errors[:, None], dimension, axis=1)
    if people.turned is not None:
        values = np.concatenate([values, people.turned], axis=1)
        errors = np.concatenate([errors, np.full(people.turned.shape, people.turned_error)], axis=1)
    length = float(norms(np.diff(people.points, axis=0)).sum())
    return Target(np.linspace(0.0, 1.0, count), values, 1.0 / errors, people.ahead, dimension, length)


@dataclass(frozen=True, slots=True, eq=False)
class _Guess:
    """Centres (K,), logarithms of extents (K,), lines (2 K, m), and where on the clock (n,) the target's points are."""

    centres: Floats
    logarithms: Floats
    lines: Floats
    clock: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """The path of a guess at its clock values: activations and offsets (K, n), points (n, m)."""

    activations: Floats
    offsets: Floats
    points: Floats


def refined(target: Target, start: Handover, patient: bool) -> tuple[Fit, float]:
    """Return the hand-over and lines nearest to the target that are reached from a start, and the mean squared distance
    in standard errors, with what was paid for moving away from the start.

    Unless ``patient``, one that will hardly come near is given up.
    """
    components = len(start.centres)
    first = _Guess(start.centres, np.log(start.extents), local_lines(start, target.clock, target.values), target.clock)
    pulls = _pulls(target, first)
    guess, path, pace = first, _evaluated(first), target.ahead
    cost, damping = np.inf, PULL
    for step in range(STEPS):
        matrix, right = _normal_equations(target, guess, path, pace)
        matrix[np.diag_indices(len(matrix))] += pulls
        right -= pulls * _away(guess, first)
        only_lines = step == 0 or components == 1
        for _ in range(4):
            moved, beyond = _footed(target, _stepped(guess, matrix, right, damping, only_lines))
            reached = _cost(target, moved, beyond, pulls, first)
            if step == 0 or reached < cost:
                break
            damping *= 8.0
        else:
            break
        gain, cost, damping = cost - reached, reached, max(damping / 4.0, 1e-6)
        guess, path = moved, beyond
        pace = _pace(guess, path)[:, : target.dimension]
        settled = step > 1 and gain < SETTLED * cost
        if settled or (components == 1 and step == 1) or (not patient and cost > max(NEAR, FAR * NEARING**-step)):
            break
    order = np.argsort(guess.centres, kind="stable")
    chosen = np.concatenate([order, order + components])
    return Fit(Handover(guess.centres[order], np.exp(guess.logarithms[order])), guess.lines[chosen]), cost


def _evaluated(guess: _Guess) -> _Path:
    offsets = (guess.clock - guess.centres[:, None]) * np.exp(-guess.logarithms)[:, None]
    shares = offsets * offsets
    shares -= shares.min(axis=0)
    shares *= -0.5
    np.exp(shares, out=shares)
    shares /= shares.sum(axis=0)
    both = np.concatenate([shares, shares * offsets])
    return _Path(shares, offsets, both.T @ guess.lines)


def _pace(guess: _Guess, path: _Path) -> Floats:
    """Return the change (n, m) of a path with the clock."""
    rates = np.exp(-guess.logarithms)[:, None]
    turning = path.offsets * -rates
    change = path.activations * turning
    change -= path.activations * np.add.reduce(change, axis=0)
    both = np.concatenate([change, change * path.offsets + path.activations * rates])
    return both.T @ guess.lines


def _footed(target: Target, guess: _Guess) -> tuple[_Guess, _Path]:
    """Return the guess with each point of the target at the nearest place of the path, by two of Newton's steps, and
    the path there.
    """
    path = _evaluated(guess)
    part = slice(0, target.dimension)
    for _ in range(2):
        pace = _pace(guess, path)[:, part]
        square = dots(pace, pace) + ALONG * target.length**2
        ahead = dots(target.values[:, part] - path.points[:, part], pace) / square
        clock = guess.clock + np.minimum(np.maximum(ahead, -0.25 * WINDOW), 0.25 * WINDOW)
        clock = np.minimum(np.maximum(clock, target.clock - WINDOW), target.clock + WINDOW)
        clock = np.maximum.accumulate(np.minimum(np.maximum(clock, 0.0), 1.0))
        clock[0], clock[-1] = 0.0, 1.0
        guess = _Guess(guess.centres, guess.logarithms, guess.lines, clock)
        path = _evaluated(guess)
    return guess, path


def _cost(target: Target, guess: _Guess, path: _Path, pulls: Floats, first: _Guess) -> float:
    rest = (target.values - path.points) * target.weights
    squares = rest * rest
    return float((squares.sum() + ENDS * squares[[0, -1]].sum()) / len(rest) + (pulls * _away(guess, first) ** 2).sum())


def _pulls(target: Target, first: _Guess) -> Floats:
    """Return what moving away from the first guess costs: for centres, logarithms of extents, lines."""
    components, outputs = len(first.centres), first.lines.shape[1]
    stretch = np.ones(outputs)
    stretch[: target.dimension] = target.length / components
    lines = np.tile(stretch**-2.0, 2 * components)
    return (PULL / components) * np.concatenate([np.exp(-2.0 * first.logarithms), np.ones(components), lines])


def _away(guess: _Guess, first: _Guess) -> Floats:
    return np.concatenate(
        [guess.centres - first.centres, guess.logarithms - first.logarithms, (guess.lines - first.lines).ravel()]
    )


def _normal_equations(target: Target, guess: _Guess, path: _Path, pace: Floats) -> tuple[Floats, Floats]:
    """Return J'J and J'r of the distances across the path, in standard errors, for centres, extents and lines."""
    components, outputs = len(guess.centres), guess.lines.shape[1]
    values, slopes = guess.lines[:components], guess.lines[components:]
    count, directions = len(target.clock), _across(target, pace)
    ends = np.repeat(np.sqrt(ENDS) * np.eye(outputs)[:, None], 2, axis=1)
    places = np.concatenate([np.arange(count)] * outputs + [np.array([0, count - 1])] * outputs)
    way = np.concatenate([directions.reshape(-1, outputs), ends.reshape(-1, outputs)]) * target.weights[places]
    share, offset = path.activations[:, places], path.offsets[:, places]
    line = slopes @ way.T
    beside = values @ way.T + line * offset - dots(way, path.points[places])
    moving = share * (beside * offset - line)
    jacobian = np.empty((2 * components * (1 + outputs), len(way)))
    np.multiply(moving, np.exp(-guess.logarithms)[:, None], out=jacobian[:components])
    np.multiply(moving, offset, out=jacobian[components : 2 * components])
    ours = jacobian[2 * components :].reshape(2, components, outputs, -1)
    np.multiply(share[:, None], way.T, out=ours[0])
    np.multiply(ours[0], offset[:, None], out=ours[1])
    missing = dots(way, (target.values - path.points)[places])
    return jacobian @ jacobian.T / count, jacobian @ missing / count


def _across(target: Target, pace: Floats) -> Floats:
    """Return the directions (m, n, m) that count: across the path, a little along it, and the whole of what is no
    place.
    """
    count, outputs = target.values.shape
    dimension = target.dimension
    unit = pace / np.maximum(norms(pace), 1e-300)[:, None]
    rows = np.zeros((outputs, count, outputs))
    rows[0, :, :dimension] = unit * np.sqrt(ALONG)
    if dimension == 2:
        rows[1, :, 0], rows[1, :, 1] = -unit[:, 1], unit[:, 0]
    else:
        one = np.cross(unit, np.eye(3)[np.abs(unit).argmin(axis=1)])
        one /= np.maximum(norms(one), 1e-300)[:, None]
        rows[1, :, :3], rows[2, :, :3] = one, np.cross(unit, one)
    for column in range(dimension, outputs):
        rows[column, :, column] = 1.0
    return rows


def _stepped(guess: _Guess, matrix: Floats, right: Floats, damping: float, only_lines: bool) -> _Guess:
    components, outputs = len(guess.centres), guess.lines.shape[1]
    free = 2 * components
    if only_lines:
        moves = np.linalg.solve(matrix[free:, free:], right[free:])
        return _Guess(guess.centres, guess.logarithms, guess.lines + moves.reshape(-1, outputs), guess.clock)
    damped = matrix.copy()
    places = np.arange(free)
    damped[places, places] += damping * (matrix[places, places] + PULL)
    moves = np.linalg.solve(damped, right)
    reach = 2.0 * np.exp(guess.logarithms)
    return _Guess(
        guess.centres + np.minimum(np.maximum(moves[:components], -reach), reach),
        guess.logarithms + np.minimum(np.maximum(moves[components:free], -0.7), 0.7),
        guess.lines + moves[free:].reshape(-1, outputs),
        guess.clock,
    )

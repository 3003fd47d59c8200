"""Drawings nobody tuned to: gentle shapes that must not be flattened, chance waves that must not be followed, and how
well the covariances foretell the next person.

Every group is simulated with a known truth, or real (the LASA shapes, twenty people's strokes).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning_material import lasa, lasa_at_hand
from benchmarks.learning_rows import Row, row
from models.alignment.aligned import AlignedDemonstrations
from models.alignment.registration import mean_of
from models.demonstration import Demonstration, Floats
from models.evaluation import frechet
from models.learning import LearnedMotion, LearningOptions, learn
from models.mixture.fitting import fit_path, mixture_of, timing
from models.motion import Motion
from models.phase import arc_lengths, at
from models.synthetic import CAMERA, TREMBLE, WANDER, ZIGZAG, raster
from models.yardstick import mean_path, misfit, retimed

MILLIMETRE = 1e-3
DENSE = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What people are asked to draw: ``truth`` (n, 2) in m, densely; ``hand`` how far in m they miss its place."""

    name: str
    kind: str
    truth: Floats
    hand: float = MILLIMETRE


def bow(share: float, length: float = 0.1) -> Floats:
    """Return an arc (n, 2) of this chord in m whose middle is a ``share`` of it off."""
    half = 2.0 * np.arctan(2.0 * share)
    radius = 0.5 * length / np.sin(half)
    turns = np.linspace(-half, half, DENSE)
    return np.column_stack([radius * np.sin(turns) + 0.5 * length, radius * (np.cos(turns) - np.cos(half))])


def seam(length: float) -> Floats:
    """Return an S (n, 2) of this length in m, 1.2 % of it to either side."""
    way = np.linspace(0.0, 1.0, DENSE)
    return length * np.column_stack([way, 0.012 * np.sin(2.0 * np.pi * way)])


def weave(periods: float, height: float, length: float = 0.2) -> Floats:
    """Return a wave (n, 2) of so many periods and this height in m to either side."""
    way = np.linspace(0.0, 1.0, 2 * DENSE)
    return np.column_stack([length * way, height * np.sin(2.0 * np.pi * periods * way)])


def bowed_square(share: float, side: float = 0.08) -> Floats:
    """Return three and a half edges (n, 2) of a square, each an arc whose middle is a ``share`` of the edge off."""
    edges: list[Floats] = []
    edge, corner = bow(share, side), np.zeros(2)
    for quarter in range(4):
        angle = 0.5 * np.pi * quarter
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        edges.append(edge @ turn.T + corner)
        corner = edges[-1][-1]
    return np.concatenate(edges)[: round(3.5 * DENSE)]


def drawings() -> list[Drawing]:
    """Return the gentle shapes of the table."""
    found = [Drawing(f"bow {100 * share:g} %", "bow", bow(share)) for share in (0.002, 0.005, 0.01, 0.015, 0.02, 0.05)]
    found += [Drawing(f"seam {length:g} m", "seam", seam(length)) for length in (0.1, 0.5, 1.0, 5.0, 9.0)]
    found += [
        Drawing(f"weave {n:g} x {1e3 * h:g} mm", "weave", weave(n, h))
        for n, h in ((3, 1.6e-3), (6, 1.6e-3), (20, 6e-3))
    ]
    found += [
        Drawing(f"square {100 * share:g} %", "square", bowed_square(share)) for share in (0.005, 0.01, 0.02, 0.04)
    ]
    return found


def polygons() -> list[Drawing]:
    """Return zigzags, strokes and rasters of the table."""
    three = np.array([[5.0, 5.0], [45.0, 18.0], [38.0, 50.0], [70.0, 60.0]]) * MILLIMETRE
    found = [("zigzag", ZIGZAG), ("three edges", three)]
    found += [(f"raster {lines}", raster(lines)) for lines in (6, 10)]
    return [Drawing(name, "polygon", dense(corners)) for name, corners in found]


def dense(corners: Floats) -> Floats:
    """Return a polyline (c, 2) with many points (n, 2), its corners among them."""
    parts = [np.linspace(start, end, 400, endpoint=False) for start, end in pairwise(corners)]
    return np.concatenate([*parts, corners[-1:]])


def drawn_by(number: int, seed: int, drawing: Drawing) -> list[Demonstration]:
    """Return so many people's demonstrations: each beside the truth, turned, larger or smaller, wandering, trembling,
    at a pace of their own, seen by cameras.
    """
    generator = np.random.default_rng([seed, number, len(drawing.name)])
    truth, hand = drawing.truth, drawing.hand
    lengths = arc_lengths(truth)
    radius = 0.5 * float(np.ptp(truth, axis=0).max())
    people: list[Demonstration] = []
    for person in range(number):
        count = round(100.0 * generator.uniform(6.0, 14.0))
        times = np.arange(count) / 100.0
        paces = [
            generator.uniform(-0.5, 0.5) * np.sin(2.0 * np.pi * rate * times / times[-1] + generator.uniform(0.0, 6.3))
            for rate in (1.0, 2.0, 3.0)
        ]
        pace = 1.0 + 0.5 * np.sum(paces, axis=0)
        way = np.concatenate([[0.0], np.cumsum(pace[1:])])
        own = at(way / way[-1] * lengths[-1], lengths, truth)
        angle = generator.normal(0.0, min(np.deg2rad(1.0), hand / radius))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = truth.mean(axis=0)
        own = (own - middle) @ turn.T * (1.0 + generator.normal(0.0, min(0.01, hand / radius))) + middle
        own += generator.normal(0.0, hand, 2)
        for axis in range(2):
            for rate in generator.uniform(0.1, 0.8, 4):
                own[:, axis] += WANDER * 0.5 * np.sin(2.0 * np.pi * rate * times + generator.uniform(0.0, 6.3))
            own[:, axis] += TREMBLE * np.sin(2.0 * np.pi * 10.0 * times + generator.uniform(0.0, 6.3))
        own += generator.normal(0.0, CAMERA, own.shape)
        people.append(Demonstration(f"person-{person}", times, own, np.ones(count, dtype=bool)))
    return people


FEW_SOME_MANY = (3, 6, 20)
NOMINAL = np.array([39.0, 86.0, 99.0])
NEWCOMERS = 6


def yardstick() -> Iterator[Row]:
    """Give the rows of gentle shapes, of how many components, and of how well covariances foretell the next person."""
    yield from _gentle_shapes()
    yield from _components()
    yield from _coverage()


def _gentle_shapes() -> Iterator[Row]:
    for number in FEW_SOME_MANY:
        ratios: list[float] = []
        unsaid = 0
        for drawing in drawings():
            learned = learn(drawn_by(number, 0, drawing), compare=False)
            people = _aligned(learned)
            mean = mean_path(people.points, people.weights, None)
            path = learned.motion.points_at(np.linspace(0.0, 1.0, len(mean.points)))
            ratios.append(frechet(path, drawing.truth, 300) / frechet(mean.points, drawing.truth, 300))
            told = any(finding.code == "path-simplified" for finding in learned.report.findings)
            unsaid += not told and not misfit(mean, path, None).agrees
        usual, most = float(np.exp(np.log(ratios).mean())), max(ratios)
        over = sum(ratio > 1.1 for ratio in ratios)
        runs = len(ratios)
        name = f"gentle shapes, {number} people: Fréchet by the aligned mean's"
        yield row(f"{name}, geometric mean", usual, "<= 1", usual <= 1.0, runs=runs)
        yield row(f"{name}, largest ({over} over 1.1)", most, "<= 1.1", most <= 1.1, runs=runs)
        goal = "0 without a word"
        name = f"gentle shapes, {number} people: over two standard errors off"
        yield row(name, unsaid, goal, unsaid == 0, runs=runs)


def _components() -> Iterator[Row]:
    counts: list[int] = []
    same = apart = groups = 0
    for shape in lasa_at_hand():
        people = lasa(shape)
        whole = learn(people, compare=False).report.components
        counts.append(whole)
        without = [
            learn([*people[:out], *people[out + 1 :]], compare=False).report.components for out in range(len(people))
        ]
        usual = max(set(without), key=without.count)
        same += sum(count == usual for count in without)
        apart += sum(count > 2 * usual or 2 * count < usual for count in without)
        groups += len(without)
    if not counts:
        return
    middle = float(np.median(counts))
    yield row(f"LASA: components, median (largest {max(counts)})", middle, "<= 5", middle <= 5.0, runs=len(counts))
    share = 100.0 * same / groups
    yield row("LASA: as many components when one is left out, %", share, ">= 90", share >= 90.0, runs=groups)
    yield row("LASA: more than twice as many or as few", apart, "0", apart == 0, runs=groups)


def _coverage() -> Iterator[Row]:
    """People aligned together, some learned from, the others foretold."""
    chosen = [
        one for one in [*drawings(), *polygons()] if one.name in {"bow 5 %", "seam 0.5 m", "square 2 %", "zigzag"}
    ]
    groups = [_aligned(learn(drawn_by(max(FEW_SOME_MANY) + NEWCOMERS, 1, one), compare=False)) for one in chosen]
    for number in FEW_SOME_MANY:
        shares: list[Floats] = []
        for people in groups:
            for turn in range(3):
                order = np.random.default_rng(turn).permutation(len(people.points))
                ours, others = _some(people, order[:number]), _some(people, order[-NEWCOMERS:])
                fit, aligned, _ = fit_path(ours, LearningOptions())
                duration, times = timing(aligned)
                mixture = mixture_of(fit, aligned, times, "path", duration)
                motion = Motion(mixture.means, mixture.covariances, "path", 2, duration, (), 0.008, "within")
                points, covariances = motion.at_phases(np.linspace(0.0, 1.0, len(times)))
                others = others.at_instants(retimed(points, mean_of(ours.points, ours.weights)))
                offsets = (others.points - points)[np.isfinite(others.points[:, :, 0])]
                spread = np.broadcast_to(covariances, (*others.points.shape[:2], 2, 2))
                spread = spread[np.isfinite(others.points[:, :, 0])]
                squares = (offsets * np.linalg.solve(spread, offsets[:, :, None])[:, :, 0]).sum(axis=1)
                shares.append(np.array([100.0 * (squares <= limit).mean() for limit in (1.0, 4.0, 9.0)]))
        found = np.mean(shares, axis=0)
        off = float(np.abs(found - NOMINAL).max())
        told = "/".join(f"{share:.0f}" for share in found)
        name = f"next person inside 1/2/3 σ, {number} people: {told} %, furthest from nominal"
        yield row(name, off, "<= 4", off <= 4.0, runs=len(shares))


def _aligned(learned: LearnedMotion) -> AlignedDemonstrations:
    points = np.stack([one.points for one in learned.aligned])
    times = np.stack([one.times for one in learned.aligned])
    weights = np.isfinite(points[:, :, 0]).astype(np.float64)
    return AlignedDemonstrations(points, times, weights, None, weights)


def _some(people: AlignedDemonstrations, rows: NDArray[np.int64]) -> AlignedDemonstrations:
    return AlignedDemonstrations(
        people.points[rows], people.times[rows], people.triggers[rows], None, people.weights[rows]
    )

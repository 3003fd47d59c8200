"""The plane that demonstrations were drawn in, which no reflection turns: a consensus, measured by its errors."""

# scipy leaves its results untyped: what leaves a function here is typed by its signature.
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from library.errors import InvalidValue
from models.demonstration import Bools, Demonstration, Floats
from models.geometry import norms

GAUSS = NormalDist()
LEAST_OFF = 0.5e-3
TRIES = 400
JUDGES = 1000
KEPT = 0.75
ROUNDS = 30
BATCHES = 8
MOST_TURN = np.radians(15.0)


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane: ``origin`` (3,) in m, ``axes`` (2, 3) of unit length.

    ``deviation`` is the RMS distance in m of the samples it was laid through, ``farthest`` the greatest of all samples
    that were seen; ``left_out`` of them were too far off to be the hand's.
    """

    origin: Floats
    axes: Floats
    deviation: float
    farthest: float
    left_out: int = 0

    def words(self) -> str:
        """Return how flat the samples lie as a sentence without its end."""
        off, most = 1000 * self.deviation, 1000 * self.farthest
        told = f"the samples lie {off:.2f} mm from one plane (RMS), {most:.2f} mm at most"
        return f"{told}; {self.left_out} that are no positions of the hand were left out" if self.left_out else told


def believable(demonstrations: Sequence[Demonstration]) -> list[Floats]:
    """Return of each demonstration the points (n, d) that learning would use: seen, and no reflections."""
    # Slow to import, and whoever only reads does not need it.
    from models.errors import UnusableDemonstration
    from models.preprocessing.filtering import clean

    found: list[Floats] = []
    for one in demonstrations:
        try:
            used = clean(one, frozenset(), 0.0, despiking=True).used
        except UnusableDemonstration:
            # Learning will say so; until then it counts as it is.
            used = np.isfinite(one.points).all(axis=1)
        found.append(one.points[used])
    return found


def common_plane(demonstrations: Sequence[Demonstration]) -> Plane:
    """Return the plane nearest to the samples of 3-D demonstrations, by least squares over those that are the hand's.

    Its first axis points as near along x as the plane allows (y, if the plane stands across x), its normal up.
    Refused are demonstrations along one line: their plane could be turned about it, up to standing on edge.
    """
    if any(one.dimension != 3 for one in demonstrations) or not demonstrations:
        raise InvalidValue("demonstrations", len(demonstrations), "one or more are needed, all in three dimensions")
    parts = believable(demonstrations)
    points = np.concatenate(parts)
    inside = _consensus(points)
    origin, sizes, directions = _fitted(points[inside])
    if len(points) < 3 or sizes[1] <= 1e-9 * max(float(sizes[0]), 1e-300):
        raise InvalidValue("demonstrations", float(sizes[0]), "they span a plane: these lie on one line")
    normal = directions[2] * (-1.0 if _points_down(directions[2]) else 1.0)
    turn = 3.0 * _doubt(parts, inside, origin, sizes, normal)
    if turn > MOST_TURN:
        unsure = f"about which it may be turned by {min(90.0, np.degrees(turn)):.0f} degrees"
        along = f"they span a plane: these lie on one line, {unsure}; show a wider stroke, or learn them in space"
        raise InvalidValue("demonstrations", float(sizes[1]), along)
    towards = np.eye(3)[1 if abs(normal[0]) > 0.9 else 0]
    first = towards - normal * (towards @ normal)
    first = first / np.linalg.norm(first)
    second = np.cross(normal, first)
    every = np.concatenate([one.points[np.isfinite(one.points).all(axis=1)] for one in demonstrations])
    farthest = float(np.abs((every - origin) @ normal).max())
    return Plane(origin, np.array([first, second]), float(sizes[2]), farthest, len(every) - int(inside.sum()))


def _fitted(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the middle (3,) of points, their RMS (3,) along and their directions (3, 3), the widest first."""
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    _, sizes, directions = np.linalg.svd(np.vstack([points - middle, np.zeros((3, 3))]), full_matrices=False)
    return middle, sizes / np.sqrt(max(1, len(points))), directions


def _consensus(points: Floats) -> Bools:
    """Return which points (n,) lie in the plane that most of them agree on, or all where there is no plane.

    Planes through three points each are tried, the spread of most points about the best one says how flat the hand
    is, and the plane is taken that the most points agree with, given that. Farther off than the farthest of so many
    errors (Chauvenet), and than the half millimetre that a reflection has at least, is none of the hand's.
    """
    every = np.ones(len(points), dtype=np.bool_)
    if len(points) < 4:
        return every
    judges = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), JUDGES)).astype(np.int64))]
    corners = judges[np.random.default_rng(0).integers(0, len(judges), (TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = norms(normals)
    usable = lengths > 1e-12 * max(float(np.ptp(judges, axis=0).max()) ** 2, 1e-300)
    middles, normals = corners[usable, 0], normals[usable] / lengths[usable, None]
    middle, _, directions = _fitted(judges)
    middles, normals = np.vstack([middles, middle]), np.vstack([normals, directions[2]])
    place = int(KEPT * (len(judges) - 1))
    away = np.abs(judges @ normals.T - (middles * normals).sum(axis=1))
    spreads = np.partition(away, place, axis=0)[place]
    best = np.argsort(spreads)[:10]
    planes = [_settled(judges, middles[one], normals[one], place) for one in (*best.tolist(), len(normals) - 1)]
    spread = min(one[2] for one in planes) / GAUSS.inv_cdf(0.5 + 0.5 * KEPT)
    reach = max(LEAST_OFF, -GAUSS.inv_cdf(0.25 / len(points)) * spread)

    def disagreement(plane: tuple[Floats, Floats, float]) -> float:
        off = (judges - plane[0]) @ plane[1]
        return float(np.minimum(off * off, reach * reach).sum())

    middle, normal, _ = min(planes, key=disagreement)
    inside: Bools = np.asarray(np.abs((points - middle) @ normal) <= reach)
    for _ in range(ROUNDS):
        if int(inside.sum()) < 3:
            return every
        middle, _, directions = _fitted(points[inside])
        again: Bools = np.asarray(np.abs((points - middle) @ directions[2]) <= reach)
        if (again == inside).all():
            break
        inside = again
    return inside


def _settled(points: Floats, middle: Floats, normal: Floats, place: int) -> tuple[Floats, Floats, float]:
    """Return middle, normal and spread of the plane through the nearest points, found again until they stay."""
    away = np.abs((points - middle) @ normal)
    spread = float(np.partition(away, place)[place])
    for _ in range(ROUNDS):
        again, _, directions = _fitted(points[away <= spread])
        away = np.abs((points - again) @ directions[2])
        now = float(np.partition(away, place)[place])
        if now >= spread:
            break
        middle, normal, spread = again, directions[2], now
    return middle, normal, spread


def _doubt(parts: list[Floats], inside: Bools, origin: Floats, sizes: Floats, normal: Floats) -> float:
    """Return the standard error in radians of the plane's turn about the line that the points lie along.

    It is that of an eigenvector of a covariance, for as many independent errors as there are: a hand that is off stays
    off for a while, which means over batches of neighbours tell.
    """
    pieces = np.split(inside, np.cumsum([len(one) for one in parts])[:-1])
    errors = [(part[kept] - origin) @ normal for part, kept in zip(parts, pieces, strict=True)]
    batches = [batch for one in errors for batch in np.array_split(one, BATCHES) if len(batch)]
    lasting = float(np.mean([float(batch.mean()) ** 2 for batch in batches]))
    usual = float(np.mean(np.square(np.concatenate(errors))))
    independent = min(float(inside.sum()), len(batches) * usual / lasting) if lasting > 0.0 else float(inside.sum())
    wide, thick = float(sizes[1]) ** 2, float(sizes[2]) ** 2
    return float(np.sqrt(wide * thick) / max(wide - thick, 1e-300) / np.sqrt(independent))


def _points_down(normal: Floats) -> bool:
    """Return whether the last component that matters is negative: up is z, then y, then x."""
    decisive = next(float(value) for value in normal[::-1] if abs(value) > 1e-6)
    return decisive < 0

"""How a newly learned path compares: to the version before it, and to what the paper's preset makes of the same people.

Nothing here touches the motion that was learned: it is measured, and the figures go into its report.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from models.alignment.aligned import taken_at
from models.alignment.dtw import Indices, warp
from models.alignment.registration import mean_of
from models.demonstration import Demonstration, Edits, Floats
from models.errors import LearningError
from models.evaluation import frechet, resampled, smoothness
from models.geometry import norms
from models.motion import Motion
from models.options import LearningOptions
from models.phase import arc_lengths, at
from models.preprocessing.filtering import CleanMotion, clean
from models.presets.paper import fit_aligned
from models.report import Previous

PATH_POINTS = 1000
SMOOTHNESS_POINTS = 300
PAPER_SAMPLES = 128
PAPER_RECORDING = 2000
PAPER_DEMONSTRATIONS = 40


@dataclass(frozen=True, slots=True)
class Distance:
    """How far two paths lie apart, in m: closest points both ways (root mean square and largest), discrete Fréchet.

    ``place`` is the phase 0..1 of the first path where they are furthest apart, ``point`` (d) in m the place itself.
    """

    rms: float
    max: float
    frechet: float
    place: float
    point: tuple[float, ...]


def distance(path: Floats, other: Floats) -> Distance:
    """Return how far a path (n, d), at even phases, lies from another one (m, d)."""
    there, _ = _to_polyline(path, other)
    back, nearest = _to_polyline(resampled(other, PATH_POINTS), path)
    worst = int(there.argmax()) if there.max() >= back.max() else int(nearest[int(back.argmax())])
    return Distance(
        rms=float(np.sqrt(0.5 * ((there * there).mean() + (back * back).mean()))),
        max=float(max(there.max(), back.max())),
        frechet=frechet(path, other),
        place=worst / (len(path) - 1),
        point=tuple(float(value) for value in path[worst]),
    )


def _to_polyline(points: Floats, line: Floats) -> tuple[Floats, Indices]:
    """Return each point's (n, d) distance (n,) to a polyline (m, d), and which of its corners (n,) is nearest."""
    nearest = np.asarray(KDTree(line).query(points)[1], dtype=np.int64)
    away = np.full(len(points), np.inf)
    for first in (nearest - 1, nearest):
        start = np.clip(first, 0, len(line) - 2)
        side = line[start + 1] - line[start]
        square = np.maximum((side * side).sum(axis=1), 1e-300)
        share = np.clip(((points - line[start]) * side).sum(axis=1) / square, 0.0, 1.0)
        rest = points - line[start] - share[:, None] * side
        away = np.minimum(away, norms(rest))
    return away, nearest


def to_previous(motion: Motion, repeatability: float | None, previous: Previous) -> dict[str, Any]:
    """Return what has changed since the version before, as JSON-able values: each figure ``before`` and ``now``.

    ``repeatability`` is the root mean square along the path of this version's deviation, in m.
    """
    path = _path(motion)
    found: dict[str, Any] = {"version": previous.version}
    before = previous.motion
    if before.dimension != motion.dimension:
        found["note"] = f"version {previous.version} has {before.dimension} dimensions, this one {motion.dimension}"
        return found
    old = _path(before)
    found["distance"] = asdict(distance(path, old))
    for name, was, now in (
        ("duration", before.duration, motion.duration),
        ("length", _length(old), _length(path)),
        ("components", len(before.means), len(motion.means)),
        ("repeatability", previous.repeatability, repeatability),
        ("smoothness", _smoothness(before), _smoothness(motion)),
    ):
        found[name] = {"before": was, "now": now}
    return found


def to_paper(motion: Motion, demonstrations: Sequence[Demonstration], edits: Edits, window: float) -> dict[str, Any]:
    """Return how the paper's preset does on the same demonstrations, those that are recordings of a motion at all.

    Its cost is bounded: at most 40 of the demonstrations, evenly chosen, at most 128 samples of each, warped exactly
    instead of by FastDTW. ``path_error`` and ``end_error`` are what the report of the preset itself would tell:
    distance to the mean of the demonstrations as it aligns them. ``distance`` is how far its path lies from ours.
    """
    motions = _as_published(demonstrations, edits, window)
    if len(motions) < 2:
        return {"note": "fewer than two demonstrations are usable as they are"}
    longest = max(motions, key=lambda one: len(one.times))
    count = min(PAPER_SAMPLES, len(longest.times))
    thinned = [_thinned(one, count) for one in motions]
    times = np.linspace(longest.times[0], longest.times[-1], count)
    reference = next(one for one, whole in zip(thinned, motions, strict=True) if whole is longest)
    positions = warp(reference.points, np.stack([one.points for one in thinned])).positions
    aligned = taken_at(thinned, positions, np.ones_like(positions))
    try:
        fitted = fit_aligned(aligned, times, LearningOptions(preset="paper"))
    except LearningError as refused:
        return {"note": str(refused)}
    mixture = fitted.mixture
    theirs = Motion(
        mixture.means, mixture.covariances, "time", motion.dimension, fitted.duration, (), 0.008, fitted.covariance_rule
    )
    mean = mean_of(aligned.points, aligned.weights)
    path = _path(theirs)
    return {
        "components": len(mixture.means),
        "demonstrations": len(motions),
        "path_error": path_error(theirs.points_at(fitted.phases), mean),
        "end_error": end_error(path, mean),
        "length": _length(path),
        "smoothness": _smoothness(theirs),
        "distance": asdict(distance(_path(motion), path)),
    }


def path_error(path: Floats, mean: Floats) -> dict[str, float]:
    """Return the distance in m of a path (n, d) from a mean (n, d) at the same phases: root mean square and largest."""
    away = norms(path - mean)
    return {"rms": float(np.sqrt((away * away).mean())), "max": float(away.max())}


def end_error(path: Floats, mean: Floats) -> dict[str, float]:
    """Return how far in m a path (n, d) starts and ends from where a mean (m, d) does."""
    start, end = norms(path[[0, -1]] - mean[[0, -1]])
    return {"start": float(start), "end": float(end)}


def _path(motion: Motion) -> Floats:
    return motion.points_at(np.linspace(0.0, 1.0, PATH_POINTS))


def _length(path: Floats) -> float:
    return float(arc_lengths(path)[-1])


def _smoothness(motion: Motion) -> float:
    return smoothness(motion.points_at(np.linspace(0.0, 1.0, SMOOTHNESS_POINTS)))


def _as_published(demonstrations: Sequence[Demonstration], edits: Edits, window: float) -> list[CleanMotion]:
    """Return the motions the paper's preset would use: moving average alone, no reflections taken out."""
    most = min(len(demonstrations), PAPER_DEMONSTRATIONS)
    found: list[CleanMotion] = []
    for index in np.unique(np.linspace(0, len(demonstrations) - 1, most).round().astype(np.int64)):
        one, struck = _strided(demonstrations[int(index)], edits)
        try:
            found.append(clean(one, struck, window, despiking=False))
        except LearningError:
            continue
    return found


def _strided(one: Demonstration, edits: Edits) -> tuple[Demonstration, frozenset[int]]:
    """Return every so many samples of a long recording, at most 2000 of them, and which of these are struck."""
    struck = edits.struck.get(one.demonstration_id, frozenset())
    stride = len(one.times) // PAPER_RECORDING + 1
    if stride == 1:
        return one, struck
    kept = slice(None, None, stride)
    thin = replace(one, times=one.times[kept], points=one.points[kept], triggers=one.triggers[kept], orientations=None)
    return thin, frozenset(index // stride for index in struck if index % stride == 0)


def _thinned(motion: CleanMotion, count: int) -> CleanMotion:
    """Return a motion at ``count`` even instants of its own time, without gaps and without orientation."""
    grid = np.linspace(motion.times[0], motion.times[-1], count)
    points = at(grid, motion.times, motion.points)
    everything = np.ones(count, dtype=bool)
    return replace(
        motion, times=grid, points=points, triggers=everything, known=everything, used=everything, orientations=None
    )

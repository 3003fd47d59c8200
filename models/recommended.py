"""The recommended pipeline: people laid upon each other, odd ones found, components over the path with chosen
hand-overs.
"""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from dataclasses import replace

import numpy as np

from models.cleaning import CleanMotion
from models.correspondence import Correspondence, Fitted, Progress, Remark, between, taken_at
from models.demonstration import Floats
from models.errors import MixedDemonstrations
from models.experts import Fit, Handover, MeanPath, fit_handover, lines, retimed
from models.geometry import diagonal, norms
from models.group import Group, lay_upon_each_other, mean_of, reference_of, taken
from models.mixture import Mixture
from models.oddness import against_direction, first_pass, mismatch, odd_ones, wavering
from models.options import LearningOptions
from models.phase import arc_lengths, at, travelled
from models.placing import laid_freely
from models.shapes import other_shapes
from models.stretches import Extra, Pause, extras, pauses
from models.tips import laid_at_tips, sharp_corners

POINTS = 256
LONG = 4.0
MOST_FINER = 2.0
CLOCK_POINTS = 300
FIT_ROWS = 2000
ROUNDS = 3
LEAST_PACE = 0.25
MIXED = 0.12
COVARIANCE_FLOOR = 1e-5


def fit_recommended(motions: list[CleanMotion], options: LearningOptions, tell: Progress) -> Fitted:
    """Return the mixture of what the motions have in common."""
    in_part: dict[int, Remark] = {}
    left_out: dict[int, Remark] = {}
    motions = list(motions)
    curves, places = _curves(motions)
    repeated = first_pass(curves)
    for index, end in repeated.items():
        motions[index] = _until(motions[index], float(places[index][end]))
        in_part[index] = Remark("drawn more than once: the first time is used", code="drawn-twice")
    if repeated:
        curves, places = _curves(motions)
    if options.place == "free":
        motions = laid_freely(motions, curves)
        curves, places = _curves(motions)
    others = other_shapes([motion.demonstration_id for motion in motions], curves)
    rows = list(range(len(motions)))
    typical = reference_of(curves)
    if options.reject_outliers:
        left_out.update(others)
        for index in against_direction(curves, typical):
            words = "drawn in the opposite direction: draw it again from the other end"
            left_out[index] = Remark(words, code="opposite-direction")
        rows = [row for row in rows if row not in left_out]
    typical = reference_of(curves[rows]) if left_out else typical
    group, aligned = _laid(motions, curves, places, rows, typical, options)
    for turn in range(ROUNDS if options.reject_outliers else 0):
        tell(0.5 + 0.05 * turn, "aligning")
        odd = odd_ones(aligned.points, aligned.weights)
        if not odd:
            break
        left_out.update({rows[row]: remark for row, remark in odd.items()})
        rows = [row for i, row in enumerate(rows) if i not in odd]
        group, aligned = _laid(motions, curves, places, rows, reference_of(curves[rows]), options)
    if mismatch(aligned.points, aligned.weights) > MIXED:
        raise MixedDemonstrations(
            "the demonstrations do not show the same shape: learn those that belong together, exclude the others"
        )
    tell(0.7, "fitting")
    for i, row in enumerate(rows):
        if group.early[i] or group.late[i]:
            in_part[row] = _partly(group, i)
        elif not np.isfinite(aligned.points[i, :, 0]).all():
            place = float(np.flatnonzero(~np.isfinite(aligned.points[i, :, 0]))[0]) / (aligned.points.shape[1] - 1)
            words = f"the marker was lost at {place:.2f} of the path: used around it"
            in_part[row] = Remark(words, place, code="marker-lost")
    fit, aligned = _fit(aligned, options)
    duration, times = _timing(aligned)
    mixture = _mixture(fit, aligned, times, options.clock or "path", duration)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    name = "time" if options.clock == "time" else "path"
    paused, extra = _stretches(motions, curves, places, rows, group, aligned)
    return Fitted(
        mixture, name, duration, phases, aligned, tuple(rows), "within", left_out, in_part, {}, (), paused, extra
    )


def _stretches(
    motions: list[CleanMotion],
    curves: Floats,
    places: Floats,
    rows: list[int],
    group: Group,
    aligned: Correspondence,
) -> tuple[dict[int, tuple[Pause, ...]], dict[int, tuple[Extra, ...]]]:
    """Return where the motions of these rows stood still and what they drew beyond the others, by the path's phase."""
    path = mean_of(taken(curves[rows], group.positions), group.weights)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    paused: dict[int, tuple[Pause, ...]] = {}
    extra: dict[int, tuple[Extra, ...]] = {}
    for i, row in enumerate(rows):
        there = np.isfinite(aligned.times[i])
        own, common = np.maximum.accumulate(aligned.times[i, there]), phases[there]
        still = pauses(motions[row])
        middles = np.interp([one.start + 0.5 * one.duration for one in still], own, common)
        if still:
            paused[row] = tuple(replace(one, place=float(where)) for one, where in zip(still, middles, strict=True))
        seconds = np.interp(places[row], np.arange(len(motions[row].times), dtype=np.float64), motions[row].times)
        beyond = extras(curves[row], group.positions[i], path, seconds)
        middles = np.interp([one.start + 0.5 * one.duration for one in beyond], own, common)
        if beyond:
            extra[row] = tuple(replace(one, place=float(where)) for one, where in zip(beyond, middles, strict=True))
    return paused, extra


def _curves(motions: list[CleanMotion]) -> tuple[Floats, Floats]:
    """Return each motion at points (u, n, d), evenly spaced along its way, and their fractional samples (u, n).

    256 points follow most drawings to the millimetre; one that is longer than four times its own diagonal, such as a
    raster, gets up to twice as many.
    """
    curves, places = _sampled(motions, POINTS)
    ways = norms(np.diff(curves, axis=1)).sum(axis=1)
    long = float(np.median(ways / np.maximum([diagonal(curve) for curve in curves], 1e-300))) / LONG
    return (curves, places) if long <= 1.0 else _sampled(motions, 2 * round(0.5 * POINTS * min(long, MOST_FINER)))


def _sampled(motions: list[CleanMotion], points: int) -> tuple[Floats, Floats]:
    places: list[Floats] = []
    curves: list[Floats] = []
    for motion in motions:
        index = np.arange(len(motion.times), dtype=np.float64)
        places.append(np.interp(np.linspace(0.0, 1.0, points), travelled(motion), index))
        curves.append(at(places[-1], index, motion.points))
    return np.stack(curves), np.stack(places)


def _laid(
    motions: list[CleanMotion],
    curves: Floats,
    places: Floats,
    rows: list[int],
    typical: int,
    options: LearningOptions,
) -> tuple[Group, Correspondence]:
    """Return how the motions of these rows lie upon each other, seen from the typical one of them, and they themselves
    at even instants of their mean path.
    """
    method = options.alignment or "dtw"
    motions, curves, places = [motions[row] for row in rows], curves[rows], places[rows]
    group = lay_upon_each_other(curves, typical, method, options.radius or 1)
    sharp = sharp_corners(mean_of(taken(curves, group.positions), group.weights))
    if method == "dtw":
        group = replace(group, positions=laid_at_tips(motions, places, group.positions, sharp))
    samples = _samples_of(places, group.positions)
    drawn = zip(samples, motions, strict=True)
    points = [at(where, np.arange(len(one.points), dtype=np.float64), one.points) for where, one in drawn]
    path = mean_of(np.stack(points), group.weights)
    instants = _even_instants(path, [corner.tip for corner in sharp])
    samples = _samples_of(places, between(group.positions, instants))
    return group, taken_at(motions, samples, between(group.weights, instants))


def _until(motion: CleanMotion, sample: float) -> CleanMotion:
    count = max(4, int(sample) + 1)
    turned = None if motion.orientations is None else motion.orientations[:count]
    return replace(
        motion,
        times=motion.times[:count],
        points=motion.points[:count],
        triggers=motion.triggers[:count],
        known=motion.known[:count],
        orientations=turned,
    )


def _samples_of(places: Floats, positions: Floats) -> Floats:
    """Return the fractional samples (u, m) of the motions at positions (u, m) on their curves; NaN stays NaN."""
    index = np.arange(places.shape[1], dtype=np.float64)
    return np.stack([np.interp(where, index, own) + 0.0 * where for where, own in zip(positions, places, strict=True)])


def _even_instants(path: Floats, sharp: list[int]) -> Floats:
    """Return 300 fractional instants (or more, where more points are drawn) evenly along a mean path (n, d), and in
    place of the nearest ones the sharp corners themselves: between two instants a tip would be cut off.
    """
    lengths = arc_lengths(path)
    index = np.arange(len(lengths), dtype=np.float64)
    count = round(CLOCK_POINTS * len(lengths) / POINTS)
    instants = np.interp(np.linspace(0.0, lengths[-1], count), lengths, index)
    for corner in sharp:
        instants[1 + int(np.abs(instants[1:-1] - corner).argmin())] = corner
    return instants


def _partly(group: Group, row: int) -> Remark:
    words: list[str] = []
    place = float(group.last[row])
    if group.late[row]:
        place = float(group.first[row])
        words.append(f"started at {place:.2f} of the path: used from there")
    if group.early[row]:
        words.append(f"let go at {float(group.last[row]):.2f} of the path: used up to there")
    return Remark(" and ".join(words), place, code="started-late" if group.late[row] else "let-go-early")


def _fit(aligned: Correspondence, options: LearningOptions) -> tuple[Fit, Correspondence]:
    """Return hand-over and lines of the mean path, and the motions at the instants nearest to the path so fitted."""
    if options.clock == "time":
        _, times = _timing(aligned)
        even = np.linspace(0.0, 1.0, len(times))
        aligned = aligned.at_instants(np.interp(even, times / times[-1], np.arange(len(times), dtype=np.float64)))
    mean = mean_of(aligned.points, aligned.weights)
    spread = float(np.sqrt(np.nanmean(((aligned.points - mean) ** 2).sum(axis=2))))
    turned = None if aligned.orientations is None else mean_of(aligned.orientations, aligned.weights)
    people = MeanPath(mean, spread / np.sqrt(len(aligned.points)), wavering(aligned.points, mean), turned)
    fit = fit_handover(people, _samples(aligned), options.components)
    path = fit.handover.basis(np.linspace(0.0, 1.0, len(mean))) @ fit.coefficients
    return fit, aligned.at_instants(retimed(path, mean))


def _samples(aligned: Correspondence) -> Floats:
    """Return clock and position (r, 1 + d) of the motions, about 2000 rows: more do not move the mixture.

    Every instant is there, for a short edge has few of them; of many people, others at each instant.
    """
    count, instants = aligned.times.shape
    every = max(1, round(count * instants / FIT_ROWS))
    turns = (np.arange(count)[:, None] + np.arange(instants)) % every == 0
    clock = np.broadcast_to(np.linspace(0.0, 1.0, instants), aligned.times.shape)
    rows = np.concatenate([clock[:, :, None], aligned.points], axis=2)[turns]
    return rows[np.isfinite(rows).all(axis=1)]


def _timing(aligned: Correspondence) -> tuple[float, Floats]:
    """Return the duration in s (the median of those who drew all of it) and the mean time (n,) at each instant.

    Each motion counts by the share of its own time, so that a slow one does not outweigh the others.
    """
    own = aligned.times - np.nanmin(aligned.times, axis=1, keepdims=True)
    whole = np.asarray(np.isfinite(own[:, [0, -1]]).all(axis=1))
    used = own[whole] if whole.any() else own
    totals = np.nanmax(used, axis=1, keepdims=True)
    duration = float(np.median(totals))
    paces = np.nan_to_num(np.diff(used / totals, axis=1))
    times = np.concatenate([[0.0], np.cumsum(np.maximum(paces.mean(axis=0), 1e-6))])
    return duration, times * (duration / times[-1])


def _mixture(fit: Fit, aligned: Correspondence, times: Floats, clock: str, duration: float) -> Mixture:
    """Return means and covariances: the lines of all outputs under the hand-over, and what the people differ from
    them.
    """
    handover = fit.handover
    components = len(handover.centres)
    grid = np.linspace(0.0, 1.0, len(times))
    basis = handover.basis(grid)
    coefficients = [fit.coefficients]
    values = [aligned.points]
    if clock == "path":
        coefficients.insert(0, _never_stopping(lines(handover, times[:, None]), handover, duration))
        values.insert(0, _own_times(aligned, times)[:, :, None])
    if aligned.orientations is not None:
        coefficients.append(lines(handover, mean_of(aligned.orientations, aligned.weights)))
        values.append(aligned.orientations)
    line = np.concatenate(coefficients, axis=1)
    residuals = np.concatenate(values, axis=2) - basis @ line
    width = line.shape[1]
    means = np.empty((components, 1 + width))
    covariances = np.empty((components, 1 + width, 1 + width))
    known = np.asarray(np.isfinite(residuals).all(axis=2))
    residuals = np.where(known[:, :, None], residuals, 0.0)
    size = diagonal(mean_of(aligned.points, aligned.weights))
    floor = np.full(width, (COVARIANCE_FLOOR * size) ** 2)
    for k in range(components):
        slope = line[components + k] / handover.extents[k]
        share = (known * basis[:, k]).reshape(-1, 1)
        flat = residuals.reshape(-1, width)
        within = (share * flat).T @ flat / max(float(share.sum()), 1e-12) + np.diag(floor)
        extent = handover.extents[k] ** 2
        means[k] = np.concatenate([[handover.centres[k]], line[k]])
        covariances[k, 0, 0] = extent
        covariances[k, 0, 1:] = covariances[k, 1:, 0] = slope * extent
        covariances[k, 1:, 1:] = 0.5 * (within + within.T) + np.outer(slope, slope) * extent
    if clock == "time":
        means[:, 0] *= duration
        covariances[:, 0, :] *= duration
        covariances[:, :, 0] *= duration
    return Mixture(means, covariances)


def _own_times(aligned: Correspondence, times: Floats) -> Floats:
    """Return each motion's time (u, n) in s on the common scale: those who drew only a part are laid upon the mean
    there.
    """
    result = np.empty_like(aligned.times)
    for row, own in enumerate(aligned.times):
        there = np.flatnonzero(np.isfinite(own))
        first, last = there[0], there[-1]
        pace = (times[last] - times[first]) / max(float(own[last] - own[first]), 1e-9)
        result[row] = times[first] + (own - own[first]) * pace
    return result


def _never_stopping(coefficients: Floats, handover: Handover, duration: float) -> Floats:
    """Return the lines of time (2 K, 1), evened just so much that time runs at a quarter of its mean pace at least."""
    basis = handover.basis(np.linspace(0.0, 1.0, 4 * CLOCK_POINTS))
    even = duration * np.concatenate([handover.centres, handover.extents])[:, None]
    slowest = float(np.diff((basis @ coefficients)[:, 0]).min()) * (4 * CLOCK_POINTS - 1) / duration
    if slowest >= LEAST_PACE:
        return coefficients
    share = (LEAST_PACE - slowest) / (1.0 - slowest)
    return (1.0 - share) * coefficients + share * even

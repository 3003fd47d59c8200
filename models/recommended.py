"""The recommended pipeline: people laid upon each other, odd ones found, components over the path with chosen
hand-overs.
"""

# numpy and scipy leave many results untyped: what leaves a function here is typed by its signature.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false

from dataclasses import replace

import numpy as np

from models.cleaning import CleanMotion
from models.correspondence import Correspondence, Fitted, Progress
from models.demonstration import Floats
from models.experts import Fit, Handover, MeanPath, fit_handover, lines, retimed
from models.geometry import diagonal
from models.group import mean_of, taken
from models.mixture import Mixture
from models.oddness import wavering
from models.options import LearningOptions
from models.screening import Screened, screened
from models.stretches import Extra, Pause, extras, pauses

CLOCK_POINTS = 300
FIT_ROWS = 2000
LEAST_PACE = 0.25
COVARIANCE_FLOOR = 1e-5


def fit_recommended(motions: list[CleanMotion], options: LearningOptions, tell: Progress) -> Fitted:
    """Return the mixture of what the motions have in common."""
    found = screened(motions, options, tell)
    tell(0.7, "fitting")
    aligned = found.aligned
    fit, aligned = _fit(aligned, options)
    duration, times = _timing(aligned)
    mixture = _mixture(fit, aligned, times, options.clock or "path", duration)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    name = "time" if options.clock == "time" else "path"
    paused, extra = _stretches(found, aligned)
    who = found.who
    return Fitted(
        mixture,
        name,
        duration,
        phases,
        aligned,
        tuple(who[row] for row in found.rows),
        "within",
        found.lacking | {who[row]: remark for row, remark in found.left_out.items()},
        {who[row]: remark for row, remark in found.in_part.items()},
        {},
        tuple(found.findings),
        {who[row]: told for row, told in paused.items()},
        {who[row]: told for row, told in extra.items()},
    )


def _stretches(
    found: Screened, aligned: Correspondence
) -> tuple[dict[int, tuple[Pause, ...]], dict[int, tuple[Extra, ...]]]:
    """Return where the motions of these rows stood still and what they drew beyond the others, by the path's phase."""
    drawings, group = found.drawings.of(found.rows), found.group
    path = mean_of(taken(drawings.curves, group.positions), group.weights)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    paused: dict[int, tuple[Pause, ...]] = {}
    extra: dict[int, tuple[Extra, ...]] = {}
    for i, row in enumerate(found.rows):
        motion, places = drawings.motions[i], drawings.places[i]
        there = np.isfinite(aligned.times[i])
        own, common = np.maximum.accumulate(aligned.times[i, there]), phases[there]
        still = pauses(motion)
        middles = np.interp([one.start + 0.5 * one.duration for one in still], own, common)
        if still:
            paused[row] = tuple(replace(one, place=float(where)) for one, where in zip(still, middles, strict=True))
        seconds = np.interp(places, np.arange(len(motion.times), dtype=np.float64), motion.times)
        beyond = extras(drawings.curves[i], group.positions[i], path, seconds)
        middles = np.interp([one.start + 0.5 * one.duration for one in beyond], own, common)
        if beyond:
            extra[row] = tuple(replace(one, place=float(where)) for one, where in zip(beyond, middles, strict=True))
    return paused, extra


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

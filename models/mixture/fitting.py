"""From people laid upon each other to means and covariances: the path they agreed on, and by how much the next person
will differ from it.
"""

import numpy as np
from scipy.special import chdtr, fdtri

from models.alignment.aligned import AlignedDemonstrations
from models.alignment.registration import mean_of
from models.demonstration import Bools, Floats
from models.findings import Finding
from models.geometry import norms
from models.mixture.gating import JudgedFit, fit_handover
from models.mixture.gmm import Mixture
from models.mixture.handover import Fit, Handover, lines
from models.options import LearningOptions
from models.yardstick import WHOLE_PATH, MeanPath, mean_path, retimed

LEAST_PACE = 0.25  # of the mean pace: time that stands still on the path cannot be read from it
LEAST_SPREAD = 1e-5  # of the path's length: a covariance has to have an inverse where people do not differ at all
PACE_STEPS = 1200  # of the clock at which that pace is looked at: four for each instant of the mean


def fit_path(
    aligned: AlignedDemonstrations, options: LearningOptions
) -> tuple[Fit, AlignedDemonstrations, tuple[Finding, ...]]:
    """Return hand-over and lines of the mean path, the motions at the instants nearest to the path so fitted, and what
    is to be known of it: that it is simpler than what the people agreed on.
    """
    if options.clock == "time":
        _, times = timing(aligned)
        even = np.linspace(0.0, 1.0, len(times))
        aligned = aligned.at_instants(np.interp(even, times / times[-1], np.arange(len(times), dtype=np.float64)))
    people = mean_path(aligned.points, aligned.weights, aligned.orientations)
    found = fit_handover(people, options.components)
    path = found.fit.handover.basis(np.linspace(0.0, 1.0, len(people.points))) @ found.fit.coefficients
    simpler = () if found.misfit.agrees else (_simplified(people, found),)
    return found.fit, aligned.at_instants(retimed(path, people.points)), simpler


def _simplified(people: MeanPath, found: JudgedFit) -> Finding:
    """Return by how much the path is simpler than the people's mean, against how sure they were."""
    misfit, components = found.misfit, len(found.fit.handover.centres)
    there = round(misfit.place * (len(people.points) - 1))
    sure = float(people.errors[there])
    off = misfit.worst * sure
    words = (
        f"the shape is simplified with {components} components: {1e3 * off:.1f} mm off the people's mean at "
        f"{misfit.place:.2f} of the path, where it is sure to {1e3 * sure:.1f} mm"
    )
    return Finding("path-simplified", words, misfit.place, off)


def timing(aligned: AlignedDemonstrations) -> tuple[float, Floats]:
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


def mixture_of(fit: Fit, aligned: AlignedDemonstrations, times: Floats, clock: str, duration: float) -> Mixture:
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
    length = float(norms(np.diff(basis @ fit.coefficients, axis=0)).sum())
    blocks = _blocks(aligned, clock)
    predicted = _spread_of_the_next(known, basis, residuals, blocks) + np.eye(width) * (LEAST_SPREAD * length) ** 2
    for k, within in enumerate(predicted):
        slope = line[components + k] / handover.extents[k]
        extent = handover.extents[k] ** 2
        means[k] = np.concatenate([[handover.centres[k]], line[k]])
        covariances[k, 0, 0] = extent
        covariances[k, 0, 1:] = covariances[k, 1:, 0] = slope * extent
        covariances[k, 1:, 1:] = within + np.outer(slope, slope) * extent
    if clock == "time":
        means[:, 0] *= duration
        covariances[:, 0, :] *= duration
        covariances[:, :, 0] *= duration
    return Mixture(means, covariances)


def _blocks(aligned: AlignedDemonstrations, clock: str) -> list[slice]:
    """Return which outputs are of one kind: time, place, how the tool is held."""
    widths = [1] if clock == "path" else []
    widths += [aligned.points.shape[2], *([] if aligned.orientations is None else [aligned.orientations.shape[2]])]
    ends = np.cumsum(widths)
    return [slice(int(end) - width, int(end)) for end, width in zip(ends, widths, strict=True)]


def _spread_of_the_next(known: Bools, basis: Floats, residuals: Floats, blocks: list[slice]) -> Floats:
    """Return the covariances (K, m, m) by which the next person will differ from the path, not those who drew it.

    What few people differ by where one component lives is pooled with what they differ by on the whole path, alike in
    all directions. The factors: the next one is off the mean by (n + 1) / (n - 1) times what n people's mean square
    off it says, and as the square itself is unsure, by Student's quantile for Gauss's at the mean square distance, so
    that as many are within it as Gauss says.
    """
    width = residuals.shape[2]
    components = basis.shape[1] // 2
    flat = residuals.reshape(-1, width)
    own = np.empty((components, width, width))
    masses = np.empty(components)
    for k in range(components):
        share = (known * basis[:, k]).reshape(-1, 1)
        masses[k] = float(share.sum())
        square = (share * flat).T @ flat / max(masses[k], 1e-12)
        own[k] = 0.5 * (square + square.T)
    whole = (own * (masses / masses.sum())[:, None, None]).sum(axis=0)
    pooled, factors = np.zeros((width, width)), np.ones(width)
    people = max(float(known.sum(axis=0).mean()), 1.0 + 1e-9)
    free = people - 1.0
    for block in blocks:
        size = block.stop - block.start
        pooled[block, block] = np.eye(size) * np.trace(whole[block, block]) / size
        sure = max(size * (free + WHOLE_PATH) - size + 1.0, 1.0)
        student = float(fdtri(size, sure, chdtr(size, size)))
        factors[block] = np.sqrt((people + 1.0) / free * student)
    mixed = (free * own + WHOLE_PATH * pooled) / (free + WHOLE_PATH)
    return mixed * np.outer(factors, factors)


def _own_times(aligned: AlignedDemonstrations, times: Floats) -> Floats:
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
    basis = handover.basis(np.linspace(0.0, 1.0, PACE_STEPS))
    even = duration * np.concatenate([handover.centres, handover.extents])[:, None]
    slowest = float(np.diff((basis @ coefficients)[:, 0]).min()) * (PACE_STEPS - 1) / duration
    if slowest >= LEAST_PACE:
        return coefficients
    share = (LEAST_PACE - slowest) / (1.0 - slowest)
    return (1.0 - share) * coefficients + share * even

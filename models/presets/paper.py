"""The pipeline as published: moving average, FastDTW to the longest demonstration, components over time, free
expectation
maximisation with four components, regression with the covariance of equation 6. Kept as it is, to compare with.

Only means and covariances are kept of the mixture, as the paper says. Its priors are free, so that what reads the
two arrays with the priors' formula gets another path than the mixture was fitted to: up to 0.1 mm on the paper's plate.
"""

from dataclasses import replace

import numpy as np

from models.alignment.aligned import AlignedDemonstrations, taken_at
from models.alignment.dtw import warp, warp_fast
from models.demonstration import Floats
from models.mixture.gmm import fit_free, in_bins
from models.options import LearningOptions, Progress
from models.phase import arc_lengths, at
from models.preprocessing.filtering import CleanMotion, moving_average
from models.presets.fit_result import FitResult

COMPONENTS = 4
MOST_SAMPLES = 2000


def fit_as_published(motions: list[CleanMotion], options: LearningOptions, tell: Progress) -> FitResult:
    """Return the paper's mixture of the motions, each with its place on the clock of the longest one."""
    aligned, times = _to_longest(motions, options.alignment or "fastdtw", options.radius or 1)
    tell(0.7, "fitting")
    return fit_aligned(aligned, times, options)


def fit_aligned(aligned: AlignedDemonstrations, times: Floats, options: LearningOptions) -> FitResult:
    """Return the paper's mixture of motions aligned to the longest one, whose times (n,) are in s."""
    duration = float(times[-1] - times[0])
    if options.clock == "path":
        lengths = arc_lengths(moving_average(aligned.points.mean(axis=0), 5))
        phases = lengths / lengths[-1]
        kept = np.concatenate([[True], np.diff(phases) > 0])
        aligned, phases = aligned.at_instants(np.flatnonzero(kept).astype(np.float64)), phases[kept]
    else:
        phases = (times - times[0]) / duration
    clock = phases * (1.0 if options.clock == "path" else duration)
    rows: list[Floats] = []
    for i, points in enumerate(aligned.points):
        columns = [clock[:, None]]
        if options.clock == "path":
            own = aligned.times[i] - aligned.times[i, 0]
            columns.append((own * (duration / own[-1]))[:, None])
        columns.append(points)
        if aligned.orientations is not None:
            columns.append(aligned.orientations[i])
        rows.append(np.concatenate(columns, axis=1))
    samples = np.concatenate(rows)
    edges = np.linspace(clock[0], clock[-1], (options.components or COMPONENTS) + 1)
    mixture = fit_free(samples, in_bins(samples, edges))
    everyone = tuple(range(len(aligned.points)))
    name = "path" if options.clock == "path" else "time"
    return FitResult(mixture, name, duration, phases, aligned, everyone, "paper", {}, {}, {}, ())


def _to_longest(motions: list[CleanMotion], method: str, radius: int) -> tuple[AlignedDemonstrations, Floats]:
    """Return the motions warped to the one with most samples, sample for sample of it, and its times (n,)."""
    reference = motions[int(np.argmax([len(motion.times) for motion in motions]))]
    stride = -(-len(reference.times) // MOST_SAMPLES) if method == "dtw" else 1
    places = np.arange(0, len(reference.times), stride)
    positions: list[Floats] = []
    for motion in motions:
        if method == "fastdtw":
            positions.append(warp_fast(reference.points, motion.points, radius))
        else:
            grid = np.linspace(0, len(motion.times) - 1, min(len(motion.times), MOST_SAMPLES))
            other = at(grid, np.arange(len(motion.times), dtype=np.float64), motion.points)
            found = warp(reference.points[places], other[None]).positions[0]
            positions.append(np.interp(found, np.arange(len(grid)), grid))
    shape = (len(motions), len(places))
    whole = [_known(motion) for motion in motions]
    return taken_at(whole, np.stack(positions), np.ones(shape)), reference.times[places]


def _known(motion: CleanMotion) -> CleanMotion:
    """Return the motion with its gaps bridged by straight lines however long: the paper does not speak of gaps."""
    return replace(motion, known=np.ones(len(motion.times), dtype=bool))

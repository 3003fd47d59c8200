"""From demonstrations to a motion: the two pipelines, ``recommended`` and ``paper``, and what is reported of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from models.cleaning import CleanMotion, clean, moving_average
from models.correspondence import Correspondence, to_longest
from models.demonstration import Demonstration, Edits, Floats
from models.errors import MixedDemonstrations, SkillError, TooFewDemonstrations, UnknownDemonstration
from models.evaluation import smoothness
from models.mixture import Mixture, fit_free, fit_tied, in_bins
from models.motion import Motion
from models.options import LearningOptions
from models.phase import arc_lengths, corners
from models.group import diagonal
from models.recommended import to_common_shape
from models.report import (
    AlignedDemonstration,
    DemonstrationError,
    Fault,
    LearnedMotion,
    LearningReport,
    Verdict,
    VerdictKind,
)

__all__ = [
    "AlignedDemonstration",
    "LearnedMotion",
    "LearningOptions",
    "LearningReport",
    "Verdict",
    "VerdictKind",
    "learn",
    "samples_along_path",
]

Progress = Callable[[float, str], None]
FILTER_WINDOW = 0.07
PAPER_COMPONENTS = 4
MOST_COMPONENTS = 12
CORNER_TOLERANCE = 0.05
CLOCK_POINTS = 300
TIME_STEP = 0.008


def learn(
    demonstrations: Sequence[Demonstration],
    edits: Edits | None = None,
    options: LearningOptions | None = None,
    progress: Progress | None = None,
) -> LearnedMotion:
    """Return the motion that the demonstrations have in common, with a verdict for each and a report.

    A recording that cannot be used is left out, and its verdict says why; fewer than two usable ones raise TooFewDemonstrations.
    """
    edits, options = edits or Edits(), options or LearningOptions()
    tell = progress or (lambda done, what: None)
    _check_edits(demonstrations, edits)
    verdicts: dict[int, Verdict] = {}
    motions: dict[int, CleanMotion] = {}
    despiking = options.preset == "recommended"
    for index, demonstration in enumerate(demonstrations):
        tell(0.4 * index / len(demonstrations), "cleaning")
        name = demonstration.demonstration_id
        if name in edits.excluded:
            verdicts[index] = _left_out(name, "excluded by an operator", "excluded")
            continue
        try:
            motions[index] = clean(
                demonstration, edits.struck.get(name, frozenset()), options.filter_window or FILTER_WINDOW, despiking
            )
        except SkillError as error:
            verdicts[index] = _left_out(name, str(error), "invalid")
    if len({motion.points.shape[1] for motion in motions.values()}) > 1:
        raise MixedDemonstrations("some demonstrations have two dimensions and some three: learn them apart")
    if len(motions) < 2:
        reasons = tuple(verdict.reason for verdict in verdicts.values())[:3]
        raise TooFewDemonstrations(len(motions), 2, reasons)
    order = sorted(motions)
    cleaned = [motions[index] for index in order]
    tell(0.4, "aligning")
    if despiking:
        aligned, group = to_common_shape(cleaned, options.alignment or "dtw", options.radius or 1)
        reached = np.where(group.early, group.last, 1.0)
        reference_times = np.empty(0)
    else:
        aligned, reference_times = to_longest(cleaned, options.alignment or "fastdtw", options.radius or 1)
        reached = np.ones(len(cleaned))
    for index, fraction in zip(order, reached, strict=True):
        verdicts[index] = _used(demonstrations[index].demonstration_id, float(fraction))
    tell(0.7, "fitting")
    clock = options.clock or ("path" if despiking else "time")
    phases = _path_phases(aligned) if clock == "path" else _time_phases(aligned, reference_times)
    duration = _duration(aligned, reference_times)
    on_grid = _on_clock(aligned, phases) if despiking else aligned
    grid = np.linspace(0.0, 1.0, CLOCK_POINTS) if despiking else phases
    samples = _samples(on_grid, grid, duration, clock)
    mixture = _fit(samples, on_grid, grid * (duration if clock == "time" else 1.0), options)
    motion = Motion(
        mixture.means,
        mixture.covariances,
        "path" if clock == "path" else "time",
        aligned.points.shape[2],
        duration,
        _dispense(on_grid, grid),
        options.time_step or TIME_STEP,
        "within" if despiking else "paper",
    )
    tell(0.9, "reporting")
    times = motion.times_at(grid)
    shown = tuple(
        AlignedDemonstration(
            demonstrations[index].demonstration_id,
            _raw_phases(demonstrations[index], motions[index], aligned.times[row], phases),
            times,
            on_grid.points[row],
            np.nan_to_num(on_grid.triggers[row]) > 0.5,
        )
        for row, index in enumerate(order)
    )
    every = tuple(verdicts[index] for index in range(len(demonstrations)))
    report = _report(motion, on_grid, grid, [demonstrations[index].demonstration_id for index in order], every, options)
    tell(1.0, "learned")
    return LearnedMotion(motion, every, shown, report)


def samples_along_path(
    motion: Motion, aligned: Sequence[AlignedDemonstration], indices: Sequence[int]
) -> dict[str, frozenset[int]]:
    """Return the raw samples of all demonstrations that lie where samples ``indices`` of the learned path lie.

    The keys are demonstration ids. Raises UnknownDemonstration if the learned path has no such sample.
    """
    phases = motion.as_learned().phases
    chosen = np.unique(np.asarray(indices, dtype=np.int64))
    if len(chosen) and (chosen[0] < 0 or chosen[-1] >= len(phases)):
        raise UnknownDemonstration(f"the learned path has samples 0 to {len(phases) - 1}: choose among them")
    borders = np.concatenate([[-np.inf], 0.5 * (phases[1:] + phases[:-1]), [np.inf]])
    struck: dict[str, frozenset[int]] = {}
    for demonstration in aligned:
        cell = np.searchsorted(borders, np.nan_to_num(demonstration.phases, nan=-1.0), side="right") - 1
        hit = np.isin(cell, chosen) & np.isfinite(demonstration.phases)
        struck[demonstration.demonstration_id] = frozenset(int(index) for index in np.flatnonzero(hit))
    return struck


def _check_edits(demonstrations: Sequence[Demonstration], edits: Edits) -> None:
    sizes = {demonstration.demonstration_id: len(demonstration.times) for demonstration in demonstrations}
    if len(sizes) < len(demonstrations):
        raise MixedDemonstrations("two demonstrations have the same id: give each its own")
    for name in sorted(edits.excluded | set(edits.struck)):
        if name not in sizes:
            raise UnknownDemonstration(f"there is no demonstration {name!r} to strike or exclude")
    for name, indices in edits.struck.items():
        if indices and (min(indices) < 0 or max(indices) >= sizes[name]):
            raise UnknownDemonstration(f"demonstration {name!r} has samples 0 to {sizes[name] - 1}: choose among them")


def _left_out(name: str, reason: str, fault: Fault) -> Verdict:
    return Verdict(name, VerdictKind.LEFT_OUT, reason, None, None, fault)


def _used(name: str, reached: float) -> Verdict:
    if reached < 1.0:
        reason = f"let go at {reached:.2f} of the path: used up to there"
        return Verdict(name, VerdictKind.USED_IN_PART, reason, reached, None, "")
    return Verdict(name, VerdictKind.USED, "", None, None, "")


def _path_phases(aligned: Correspondence) -> Floats:
    mean = moving_average(np.nanmean(aligned.points, axis=0), 5)
    lengths = arc_lengths(mean)
    return lengths / lengths[-1]


def _time_phases(aligned: Correspondence, reference_times: Floats) -> Floats:
    if len(reference_times):
        return (reference_times - reference_times[0]) / (reference_times[-1] - reference_times[0])
    steps = np.nanmean(np.diff(aligned.times / np.nanmax(aligned.times, axis=1, keepdims=True), axis=1), axis=0)
    clock = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
    return clock / clock[-1]


def _duration(aligned: Correspondence, reference_times: Floats) -> float:
    if len(reference_times):
        return float(reference_times[-1] - reference_times[0])
    whole = np.isfinite(aligned.times[:, [0, -1]]).all(axis=1)
    rows = aligned.times[whole] if whole.any() else aligned.times
    return float(np.median(np.nanmax(rows, axis=1) - np.nanmin(rows, axis=1)))


def _on_clock(aligned: Correspondence, phases: Floats) -> Correspondence:
    """Return the correspondence at even steps of the clock."""
    grid = np.linspace(0.0, 1.0, CLOCK_POINTS)
    where = np.interp(grid, phases, np.arange(len(phases), dtype=np.float64))
    low = np.minimum(where.astype(int), len(phases) - 2)
    share = where - low

    def moved(values: Floats) -> Floats:
        portion = share.reshape((1, -1) + (1,) * (values.ndim - 2))
        between = (1.0 - portion) * values[:, low] + portion * values[:, low + 1]
        return np.where(portion == 0, values[:, low], np.where(portion == 1, values[:, low + 1], between))

    turned = None if aligned.orientations is None else moved(aligned.orientations)
    return Correspondence(moved(aligned.points), moved(aligned.times), moved(aligned.triggers), turned)


def _samples(aligned: Correspondence, grid: Floats, duration: float, clock: str) -> Floats:
    """Return the rows (n, D) the mixture is fitted to: clock, time where the clock is the path, position, orientation."""
    rows = []
    reach = np.nanmax(aligned.times, axis=1) - np.nanmin(aligned.times, axis=1)
    whole = np.isfinite(aligned.times[:, [0, -1]]).all(axis=1)
    for i, points in enumerate(aligned.points):
        columns = [grid[:, None] * (duration if clock == "time" else 1.0)]
        if clock == "path":
            pace = duration / reach[i] if whole[i] else 1.0
            columns.append((aligned.times[i] - np.nanmin(aligned.times[i]))[:, None] * pace)
        columns.append(points)
        if aligned.orientations is not None:
            columns.append(_same_side(aligned.orientations[i], aligned.orientations[0]))
        row = np.concatenate(columns, axis=1)
        rows.append(row[np.isfinite(row).all(axis=1)])
    return np.concatenate(rows)


def _same_side(orientations: Floats, reference: Floats) -> Floats:
    """Return quaternions (n, 4) with the sign that is nearer to the reference's."""
    return orientations * (-1.0 if np.nansum(orientations * reference) < 0 else 1.0)


def _fit(samples: Floats, aligned: Correspondence, clock: Floats, options: LearningOptions) -> Mixture:
    if options.preset == "paper":
        edges = np.linspace(clock[0], clock[-1], (options.components or PAPER_COMPONENTS) + 1)
        return fit_free(samples, in_bins(samples, edges))
    mean = np.nanmean(aligned.points, axis=0)
    if options.components:
        edges = np.linspace(clock[0], clock[-1], options.components + 1)
    else:
        found = corners(mean, CORNER_TOLERANCE * diagonal(mean))
        edges = (
            clock[list(found)]
            if len(found) - 1 <= MOST_COMPONENTS
            else np.linspace(clock[0], clock[-1], MOST_COMPONENTS + 1)
        )
    return fit_tied(samples, in_bins(samples, edges))


def _dispense(aligned: Correspondence, grid: Floats) -> tuple[tuple[float, float], ...]:
    """Return the phases between which most of those who are still there press the button."""
    pressed = np.nanmean(aligned.triggers, axis=0) > 0.5
    turns = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(int)))
    starts, ends = turns[::2], turns[1::2] - 1
    return tuple((float(grid[a]), float(grid[b])) for a, b in zip(starts, ends, strict=True) if grid[b] > grid[a])


def _raw_phases(demonstration: Demonstration, motion: CleanMotion, times: Floats, phases: Floats) -> Floats:
    known = np.isfinite(times)
    own = demonstration.times - demonstration.times[0]
    found = np.interp(own, np.maximum.accumulate(times[known]), phases[known])
    return np.where(motion.used, found, np.nan)


def _report(
    motion: Motion,
    aligned: Correspondence,
    grid: Floats,
    names: Sequence[str],
    verdicts: tuple[Verdict, ...],
    options: LearningOptions,
) -> LearningReport:
    path = motion.points_at(grid)
    mean = np.nanmean(aligned.points, axis=0)
    from_mean = np.sqrt(((path - mean) ** 2).sum(axis=1))
    each = []
    for name, points in zip(names, aligned.points, strict=True):
        away = np.sqrt(((points - path) ** 2).sum(axis=1))
        worst = int(np.nanargmax(away))
        each.append(
            DemonstrationError(name, float(np.sqrt(np.nanmean(away**2))), float(away[worst]), float(grid[worst]))
        )
    spread = np.sqrt(np.nanmean(((aligned.points - mean) ** 2).sum(axis=2), axis=0))
    places = np.linspace(0.0, 1.0, 101)
    even = motion.points_at(np.linspace(0.0, 1.0, 300))
    return LearningReport(
        preset=options.preset,
        components=len(motion.means),
        clock=motion.clock,
        duration=motion.duration,
        length=float(arc_lengths(motion.points_at(np.linspace(0.0, 1.0, 1000)))[-1]),
        path_error={"rms": float(np.sqrt((from_mean**2).mean())), "max": float(from_mean.max())},
        demonstrations=tuple(each),
        repeatability_phases=tuple(float(place) for place in places),
        repeatability=tuple(float(value) for value in np.interp(places, grid, spread)),
        smoothness=smoothness(even),
        verdicts=verdicts,
        covariance_rule=motion.covariance_rule,
        options=asdict(options),
    )

"""The recommended pipeline: people laid upon each other, odd ones found, components over the path with chosen
hand-overs.
"""

from dataclasses import replace

import numpy as np

from models.alignment.aligned import AlignedDemonstrations
from models.alignment.registration import mean_of, taken
from models.mixture.fitting import fit_path, mixture_of, timing
from models.options import LearningOptions, Progress
from models.preprocessing.filtering import CleanMotion
from models.presets.fit_result import FitResult
from models.screening.pauses import Detour, Pause, extras, pauses
from models.screening.screen import Screened, screened


def fit_recommended(motions: list[CleanMotion], options: LearningOptions, tell: Progress) -> FitResult:
    """Return the mixture of what the motions have in common."""
    found = screened(motions, options, tell)
    tell(0.7, "fitting")
    fit, aligned, simpler = fit_path(found.aligned, options)
    duration, times = timing(aligned)
    mixture = mixture_of(fit, aligned, times, options.clock or "path", duration)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    name = "time" if options.clock == "time" else "path"
    paused, extra = _stretches(found, aligned)
    who = found.who
    return FitResult(
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
        (*found.findings, *simpler),
        {who[row]: told for row, told in paused.items()},
        {who[row]: told for row, told in extra.items()},
    )


def _stretches(
    found: Screened, aligned: AlignedDemonstrations
) -> tuple[dict[int, tuple[Pause, ...]], dict[int, tuple[Detour, ...]]]:
    """Return where the motions of these rows stood still and what they drew beyond the others, by the path's phase."""
    drawings, group = found.drawings.of(found.rows), found.group
    path = mean_of(taken(drawings.curves, group.positions), group.weights)
    phases = np.linspace(0.0, 1.0, aligned.times.shape[1])
    paused: dict[int, tuple[Pause, ...]] = {}
    extra: dict[int, tuple[Detour, ...]] = {}
    for i, row in enumerate(found.rows):
        motion, places = drawings.motions[i], drawings.places[i]
        there = np.isfinite(aligned.times[i])
        own, common = np.maximum.accumulate(aligned.times[i, there]), phases[there]
        still = pauses(motion)
        middles = np.interp([one.start + 0.5 * one.duration for one in still], own, common)
        if still:
            paused[row] = tuple(
                replace(one, place=float(where), start=_recorded(one.start, motion))
                for one, where in zip(still, middles, strict=True)
            )
        seconds = np.interp(places, np.arange(len(motion.times), dtype=np.float64), motion.times)
        beyond = extras(drawings.curves[i], group.positions[i], path, seconds)
        middles = np.interp([one.start + 0.5 * one.duration for one in beyond], own, common)
        if beyond:
            extra[row] = tuple(
                replace(one, place=float(where), start=_recorded(one.start, motion))
                for one, where in zip(beyond, middles, strict=True)
            )
    return paused, extra


def _recorded(start: float, motion: CleanMotion) -> float:
    """Return when in its recording a closed motion, begun at another of its samples, was at a time of its own."""
    return start - motion.period if start >= motion.period else start

"""From demonstrations to a motion: ``learn`` and what is reported of it. The pipelines are
``models.presets.recommended`` and ``models.presets.paper``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from threadpoolctl import ThreadpoolController

from models.alignment.registration import mean_of
from models.comparison import end_error, path_error, to_paper, to_previous
from models.demonstration import Demonstration, Edits, Floats
from models.errors import LearningError, MixedDemonstrations, TooFewDemonstrations, UnknownDemonstration, UnlikelyUnits
from models.evaluation import smoothness
from models.findings import Finding, Remark
from models.geometry import diagonal, norms
from models.motion import Motion
from models.options import LearningOptions, Progress
from models.phase import arc_lengths
from models.preprocessing.filtering import CleanMotion, clean
from models.presets import FILTER_WINDOW, Preset, preset_named
from models.presets.fit_result import FitResult
from models.report import (
    AlignedDemonstration,
    DemonstrationError,
    LearnedMotion,
    LearningReport,
    Previous,
    Verdict,
    VerdictKind,
    mean_repeatability,
    samples_along_path,
)
from models.screening.messages import what_it_did
from models.screening.pauses import Detour, Pause
from models.screening.tool_orientation import tool_findings

__all__ = [
    "AlignedDemonstration",
    "LearnedMotion",
    "LearningOptions",
    "LearningReport",
    "Previous",
    "Verdict",
    "VerdictKind",
    "learn",
    "samples_along_path",
]

TIME_STEP = 0.008
WIDEST = 12.0
"""m across, beyond which it is no metres: a seam of 10 m with its scatter fits, a plate of 15 mm in mm does not."""
OTHER_UNIT = 100.0
SAME_PLACE = 0.01
"""Part of the path by which a press may seem to lie off its place: a recording is averaged over 2 % of the drawing."""


def learn(
    demonstrations: Sequence[Demonstration],
    edits: Edits | None = None,
    options: LearningOptions | None = None,
    progress: Progress | None = None,
    previous: Previous | None = None,
    *,
    compare: bool = True,
) -> LearnedMotion:
    """Return the motion that the demonstrations have in common, with a verdict for each and a report.

    The report compares it with ``previous``, the version the skill had before, and, unless told not to ``compare``,
    with the paper's preset.

    A recording that cannot be used is left out, and its verdict says why; fewer than two usable ones raise
    TooFewDemonstrations.
    The same demonstrations, edits and options give the same bits in any process: one thread, no randomness.
    """
    edits, options = edits or Edits(), options or LearningOptions()
    tell = progress or _to_nobody
    _check_edits(demonstrations, edits)
    with _libraries().limit(limits=1):
        return _learn(demonstrations, edits, options, tell, previous, compare)


@cache
def _libraries() -> ThreadpoolController:
    """Return the linear algebra libraries of this process: looking for them costs more than limiting them."""
    return ThreadpoolController()


def _to_nobody(done: float, what: str) -> None:
    """Progress nobody asked for."""


def _learn(
    demonstrations: Sequence[Demonstration],
    edits: Edits,
    options: LearningOptions,
    tell: Progress,
    previous: Previous | None,
    compare: bool,
) -> LearnedMotion:
    preset = preset_named(options.preset)
    motions, verdicts = _cleaned(demonstrations, edits, options, preset, tell)
    order = sorted(motions)
    used_motions = [motions[index] for index in order]
    tell(0.4, "aligning")
    fitted = preset.fit(used_motions, options, tell)
    longest = [max((one.share for one in fitted.pauses.get(row, ())), default=0.0) for row in fitted.rows]
    usual_pause = float(np.median(longest))
    for row, index in enumerate(order):
        verdicts[index] = _verdict(motions[index], fitted, row, usual_pause)
    motion = Motion(
        fitted.mixture.means,
        fitted.mixture.covariances,
        fitted.clock,
        fitted.aligned.points.shape[2],
        fitted.duration,
        _dispense(fitted),
        options.time_step or TIME_STEP,
        fitted.covariance_rule,
    )
    tell(0.9, "reporting")
    used = [order[row] for row in fitted.rows]
    names = [demonstrations[index].demonstration_id for index in used]
    findings = (
        *fitted.findings,
        *_orientation_finding(used_motions),
        *tool_findings(fitted.aligned.orientations, names),
        *_dots_finding(fitted, [motions[index] for index in used], motion.dispense),
    )
    every = tuple(verdicts[index] for index in range(len(demonstrations)))
    everyone = [one.demonstration_id for one in used_motions]
    report = _report(motion, replace(fitted, findings=findings), everyone, names, every, options)
    tell(0.95, "comparing")
    if compare and preset.compared:
        window = options.filter_window or FILTER_WINDOW
        report = replace(report, paper=to_paper(motion, [demonstrations[index] for index in order], edits, window))
    if previous is not None:
        report = replace(report, previous=to_previous(motion, mean_repeatability(report.as_dict()), previous))
    tell(1.0, "learned")
    shown = _shown(motion, fitted, [demonstrations[index] for index in used], [motions[index] for index in used])
    return LearnedMotion(motion, every, shown, report)


def _cleaned(
    demonstrations: Sequence[Demonstration], edits: Edits, options: LearningOptions, preset: Preset, tell: Progress
) -> tuple[dict[int, CleanMotion], dict[int, Verdict]]:
    """Return the motions that can be used by the index of their demonstration, and verdicts on all others."""
    verdicts: dict[int, Verdict] = {}
    motions: dict[int, CleanMotion] = {}
    for index, demonstration in enumerate(demonstrations):
        tell(0.4 * index / len(demonstrations), "cleaning")
        name = demonstration.demonstration_id
        if name in edits.excluded:
            verdicts[index] = _left_out(name, "excluded by an operator", "excluded")
            continue
        try:
            struck = edits.struck.get(name, frozenset())
            window = options.filter_window or preset.filter_window
            motions[index] = clean(demonstration, struck, window, preset.despiked)
        except LearningError as error:
            verdicts[index] = _left_out(name, str(error), "invalid")
    _check_units(motions, verdicts)
    if len({motion.points.shape[1] for motion in motions.values()}) > 1:
        raise MixedDemonstrations("some demonstrations have two dimensions and some three: learn them apart")
    if len(motions) < 2:
        reasons = tuple(verdict.reason for verdict in verdicts.values())[:3]
        raise TooFewDemonstrations(len(motions), 2, reasons)
    return motions, verdicts


def _shown(
    motion: Motion, fitted: FitResult, demonstrations: Sequence[Demonstration], motions: Sequence[CleanMotion]
) -> tuple[AlignedDemonstration, ...]:
    """Return the demonstrations as they lie upon each other, on the motion's clock."""
    times = motion.times_at(fitted.phases)
    return tuple(
        AlignedDemonstration(
            demonstration.demonstration_id,
            _raw_phases(demonstration, cleaned, fitted.aligned.times[i], fitted.phases),
            times,
            fitted.aligned.points[i],
            np.nan_to_num(fitted.aligned.triggers[i]) > 0.5,
        )
        for i, (demonstration, cleaned) in enumerate(zip(demonstrations, motions, strict=True))
    )


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


def _left_out(name: str, reason: str, fault: Literal["invalid", "excluded"]) -> Verdict:
    return Verdict(name, VerdictKind.LEFT_OUT, reason, None, None, fault, fault)


def _verdict(motion: CleanMotion, fitted: FitResult, row: int, usual_pause: float) -> Verdict:
    did = what_it_did(fitted.pauses.get(row, ()), fitted.extras.get(row, ()), usual_pause)
    name = motion.demonstration_id
    if row in fitted.left_out:
        remark = fitted.left_out[row]
        return Verdict(name, VerdictKind.LEFT_OUT, remark.reason, remark.place, remark.size, "odd", remark.code)
    if row in fitted.in_part:
        remark = fitted.in_part[row]
        reason = f"{remark.reason}; {did.reason}" if did else remark.reason
        return Verdict(name, VerdictKind.USED_IN_PART, reason, remark.place, remark.size, "", remark.code)
    remark = fitted.remarks.get(row) or did or Remark("")
    return Verdict(name, VerdictKind.USED, remark.reason, remark.place, remark.size, "", remark.code)


def _check_units(motions: dict[int, CleanMotion], verdicts: dict[int, Verdict]) -> None:
    """Take out motions in another unit than the others, refuse those that no workstation could hold."""
    sizes = {index: diagonal(motion.points) for index, motion in motions.items()}
    if not sizes:
        return
    usual = float(np.median(list(sizes.values())))
    if usual > WIDEST:
        raise UnlikelyUnits(
            f"the drawing is {usual:.0f} m wide: positions are in metres, were millimetres sent? Divide them by 1000"
        )
    for index, size in sizes.items():
        if size > OTHER_UNIT * usual or size * OTHER_UNIT < usual:
            name = motions.pop(index).demonstration_id
            reason = f"{size:.3g} m wide where the others are {usual:.3g} m: is it in another unit?"
            verdicts[index] = _left_out(name, reason, "invalid")


def _dispense(fitted: FitResult) -> tuple[tuple[float, float], ...]:
    """Return the phases between which most of those who are still there press the button."""
    known = np.isfinite(fitted.aligned.triggers)
    votes = np.where(known, fitted.aligned.triggers, 0.0).sum(axis=0)
    pressed = votes > 0.5 * known.sum(axis=0)
    turns = np.flatnonzero(np.diff(np.concatenate([[False], pressed, [False]]).astype(np.int64)))
    starts, ends = turns[::2], turns[1::2] - 1
    grid = fitted.phases
    return tuple((float(grid[a]), float(grid[b])) for a, b in zip(starts, ends, strict=True) if grid[b] > grid[a])


def _raw_phases(demonstration: Demonstration, motion: CleanMotion, times: Floats, phases: Floats) -> Floats:
    known = np.isfinite(times)
    own = demonstration.times - demonstration.times[0]
    own = np.where(own < motion.begun, own + motion.period, own)
    step = motion.times[1] - motion.times[0]
    there = (own >= np.nanmin(times) - step) & (own <= np.nanmax(times) + step)
    found = np.interp(own, np.maximum.accumulate(times[known]), phases[known])
    return np.where(motion.used & there, found, np.nan)


def _orientation_finding(motions: Sequence[CleanMotion]) -> tuple[Finding, ...]:
    """Return what is to be said where only some of the motions carry the tool's orientation."""
    without = [motion.demonstration_id for motion in motions if motion.orientations is None]
    if not without or len(without) == len(motions):
        return ()
    words = (
        f"{len(without)} of {len(motions)} demonstrations carry no tool orientation ({', '.join(without[:3])}), so "
        "none was learned: record it in all of them, or exclude those without"
    )
    return (Finding("without-orientation", words, people=tuple(without)),)


def _dots_finding(
    fitted: FitResult, motions: Sequence[CleanMotion], laid: Sequence[tuple[float, float]]
) -> tuple[Finding, ...]:
    """Return what is to be said where most pressed the button at a place of the path at which nothing is dispensed."""
    grid = fitted.phases
    votes, there = np.zeros(len(grid)), np.zeros(len(grid))
    for motion, times in zip(motions, fitted.aligned.times, strict=True):
        known = np.isfinite(times)
        there += known
        turns = np.flatnonzero(np.diff(np.concatenate([[False], motion.triggers, [False]]).astype(np.int64)))
        pressed = np.zeros(len(grid), dtype=bool)
        for first, after in zip(turns[::2], turns[1::2], strict=True):
            ends = np.interp(motion.times[[first, after - 1]], np.maximum.accumulate(times[known]), grid[known])
            if not any(start <= ends[1] and ends[0] <= end for start, end in laid):
                pressed |= (grid >= ends[0] - SAME_PLACE) & (grid <= ends[1] + SAME_PLACE)
        votes += pressed
    most = votes > 0.5 * there
    starts = np.flatnonzero(np.diff(np.concatenate([[False], most]).astype(np.int64)) == 1)
    if not len(starts):
        return ()
    place = float(np.clip(grid[starts[0]] + SAME_PLACE, 0.0, 1.0))
    words = (
        f"most pressed the button where the path does not go on, {len(starts)} times, first at {place:.2f} of it: dots "
        "are not dispensed, only beads along the path: press a little before such a place and let go a little after it"
    )
    return (Finding("dots-not-laid", words, place),)


def _report(
    motion: Motion,
    fitted: FitResult,
    everyone: Sequence[str],
    names: Sequence[str],
    verdicts: tuple[Verdict, ...],
    options: LearningOptions,
) -> LearningReport:
    grid, points = fitted.phases, fitted.aligned.points
    path = motion.points_at(grid)
    mean = mean_of(points, fitted.aligned.weights)
    away = norms(points - path)
    worst, rms = np.nanargmax(away, axis=1), np.sqrt(np.nanmean(away**2, axis=1))
    spread = np.sqrt(mean_of(((points - mean) ** 2).sum(axis=2, keepdims=True), fitted.aligned.weights)[:, 0])
    places = np.linspace(0.0, 1.0, 101)
    return LearningReport(
        preset=options.preset,
        components=len(motion.means),
        clock=motion.clock,
        duration=motion.duration,
        length=float(arc_lengths(motion.points_at(np.linspace(0.0, 1.0, 1000)))[-1]),
        path_error=path_error(path, mean),
        end_error=end_error(motion.points_at(np.array([0.0, 1.0])), mean),
        demonstrations=tuple(
            DemonstrationError(name, float(rms[i]), float(away[i, worst[i]]), float(grid[worst[i]]))
            for i, name in enumerate(names)
        ),
        repeatability_phases=tuple(float(place) for place in places),
        repeatability=tuple(float(value) for value in np.interp(places, grid, spread)),
        smoothness=smoothness(motion.points_at(np.linspace(0.0, 1.0, 300))),
        verdicts=verdicts,
        covariance_rule=motion.covariance_rule,
        notes=tuple(finding.sentence for finding in fitted.findings),
        findings=fitted.findings,
        options=asdict(options),
        pauses=_told(fitted.pauses, everyone),
        extras=_told(fitted.extras, everyone),
    )


def _told(found: Mapping[int, Sequence[Pause | Detour]], names: Sequence[str]) -> tuple[dict[str, Any], ...]:
    """Return what was found of each motion, with the id of its demonstration."""
    return tuple(
        {"demonstration_id": names[row]} | {field.name: getattr(one, field.name) for field in fields(one)}
        for row, several in sorted(found.items())
        for one in several
    )

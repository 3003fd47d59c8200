"""From cleaned motions to those that belong together, laid upon each other, and what has to be said of the rest."""

from dataclasses import dataclass, field

import numpy as np

from models.alignment.aligned import AlignedDemonstrations
from models.alignment.beads import Beads, between_samples, cut
from models.alignment.laying import Drawings, drawn, laid
from models.alignment.loops import begun_at, starts
from models.alignment.procrustes import laid_freely
from models.alignment.registration import Group
from models.demonstration import Bools
from models.errors import MixedDemonstrations, TooFewDemonstrations
from models.findings import Finding, Remark
from models.options import LearningOptions, Progress
from models.phase import arc_lengths
from models.preprocessing.filtering import CleanMotion
from models.screening.agreement import TwoPlaces, disagreement, elsewhere, places, two_places
from models.screening.clustering import named, other_shapes
from models.screening.extent import furthest_of, reaches
from models.screening.messages import drawn_elsewhere, millimetres
from models.screening.outliers import against_direction, first_pass, mismatch, odd_ones, two_ways

ROUNDS = 3
MIXED = 0.12
MAJORITY = 0.6
GUESSED = 0.5


@dataclass(slots=True, eq=False)
class Screened:
    """The drawings, and what has been found of them. ``rows``: those laid upon each other; ``who``: which motion, of
    those given, each drawing is. ``left_out`` and ``in_part``: what is to be said of drawings, by their row.
    """

    drawings: Drawings
    who: list[int]
    rows: list[int]
    group: Group
    aligned: AlignedDemonstrations
    judged: Bools
    left_out: dict[int, Remark] = field(default_factory=dict[int, Remark])
    in_part: dict[int, Remark] = field(default_factory=dict[int, Remark])
    lacking: dict[int, Remark] = field(default_factory=dict[int, Remark])
    findings: list[Finding] = field(default_factory=list[Finding])

    @property
    def names(self) -> list[str]:
        """Return the id of each drawing's demonstration."""
        return [motion.demonstration_id for motion in self.drawings.motions]

    def lay(self, options: LearningOptions) -> None:
        """Lay the drawings of these rows upon each other, without those left out."""
        self.rows = [row for row in self.rows if row not in self.left_out]
        kept = self.drawings.of(self.rows)
        self.group, self.aligned, self.judged = laid(kept, furthest_of(kept.shapes), options)


def screened(motions: list[CleanMotion], options: LearningOptions, tell: Progress) -> Screened:
    """Return the motions that belong together, laid upon each other."""
    motions, beads, lacking = cut(motions, options.reject_outliers)
    who = [index for index in range(len(motions)) if index not in lacking]
    if len(who) < 2:
        raise TooFewDemonstrations(len(who), 2, tuple(remark.reason for remark in lacking.values())[:3])
    motions, beads = [motions[index] for index in who], [beads[index] for index in who]
    drawings = drawn(motions, beads)
    in_part: dict[int, Remark] = {}
    findings: list[Finding] = []
    if len(beads[0]) == 1:
        drawings, in_part = _once(motions, drawings)
        drawings, turned = _from_one_start(drawings)
        findings += turned
        drawings, past = _no_further(drawings)
        in_part |= past
    if options.place == "free":
        drawings = drawn(laid_freely(list(drawings.motions), drawings.curves), _beads(drawings, beads))
    typical = furthest_of(drawings.shapes)
    names, left_out = [motion.demonstration_id for motion in motions], dict[int, Remark]()
    others = other_shapes(names, drawings.shapes)
    if options.reject_outliers:
        left_out.update(others)
        for index in against_direction(drawings.shapes, typical):
            words = "drawn in the opposite direction: draw it again from the other end"
            left_out[index] = Remark(words, code="opposite-direction")
    rows = [row for row in range(len(motions)) if row not in left_out]
    kept = drawings.of(rows)
    group, aligned, judged = laid(kept, furthest_of(kept.shapes) if left_out else typical, options)
    found = Screened(drawings, who, rows, group, aligned, judged, left_out, in_part, lacking, findings)
    tell(0.5, "aligning")
    _without_odd_ones(found, options, tell)
    if mismatch(found.aligned.points[:, found.judged], found.aligned.weights[:, found.judged]) > MIXED:
        raise MixedDemonstrations(
            "the demonstrations do not show the same shape: learn those that belong together, exclude the others"
        )
    _tell_parts(found)
    return found


def _beads(drawings: Drawings, beads: list[Beads]) -> list[Beads]:
    """Return the beads of motions that may have been cut: all of it, where one bead is all."""
    if len(beads[0]) > 1:
        return beads
    return [((0, len(motion.times) - 1),) for motion in drawings.motions]


def _once(motions: list[CleanMotion], drawings: Drawings) -> tuple[Drawings, dict[int, Remark]]:
    """Return the drawings, those drawn more than once until the end of the first time."""
    repeated = first_pass(drawings.curves)
    if not repeated:
        return drawings, {}
    motions = list(motions)
    for index, end in repeated.items():
        motions[index] = between_samples(motions[index], 0, max(3, int(drawings.places[index][end])))
    words = "drawn more than once: the first time is used"
    beads: list[Beads] = [((0, len(motion.times) - 1),) for motion in motions]
    return drawn(motions, beads), {index: Remark(words, code="drawn-twice") for index in repeated}


def _no_further(drawings: Drawings) -> tuple[Drawings, dict[int, Remark]]:
    """Return the drawings, without what too few drew before the others begin and after they end."""
    before, after = (reach.too_far for reach in reaches(drawings.curves, furthest_of(drawings.curves)))
    rows = np.flatnonzero((before > 0.0) | (after > 0.0))
    if not len(rows):
        return drawings, {}
    motions, found = list(drawings.motions), dict[int, Remark]()
    most = drawings.places.shape[1] - 1
    for row in rows:
        way = float(arc_lengths(drawings.curves[row])[-1])
        kept = np.array([before[row] / way, 1.0 - after[row] / way]) * most
        first, last = np.interp(kept, np.arange(most + 1), drawings.places[row])
        motions[row] = between_samples(motions[row], int(first), max(int(first) + 3, int(np.ceil(last))))
        words: list[str] = []
        if before[row]:
            words.append(f"began {millimetres(before[row])} mm before the others: used from where they begin")
        if after[row]:
            words.append(f"went on {millimetres(after[row])} mm past where the others end: used up to there")
        place, code = (0.0, "began-before") if before[row] else (1.0, "went-on")
        found[int(row)] = Remark(" and ".join(words), place, float(max(before[row], after[row])), code)
    beads: list[Beads] = [((0, len(motion.times) - 1),) for motion in motions]
    return drawn(motions, beads), found


def _from_one_start(drawings: Drawings) -> tuple[Drawings, list[Finding]]:
    """Return drawings of a closed shape, all begun where most began, and who of them was not."""
    found = starts(drawings.curves)
    if found is None:
        return drawings, []
    turned = np.flatnonzero(found.turned > 0.0)
    start = drawings.curves[found.turned == 0.0, 0].mean(axis=0)
    motions = list(drawings.motions)
    for index in turned:
        motions[index] = begun_at(motions[index], drawings.places[index], float(found.turned[index]), start)
    count = len(motions)
    words = (
        f"the shape is closed, and {len(turned)} of {count} began elsewhere on it: "
        f"it begins where most did, {count - len(turned)} of {count}"
    )
    people = tuple(sorted(motions[index].demonstration_id for index in turned))
    beads: list[Beads] = [((0, len(motion.times) - 1),) for motion in motions]
    return drawn(motions, beads), [Finding("begun-elsewhere", words, 0.0, people=people)]


def _without_odd_ones(found: Screened, options: LearningOptions, tell: Progress) -> None:
    """Take out who does not fit the others, and say what is to be known of the places in which people drew."""
    located = places(found.aligned.points[:, found.judged])
    groups = two_places(*located)
    if groups is not None:
        _two_places(found, groups, options)
    for turn in range(ROUNDS if options.reject_outliers else 0):
        tell(0.55 + 0.04 * turn, "aligning")
        points, weights = (values[:, found.judged] for values in (found.aligned.points, found.aligned.weights))
        if turn or groups is not None:
            located = places(points)
        odd = {row: drawn_elsewhere(offset) for row, offset in elsewhere(*located).items()}
        if not odd:
            odd = odd_ones(points, weights, np.flatnonzero(found.judged) / (len(found.judged) - 1.0))
        if not odd:
            break
        found.left_out.update({found.rows[row]: remark for row, remark in odd.items()})
        found.lay(options)
    points, weights = (values[:, found.judged] for values in (found.aligned.points, found.aligned.weights))
    ways = two_ways(points, weights, np.flatnonzero(found.judged) / (len(found.judged) - 1.0))
    if ways is not None:
        most, others = (
            tuple(sorted(found.names[found.rows[row]] for row in group)) for group in (ways.most, ways.others)
        )
        words = (
            f"at {ways.place:.2f} of the path {named(most)} and {named(others)} go ways {millimetres(ways.size)} mm "
            "apart with nobody between: exclude one group, or draw it again one way, for the path lies between them"
        )
        found.findings.append(Finding("two-ways", words, ways.place, ways.size, others, most))
    if len(found.rows) == 2:
        apart = disagreement(found.aligned.points[:, found.judged])
        if apart is not None:
            names = tuple(sorted(found.names[row] for row in found.rows))
            words = (
                f"{named(names)} drew {millimetres(apart.size)} mm apart from each other, and of two nobody can tell "
                "who is right: let a third person draw it"
            )
            if apart.place is not None:
                words = (
                    f"{named(names)} are {millimetres(apart.size)} mm apart at {apart.place:.2f} of the path, and of "
                    "two nobody can tell who is right: let a third person draw it"
                )
            found.findings.append(Finding("two-disagree", words, apart.place, apart.size, names))


def _two_places(found: Screened, groups: TwoPlaces, options: LearningOptions) -> None:
    """Say that people drew in two places; leave out the fewer, or refuse to learn if it is nobody's choice."""
    rows = found.rows
    most, others = (tuple(sorted(found.names[rows[row]] for row in group)) for group in (groups.most, groups.others))
    size = millimetres(groups.size)
    if not groups.apart or not options.reject_outliers:
        words = (
            f"the same shape was drawn in two places, {size} mm apart, by {named(most)} and by {named(others)}: "
            "the path lies between them"
        )
    elif len(most) < MAJORITY * len(rows):
        words = (
            f"the same shape was drawn in two places, {size} mm apart, by {named(most)} and by {named(others)}: "
            "exclude one group, or draw it again in one place"
        )
        raise MixedDemonstrations(words, Finding("two-places", words, None, groups.size, others, most))
    else:
        words = (
            f"the same shape was drawn in two places, {size} mm apart, by {named(most)} and by {named(others)}: "
            "the path is that of the former"
        )
        points = found.aligned.points[:, found.judged]
        usual = np.nanmean(points[list(groups.most)], axis=0)
        for row in groups.others:
            found.left_out[rows[row]] = drawn_elsewhere(np.nanmean(points[row] - usual, axis=0))
        found.lay(options)
    found.findings.append(Finding("two-places", words, None, groups.size, others, most))


def _tell_parts(found: Screened) -> None:
    """Say who drew only a part, what nobody or hardly anybody drew."""
    group, count = found.group, len(found.rows)
    known = np.isfinite(found.aligned.points[:, :, 0])
    lost: list[str] = []
    for i, row in enumerate(found.rows):
        if group.early[i] or group.late[i]:
            found.in_part[row] = _partly(group, i)
        elif not known[i].all():
            place = float(np.flatnonzero(~known[i])[0]) / (known.shape[1] - 1)
            words = f"the marker was lost at {place:.2f} of the path: used around it"
            found.in_part[row] = Remark(words, place, code="marker-lost")
            lost.append(found.names[row])
    voices = known.sum(axis=0)
    fewest = int(voices.argmin())
    if lost and voices[fewest] < GUESSED * count:
        place = fewest / (len(voices) - 1.0)
        words = f"at {place:.2f} of the path the marker of {count - voices[fewest]} of {count} was lost: check it there"
        found.findings.append(Finding("common-gap", words, place, None, tuple(sorted(lost))))
    drawn_by = count - int(group.late.sum())
    if drawn_by <= (1.0 - GUESSED) * count:
        words = f"the start of the path is drawn by {drawn_by} of {count} only: check it"
        found.findings.append(Finding("start-guessed", words, 0.0, None, _people(found, group.late)))
    drawn_by = count - int(group.early.sum())
    if drawn_by <= (1.0 - GUESSED) * count:
        words = f"the end of the path is drawn by {drawn_by} of {count} only: check it"
        found.findings.append(Finding("end-guessed", words, 1.0, None, _people(found, group.early)))


def _people(found: Screened, which: Bools) -> tuple[str, ...]:
    return tuple(sorted(found.names[found.rows[i]] for i in np.flatnonzero(which)))


def _partly(group: Group, row: int) -> Remark:
    words: list[str] = []
    place = float(group.last[row])
    if group.late[row]:
        place = float(group.first[row])
        words.append(f"started at {place:.2f} of the path: used from there")
    if group.early[row]:
        words.append(f"let go at {float(group.last[row]):.2f} of the path: used up to there")
    return Remark(" and ".join(words), place, code="started-late" if group.late[row] else "let-go-early")

"""What an operator takes out of a version's recordings, and what that would change: plain values, no page."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.demonstration import Demonstration, Edits, Floats
from opcua_skill.client import Path

Indices = NDArray[np.int64]
NOT_THERE = -1
WINDOW = 0.04


@dataclass
class Draft:
    """Edits not yet learned, with undo and redo, and the reason for a decision as far as it is written.

    ``saved`` are the edits the version was learned with.
    """

    saved: Edits
    reason: str = ""
    _steps: list[Edits] = field(default_factory=list)
    _place: int = 0

    def __post_init__(self) -> None:
        self._steps = [self.saved]

    @property
    def edits(self) -> Edits:
        """The edits as they stand."""
        return self._steps[self._place]

    @property
    def changed(self) -> bool:
        """Whether learning again would be with other edits than before."""
        return self.edits != self.saved

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to take back."""
        return self._place > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a step to do again."""
        return self._place < len(self._steps) - 1

    def undo(self) -> None:
        """Take the last step back, if there is one."""
        self._place = max(0, self._place - 1)

    def redo(self) -> None:
        """Do the step taken back last again, if there is one."""
        self._place = min(len(self._steps) - 1, self._place + 1)

    def become(self, edits: Edits) -> None:
        """Take a step: whatever was undone before is gone."""
        if edits != self.edits:
            del self._steps[self._place + 1 :]
            self._steps.append(edits)
            self._place += 1

    def strike(self, samples: Mapping[str, frozenset[int]]) -> None:
        """Strike samples of recordings, in one step. Striking what is struck already restores it."""
        named = {name: indices for name, indices in samples.items() if indices}
        now = self.edits
        if not named:
            return
        if all(indices <= now.struck.get(name, frozenset()) for name, indices in named.items()):
            self.restore(named)
            return
        for name, indices in named.items():
            now = now.with_struck(name, indices)
        self.become(now)

    def restore(self, samples: Mapping[str, frozenset[int]]) -> None:
        """Take struck samples in again."""
        left = {name: kept - samples.get(name, frozenset()) for name, kept in self.edits.struck.items()}
        self.become(Edits(self.edits.excluded, {name: kept for name, kept in left.items() if kept}))

    def restore_all(self, name: str) -> None:
        """Take every struck sample of one recording in again."""
        self.restore({name: self.edits.struck.get(name, frozenset())})

    def include(self, name: str, wanted: bool) -> None:
        """Leave a whole recording out, or take it in again."""
        excluded = self.edits.excluded - {name} if wanted else self.edits.excluded | {name}
        self.become(Edits(excluded, dict(self.edits.struck)))

    @property
    def struck_count(self) -> int:
        """How many samples are struck."""
        return sum(len(indices) for indices in self.edits.struck.values())


def edits_of(provenance: Mapping[str, object]) -> Edits:
    """Return the edits a version was learned with, from its description's provenance."""
    struck = provenance.get("struck") or {}
    assert isinstance(struck, Mapping)
    excluded = provenance.get("excluded") or ()
    assert isinstance(excluded, Sequence)
    return Edits(frozenset(map(str, excluded)), {str(name): frozenset(indices) for name, indices in struck.items()})


def along(points: Floats) -> Floats:
    """Return how far along its length each point (n, d) lies, 0 to 1; a gap is crossed in a straight line."""
    steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    lengths = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    return lengths / max(lengths[-1], 1e-12)


def raw_samples(raw: Demonstration, aligned: Demonstration) -> Indices:
    """Return for each instant (m,) of an aligned demonstration the sample of the recording it came from.

    Both run along one curve, so the sample is the nearest one to the instant's point near the same share of the length;
    where the aligned demonstration has nothing to say it is -1. The samples never go back.
    """
    found = np.full(len(aligned.times), NOT_THERE, dtype=np.int64)
    known = np.flatnonzero(np.isfinite(aligned.points).all(axis=1))
    if len(known) < 2:
        return found
    usable = np.flatnonzero(np.isfinite(raw.points).all(axis=1))
    curve, way = raw.points[usable], along(raw.points[usable])
    ends = [
        int(np.argmin(((curve - aligned.points[known[k]]) ** 2).sum(axis=1) + penalty)) for k, penalty in _ends(way)
    ]
    if ends[1] <= ends[0]:
        ends = [0, len(curve) - 1]
    target = way[ends[0]] + along(aligned.points[known]) * (way[ends[1]] - way[ends[0]])
    first = np.searchsorted(way, target - WINDOW)
    last = np.maximum(np.searchsorted(way, target + WINDOW, side="right"), first + 1)
    best = np.empty(len(known), dtype=np.int64)
    for place, (instant, start, stop) in enumerate(zip(known, first, last, strict=True)):
        start = min(int(start), len(curve) - 1)
        near = curve[start : max(int(stop), start + 1)] - aligned.points[instant]
        best[place] = start + int(np.argmin((near * near).sum(axis=1)))
    found[known] = usable[np.maximum.accumulate(best)]
    return found


def _ends(way: Floats) -> tuple[tuple[int, Floats], tuple[int, Floats]]:
    """Return, for both ends of an aligned demonstration, which samples cannot be meant: those of the other half."""
    return (0, np.where(way > 0.5, np.inf, 0.0)), (-1, np.where(way < 0.5, np.inf, 0.0))


def samples_between(samples: Indices, first: int, last: int) -> frozenset[int]:
    """Return the recording's samples that instants ``first`` to ``last`` stand for: half way to the next ones."""
    span = samples[first : last + 1]
    span = span[span >= 0]
    if not len(span):
        return frozenset()
    before, after = samples[:first], samples[last + 1 :]
    before, after = before[before >= 0], after[after >= 0]
    low = (int(before[-1]) + int(span[0])) // 2 + 1 if len(before) and before[-1] < span[0] else int(span[0])
    high = (int(span[-1]) + int(after[0])) // 2 if len(after) else int(span[-1])
    return frozenset(range(min(low, int(span[0])), max(high, int(span[-1])) + 1))


def instants_struck(samples: Indices, struck: Iterable[int]) -> list[int]:
    """Return the instants of an aligned demonstration at which the recording's sample is struck."""
    return np.flatnonzero(np.isin(samples, list(struck))).tolist()


@dataclass(frozen=True, eq=False)
class Material:
    """Everything a version is judged by: recordings, what learning made of them, and its path."""

    raw: Mapping[str, Demonstration]
    aligned: Mapping[str, Demonstration]
    samples: Mapping[str, Indices]
    path: Path

    @classmethod
    def of(cls, raw: Sequence[Demonstration], aligned: Sequence[Demonstration], path: Path) -> "Material":
        """Put it together, and find which sample of the recording each aligned instant came from."""
        recordings = {one.demonstration_id: one for one in raw}
        warped = {one.demonstration_id: one for one in aligned}
        samples = {name: raw_samples(recordings[name], one) for name, one in warped.items()}
        return cls(recordings, warped, samples, path)

    def picked(self, name: str, first: int, last: int, mode: str) -> frozenset[int]:
        """Return the samples of a recording meant by indices ``first`` to ``last`` of its line as shown."""
        if mode == "raw" or name not in self.samples:
            return frozenset(range(first, last + 1))
        return samples_between(self.samples[name], first, last)

    def picked_everywhere(self, first: int, last: int) -> dict[str, frozenset[int]]:
        """Return the samples of all recordings that lie at samples ``first`` to ``last`` of the learned path."""
        if not self.aligned:
            return {}
        clock = next(iter(self.aligned.values())).times
        times = self.path.times[[first, last]]
        low, high = np.searchsorted(clock, times[0], side="right") - 1, np.searchsorted(clock, times[1])
        low, high = max(int(low), 0), min(max(int(high), int(low)), len(clock) - 1)
        return {name: samples_between(samples, low, high) for name, samples in self.samples.items()}

    def mean(self, edits: Edits) -> Floats:
        """Return the mean (m, d) of the aligned demonstrations that these edits leave; NaN where nobody is left."""
        kept = []
        for name, one in self.aligned.items():
            if name not in edits.excluded:
                points = one.points.copy()
                points[instants_struck(self.samples[name], edits.struck.get(name, ()))] = np.nan
                kept.append(points)
        if not kept:
            shape = next(iter(self.aligned.values())).points.shape if self.aligned else (0, 2)
            return np.full(shape, np.nan)
        stacked = np.stack(kept)
        known = np.isfinite(stacked)
        count = known.sum(axis=0)
        total = np.where(known, stacked, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def expected(self, saved: Edits, now: Edits) -> Floats:
        """Return where the learned path (n, d) would go with other edits: moved as the demonstrations' mean moves.

        An estimate, shown while one edits; learning again gives the answer.
        """
        if not self.aligned:
            return self.path.points
        clock = next(iter(self.aligned.values())).times
        moves = np.nan_to_num(self.mean(now) - self.mean(saved))
        columns = [np.interp(self.path.times, clock, moves[:, k]) for k in range(moves.shape[1])]
        return self.path.points + np.stack(columns, axis=1)


def largest_change(before: Path, after: Path) -> tuple[float, float]:
    """Return the largest distance in m between two paths at the same share of their length, and at which share."""
    share = np.linspace(0.0, 1.0, 400)
    first, second = (
        np.stack([np.interp(share, along(one.points), one.points[:, k]) for k in range(one.points.shape[1])], axis=1)
        for one in (before, after)
    )
    away = np.sqrt(((first - second) ** 2).sum(axis=1))
    return float(away.max()), float(share[int(away.argmax())])

"""Versions compared: which figures of their reports differ, and whether for the better. Plain values, no page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from opcua_skill.client import Skill
from opcua_skill.panel.formatting import mm, percent, seconds
from opcua_skill.panel.words import Words

SAME = 0.02
FEWEST_USED = 3
Number = float | None
Mark = Literal["", "better", "worse", "differs"]


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of a comparison: how it is read from a version, how it is said, and which way is better."""

    label: str
    read: Callable[[Skill], Number]
    said: Callable[[Number], str]
    better: Literal["less", "more", ""] = ""

    def mark(self, here: Skill, other: Skill) -> Mark:
        """Return whether ``other`` is better or worse than ``here``; 2 % is no difference, nor what cannot be read."""
        one, two = self.read(here), self.read(other)
        if one is None or two is None or self.said(one) == self.said(two):
            return ""
        if self.said(abs(two - one)) == self.said(0.0) or abs(two - one) <= SAME * max(abs(one), abs(two), 1e-9):
            return ""
        if not self.better:
            return "differs"
        return "better" if (two < one) == (self.better == "less") else "worse"

    def difference(self, here: Skill, other: Skill) -> str:
        """Return by how much ``other`` is more (+) or less (−) than ``here``."""
        one, two = self.read(here), self.read(other)
        if one is None or two is None:
            return ""
        return f"{'+' if two > one else '−'}{self.said(abs(two - one))}"


def number(value: Any) -> Number:
    """Return a value of a report as a number, None for what was not measured."""
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None


def within(*keys: str) -> Callable[[Skill], Number]:
    """Return what reads a number from a version's report, by its keys from the outside in."""

    def read(skill: Skill) -> Number:
        found: Any = skill.report
        for key in keys:
            found = found.get(key) if isinstance(found, Mapping) else None
        return number(found)

    return read


def spread(skill: Skill) -> list[float]:
    """Return how far the people were apart along the path, m; empty when it was not measured."""
    told = (skill.report.get("repeatability") or {}).get("deviation") or ()
    return [float(value) for value in told if value is not None]


def _widest(skill: Skill) -> Number:
    return max(spread(skill), default=None)


def _usual(skill: Skill) -> Number:
    values = np.array(spread(skill))
    return float(np.sqrt((values * values).mean())) if len(values) else None


def _people(skill: Skill) -> Number:
    each = [float(one["rms"]) for one in skill.report.get("demonstrations") or ()]
    return sum(each) / len(each) if each else None


def verdicts(skill: Skill) -> Sequence[Mapping[str, Any]]:
    """Return what learning said of each recording."""
    return skill.document.get("verdicts") or ()


def wrong(verdict: Mapping[str, Any]) -> bool:
    """Whether learning found fault with a recording: one that a person took out is no finding."""
    return verdict["kind"] != "used" and verdict.get("fault") != "excluded"


def used(skill: Skill) -> int:
    """Return how many recordings a version was learned from."""
    return sum(one["kind"] != "left out" for one in verdicts(skill))


def _struck(skill: Skill) -> float:
    struck = (skill.document.get("provenance") or {}).get("struck") or {}
    return float(sum(len(indices) for indices in struck.values()))


def _count(value: Number) -> str:
    return "–" if value is None else f"{value:.0f}"


def _plain(value: Number) -> str:
    return "–" if value is None else f"{value:.1f}"


def _tenth(value: Number) -> str:
    return mm(value, 1)


FIGURES = (
    Figure("demonstrations used", lambda skill: float(used(skill)), _count),
    Figure("samples struck", _struck, _count),
    Figure("components", within("components"), _count),
    Figure("duration as taught", within("duration"), seconds),
    Figure("length", within("length"), _tenth),
    Figure("path against mean of people, RMS", within("path_error", "rms"), mm, "less"),
    Figure("the same, largest", within("path_error", "max"), mm, "less"),
    Figure("start of the path against mean of people", within("end_error", "start"), mm, "less"),
    Figure("end of the path against mean of people", within("end_error", "end"), mm, "less"),
    Figure("people against the path, RMS", _people, mm, "less"),
    Figure("people's spread, RMS", _usual, mm, "less"),
    Figure("people's spread, largest", _widest, mm, "less"),
    Figure("smoothness (nearer 0 is smoother)", within("smoothness"), _plain, "more"),
)
IN_SHORT = (
    "duration as taught",
    "length",
    "components",
    "path against mean of people, RMS",
    "the same, largest",
    "people's spread, largest",
    "smoothness (nearer 0 is smoother)",
)
CHANGES = (
    ("length", "length", _tenth),
    ("duration", "duration as taught", seconds),
    ("components", "components", _count),
    ("repeatability", "people's spread, RMS", mm),
    ("smoothness", "smoothness (nearer 0 is smoother)", _plain),
)


@dataclass(frozen=True, slots=True)
class Check:
    """A line of the checks: whether it is good, and the sentence."""

    good: bool
    sentence: str

    @property
    def sign(self) -> str:
        """The sign that goes before the sentence, so that colour is not the only one."""
        return "✓" if self.good else "⚠"


def checks(words: Words, skill: Skill) -> list[Check]:
    """Return what to look at before approving, each good or not."""
    count, flagged = used(skill), sum(wrong(one) for one in verdicts(skill))
    found = [
        Check(count >= FEWEST_USED, words.count(count, "demonstration used", "demonstrations used")),
        Check(not flagged, f"{flagged} {words('flagged')}"),
    ]
    error, widest = within("path_error", "max")(skill), _widest(skill)
    if error is not None and widest is not None:
        found.append(
            Check(error <= 2.0 * widest, f"{words('path within ±2σ of the people')}: {words.figures(mm(error))}")
        )
    found += [Check(False, words.said(note)) for note in skill.report.get("notes") or ()]
    return found


def against_paper(words: Words, skill: Skill) -> list[str]:
    """Return how the published pipeline does on the same demonstrations, in sentences; nothing if nobody looked."""
    paper = skill.report.get("paper")
    if not isinstance(paper, Mapping):
        return []
    if paper.get("note"):
        return [f"{words('as published')}: {words.said(paper['note'])}"]
    error, apart = paper.get("path_error") or {}, paper.get("distance") or {}
    told = [
        words.figures(
            f"{words('as published, the path would be off by')} {mm(number(error.get('rms')))} {words('RMS')}, "
            f"{mm(number(error.get('max')))} {words('at most')}"
        )
    ]
    if "max" in apart:
        where = percent(number(apart.get("place")))
        told.append(
            words.figures(
                f"{words('the two paths are at most')} {mm(number(apart['max']))} {words('apart, at')} {where}"
            )
        )
    return told


def since_before(words: Words, skill: Skill) -> list[str]:
    """Return what learning changed against the version before, in sentences; nothing for a first version."""
    before = skill.report.get("previous")
    if not isinstance(before, Mapping):
        return []
    told = []
    if before.get("note"):
        return [words.said(before["note"])]
    apart = before.get("distance") or {}
    if "max" in apart:
        where = percent(number(apart.get("place")))
        told.append(
            f"{words('path moved by at most')} {words.figures(mm(number(apart['max'])))}, {words('at')} {where}"
        )
    for key, label, said in CHANGES:
        change = before.get(key) or {}
        was, now = number(change.get("before")), number(change.get("now"))
        if was is not None and now is not None and abs(now - was) > SAME * max(abs(was), abs(now), 1e-9):
            told.append(f"{words(label)}: {words.figures(said(was))} → {words.figures(said(now))}")
    return told


def told_distance(now: Skill, before: Skill) -> tuple[float, float] | None:
    """Return the largest distance in m between two versions' paths and where, as the report says; None: it does not.

    The report's figure is the one truth: what a page would measure again would differ by how it is measured.
    """
    told = now.report.get("previous") or {}
    apart = told.get("distance") or {}
    if told.get("version") != before.version or "max" not in apart or apart.get("place") is None:
        return None
    return float(apart["max"]), float(apart["place"])


def changes(words: Words, before: Skill, now: Skill) -> list[str]:
    """Return what is different between two versions, a sentence a thing: how they were learned, and their figures."""
    told = []
    for label, read in (
        ("Type", lambda one: one.semantic_type),
        ("How to learn", lambda one: words(str(one.report.get("preset", "")))),
    ):
        was, is_now = read(before), read(now)
        if was != is_now:
            told.append(f"{words(label)}: {was} → {is_now}")
    for figure in FIGURES:
        was, is_now = figure.said(figure.read(before)), figure.said(figure.read(now))
        if was != is_now:
            told.append(f"{words(figure.label)}: {words.figures(was)} → {words.figures(is_now)}")
    return told

"""The operator card: what a run would do, drawn from the check of the server, to scale in the part's frame, as SVG."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np

from models.demonstration import Bools, Floats
from opcua_skill.client import Finding, Path, RunCheck
from opcua_skill.panel.formatting import mm, percent, seconds
from opcua_skill.panel.words import Words

WIDE, HIGH, ROOM = 380.0, 300.0, 32.0
SPEED_COLOURS = ("#5b2a86", "#2f5fa8", "#0f7b7b", "#3f7d1f", "#a35f00")
SIGMAS = 2.0
BORDER_MM = 20.0
ARROWS = 5
FLAT_MM = 1.0
SHORT = {
    "NoIkSolution": "out of reach",
    "WorkspaceLimit": "outside the workspace",
    "JointLimit": "beyond the limit of a joint",
    "SpeedLimit": "too fast for the arm",
    "Singularity": "too near to a pose in which the arm loses a direction",
    "Collision": "too little room between arm and what surrounds it",
    "ParameterInvalid": "a value that is not allowed",
}
UNITS = {"mm": "\u00a0mm", "degrees": "°"}


def in_short(words: Words, finding: Finding) -> str:
    """Return a finding in a few words: by how much, what, where."""
    unit = UNITS.get(finding.unit, "")
    much = f"{finding.size:.0f}{unit} " if finding.size and unit else ""
    if finding.code == "SpeedLimit" and finding.asked is not None and finding.limit is not None:
        much = f"{finding.asked:.0f} → {finding.limit:.0f}\u00a0{finding.unit} "
    where = f" {words('at')} {percent(finding.place)}" if finding.place is not None else ""
    return f"{much}{words(SHORT.get(finding.code, finding.code))}{where}"


def cannot_run(words: Words, check: RunCheck) -> str:
    """Return why a run is impossible, in a line; empty for one that is possible."""
    if check.can_run:
        return ""
    fatal = [one for one in check.findings if one.fatal]
    more = f" ({words('and')} {len(fatal) - 1} {words('more')})" if len(fatal) > 1 else ""
    return f"{words('cannot run')}: {in_short(words, fatal[0]) if fatal else '–'}{more}"


def facts(words: Words, check: RunCheck) -> Iterator[tuple[str, str]]:
    """Yield name and value of what is worth knowing of a run."""
    told = check.facts
    slowest, fastest = told.get("speedMin"), told.get("speedMax")
    yield words("length"), mm(told["length"], 0)
    yield (
        words("time on the path, and with the ways there and back"),
        f"{seconds(told['pathDuration'])} / {seconds(told['duration'])}",
    )
    if slowest is not None and fastest is not None:
        yield words("nozzle speed"), f"{1e3 * slowest:.0f} … {1e3 * fastest:.0f}\u00a0mm/s"
    yield words("time steps"), f"{told['samples']} × {1e3 * told['timeStep']:g}\u00a0ms"
    yield words("nozzle above the part"), mm(told["standoff"], 1)
    if told.get("clearance") is not None:
        yield words("smallest distance to anything"), mm(told["clearance"], 0)
    if (plate := told.get("plate")) is not None:
        yield words("part"), f"{1e3 * plate[2]:.0f} × {1e3 * plate[3]:.0f}\u00a0mm"
    valve = [one for one in told.get("valve") or () if one["opens"]]
    yield words("valve opens"), f"{len(valve)} ×"
    if told.get("tubeSigmas"):
        policy = words("stops the run") if told["tubePolicy"] == "stop" else words("is told")
        yield words("leaving the tube"), f"±{told['tubeSigmas']:g}σ: {policy}"
    yield words("plan"), f"{told['planDigest'][:12]}…"


@dataclass(frozen=True, slots=True)
class Window:
    """From mm in the part's frame to places in the drawing, with equal scales."""

    middle: tuple[float, float]
    scale: float

    @classmethod
    def around(cls, corners: Floats) -> "Window":
        """Return the window that shows these points (n, 2)."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        wide, high_ = np.maximum(high - low, 1.0)
        scale = min((WIDE - 2 * ROOM) / wide, (HIGH - 2 * ROOM) / high_)
        middle = (low + high) / 2
        return cls((float(middle[0]), float(middle[1])), float(scale))

    def at(self, points: Floats) -> Floats:
        """Return where points (n, 2) are drawn; y goes up."""
        away = (np.atleast_2d(points) - np.array(self.middle)) * self.scale
        return np.stack([WIDE / 2 + away[:, 0], HIGH / 2 - away[:, 1]], axis=1)


def drawn(words: Words, check: RunCheck, before: Path | None = None) -> str:
    """Return the views of a run as SVG: from above, and from the side where the path has height.

    ``before`` is a path to lay under it, dashed: that of the version approved last.
    """
    points = 1e3 * check.points
    views = [(0, 1)] if np.ptp(points[:, 2]) < FLAT_MM else [(0, 1), (0, 2)]
    return "".join(_view(words, check, points, axes, before) for axes in views)


def _view(words: Words, check: RunCheck, points: Floats, axes: tuple[int, int], before: Path | None) -> str:
    flat = points[:, axes]
    plate = _plate(check, points) if axes == (0, 1) else None
    window = Window.around(np.vstack([flat, plate]) if plate is not None else flat)
    at = window.at(flat)
    name = words("The run seen from above") if axes == (0, 1) else words("The run seen from the side")
    parts = [
        f'<svg class="card-view" viewBox="0 0 {WIDE:.0f} {HIGH:.0f}" role="img" '
        f'aria-label="{escape(name)}: {escape(in_words(words, check))}" data-mark="card-{"xy"[0]}{"xyz"[axes[1]]}">'
    ]
    if plate is not None:
        parts.append(_part(words, check, window.at(plate)))
    parts += _tube(check, flat, window, axes)
    if before is not None and before.points.shape[1] > axes[1]:
        line = window.at(1e3 * before.points[:, axes])
        parts.append(
            f'<path d="{_line(line)}" fill="none" stroke="#b45309" stroke-width="1.6" stroke-dasharray="5 4"/>'
        )
    parts += _path(check, at)
    parts += _arrows(at)
    parts += _marks(words, check, at)
    parts += _ends(words, at)
    parts += _ruler(window, axes)
    return "".join([*parts, "</svg>"])


def in_words(words: Words, check: RunCheck) -> str:
    """Return what the drawing shows, for whoever cannot see it."""
    first, last = (1e3 * check.points[k] for k in (0, -1))
    places = [f"x {one[0]:.0f}, y {one[1]:.0f} mm" for one in (first, last)]
    return words.figures(f"{words('Start')} {places[0]}; {words('End')} {places[1]}; {mm(check.facts['length'], 0)}")


def _plate(check: RunCheck, points: Floats) -> Floats:
    plate = check.facts.get("plate")
    if plate is not None:
        x, y, length, width = (1e3 * float(value) for value in plate)
        return np.array([[x, y], [x + length, y + width]])
    return np.array([points[:, :2].min(axis=0) - BORDER_MM, points[:, :2].max(axis=0) + BORDER_MM])


def _part(words: Words, check: RunCheck, corners: Floats) -> str:
    (left, low), (right, up) = corners
    known = check.facts.get("plate") is not None
    look = 'fill="#e7eff8" stroke="#30363d"' if known else 'fill="none" stroke="#5b6b7b" stroke-dasharray="3 4"'
    told = words("part") if known else words("kept clear: the recipe does not say how large the part is")
    return (
        f'<rect x="{left:.1f}" y="{up:.1f}" width="{right - left:.1f}" height="{low - up:.1f}" {look}/>'
        f'<text x="10" y="15" class="card-soft">{"▭" if known else "┈"} {escape(told)}</text>'
    )


def _line(at: Floats) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at)


def _tube(check: RunCheck, flat: Floats, window: Window, axes: tuple[int, int]) -> list[str]:
    if len(flat) < 3:
        return []
    way = np.gradient(flat, axis=0)
    across = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(np.linalg.norm(way, axis=1), 1e-9)[:, None]
    spread = 1e6 * check.covariances[np.ix_(range(len(flat)), axes, axes)]
    wide = SIGMAS * np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", across, spread, across), 0.0))[:, None]
    outline = window.at(np.vstack([flat + wide * across, (flat - wide * across)[::-1]]))
    return [f'<path d="{_line(outline)}Z" fill="#1f5fa8" fill-opacity="0.13"/>']


def speed_steps(check: RunCheck) -> tuple[Floats, int]:
    """Return the bounds (k + 1,) in m/s of the colours, and how many there are; one colour for a constant speed."""
    wet = check.speeds[check.dispense] if check.dispense.any() else check.speeds
    low, high = float(wet.min()), float(wet.max())
    count = 1 if high - low < 0.02 * max(high, 1e-9) else len(SPEED_COLOURS)
    return np.linspace(low, high, count + 1), count


def colours_of(count: int) -> tuple[str, ...]:
    """Return the colours from slow to fast."""
    return SPEED_COLOURS if count > 1 else SPEED_COLOURS[1:2]


def _path(check: RunCheck, at: Floats) -> list[str]:
    bounds, count = speed_steps(check)
    colours = colours_of(count)
    bins = np.clip(np.searchsorted(bounds, check.speeds, side="right") - 1, 0, count - 1)
    keys = np.where(check.dispense, bins, -1)
    parts, first = [], 0
    for k in range(1, len(at) + 1):
        if k == len(at) or keys[k] != keys[first]:
            piece = at[first : min(k, len(at) - 1) + 1]
            if keys[first] < 0:
                look = 'stroke="#5b6b7b" stroke-width="1.5" stroke-dasharray="2 4"'
            else:
                look = f'stroke="{colours[keys[first]]}" stroke-width="4"'
            parts.append(
                f'<path d="{_line(piece)}" fill="none" stroke-linecap="round" stroke-linejoin="round" {look}/>'
            )
            first = k
    return parts


def _arrows(at: Floats) -> list[str]:
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])
    places = np.searchsorted(way, way[-1] * (np.arange(ARROWS) + 0.5) / ARROWS).clip(1, len(at) - 1)
    parts = []
    for k in places:
        ahead = at[min(k + 2, len(at) - 1)] - at[max(k - 2, 0)]
        turn = np.degrees(np.arctan2(ahead[1], ahead[0]))
        x, y = at[k]
        parts.append(
            f'<path d="M7 0L-5 -5.5L-5 5.5Z" transform="translate({x:.1f} {y:.1f}) rotate({turn:.0f})" '
            'fill="#1d2733" stroke="white" stroke-width="1.4"/>'
        )
    return parts


def valve_places(dispense: Bools) -> tuple[list[int], list[int]]:
    """Return at which samples the valve opens, and at which it closes."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], dispense, [False]]).astype(int)))
    last = len(dispense) - 1
    return [int(min(k, last)) for k in edges[::2]], [int(min(k, last)) for k in edges[1::2]]


def slowdowns(check: RunCheck) -> list[Finding]:
    """Return what is told of places on the path, in the order of the path."""
    told = [one for one in check.findings if not one.fatal and one.place is not None]
    return sorted(told, key=lambda one: one.place or 0.0)


def _at_place(check: RunCheck, finding: Finding) -> int:
    """Return the sample at which a finding is: by its time, which samples are ordered by."""
    return int(np.searchsorted(check.times, finding.time or 0.0).clip(0, len(check.times) - 1))


def _marks(words: Words, check: RunCheck, at: Floats) -> list[str]:
    parts = []
    opens, closes = valve_places(check.dispense)
    for k in opens:
        x, y = at[k]
        parts.append(
            f'<path d="M0 -8L7 5L-7 5Z" transform="translate({x:.1f} {y:.1f})" fill="#1a7f37" stroke="white">'
            f"<title>{escape(words('valve opens'))}</title></path>"
        )
    for k in closes:
        x, y = at[k]
        parts.append(
            f'<rect x="{x - 6:.1f}" y="{y - 6:.1f}" width="12" height="12" fill="#b42318" stroke="white">'
            f"<title>{escape(words('valve closes'))}</title></rect>"
        )
    for number, finding in enumerate(slowdowns(check), start=1):
        x, y = at[_at_place(check, finding)]
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y - 15:.1f}" r="9" fill="#fff4e0" stroke="#8a4b00" stroke-width="1.6"/>'
            f'<text x="{x:.1f}" y="{y - 11:.1f}" text-anchor="middle" class="card-number">{number}</text>'
        )
    return parts


def _ends(words: Words, at: Floats) -> list[str]:
    parts = []
    same = float(np.linalg.norm(at[0] - at[-1])) < 26.0
    for k, name, colour, down in ((0, "Start", "#1a7f37", -1.0), (-1, "End", "#1d2733", 1.0 if same else -1.0)):
        x, y = at[k]
        above = y + (down * 17.0 if down < 0 else 26.0)
        place = min(max(x, 26.0), WIDE - 26.0)
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="11" fill="none" stroke="{colour}" stroke-width="2.4"/>'
            f'<text x="{place:.1f}" y="{min(max(above, 14.0), HIGH - 20.0):.1f}" text-anchor="middle" class="card-end" '
            f'fill="{colour}">{escape(words(name))}</text>'
        )
    return parts


def _ruler(window: Window, axes: tuple[int, int]) -> list[str]:
    steps = [one * 10.0**power for power in range(5) for one in (1.0, 2.0, 5.0)]
    length = max((one for one in steps if one * window.scale <= 120.0), default=1.0)
    wide, y = length * window.scale, HIGH - 8.0
    names = ("x", "xyz"[axes[1]])
    return [
        f'<path d="M14 {y:.1f}h{wide:.1f}M14 {y - 4:.1f}v8M{14 + wide:.1f} {y - 4:.1f}v8" stroke="#1d2733"/>',
        f'<text x="{20 + wide:.1f}" y="{y + 4:.1f}" class="card-soft">{length:g} mm · {names[0]} → {names[1]} ↑</text>',
    ]

"""A version's quality report in words, as an engineer reads it before signing: millimetres, seconds, places."""

from collections.abc import Mapping
from typing import Any

from opcua_skill.commands.terminal.output import counted

Facts = list[tuple[str, str]]


def facts(report: Mapping[str, Any]) -> Facts:
    """Return what was learned, how well, and how it compares, line by line. What a report does not tell is left out."""
    found: Facts = []
    if "preset" in report:
        parts = f"{counted(report.get('components', 0), 'component')} over the {report.get('clock')}"
        found.append(("preset", f"{report['preset']}: {parts}"))
    if "length" in report:
        found.append(("path", f"{mm(report['length'])} in {report.get('duration', 0.0):.2f} s"))
    found += _errors("", report)
    found += _repeatability(report.get("repeatability"))
    if isinstance(report.get("smoothness"), int | float):
        found.append(("smoothness", f"log dimensionless jerk {report['smoothness']:.1f} (nearer to zero is smoother)"))
    found += _before(report.get("previous"))
    found += _paper(report.get("paper"))
    return found + [("note", note) for note in report.get("notes") or ()]


def mm(metres: float | None) -> str:
    """Return a length in millimetres: two digits behind the point below 10 mm, one below 100."""
    if metres is None:
        return "unknown"
    value = 1e3 * metres
    return f"{value:.{2 if abs(value) < 10 else 1 if abs(value) < 100 else 0}f} mm"


def _errors(whose: str, told: Mapping[str, Any]) -> Facts:
    found: Facts = []
    error, ends = told.get("path_error"), told.get("end_error")
    if error:
        words = f"{mm(error['rms'])} RMS, {mm(error['max'])} at most, from the mean of the demonstrations"
        found.append((f"{whose}path error", words))
    if ends:
        found.append((f"{whose}ends", f"starts {mm(ends['start'])} and ends {mm(ends['end'])} from that mean"))
    return found


def _repeatability(told: Mapping[str, Any] | None) -> Facts:
    pairs = [] if not told else zip(told.get("phases") or (), told.get("deviation") or (), strict=False)
    known = [(deviation, phase) for phase, deviation in pairs if deviation is not None]
    if not known:
        return []
    rms = (sum(deviation**2 for deviation, _ in known) / len(known)) ** 0.5
    worst, place = max(known)
    words = f"people differ by {mm(rms)} RMS, most at {place:.2f} of the path: {mm(worst)}"
    return [("repeatability", words)]


def _apart(told: Mapping[str, Any]) -> str:
    where = ", ".join(f"{1e3 * value:.1f}" for value in told.get("point") or ())
    place = f"at {told['place']:.2f} of the path" + (f" ({where} mm)" if where else "")
    return f"{mm(told['rms'])} RMS, {mm(told['max'])} at most {place}, Fréchet {mm(told['frechet'])}"


def _before(told: Mapping[str, Any] | None) -> Facts:
    if not told:
        return []
    name = f"version {told.get('version')}"
    if "distance" not in told:
        return [(f"to {name}", str(told.get("note", "not comparable")))]
    found: Facts = [(f"from {name}", _apart(told["distance"]))]
    for what, shown in (
        ("duration", lambda value: f"{value:.2f} s"),
        ("length", mm),
        ("components", str),
        ("repeatability", mm),
        ("smoothness", lambda value: f"{value:.1f}"),
    ):
        change = told.get(what)
        if change:
            was, now = (shown(change[key]) if change[key] is not None else "unknown" for key in ("before", "now"))
            found.append((f"  {what}", f"{was}, as before" if was == now else f"{was} → {now}"))
    return found


def _paper(told: Mapping[str, Any] | None) -> Facts:
    if not told:
        return []
    if "distance" not in told:
        return [("the paper's preset", str(told.get("note", "could not be compared")))]
    found = _errors("  its ", told)
    return [("the paper's preset, estimated", f"{_apart(told['distance'])}, from this path"), *found]

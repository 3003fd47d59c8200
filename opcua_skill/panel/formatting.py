"""How values are shown to people: lengths in mm, moments in local time, states with a sign and not colour alone."""

import math
from datetime import datetime
from html import escape

from opcua_skill.panel.words import Words

STATE_SIGNS = {
    "Learned": ("○", "learned"),
    "Approved": ("✓", "approved"),
    "Rejected": ("✕", "rejected"),
    "Retired": ("–", "retired"),
    "Queued": ("…", "plain"),
    "Running": ("▶", "learned"),
    "Paused": ("‖", "flag"),
    "Stopping": ("■", "flag"),
    "Completed": ("✓", "approved"),
    "Failed": ("✕", "rejected"),
    "Aborted": ("■", "flag"),
}


def mm(metres: float | None, digits: int = 2) -> str:
    """Return a length with its unit; an en dash for one that was not measured."""
    if metres is None or not math.isfinite(metres):
        return "–"
    return f"{metres * 1000:.{digits}f}\u00a0mm"


def seconds(value: float | None, digits: int = 1) -> str:
    """Return a duration with its unit."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}f}\u00a0s"


def percent(fraction: float | None) -> str:
    """Return a fraction as percent."""
    return "–" if fraction is None or not math.isfinite(fraction) else f"{100 * fraction:.0f}\u00a0%"


def moment(value: datetime | None) -> str:
    """Return a moment in local time."""
    return value.astimezone().strftime("%Y-%m-%d %H:%M") if value else "–"


def state_tag(words: Words, state: str) -> str:
    """Return HTML for a state: sign, word and colour."""
    sign, kind = STATE_SIGNS.get(state, ("", "plain"))
    return f'<span class="tag tag-{kind}">{sign} {escape(words(state))}</span>'


def moment_of(written: object) -> str:
    """Return a moment written in a description in local time."""
    try:
        return moment(datetime.fromisoformat(str(written)))
    except ValueError:
        return "–"

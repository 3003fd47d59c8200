"""What is to be said of one demonstration, in words for an operator: what it did that the others did not."""

from collections.abc import Sequence

import numpy as np

from models.demonstration import Floats
from models.findings import Remark
from models.geometry import norms
from models.screening.pauses import Detour, Pause

LONG_PAUSE = 0.12
LONG_WAIT = 0.3
UNUSUAL = 2.0
MOST_TOLD = 3
AT_AN_END = 0.02


def what_it_did(pauses: Sequence[Pause], extras: Sequence[Detour], usual: float = 0.0) -> Remark | None:
    """Return pauses of an eighth of the time and more, waits of three tenths at the ends and stretches the others lack,
    in words. ``usual``: the people's usual longest share; who pauses less than twice as long does what all do.

    The place is that of the first one told, the size how far from the common path a way around went.
    """
    told: list[Remark] = []
    for extra in sorted(extras, key=lambda one: -one.length):
        length = f"{1e3 * extra.length:.0f} mm"
        if extra.repeated:
            told.append(
                Remark(
                    f"went over {length} again at {extra.place:.2f} of the path", extra.place, None, "went-over-again"
                )
            )
        else:
            away = f"{1e3 * extra.away:.0f} mm"
            words = f"took a way around at {extra.place:.2f} of the path: {length} long, {away} away"
            told.append(Remark(words, extra.place, extra.away, "way-around"))
    for pause in sorted(pauses, key=lambda one: -one.duration):
        waited = f"waited for {pause.duration:.1f} s"
        if AT_AN_END < pause.place < 1.0 - AT_AN_END:
            if pause.share >= max(LONG_PAUSE, UNUSUAL * usual):
                words = f"paused for {pause.duration:.1f} s at {pause.place:.2f} of the path"
                told.append(Remark(words, pause.place, None, "paused"))
        elif pause.share >= max(LONG_WAIT, UNUSUAL * usual):
            where = "before the first move" if pause.place < 0.5 else "after the last move"
            told.append(Remark(f"{waited} {where}", pause.place, None, "waited"))
    if not told:
        return None
    shown = told[:MOST_TOLD]
    words = ", ".join(one.reason for one in shown)
    if len(told) > len(shown):
        words += f" and {len(told) - len(shown)} more"
    return Remark(words, shown[0].place, shown[0].size, shown[0].code)


def another_shape(place: float, size: float) -> Remark:
    """Return what is said of a demonstration that shows something else than the others do."""
    words = f"another shape than the others: {1e3 * size:.0f} mm off at {place:.2f} of the path"
    return Remark(words, place, size, "another-shape")


def off(place: float, offset: Floats) -> Remark:
    """Return what is said of a demonstration that is this far (d,) from the others at one place."""
    size = float(norms(offset))
    words = f"{place:.2f} of the path: {millimetres(size)} mm {_side(offset)} the others"
    return Remark(words, place, size, "off")


def drawn_elsewhere(offset: Floats) -> Remark:
    """Return what is said of a demonstration that lies this far (d,) from the others all along."""
    size = float(norms(offset))
    words = f"the same shape drawn elsewhere: {millimetres(size)} mm {_side(offset)} the others"
    return Remark(words, None, size, "elsewhere")


def millimetres(size: float) -> str:
    """Return a size in m in millimetres, to a tenth where that says something."""
    return f"{1e3 * size:.0f}" if size >= 0.01 else f"{1e3 * size:.1f}"


def _side(offset: Floats) -> str:
    """Return in words to which side an offset (d,) goes most."""
    axis = int(np.abs(offset).argmax())
    up = len(offset) - 1
    if axis == up:
        return "above" if offset[axis] > 0 else "below"
    if axis == 0:
        return "to the right of" if offset[axis] > 0 else "to the left of"
    return "behind" if offset[axis] > 0 else "in front of"

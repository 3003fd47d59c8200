"""What is to be said of one demonstration, in words for an operator: what it did that the others did not."""

from collections.abc import Sequence

from models.correspondence import Remark
from models.stretches import Extra, Pause

LONG_PAUSE = 0.1
LONG_WAIT = 0.3
MOST_TOLD = 3


def what_it_did(pauses: Sequence[Pause], extras: Sequence[Extra]) -> Remark | None:
    """Return pauses of a tenth of the time and more, waits of three tenths at the ends and stretches the others lack,
    in words.

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
        if 0.0 < pause.place < 1.0:
            if pause.share >= LONG_PAUSE:
                words = f"paused for {pause.duration:.1f} s at {pause.place:.2f} of the path"
                told.append(Remark(words, pause.place, None, "paused"))
        elif pause.share >= LONG_WAIT:
            where = "before the first move" if pause.place == 0.0 else "after the last move"
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

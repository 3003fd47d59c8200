"""TRC (Motion Analysis, OpenSim): five lines of header, then frame, time and three columns a marker.

Real files are separated by tabs or commas, begin with ``PathFileType  4`` in one cell, double the tabs of a line, begin
with any frame, end lines with a tab, and promise more frames than they hold: the rows are believed.
"""

from library.readers.import_options import Choices
from library.readers.text_table import METRES, Sheet
from library.readers.tracks import Track, follow, frame_times, pick, table, up_axis_needed
from models.demonstration import Demonstration

AGAIN = "export it again as TRC"


def is_trc(sheet: Sheet) -> bool:
    """Return whether the file begins as TRC files do."""
    return bool(sheet.rows) and sheet.rows[0][:1] != [] and sheet.rows[0][0].split()[:1] == ["PathFileType"]


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker. TRC does not say which axis points up, so it has to be chosen."""
    if not is_trc(sheet):
        raise sheet.error("it does not begin with PathFileType", AGAIN, 1)
    rate, unit = _rate_and_unit(sheet)
    names = sheet.cells(4)
    if names[:2] != ["Frame#", "Time"]:
        raise sheet.error("there is no line that begins with Frame#, Time", AGAIN, 4)
    firsts = [column for column, name in enumerate(names) if column > 1 and name]
    axes = sheet.cells(5)
    number = 0
    for column in firsts:
        # A part of the markers keeps its numbers: they only rise.
        told = axes[column][1:] if column < len(axes) else ""
        at_least, number = number + 1, int(told) if told.isdecimal() and len(told) < 6 else number + 1
        if number < at_least or axes[column : column + 3] != [f"X{number}", f"Y{number}", f"Z{number}"]:
            raise sheet.error(f"below {names[column]!r} are no columns X{number}, Y{number}, Z{number}", AGAIN, 5)
    first = firsts[pick(sheet.path, [names[column] for column in firsts], choices.marker)]
    lines = [line for line in range(6, len(sheet.rows) + 1) if any(sheet.rows[line - 1])]
    if not lines:
        raise sheet.error("there are no samples", AGAIN, 6)
    if not choices.up_axis:
        raise up_axis_needed(sheet, "choose the up axis: x, y or z")
    points = table(sheet, lines, (first, first + 1, first + 2), width=first + 3) * unit
    told = [sheet.number(line, 1) for line in lines]
    track = Track(names[first], frame_times(sheet, lines, rate, told=told), points)
    return follow(sheet.path, [track], Choices(up_axis=choices.up_axis))


def _rate_and_unit(sheet: Sheet) -> tuple[float, float]:
    """Return frames a second, and metres a unit. Real files double tabs on one of these lines and not on the other."""
    keys, values = ([cell for cell in sheet.cells(line) if cell] for line in (2, 3))
    told = dict(zip(keys, values, strict=False))
    if not {"DataRate", "Units"} <= set(told) or len(keys) != len(values):
        raise sheet.error("DataRate and Units are missing, or do not stand one below the other", AGAIN, 2)
    rate = sheet.number(3, sheet.cells(3).index(told["DataRate"]))
    unit = METRES.get(told["Units"].lower())
    if rate <= 0 or unit is None:
        raise sheet.error(f"rate and unit are {rate:g} and {told['Units'][:40]!r}", AGAIN, 3)
    return rate, unit

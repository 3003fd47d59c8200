"""OptiTrack Motive CSV (1.2x and later): keys and values on the first line, then five or six lines of column heads.

Times come from the export frame rate: the time column is rounded to milliseconds. Which axis points up is not said.
"""

from collections import Counter

from library.readers.import_options import Choices
from library.readers.text_table import METRES, Sheet
from library.readers.tracks import Track, follow, frame_times, pick, table, up_axis_needed
from models.demonstration import Demonstration

AGAIN = "export it again from Motive as CSV"
BODIES = {"Rigid Body", "Bone", "Marker", "Rigid Body Marker", "Bone Marker"}


def is_motive(sheet: Sheet) -> bool:
    """Return whether the file begins as Motive's do."""
    return bool(sheet.rows) and sheet.rows[0][:1] == ["Format Version"]


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen rigid body or marker."""
    told = dict(zip(sheet.rows[0][0::2], sheet.rows[0][1::2], strict=False))
    rate = _rate(sheet, told)
    unit = METRES.get(told.get("Length Units", "").lower())
    if unit is None:
        raise sheet.error(f"Length Units are {told.get('Length Units', '')!r}", AGAIN, 1)
    if not choices.up_axis:
        raise up_axis_needed(sheet, "choose the up axis: y unless Motive was set to z")
    found = [line for line, cells in enumerate(sheet.rows[:20], 1) if cells[:1] == ["Frame"]]
    if not found:
        raise sheet.error("there is no line that begins with Frame", AGAIN)
    head = found[0]
    names, columns_of = _positions(sheet, head)
    place = pick(sheet.path, names, choices.marker)
    name, columns = names[place], columns_of[place]
    lines = [line for line in range(head + 1, len(sheet.rows) + 1) if any(sheet.rows[line - 1])]
    if not lines:
        raise sheet.error("there are no samples", AGAIN, head + 1)
    points = table(sheet, lines, columns, width=max(columns) + 1) * unit
    times = frame_times(sheet, lines, rate, told=[sheet.number(line, 1) for line in lines])
    return follow(sheet.path, [Track(name, times, points)], Choices(up_axis=choices.up_axis))


def _rate(sheet: Sheet, told: dict[str, str]) -> float:
    key = "Export Frame Rate" if "Export Frame Rate" in told else "Capture Frame Rate"
    if key not in told:
        raise sheet.error("there is no Export Frame Rate", AGAIN, 1)
    rate = sheet.number(1, sheet.rows[0].index(key) + 1)
    if rate <= 0:
        raise sheet.error(f"{key} is {rate:g}", AGAIN, 1)
    return rate


def _positions(sheet: Sheet, head: int) -> tuple[list[str], list[tuple[int, int, int]]]:
    """Return names and columns X, Y, Z of the position of each body and marker.

    A rigid body's solved marker and the measured one share a name: then the kind is added to it.
    """
    kinds, names = _kinds_and_names(sheet, head)
    what, axes = sheet.rows[head - 2], sheet.rows[head - 1]
    if len(names) != len(kinds) or len(axes) < 5:
        raise sheet.error("the lines Type and Name are missing above Frame", AGAIN, head)
    found: list[tuple[str, str, tuple[int, int, int]]] = []
    for column in range(2, len(axes) - 2):
        group = [row[column : column + 3] for row in (kinds, names, what, axes)]
        if group[3] != ["X", "Y", "Z"] or set(group[2]) != {"Position"} or kinds[column] not in BODIES:
            continue
        if len(set(group[0])) != 1 or len(set(group[1])) != 1:
            raise sheet.error(f"X, Y and Z of {names[column]!r} belong to different bodies", AGAIN, head)
        found.append((names[column], kinds[column], (column, column + 1, column + 2)))
    many = Counter(name for name, _, _ in found)
    shown = [f"{name} ({kind})" if many[name] > 1 else name for name, kind, _ in found]
    return shown, [columns for _, _, columns in found]


def _kinds_and_names(sheet: Sheet, head: int) -> tuple[list[str], list[str]]:
    """Return the lines Type and Name; older exports do not label them, but have them in this order."""
    above = [cells for cells in sheet.rows[1 : head - 2] if len(cells) > 2 and any(cells)]
    labelled = {cells[1]: cells for cells in above if cells[1]}
    if "Type" in labelled and "Name" in labelled:
        return labelled["Type"], labelled["Name"]
    if labelled or len(above) < 2 or not set(filter(None, above[0])) <= BODIES:
        return [], [""]
    return above[0], above[1]

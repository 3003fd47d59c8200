"""Vicon CSV: a block of Nexus (``Trajectories``, ``Segments``) or Tracker (``Objects``), which a blank line ends.

Markers have columns X, Y, Z, bodies RX, RY, RZ, perhaps RW, and TX, TY, TZ. Bodies are followed where no markers are.
"""

from library.readers.import_options import Choices
from library.readers.text_table import METRES, Sheet
from library.readers.tracks import Track, follow, frame_times, pick, table
from models.demonstration import Demonstration

AGAIN = "export it again from Nexus as ASCII with trajectories"


BLOCKS = {"Trajectories": ("X", "Y", "Z"), "Objects": ("TX", "TY", "TZ"), "Segments": ("TX", "TY", "TZ")}
OTHER_BLOCKS = {"Devices", "Joints", "Model Outputs", "Events"}


def is_vicon(sheet: Sheet) -> bool:
    """Return whether the file begins as Vicon's do, or a block of trajectories comes later."""
    if not sheet.rows:
        return False
    first = sheet.rows[0]
    a_block = first[:1] in [[block] for block in (*BLOCKS, *OTHER_BLOCKS)] and not any(first[1:])
    return a_block or any(cells and cells[0] == "Trajectories" for cells in sheet.rows)


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker or body; Vicon exports with z up."""
    starts = {cells[0]: line for line, cells in enumerate(sheet.rows, 1) if cells and cells[0] in BLOCKS}
    block = next((block for block in BLOCKS if block in starts), "")
    if not block:
        raise sheet.error(f"it holds {sheet.rows[0][0]} and no trajectories", AGAIN, 1)
    start, three = starts[block], list(BLOCKS[block])
    sheet.cells(start + 1)
    rate = sheet.number(start + 1, 0) if sheet.rows[start] else 0.0
    if rate <= 0:
        raise sheet.error("there is no frame rate", AGAIN, start + 1)
    names = sheet.cells(start + 2)
    axes, units = sheet.cells(start + 3), sheet.cells(start + 4)
    if axes[:2] != ["Frame", "Sub Frame"]:
        raise sheet.error("there is no line that begins with Frame, Sub Frame", AGAIN, start + 3)
    named = [column for column, name in enumerate(names) if name]
    firsts: list[int] = []
    for column, end in zip(named, [*named[1:], len(axes)], strict=False):
        found = [place for place in range(column, min(end, column + 5)) if axes[place : place + 3] == three]
        if not found or (block == "Trajectories" and found[0] != column):
            raise sheet.error(f"below {names[column]!r} are no columns {', '.join(three)}", AGAIN, start + 3)
        firsts.append(found[0])
    place = pick(sheet.path, [names[column] for column in named], choices.marker)
    name, first = names[named[place]], firsts[place]
    columns = (first, first + 1, first + 2)
    used = {units[column] if column < len(units) else "" for column in columns}
    unit = METRES.get(next(iter(used)).lower()) if len(used) == 1 else None
    if unit is None:
        raise sheet.error(f"the unit of {name!r} is {', '.join(sorted(used))!r}", AGAIN, start + 4)
    lines: list[int] = []
    for line in range(start + 5, len(sheet.rows) + 1):
        if not any(sheet.rows[line - 1]):
            break
        lines.append(line)
    if not lines:
        raise sheet.error("there are no samples", AGAIN, start + 5)
    points = table(sheet, lines, columns, width=first + 3) * unit
    for line in lines:
        if sheet.number(line, 1) != 0:
            raise sheet.error("it has sub frames", "export trajectories at their own rate", line)
    track = Track(name, frame_times(sheet, lines, rate), points)
    return follow(sheet.path, [track], Choices(up_axis=choices.up_axis))

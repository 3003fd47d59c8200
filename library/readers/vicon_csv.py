"""Vicon Nexus CSV: the block ``Trajectories``, its rate below, markers in threes of columns, a blank line ends it."""

from library.readers.choices import Choices
from library.readers.sheet import METRES, Sheet
from library.readers.tracks import Track, follow, frame_times, pick, table
from models.demonstration import Demonstration

AGAIN = "export it again from Nexus as ASCII with trajectories"


def is_vicon(sheet: Sheet) -> bool:
    """Return whether there is a block of trajectories."""
    return any(cells and cells[0] == "Trajectories" for cells in sheet.rows)


def is_without_trajectories(sheet: Sheet) -> bool:
    """Return whether the file begins as Nexus's do, with another block."""
    return bool(sheet.rows) and sheet.rows[0][:1] in (["Devices"], ["Joints"], ["Model Outputs"], ["Segments"])


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker; Nexus exports with z up."""
    if not is_vicon(sheet):
        raise sheet.error(f"it holds {sheet.rows[0][0]} and no trajectories", AGAIN, 1)
    start = next(line for line, cells in enumerate(sheet.rows, 1) if cells and cells[0] == "Trajectories")
    sheet.cells(start + 1)
    rate = sheet.number(start + 1, 0) if sheet.rows[start] else 0.0
    if rate <= 0:
        raise sheet.error("there is no frame rate", AGAIN, start + 1)
    names = sheet.cells(start + 2)
    axes, units = sheet.cells(start + 3), sheet.cells(start + 4)
    if axes[:2] != ["Frame", "Sub Frame"]:
        raise sheet.error("there is no line that begins with Frame, Sub Frame", AGAIN, start + 3)
    firsts = [column for column, name in enumerate(names) if name]
    for column in firsts:
        if axes[column : column + 3] != ["X", "Y", "Z"]:
            raise sheet.error(f"below {names[column]!r} are no columns X, Y, Z", AGAIN, start + 3)
    first = firsts[pick(sheet.path, [names[column] for column in firsts], choices.marker)]
    columns = (first, first + 1, first + 2)
    used = {units[column] if column < len(units) else "" for column in columns}
    unit = METRES.get(next(iter(used)).lower()) if len(used) == 1 else None
    if unit is None:
        raise sheet.error(f"the unit of {names[first]!r} is {', '.join(sorted(used))!r}", AGAIN, start + 4)
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
    track = Track(names[first], frame_times(sheet, lines, rate), points)
    return follow(sheet.path, [track], Choices(up_axis=choices.up_axis))

"""Qualisys TSV (3D): a key and its values a line, ``MARKER_NAMES`` among them, then three columns a marker, in mm.

With or without a line of column heads, and with or without frame and time before the positions, as it was exported.
"""

import numpy as np

from library.readers.import_options import Choices
from library.readers.text_table import Sheet, is_number
from library.readers.tracks import Track, follow, pick, table
from models.demonstration import Demonstration

AGAIN = "export it again from Qualisys Track Manager as TSV with 3D data"
BEGIN = 5
MOST_KEYS = 40


def is_qualisys(sheet: Sheet) -> bool:
    """Return whether the file begins as Qualisys's do."""
    return any(cells[:1] == ["NO_OF_FRAMES"] for cells in sheet.rows[:BEGIN])


def read(sheet: Sheet, choices: Choices) -> list[Demonstration]:
    """Return the way of the chosen marker; Qualisys exports millimetres, with z up."""
    keys = {cells[0]: line for line, cells in enumerate(sheet.rows[:MOST_KEYS], 1) if cells and cells[0].isupper()}
    kind = _told(sheet, keys, "DATA_INCLUDED")
    if kind != "3D" or "MARKER_NAMES" not in keys:
        raise sheet.error(f"it holds {kind[:40]} data and no markers", AGAIN, keys.get("DATA_INCLUDED", 1))
    names = [name for name in sheet.cells(keys["MARKER_NAMES"])[1:] if name]
    rate = sheet.number(keys["FREQUENCY"], 1) if _told(sheet, keys, "FREQUENCY") else 0.0
    if rate <= 0:
        raise sheet.error("there is no frame rate", AGAIN, keys.get("FREQUENCY", 1))
    place = pick(sheet.path, names, choices.marker)
    start = max(keys.values()) + 1
    while start <= len(sheet.rows) and not (sheet.rows[start - 1] and is_number(sheet.rows[start - 1][0])):
        start += 1
    lines = [line for line in range(start, len(sheet.rows) + 1) if any(sheet.rows[line - 1])]
    if not lines:
        raise sheet.error("there are no samples", AGAIN, start)
    width = len(sheet.rows[lines[0] - 1])
    while width and not sheet.rows[lines[0] - 1][width - 1] and width > 3 * len(names) + 2:
        width -= 1
    before = width - 3 * len(names)
    if before not in {0, 1, 2}:
        raise sheet.error(f"it names {len(names)} markers and has {width} columns", AGAIN, lines[0])
    first = before + 3 * place
    points = table(sheet, lines, (first, first + 1, first + 2), width=first + 3) * 0.001
    frames = np.arange(len(lines), dtype=np.float64)
    if before == 2:
        frames = np.array([sheet.number(line, 0) for line in lines])
        wrong = np.flatnonzero(np.diff(frames) != 1)
        if len(wrong):
            told = f"frame {frames[wrong[0] + 1]:g} does not come after {frames[wrong[0]]:g}"
            raise sheet.error(told, "delete or mend the line", lines[int(wrong[0]) + 1])
    times = (frames - frames[0]) / rate
    return follow(sheet.path, [Track(names[place], times, points)], Choices(up_axis=choices.up_axis))


def _told(sheet: Sheet, keys: dict[str, int], key: str) -> str:
    """Return the value beside a key, empty where there is none."""
    cells = sheet.rows[keys[key] - 1] if key in keys else []
    return cells[1] if len(cells) > 1 else ""

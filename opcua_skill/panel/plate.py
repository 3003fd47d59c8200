"""The plate in the browser: strokes are drawn on it, recordings shown, and a tracker's samples as they come."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from nicegui.element import Element

from models.demonstration import Bools, Demonstration, Floats

MOST_POINTS = 400


class Plate(Element, component=Path(__file__).parent / "static" / "plate.js"):
    """A plate to scale; ``width`` and ``height`` in mm. A tracker that works elsewhere makes it show more room."""

    def __init__(self, width: float, height: float, *, drawing: bool) -> None:
        super().__init__()
        self._props.update(width=width, height=height, drawing=drawing)

    def show(self, recordings: "list[tuple[Demonstration, bool]]") -> None:
        """Draw recordings, and whether each is used."""
        strokes = []
        for one, used in recordings:
            step = max(1, len(one.times) // MOST_POINTS)
            points = np.round(1000.0 * one.points[::step, :2], 2)
            finite = [[x, y] if np.isfinite(x) and np.isfinite(y) else [None, None] for x, y in points.tolist()]
            strokes.append({"id": one.demonstration_id, "used": used, "points": finite})
        self.run_method("show", strokes)

    def track(self, positions: Floats, pressed: Bools, *, begin: bool) -> None:
        """Draw samples of a tracker: positions (n, d) in m seen from above, and where the button was pressed."""
        points = np.round(1000.0 * positions[:, :2], 2).tolist()
        self.run_method("track", {"points": points, "pressed": [bool(one) for one in pressed], "begin": begin})

    def presses(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Say which samples of the tracker are demonstrations; what is pressed and in none was discarded."""
        self.run_method("presses", [list(one) for one in ranges])

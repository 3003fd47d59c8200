"""The review chart: packs recordings, path, tube and components for the browser, once; later only what changed."""

import base64
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from nicegui.element import Element
from nicegui.elements.echart import EChart

from models.demonstration import Demonstration, Floats
from opcua_skill.client import Path, Skill
from opcua_skill.panel.review import Material, along
from opcua_skill.panel.words import Words

SHOWN_PATH_SAMPLES = 500
TUBE = 2.0
ROUND = np.linspace(0.0, 2.0 * np.pi, 49)
ECHARTS = EChart  # importing it puts its bundle on the page, which the component below draws with


class ReviewChart(Element, component=FilePath(__file__).parent / "static" / "review_chart.js"):
    """The chart in the browser. It tells which samples a person picked; what that means is decided here."""

    def __init__(
        self, data: Mapping[str, Any], state: Mapping[str, Any], on_strike: Callable[[Mapping[str, Any]], None]
    ) -> None:
        super().__init__()
        self._props["data"] = dict(data)
        self._props["state"] = dict(state)
        self.on("strike", lambda event: on_strike(event.args))

    def show(self, **state: Any) -> None:
        """Change view, mode, layers or tool."""
        self.run_method("show", state)

    def overlay(self, **over: Any) -> None:
        """Change what lies over the lines: struck samples, excluded lines, preview, ghost."""
        self.run_method("overlay", over)


def packed(values: Floats) -> str:
    """Return numbers as base64 of 32-bit floats: a fifth of the size of text, and read in no time."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def thinned(path: Path) -> list[int]:
    """Return which samples of a path are shown."""
    count = len(path.times)
    return np.unique(np.linspace(0, count - 1, min(count, SHOWN_PATH_SAMPLES)).round().astype(int)).tolist()


def packed_path(path: Path, points: Floats | None = None) -> dict[str, str]:
    """Return a path, or other points at its times, as an overlay."""
    shown = thinned(path)
    where = path.points if points is None else points
    return {"points": packed(1000.0 * where[shown]), "clock": packed(path.times[shown])}


def chart_data(words: Words, skill: Skill, material: Material, flagged: Mapping[str, float | None]) -> dict[str, Any]:
    """Return everything the chart draws once. Lengths in mm, times in s.

    ``flagged`` are the recordings that learning found fault with, each with the place (0 to 1), if it has one.
    """
    lines = [_line(name, raw, material, name in flagged, flagged.get(name)) for name, raw in material.raw.items()]
    return {
        "dimension": int(material.path.points.shape[1]),
        "lines": lines,
        "path": packed_path(material.path),
        "shapes": _shapes(skill, material.path),
        "words": {"time": words("time"), "learned": words("learned path"), "comma": words.figures("0.5")[1]},
    }


def _line(name: str, raw: Demonstration, material: Material, flagged: bool, place: float | None) -> dict[str, Any]:
    aligned = material.aligned.get(name)
    length = float(material.path.times[-1])
    shown = aligned if aligned is not None else raw
    clock = aligned.times if aligned is not None else raw.times * (length / max(float(raw.times[-1]), 1e-9))
    return {
        "id": name,
        "flagged": flagged,
        "used": aligned is not None,
        "raw": packed(1000.0 * raw.points),
        "raw_clock": packed(raw.times),
        "aligned": packed(1000.0 * shown.points),
        "aligned_clock": packed(clock),
        "place": None if place is None else {"raw": _at(raw, place), "aligned": _at(shown, place)},
    }


def _at(shown: Demonstration, place: float) -> int:
    """Return the sample at a share of a line's length."""
    return int(np.argmin(np.abs(along(shown.points) - place)))


def _shapes(skill: Skill, path: Path) -> dict[str, dict[str, list[list[list[float]]]]]:
    """Return the polygons of tube and components for every pair of axes a view may have."""
    dimension = path.points.shape[1]
    with_phase = skill.means.shape[1] >= dimension + 2
    first = 2 if with_phase else 1
    projections = [(0, 1)] if dimension == 2 else [(0, 1), (0, 2)]
    shapes: dict[str, dict[str, list[list[list[float]]]]] = {}
    for x, y in projections:
        shapes[f"{x}{y}"] = {
            "tube": _tube(path, x, y),
            "components": [
                _ellipse(1000.0 * mean[[first + x, first + y]], 1e6 * deviation)
                for mean, deviation in zip(
                    skill.means, _marginals(skill.covariances, first + x, first + y), strict=True
                )
            ],
        }
    clock = first - 1
    for k in range(dimension):
        scale = np.array([1.0, 1000.0])
        shapes[f"t{k}"] = {
            "tube": _band(path, k),
            "components": [
                _ellipse(scale * mean[[clock, first + k]], deviation * np.outer(scale, scale))
                for mean, deviation in zip(skill.means, _marginals(skill.covariances, clock, first + k), strict=True)
            ],
        }
    return shapes


def _marginals(covariances: Floats, a: int, b: int) -> Floats:
    """Return the covariances (K, 2, 2) of two columns."""
    return covariances[:, [[a], [b]], [[a, b]]]


def _ellipse(middle: Floats, covariance: Floats) -> list[list[float]]:
    """Return the outline of two standard deviations."""
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(ROUND), np.sin(ROUND)])
    outline = middle[:, None] + TUBE * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    return np.round(outline.T, 3).tolist()


def _tube(path: Path, x: int, y: int) -> list[list[list[float]]]:
    """Return the tube of two standard deviations across the path, as one polygon."""
    shown = thinned(path)[::2]
    points = 1000.0 * path.points[np.ix_(shown, [x, y])]
    moves = np.gradient(points, axis=0)
    lengths = np.sqrt((moves * moves).sum(axis=1, keepdims=True))
    across = np.stack([-moves[:, 1], moves[:, 0]], axis=1) / np.maximum(lengths, 1e-9)
    covariances = 1e6 * path.covariances[np.ix_(shown, [x, y], [x, y])]
    width = TUBE * np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", across, covariances, across), 0.0))[:, None]
    left, right = np.round(points + width * across, 2), np.round(points - width * across, 2)
    return [np.concatenate([left, right[::-1]]).tolist()]


def _band(path: Path, k: int) -> list[list[list[float]]]:
    """Return mean ± two standard deviations of one coordinate over time."""
    shown = thinned(path)
    middle = 1000.0 * path.points[shown, k]
    width = TUBE * 1000.0 * np.sqrt(np.maximum(path.covariances[shown, k, k], 0.0))
    times = path.times[shown]
    upper, lower = np.stack([times, middle + width], axis=1), np.stack([times, middle - width], axis=1)
    return [np.round(np.concatenate([upper, lower[::-1]]), 3).tolist()]

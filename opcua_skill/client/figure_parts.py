"""What the pictures have in common: units, plain frames, ellipses, normals, the file."""

from pathlib import Path as FilePath

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from models.demonstration import Floats

GREY, BLUE, ORANGE, GREEN, RED = "#9a9a9a", "#1f5fa8", "#d97b1c", "#2e7d4f", "#b3261e"
SIGMAS = 2.0


def ellipse(mean: Floats, covariance: Floats) -> Ellipse:
    """Return the ellipse of two standard deviations of a normal distribution in the plane."""
    values, vectors = np.linalg.eigh(covariance)
    width, height = 2 * SIGMAS * np.sqrt(np.maximum(values[::-1], 0.0))
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    return Ellipse(
        (float(mean[0]), float(mean[1])),
        width,
        height,
        angle=float(angle),
        facecolor=ORANGE,
        edgecolor=ORANGE,
        alpha=0.35,
    )


def normals_along(points: Floats) -> Floats:
    """Return unit normals (n, 2) of a path in the plane; zero where it stands still."""
    tangents = np.gradient(points, axis=0)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)


def lengths_along(points: Floats) -> Floats:
    """Return the length from the start to each point of a path (n, d): (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def mm(metres: Floats) -> Floats:
    """Return metres as millimetres."""
    return np.asarray(metres, dtype=np.float64) * 1000.0


def plate(axes: Axes, title: str) -> None:
    """Give a plot of the plate its title and equal axes."""
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal", adjustable="box")
    plain_frame(axes)


def plain_frame(axes: Axes) -> None:
    """Leave out what carries no information."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)


def save(figure: Figure, file: FilePath) -> None:
    """Write a figure as PNG, without a display and without the time of day in it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(str(file), metadata={"Software": "opcua-skill"})

"""Pictures from what any client can get over OPC UA: the paper's Figure 3, and commanded against measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from models.demonstration import Bools, Floats
from opcua_skill.client import JobTrace, Path, Recordings, Skill, SkillClient

GREY, BLUE, ORANGE, GREEN = "#9a9a9a", "#1f5fa8", "#d97b1c", "#2e7d4f"
SIGMAS = 2.0
WORK_HEIGHT = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What is drawn of one version: where it comes from, its model, and its path as learned."""

    title: str
    skill: Skill
    recordings: Recordings
    path: Path


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What is drawn of one run: a title, and its trace."""

    title: str
    trace: JobTrace


async def view_of(client: SkillClient, skill_name: str, version: int = 0, title: str = "") -> View:
    """Ask a server for all that the picture of a version needs."""
    skill = await client.skill(skill_name, version)
    return View(
        title=title or f"{skill.name} version {skill.version}",
        skill=skill,
        recordings=await client.recordings(skill_name, skill.version),
        path=await client.path(skill_name, skill.version),
    )


def learning_figure(views: Sequence[View], file: FilePath) -> None:
    """Draw the paper's Figure 3, a row a version: aligned demonstrations; components and regression; path alone."""
    figure = Figure(figsize=(12.6, 0.2 + (0.65 + 3.55 * tallness(views)) * len(views)), layout="constrained")
    grid: Any = figure.subplots(len(views), 3, squeeze=False, sharex=True, sharey=True)
    for row, view in zip(grid, views, strict=True):
        draw_aligned(row[0], view)
        draw_model(row[1], view)
        draw_path(row[2], view)
        row[0].set_ylabel(f"{view.title}\n\ny, mm", fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("x, mm")
    save(figure, file)


def tallness(views: Sequence[View]) -> float:
    """Return height over width of what is drawn, with room for the components around it, within what reads well."""
    shown = [one.points[:, :2] for view in views for one in view.recordings.aligned]
    points = mm(np.vstack([*shown, *(view.path.points[:, :2] for view in views)]))
    width, height = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)
    return float(np.clip((height + 20.0) / (width + 20.0), 0.4, 1.6))


def draw_aligned(axes: Axes, view: View) -> None:
    """Draw the aligned demonstrations and their mean."""
    aligned = [mm(one.points) for one in view.recordings.aligned]
    for points in aligned:
        axes.plot(points[:, 0], points[:, 1], color=GREY, linewidth=0.9, alpha=0.8)
    if aligned:
        together = np.stack(aligned)
        known = ~np.isnan(together).all(axis=(0, 2))
        mean = np.nanmean(together[:, known], axis=0)
        axes.plot(mean[:, 0], mean[:, 1], color=BLUE, linewidth=1.6)
    plate(axes, f"{len(aligned)} aligned demonstrations and their mean")


def draw_model(axes: Axes, view: View) -> None:
    """Draw the components as ellipses of two standard deviations, and the regression with a tube as wide."""
    points = mm(view.path.points)
    normals = normals_along(points[:, :2])
    across = np.einsum("ni,nij,nj->n", normals, view.path.covariances[:, :2, :2], normals)
    sideways = normals * SIGMAS * mm(np.sqrt(np.maximum(across, 0.0)))[:, None]
    tube = np.vstack([points[:, :2] + sideways, (points[:, :2] - sideways)[::-1]])
    axes.fill(tube[:, 0], tube[:, 1], color=BLUE, alpha=0.12, linewidth=0)
    for mean, covariance in components(view.skill):
        axes.add_patch(ellipse(mean, covariance))
        axes.plot(*mean, marker="+", color=ORANGE, markersize=7)
    axes.plot(points[:, 0], points[:, 1], color=BLUE, linewidth=1.6)
    plate(axes, f"{len(view.skill.means)} components and their regression, {SIGMAS:g} σ")


def draw_path(axes: Axes, view: View) -> None:
    """Draw the path alone: full where the process is on, thin where it is off; a ring where it starts."""
    points = mm(view.path.points)
    axes.plot(points[:, 0], points[:, 1], color=GREY, linewidth=0.8)
    segments = np.stack([points[:-1, :2], points[1:, :2]], axis=1)
    on = view.path.dispense[:-1] & view.path.dispense[1:]
    axes.add_collection(LineCollection(list(segments[on]), colors=BLUE, linewidths=2.2, capstyle="round"))
    axes.plot(*points[0, :2], marker="o", color=GREEN, markerfacecolor="none", markersize=8)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    plate(axes, f"the path: {length:.0f} mm in {view.path.times[-1]:.1f} s")


def runs_figure(runs: Sequence[Run], file: FilePath) -> None:
    """Draw commanded against measured, a column a run: the path from above, and how far they are apart over time."""
    figure = Figure(figsize=(12.6, 7.2), layout="constrained")
    grid: Any = figure.subplots(2, len(runs), squeeze=False, gridspec_kw={"height_ratios": [2.4, 1]})
    for above, below, run in zip(grid[0], grid[1], runs, strict=True):
        commanded, measured = mm(run.trace.commanded), mm(run.trace.measured)
        working = at_work(commanded)
        above.plot(
            *hidden(commanded, ~working), color=GREY, linewidth=0.8, linestyle="--", label="travel, above the part"
        )
        above.plot(*hidden(commanded, working), color=ORANGE, linewidth=3.2, alpha=0.55, label="commanded")
        above.plot(*hidden(measured, working), color=BLUE, linewidth=1.0, label="measured")
        above.set(title=run.title, xlabel="x in the arm's base, mm", ylabel="y, mm")
        above.set_aspect("equal", adjustable="datalim")
        above.legend(loc="best", frameon=False)
        apart = np.linalg.norm(commanded - measured, axis=1)
        below.plot(run.trace.times, apart, color=BLUE, linewidth=0.9)
        below.set(xlabel="time, s", ylabel="apart, mm", ylim=(0, max(1.15 * float(apart.max()), 1e-6)))
        rms = float(np.sqrt(np.mean(apart**2)))
        below.set_title(f"RMS {rms:.4f} mm, maximum {apart.max():.4f} mm (simulated arm)", fontsize=9)
        for axes in (above, below):
            plain_frame(axes)
    save(figure, file)


def at_work(points: Floats) -> Bools:
    """Return which samples (n,) of a tool path in mm lie at the height of the work, the lowest there is."""
    return points[:, 2] <= points[:, 2].min() + WORK_HEIGHT


def hidden(points: Floats, shown: Bools) -> tuple[Floats, Floats]:
    """Return x and y (n,), NaN where a sample is not to be drawn."""
    x, y = np.where(shown[:, None], points[:, :2], np.nan).T
    return x, y


def components(skill: Skill) -> list[tuple[Floats, Floats]]:
    """Return mean (2,) in mm and covariance (2, 2) in mm² of each component over the first two position values."""
    first = 2 if skill.document.get("clock") == "path" else 1
    block = slice(first, first + 2)
    return [
        (mm(mean[block]), mm(mm(covariance[block, block])))
        for mean, covariance in zip(skill.means, skill.covariances, strict=True)
    ]


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

"""Pictures from what any client can get over OPC UA: the paper's Figure 3, and commanded against measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from models.demonstration import Bools, Floats
from opcua_skill.client import JobTrace, Path, Recordings, Refused, Skill, SkillClient
from opcua_skill.client.figure_parts import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SIGMAS,
    ellipse,
    lengths_along,
    mm,
    normals_along,
    plain_frame,
    plate,
    save,
)

WORK_HEIGHT = 0.5
TOOLS_SHOWN = 24
WORTH_MARKING = 0.1
OUTERMOST = 1.0
TURNS = (("roll", BLUE, "-"), ("pitch", ORANGE, "--"), ("yaw", GREEN, ":"))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What is drawn of one version: where it comes from, its model, its path as learned.

    ``before`` is the path of the version it was compared with at learning, if that can be had.
    """

    title: str
    skill: Skill
    recordings: Recordings
    path: Path
    before: Path | None = None

    @property
    def verdicts(self) -> Mapping[str, str]:
        """What became of each demonstration, by its id."""
        return {one["demonstrationId"]: one["kind"] for one in self.skill.document.get("verdicts") or ()}

    @property
    def has_orientation(self) -> bool:
        """Whether the tool's orientation was learned."""
        clock = 2 if self.skill.document.get("clock") == "path" else 1
        return self.skill.means.shape[1] == clock + self.path.points.shape[1] + 4

    def orientations(self) -> Floats:
        """Return the tool's unit quaternions (n, 4) at the samples of the path."""
        motion = self.skill.motion()
        return motion.orientations_at(motion.phases_at(self.path.times))


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
        before=await _path_before(client, skill),
    )


async def _path_before(client: SkillClient, skill: Skill) -> Path | None:
    """Return the path of the version that the report compares with; one imported from elsewhere may not be here."""
    told = skill.report.get("previous") or {}
    if "distance" not in told or skill.document["provenance"].get("importedBy"):
        return None
    try:
        return await client.path(skill.name, int(told["version"]))
    except Refused as refusal:
        if refusal.status != "BadNotFound":
            raise
        return None


def learning_figure(views: Sequence[View], file: FilePath) -> None:
    """Draw the paper's Figure 3, a row a version: aligned demonstrations; components and regression; path alone.

    Where height or the tool's orientation was learned, a fourth column shows them along the path.
    """
    along = any(view.path.points.shape[1] == 3 or view.has_orientation for view in views)
    columns = 4 if along else 3
    row_height = max(0.85 + 3.55 * tallness(views), 4.6 if along else 0.0)
    figure = Figure(figsize=(4.2 * columns, 0.2 + row_height * len(views)), layout="constrained")
    rows: Any = np.atleast_1d(np.asarray(figure.subfigures(len(views), 1), dtype=object))
    low, high = limits(views)
    for row, view in zip(rows, views, strict=True):
        cells: Any = row.add_gridspec(1, columns)
        plates = [row.add_subplot(cells[0, column]) for column in range(3)]
        for axes, draw in zip(plates, (draw_aligned, draw_model, draw_path), strict=True):
            draw(axes, view)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, mm")
        plates[0].set_ylabel("y, mm")
        row.suptitle(heading(view), fontsize=10, x=0.01, ha="left")
        drawn = [draw_height] if view.path.points.shape[1] == 3 else []
        drawn += [draw_orientation] if view.has_orientation else []
        beside: Any = cells[0, 3].subgridspec(len(drawn), 1) if drawn else ()
        for cell, draw in zip(beside, drawn, strict=True):
            draw(row.add_subplot(cell), view)
    save(figure, file)


def heading(view: View) -> str:
    """Return what has to stand above a picture that somebody signs: which model, its state, its quality."""
    skill, report = view.skill, view.skill.report
    words = [f"{view.title}  ·  {skill.state}  ·  digest {skill.model_digest.hex()[:16]}"]
    error, ends = report.get("path_error"), report.get("end_error")
    quality: list[str] = []
    if error:
        quality.append(f"path error {1e3 * error['rms']:.2f} mm RMS, {1e3 * error['max']:.2f} mm at most")
    if ends:
        quality.append(f"ends {1e3 * ends['start']:.2f} and {1e3 * ends['end']:.2f} mm")
    paper = report.get("paper") or {}
    if "path_error" in paper:
        theirs, off = paper["path_error"], paper["end_error"]
        quality.append(
            f"the paper's preset, estimated: {1e3 * theirs['rms']:.2f} and {1e3 * theirs['max']:.2f} mm, "
            f"ends {1e3 * off['start']:.1f} and {1e3 * off['end']:.1f} mm"
        )
    return "\n".join([*words, "  ·  ".join(quality)] if quality else words)


def limits(views: Sequence[View]) -> tuple[Floats, Floats]:
    """Return the lower and upper corner (2,) in mm of what all views show, with room for the components around it.

    Every path is shown whole; of the demonstrations all but the outermost per cent, so that reflections stay outside.
    """
    paths = mm(np.vstack([view.path.points[:, :2] for view in views]))
    corners = [paths]
    shown = [one.points[:, :2] for view in views for one in view.recordings.aligned]
    if shown:
        corners.append(np.nanpercentile(mm(np.vstack(shown)), (OUTERMOST, 100.0 - OUTERMOST), axis=0))
    points = np.vstack(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.06 * float(np.linalg.norm(high - low))
    return low - room, high + room


def tallness(views: Sequence[View]) -> float:
    """Return height over width of what is drawn, within what reads well."""
    low, high = limits(views)
    width, height = high - low
    return float(np.clip(height / max(float(width), 1e-9), 0.4, 1.6))


def draw_aligned(axes: Axes, view: View) -> None:
    """Draw the aligned demonstrations and their mean, and those left out as they were recorded."""
    aligned = [mm(one.points) for one in view.recordings.aligned]
    for points in aligned:
        axes.plot(points[:, 0], points[:, 1], color=GREY, linewidth=0.9, alpha=0.8)
    verdicts = view.verdicts
    out = [mm(one.points) for one in view.recordings.raw if verdicts.get(one.demonstration_id) == "left out"]
    for points in out:
        axes.plot(points[:, 0], points[:, 1], color=ORANGE, linewidth=0.8, alpha=0.9)
    if aligned:
        together = np.stack(aligned)
        known = ~np.isnan(together).all(axis=(0, 2))
        mean = np.nanmean(together[:, known], axis=0)
        axes.plot(mean[:, 0], mean[:, 1], color=BLUE, linewidth=1.6)
    title = f"{len(aligned)} aligned demonstrations and their mean"
    plate(axes, f"{title}; {len(out)} left out" if out else title)


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
    """Draw the path alone: full where the process is on, thin where it is off; ring at its start, square at its end.

    The version before is dashed, with a ring where the two are furthest apart.
    """
    points = mm(view.path.points)
    if view.before is not None:
        old = mm(view.before.points)
        axes.plot(old[:, 0], old[:, 1], color=ORANGE, linewidth=1.1, linestyle="--", zorder=3)
    axes.plot(points[:, 0], points[:, 1], color=GREY, linewidth=0.8)
    segments = np.stack([points[:-1, :2], points[1:, :2]], axis=1)
    on = view.path.dispense[:-1] & view.path.dispense[1:]
    axes.add_collection(LineCollection(list(segments[on]), colors=BLUE, linewidths=2.2, capstyle="round"))
    axes.plot(*points[0, :2], marker="o", color=GREEN, markerfacecolor="none", markersize=8)
    axes.plot(*points[-1, :2], marker="s", color=GREEN, markerfacecolor="none", markersize=7)
    title = f"the path: {lengths_along(points)[-1]:.0f} mm in {view.path.times[-1]:.1f} s"
    if view.has_orientation:
        draw_tool(axes, view)
        title += ", how the tool leans (red)"
    told = view.skill.report.get("previous") or {}
    if view.before is not None and "distance" in told:
        apart = 1e3 * told["distance"]["max"]
        title += f"\nup to {apart:.2f} mm from version {told['version']} (dashed)"
        if apart > WORTH_MARKING:
            place = mm(np.array(told["distance"]["point"][:2]))
            axes.plot(*place, marker="o", color=RED, markerfacecolor="none", markersize=12, zorder=4)
    plate(axes, title)


def draw_tool(axes: Axes, view: View) -> None:
    """Draw, at even places, how the tool leans seen from above: its z axis, a quarter of the picture if flat."""
    points = mm(view.path.points[:, :2])
    along = lengths_along(points)
    chosen = np.searchsorted(along, np.linspace(0.0, along[-1], TOOLS_SHOWN)).clip(0, len(points) - 1)
    lean = Rotation.from_quat(view.orientations()[chosen]).apply([0.0, 0.0, 1.0])[:, :2]
    reach = 0.25 * float(np.linalg.norm(np.ptp(points, axis=0)))
    tips = points[chosen] + reach * lean
    axes.add_collection(LineCollection(list(np.stack([points[chosen], tips], axis=1)), colors=RED, linewidths=1.2))


def draw_height(axes: Axes, view: View) -> None:
    """Draw the height along the path: demonstrations, regression, tube."""
    points = mm(view.path.points)
    along = lengths_along(points)
    for one in view.recordings.aligned:
        where = np.interp(one.times / max(float(one.times[-1]), 1e-9), view.path.times / view.path.times[-1], along)
        axes.plot(where, mm(one.points[:, 2]), color=GREY, linewidth=0.8, alpha=0.8)
    wide = SIGMAS * mm(np.sqrt(np.maximum(view.path.covariances[:, 2, 2], 0.0)))
    axes.fill_between(along, points[:, 2] - wide, points[:, 2] + wide, color=BLUE, alpha=0.12, linewidth=0)
    axes.plot(along, points[:, 2], color=BLUE, linewidth=1.6)
    axes.set_title("height", fontsize=10)
    axes.set(xlabel="along the path, mm", ylabel="z, mm")
    plain_frame(axes)


def draw_orientation(axes: Axes, view: View) -> None:
    """Draw roll, pitch and yaw of the tool in the part's frame along the path."""
    along = lengths_along(mm(view.path.points))
    angles = np.degrees(np.unwrap(Rotation.from_quat(view.orientations()).as_euler("xyz"), axis=0))
    for (name, colour, style), values in zip(TURNS, angles.T, strict=True):
        axes.plot(along, values, color=colour, linestyle=style, linewidth=1.4, label=name)
    axes.legend(loc="best", frameon=False, fontsize=8)
    axes.set_title("tool orientation in the part's frame", fontsize=10)
    axes.set(xlabel="along the path, mm", ylabel="degrees")
    plain_frame(axes)


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

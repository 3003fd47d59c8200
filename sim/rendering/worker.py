"""Draws pictures of plans in a process of its own: ``python -m sim.rendering.worker REQUEST RESULT``, two files."""

import io
import math
import pickle
import sys
import textwrap
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image
from scipy.spatial.transform import Rotation

from sim.arm_model import ArmModel, Floats
from sim.drivers.pybullet.suppress_output import silent
from sim.plan import MotionPlan
from sim.planning.clearance import PART_BORDER
from sim.rendering.scene import Line, Scene, at_work, from_nearby, path_lines, png, show_rows, webp, whole_arm

VIEW, CARD_HEIGHT = (760, 760), 760
FRAME = (440, 360)
FILM_MILLISECONDS = 4800
NOTE_WIDTH = 76


def still(model: ArmModel, plan: MotionPlan, view: str) -> bytes:
    """Return the arm in the middle of the path as PNG."""
    return png(_still(model, plan, view, VIEW))


def card(model: ArmModel, plan: MotionPlan) -> bytes:
    """Return the operator card: what runs, where, how fast, with the valve, and the arm that does it."""
    pictures = [_still(model, plan, view, VIEW) for view in ("arm", "work")]
    drawing = Image.open(io.BytesIO(_top_view(model, plan))).convert("RGB")
    drawing = drawing.resize(
        (round(drawing.width * CARD_HEIGHT / drawing.height), CARD_HEIGHT), Image.Resampling.LANCZOS
    )
    pictures.append(drawing)
    whole = Image.new("RGB", (sum(picture.width for picture in pictures) + 16, CARD_HEIGHT), "white")
    left = 0
    for picture in pictures:
        whole.paste(picture, (left, 0))
        left += picture.width + 8
    return png(whole)


def animation(model: ArmModel, plan: MotionPlan, frames: int) -> bytes:
    """Return the whole run, from home to home, as a short animated WebP."""
    scene = Scene(model, plan)
    try:
        images = []
        for row in show_rows(plan, frames):
            scene.place(plan.joints[row])
            images.append(scene.take(from_nearby(scene.part), FRAME, path_lines(plan, row, 1.6)))
        return webp(images, FILM_MILLISECONDS // frames)
    finally:
        scene.close()


def _still(model: ArmModel, plan: MotionPlan, view: str, size: tuple[int, int]) -> Image.Image:
    scene = Scene(model, plan)
    try:
        row = round(0.42 * plan.path_rows[0] + 0.58 * plan.path_rows[1])
        scene.place(plan.joints[row])
        camera = whole_arm(scene.part) if view == "arm" else at_work(scene.part)
        rows = np.unique(np.linspace(*plan.path_rows, 60).astype(int))
        camera = scene.with_a_view(camera, plan.tool[np.append(rows, [row] * 20)])
        lines: list[Line] = path_lines(plan, row, 1.2 if view == "arm" else 3.0)
        return scene.take(camera, size, lines)
    finally:
        scene.close()


def _top_view(model: ArmModel, plan: MotionPlan) -> bytes:
    """Return the path from above, to scale in mm in the part's frame, coloured by nozzle speed, valve marked."""
    matplotlib.use("Agg")
    frame = plan.order.frame
    first, last = plan.path_rows
    local = Rotation.from_quat(frame[3:]).inv().apply(plan.tool[first : last + 1] - np.array(frame[:3])) * 1e3
    valve = plan.dispense[first : last + 1]
    speed = np.sqrt((np.diff(local, axis=0) ** 2).sum(axis=1)) / plan.order.time_step
    figure = Figure(figsize=(6.4, 7.6), dpi=200, layout="constrained")
    axes = figure.subplots()
    low, high, look = plate_of(plan, local)
    axes.add_patch(Rectangle(tuple(low), *(high - low), lw=1.0, **look))
    low, high = np.minimum(low, local[:, :2].min(axis=0)), np.maximum(high, local[:, :2].max(axis=0))
    pieces = np.stack([local[:-1, :2], local[1:, :2]], axis=1)
    wet = LineCollection(list(pieces[valve[:-1]]), cmap="viridis", linewidths=4.0, capstyle="round", zorder=2)
    wet.set_array(speed[valve[:-1]])
    wet.set_clim(0.0, max(1.0, float(speed.max()) * 1.08))
    axes.add_collection(wet)
    dry = LineCollection(list(pieces[~valve[:-1]]), colors="#8a929c", linewidths=1.2, linestyles=":", zorder=2)
    axes.add_collection(dry)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], valve, [False]]).astype(int)))
    for at, colour, marker, label in (
        (np.clip(edges[::2], 0, len(local) - 1), "#1a7f37", "^", "valve opens"),
        (np.clip(edges[1::2], 0, len(local) - 1), "#cf222e", "s", "valve closes"),
    ):
        axes.scatter(local[at, 0], local[at, 1], s=110, c=colour, marker=marker, zorder=4, label=label, linewidths=0)
    axes.set_aspect("equal")
    margin = 6
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_xlabel("x in mm, part's frame")
    axes.set_ylabel("y in mm")
    report, order = plan.report, plan.order
    title = plan.recipe_id or "run without a recipe"
    told = [line for finding in plan.findings for line in textwrap.wrap(finding.text, NOTE_WIDTH)]
    held = f", nozzle tilted up to {math.degrees(report['tilt_max']):.0f} degrees" if "tilt_max" in report else ""
    maker = "" if model.model.startswith(model.manufacturer.split()[0]) else f"{model.manufacturer} "
    facts = (
        f"{report['length'] * 1e3:.0f} mm in {report['path_duration']:.1f} s, {order.timing.replace('_', ' ')}, "
        f"{plan.samples} steps of {order.time_step * 1e3:g} ms\n"
        f"nozzle {report['speed_min'] * 1e3:.0f} to {report['speed_max'] * 1e3:.0f} mm/s, path kept to "
        f"{plan.path_error[1] * 1e3:.3f} mm, nearest obstacle {report['smallest_clearance'] * 1e3:.0f} mm\n"
        f"{maker}{model.model}{held}, plan {plan.digest[:16]}"
    )
    lift = 14 + 13 * len(told)
    axes.set_title(title, fontsize=13, fontweight="bold", loc="left", pad=38 + lift)
    below_title = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom", "in_layout": False}
    axes.annotate(facts, (0.0, 1.0), (0, lift - 6), fontsize=9, color="#30363d", **below_title)
    if told:
        axes.annotate("\n".join(told), (0.0, 1.0), (0, 5), fontsize=9, color="#9a3b00", **below_title)
    figure.colorbar(wet, ax=axes, label="nozzle speed in mm/s", fraction=0.05, pad=0.03)
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.08)  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue, reportCallIssue]
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncol=2, frameon=False)
    axes.grid(color="#d0d7de", lw=0.5, zorder=0)
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def plate_of(plan: MotionPlan, local: Floats) -> tuple[Floats, Floats, dict[str, str]]:
    """Return two corners of the part in mm in its frame, and its look: dashed where the recipe does not say."""
    plate = plan.order.plate
    if plate is None:
        low, high = local[:, :2].min(axis=0) - 1e3 * PART_BORDER, local[:, :2].max(axis=0) + 1e3 * PART_BORDER
        return low, high, {"facecolor": "none", "edgecolor": "#5b6b7b", "linestyle": ":"}
    corner, size = 1e3 * np.array(plate[:2]), 1e3 * np.array(plate[2:])
    return corner, corner + size, {"facecolor": "#eef4fb", "edgecolor": "#30363d", "linestyle": "-"}


DRAWINGS = {"still": still, "card": card, "animation": animation}


def main() -> None:
    """Read a pickled request (drawing, arguments), write the picture."""
    request, result = (Path(name) for name in sys.argv[1:3])
    drawing, arguments = pickle.loads(request.read_bytes())
    with silent():
        picture = DRAWINGS[drawing](*arguments)
    result.write_bytes(picture)


if __name__ == "__main__":
    main()

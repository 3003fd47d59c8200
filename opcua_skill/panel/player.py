"""The player: a run's commanded and measured path, played in the browser, and the arm's way while it moves."""

from pathlib import Path as FilePath

import numpy as np
from nicegui.element import Element
from nicegui.elements.echart import EChart

from models.demonstration import Floats
from opcua_skill.client import ArmLinks, JobTrace, JointTrace, Path, Recipe
from opcua_skill.panel.chart import packed
from opcua_skill.panel.words import Words

SHOWN_SAMPLES = 1500
LONGER, STANDS = 3.0, 1e-6
STATIC = FilePath(__file__).parent / "static"
ECHARTS = EChart  # importing it puts its bundle on the page, which the component below draws with


class Player(Element, component=STATIC / "player.js", esm={"panel-links": str(STATIC / "links")}):
    """The player in the browser."""

    def __init__(self, words: Words, height: str) -> None:
        super().__init__()
        self._props["labels"] = {
            "time": words("time"),
            "speed": words("speed of the animation"),
            "away": words("off what was commanded by"),
            "error": words("error (mm)"),
            "play": words("▶ Play the replay"),
            "hold": words("Hold the replay"),
            "replay": words("REPLAY"),
            "end": words("End the replay"),
            "chart": words("Path of the nozzle"),
            "turn": words("Drag to turn, wheel or two fingers to zoom. The links are drawn as the checks see them."),
            "comma": words.figures("0.5")[1],
            "arm": words("Whole arm"),
            "near": words("Path only"),
            "paused": words("paused"),
        }
        self._props["height"] = height

    def arm(self, links: ArmLinks) -> None:
        """Say of which links the arm is made, so that it is drawn wherever its joints are known."""
        origins, capsules = links.origins.copy(), links.capsules.copy()
        origins[:, :3] *= 1000.0
        capsules[:, 1:] *= 1000.0
        told = {
            "origins": origins.round(6).tolist(),
            "axes": links.axes.tolist(),
            "capsules": capsules.round(3).tolist(),
        }
        self.run_method("arm", told)

    def pose(self, joints: Floats) -> None:
        """Show the arm as it is now: its joints in rad."""
        self.run_method("pose", np.round(joints, 5).tolist())

    def load(self, job_id: str, trace: JobTrace, joints: JointTrace, *, title: str, measured: str) -> None:
        """Show a run that has ended, under its ``title``; it waits until somebody plays it.

        Without joints the arm is not drawn; ``measured`` says what its numbers are: measured, or simulated.
        """
        stood = pauses(trace)
        shown = sorted({*spread(len(trace.times)), *stood, *(row + 1 for row in stood)})
        self.run_method(
            "load",
            {
                "job": job_id,
                "title": title,
                "measured_word": measured,
                "pauses": [np.round(trace.times[row : row + 2], 4).tolist() for row in stood],
                "times": np.round(trace.times[shown], 4).tolist(),
                "commanded": np.round(1000.0 * trace.commanded[shown, :3], 3).tolist(),
                "measured": np.round(1000.0 * trace.measured[shown, :3], 3).tolist(),
                "joints": packed(joints.measured[shown]) if joints.measured.size else "",
            },
        )

    def plan(self, points: Floats) -> None:
        """Show where the nozzle is to go: points (n, 3) in m in the arm's base."""
        self.run_method("plan", np.round(1000.0 * points[spread(len(points))], 2).tolist())

    def view(self, name: str) -> None:
        """Show the run from above and the side (``paths``), in space (``space``), or over time (``time``)."""
        self.run_method("look", name)

    def begin(self) -> None:
        """Make room for a run that starts."""
        self.run_method("begin")

    def live(self, point: Floats) -> None:
        """Show where the nozzle is now: x y z in m."""
        self.run_method("live", np.round(1000.0 * point, 2).tolist())


def spread(count: int) -> list[int]:
    """Return which of ``count`` samples are shown: the first, the last, and evenly between."""
    return np.unique(np.linspace(0, count - 1, min(count, SHOWN_SAMPLES)).round().astype(int)).tolist() if count else []


def pauses(trace: JobTrace) -> list[int]:
    """Return after which rows a run stood still: the next row is later than any step, and at the same place."""
    if len(trace.times) < 3:
        return []
    steps = np.diff(trace.times)
    moved = np.sqrt((np.diff(trace.commanded[:, :3], axis=0) ** 2).sum(axis=1))
    return np.flatnonzero((steps > LONGER * np.median(steps)) & (moved < STANDS)).tolist()


def in_base(path: Path, recipe: Recipe) -> Floats:
    """Return a path in the part's frame as points (n, 3) in the arm's base, the standoff above the part."""
    x, y, z, w = recipe.frame[3:]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    points = np.zeros((len(path.times), 3))
    points[:, : path.points.shape[1]] = path.points
    points[:, 2] += recipe.standoff
    return points @ turn.T + np.array(recipe.frame[:3])


def trace_csv(trace: JobTrace) -> str:
    """Return a run's record as CSV: times in s, nozzle tip commanded and measured in m, and how far apart in m."""
    names = [f"{kind}_{axis}_m" for kind in ("commanded", "measured") for axis in "xyz"]
    commanded, measured = trace.commanded[:, :3], trace.measured[:, :3]
    away = np.sqrt(((measured - commanded) ** 2).sum(axis=1))
    rows = np.column_stack([trace.times, commanded, measured, away])
    head = ",".join(["time_s", *names, "error_m"])
    return "\n".join([head, *(",".join(f"{value:.9g}" for value in row) for row in rows.tolist())]) + "\n"

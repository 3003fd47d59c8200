"""What the learned paths look like: demonstrations in grey, the path in blue, as an operator would judge them."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from models.demonstration import Demonstration
from models.learning import LearnedMotion, VerdictKind

GREY, ODD, BLUE, MEAN = "0.75", "tab:orange", "tab:blue", "k"


def sheet(
    path: Path,
    learned: Mapping[str, LearnedMotion],
    demonstrations: Mapping[str, list[Demonstration]],
    columns: int = 4,
) -> None:
    """Draw one picture a shape into ``path``: demonstrations grey, those left out orange, component means as
    crosses.
    """
    rows = -(-len(learned) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(4.6 * columns, 4.2 * rows), squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (name, motion) in zip(axes.flat, learned.items(), strict=False):
        left_out = {one.demonstration_id for one in motion.verdicts if one.kind == VerdictKind.LEFT_OUT}
        for one in demonstrations[name]:
            colour = ODD if one.demonstration_id in left_out else GREY
            axis.plot(*(1e3 * one.points[:, :2].T), color=colour, linewidth=0.7)
        points = motion.motion.points_at(np.linspace(0.0, 1.0, 2000))
        axis.plot(*(1e3 * points[:, :2].T), color=BLUE, linewidth=2.0)
        first = 2 if motion.motion.clock == "path" else 1
        axis.plot(*(1e3 * motion.motion.means[:, first : first + 2].T), "+", color=MEAN, markersize=5)
        report = motion.report
        axis.set_title(
            f"{name}: K = {report.components}, {report.path_error['rms'] * 1e3:.2f} mm from the mean, "
            f"LDLJ {report.smoothness:.1f}",
            fontsize=9,
        )
        axis.set_aspect("equal")
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=70)
    plt.close(figure)

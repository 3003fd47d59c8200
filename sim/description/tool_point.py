"""Where a tool's tip is, measured: the tip is held on one point while the flange is turned around it."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sim.arm_model import Floats
from sim.description.findings import DescriptionError

FEWEST = 4
# In rad: poses turned less than that from each other say nothing of the tip.
LEAST_TURN = math.radians(15.0)
# The smallest share of its largest singular value that the equations may have.
LEAST_SHARE = 0.02


class PosesRefused(DescriptionError):
    """Poses from which no tip can be worked out: one sentence with the way out."""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPoint:
    """The tip in the flange's frame, ``offset`` (3,) m, and the point it was held on in the base, ``point`` (3,) m.

    ``residuals`` (n,) m: how far each pose's tip is from that point. ``uncertainty`` (3,) m: standard error of the
    offset along the flange's axes; NaN for too few poses to tell.
    """

    offset: Floats
    point: Floats
    residuals: Floats
    uncertainty: Floats

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, m."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def tool_point(positions: Floats, rotations: Floats) -> ToolPoint:
    """Return the tip from flange positions (n, 3) and rotations (n, 3, 3) in the base, n at least 4: least squares.

    Raises ``PosesRefused`` where the poses do not tell: too few, or turned about one axis only.
    """
    count = len(positions)
    if count < FEWEST:
        raise PosesRefused(f"{count} poses are too few: hold the tip on one point in at least {FEWEST}")
    between = Rotation.from_matrix(rotations[0].T @ rotations).magnitude()
    if between.max() < LEAST_TURN:
        raise PosesRefused(
            f"the poses are turned by {math.degrees(between.max()):.1f} degrees at most: turn the flange by "
            f"{math.degrees(LEAST_TURN):.0f} or more between them, about different axes"
        )
    equations = np.zeros((3 * count, 6))
    equations[:, :3] = rotations.reshape(-1, 3)
    equations[:, 3:] = -np.tile(np.eye(3), (count, 1))
    values = np.linalg.svd(equations, compute_uv=False)
    if values[-1] < LEAST_SHARE * values[0]:
        raise PosesRefused(
            "the poses are turned about one axis only, which leaves the tip's place along it open: turn the flange "
            "about another axis too"
        )
    solved = np.asarray(np.linalg.lstsq(equations, -positions.reshape(-1), rcond=None)[0], dtype=np.float64)
    away = (equations @ solved + positions.reshape(-1)).reshape(-1, 3)
    spare = 3 * count - 6
    variance = float((away**2).sum()) / spare
    error = np.sqrt(np.diag(np.linalg.inv(equations.T @ equations))[:3] * variance)
    return ToolPoint(solved[:3], solved[3:], np.sqrt((away**2).sum(axis=1)), error)

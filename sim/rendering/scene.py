"""What a picture of an arm at work is made of: the arm, its table and part, and the path drawn where it really is.

Runs in a worker process only: rendering holds the interpreter's lock for a second and more. The path is projected
through the camera's own matrices and hidden where the depth buffer says something is in front of it: crisp at any
size.
"""

import io
import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pybullet
from PIL import Image, ImageDraw

from sim.arm_model import ArmModel, Bools, Floats
from sim.drivers.pybullet.world import load_arm
from sim.plan import MotionPlan
from sim.planning.clearance import Box, Cell, part_box

ON, OFF, AHEAD = (235, 110, 20), (110, 120, 135), (40, 90, 200)
FIELD_OF_VIEW = 32.0
NEAR, FAR = 0.05, 8.0
OVERSAMPLING = 2
ROUND, ROUGH, GOOD = (0.0, -76.0, 90.0, 180.0), (150, 150), 0.9
TABLE_COLOUR, PART_COLOUR, PLATE_COLOUR = (0.80, 0.77, 0.72, 1.0), (0.36, 0.40, 0.46, 1.0), (0.80, 0.88, 0.95, 1.0)
PLATE = 0.004


@dataclass(frozen=True, slots=True)
class Camera:
    """Where a picture is taken from: looking at ``target`` (m, base frame) from ``distance`` m, angles in degrees."""

    target: tuple[float, float, float]
    distance: float
    yaw: float
    pitch: float


def whole_arm(part: Box) -> Camera:
    """Return the view of arm and part together."""
    return Camera((0.55 * part.pose[0], 0.5 * part.pose[1], 0.30), 2.05, 48.0, -24.0)


def at_work(part: Box) -> Camera:
    """Return the view of the nozzle over the part."""
    x, y, z = part.pose[:3]
    return Camera((x, y, z + 0.5 * part.size[2] + 0.02), 0.46, 38.0, -34.0)


def from_nearby(part: Box) -> Camera:
    """Return the view that follows a whole run: the part, and the nozzle on its way to it."""
    x, y, z = part.pose[:3]
    return Camera((x - 0.03, y, z + 0.5 * part.size[2] + 0.07), 0.86, 40.0, -24.0)


class Scene:
    """One arm over one part in a world of its own, to take pictures of."""

    def __init__(self, model: ArmModel, plan: MotionPlan, cell: Cell | None = None) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        self._model = model
        self._arm = load_arm(model, self.client)
        count = pybullet.getNumJoints(self._arm, physicsClientId=self.client)
        kinds = [pybullet.getJointInfo(self._arm, index, physicsClientId=self.client)[2] for index in range(count)]
        self._joints = [index for index, kind in enumerate(kinds) if kind == pybullet.JOINT_REVOLUTE]
        first, last = plan.path_rows
        surroundings = cell or Cell()
        self.part = part_box(plan.tool[first : last + 1], plan.order.frame, surroundings.table_height, plan.order.plate)
        self._add(
            Box("table", (0.3, 0.0, surroundings.table_height - 0.02, 0, 0, 0, 1), (1.6, 1.4, 0.04)), TABLE_COLOUR
        )
        x, y, z, *_ = self.part.pose
        turn = plan.order.frame[3:]
        top = z + 0.5 * self.part.size[2]
        width, depth, height = self.part.size
        plinth = Box("plinth", (x, y, z - 0.5 * PLATE, *turn), (width + 0.06, depth + 0.06, height - PLATE))
        self._add(plinth, PART_COLOUR)
        self._add(Box("plate", (x, y, top - 0.5 * PLATE, *turn), (width, depth, PLATE)), PLATE_COLOUR)
        for fixture in surroundings.fixtures:
            self._add(fixture, (0.75, 0.25, 0.2, 1.0))

    def place(self, joints: Floats) -> None:
        """Put the arm somewhere."""
        for index, value in zip(self._joints, joints, strict=True):
            pybullet.resetJointState(self._arm, index, float(value), 0.0, physicsClientId=self.client)

    def take(self, camera: Camera, size: tuple[int, int], lines: list["Line"]) -> Image.Image:
        """Return a picture of ``size`` pixels with lines drawn into it where nothing hides them."""
        width, height = (OVERSAMPLING * side for side in size)
        view, lens = _matrices(camera, width / height)
        _, _, pixels, depth, _ = pybullet.getCameraImage(
            width, height, view, lens, lightDirection=(0.4, -0.6, 1.4), lightColor=(1.0, 1.0, 1.0), shadow=1,
            lightAmbientCoeff=0.62, lightDiffuseCoeff=0.45, lightSpecularCoeff=0.12,
            renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self.client,
        )  # fmt: skip
        colours = np.asarray(pixels, dtype=np.uint8).reshape(height, width, 4)[:, :, :3].copy()
        buffer = np.asarray(depth, dtype=float).reshape(height, width)
        empty = buffer >= 0.9999
        shade = np.linspace(252, 226, height)[:, None] * np.array([1.0, 1.0, 1.005])
        colours[empty] = np.clip(np.broadcast_to(shade[:, None], colours.shape), 0, 255).astype(np.uint8)[empty]
        image = Image.fromarray(colours)
        draw = ImageDraw.Draw(image)
        matrix = _projection(view, lens)
        for line in lines:
            line.draw(draw, matrix, buffer)
        return image.resize(size, Image.Resampling.LANCZOS)

    def with_a_view(self, camera: Camera, points: Floats) -> Camera:
        """Return the camera, or one from another side where far more of the points (n, 3) are not hidden."""
        around = [replace(camera, yaw=camera.yaw + turn) for turn in ROUND]
        seen = [self._share_seen(side, points) for side in around]
        return camera if seen[0] >= GOOD * max(seen) else around[seen.index(max(seen))]

    def _share_seen(self, camera: Camera, points: Floats) -> float:
        """Return the share of points (n, 3) that nothing hides."""
        view, lens = _matrices(camera, 1.0)
        *_, depth, _ = pybullet.getCameraImage(
            *ROUGH, view, lens, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self.client
        )
        line = Line(points, ON, 1.0)
        _, _, inside = line.on_screen(_projection(view, lens), np.asarray(depth, dtype=float).reshape(ROUGH))
        return float(inside.mean())

    def close(self) -> None:
        """Let go of the world."""
        pybullet.disconnect(physicsClientId=self.client)

    def _add(self, box: Box, colour: tuple[float, float, float, float]) -> None:
        half = [0.5 * side for side in box.size]
        shape = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=half, rgbaColor=colour, specularColor=(0, 0, 0), physicsClientId=self.client
        )
        pybullet.createMultiBody(0, -1, shape, box.pose[:3], box.pose[3:], physicsClientId=self.client)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line through points (n, 3) in the base frame, one colour, ``width`` in pixels of the finished picture."""

    points: Floats
    colour: tuple[int, int, int]
    width: float

    def draw(self, draw: ImageDraw.ImageDraw, matrix: Floats, depth: Floats) -> None:
        """Draw what is in front of everything else in the picture."""
        if len(self.points) < 2:
            return
        x, y, inside = self.on_screen(matrix, depth)
        thick = max(1, round(self.width * OVERSAMPLING))
        for start in range(len(x) - 1):
            if inside[start] and inside[start + 1]:
                draw.line((x[start], y[start], x[start + 1], y[start + 1]), fill=self.colour, width=thick)
                radius = 0.5 * thick
                draw.ellipse((x[start] - radius, y[start] - radius, x[start] + radius, y[start] + radius), self.colour)

    def on_screen(self, matrix: Floats, depth: Floats) -> tuple[Floats, Floats, Bools]:
        """Return pixels x and y (n,) of the points, and which of them are in the picture and not hidden."""
        height, width = depth.shape
        clip = np.column_stack([self.points, np.ones(len(self.points))]) @ matrix.T
        flat = clip[:, :3] / clip[:, 3:]
        x, y = (flat[:, 0] + 1.0) * 0.5 * width, (1.0 - flat[:, 1]) * 0.5 * height
        column, row = (np.clip(values, 0, side - 1).astype(int) for values, side in ((x, width), (y, height)))
        seen = depth[row, column]
        far = _metres(0.5 * (flat[:, 2] + 1.0)) <= _metres(seen) + 0.006
        return x, y, far & (x >= 0) & (x < width) & (y >= 0) & (y < height)


def _matrices(camera: Camera, aspect: float) -> tuple[list[float], list[float]]:
    """Return Bullet's view and projection of a camera."""
    view = pybullet.computeViewMatrixFromYawPitchRoll(camera.target, camera.distance, camera.yaw, camera.pitch, 0.0, 2)
    return view, pybullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, aspect, NEAR, FAR)


def _projection(view: list[float], lens: list[float]) -> Floats:
    """Return the matrix (4, 4) from points in the base frame to the picture."""
    return np.array(lens).reshape(4, 4).T @ np.array(view).reshape(4, 4).T


def path_lines(plan: MotionPlan, done: int, width: float) -> list[Line]:
    """Return the path up to row ``done`` in the valve's colours, the rest as what is still to come, lead-in thin."""
    first, last = plan.path_rows
    keep = max(1, (last - first) // 1200)
    lines = []
    for segment in plan.segments:
        if segment.stage in {"approach", "retract"}:
            lines.append(Line(plan.tool[segment.first : segment.last + 1 : 4], OFF, 0.5 * width))
    rows = np.unique(np.append(np.arange(first, last + 1, keep), [min(max(done, first), last), last]))
    lines.append(Line(plan.tool[rows[rows >= done]], AHEAD, width))
    lines.extend(
        Line(plan.tool[piece], ON if valve else OFF, width) for piece, valve in _runs(rows[rows <= done], plan.dispense)
    )
    return lines


def png(image: Image.Image) -> bytes:
    """Return a picture as PNG."""
    out = io.BytesIO()
    image.save(out, "PNG", optimize=True)
    return out.getvalue()


def webp(images: list[Image.Image], milliseconds: int) -> bytes:
    """Return pictures as one animated WebP that runs for ever."""
    out = io.BytesIO()
    images[0].save(
        out, "WEBP", save_all=True, append_images=images[1:], duration=milliseconds, loop=0, quality=72, method=4
    )
    return out.getvalue()


def _runs(rows: np.ndarray, valve: Bools) -> list[tuple[np.ndarray, bool]]:
    """Return the rows in pieces over which the valve stays as it is; neighbours share a row."""
    if len(rows) < 2:
        return []
    cuts = np.flatnonzero(np.diff(valve[rows].astype(int))) + 1
    edges = [0, *cuts.tolist(), len(rows) - 1]
    return [(rows[a : b + 1], bool(valve[rows[a]])) for a, b in pairwise(edges) if b > a]


def _metres(depth: Floats) -> Floats:
    """Return the distance in m from the camera for depth-buffer values 0..1."""
    return FAR * NEAR / (FAR - (FAR - NEAR) * np.clip(depth, 0.0, 1.0))


def show_rows(plan: MotionPlan, count: int) -> list[int]:
    """Return rows of a plan evenly spread in time, first and last included."""
    return [math.floor(row) for row in np.linspace(0, plan.samples - 1, count)]

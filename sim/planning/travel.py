"""The way from one place to another where nothing is to be followed: straight in joint space, or round what is there.

Where the straight joint move comes too near something, places in between are drawn at random (always the same ones),
those that are free are kept, and the shortest way over them is looked for; its moves are looked at only then, and
given up where they are not free (lazy probabilistic roadmap, Bohlin and Kavraki, 2000). Then places that are not
needed are left out. At each place the arm comes to rest.
"""

import heapq
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.arm_model import ArmModel, Bools, Floats
from sim.planning.clearance import MARGIN, Box, least_distances
from sim.planning.kinematics import kinematics

STRIDE = 0.05
DRAWN, NEIGHBOURS, TRIES = 360, 14, 60
SPARE_GAP = 1e-3
SHORTENED = 3


def free_way(start: Floats, end: Floats, arm: ArmModel, boxes: tuple[Box, ...]) -> list[Floats]:
    """Return the places (dof,) of joint moves from ``start`` to ``end``: those two only where nothing is in between.

    Also where no free way was found: the plan's own check then says what is in the way.
    """
    space = _Space(arm, boxes, start, end)
    direct = [start, end]
    if space.moves_free([(start, end)])[0]:
        return direct
    if not space.free(np.array(direct)).all():
        return direct
    return space.around(start, end) or direct


class _Space:
    """The joints at which an arm is inside its workspace and clear of everything."""

    def __init__(self, arm: ArmModel, boxes: tuple[Box, ...], start: Floats, end: Floats) -> None:
        self.arm, self.boxes = arm, boxes
        self.chain = kinematics(arm)
        limits = arm.limits
        self.lower, self.upper = np.array(limits.lower), np.array(limits.upper)
        self.scale = 1.0 / np.array(limits.velocity)
        low, high = np.array(arm.workspace_low), np.array(arm.workspace_high)
        ends = self.chain.forward(np.array([start, end]))[0]
        # An end outside of the workspace is not this way's to mend.
        self.low, self.high = np.minimum(low, ends.min(axis=0)) - 1e-6, np.maximum(high, ends.max(axis=0)) + 1e-6

    def free(self, joints: Floats) -> Bools:
        """Return which joints (n, dof) may be."""
        tool = self.chain.forward(joints)[0]
        inside = (tool >= self.low) & (tool <= self.high)
        good = np.asarray(
            np.concatenate([inside, joints >= self.lower, joints <= self.upper], axis=1).all(axis=1), dtype=np.bool_
        )
        if good.any() and self.arm.capsules:
            rows = np.flatnonzero(good)
            good[rows] = least_distances(self.arm, joints[rows], self.boxes) > MARGIN + SPARE_GAP
        return good

    def moves_free(self, moves: list[tuple[Floats, Floats]]) -> list[bool]:
        """Return which joint moves may be made: all looked at together."""
        rows, owners = [], []
        for k, (start, end) in enumerate(moves):
            reach = float(np.abs((end - start) * np.where(self.chain.slides, 5.0, 1.0)).max())
            count = max(2, int(np.ceil(reach / STRIDE)) + 1)
            rows.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
            owners.append(np.full(count, k))
        good = self.free(np.concatenate(rows))
        owner = np.concatenate(owners)
        return [bool(good[owner == k].all()) for k in range(len(moves))]

    def around(self, start: Floats, end: Floats) -> list[Floats]:
        """Return places from start to end over others, empty if none was found."""
        places = np.concatenate([[start], self._drawn(start, end), [end]])
        count = len(places)
        apart = np.abs((places[:, None] - places[None]) * self.scale).max(axis=2)
        near = np.argsort(apart, axis=1)[:, 1 : NEIGHBOURS + 1]
        edges: dict[tuple[int, int], bool | None] = {}
        for a in range(count):
            for b in near[a]:
                edges[min(a, int(b)), max(a, int(b))] = None
        edges[0, count - 1] = False
        for _ in range(TRIES):
            way = _shortest(apart, edges, count)
            if not way:
                return []
            unknown = [pair for pair in _pairs(way) if edges[pair] is None]
            if not unknown:
                return self._shortened([places[k] for k in way])
            for pair, good in zip(unknown, self.moves_free([(places[a], places[b]) for a, b in unknown]), strict=True):
                edges[pair] = good
        return []

    def _drawn(self, start: Floats, end: Floats) -> Floats:
        """Return free joints (k, dof) to go over: half of them about the moves, half where the nozzle may be."""
        random = np.random.default_rng(11)
        half = DRAWN // 2
        home = np.array(self.arm.home)
        corners = np.array([start, end, home])
        share = random.dirichlet(np.ones(3), DRAWN)
        about = share @ corners
        wide = np.clip(0.35 * (self.upper - self.lower), 0.0, np.where(self.chain.slides, np.inf, 0.8))
        spread = about[:half] + random.normal(size=(half, self.arm.dof)) * wide * random.uniform(0.1, 1.0, (half, 1))
        points = random.uniform(self.arm.workspace_low, self.arm.workspace_high, (half, 3))
        held = Rotation.from_matrix(self.chain.forward(np.array([home, end]))[1])
        turned = Slerp([0.0, 1.0], held)(random.uniform(size=half)).as_matrix()
        solved = self.chain.refine(points, turned, about[half:])
        joints = np.concatenate([spread, solved.joints[solved.reached], [home]])
        joints = joints[np.isfinite(joints).all(axis=1)]
        return joints[self.free(joints)]

    def _shortened(self, places: list[Floats]) -> list[Floats]:
        """Return the places without those that a free move can leave out."""
        for _ in range(SHORTENED):
            pairs = [(i, j) for i in range(len(places)) for j in range(i + 2, len(places))]
            if not pairs:
                break
            good = self.moves_free([(places[i], places[j]) for i, j in pairs])
            skips = [pair for pair, free in zip(pairs, good, strict=True) if free]
            if not skips:
                break
            i, j = max(skips, key=lambda pair: pair[1] - pair[0])
            places = places[: i + 1] + places[j:]
        return places


def _pairs(way: list[int]) -> list[tuple[int, int]]:
    return [(min(a, b), max(a, b)) for a, b in pairwise(way)]


def _shortest(apart: Floats, edges: dict[tuple[int, int], bool | None], count: int) -> list[int]:
    """Return the shortest way from the first place to the last over moves not known to be blocked (Dijkstra)."""
    beside: list[list[int]] = [[] for _ in range(count)]
    for (a, b), free in edges.items():
        if free is not False:
            beside[a].append(b)
            beside[b].append(a)
    least = np.full(count, np.inf)
    before = np.full(count, -1)
    least[0] = 0.0
    queue = [(0.0, 0)]
    while queue:
        far, here = heapq.heappop(queue)
        if here == count - 1:
            way = [here]
            while way[-1] != 0:
                way.append(int(before[way[-1]]))
            return way[::-1]
        if far > least[here]:
            continue
        for there in beside[here]:
            # Each stop costs a little: few places rather than many.
            longer = far + float(apart[here, there]) + 0.05
            if longer < least[there]:
                least[there], before[there] = longer, here
                heapq.heappush(queue, (longer, there))
    return []

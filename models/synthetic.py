"""Simulated demonstrators on the paper's 65 x 90 mm plate, with known truth: for the demo, the tests and the
benchmarks.

Each person holds the pen a little turned, moved and scaled, misses each corner by their own amount, takes their own
time,
waits at the ends and slows down at corners, wanders and trembles; the cameras add noise and, if asked, reflections.
"""

from dataclasses import dataclass

import numpy as np

from models.demonstration import Bools, Demonstration, Floats

ZIGZAG = np.array([[5.0, 5.0], [60.0, 25.0], [5.0, 45.0], [60.0, 65.0], [5.0, 85.0]]) * 1e-3
ZIGZAG_IN_SPACE = np.column_stack([ZIGZAG, [10e-3, 22e-3, 5e-3, 18e-3, 8e-3]])
TURN = np.deg2rad(1.0)
SCALE = 0.01
OFFSET = 1e-3
CORNER = 1.5e-3
WANDER = 1e-3
TREMBLE = 0.25e-3
CAMERA = 0.3e-3
TILT = np.deg2rad(2.0)
MOST_REST = 0.6


def raster(lines: int) -> Floats:
    """Return the corners (2 lines, 2) in m of a raster over the plate: lines joined by short edges."""
    across = np.where(np.arange(2 * lines) // 2 % 2 == np.arange(2 * lines) % 2, 5.0, 60.0)
    return np.column_stack([across, np.repeat(np.linspace(5.0, 85.0, lines), 2)]) * 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedGroup:
    """Simulated people and what nobody knows of real ones.

    ``truth`` (c, d) in m: the corners that all of them meant; ``corners`` (n, c, d): those that each had in mind;
    ``whole`` (n,): who did not let go early.
    """

    people: list[Demonstration]
    truth: Floats
    corners: Floats
    whole: Bools

    @property
    def agreed(self) -> Floats:
        """Return the mean (c, d) of what they had in mind, its last corner by those who drew it: no path can be had of
        them that is surely nearer to the truth.
        """
        mean = self.corners.mean(axis=0)
        mean[-1] = self.corners[self.whole, -1].mean(axis=0)
        return mean


def simulated_people(
    number: int = 20,
    seed: int = 0,
    reflections: bool = False,
    early_release: int = 0,
    *,
    rate: float = 100.0,
    corners: Floats | None = None,
    orientation: bool = False,
) -> tuple[list[Demonstration], Floats]:
    """Return ``number`` demonstrations and the true polyline (c, d) in m that all of them meant to draw.

    ``early_release`` of them let go of the button after 80 to 95 % of the path and their recording ends there.
    ``rate`` of
    the cameras in samples a second. ``corners`` (c, d) replaces the plate's zigzag, in two or three dimensions.
    With ``orientation`` the tool turns as ``true_orientations`` says.
    """
    group = simulated_group(
        number, seed, reflections, early_release, rate=rate, corners=corners, orientation=orientation
    )
    return group.people, group.truth


def simulated_group(
    number: int = 20,
    seed: int = 0,
    reflections: bool = False,
    early_release: int = 0,
    *,
    rate: float = 100.0,
    corners: Floats | None = None,
    orientation: bool = False,
) -> SimulatedGroup:
    """Return the people of ``simulated_people``, with what each of them had in mind."""
    generator, faults = (np.random.Generator(np.random.PCG64([seed, stream])) for stream in (0, 1))
    truth = ZIGZAG if corners is None else corners
    early = set(faults.choice(number, size=early_release, replace=False).tolist())
    people: list[Demonstration] = []
    meant: list[Floats] = []
    for person in range(number):
        reach = float(faults.uniform(0.80, 0.95)) if person in early else 1.0
        meant.append(_own_corners(generator, truth))
        people.append(_person(generator, faults if reflections else None, person, meant[-1], rate, reach, orientation))
    return SimulatedGroup(people, truth, np.stack(meant), np.array([person not in early for person in range(number)]))


def true_orientations(phases: Floats) -> Floats:
    """Return the quaternions (n, 4), x y z w, that were meant: leaning 30 degrees about y, swung by 40 about x along
    the path.
    """
    lean, swing = np.deg2rad(30.0) / 2, np.deg2rad(40.0) * np.sin(np.pi * phases) / 2
    return np.column_stack(
        [
            np.sin(swing) * np.cos(lean),
            np.cos(swing) * np.sin(lean),
            np.sin(swing) * np.sin(lean),
            np.cos(swing) * np.cos(lean),
        ]
    )


def _person(
    generator: np.random.Generator,
    faults: np.random.Generator | None,
    person: int,
    own: Floats,
    rate: float,
    reach: float,
    orientation: bool,
) -> Demonstration:
    duration = float(generator.uniform(6.0, 14.0))
    count = round(duration * rate)
    times = np.arange(count) / rate
    way = _progress(generator, own, np.linspace(0.0, 1.0, count))
    lengths = np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(own, axis=0) ** 2).sum(axis=1)))])
    points = np.column_stack([np.interp(way, lengths / lengths[-1], column) for column in own.T])
    points = points + _wander(generator, times, points.shape[1])
    points += generator.normal(0.0, CAMERA, points.shape)
    kept = int(np.searchsorted(way, reach)) if reach < 1.0 else count
    times, points, way = times[:kept], points[:kept], way[:kept]
    if faults is not None:
        _reflect(faults, points)
    return Demonstration(
        f"person-{person + 1:02d}",
        times,
        points,
        np.ones(len(times), dtype=bool),
        operator=f"person {person + 1}",
        source="simulated",
        orientations=_held(generator, way, times) if orientation else None,
    )


def _own_corners(generator: np.random.Generator, truth: Floats) -> Floats:
    """Return the polyline this person draws: turned, scaled, moved, each corner missed."""
    centre = truth.mean(axis=0)
    angle = generator.normal(0.0, TURN)
    turn = np.eye(truth.shape[1])
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turned = ((truth - centre)[:, None, :] * turn[None]).sum(axis=2) * (1.0 + generator.normal(0.0, SCALE))
    spread = generator.normal(0.0, CORNER, truth.shape)
    return turned + centre + generator.normal(0.0, OFFSET, truth.shape[1]) + spread


def _progress(generator: np.random.Generator, corners: Floats, clock: Floats) -> Floats:
    """Return the way gone (n,), 0..1, at each instant of ``clock`` (n,), 0..1: pauses at corners, slow around them.

    However many corners there are, people rest for 60 % of the time at most.
    """
    edges = np.sqrt((np.diff(corners, axis=0) ** 2).sum(axis=1))
    shares = edges / edges.sum()
    pauses = generator.uniform(0.0, 0.045, len(edges) + 1)
    pauses *= min(1.0, MOST_REST / float(pauses.sum()))
    moving = shares * generator.uniform(0.8, 1.2, len(edges))
    moving *= (1.0 - pauses.sum()) / moving.sum()
    softness = float(generator.uniform(0.3, 0.9))
    gone, start, way = pauses[0], 0.0, np.zeros_like(clock)
    for share, span, pause in zip(shares, moving, pauses[1:], strict=True):
        part = np.clip((clock - gone) / span, 0.0, 1.0)
        jerkless = part**3 * (10.0 - 15.0 * part + 6.0 * part * part)
        way = np.where(clock >= gone, start + share * (softness * jerkless + (1.0 - softness) * part), way)
        gone, start = gone + span + pause, start + share
    return np.clip(way, 0.0, 1.0)


def _wander(generator: np.random.Generator, times: Floats, dimension: int) -> Floats:
    """Return slow wandering (about 1 mm) and trembling at 8 to 12 Hz (0.25 mm): shape (n, d)."""
    result = np.zeros((len(times), dimension))
    for axis in range(dimension):
        for frequency in generator.uniform(0.1, 0.8, 4):
            phase = generator.uniform(0.0, 2.0 * np.pi)
            result[:, axis] += WANDER * np.sqrt(0.25) * np.sin(2.0 * np.pi * frequency * times + phase)
        frequency, phase = generator.uniform(8.0, 12.0), generator.uniform(0.0, 2.0 * np.pi)
        result[:, axis] += TREMBLE * np.sin(2.0 * np.pi * frequency * times + phase)
    return result


def _reflect(generator: np.random.Generator, points: Floats) -> None:
    """Throw 1 to 9 bursts of 1 to 6 samples tens of millimetres and more off, as a reflection taken for the marker
    does.
    """
    for _ in range(int(generator.integers(1, 10))):
        length = int(generator.integers(1, 7))
        start = int(generator.integers(5, len(points) - length - 5))
        direction = generator.normal(0.0, 1.0, points.shape[1])
        direction /= np.sqrt((direction * direction).sum())
        points[start : start + length] += direction * generator.uniform(0.02, 0.15)


def _held(generator: np.random.Generator, way: Floats, times: Floats) -> Floats:
    """Return the tool's quaternions (n, 4): the meant ones, tilted by this person's habit (2 degrees) and tremble."""
    meant = true_orientations(way)
    habit = generator.normal(0.0, TILT / 2.0, 3)
    wobble = TILT / 6.0 * np.sin(2.0 * np.pi * generator.uniform(0.2, 0.8, 3) * times[:, None])
    small = np.column_stack([habit + wobble, np.ones(len(times))])
    small /= np.sqrt((small * small).sum(axis=1, keepdims=True))
    return quaternion_product(small, meant)


def quaternion_product(one: Floats, other: Floats) -> Floats:
    """Return the product (n, 4) of quaternions x y z w: first ``other``, then ``one``."""
    ax, ay, az, aw = one.T
    bx, by, bz, bw = other.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )

"""Orders nobody thought of: any arm, skill, place, timing and time step, the same ones for the same seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from drawn_motion import DrawnMotion
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.learning import learn
from models.motion import Motion
from models.synthetic import ZIGZAG, ZIGZAG_IN_SPACE, simulated_people
from sim import robots
from sim.arm_model import ArmModel
from sim.order import MotionOrder
from sim.plan import MotionPlan

ROBOTS = Path(__file__).parents[1] / "sim" / "robots"
OWN = ("ur5e", "gantry", "scara")
DOME = np.array([[0.0, 0.0, 0.0], [20.0, 15.0, 14.0], [40.0, 10.0, 18.0], [55.0, 30.0, 6.0]]) * 1e-3
LEARNED = ("flat", "space", "dome")


@dataclass(frozen=True)
class Case:
    """One order for one arm."""

    number: int
    arm: ArmModel
    skill: str
    motion: Motion | DrawnMotion
    order: MotionOrder

    def __str__(self) -> str:
        return f"order {self.number}: {self.arm.name}, {self.skill}, {self.order}"


def own_arm(name: str) -> ArmModel:
    """Return an arm that is not shipped, with a hull."""
    return robots.load(str(ROBOTS / name))


def five_arms() -> tuple[ArmModel, ...]:
    """Return the shipped arms and two that are not."""
    return (*(robots.load(name) for name in robots.names()), own_arm("ur5e"), own_arm("scara"))


@lru_cache(maxsize=8)
def learned(name: str) -> Motion:
    """Return a skill learned from simulated people: a zigzag on a plate, one in space, a dome with a turning tool."""
    corners = {"flat": ZIGZAG, "space": ZIGZAG_IN_SPACE, "dome": DOME}[name]
    people = simulated_people(6, 3, corners=corners, orientation=name != "flat")[0]
    return learn(people, compare=False).motion


def random_cases(count: int, seed: int = 1, *, arms_in_turn: tuple[ArmModel, ...] | None = None) -> Iterator[Case]:
    """Yield orders, the arms in turn."""
    random = np.random.default_rng(seed)
    models = arms_in_turn or five_arms()
    for number in range(count):
        arm = models[number % len(models)]
        skill = str(random.choice([*LEARNED, "drawn"]))
        motion = _drawn(random) if skill == "drawn" else learned(skill)
        yield Case(number, arm, skill, motion, _order(random, arm))


def _drawn(random: np.random.Generator) -> DrawnMotion:
    count = int(random.integers(2, 6))
    ways = random.uniform(-2.4, 2.4, count).cumsum()
    steps = random.uniform(0.015, 0.05, (count, 1)) * np.column_stack([np.cos(ways), np.sin(ways), np.zeros(count)])
    steps[:, 2] += random.uniform(-0.005, 0.005, count)
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    radius = float(random.choice([0.0, 0.0004, 0.001, 0.0015]))
    return DrawnMotion(tuple(tuple(float(x) for x in point) for point in points), radius)


def _order(random: np.random.Generator, arm: ArmModel) -> MotionOrder:
    x, y, z = np.array(arm.part_frame[:3]) + random.uniform([-0.08, -0.2, -0.03], [0.16, 0.2, 0.15])
    tilt = random.uniform(-0.6, 0.6, 2) * random.choice([0.0, 1.0])
    turn = Rotation.from_euler("zyx", [random.uniform(-np.pi, np.pi), *tilt]).as_quat()
    timing = str(random.choice(["demonstrated", "constant_speed", "time_optimal"]))
    speed = float(np.exp(random.uniform(np.log(0.002), np.log(0.3)))) if timing == "constant_speed" else 0.0
    return MotionOrder(
        time_step=round(float(random.uniform(0.001, 0.02)), 4),
        timing=timing,  # pyright: ignore[reportArgumentType]
        speed=speed,
        duration=float(random.choice([0.0, random.uniform(4.0, 20.0)])) if timing == "demonstrated" else 0.0,
        speed_override=float(random.choice([1.0, random.uniform(0.3, 1.0)])),
        frame=(float(x), float(y), float(z), *(float(one) for one in turn)),
        blend_radius=float(random.choice([0.0, 0.0, random.uniform(0.0005, 0.004)])),
        nozzle_turn=str(random.choice(["shown", "free"])),  # pyright: ignore[reportArgumentType]
        approach_height=float(random.uniform(0.0, 0.08)),
    )


def largest_shares(plan: MotionPlan, arm: ArmModel) -> NDArray[np.float64]:
    """Return which share of their limits velocity, acceleration and jerk reach between any two samples of a plan.

    Worked out from each row's cubic itself, by other formulas than the planner's.
    """
    h, q, v = plan.order.time_step, plan.joints, plan.velocities
    start, end = q[:-1], q[1:]
    jerk = 6.0 * (2.0 * (start - end) / h + v[:-1] + v[1:]) / h**2
    second = 3.0 * (end - start) / h**2 - (2.0 * v[:-1] + v[1:]) / h
    pushes = np.stack([2.0 * second, 2.0 * second + jerk * h])
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.clip(np.nan_to_num(-2.0 * second / jerk), 0.0, h)
    inside = v[:-1] + 2.0 * second * turning + 0.5 * jerk * turning**2
    limits = arm.limits
    return np.array(
        [
            max((np.abs(v) / limits.velocity).max(), (np.abs(inside) / limits.velocity).max()),
            (np.abs(pushes) / limits.acceleration).max(),
            (np.abs(jerk) / limits.jerk).max(),
        ]
    )


def ends_pushed(plan: MotionPlan, arm: ArmModel) -> float:
    """Return which share of the acceleration limit a plan begins or ends with."""
    h, q, v = plan.order.time_step, plan.joints, plan.velocities
    first = 6.0 * (q[1] - q[0]) / h**2 - (4.0 * v[0] + 2.0 * v[1]) / h
    last = -6.0 * (q[-1] - q[-2]) / h**2 + (4.0 * v[-1] + 2.0 * v[-2]) / h
    return float((np.abs([first, last]) / arm.limits.acceleration).max())

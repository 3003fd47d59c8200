"""Execution held to its figures, against PyBullet's and Pinocchio's kinematics and the usual feed-forward.

The task is the zigzag of a 65 x 90 mm plate, seven strokes of 80 mm with 3 mm corners, about 600 mm in 12 s at 50
mm/s. Errors are judged by a forward kinematics of its own, written with plain 4 x 4 matrices. Pinocchio runs in an
environment of its own, made at first use (``execution_peers``); where that cannot be made, its row says so and does
not hold.
"""

import asyncio
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks import execution_peers
from models.motion import Motion
from sim import robots
from sim.arm import Stopped, Trace
from sim.arm_model import ArmModel
from sim.drivers.execution import Execution, Phase
from sim.drivers.pybullet.arm import PyBulletArm
from sim.drivers.pybullet.world import BulletWorld, pybullet
from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.checks import check_joints, check_reach, check_singularity
from sim.planning.clearance import Cell, check_clearance, part_box
from sim.planning.kinematics import kinematics
from sim.planning.planner import plan_motion
from sim.testing.conformance import left_path

Floats = NDArray[np.float64]
Row = dict[str, Any]
STROKES, STROKE, PITCH, RADIUS = 7, 0.08, 0.009, 0.003
IK_POINTS, PEER_RUNS = 4000, 5
BULLET, PINOCCHIO = "PyBullet, tuned", "Pinocchio loop"


class Zigzag:
    """The zigzag as a motion: straight strokes and half-round-ish turns of two 3 mm corners, shown at an even pace."""

    dimension, dispense, duration, has_orientation = 2, ((0.0, 1.0),), 12.0, False

    def __init__(self, radius: float = RADIUS) -> None:
        pieces: list[Floats] = []
        for k in range(STROKES):
            up = k % 2 == 0
            x, low, high = k * PITCH, (0.0, STROKE)[not up], (0.0, STROKE)[up]
            pieces.append(np.array([[x, low + (radius if k else 0.0) * (1 if up else -1)]]))
            if k < STROKES - 1:
                side = 1 if up else -1
                turn = np.linspace(0.0, 0.5 * np.pi, 400)
                first = np.column_stack([x + radius * (1 - np.cos(turn)), high - side * radius * (1 - np.sin(turn))])
                second = np.column_stack(
                    [x + PITCH - radius * (1 - np.sin(turn)), high - side * radius * (1 - np.cos(turn))]
                )
                pieces += [first, second]
            else:
                pieces.append(np.array([[x, high]]))
        self._points = np.concatenate(pieces)
        steps = np.sqrt((np.diff(self._points, axis=0) ** 2).sum(axis=1))
        self._at = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()

    def points_at(self, phases: Floats) -> Floats:
        """Return points (n, 2) at phases (n,)."""
        return np.column_stack([np.interp(phases, self._at, self._points[:, k]) for k in range(2)])

    def at_phases(self, phases: Floats) -> tuple[Floats, Floats]:
        """Return points and a spread of 1 mm."""
        return self.points_at(phases), np.tile(1e-6 * np.eye(2), (len(phases), 1, 1))

    def times_at(self, phases: Floats) -> Floats:
        """Return the time in s at each phase."""
        return phases * self.duration


def zigzag(radius: float = RADIUS) -> Motion:
    """Return the zigzag where a learned motion is asked for: the planner uses nothing else of one."""
    return Zigzag(radius)  # pyright: ignore[reportReturnType]


def rows() -> Iterator[Row]:
    """Yield the figures as they are measured."""
    yield from inverse_kinematics()
    yield from planning()
    yield from motion()


def row(name: str, ours: float, peer: str, theirs: float | None, goal: str, holds: bool, runs: int = 1) -> Row:
    """Return one line of the table; the ratio says how many times better ours is, None where that means nothing."""
    ratio = theirs / ours if theirs and ours else None
    return {
        "name": name, "ours": ours, "peer": peer, "theirs": theirs, "ratio": ratio,
        "goal": goal, "holds": bool(holds), "runs": runs,
    }  # fmt: skip


def inverse_kinematics() -> Iterator[Row]:
    """Compare accuracy and time a point on the whole zigzag, on every arm: processor time, models loaded before."""
    goals: dict[str, Floats] = {}
    for name in robots.names():
        goal = plan_motion(zigzag(), MotionOrder(time_step=0.001, speed=0.05), robots.load(name)).tool
        goals[name] = goal[np.linspace(1500, len(goal) - 1500, IK_POINTS).astype(int)]
    models = {name: robots.load(name) for name in goals}
    tasks = [
        (model.urdf, model.tool.tip, model.home, kinematics(model).seed_rotation, goals[name], PEER_RUNS)
        for name, model in models.items()
    ]
    told = execution_peers.answers(tasks)
    for k, (name, model) in enumerate(models.items()):
        arm, goal = kinematics(model), goals[name]
        ours: list[float] = []
        theirs: list[float] = []
        joints, bullet = np.empty(0), np.empty(0)
        for _ in range(PEER_RUNS):
            for _ in range(3):
                began = time.process_time()
                joints = arm.inverse(goal, arm.seed_rotation).joints
                ours.append((time.process_time() - began) / len(goal) * 1e6)
            bullet, spent = bullet_inverse(model, goal)
            theirs.append(spent / len(goal) * 1e6)
        errors = [float(np.abs(matrix_forward(model, found) - goal).max()) * 1e3 for found in (joints, bullet)]
        yield row(
            f"inverse kinematics {name}: largest error in mm", errors[0], BULLET, errors[1], "at most 1e-6 mm",
            errors[0] <= 1e-6, PEER_RUNS,
        )  # fmt: skip
        best = min(ours)
        title, goal_text = f"inverse kinematics {name}: µs a point", "at least 3 times faster"
        yield row(title, best, BULLET, min(theirs), goal_text, min(theirs) >= 3 * best, PEER_RUNS)
        if isinstance(told, str):
            yield row(title, best, f"{PINOCCHIO}: not measured, {told}", None, goal_text, False)
            continue
        found, spent = told[k]
        error = float(np.abs(matrix_forward(model, found) - goal).max()) * 1e3
        peer, each = f"{PINOCCHIO} ({error:.1g} mm)", spent / len(goal) * 1e6
        yield row(title, best, peer, each, goal_text, each >= 3 * best, PEER_RUNS)


def bullet_inverse(model: ArmModel, goal: Floats) -> tuple[Floats, float]:
    """Return joints by ``calculateInverseKinematics`` as it measured best, each from the one before, and the time in s.

    Loading the arm is not counted.
    """
    world = BulletWorld(model)
    try:
        began = time.process_time()
        count = pybullet.getNumJoints(world.body, physicsClientId=world.client)
        turn = Rotation.from_matrix(kinematics(model).seed_rotation).as_quat().tolist()
        joints = []
        for point in goal.tolist():
            found = pybullet.calculateInverseKinematics(
                world.body, count - 1, point, turn, maxNumIterations=100, residualThreshold=1e-6,
                jointDamping=[1e-3] * model.dof, physicsClientId=world.client,
            )  # fmt: skip
            joints.append(found)
            for index, value in zip(world.joints, found, strict=True):
                pybullet.resetJointState(world.body, index, value, physicsClientId=world.client)
        return np.array(joints), time.process_time() - began
    finally:
        world.close()


def matrix_forward(model: ArmModel, joints: Floats) -> Floats:
    """Return nozzle positions (n, 3) by multiplying 4 x 4 matrices read from the description."""
    by_child = {joint.find("child").get("link"): joint for joint in ElementTree.fromstring(model.urdf).iter("joint")}  # pyright: ignore[reportOptionalMemberAccess]
    chain, link = [], model.tool.tip
    while link in by_child:
        chain.insert(0, by_child[link])
        link = by_child[link].find("parent").get("link")  # pyright: ignore[reportOptionalMemberAccess]
    pose = np.tile(np.eye(4), (len(joints), 1, 1))
    moving = 0
    for joint in chain:
        fixed = np.eye(4)
        origin = joint.find("origin")
        fixed[:3, 3] = [float(value) for value in origin.get("xyz").split()]  # pyright: ignore[reportOptionalMemberAccess]
        fixed[:3, :3] = Rotation.from_euler("xyz", [float(value) for value in origin.get("rpy").split()]).as_matrix()  # pyright: ignore[reportOptionalMemberAccess]
        pose = pose @ fixed
        if joint.get("type") == "revolute":
            turn = np.tile(np.eye(4), (len(joints), 1, 1))
            turn[:, :3, :3] = Rotation.from_rotvec(joints[:, [moving]] * [[0.0, 0.0, 1.0]]).as_matrix()
            pose = pose @ turn
            moving += 1
    return pose[:, :3, 3]


def planning() -> Iterator[Row]:
    """Measure contour error against the time step, evenness of the speed, and how long all checks take."""
    model = robots.load()
    kept, refused = [], 0
    for step in (0.001, 0.004, 0.008, 0.012, 0.016, 0.02):
        try:
            order = MotionOrder(time_step=step, timing="constant_speed", speed=0.05, corners="refuse")
            kept.append(plan_motion(zigzag(0.001), order, model).path_error[1] * 1e3)
        except MotionRefused:
            refused += 1
    usual = (0.05 * 0.02) ** 2 / (8 * 0.001) * 1e3
    yield row(
        f"contour error with 1 mm corners, 1 to 20 ms steps, mm ({refused} of 6 refused)", max(kept),
        "linear at 20 ms, unchecked", usual, "at most 0.05 mm, or refused", max(kept) <= 0.05 * 1.03, 6,
    )  # fmt: skip
    plan = plan_motion(zigzag(), MotionOrder(time_step=0.001, timing="constant_speed", speed=0.05), model)
    first, last = plan.path_rows
    speeds = np.sqrt((np.diff(plan.tool[first : last + 1], axis=0) ** 2).sum(axis=1)) / 0.001
    uneven = float(np.abs(speeds / 0.05 - 1.0).max()) * 100
    yield row(
        "nozzle speed while dispensing, largest deviation in %", uneven, "toppra with a cap", 1.5, "within 1 %",
        uneven <= 1.0,
    )  # fmt: skip
    spent = []
    for _ in range(3):
        began = time.process_time()
        all_checks(model, plan)
        spent.append(time.process_time() - began)
    yield row(
        "all checks of a 12 s path every 1 mm, s", min(spent), "the goal", 1.0, "at most 1 s", min(spent) <= 1.0, 3
    )


def all_checks(model: ArmModel, plan: MotionPlan) -> None:
    """Look at everything that is looked at before a run, every millimetre of the path."""
    first, last = plan.path_rows
    spacing = max(1, round(0.001 / (plan.report["speed_mean"] * plan.order.time_step)))
    rows = np.arange(first, last + 1, spacing)
    points, times, phases = plan.tool[rows], plan.times[rows], plan.phases[rows]
    solved = kinematics(model).inverse(points, kinematics(model).seed_rotation)
    boxes = (Cell().table(), part_box(points, plan.order.frame, 0.0))
    found = check_reach(model, points, solved, times, phases) + check_joints(model, solved.joints, times, phases)
    found += check_singularity(model, solved.joints, times, phases)[0]
    found += check_clearance(model, solved.joints, times, phases, boxes)[0]
    if found:
        raise MotionRefused(found)


def motion() -> Iterator[Row]:
    """Measure tracking, pause, stop, speed of simulation and repeatability in PyBullet at 1 kHz."""
    model = robots.load()
    worst, usual = 0.0, 0.0
    for speed in (0.01, 0.05, 0.1):
        order = MotionOrder(time_step=0.001, timing="constant_speed", speed=speed, corners="slow")
        plan = plan_motion(zigzag(), order, model)
        worst = max(worst, tracked(model, plan, ahead=False))
        usual = max(usual, tracked(model, plan, ahead=True))
    yield row(
        "tracking at 1 kHz, 10 to 100 mm/s, largest error in mm", worst, "PyBullet, usual feed-forward", usual,
        "at most 0.005 mm", worst <= 0.005, 3,
    )  # fmt: skip
    yield from asyncio.run(runs(model))


def tracked(model: ArmModel, plan: MotionPlan, *, ahead: bool) -> float:
    """Return the largest tracking error in mm.

    ``ahead`` sends each tick's end position with its velocity, as is usual.
    """
    world, execution = BulletWorld(model), Execution(plan, model)
    world.begin(plan.joints[0], execution.dt)
    now, wanted, measured = plan.joints[0], [], []
    try:
        while execution.phase is not Phase.ENDED:
            before, now = now, execution.tick()
            world.step(now if ahead else before, now + (now - before) if ahead else now, execution.dt)
            wanted.append(now)
            measured.append(world.measure()[0])
    finally:
        world.close()
    forward = kinematics(model).forward
    away = forward(np.array(measured))[0] - forward(np.array(wanted))[0]
    return float(np.sqrt((away**2).sum(axis=1)).max()) * 1e3


async def runs(model: ArmModel) -> list[Row]:
    """Run plans on the simulated arm as a server would."""
    plan = plan_motion(zigzag(), MotionOrder(time_step=0.001, timing="constant_speed", speed=0.05), model)
    fast = plan_motion(zigzag(), MotionOrder(time_step=0.001, timing="constant_speed", speed=0.075), model)
    arm = PyBulletArm(model, realtime=False)
    await arm.open()
    try:
        took, traces = [], []
        for _ in range(2):
            began = processor_seconds(arm.process_id)
            traces.append(await arm.run(plan, lambda _: None))
            took.append(processor_seconds(arm.process_id) - began)
        paused = await with_pauses(arm, plan)
    finally:
        await arm.close()
    stopped = await stopping(model, fast)
    same = all(
        np.array_equal(getattr(traces[0], name), getattr(traces[1], name))
        for name in ("joints_measured", "tool_measured")
    )
    off = max(left_path(paused, plan, model), paused.tracking_error()[1]) * 1e3
    factor = plan.duration / min(took)
    return [
        row("pause and resume leave the path by, mm", off, "the goal", 0.01, "at most 0.01 mm", off <= 0.01, 1),
        row(
            "stop from 75 mm/s takes, mm", stopped, "the goal", 5.0, "at most 5 mm, on the path", 0 < stopped <= 5.0, 1
        ),
        {
            **row(
                "real-time factor of a logged 1 kHz run, processor time",
                factor,
                "the goal",
                5.0,
                "at least 5",
                factor >= 5.0,
                2,
            ),
            "ratio": factor / 5.0,
        },
        row("traces of two runs differ in, bits", 0.0 if same else 1.0, "the goal", 0.0, "bitwise equal", same, 2),
    ]


def processor_seconds(process_id: int | None) -> float:
    """Return the processor time in s a process has used: what it would take on a core of its own."""
    words = Path(f"/proc/{process_id}/stat").read_text("ascii").rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


async def with_pauses(arm: PyBulletArm, plan: MotionPlan) -> Trace:
    """Return the trace of a run paused and resumed on its way."""
    run = asyncio.create_task(arm.run(plan, lambda _: None))
    for _ in range(3):
        await asyncio.sleep(0.1)
        if not run.done():
            await arm.pause("to measure")
        if not run.done():
            await arm.resume()
    return await run


async def stopping(model: ArmModel, plan: MotionPlan) -> float:
    """Return the way in mm that the nozzle goes after a stop in the middle of the path."""
    arm = PyBulletArm(model, realtime=True)
    await arm.open()
    try:
        run = asyncio.create_task(arm.run(plan, lambda _: None))
        await asyncio.sleep(float(plan.times[plan.path_rows[0]]) + 0.5)
        await arm.stop("to measure")
        try:
            await run
        except Stopped as stopped:
            slowing = stopped.trace.override < 1.0 - 1e-9
            way = np.diff(stopped.trace.tool_measured[slowing], axis=0)
            return float(np.sqrt((way**2).sum(axis=1)).sum()) * 1e3
        return float("inf")
    finally:
        await arm.close()

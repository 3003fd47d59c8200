"""Orders nobody thought of, on the shipped arms and two others: what is accepted keeps every limit, what is refused
could not have been run.

    PLAN_ORDERS=500 pytest tests/sim/test_random_orders.py -n 0 -s

is the whole of it; without the variable a sample is taken.
"""

import os
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from brute_search import could_be_run
from drawn_motion import DrawnMotion
from random_orders import Case, ends_pushed, five_arms, largest_shares, own_arm, random_cases
from scipy.spatial.transform import Rotation

from sim.findings import MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.planner import OF_THE_POSTURE, plan_motion

ORDERS = int(os.environ.get("PLAN_ORDERS", "40"))
SLOWER = (0.8, 0.45, 0.13)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900 + 20 * ORDERS)]


@dataclass(frozen=True)
class Turning(DrawnMotion):
    """A way on a plate along which the tool leans, and turns evenly from the first point to the last."""

    corners: tuple = ((0.0, 0.0, 0.0), (0.03, 0.02, 0.0), (0.0, 0.05, 0.0))
    has_orientation = True

    def orientations_at(self, phases):
        return Rotation.from_euler("yz", np.column_stack([0.25 + 0.3 * phases, 0.4 * phases])).as_quat()


def answer(case: Case) -> MotionPlan | MotionRefused:
    try:
        return plan_motion(case.motion, case.order, case.arm)  # pyright: ignore[reportArgumentType]
    except MotionRefused as refused:
        return refused


@pytest.fixture(scope="module")
def answers() -> list[tuple[Case, float, float, float, float, MotionRefused | None]]:
    """Return for every order the largest shares of velocity, acceleration, jerk, at rest; or its refusal."""
    found = []
    for case in random_cases(ORDERS):
        plan = answer(case)
        if isinstance(plan, MotionPlan):
            found.append((case, *largest_shares(plan, case.arm), ends_pushed(plan, case.arm), None))
        else:
            found.append((case, 0.0, 0.0, 0.0, 0.0, plan))
    return found


def test_every_accepted_plan_keeps_velocity_acceleration_and_jerk_between_all_samples(answers):
    shares = np.array([row[1:5] for row in answers if row[5] is None])
    told = Counter((row[0].arm.name, row[5].failure if row[5] else "accepted") for row in answers)
    print(
        f"\n{len(answers)} orders, {len(shares)} accepted; largest shares {shares.max(axis=0).round(4)}; {dict(told)}"
    )
    assert len(shares) >= 0.3 * len(answers)
    for case, velocity, acceleration, jerk, at_rest, refused in answers:
        if refused is None:
            assert max(velocity, acceleration, jerk) <= 1.0 + 1e-9, case
            assert at_rest < 1e-3, case


def test_no_order_is_refused_that_a_search_over_starts_and_branches_can_run(answers):
    refused = [row[0] for row in answers if row[5] is not None and row[5].failure in OF_THE_POSTURE][:100]
    found = [str(case) for case in refused if could_be_run(case)]
    print(f"\n{len(refused)} refusals searched, {len(found)} could have been run: {found}")
    assert not found


def test_what_is_accepted_at_a_constant_speed_is_accepted_at_every_lower_one():
    cases = [case for case in random_cases(ORDERS, seed=2) if case.order.timing == "constant_speed"]
    tried = 0
    for case in cases:
        if isinstance(answer(case), MotionRefused):
            continue
        for share in SLOWER:
            slower = replace(case, order=replace(case.order, speed=share * case.order.speed))
            refused = answer(slower)
            tried += 1
            assert isinstance(refused, MotionPlan), f"{refused}: {slower}"
    print(f"\n{tried} slower orders")
    assert tried


def test_a_gantry_plans_in_metres_and_holds_its_nozzle_as_it_can():
    gantry = own_arm("gantry")
    order = MotionOrder(time_step=0.004, timing="constant_speed", speed=0.05, frame=(0.4, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0))
    plan = plan_motion(DrawnMotion(), order, gantry)  # pyright: ignore[reportArgumentType]
    assert largest_shares(plan, gantry).max() <= 1.0
    assert np.abs(plan.joints[:, :2] - plan.tool[:, :2]).max() < 1e-9


@pytest.mark.parametrize("arm", five_arms(), ids=lambda arm: arm.name)
def test_a_taught_turn_neither_stops_a_constant_speed_nor_begins_with_a_step(arm):
    for speed in (0.002, 0.005, 0.01):
        order = MotionOrder(time_step=0.004, timing="constant_speed", speed=speed, frame=arm.part_frame)
        plan = plan_motion(Turning(), order, arm)  # pyright: ignore[reportArgumentType]
        assert largest_shares(plan, arm).max() <= 1.0
        first, last = plan.path_rows
        ends = np.sqrt((np.diff(plan.tool[[first, first + 1, last - 1, last]], axis=0)[[0, 2]] ** 2).sum(axis=1))
        assert ends / order.time_step == pytest.approx(speed, rel=0.01), "the valve opens and closes at speed"

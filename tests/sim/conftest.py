"""Arms and motions that many tests here need."""

from functools import lru_cache

import pytest
from drawn_motion import DrawnMotion

from sim import robots
from sim.arm_model import ArmModel
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.planner import plan_motion


@lru_cache(maxsize=64)
def _planned(order: MotionOrder, arm: str, radius: float) -> MotionPlan:
    return plan_motion(DrawnMotion(radius=radius), order, robots.load(arm), skill_digest="ab" * 32, recipe_id="r1")


@pytest.fixture(params=robots.names())
def model(request: pytest.FixtureRequest) -> ArmModel:
    return robots.load(request.param)


@pytest.fixture
def panda() -> ArmModel:
    return robots.load("panda")


@pytest.fixture
def planned():
    """Return plans of the zigzag; equal orders share one plan."""

    def plan(order: MotionOrder | None = None, arm: str = "panda", radius: float = 0.003) -> MotionPlan:
        return _planned(order or MotionOrder(time_step=0.004, timing="constant_speed", speed=0.03), arm, radius)

    return plan

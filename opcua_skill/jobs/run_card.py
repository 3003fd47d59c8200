"""What an operator has to see of a run before it is approved or started: made from the very plan that would run."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from models.demonstration import Bools, Floats
from models.motion import Motion
from opcua_skill.jobs.worker_tasks import PlanRefused, plan_skill
from sim.arm_model import ArmModel
from sim.findings import Finding
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.clearance import Cell

SHOWN = 400


@dataclass(frozen=True, slots=True, eq=False)
class RunCard:
    """The path of a run in the part's frame, thinned: ``times`` (n,) s from its start, ``points`` (n, 3) m.

    ``speeds`` (n,) of the nozzle in m/s, ``dispense`` (n,) valve open, ``covariances`` (n, 3, 3) m² of the people,
    ``facts`` what else is known, JSON-able.
    """

    times: Floats
    points: Floats
    speeds: Floats
    dispense: Bools
    covariances: Floats
    facts: dict[str, Any]


def run_card(
    motion: Motion, order: MotionOrder, arm: ArmModel, skill_digest: str, recipe_id: str, cell: Cell
) -> RunCard | PlanRefused:
    """Plan a run and return its card; a run that must not be is refused as at ExecuteSkill."""
    plan = plan_skill(motion, order, arm, skill_digest, recipe_id, cell)
    return plan if isinstance(plan, PlanRefused) else card_of(plan)


def card_of(plan: MotionPlan) -> RunCard:
    """Return the card of a plan."""
    first, last = plan.path_rows
    rows = slice(first, last + 1)
    frame = plan.order.frame
    turn = Rotation.from_quat(frame[3:])
    points = turn.inv().apply(plan.tool[rows] - np.array(frame[:3]))
    times, dispense = plan.times[rows] - plan.times[first], plan.dispense[rows]
    speeds = np.zeros(len(points))
    if len(points) > 1:
        speeds = np.linalg.norm(np.gradient(points, plan.order.time_step, axis=0), axis=1)
    count = len(points)
    edges = np.flatnonzero(np.diff(dispense.astype(int)))
    shown = np.unique(
        np.concatenate([np.linspace(0, count - 1, min(count, SHOWN)).round().astype(int), edges, edges + 1])
    )
    shown = shown[shown < count]
    report = plan.report
    facts = {
        "planDigest": plan.digest,
        "arm": plan.arm,
        "samples": plan.samples,
        "timeStep": plan.order.time_step,
        "timing": plan.order.timing,
        "duration": plan.duration,
        "pathDuration": float(times[-1]),
        "length": float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
        "speedMin": _finite(report.get("speed_min")),
        "speedMax": _finite(report.get("speed_max")),
        "pathError": [_finite(one) for one in plan.path_error],
        "clearance": _finite(report.get("smallest_clearance")),
        "standoff": plan.order.standoff,
        "plate": plan.order.plate,
        "tubeSigmas": plan.order.tube_sigmas,
        "tubePolicy": plan.order.tube_policy,
        "valve": [
            {"opens": one.opens, "time": one.time - float(plan.times[first]), "arcLength": one.arc_length}
            for one in plan.valve_events
        ],
    }
    to_part = turn.as_matrix()
    covariances = np.einsum("ji,njk,kl->nil", to_part, plan.covariances[shown], to_part)
    told = facts | found(plan.findings)
    return RunCard(times[shown], points[shown], speeds[shown], dispense[shown], covariances, told)


def found(findings: tuple[Finding, ...]) -> dict[str, Any]:
    """Return findings as fields: what, where, by how much."""
    return {"findings": [{name: _finite(value) for name, value in asdict(one).items()} for one in findings]}


def _finite(value: Any) -> Any:
    """Return a value as JSON can say it: what is not a finite number is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value

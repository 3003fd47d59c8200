"""What runs inside worker processes. Refusals come back as values: not every exception survives being pickled."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from library.description import SkillDescription
from library.errors import InvalidValue
from library.private_files import make_private, write_private
from models.demonstration import Demonstration, Edits
from models.errors import LearningError
from models.motion import Motion, Trajectory
from models.options import LearningOptions
from models.report import LearnedMotion, Previous
from opcua_skill.jobs.process_pool import report_progress
from sim.arm import Trace
from sim.arm_model import ArmModel
from sim.findings import Finding, MotionRefused
from sim.order import MotionOrder
from sim.plan import MotionPlan
from sim.planning.clearance import Cell
from sim.planning.planner import plan_home, plan_motion
from sim.traces import to_csv, to_parquet

HOMING_SPEED = 0.25
CHECKED_SAMPLES, FARTHEST = 20_000, 20.0
# What a worker plans and checks within half the time it may take; over an hour at 8 ms, ten minutes at 1 ms.
MOST_TIME_STEPS = 500_000


@dataclass(frozen=True, slots=True)
class LearningRefused:
    """Demonstrations or options that cannot be learned from: what is at fault, and the remedy."""

    argument: str
    reason: str


@dataclass(frozen=True, slots=True)
class PlanRefused:
    """A motion that must not run, with what was found and where on the path."""

    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class DocumentRefused:
    """A document that is no skill that can be run, and the reason."""

    reason: str


def ready() -> bool:
    """Import everything a first computation needs."""
    return True


def learn_skill(
    demonstrations: Sequence[Demonstration],
    edits: Edits,
    options: LearningOptions,
    previous: Previous | None,
) -> LearnedMotion | LearningRefused:
    """Learn a motion, and compare it with the version before."""
    from models.learning import learn

    try:
        return learn(demonstrations, edits, options, progress=report_progress, previous=previous)
    except LearningError as error:
        return LearningRefused(error.argument, str(error))


def read_document(content: str, longest: float) -> SkillDescription | DocumentRefused:
    """Return the version in a document, looked at as far as running it goes: its whole path is made once.

    Its path may take ``longest`` s, and have as many samples at its own time step as a run may have.
    """
    try:
        description = SkillDescription.from_json(content)
    except InvalidValue as error:
        return DocumentRefused(str(error))
    try:
        return DocumentRefused(reason) if (reason := _cannot_run(description.motion(), longest)) else description
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return DocumentRefused(f"its path cannot be worked out: {error}")


def _cannot_run(motion: Motion, longest: float) -> str:
    """Return why the path of a motion cannot be run, "" for one that can."""
    if motion.duration > longest:
        return f"duration is {motion.duration:.4g} s: it has to be at most {longest:g} s"
    samples = motion.duration / motion.time_step + 1.0
    if samples > MOST_TIME_STEPS:
        return f"timeStep is {motion.time_step:.4g} s: that makes {samples:.4g} samples, {MOST_TIME_STEPS} are allowed"
    with np.errstate(all="ignore"):
        path = replace(motion, time_step=max(motion.time_step, motion.duration / CHECKED_SAMPLES)).as_learned()
    for name, values in (("times", path.times), ("positions", path.points), ("covariances", path.covariances)):
        if not np.isfinite(values).all():
            return f"its path has {name} that are not finite numbers: means and covariances do not fit together"
    if not (np.diff(path.times) > 0.0).all():
        return "the times along its path do not rise: means and covariances do not fit together"
    farthest = float(np.abs(path.points).max())
    if farthest > FARTHEST:
        return f"its path goes {farthest:.4g} m away: positions are in metres, at most {FARTHEST:g} from the origin"
    if not (np.diagonal(path.covariances, axis1=1, axis2=2) >= 0.0).all():
        return "its path has a spread below 0: the covariances are not those of a skill"
    if motion.has_orientation and not np.isfinite(motion.orientations_at(path.phases)).all():
        return "its path has orientations that are not finite numbers"
    return ""


def trajectory_as_learned(motion: Motion, time_step: float) -> Trajectory:
    """Return the path with the people's own timing; ``time_step`` 0 is the learned one."""
    return (replace(motion, time_step=time_step) if time_step else motion).as_learned()


def trajectory_of_plan(motion: Motion, plan: MotionPlan) -> Trajectory:
    """Return the learned path at the samples of a plan, in the part's frame, from the path's first sample on."""
    first, last = plan.path_rows
    rows = slice(first, last + 1)
    phases = plan.phases[rows]
    points, covariances = motion.at_phases(phases)
    return Trajectory(plan.times[rows] - plan.times[first], phases, points, covariances, plan.dispense[rows])


def plan_record(plan: MotionPlan) -> dict[str, Any]:
    """Return what is worth keeping of a plan beside its trace, JSON-able: what it was made of, and what was found.

    ``planDigest`` is the SHA-256 the arm checked before it moved: runs with the same one ran the same samples.
    """
    findings = [{name: _said(value) for name, value in asdict(one).items()} for one in plan.findings]
    return {
        "planDigest": plan.digest,
        "arm": plan.arm,
        "armDigest": plan.arm_digest,
        "skillDigest": plan.skill_digest,
        "recipeId": plan.recipe_id,
        "order": asdict(plan.order),
        "samples": plan.samples,
        "segments": [asdict(segment) for segment in plan.segments],
        "valve": [asdict(event) for event in plan.valve_events],
        "pathError": plan.path_error,
        "findings": findings,
        "report": {name: _said(value) for name, value in plan.report.items()},
    }


def _said(value: Any) -> Any:
    """Return a value as JSON can say it: what is not a finite number is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_trace(
    trace: Trace, folder: Path, name: str, formats: tuple[str, ...], plan: Mapping[str, Any] | None = None
) -> None:
    """Write what a run did into files of the given formats, and the record of its plan as JSON.

    Each file appears whole or not at all.
    """
    make_private(folder)
    contents = {kind: to_csv(trace).encode() if kind == "csv" else to_parquet(trace) for kind in formats}
    if plan is not None:
        contents["plan.json"] = json.dumps(plan, indent=1, default=float, allow_nan=False).encode()
    for kind, content in contents.items():
        unfinished = folder / f".{name}.{kind}.part"
        try:
            write_private(unfinished, content)
            unfinished.replace(folder / f"{name}.{kind}")
        except OSError:
            unfinished.unlink(missing_ok=True)  # a full disk gets its room back
            raise


def plan_skill(
    motion: Motion, order: MotionOrder, arm: ArmModel, skill_digest: str, recipe_id: str, cell: Cell
) -> MotionPlan | PlanRefused:
    """Plan and check a motion on an arm."""
    steps = time_steps(motion, order)
    if steps > MOST_TIME_STEPS:
        text = (
            f"the path would take {steps:.3g} time steps: it has to be at most {MOST_TIME_STEPS}, go faster or use "
            "longer steps"
        )
        many = Finding(
            "ParameterInvalid", math.nan, math.nan, steps, "time steps", text, asked=steps, limit=MOST_TIME_STEPS
        )
        return PlanRefused((many,))
    try:
        return plan_motion(motion, order, arm, skill_digest=skill_digest, recipe_id=recipe_id, cell=cell)
    except MotionRefused as refused:
        return PlanRefused(tuple(refused.findings))


def time_steps(motion: Motion, order: MotionOrder) -> float:
    """Return about how many time steps a path takes; NaN for an order that the plan will refuse anyway."""
    slowed = order.speed_override * order.speed_fraction * order.time_step
    if order.timing == "constant_speed":
        length = float(np.linalg.norm(np.diff(motion.as_learned().points, axis=0), axis=1).sum())
        seconds = length / order.speed if order.speed > 0.0 else math.nan
    else:
        seconds = order.duration or motion.duration
    return seconds / slowed if slowed > 0.0 else math.nan


def plan_way_home(arm: ArmModel, joints: tuple[float, ...], cell: Cell) -> MotionPlan | PlanRefused:
    """Plan and check an arm's way from where it stands to where every run starts."""
    try:
        return plan_home(arm, joints, speed_fraction=HOMING_SPEED, cell=cell)
    except MotionRefused as refused:
        return PlanRefused(tuple(refused.findings))

"""Between the structures on the wire and the values inside: checked at the door, flat arrays out."""

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from asyncua import ua

from library.description import Failure, JobReport, Recipe, SkillSummary
from library.errors import InvalidValue
from library.values import check_text
from models.demonstration import Demonstration
from models.options import LearningOptions
from models.report import AlignedDemonstration
from opcua_skill.configuration.settings import Limits
from opcua_skill.stack.services.calls import Refused
from opcua_skill.stack.transport.decoding import MANY
from opcua_skill.wire.refusals import Code, out_of_range

NEEDED = 2
UNIT_TOLERANCE = 0.01
NO_TIME = datetime(1601, 1, 1, tzinfo=UTC)
FAILURE_NUMBERS = {failure: number for number, failure in enumerate(Failure)}


@dataclass(frozen=True)
class ReceivedDemonstrations:
    """Demonstrations as they came in; ``faults`` has one entry each: empty, or why it cannot be used."""

    usable: tuple[Demonstration, ...]
    faults: tuple[str, ...]
    ids: tuple[str, ...]


def _moment(value: datetime | None) -> datetime | None:
    if value is None or value.year <= NO_TIME.year:
        return None
    return value.replace(tzinfo=UTC) if value.tzinfo is None else value


def wire_moment(value: datetime | None) -> datetime:
    """Return a DateTime for the wire; OPC UA's zero when there is none."""
    return value or NO_TIME


def received_demonstrations(given: Sequence[Any], limits: Limits) -> ReceivedDemonstrations:
    """Check what arrived. A bad demonstration is set aside with its reason; fewer than two good ones are refused."""
    if len(given) > limits.max_demonstrations:
        raise Refused(
            Code.BadRequestTooLarge,
            f"{len(given)} demonstrations were sent, {limits.max_demonstrations} are allowed in one call",
        )
    longest = max((len(item.Times) for item in given), default=0)
    if longest > limits.max_points_per_demonstration:
        raise Refused(
            Code.BadRequestTooLarge,
            f"a demonstration has {longest} samples, {limits.max_points_per_demonstration} are allowed",
        )
    usable: list[Demonstration] = []
    faults: list[str] = []
    ids: list[str] = []
    for place, item in enumerate(given, start=1):
        name = item.DemonstrationId or f"demonstration-{place}"
        fault = "its DemonstrationId was used before" if name in ids else _fault(item)
        ids.append(name)
        faults.append(fault)
        if not fault:
            usable.append(_demonstration(name, item))
    dimensions = [one.dimension for one in usable]
    if dimensions:
        common = max(set(dimensions), key=dimensions.count)
        for one in usable:
            if one.dimension != common:
                faults[ids.index(one.demonstration_id)] = f"it has {one.dimension} dimensions, the others have {common}"
        usable = [one for one in usable if one.dimension == common]
    if len(usable) < NEEDED:
        first = next(((name, fault) for name, fault in zip(ids, faults, strict=True) if fault), None)
        detail = f"; {first[0]}: {first[1]}" if first else ""
        raise out_of_range("Demonstrations", f"{NEEDED} usable demonstrations are needed, {len(usable)} came{detail}")
    return ReceivedDemonstrations(tuple(usable), tuple(faults), tuple(ids))


def _fault(item: Any) -> str:
    if item.Dimension not in (2, 3):
        return f"Dimension is {item.Dimension}: it has to be 2 or 3"
    samples = len(item.Times)
    if samples < NEEDED:
        return f"{NEEDED} samples are needed, it has {samples}"
    if len(item.Positions) != samples * item.Dimension:
        return f"{samples} times need {samples * item.Dimension} position values, {len(item.Positions)} were sent"
    if len(item.Triggers) not in (0, samples):
        return f"{samples} times need {samples} triggers or none, {len(item.Triggers)} were sent"
    times, positions = np.array(item.Times, dtype=np.float64), np.array(item.Positions, dtype=np.float64)
    if not np.isfinite(times).all() or not np.isfinite(positions).all():
        return "it holds NaN or infinity"
    if not (np.diff(times) > 0).all():
        return f"its times do not increase at sample {int(np.argmin(np.diff(times) > 0)) + 1}"
    if fault := _orientation_fault(_orientations(item), samples):
        return fault
    try:
        for field in ("DemonstrationId", "Operator", "Source"):
            check_text(getattr(item, field), field, 512)
    except InvalidValue as error:
        return str(error)
    return ""


def _orientations(item: Any) -> Sequence[float]:
    """Return the quaternions that only a `PoseDemonstrationDataType` carries, flat."""
    return getattr(item, "Orientations", ())


def _orientation_fault(flat: Sequence[float], samples: int) -> str:
    if not len(flat):
        return ""
    if len(flat) != 4 * samples:
        return (
            f"{samples} samples need {4 * samples} values of orientation (x y z w each) or none, {len(flat)} were sent"
        )
    quaternions = np.array(flat, dtype=np.float64).reshape(samples, 4)
    if not np.isfinite(quaternions).all():
        return "its orientations hold NaN or infinity"
    lengths = np.sqrt((quaternions * quaternions).sum(axis=1))
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > UNIT_TOLERANCE)
    if len(wrong):
        return f"its orientation at sample {wrong[0]} has length {lengths[wrong[0]]:.3g}: a unit quaternion has 1"
    return ""


def _demonstration(name: str, item: Any) -> Demonstration:
    turned = _orientations(item)
    times = np.array(item.Times, dtype=np.float64)
    triggers = np.array(item.Triggers, dtype=bool) if item.Triggers else np.ones(len(times), dtype=bool)
    return Demonstration(
        demonstration_id=name,
        times=times - times[0],
        points=np.array(item.Positions, dtype=np.float64).reshape(len(times), item.Dimension),
        triggers=triggers,
        operator=item.Operator,
        source=item.Source,
        recorded_at=_moment(item.RecordedAt),
        orientations=np.array(turned, dtype=np.float64).reshape(len(times), 4) if len(turned) else None,
    )


def flat(values: np.ndarray) -> Any:
    """Return numbers row-major: a few as a list, many as the array itself, which costs no object for each."""
    plain = np.ascontiguousarray(values).ravel()
    return plain if plain.size > MANY else plain.tolist()


def wire_demonstration(one: Demonstration) -> Any:
    """Return a recording as it goes over the wire, with the tool's orientation where it was recorded."""
    fields: dict[str, Any] = {
        "DemonstrationId": one.demonstration_id,
        "Dimension": one.dimension,
        "Times": flat(one.times),
        "Positions": flat(one.points),
        "Triggers": flat(one.triggers),
        "Operator": one.operator,
        "Source": one.source,
        "RecordedAt": wire_moment(one.recorded_at),
    }
    if one.orientations is None:
        return ua.DemonstrationDataType(**fields)  # type: ignore[attr-defined]
    turned = flat(one.orientations)
    return ua.PoseDemonstrationDataType(**fields, Orientations=turned)  # type: ignore[attr-defined]


def wire_aligned(one: AlignedDemonstration) -> Any:
    """Return an aligned demonstration: resampled on the common clock."""
    return ua.DemonstrationDataType(  # type: ignore[attr-defined]
        DemonstrationId=one.demonstration_id,
        Dimension=one.points.shape[1],
        Times=flat(one.times),
        Positions=flat(one.points),
        Triggers=flat(one.triggers),
        Operator="",
        Source="aligned",
        RecordedAt=NO_TIME,
    )


def learning_options(given: Any) -> LearningOptions:
    """Return the options, or refuse what is not finite, not known or out of range."""
    if not (np.isfinite(given.FilterWindow) and np.isfinite(given.TimeStep)):
        raise out_of_range("Options", "FilterWindow and TimeStep have to be finite")
    return LearningOptions(
        preset=given.Preset or "recommended",
        components=given.Components,
        filter_window=given.FilterWindow,
        alignment=given.Alignment,  # type: ignore[arg-type]
        radius=given.Radius,
        clock=given.Clock,  # type: ignore[arg-type]
        reject_outliers=given.RejectOutliers,
        time_step=given.TimeStep,
        seed=given.Seed,
    )


def wire_summary(one: SkillSummary) -> Any:
    """Return one line of FindSkills."""
    return ua.SkillSummaryDataType(  # type: ignore[attr-defined]
        Name=one.name,
        Version=one.version,
        SemanticType=one.semantic_type,
        State=one.state.value,
        ModelDigest=bytes.fromhex(one.model_digest),
        CreatedAt=one.created_at,
        CreatedBy=one.created_by,
        Workstations=list(one.workstations),
    )


def recipe(given: Any) -> Recipe:
    """Return a recipe; raises InvalidValue naming the field."""
    return Recipe(
        recipe_id=given.RecipeId,
        skill_name=given.SkillName,
        skill_version=given.SkillVersion,
        product=given.Product,
        time_step=given.TimeStep,
        timing=given.Timing or "demonstrated",
        duration=given.Duration,
        speed=given.Speed,
        speed_override=given.SpeedOverride,
        frame=tuple(given.Frame),
        standoff=given.Standoff,
        approach_height=given.ApproachHeight,
        retract_height=given.RetractHeight,
        dispense_lead=given.DispenseLead,
        max_deviation=given.MaxDeviation,
        parameters={pair.Key.Name: _parameter(pair) for pair in given.Parameters},
    )


def _parameter(pair: Any) -> float | str:
    value = pair.Value.Value if isinstance(pair.Value, ua.Variant) else pair.Value
    if isinstance(value, str):
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    raise InvalidValue(f"parameters.{pair.Key.Name}", value, "a parameter is a number or a text")


def wire_recipe(one: Recipe) -> Any:
    """Return a recipe as it goes over the wire."""
    return ua.RecipeDataType(  # type: ignore[attr-defined]
        RecipeId=one.recipe_id,
        SkillName=one.skill_name,
        SkillVersion=one.skill_version,
        Product=one.product,
        TimeStep=one.time_step,
        Timing=one.timing,
        Duration=one.duration,
        Speed=one.speed,
        SpeedOverride=one.speed_override,
        Frame=list(one.frame),
        Standoff=one.standoff,
        ApproachHeight=one.approach_height,
        RetractHeight=one.retract_height,
        DispenseLead=one.dispense_lead,
        MaxDeviation=one.max_deviation,
        Parameters=[
            ua.KeyValuePair(
                ua.QualifiedName(name),
                ua.Variant(value, ua.VariantType.String if isinstance(value, str) else ua.VariantType.Double),
            )
            for name, value in one.parameters.items()
        ],
    )


def wire_report(one: JobReport) -> Any:
    """Return a job report as it goes over the wire."""
    return ua.JobReportDataType(  # type: ignore[attr-defined]
        JobId=one.job_id,
        Kind=one.kind,
        State=one.state.value,
        Progress=one.progress,
        SkillName=one.skill_name,
        SkillVersion=one.skill_version,
        RecipeId=one.recipe_id,
        Mode=one.mode,
        StartTime=wire_moment(one.start_time),
        EndTime=wire_moment(one.end_time),
        Failure=ua.SkillFailure(FAILURE_NUMBERS[one.failure]),  # type: ignore[attr-defined]
        Message=one.message,
        PathError=list(one.path_error),
        TrackingError=list(one.tracking_error),
        Samples=one.samples,
        Cause=one.cause.value,
        PathPhase=_or_nan(one.path_phase),
        Place=_or_nan(one.place),
        PlanDigest=one.plan_digest,
        SlowedTo=one.slowed_to,
        HeldQueue=one.held_queue,
        PausedFrom=list(one.paused_from),
        PausedUntil=list(one.paused_until),
    )


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def audit_value(value: Any) -> Any:
    """Return an argument as it is kept in the audit trail: JSON, long arrays and texts only counted."""
    if isinstance(value, bytes):
        return value.hex() if len(value) <= 64 else f"{len(value)} bytes"
    if isinstance(value, str):
        if len(value) > 500:
            return f"{len(value)} characters"
        return value.encode("utf-8", "backslashreplace").decode("utf-8").replace("\x00", "\\0")
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, list | tuple | array):
        return [audit_value(item) for item in value] if len(value) <= 16 else f"{len(value)} values"
    fields: Iterable[str] = getattr(value, "__dataclass_fields__", ())
    if fields:
        return {name: audit_value(getattr(value, name)) for name in fields}
    return str(value)[:200]

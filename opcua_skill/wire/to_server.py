"""Frozen values to OPC UA structures and back. Structure classes come from the server's own type definitions."""

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from asyncua import ua

from models.demonstration import Demonstration
from opcua_skill.wire.values import MODES, AuditEntry, Failure, JobReport, LearningOptions, Recipe, SkillSummary

Structures = Callable[[str], type]
OPC_UA_EPOCH = datetime(1601, 1, 1, tzinfo=UTC)


def string(value: str) -> ua.Variant:
    """Return a String variant."""
    return ua.Variant(value, ua.VariantType.String)


def uint32(value: int) -> ua.Variant:
    """Return a UInt32 variant."""
    return ua.Variant(value, ua.VariantType.UInt32)


def uint64(value: int) -> ua.Variant:
    """Return a UInt64 variant."""
    return ua.Variant(value, ua.VariantType.UInt64)


def int32(value: int) -> ua.Variant:
    """Return an Int32 variant."""
    return ua.Variant(value, ua.VariantType.Int32)


def double(value: float) -> ua.Variant:
    """Return a Double variant."""
    return ua.Variant(value, ua.VariantType.Double)


def byte_string(value: bytes) -> ua.Variant:
    """Return a ByteString variant."""
    return ua.Variant(value, ua.VariantType.ByteString)


def uint32_array(values: Sequence[int]) -> ua.Variant:
    """Return a UInt32[] variant, also for no values."""
    return ua.Variant([int(value) for value in values], ua.VariantType.UInt32, is_array=True)


def structure(value: Any) -> ua.Variant:
    """Return a variant of one structure."""
    return ua.Variant(value, ua.VariantType.ExtensionObject)


def structure_array(values: Sequence[Any]) -> ua.Variant:
    """Return a variant of an array of structures, also for no values."""
    return ua.Variant(list(values), ua.VariantType.ExtensionObject, is_array=True)


def moment(value: Any) -> datetime | None:
    """Return a DateTime as seen by a client, None for the null date."""
    if not isinstance(value, datetime):
        return None
    aware = value if value.tzinfo else value.replace(tzinfo=UTC)
    return aware if aware.year > OPC_UA_EPOCH.year else None


def moments(values: Any) -> tuple[datetime, ...]:
    """Return the DateTimes of an array, all of them real ones."""
    return tuple(one for one in map(moment, values or ()) if one is not None)


def identifier(node: ua.NodeId) -> str:
    """Return the identifier of a node in hex, or as text where it is none of bytes."""
    value = node.Identifier
    return value.hex() if isinstance(value, bytes) else str(value)


def demonstration_out(structures: Structures, value: Demonstration) -> Any:
    """Return a `DemonstrationDataType`, or a `PoseDemonstrationDataType` where the tool's orientation was recorded.

    A push button that was always on is sent empty.
    """
    fields: dict[str, Any] = {
        "DemonstrationId": value.demonstration_id,
        "Dimension": value.dimension,
        "Times": np.asarray(value.times, dtype=np.float64).tolist(),
        "Positions": np.asarray(value.points, dtype=np.float64).ravel().tolist(),
        "Triggers": [] if bool(np.all(value.triggers)) else np.asarray(value.triggers, dtype=bool).tolist(),
        "Operator": value.operator,
        "Source": value.source,
        "RecordedAt": value.recorded_at or OPC_UA_EPOCH,
    }
    if value.orientations is None:
        return structures("DemonstrationDataType")(**fields)
    orientations = np.asarray(value.orientations, dtype=np.float64).ravel().tolist()
    return structures("PoseDemonstrationDataType")(**fields, Orientations=orientations)


def size_of(value: Demonstration) -> int:
    """Return about how many bytes a demonstration takes in a message, rather too many than too few."""
    turned = 0 if value.orientations is None else value.orientations.size
    numbers = value.times.size + value.points.size + turned
    return 8 * numbers + np.size(value.triggers) + 8 * (len(value.demonstration_id) + len(value.operator)) + 1000


def demonstration_in(value: Any) -> Demonstration:
    """Return the `Demonstration` in a `DemonstrationDataType` or a subtype of it."""
    turned = getattr(value, "Orientations", None)
    times = np.asarray(value.Times, dtype=np.float64)
    triggers = np.asarray(value.Triggers, dtype=bool) if value.Triggers else np.ones(len(times), dtype=bool)
    return Demonstration(
        demonstration_id=value.DemonstrationId or "",
        times=times,
        points=np.asarray(value.Positions, dtype=np.float64).reshape(len(times), int(value.Dimension)),
        triggers=triggers,
        operator=value.Operator or "",
        source=value.Source or "",
        recorded_at=moment(value.RecordedAt),
        orientations=np.asarray(turned, dtype=np.float64).reshape(len(times), 4) if turned else None,
    )


def options_out(structures: Structures, value: LearningOptions) -> Any:
    """Return a `LearningOptionsDataType`."""
    return structures("LearningOptionsDataType")(
        Preset=value.preset,
        Components=value.components,
        FilterWindow=value.filter_window,
        Alignment=value.alignment,
        Radius=value.radius,
        Clock=value.clock,
        RejectOutliers=value.reject_outliers,
        TimeStep=value.time_step,
        Seed=value.seed,
    )


def recipe_out(structures: Structures, value: Recipe) -> Any:
    """Return a `RecipeDataType`."""
    return structures("RecipeDataType")(
        RecipeId=value.recipe_id,
        SkillName=value.skill_name,
        SkillVersion=value.skill_version,
        Product=value.product,
        TimeStep=value.time_step,
        Timing=value.timing,
        Duration=value.duration,
        Speed=value.speed,
        SpeedOverride=value.speed_override,
        Frame=[float(part) for part in value.frame],
        Standoff=value.standoff,
        ApproachHeight=value.approach_height,
        RetractHeight=value.retract_height,
        DispenseLead=value.dispense_lead,
        MaxDeviation=value.max_deviation,
        Parameters=[
            ua.KeyValuePair(
                Key=ua.QualifiedName(name), Value=string(given) if isinstance(given, str) else double(given)
            )
            for name, given in value.parameters.items()
        ],
    )


def recipe_in(value: Any) -> Recipe:
    """Return the `Recipe` in a `RecipeDataType`."""
    return Recipe(
        recipe_id=value.RecipeId,
        skill_name=value.SkillName,
        skill_version=int(value.SkillVersion),
        product=value.Product or "",
        time_step=value.TimeStep,
        timing=value.Timing,
        duration=value.Duration,
        speed=value.Speed,
        speed_override=value.SpeedOverride,
        frame=tuple(value.Frame),
        standoff=value.Standoff,
        approach_height=value.ApproachHeight,
        retract_height=value.RetractHeight,
        dispense_lead=value.DispenseLead,
        max_deviation=value.MaxDeviation,
        parameters={pair.Key.Name: pair.Value.Value for pair in value.Parameters or ()},
    )


def summary_in(value: Any) -> SkillSummary:
    """Return the `SkillSummary` in a `SkillSummaryDataType`."""
    digest = value.ModelDigest
    return SkillSummary(
        name=value.Name,
        version=int(value.Version),
        semantic_type=value.SemanticType or "",
        state=value.State,
        model_digest=bytes.fromhex(digest) if isinstance(digest, str) else bytes(digest or b""),
        created_at=moment(value.CreatedAt),
        created_by=value.CreatedBy or "",
        workstations=tuple(value.Workstations or ()),
    )


def job_in(value: Any) -> JobReport:
    """Return the `JobReport` in a `JobReportDataType`."""
    return JobReport(
        job_id=value.JobId,
        kind=value.Kind,
        state=value.State,
        progress=float(value.Progress),
        skill_name=value.SkillName or "",
        skill_version=int(value.SkillVersion),
        recipe_id=value.RecipeId or "",
        mode=MODES[value.Mode] if isinstance(value.Mode, int) else value.Mode or "",
        start_time=moment(value.StartTime),
        end_time=moment(value.EndTime),
        failure=tuple(Failure)[int(value.Failure)],
        message=value.Message or "",
        path_error=pair(value.PathError),
        tracking_error=pair(value.TrackingError),
        samples=int(value.Samples),
        cause=value.Cause or "",
        path_phase=float(value.PathPhase),
        place=float(value.Place),
        plan_digest=value.PlanDigest or "",
        slowed_to=float(value.SlowedTo),
        held_queue=bool(value.HeldQueue),
        paused_from=moments(value.PausedFrom),
        paused_until=moments(value.PausedUntil),
    )


def audit_entry_in(value: Any) -> AuditEntry:
    """Return the `AuditEntry` in an `AuditEntryDataType`."""
    return AuditEntry(
        entry_id=int(value.EntryId),
        at=moment(value.At),
        actor=value.Actor or "",
        role=value.Role or "",
        action=value.Action or "",
        target=value.Target or "",
        arguments=document(value.Arguments),
        status=value.Status or "",
        reason=value.Reason or "",
    )


def pair(values: Any) -> tuple[float, float]:
    """Return RMS and maximum; NaN for what has not been measured."""
    given = [float(value) for value in values or ()]
    return (given[0], given[1]) if len(given) == 2 else (float("nan"), float("nan"))


def matrix(flat: Any, rows: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a flat row-major array as (rows, columns)."""
    return np.asarray(flat or [], dtype=np.float64).reshape(rows, -1) if rows else np.zeros((0, 0))


def document(text: str | None) -> Mapping[str, Any]:
    """Return a JSON text as a mapping, empty for no text."""
    return json.loads(text) if text else {}

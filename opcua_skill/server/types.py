"""Our type namespace: structures that cross the wire, object types, event types, as docs/interface.md names them."""

from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.common.structures104 import new_enum_field, new_struct_field
from asyncua.ua.object_ids import ObjectIds

from library.description import Failure
from opcua_skill.server.address_space import Tree, standard
from opcua_skill.server.members import declare_members
from opcua_skill.wire.from_client import NO_TIME

STRING = standard(ObjectIds.String)
BOOLEAN = standard(ObjectIds.Boolean)
BYTE = standard(ObjectIds.Byte)
UINT16 = standard(ObjectIds.UInt16)
UINT32 = standard(ObjectIds.UInt32)
UINT64 = standard(ObjectIds.UInt64)
INT32 = standard(ObjectIds.Int32)
DOUBLE = standard(ObjectIds.Double)
DATE_TIME = standard(ObjectIds.DateTime)
BYTE_STRING = standard(ObjectIds.ByteString)
STATUS_CODE = standard(ObjectIds.StatusCode)
KEY_VALUE_PAIR = standard(ObjectIds.KeyValuePair)


@dataclass(frozen=True)
class Field:
    """A field of a structure: name, data type, whether it is an array, and what it means."""

    name: str
    data_type: ua.NodeId
    array: bool = False
    description: str = ""


DEMONSTRATION = (
    Field("DemonstrationId", STRING, description="unique among the demonstrations of one call"),
    Field("Dimension", BYTE, description="2 or 3"),
    Field("Times", DOUBLE, array=True, description="s, strictly increasing"),
    Field("Positions", DOUBLE, array=True, description="m, row-major, Dimension values a sample"),
    Field("Triggers", BOOLEAN, array=True, description="push button; empty: always on"),
    Field("Operator", STRING, description="who demonstrated"),
    Field("Source", STRING, description="tracker or file"),
    Field("RecordedAt", DATE_TIME, description="when it was recorded"),
)
POSE_DEMONSTRATION = (
    *DEMONSTRATION,
    Field(
        "Orientations",
        DOUBLE,
        array=True,
        description="unit quaternions of the tool in the part's frame, row-major, x y z w a sample; empty: none",
    ),
)
LEARNING_OPTIONS = (
    Field("Preset", STRING, description="recommended, free or paper; empty: recommended"),
    Field("Components", UINT16, description="0: choose"),
    Field("FilterWindow", DOUBLE, description="s; 0: the preset's"),
    Field("Alignment", STRING, description="dtw or fastdtw; empty: the preset's"),
    Field("Radius", UINT16, description="of fastdtw; 0: the preset's"),
    Field("Clock", STRING, description="path or time; empty: the preset's"),
    Field("RejectOutliers", BOOLEAN, description="leave out demonstrations unlike the others"),
    Field("TimeStep", DOUBLE, description="s, of the reported path; 0: the preset's"),
    Field("Seed", UINT32, description="of random numbers, where an option uses any"),
)
DEMONSTRATION_EDITS = (
    Field("DemonstrationId", STRING, description="a recording of the version"),
    Field("Excluded", BOOLEAN, description="leave it out altogether"),
    Field("Struck", UINT32, array=True, description="samples of the recording to leave out"),
)
SKILL_SUMMARY = (
    Field("Name", STRING),
    Field("Version", UINT32),
    Field("SemanticType", STRING),
    Field("State", STRING, description="Learned, Approved, Rejected or Retired"),
    Field("ModelDigest", BYTE_STRING, description="SHA-256"),
    Field("CreatedAt", DATE_TIME),
    Field("CreatedBy", STRING),
    Field("Workstations", STRING, array=True, description="where this version is deployed"),
)
RECIPE = (
    Field("RecipeId", STRING),
    Field("SkillName", STRING),
    Field("SkillVersion", UINT32, description="0: the deployed one"),
    Field("Product", STRING),
    Field("TimeStep", DOUBLE, description="s"),
    Field("Timing", STRING, description="demonstrated, constant_speed or time_optimal"),
    Field("Duration", DOUBLE, description="s; 0: as learned"),
    Field("Speed", DOUBLE, description="m/s, for constant_speed"),
    Field("SpeedOverride", DOUBLE, description="above 0, up to 1"),
    Field("Frame", DOUBLE, array=True, description="part in the arm's base: x y z (m) qx qy qz qw"),
    Field("Standoff", DOUBLE, description="m"),
    Field("ApproachHeight", DOUBLE, description="m"),
    Field("RetractHeight", DOUBLE, description="m"),
    Field("DispenseLead", DOUBLE, description="s"),
    Field("MaxDeviation", DOUBLE, description="m"),
    Field("Parameters", KEY_VALUE_PAIR, array=True, description="parameters of the process"),
)
AUDIT_ENTRY = (
    Field("EntryId", UINT64, description="rises with every entry"),
    Field("At", DATE_TIME, description="when it was asked for"),
    Field("Actor", STRING, description="who asked"),
    Field("Role", STRING, description="the role they had"),
    Field("Action", STRING, description="the method, or SignIn"),
    Field("Target", STRING, description="the object it was called on, or where a sign-in came from"),
    Field("Arguments", STRING, description="JSON; long ones are shortened"),
    Field("Status", STRING, description="name of the status code"),
    Field("Reason", STRING, description="why not, in a sentence; empty: done"),
)
FAILURES = tuple(failure.value for failure in Failure)


def _job_report(failure: ua.NodeId) -> tuple[Field, ...]:
    return (
        Field("JobId", STRING),
        Field("Kind", STRING, description="Learning or Execution"),
        Field("State", STRING, description="Queued, Running, Paused, Stopping, Completed, Failed or Aborted"),
        Field("Progress", DOUBLE, description="0..1"),
        Field("SkillName", STRING),
        Field("SkillVersion", UINT32),
        Field("RecipeId", STRING),
        Field("Mode", STRING, description="simulation, test or production; empty for learning"),
        Field("StartTime", DATE_TIME),
        Field("EndTime", DATE_TIME),
        Field("Failure", failure),
        Field("Message", STRING),
        Field("PathError", DOUBLE, array=True, description="m: RMS and maximum, commanded against the learned path"),
        Field("TrackingError", DOUBLE, array=True, description="m: RMS and maximum, measured against commanded"),
        Field("Samples", UINT32, description="time steps commanded"),
        Field("Cause", STRING, description="what ended, paused or refused it, as HeldBecause of a queue; empty: fine"),
        Field("PathPhase", DOUBLE, description="0..1, where on the path; NaN off it"),
        Field("Place", DOUBLE, description="m along the path; NaN off it"),
        Field("PlanDigest", STRING, description="SHA-256 of the plan in hex; empty: there is none"),
        Field("SlowedTo", DOUBLE, description="m/s, the least speed the path was slowed to; 0: it was not"),
        Field("HeldQueue", BOOLEAN, description="its end held the queue; of one that waits: the queue is held"),
        Field("PausedFrom", DATE_TIME, array=True, description="when the run came to stand still"),
        Field("PausedUntil", DATE_TIME, array=True, description="when it went on; one less than PausedFrom: not yet"),
    )


OBJECT_TYPES: tuple[tuple[str, int, str], ...] = (
    ("SkillLibraryType", ObjectIds.BaseObjectType, "learned skills: versions, approvals, recipes"),
    ("LibraryLimitsType", ObjectIds.BaseObjectType, "what one client may ask for at once"),
    ("WorkstationType", ObjectIds.BaseObjectType, "an arm, its process equipment, and the skills deployed on them"),
    (
        "EquipmentType",
        ObjectIds.BaseObjectType,
        "an arm or process equipment, and the atomic skills it gives",
    ),
    ("AtomicSkillType", ObjectIds.BaseObjectType, "something equipment can do, with typed parameters"),
    ("SkillType", ObjectIds.ProgramStateMachineType, "a learned skill as deployed on a workstation"),
    ("ArmType", ObjectIds.BaseObjectType, "the state of an arm"),
    ("QueueType", ObjectIds.BaseObjectType, "the jobs that wait for an arm, and whether the next one may begin"),
    ("RecorderType", ObjectIds.BaseObjectType, "takes what a tracker sees, and cuts it into demonstrations"),
)
EVENT_TYPES: tuple[tuple[str, str, tuple[tuple[str, ua.VariantType], ...]], ...] = (
    (
        "LearningFinishedEventType",
        "a learning job has ended",
        (
            ("JobId", ua.VariantType.String),
            ("State", ua.VariantType.String),
            ("SkillName", ua.VariantType.String),
            ("SkillVersion", ua.VariantType.UInt32),
        ),
    ),
    (
        "SkillVersionStateEventType",
        "a version was learned, approved, rejected or retired",
        (
            ("SkillName", ua.VariantType.String),
            ("SkillVersion", ua.VariantType.UInt32),
            ("State", ua.VariantType.String),
            ("ModelDigest", ua.VariantType.ByteString),
            ("Actor", ua.VariantType.String),
            ("Comment", ua.VariantType.String),
        ),
    ),
    (
        "DeploymentEventType",
        "a version was deployed on a workstation or withdrawn from it",
        (
            ("SkillName", ua.VariantType.String),
            ("SkillVersion", ua.VariantType.UInt32),
            ("Workstation", ua.VariantType.String),
            ("Deployed", ua.VariantType.Boolean),
            ("Actor", ua.VariantType.String),
        ),
    ),
    (
        "JobStateEventType",
        "a job has changed its state",
        (
            ("JobId", ua.VariantType.String),
            ("Kind", ua.VariantType.String),
            ("State", ua.VariantType.String),
            ("Progress", ua.VariantType.Double),
            ("SkillName", ua.VariantType.String),
            ("SkillVersion", ua.VariantType.UInt32),
            ("RecipeId", ua.VariantType.String),
            ("Workstation", ua.VariantType.String),
            ("Failure", ua.VariantType.Int32),
        ),
    ),
    (
        "QueueEventType",
        "a workstation's queue was held or released, or has another number of jobs waiting",
        (
            ("Workstation", ua.VariantType.String),
            ("State", ua.VariantType.String),
            ("HeldBecause", ua.VariantType.String),
            ("HeldBy", ua.VariantType.String),
            ("HeldSince", ua.VariantType.DateTime),
            ("Waiting", ua.VariantType.UInt32),
        ),
    ),
    (
        "ProtectiveStopEventType",
        "an arm was stopped",
        (("Workstation", ua.VariantType.String), ("Reason", ua.VariantType.String), ("Actor", ua.VariantType.String)),
    ),
)


async def _structure(tree: Tree, name: str, fields: tuple[Field, ...], base: str = "") -> ua.NodeId:
    """Add a structure with its binary encoding; ``base`` is the structure whose fields ``fields`` begin with."""
    server = tree.server
    above = server.get_node(tree.type_id(base)) if base else server.nodes.base_structure_type
    data_type = await above.add_data_type(tree.type_id(name), tree.name(name))
    encoding = tree.type_id(f"{name}/Default Binary")
    attributes = ua.ObjectAttributes()
    attributes.DisplayName = ua.LocalizedText("Default Binary")
    item = ua.AddNodesItem()
    item.RequestedNewNodeId, item.ParentNodeId = encoding, data_type.nodeid
    item.BrowseName = ua.QualifiedName("Default Binary", 0)
    item.NodeClass = ua.NodeClass.Object
    item.ReferenceTypeId = standard(ObjectIds.HasEncoding)
    item.TypeDefinition = standard(ObjectIds.DataTypeEncodingType)
    item.NodeAttributes = attributes
    server.iserver.node_mgt_service.add_nodes([item])[0].StatusCode.check()
    definition = ua.StructureDefinition()
    definition.StructureType = ua.StructureType.Structure
    definition.BaseDataType = above.nodeid
    definition.DefaultEncodingId = encoding
    definition.Fields = [
        new_struct_field(field.name, field.data_type, array=field.array, description=field.description)
        for field in fields
    ]
    for field in definition.Fields:
        if field.ValueRank == ua.ValueRank.OneDimension:
            field.ArrayDimensions = [ua.UInt32(0)]
    await data_type.write_data_type_definition(definition)
    return data_type.nodeid


async def _enumeration(tree: Tree, name: str, values: tuple[str, ...]) -> ua.NodeId:
    """Add an enumeration with its EnumStrings, as OPC 10000-3 asks of consecutive values."""
    definition = ua.EnumDefinition()
    for value, text in enumerate(values):
        field = new_enum_field(text)
        field.Value = ua.Int64(value)
        definition.Fields.append(field)
    data_type = await tree.server.nodes.enum_data_type.add_data_type(tree.type_id(name), tree.name(name))
    await data_type.write_data_type_definition(definition)
    tree.property(
        "EnumStrings",
        data_type.nodeid,
        ua.Variant([ua.LocalizedText(text) for text in values], ua.VariantType.LocalizedText, is_array=True),
        node_id=tree.type_id(f"{name}/EnumStrings"),
        name=ua.QualifiedName("EnumStrings", 0),
    )
    return data_type.nodeid


def _event_type(tree: Tree, name: str, description: str, fields: tuple[tuple[str, ua.VariantType], ...]) -> None:
    node_id = tree.object_type(name, standard(ObjectIds.BaseEventType), description)
    for field, variant_type in fields:
        member = tree.property(
            f"{name}/{field}",
            node_id,
            ua.Variant(_zero(variant_type), variant_type),
            node_id=tree.type_id(f"{name}/{field}"),
            name=tree.name(field),
        )
        tree.make_mandatory(member)


def _zero(variant_type: ua.VariantType) -> Any:
    return {
        ua.VariantType.String: "",
        ua.VariantType.ByteString: b"",
        ua.VariantType.Boolean: False,
        ua.VariantType.Double: 0.0,
        ua.VariantType.DateTime: NO_TIME,
    }.get(variant_type, 0)


async def add_types(tree: Tree) -> None:
    """Add every type; afterwards `ua.DemonstrationDataType` and its siblings exist for this server's decoder."""
    failure = await _enumeration(tree, "SkillFailure", FAILURES)
    for name, fields in (
        ("DemonstrationDataType", DEMONSTRATION),
        ("LearningOptionsDataType", LEARNING_OPTIONS),
        ("DemonstrationEditsDataType", DEMONSTRATION_EDITS),
        ("SkillSummaryDataType", SKILL_SUMMARY),
        ("RecipeDataType", RECIPE),
        ("JobReportDataType", _job_report(failure)),
        ("AuditEntryDataType", AUDIT_ENTRY),
    ):
        await _structure(tree, name, fields)
    await _structure(tree, "PoseDemonstrationDataType", POSE_DEMONSTRATION, base="DemonstrationDataType")
    await tree.server.load_data_type_definitions()
    for name, base, description in OBJECT_TYPES:
        tree.object_type(name, standard(base), description)
    declare_members(tree)
    for name, description, event_fields in EVENT_TYPES:
        _event_type(tree, name, description, event_fields)

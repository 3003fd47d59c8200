"""What our object types declare: every member that their instances have, so that generated clients can reach it."""

from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.configuration.atomic_skills import KNOWN
from opcua_skill.server.address_space import Tree, standard
from opcua_skill.server.units import BYTE, METRE, ONE, RADIAN, SECOND, Unit, joint_units, measured

LOCKING_SERVICES, MACHINE_IDENTIFICATION = 6388, 1012
_T = ua.VariantType
_BLANK: dict[ua.VariantType, Any] = {
    _T.String: "",
    _T.Boolean: False,
    _T.Double: 0.0,
    _T.ByteString: b"",
}


@dataclass(frozen=True, slots=True)
class Member:
    """A variable or property of a type. ``unit`` makes it one with unit and range; ``optional``: not all have it."""

    name: str
    kind: ua.VariantType
    description: str = ""
    array: bool = False
    is_property: bool = False
    optional: bool = False
    writable: bool = False
    unit: Unit | None = None
    span: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Part:
    """An object of a type. ``type_name`` is one of ours, empty: a folder; ``each``: the type of what it holds."""

    name: str
    type_name: str = ""
    each: str = ""


def _properties(kind: ua.VariantType, *names: str, array: bool = False, optional: bool = False) -> tuple[Member, ...]:
    return tuple(Member(name, kind, array=array, is_property=True, optional=optional) for name in names)


_JOINTS = ("JointPositionMinimum", "JointPositionMaximum", "JointVelocityMaximum", "JointAccelerationMaximum")
_JOINT_UNITS = joint_units([False])
MEMBERS: dict[str, tuple[Member, ...]] = {
    "SkillLibraryType": (
        *_properties(
            _T.String, "Presets", "Faults", "FaultKinds", "Insecure", "LeasedWorkstations", "LeasedBy", array=True
        ),
        *_properties(_T.Boolean, "FourEyes"),
        *_properties(_T.UInt32, "Holds"),
        Member("LongestHold", _T.Double, "how long the event loop was held longest", unit=SECOND),
    ),
    "LibraryLimitsType": (
        *_properties(_T.UInt32, "MaxDemonstrations", "MaxPointsPerDemonstration", "MaxQueuedJobs"),
        *_properties(_T.UInt32, "MaxTrajectorySamples", "MaxContentLength", "MaxPage"),
        Member("MaxMessageSize", _T.UInt32, "of one call", unit=BYTE),
        Member("MaxAnswerSize", _T.UInt32, "of one answer", unit=BYTE),
    ),
    "EquipmentType": (
        *_properties(_T.String, "Manufacturer", "Model"),
        *_properties(_T.String, "AtomicSkills", array=True),
        *(
            Member(name, _T.Double, "one value a joint", array=True, optional=True, unit=unit)
            for name, unit in zip((*_JOINTS, "JointJerkMaximum"), (_JOINT_UNITS[0], *_JOINT_UNITS), strict=True)
        ),
        *_properties(_T.String, "LinkNames", array=True, optional=True),
        *_properties(_T.Double, "LinkOrigins", "LinkAxes", "LinkCapsules", array=True, optional=True),
    ),
    "AtomicSkillType": tuple(
        Member(
            one.name,
            _T.Double,
            one.description,
            optional=True,
            unit=Unit(one.unit_code, one.unit or "1", one.unit or "one"),
            span=(one.low, one.high),
        )
        for one in {each.name: each for skill in KNOWN.values() for each in skill.parameters}.values()
    ),
    "SkillType": (
        *_properties(_T.String, "SemanticType"),
        *_properties(_T.String, "RequiredAtomicSkills", array=True),
        *_properties(_T.UInt32, "Version", "Components"),
        *_properties(_T.ByteString, "ModelDigest"),
        *_properties(_T.Byte, "Dimension"),
        Member("Means", _T.Double, "row-major", array=True),
        Member("Covariances", _T.Double, "row-major", array=True),
        Member("Progress", _T.Double, "of the run under way", unit=ONE, span=(0.0, 1.0)),
    ),
    "ArmType": (
        Member("Position", _T.Double, "joint positions", array=True, unit=RADIAN),
        Member("ToolPose", _T.Double, "x y z (m) qx qy qz qw in the base", array=True, unit=METRE),
        Member("Mode", _T.String, "what the arm is doing"),
        Member("AtRest", _T.Boolean, "nothing moves"),
        Member("Known", _T.Boolean, "false after a loss of contact, until Reset"),
        Member("Fault", _T.String, "what is wrong; empty: nothing"),
        Member("SpeedOverride", _T.Double, "fraction of the planned speed", writable=True, unit=ONE, span=(0.01, 1.0)),
    ),
    "RecorderType": (
        Member("Recording", _T.Boolean),
        Member("Trigger", _T.Boolean, writable=True),
        *(Member(name, _T.String) for name in ("RecordingId", "LastIgnored")),
        *(Member(name, _T.UInt32) for name in ("Samples", "DemonstrationCount", "Ignored")),
        *_properties(_T.UInt32, "MaxSamplesPerAppend", "MaxSamplesPerAnswer", "MaxSamplesPerFinish", "MaxSamples"),
    ),
}
PARTS: dict[str, tuple[Part, ...]] = {
    "SkillLibraryType": (Part("Limits", "LibraryLimitsType"),),
    "WorkstationType": (
        Part("Equipment", each="EquipmentType"),
        Part("AtomicSkills", each="AtomicSkillType"),
        Part("Skills", each="SkillType"),
        Part("Arm", "ArmType"),
        Part("Queue", "QueueType"),
        Part("Recorder", "RecorderType"),
    ),
}


def declare_members(tree: Tree) -> None:
    """Declare what instances of our types have, besides their methods."""
    for type_name, members in MEMBERS.items():
        for member in members:
            _declare(tree, type_name, member)
    for type_name, parts in PARTS.items():
        for part in parts:
            owner = _part(tree, tree.type_id(type_name), f"{type_name}/{part.name}", part.name, part.type_name)
            tree.make_mandatory(owner)
            if part.each:
                held = _part(tree, owner, f"{type_name}/{part.name}/<{part.each}>", f"<{part.each}>", part.each)
                tree.reference(held, standard(ObjectIds.ModellingRule_OptionalPlaceholder), ObjectIds.HasModellingRule)
    identification = tree.di_name("Identification")
    kind = tree.machinery(MACHINE_IDENTIFICATION)
    add_in = ObjectIds.HasAddIn
    for type_name, name, definition, reference in (
        ("WorkstationType", identification, kind, add_in),
        ("ArmType", tree.di_name("Lock"), tree.di(LOCKING_SERVICES), ObjectIds.HasComponent),
    ):
        place = f"{type_name}/{name.Name}"
        node = tree.object(
            place,
            tree.type_id(type_name),
            name=name,
            type_definition=definition,
            reference=reference,
            node_id=tree.type_id(place),
        )
        tree.make_mandatory(node)


def _part(tree: Tree, owner: ua.NodeId, place: str, name: str, type_name: str) -> ua.NodeId:
    definition = tree.type_id(type_name) if type_name else standard(ObjectIds.FolderType)
    return tree.object(place, owner, name=tree.name(name), type_definition=definition, node_id=tree.type_id(place))


def _declare(tree: Tree, type_name: str, member: Member) -> None:
    place, owner = f"{type_name}/{member.name}", tree.type_id(type_name)
    blank = [] if member.array else _BLANK.get(member.kind, 0)
    value = ua.Variant(blank, member.kind, is_array=member.array)
    options: dict[str, Any] = {
        "node_id": tree.type_id(place),
        "name": tree.name(member.name),
        "description": member.description,
        "writable": member.writable,
    }
    if member.unit is not None:
        node = measured(tree, place, owner, value, member.unit, member.span, **options)
    elif member.is_property:
        node = tree.property(place, owner, value, **options)
    else:
        node = tree.variable(place, owner, value, **options)
    if member.optional:
        tree.reference(node, standard(ObjectIds.ModellingRule_Optional), ObjectIds.HasModellingRule)
    else:
        tree.make_mandatory(node)

"""The face of a workstation: `Machines/<Workstation>` with all that stands there, and its methods."""

from importlib.metadata import version as installed_version
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.configuration.atomic_skills import SkillParameter, described, motions_of
from opcua_skill.configuration.settings import Workstation
from opcua_skill.security.access import Role
from opcua_skill.server.address_space import Tree, localized, number, numbers, standard, text, texts
from opcua_skill.server.features.library_nodes import (
    COMMENT,
    JOB_ID,
    OPERATORS,
    READERS,
    RECIPE_ID,
    SKILL,
    STATE,
    method,
)
from opcua_skill.server.features.links import add_links
from opcua_skill.server.features.skills import SkillNodes
from opcua_skill.server.features.workstation import WorkstationMethods
from opcua_skill.server.members import LOCKING_SERVICES, MACHINE_IDENTIFICATION
from opcua_skill.server.types import DOUBLE, INT32, STRING, UINT32
from opcua_skill.server.units import METRE, ONE, Unit, joint_units, measured
from opcua_skill.stack.address_space.events import make_notifier
from opcua_skill.stack.services.calls import Argument, MethodSpec, add_method
from sim.arm_model import ArmModel
from sim.drivers.preconditions import LOWEST_OVERRIDE
from sim.planning.kinematics import kinematics

MACHINES = 1001  # the folder Machines in the NodeSet of OPC 40001-1


def specs(tree: Tree, methods: WorkstationMethods) -> tuple[MethodSpec, ...]:
    """Return the methods of a workstation."""
    report = tree.type_id("JobReportDataType")
    return (
        method(
            "ExecuteSkill",
            methods.execute_skill,
            OPERATORS,
            (SKILL, RECIPE_ID, Argument("Mode", INT32, description="0 simulation, 1 test, 2 production")),
            (JOB_ID, STATE),
        ),
        method("PauseJob", methods.pause_job, OPERATORS, (JOB_ID, COMMENT), (STATE,), urgent=True),
        method("ResumeJob", methods.resume_job, OPERATORS, (JOB_ID, COMMENT), (STATE,)),
        method("AbortJob", methods.abort_job, OPERATORS, (JOB_ID, COMMENT), (STATE,), urgent=True),
        method("GetJob", methods.get_job, READERS, (JOB_ID,), (Argument("Report", report),), changes=False),
        method(
            "ListJobs",
            methods.list_jobs,
            READERS,
            (Argument("State", STRING, description="empty: any"), Argument("Limit", UINT32, description="0: most")),
            (Argument("Reports", report, 1),),
            changes=False,
        ),
        method(
            "GetTrace",
            methods.get_trace,
            READERS,
            (JOB_ID,),
            (
                Argument("Times", DOUBLE, 1, "s"),
                Argument("Commanded", DOUBLE, 1, "nozzle tip x y z in m, row-major"),
                Argument("Measured", DOUBLE, 1, "nozzle tip x y z in m, row-major"),
            ),
            changes=False,
        ),
        method(
            "GetJointTrace",
            methods.get_joint_trace,
            READERS,
            (JOB_ID,),
            (
                Argument("Times", DOUBLE, 1, "s"),
                Argument("Commanded", DOUBLE, 1, "joints in rad, row-major; empty: the run's joints were not kept"),
                Argument("Measured", DOUBLE, 1, "joints in rad, row-major; empty: the run's joints were not kept"),
            ),
            changes=False,
        ),
    )


def lock_specs(methods: WorkstationMethods) -> tuple[MethodSpec, ...]:
    """Return the methods of the DI Lock (OPC 10000-100)."""
    return (
        method(
            "InitLock",
            methods.init_lock,
            OPERATORS,
            (Argument("Context", STRING, description="who locks, in words"),),
            (Argument("InitLockStatus", INT32),),
        ),
        method("RenewLock", methods.renew_lock, OPERATORS, (), (Argument("RenewLockStatus", INT32),)),
        method("ExitLock", methods.exit_lock, OPERATORS, (), (Argument("ExitLockStatus", INT32),)),
        method("BreakLock", methods.break_lock, Role.ENGINEER.and_above, (), (Argument("BreakLockStatus", INT32),)),
    )


async def add_workstation(
    tree: Tree, settings: Workstation, model: ArmModel, methods: WorkstationMethods, installation: str
) -> SkillNodes:
    """Add one workstation to Machines; return the keeper of its deployed skills.

    ``installation`` names this installation and no other.
    """
    machines = tree.machinery(MACHINES)
    path = f"Machines/{settings.name}"
    root = tree.object(
        path,
        machines,
        name=tree.instance_name(settings.name),
        type_definition=tree.type_id("WorkstationType"),
        description=f"workstation with {model.manufacturer} {model.model}",
    )
    await make_notifier(tree.server.get_node(root))
    _add_identification(tree, path, root, settings, installation)
    _add_equipment(tree, path, root, settings, model)
    for spec in specs(tree, methods):
        tree.declare_method("WorkstationType", spec)
        await add_method(tree.server, root, spec, tree.id(f"{path}/{spec.name}"), tree.name(spec.name))
    folder = standard(ObjectIds.FolderType)
    tree.object(f"{path}/Skills", root, type_definition=folder, description="the skills deployed here")
    await _add_arm(tree, path, root, model, methods)
    return SkillNodes(tree, settings.name)


def _add_identification(tree: Tree, path: str, root: ua.NodeId, settings: Workstation, installation: str) -> None:
    identification = tree.object(
        f"{path}/Identification",
        root,
        name=tree.di_name("Identification"),
        type_definition=tree.machinery(MACHINE_IDENTIFICATION),
        reference=ObjectIds.HasAddIn,
        description="name plate of the workstation",
    )
    product = f"urn:opcua-skill:workstation:{installation}:{settings.name}"
    for name, value in (
        ("Manufacturer", localized(settings.manufacturer or "opcua-skill")),
        ("Model", localized(settings.model or "learned-skill workstation")),
        ("SerialNumber", text(settings.serial_number or settings.name)),
        ("ProductInstanceUri", text(product)),
        ("SoftwareRevision", text(installed_version("opcua-skill"))),
    ):
        tree.property(f"{path}/Identification/{name}", identification, value, name=tree.di_name(name))


def _add_equipment(tree: Tree, path: str, root: ua.NodeId, settings: Workstation, model: ArmModel) -> None:
    folder = standard(ObjectIds.FolderType)
    equipment = tree.object(f"{path}/Equipment", root, type_definition=folder, description="what stands here")
    atomic = tree.object(f"{path}/AtomicSkills", root, type_definition=folder, description="what can be done here")
    items = [("Arm", model.manufacturer, model.model, motions_of(model))]
    items += [(item.name, item.manufacturer, item.model, item.atomic_skills) for item in settings.equipment]
    given: dict[str, ua.NodeId] = {}
    for name, manufacturer, model_name, skills in items:
        place = f"{path}/Equipment/{name}"
        node = tree.object(
            place, equipment, name=tree.instance_name(name), type_definition=tree.type_id("EquipmentType")
        )
        tree.property(f"{place}/Manufacturer", node, text(manufacturer))
        tree.property(f"{place}/Model", node, text(model_name))
        tree.property(f"{place}/AtomicSkills", node, texts(skills), description="the atomic skills it gives")
        if name == "Arm":
            limits = model.limits
            position, velocity, acceleration, jerk = joint_units(kinematics(model).slides.tolist())
            for label, values, unit in (
                ("JointPositionMinimum", limits.lower, position),
                ("JointPositionMaximum", limits.upper, position),
                ("JointVelocityMaximum", limits.velocity, velocity),
                ("JointAccelerationMaximum", limits.acceleration, acceleration),
                ("JointJerkMaximum", limits.jerk, jerk),
            ):
                span = (min(0.0, *values), max(0.0, *values))
                one = "one value a joint"
                measured(tree, f"{place}/{label}", node, numbers(values), unit, span, description=one)
            add_links(tree, place, node, model)
        for skill in skills:
            if skill not in given:
                given[skill] = _add_atomic_skill(tree, f"{path}/AtomicSkills/{skill}", atomic, skill)


def _add_atomic_skill(tree: Tree, path: str, parent: ua.NodeId, name: str) -> ua.NodeId:
    skill = described(name)
    node = tree.object(
        path,
        parent,
        name=tree.instance_name(name),
        type_definition=tree.type_id("AtomicSkillType"),
        description=skill.description,
    )
    for parameter in skill.parameters:
        _add_parameter(tree, f"{path}/{parameter.name}", node, parameter)
    return node


def _add_parameter(tree: Tree, path: str, parent: ua.NodeId, parameter: SkillParameter) -> None:
    """Add a parameter as an AnalogUnitRangeType variable: its default, unit and range."""
    unit = Unit(parameter.unit_code, parameter.unit or "1", parameter.unit or "one")
    span, meaning = (parameter.low, parameter.high), parameter.description
    measured(tree, path, parent, number(parameter.default), unit, span, description=meaning)


async def _add_arm(tree: Tree, path: str, root: ua.NodeId, model: ArmModel, methods: WorkstationMethods) -> None:
    arm_path = f"{path}/Arm"
    arm = tree.object(arm_path, root, type_definition=tree.type_id("ArmType"), description="the arm as it is now")
    state = methods.station.arm.state()
    position = joint_units(kinematics(model).slides.tolist())[0]
    span = (min(model.limits.lower), max(model.limits.upper))
    joints = numbers(state.joints)
    measured(tree, f"{arm_path}/Position", arm, joints, position, span, description="joint positions")
    reach = max(1.0, *(abs(edge) for edge in (*model.workspace_low, *model.workspace_high)))
    tool, meaning = numbers(state.tool_pose), "x y z (m) qx qy qz qw in the base"
    measured(tree, f"{arm_path}/ToolPose", arm, tool, METRE, (-reach, reach), description=meaning)
    tree.variable(f"{arm_path}/Mode", arm, text(state.mode.value), description="what the arm is doing")
    boolean = ua.VariantType.Boolean
    tree.variable(f"{arm_path}/AtRest", arm, ua.Variant(state.at_rest, boolean), description="nothing moves")
    tree.variable(
        f"{arm_path}/Known",
        arm,
        ua.Variant(state.known, boolean),
        description="false after a loss of contact, until Reset",
    )
    tree.variable(f"{arm_path}/Fault", arm, text(state.fault), description="what is wrong; empty: nothing")
    override = measured(
        tree,
        f"{arm_path}/SpeedOverride",
        arm,
        number(state.override),
        ONE,
        (LOWEST_OVERRIDE, 1.0),
        writable=True,
        description="fraction of the planned speed",
    )
    tree.server.restrict_writes(override, OPERATORS)  # type: ignore[attr-defined]
    for spec in (
        method("ProtectiveStop", methods.protective_stop, OPERATORS, (COMMENT,), (), urgent=True),
        method("Reset", methods.reset, OPERATORS, (COMMENT,), ()),
    ):
        tree.declare_method("ArmType", spec)
        await add_method(tree.server, arm, spec, tree.id(f"{arm_path}/{spec.name}"), tree.name(spec.name))
    lock_path = f"{arm_path}/Lock"
    lock = tree.object(
        lock_path,
        arm,
        name=tree.di_name("Lock"),
        type_definition=tree.di(LOCKING_SERVICES),
        description="single point of control of this arm",
    )
    for name, value in (
        ("Locked", ua.Variant(False, boolean)),
        ("LockingClient", text("")),
        ("LockingUser", text("")),
        ("RemainingLockTime", number(0.0)),
    ):
        options: dict[str, Any] = {"data_type": standard(ObjectIds.Duration)} if name == "RemainingLockTime" else {}
        tree.property(f"{lock_path}/{name}", lock, value, name=tree.di_name(name), **options)
    for spec in lock_specs(methods):
        await add_method(tree.server, lock, spec, tree.id(f"{lock_path}/{spec.name}"), tree.di_name(spec.name))

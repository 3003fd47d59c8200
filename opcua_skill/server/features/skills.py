"""Deployed skills as nodes: `Machines/<Workstation>/Skills/<name>`. The rest of a library is reached by its methods."""

from datetime import UTC, datetime
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from library.description import JobReport, JobState, SkillDescription
from opcua_skill.server.address_space import Tree, count, localized, number, standard, text, texts
from opcua_skill.server.units import ONE, measured
from opcua_skill.stack.address_space.events import make_notifier

# OPC 10000-10: numbers of the states of a program.
READY, RUNNING, SUSPENDED, HALTED = (12, "Ready"), (13, "Running"), (14, "Suspended"), (11, "Halted")
STATES = {
    JobState.RUNNING: RUNNING,
    JobState.STOPPING: RUNNING,
    JobState.PAUSED: SUSPENDED,
    JobState.COMPLETED: READY,
    JobState.FAILED: HALTED,
    JobState.ABORTED: HALTED,
}
STATE_IDS = {
    "Ready": ObjectIds.ProgramStateMachineType_Ready,
    "Running": ObjectIds.ProgramStateMachineType_Running,
    "Suspended": ObjectIds.ProgramStateMachineType_Suspended,
    "Halted": ObjectIds.ProgramStateMachineType_Halted,
}
TRANSITIONS = {
    ("Halted", "Ready"): (1, ObjectIds.ProgramStateMachineType_HaltedToReady),
    ("Ready", "Running"): (2, ObjectIds.ProgramStateMachineType_ReadyToRunning),
    ("Running", "Halted"): (3, ObjectIds.ProgramStateMachineType_RunningToHalted),
    ("Running", "Ready"): (4, ObjectIds.ProgramStateMachineType_RunningToReady),
    ("Running", "Suspended"): (5, ObjectIds.ProgramStateMachineType_RunningToSuspended),
    ("Suspended", "Running"): (6, ObjectIds.ProgramStateMachineType_SuspendedToRunning),
    ("Suspended", "Halted"): (7, ObjectIds.ProgramStateMachineType_SuspendedToHalted),
    ("Suspended", "Ready"): (8, ObjectIds.ProgramStateMachineType_SuspendedToReady),
    ("Ready", "Halted"): (9, ObjectIds.ProgramStateMachineType_ReadyToHalted),
}


def _matrix(values: Any) -> ua.Variant:
    array = np.array(values, dtype=np.float64)
    return ua.Variant(array.ravel().tolist(), ua.VariantType.Double, is_array=True)


class SkillNodes:
    """The skills deployed on one workstation. A skill is there once: a new version takes the place of the old one."""

    def __init__(self, tree: Tree, workstation: str) -> None:
        self._tree = tree
        self._workstation = workstation
        self._root = f"Machines/{workstation}/Skills"
        self._nodes: dict[str, list[ua.NodeId]] = {}
        self._states: dict[str, tuple[int, str]] = {}
        self.shown: dict[str, int] = {}

    def path(self, skill_name: str) -> str:
        """Return the path of a skill's object."""
        return f"{self._root}/{skill_name}"

    async def show(self, description: SkillDescription) -> None:
        """Add a deployed version, in place of another version of the same skill."""
        await self.hide(description.name)
        tree, path = self._tree, self.path(description.name)
        root = tree.object(
            path,
            tree.id(self._root),
            name=tree.instance_name(description.name),
            type_definition=tree.type_id("SkillType"),
            description=f"{description.semantic_type}, version {description.version}",
        )
        added = [root]

        def add(
            name: str, value: ua.Variant, meaning: str, *, standard_name: bool = False, prop: bool = True
        ) -> ua.NodeId:
            browse_name = ua.QualifiedName(name.rsplit("/", 1)[-1], 0) if standard_name else None
            parent = tree.id(f"{path}/{name.rsplit('/', 1)[0]}") if "/" in name else root
            kind = tree.property if prop else tree.variable
            node = kind(f"{path}/{name}", parent, value, name=browse_name, description=meaning)
            added.append(node)
            return node

        add("SemanticType", text(description.semantic_type), "what kind of skill this is")
        add("RequiredAtomicSkills", texts(description.required_atomic_skills), "what equipment has to be able to do")
        add("Version", count(description.version), "the version deployed here")
        digest = ua.Variant(bytes.fromhex(description.model_digest), ua.VariantType.ByteString)
        add("ModelDigest", digest, "SHA-256 over the model and its semantic description")
        add("Dimension", ua.Variant(description.dimension, ua.VariantType.Byte), "of the positions: 2 or 3")
        columns = "phase, time (s), position (m)" if description.clock == "path" else "time (s), position (m)"
        shape = f"{len(description.means)} components, columns: {columns}"
        add("Components", count(len(description.means)), "number of Gaussian components")
        add("Means", _matrix(description.means), f"row-major, {shape}", prop=False)
        add("Covariances", _matrix(description.covariances), f"row-major, {shape}", prop=False)
        progress = f"{path}/Progress"
        measured(tree, progress, root, number(0.0), ONE, (0.0, 1.0), description="of the run under way")
        added += [tree.id(progress), tree.id(f"{progress}/EURange"), tree.id(f"{progress}/EngineeringUnits")]
        self._add_program_members(add, description)
        self._nodes[description.name] = added
        self._states[description.name] = READY
        self.shown[description.name] = description.version
        await make_notifier(tree.server.get_node(root), tree.server.get_node(tree.id(f"Machines/{self._workstation}")))

    def _add_program_members(self, add: Any, description: SkillDescription) -> None:
        """Add what OPC 10000-10 makes mandatory on a program; the state follows the jobs of this skill."""
        add("CurrentState", localized("Ready"), "state of the program", standard_name=True, prop=False)
        ready = ua.Variant(standard(STATE_IDS["Ready"]), ua.VariantType.NodeId)
        add("CurrentState/Id", ready, "node of the state", standard_name=True)
        add("CurrentState/Number", count(READY[0]), "number of the state", standard_name=True)
        add("LastTransition", localized(""), "last change of state", standard_name=True, prop=False)
        none = ua.Variant(ua.NodeId(), ua.VariantType.NodeId)
        add("LastTransition/Id", none, "node of the transition", standard_name=True)
        add("LastTransition/Number", count(0), "number of the transition", standard_name=True)
        now = ua.Variant(datetime.now(UTC), ua.VariantType.DateTime)
        add("LastTransition/TransitionTime", now, "when it happened", standard_name=True)
        for name, value in (("AutoDelete", False), ("Creatable", False), ("Deletable", False)):
            add(name, ua.Variant(value, ua.VariantType.Boolean), "of the program", standard_name=True)
        add("RecycleCount", ua.Variant(0, ua.VariantType.Int32), "of the program", standard_name=True)

    async def hide(self, skill_name: str) -> None:
        """Take a skill's nodes away."""
        nodes = self._nodes.pop(skill_name, [])
        self._states.pop(skill_name, None)
        self.shown.pop(skill_name, None)
        await self._tree.delete(list(reversed(nodes)))

    async def job_changed(self, report: JobReport) -> None:
        """Show how the program stands after a job of this workstation changed."""
        name, never_ran = report.skill_name, report.start_time is None
        if never_ran or name not in self._nodes or report.mode == "simulation" or report.state not in STATES:
            return
        path, before, after = self.path(name), self._states[name], STATES[report.state]
        await self._tree.write(f"{path}/Progress", number(report.progress))
        if after == before:
            return
        if before == HALTED and after == RUNNING:
            await self._enter(name, READY)
        await self._enter(name, after)

    async def _enter(self, name: str, state: tuple[int, str]) -> None:
        path, before = self.path(name), self._states[name]
        self._states[name] = state
        transition = TRANSITIONS.get((before[1], state[1]))
        await self._tree.write(f"{path}/CurrentState", localized(state[1]))
        node = ua.Variant(standard(STATE_IDS[state[1]]), ua.VariantType.NodeId)
        await self._tree.write(f"{path}/CurrentState/Id", node)
        await self._tree.write(f"{path}/CurrentState/Number", count(state[0]))
        if transition is None:
            return
        await self._tree.write(f"{path}/LastTransition", localized(f"{before[1]}To{state[1]}"))
        node = ua.Variant(standard(transition[1]), ua.VariantType.NodeId)
        await self._tree.write(f"{path}/LastTransition/Id", node)
        await self._tree.write(f"{path}/LastTransition/Number", count(transition[0]))
        now = ua.Variant(datetime.now(UTC), ua.VariantType.DateTime)
        await self._tree.write(f"{path}/LastTransition/TransitionTime", now)

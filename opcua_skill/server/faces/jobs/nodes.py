"""`MachineryBuildingBlocks/JobManagement` of a workstation, and who keeps it true."""

from collections.abc import Sequence

from asyncua import ua
from asyncua.common.event_objects import BaseEvent
from asyncua.ua.object_ids import ObjectIds

from library.description import JobReport, SkillDescription
from library.errors import NotFound
from library.store import SkillLibrary
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.address_space import Tree, standard, texts
from opcua_skill.server.faces.blocks import building_blocks
from opcua_skill.server.faces.jobs.methods import ControlMethods, ResultMethods
from opcua_skill.server.faces.jobs.orders import Found, JobOrders
from opcua_skill.server.faces.jobs.parameters import parameters_of
from opcua_skill.server.faces.jobs.states import STATE_NAMES, OrderState
from opcua_skill.server.faces.jobs.structures import ORDER, ORDER_AND_STATE, RESPONSE, STATE, WORK_MASTER, Structures
from opcua_skill.server.features.library_nodes import OPERATORS, READERS, method
from opcua_skill.server.nodesets import ISA95, MACHINERY_JOBS
from opcua_skill.stack.address_space.events import make_notifier
from opcua_skill.stack.services.calls import Argument, MethodSpec, add_method

JOB_MANAGEMENT, RECEIVER, PROVIDER, STATUS_EVENT = 1003, 1008, 1003, 1006
EVENT_TYPE = "JobOrderStatusEventType"
STOPPING = frozenset({"Pause", "Stop", "Abort"})
SEVERITY = {OrderState.ABORTED: 700, OrderState.INTERRUPTED: 500}


class JobFace:
    """The node of one workstation's job management."""

    def __init__(
        self, tree: Tree, library: SkillLibrary, jobs: JobEngine, station: Station, lock: ArmLock, most: int
    ) -> None:
        self._tree = tree
        self._library = library
        self._workstation = station.name
        self._structures = Structures(tree)
        self._path = f"Machines/{station.name}/MachineryBuildingBlocks/JobManagement"
        self.orders = JobOrders(library, jobs, station, lock, self._structures, most)
        self.orders.tell = self._tell
        self.orders.show_lists = self._show_lists

    async def add(self) -> None:
        """Add the nodes, and show what was ordered before the server's last end."""
        tree, path = self._tree, self._path
        machine = tree.id(f"Machines/{self._workstation}")
        blocks = building_blocks(tree, self._workstation)
        management = tree.object(
            path,
            blocks,
            name=tree.name("JobManagement", MACHINERY_JOBS),
            type_definition=tree.foreign(MACHINERY_JOBS, JOB_MANAGEMENT),
            reference=ObjectIds.HasAddIn,
            description="job orders of a manufacturing system",
        )
        control = tree.object(
            f"{path}/JobOrderControl",
            management,
            name=tree.name("JobOrderControl", MACHINERY_JOBS),
            type_definition=tree.foreign(ISA95, RECEIVER),
            description="takes job orders",
        )
        await make_notifier(tree.server.get_node(control), tree.server.get_node(machine))
        results = tree.object(
            f"{path}/JobOrderResults",
            management,
            name=tree.name("JobOrderResults", MACHINERY_JOBS),
            type_definition=tree.foreign(ISA95, PROVIDER),
            description="tells what has become of job orders",
        )
        if tree.type_id(EVENT_TYPE) not in tree.server.iserver.aspace:
            told = "a job order has another state"
            tree.object_type(EVENT_TYPE, tree.foreign(ISA95, STATUS_EVENT), told)
        tree.reference(control, tree.type_id(EVENT_TYPE), ObjectIds.GeneratesEvent, ua.NodeClass.ObjectType)
        self._add_state(control)
        self._add_lists(control, results)
        for owner, name, specs in (
            (control, "JobOrderControl", self._control_specs()),
            (results, "JobOrderResults", self._result_specs()),
        ):
            for spec in specs:
                place = tree.id(f"{path}/{name}/{spec.name}")
                await add_method(tree.server, owner, spec, place, tree.name(spec.name, ISA95))
        await self.orders.show()
        await self.show_work_masters()

    def _add_state(self, control: ua.NodeId) -> None:
        """Add the state that the type asks for. Many orders are here at once, so it is none of theirs: null."""
        tree = self._tree
        path = f"{self._path}/JobOrderControl/CurrentState"
        current = tree.variable(
            path,
            control,
            ua.Variant(ua.LocalizedText(), ua.VariantType.LocalizedText),
            name=ua.QualifiedName("CurrentState", 0),  # pyright: ignore[reportArgumentType]
            type_definition=ObjectIds.FiniteStateVariableType,
            description="null: every job order has a state of its own, in JobOrderList",
        )
        tree.property(
            f"{path}/Id",
            current,
            ua.Variant(ua.NodeId(), ua.VariantType.NodeId),
            name=ua.QualifiedName("Id", 0),  # pyright: ignore[reportArgumentType]
        )

    def _add_lists(self, control: ua.NodeId, results: ua.NodeId) -> None:
        tree, path = self._tree, f"{self._path}/JobOrderControl"
        most = ua.Variant(self.orders.most, ua.VariantType.UInt16)
        tree.variable(f"{path}/MaxDownloadableJobOrders", control, most, name=self._name("MaxDownloadableJobOrders"))
        for name in ("MaterialClassID", "MaterialDefinitionID", "PersonnelID", "PhysicalAssetID"):
            tree.variable(f"{path}/{name}", control, texts([]), name=self._name(name), description="none is asked for")
        equipment = texts([self._workstation])
        tree.variable(f"{path}/EquipmentID", control, equipment, name=self._name("EquipmentID"))
        for name, kind, owner, where in (
            ("WorkMaster", WORK_MASTER, control, path),
            ("JobOrderList", ORDER_AND_STATE, control, path),
            ("JobOrderResponseList", RESPONSE, results, f"{self._path}/JobOrderResults"),
        ):
            data_type = tree.foreign(ISA95, kind)
            tree.variable(f"{where}/{name}", owner, _structures([]), data_type=data_type, name=self._name(name))

    def _name(self, text: str) -> ua.QualifiedName:
        return self._tree.name(text, ISA95)

    def _control_specs(self) -> tuple[MethodSpec, ...]:
        handlers = ControlMethods(self.orders)
        comment = Argument("Comment", standard(ObjectIds.LocalizedText), 1, "why, in words")
        order = Argument("JobOrder", self._tree.foreign(ISA95, ORDER), description="what is ordered")
        order_id = Argument("JobOrderID", standard(ObjectIds.String), description="which order")
        status = Argument("ReturnStatus", standard(ObjectIds.UInt64), description="bit 0: done; else why not")
        return (
            *(
                method(name, handler, OPERATORS, (order, comment), (status,))
                for name, handler in (
                    ("Store", handlers.store),
                    ("StoreAndStart", handlers.store_and_start),
                    ("Update", handlers.update),
                )
            ),
            *(
                method(
                    name, handler, OPERATORS, (order_id, comment), (status,), urgent=name in {"Pause", "Stop", "Abort"}
                )
                for name, handler in (
                    ("Start", handlers.start),
                    ("RevokeStart", handlers.revoke_start),
                    ("Pause", handlers.pause),
                    ("Resume", handlers.resume),
                    ("Stop", handlers.stop),
                    ("Abort", handlers.abort),
                    ("Cancel", handlers.cancel),
                    ("Clear", handlers.clear),
                )
            ),
        )

    def _result_specs(self) -> tuple[MethodSpec, ...]:
        handlers, tree = ResultMethods(self.orders, self._structures), self._tree
        order_id = Argument("JobOrderID", standard(ObjectIds.String), description="which order")
        states = Argument("JobOrderState", tree.foreign(ISA95, STATE), 1, "top-level states")
        one = Argument("JobResponse", tree.foreign(ISA95, RESPONSE))
        many = Argument("JobResponses", tree.foreign(ISA95, RESPONSE), 1)
        status = Argument("ReturnStatus", standard(ObjectIds.UInt64), description="bit 0: done; else why not")
        by_id, by_state = "RequestJobResponseByJobOrderID", "RequestJobResponseByJobOrderState"
        return (
            method(by_id, handlers.by_order_id, READERS, (order_id,), (one, status), changes=False),
            method(by_state, handlers.by_state, READERS, (states,), (many, status), changes=False),
        )

    # What keeps it true

    async def show_work_masters(self) -> None:
        """Show which versions may be ordered: one work master a deployed version."""
        masters = []
        for description in await self._library.deployments(self._workstation):
            try:
                recipe = await self._library.recipe(await self._library.default_recipe_id(description.name))
            except NotFound:
                continue
            told = f"{description.semantic_type}: {description.name} version {description.version}"
            parameters = parameters_of(description, recipe)
            masters.append(self._structures.work_master(description.name, description.version, told, parameters))
        await self._tree.write(f"{self._path}/JobOrderControl/WorkMaster", _structures(masters))

    async def deployment_changed(self, _description: SkillDescription, workstation: str, _there: bool) -> None:
        """Show the work masters anew where a version was deployed or withdrawn here."""
        if workstation == self._workstation:
            await self.show_work_masters()

    async def job_changed(self, report: JobReport) -> None:
        """Tell of a job's order."""
        await self.orders.job_changed(report)

    async def _show_lists(self, listed: Sequence[Found]) -> None:
        entries, responses = [], []
        for found in listed:
            states = self._structures.states(*self.orders.state(found))
            entries.append(self._structures.order_and_state(*found, states))
            if found[1] is not None:
                responses.append(self._structures.response(*found, states))
        await self._tree.write(f"{self._path}/JobOrderControl/JobOrderList", _structures(entries))
        await self._tree.write(f"{self._path}/JobOrderResults/JobOrderResponseList", _structures(responses))

    async def _tell(self, found: Found, state: tuple[OrderState, str]) -> None:
        """Raise the event of an order's new state."""
        order, report = found
        states = self._structures.states(*state)
        entry, response = self._structures.order(order, report), self._structures.response(order, report, states)
        event = BaseEvent()
        substate = f", {state[1]}" if state[1] else ""
        message = ua.LocalizedText(f"job order {entry.JobOrderID} is {STATE_NAMES[state[0]]}{substate}", "en")
        structure = ua.VariantType.ExtensionObject
        for field, value, kind in (
            ("EventType", self._tree.type_id(EVENT_TYPE), ua.VariantType.NodeId),
            ("Message", message, ua.VariantType.LocalizedText),
            ("Severity", SEVERITY.get(state[0], 200), ua.VariantType.UInt16),
            ("JobOrder", entry, structure),
            ("JobState", states, structure),
            ("JobResponse", response, structure),
        ):
            event.add_property(field, value, kind)
        await self._tree.server.raise_event(self._tree.id(f"{self._path}/JobOrderControl"), event)  # type: ignore[attr-defined]


def _structures(values: Sequence[object]) -> ua.Variant:
    return ua.Variant(list(values), ua.VariantType.ExtensionObject, is_array=True)

"""`MachineryItemState` and `MachineryOperationMode` of a workstation, and who keeps them true."""

from dataclasses import dataclass
from datetime import UTC, datetime

from asyncua import ua
from asyncua.common.event_objects import BaseEvent
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds

from library.description import JobReport, JobState
from opcua_skill.jobs import Station
from opcua_skill.server.address_space import Tree, count, standard
from opcua_skill.server.faces.blocks import building_blocks
from opcua_skill.server.faces.machinery.states import item_state, operation_mode
from opcua_skill.server.nodesets import MACHINERY
from opcua_skill.stack.address_space.events import make_notifier

ITEM_STATE, OPERATION_MODE = ("MachineryItemState", 1002), ("MachineryOperationMode", 1008)
BEGUN = frozenset({JobState.RUNNING, JobState.PAUSED, JobState.STOPPING})
NULL_ID = ua.Variant(ua.NodeId(), ua.VariantType.NodeId)
NULL_TEXT = ua.Variant(ua.LocalizedText(), ua.VariantType.LocalizedText)
SEVERITY = {"NotAvailable": 700, "OutOfService": 700}


@dataclass(frozen=True, slots=True)
class Known:
    """A state or a transition as its type declares it."""

    node: ua.NodeId
    number: int


def declared(tree: Tree, state_machine: ua.NodeId) -> dict[str, Known]:
    """Return the states and transitions that a type of state machine declares, by name."""
    space, found = tree.server.iserver.aspace, {}
    for member in space[state_machine].references:
        if not member.IsForward or member.NodeClass != ua.NodeClass.Object:
            continue
        for told in space[member.NodeId].references:
            if told.IsForward and told.BrowseName.Name in {"StateNumber", "TransitionNumber"}:
                number = space.read_attribute_value(told.NodeId, AttributeIds.Value).Value
                found[member.BrowseName.Name] = Known(member.NodeId, number.Value)  # type: ignore[union-attr]
    return found


class StateMachine:
    """The node of one state machine."""

    def __init__(self, tree: Tree, workstation: str, block: tuple[str, int]) -> None:
        name, number = block
        self._tree, self._workstation = tree, workstation
        self._name = name
        self._path = f"Machines/{workstation}/MachineryBuildingBlocks/{name}"
        self._type = tree.machinery(number)
        self._known = declared(tree, self._type)
        self.shown = ""

    async def add(self, folder: ua.NodeId) -> None:
        """Add the node; its state is null until it is first shown."""
        tree, path = self._tree, self._path
        root = tree.object(
            path,
            folder,
            name=tree.name(self._name, MACHINERY),
            type_definition=self._type,
            reference=ObjectIds.HasAddIn,
            description="follows from the arm, its queue and its job",
        )
        machine = tree.server.get_node(tree.id(f"Machines/{self._workstation}"))
        await make_notifier(tree.server.get_node(root), machine)
        for name, kind in (
            ("CurrentState", ObjectIds.FiniteStateVariableType),
            ("LastTransition", ObjectIds.FiniteTransitionVariableType),
        ):
            place = f"{path}/{name}"
            node = tree.variable(place, root, NULL_TEXT, name=_own(name), type_definition=kind)
            tree.property(f"{place}/Id", node, NULL_ID, name=_own("Id"))
            tree.property(f"{place}/Number", node, count(0), name=_own("Number"))
            if name == "LastTransition":
                when = ua.Variant(datetime.now(UTC), ua.VariantType.DateTime)
                tree.property(
                    f"{place}/TransitionTime", node, when, data_type=standard(294), name=_own("TransitionTime")
                )

    async def show(self, state: str) -> None:
        """Show a state, and tell of the transition to it."""
        before = self.shown
        if state == before:
            return
        self.shown = state
        await self._write("CurrentState", state, self._known[state])
        if before:
            name = f"From{before}To{state}"
            when = ua.Variant(datetime.now(UTC), ua.VariantType.DateTime)
            await self._tree.write(f"{self._path}/LastTransition/TransitionTime", when)
            await self._write("LastTransition", name, self._known[name])
            await self._tell(before, state, name)

    async def _write(self, variable: str, name: str, known: Known) -> None:
        place = f"{self._path}/{variable}"
        await self._tree.write(f"{place}/Id", ua.Variant(known.node, ua.VariantType.NodeId))
        await self._tree.write(f"{place}/Number", count(known.number))
        await self._tree.write(place, _text(name))

    async def _tell(self, before: str, after: str, transition: str) -> None:
        event = BaseEvent()
        kind = ua.VariantType
        event.add_property("EventType", standard(ObjectIds.TransitionEventType), kind.NodeId)
        told = ua.LocalizedText(f"{self._name} of {self._workstation} is {after}", "en")
        event.add_property("Message", told, kind.LocalizedText)
        event.add_property("Severity", SEVERITY.get(after, 200), kind.UInt16)
        for field, name in (("FromState", before), ("ToState", after), ("Transition", transition)):
            event.add_property(field, ua.LocalizedText(name, "en"), kind.LocalizedText)
            event.add_property(f"{field}/Id", self._known[name].node, kind.NodeId)
        await self._tree.server.raise_event(self._tree.id(self._path), event)  # type: ignore[attr-defined]


class MachineryFace:
    """The state and the operation mode of one workstation."""

    def __init__(self, tree: Tree, station: Station) -> None:
        self._tree, self._station = tree, station
        self._state = StateMachine(tree, station.name, ITEM_STATE)
        self._mode = StateMachine(tree, station.name, OPERATION_MODE)
        self._running: JobReport | None = None

    async def add(self) -> None:
        """Add the nodes, and show what is so now."""
        folder = building_blocks(self._tree, self._station.name)
        for one in (self._state, self._mode):
            await one.add(folder)
        await self.show()

    async def job_changed(self, report: JobReport) -> None:
        """Follow the job that has the arm."""
        if report.workstation != self._station.name or report.mode == "simulation":
            return
        if report.state in BEGUN:
            self._running = report
        elif self._running is not None and self._running.job_id == report.job_id:
            self._running = None
        await self.show()

    async def show(self) -> None:
        """Show what follows from arm, queue and job; nothing is written where nothing has changed."""
        arm = self._station.arm.state()
        await self._state.show(item_state(arm))
        await self._mode.show(operation_mode(arm, self._running, held=self._station.queue.status.held))


def _own(name: str) -> ua.QualifiedName:
    return ua.QualifiedName(name, 0)  # pyright: ignore[reportArgumentType]


def _text(words: str) -> ua.Variant:
    return ua.Variant(ua.LocalizedText(words, "en"), ua.VariantType.LocalizedText)

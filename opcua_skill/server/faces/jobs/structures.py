"""The structures of OPC 10031-4: from orders and jobs to what goes over the wire, and back."""

from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua import ua_binary
from asyncua.ua.object_ids import ObjectIds

from library.description import JobReport, JobState
from library.records import JobOrder
from opcua_skill.jobs.execution import MODES
from opcua_skill.server.address_space import Tree
from opcua_skill.server.faces.jobs.parameters import EXECUTION_MODE, RECIPE_ID, OrderParameter
from opcua_skill.server.faces.jobs.states import STATE_NAMES, SUBSTATES, OrderState
from opcua_skill.server.nodesets import ISA95
from opcua_skill.server.units import METRE, ONE, SECOND, Unit

ORDER, ORDER_AND_STATE, STATE, WORK_MASTER, RESPONSE, PARAMETER = 3008, 3015, 3006, 3007, 3013, 3003
UNKNOWN, SUCCESSFUL, UNSUCCESSFUL = 0, 1, 2  # JobResult of OPC 40001-3
RESULTS = {JobState.COMPLETED: SUCCESSFUL, JobState.FAILED: UNSUCCESSFUL, JobState.ABORTED: UNSUCCESSFUL}
DOUBLE, STRING, INT32, UINT32 = (
    ua.VariantType.Double,
    ua.VariantType.String,
    ua.VariantType.Int32,
    ua.VariantType.UInt32,
)


class Structures:
    """Makes and reads the structures; their classes exist once the NodeSet is loaded."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self._index = tree.name("", ISA95).NamespaceIndex

    def _new(self, kind: int, **fields: Any) -> Any:
        return ua.extension_objects_by_datatype[self._tree.foreign(ISA95, kind)](**fields)

    def encode(self, order: Any) -> bytes:
        """Return an order as bytes, the same for the same content."""
        return ua_binary.struct_to_binary(order)

    def decode(self, content: bytes) -> Any:
        """Return the order in bytes that ``encode`` made."""
        kind = ua.extension_objects_by_datatype[self._tree.foreign(ISA95, ORDER)]
        return ua_binary.struct_from_binary(kind, Buffer(content))

    def order(self, order: JobOrder | None, report: JobReport | None) -> Any:
        """Return an order as it came; for a job that was begun in another way, the order that would have begun it."""
        if order is not None:
            return self.decode(order.content)
        assert report is not None
        return self._new(
            ORDER,
            JobOrderID=report.job_id,
            WorkMasterID=[self._new(WORK_MASTER, ID=f"{report.skill_name}@{report.skill_version}")],
            JobOrderParameters=[
                self._parameter(RECIPE_ID, report.recipe_id, STRING),
                self._parameter(EXECUTION_MODE, MODES.index(report.mode) if report.mode else 0, INT32),
            ],
        )

    def states(self, state: OrderState, substate: str) -> list[Any]:
        """Return a state and, below it, its substate."""
        name = STATE_NAMES[state]
        text, number = ua.LocalizedText(name, "en"), ua.UInt32(state)
        found = [self._new(STATE, BrowsePath=ua.RelativePath(), StateText=text, StateNumber=number)]
        if substate:
            element = ua.RelativePathElement(
                ReferenceTypeId=ua.NodeId(ObjectIds.HasSubStateMachine),  # pyright: ignore[reportArgumentType]
                IsInverse=False,  # pyright: ignore[reportArgumentType]
                IncludeSubtypes=True,  # pyright: ignore[reportArgumentType]
                TargetName=ua.QualifiedName(f"{name}Substates", self._index),
            )
            text, number = ua.LocalizedText(substate, "en"), ua.UInt32(SUBSTATES[state][substate])
            path = ua.RelativePath(Elements=[element])
            found.append(self._new(STATE, BrowsePath=path, StateText=text, StateNumber=number))
        return found

    def order_and_state(self, order: JobOrder | None, report: JobReport | None, states: list[Any]) -> Any:
        """Return an entry of JobOrderList."""
        return self._new(ORDER_AND_STATE, JobOrder=self.order(order, report), State=states)

    def response(self, order: JobOrder | None, report: JobReport | None, states: list[Any]) -> Any:
        """Return what has become of an order so far."""
        order_id = order.order_id if order is not None else report.job_id if report is not None else ""
        if report is None:
            return self._new(RESPONSE, JobResponseID="", JobOrderID=order_id, JobState=states)
        return self._new(
            RESPONSE,
            JobResponseID=report.job_id,
            JobOrderID=order_id,
            StartTime=report.start_time,
            EndTime=report.end_time,
            JobState=states,
            JobResponseData=self._figures(report),
        )

    def _figures(self, report: JobReport) -> list[Any]:
        lasted = 0.0
        if report.start_time is not None:
            lasted = ((report.end_time or datetime.now(UTC)) - report.start_time).total_seconds()
        return [
            self._parameter("JobResult", RESULTS.get(report.state, UNKNOWN), INT32),
            self._parameter("ReasonForStateChange", report.message, STRING),
            self._parameter("Failure", report.failure.value, STRING),
            self._parameter("Cause", report.cause.value, STRING),
            self._parameter("JobId", report.job_id, STRING),
            self._parameter("SkillName", report.skill_name, STRING),
            self._parameter("SkillVersion", report.skill_version, UINT32),
            self._parameter(RECIPE_ID, report.recipe_id, STRING),
            self._parameter("PlanDigest", report.plan_digest, STRING),
            self._parameter("Progress", report.progress, DOUBLE, ONE),
            self._parameter("ActualProductionTime", lasted, DOUBLE, SECOND),
            self._parameter("PathErrorRms", report.path_error[0], DOUBLE, METRE),
            self._parameter("PathErrorMaximum", report.path_error[1], DOUBLE, METRE),
            self._parameter("TrackingErrorRms", report.tracking_error[0], DOUBLE, METRE),
            self._parameter("TrackingErrorMaximum", report.tracking_error[1], DOUBLE, METRE),
        ]

    def work_master(self, name: str, version: int, told: str, parameters: tuple[OrderParameter, ...]) -> Any:
        """Return a version that may be ordered, with what an order for it may say."""
        return self._new(
            WORK_MASTER,
            ID=f"{name}@{version}",
            Description=ua.LocalizedText(told, "en"),
            Parameters=[self._declared(parameter) for parameter in parameters],
        )

    def _declared(self, parameter: OrderParameter) -> Any:
        default = parameter.default
        kind = STRING if isinstance(default, str) else INT32 if isinstance(default, int) else DOUBLE
        edges = [("Min", parameter.low), ("Max", parameter.high)]
        given = [self._parameter(name, float(edge), DOUBLE, parameter.unit) for name, edge in edges if edge is not None]
        return self._parameter(parameter.name, default, kind, parameter.unit, parameter.description, given)

    def _parameter(
        self,
        name: str,
        value: Any,
        kind: ua.VariantType,
        unit: Unit | None = None,
        told: str = "",
        within: list[Any] | None = None,
    ) -> Any:
        return self._new(
            PARAMETER,
            ID=name,
            Value=ua.Variant(value, kind),
            Description=[ua.LocalizedText(told, "en")] if told else None,
            EngineeringUnits=unit.value() if unit is not None else None,
            Subparameters=within or None,
        )

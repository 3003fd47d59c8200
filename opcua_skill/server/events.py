"""What is told to the outside once it has been written: events, and the nodes that show state."""

from collections.abc import Awaitable, Callable
from typing import Any

from asyncua import ua
from asyncua.common.event_objects import BaseEvent
from asyncua.common.events import Event

from library.description import Failure, JobReport, JobState, SkillDescription
from opcua_skill.jobs.motion.release import QueueStatus
from opcua_skill.server.address_space import Tree
from opcua_skill.server.features.queue import queue_values
from opcua_skill.server.types import EVENT_TYPES
from opcua_skill.wire.from_client import FAILURE_NUMBERS

FIELDS = {name: dict(fields) for name, _, fields in EVENT_TYPES}
SEVERITY = {JobState.FAILED: 700, JobState.ABORTED: 500}
Listener = Callable[..., Awaitable[None]]


class EventPublisher:
    """Raises our events at the object they belong to, and keeps the nodes of deployed skills up to date."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self.on_deployment: list[Callable[[SkillDescription, str, bool], Awaitable[None]]] = []
        self.on_job: list[Callable[[JobReport], Awaitable[None]]] = []

    async def _raise(self, path: str, event_type: str, message: str, severity: int, **values: Any) -> None:
        event: Event = BaseEvent()
        event.add_property("EventType", self._tree.type_id(event_type), ua.VariantType.NodeId)
        event.add_property("Message", ua.LocalizedText(message), ua.VariantType.LocalizedText)
        event.add_property("Severity", severity, ua.VariantType.UInt16)
        for field, variant_type in FIELDS[event_type].items():
            event.add_property(field, values[field], variant_type)
        await self._tree.server.raise_event(self._tree.id(path), event)  # type: ignore[attr-defined]

    async def version_changed(self, description: SkillDescription, actor: str, comment: str) -> None:
        """A version was learned, approved, rejected, retired or imported."""
        what = f"{description.name} version {description.version}"
        await self._raise(
            "SkillLibrary",
            "SkillVersionStateEventType",
            f"{what} is {description.state.value}, by {actor}",
            300,
            SkillName=description.name,
            SkillVersion=description.version,
            State=description.state.value,
            ModelDigest=bytes.fromhex(description.model_digest),
            Actor=actor,
            Comment=comment,
        )

    async def deployment_changed(
        self, description: SkillDescription, workstation: str, there: bool, actor: str
    ) -> None:
        """A version was deployed or withdrawn: first the nodes, then the event."""
        for listener in self.on_deployment:
            await listener(description, workstation, there)
        verb = "deployed on" if there else "withdrawn from"
        path = f"Machines/{workstation}"
        await self._raise(
            path if self._tree.has(path) else "SkillLibrary",  # of another server that shares the library
            "DeploymentEventType",
            f"{description.name} version {description.version} {verb} {workstation} by {actor}",
            300,
            SkillName=description.name,
            SkillVersion=description.version,
            Workstation=workstation,
            Deployed=there,
            Actor=actor,
        )

    async def job_changed(self, report: JobReport) -> None:
        """A job has another state, or has come further."""
        for listener in self.on_job:
            await listener(report)
        severity = SEVERITY.get(report.state, 200)
        word = "" if report.failure is Failure.NONE else f"{report.failure.value}, "
        ended = f": {word}{report.message}" if report.message else ""
        path = f"Machines/{report.workstation}" if report.workstation else "SkillLibrary"
        common: dict[str, Any] = {
            "JobId": report.job_id,
            "State": report.state.value,
            "SkillName": report.skill_name,
            "SkillVersion": report.skill_version,
        }
        message = f"job {report.job_id} of {report.skill_name} is {report.state.value}{ended}"
        await self._raise(
            path,
            "JobStateEventType",
            message,
            severity,
            Kind=report.kind,
            Progress=report.progress,
            RecipeId=report.recipe_id,
            Workstation=report.workstation,
            Failure=FAILURE_NUMBERS[report.failure],
            **common,
        )
        if report.kind == "Learning" and report.state in {JobState.COMPLETED, JobState.FAILED, JobState.ABORTED}:
            await self._raise(path, "LearningFinishedEventType", message, severity, **common)

    async def queue_changed(self, workstation: str, status: QueueStatus) -> None:
        """A queue was held or released, or another number of jobs waits: first the nodes, then the event."""
        for name, value in queue_values(status).items():
            path = f"Machines/{workstation}/Queue/{name}"
            if self._tree.value(path) != value.Value:
                await self._tree.write(path, value)
        why = f" because of {status.because.value}" if status.held else ""
        await self._raise(
            f"Machines/{workstation}",
            "QueueEventType",
            f"the queue of {workstation} is {status.state}{why}, by {status.by or 'server'}: {status.waiting} waiting",
            600 if status.held else 200,
            Workstation=workstation,
            **{name: value.Value for name, value in queue_values(status).items()},
        )

    async def protective_stop(self, workstation: str, reason: str, actor: str) -> None:
        """An arm was stopped."""
        await self._raise(
            f"Machines/{workstation}",
            "ProtectiveStopEventType",
            f"protective stop on {workstation}: {reason}",
            900,
            Workstation=workstation,
            Reason=reason,
            Actor=actor,
        )

"""The server: library, job engine, address space and endpoint put together, started in order and stopped in order."""

import asyncio
import contextlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import urlsplit

from asyncua import ua

from library.description import AuditEntry, JobReport, SkillDescription
from library.errors import Damaged, LibraryUnusable
from library.private_files import make_private
from library.queries.leases import Lease
from library.store import SkillLibrary
from opcua_skill import messages
from opcua_skill.configuration.data_lock import DataLock, database_file
from opcua_skill.configuration.logs import Logs
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs import ArmFactory, JobEngine, Station, ready_to_move
from opcua_skill.jobs.motion.release import QueueStatus
from opcua_skill.jobs.station import model_of
from opcua_skill.security import ApplicationCertificate, Authenticator, SecuritySettings, ensure_server_certificate
from opcua_skill.security.access import caller
from opcua_skill.security.arm_lock import ArmLock, LockedByAnother
from opcua_skill.server.address_space import Tree, number, numbers, text, texts
from opcua_skill.server.address_space import count as count_of
from opcua_skill.server.auditing import AuditWriter
from opcua_skill.server.events import EventPublisher
from opcua_skill.server.features.audit import AuditMethods, add_audit
from opcua_skill.server.features.checking import CheckingMethods, add_checking
from opcua_skill.server.features.edits import EditMethods, add_edits
from opcua_skill.server.features.homing import HomingMethods, add_homing
from opcua_skill.server.features.library import LibraryMethods
from opcua_skill.server.features.library_nodes import add_library
from opcua_skill.server.features.queue import QueueMethods, add_queue
from opcua_skill.server.features.recorder import RecorderMethods
from opcua_skill.server.features.recorder_nodes import RecorderNodes, add_recorder
from opcua_skill.server.features.sessions import SessionMethods, add_sessions
from opcua_skill.server.features.skills import SkillNodes
from opcua_skill.server.features.workstation import WorkstationMethods
from opcua_skill.server.features.workstation_nodes import add_workstation
from opcua_skill.server.first_look import check_library_is_there, check_users, tell_doubles, tell_loose
from opcua_skill.server.health import Fault, FaultKind, Health
from opcua_skill.server.namespaces import add_namespaces
from opcua_skill.server.nodesets import OF_FACES
from opcua_skill.server.sharing import LEASE_SECONDS, Sharing, server_of
from opcua_skill.server.standing import Standing, told_of
from opcua_skill.server.types import add_types
from opcua_skill.stack.address_space.languages import Languages
from opcua_skill.stack.diagnostics.audit import SignInRecord, WriteRecord
from opcua_skill.stack.diagnostics.watchdog import Watchdog
from opcua_skill.stack.server import SkillServer
from opcua_skill.stack.services.calls import CallRecord, Refused
from opcua_skill.stack.sessions.sessions import Session
from opcua_skill.stack.transport.transport import ReservedPort
from opcua_skill.wire.from_client import audit_value
from opcua_skill.wire.refusals import Code
from sim.arm import ArmError, ArmState
from sim.arm_model import ArmModel
from sim.drivers.preconditions import LOWEST_OVERRIDE

if TYPE_CHECKING:
    from opcua_skill.server.faces.jobs.nodes import JobFace
    from opcua_skill.server.faces.machinery.nodes import MachineryFace

SHOW_STATE_EVERY = 0.1
MENTION_REFUSALS_EVERY = 1.0
PAGE = 500
APPLICATION_NAME = "opcua-skill"
HEALTHY, DEGRADED = 255, 199

_log = logging.getLogger(__name__)


@dataclass
class _Face:
    """One workstation as shown: its lock, its skills, and what was last shown of its arm."""

    station: Station
    lock: ArmLock
    skills: SkillNodes
    recorder: RecorderNodes
    jobs: "JobFace | None" = None
    machinery: "MachineryFace | None" = None
    shown: ArmState | None = None
    shown_lock: tuple[bool, str] = (False, "")


class SkillServerApp:
    """The whole server of one process. ``arm_factory`` makes arms: it is the only way anything can move."""

    def __init__(self, settings: Settings, arm_factory: ArmFactory) -> None:
        self.settings = settings
        self._arm_factory = arm_factory
        self._models: Mapping[str, ArmModel] = {one.name: model_of(one) for one in settings.workstations}
        self._faces: dict[str, _Face] = {}
        self._faults: tuple[Fault, ...] = ()
        self._showing: asyncio.Task[None] | None = None
        self._lock = DataLock(settings)
        self._logs = Logs()
        self.watchdog = Watchdog()
        self._mentioning: asyncio.Task[None] | None = None
        self._weakness = ""
        self._reading: asyncio.Task[None] | None = None
        self.library: SkillLibrary
        self.jobs: JobEngine
        self.server: SkillServer
        self._authenticator: Authenticator
        self._health: Health
        self._standing: Standing
        self._sharing: Sharing
        self._audit: AuditWriter
        self._tree: Tree
        self._methods: LibraryMethods
        self._tidings: EventPublisher

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    @property
    def endpoint(self) -> str:
        """The address clients connect to."""
        return self.server.url

    @property
    def insecure(self) -> tuple[str, ...]:
        """What the configuration weakens, in words; empty as it comes."""
        return (*self.server.insecure, *([self._weakness] if self._weakness else []))

    async def start(self) -> None:
        """Lock the data folder, bind the port, open the library, build the address space, the arms, the endpoint.

        What has been taken is given back when a later step fails. Nothing is read or written before the lock is held,
        and no job is touched before the port is.
        """
        settings = self.settings
        async with contextlib.AsyncExitStack() as undo:
            self._logs.start()
            undo.callback(self._logs.stop)
            make_private(settings.data)
            last = self._lock.take()
            undo.callback(self._lock.release)
            check_library_is_there(settings, last)
            database = database_file(settings)
            tell_loose(settings, *([database] if database else []))
            address = urlsplit(settings.endpoint)
            port = await ReservedPort.take(address.hostname or "", address.port or 0)
            undo.callback(port.close)
            self.library = await SkillLibrary.open(settings.database_address)
            undo.push_async_callback(self.library.close)
            own = await self._own_certificate()
            await self._take_workstations(own.installation)
            undo.push_async_callback(self.library.give_back_leases)
            self._weakness = await self.library.weakness()
            if self._weakness:
                _log.warning("%s: opcua-skill library prepare makes a role that cannot", self._weakness)
            users = await self.library.users()
            check_users(users)
            tell_doubles(users)
            self._authenticator = Authenticator(self.library)
            undo.callback(self._authenticator.close)
            self._health = Health(self.library, writable=self.library.check_writable, folder=settings.data)
            self._audit = AuditWriter(self.library, self._health.recorded)
            self._audit.start()
            undo.push_async_callback(self._audit.stop)
            self.jobs = JobEngine(
                self.library,
                settings,
                self._models,
                self._arm_factory,
                self._job_changed,
                self._version_changed,
                self._queue_changed,
            )
            # The arms' processes start while the address space is built: half of a start is waiting for them.
            starting = asyncio.create_task(self.jobs.start(), name="start jobs")
            undo.push_async_callback(self._stop_jobs, starting)
            await self._build(own)
            await starting
            for workstation in settings.workstations:
                await self._add_workstation(workstation.name)
            self._tidings.on_deployment.append(self._deployment_changed)
            self.server.iserver.on_session_closed.append(self._session_closed)
            await self.server.start(port)
            undo.pop_all()
        self._sharing.start()
        self._health.start()
        self.watchdog.start()
        self._standing.start()
        self._showing = asyncio.create_task(self._show_state(), name="show state of arms")
        self._mentioning = asyncio.create_task(self._mention_refusals(), name="mention refusals")
        # Read aside: it takes longer than anybody may hold the loop who asks for a language first.
        self._reading = asyncio.create_task(asyncio.to_thread(messages.read_all), name="read catalogues")

    async def _own_certificate(self) -> ApplicationCertificate:
        """Read the server's certificate and key, or make both in a new data folder."""
        settings = self.settings
        names = tuple(name for name in (urlsplit(settings.endpoint).hostname, *settings.host_names) if name)
        return await asyncio.to_thread(
            ensure_server_certificate,
            settings.data / "certificates",
            settings.application_uri,
            APPLICATION_NAME,
            names,
        )

    async def _take_workstations(self, installation: str) -> None:
        """Have the workstations for this server alone, where the library is shared; raises ServedElsewhere."""
        if self.library.shared:
            names = [one.name for one in self.settings.workstations]
            await self.library.serve_as(server_of(self.settings, installation), names, LEASE_SECONDS)

    async def _build(self, own: ApplicationCertificate) -> None:
        """Make the server and its address space, all but the workstations."""
        settings = self.settings
        self._installation = own.installation
        security = SecuritySettings(
            folder=settings.data / "certificates",
            endpoint=settings.endpoint,
            application_uri=own.application_uri,
            application_name=APPLICATION_NAME,
            host_names=settings.host_names,
            discovery_servers=settings.discovery_servers,
            insecure_no_encryption=settings.security.allow_no_security,
            insecure_anonymous=settings.security.allow_anonymous,
            insecure_trust_every_client=settings.security.trust_all_clients,
        )
        self.server = SkillServer(
            self._authenticator,
            security,
            on_call=self._record,
            on_sign_in=self._record_sign_in,
            on_written=self._record_write,
            languages=Languages(messages.languages(), messages.negotiated, messages.said),
        )
        await self.server.init()
        self._tree = await Tree.on(self.server, [name for face in settings.faces for name in OF_FACES[face]])
        await add_types(self._tree)
        await add_namespaces(self._tree)
        self._tidings = EventPublisher(self._tree)
        names = [one.name for one in settings.workstations]
        self._sharing = Sharing(self.library, names, self._tidings, self._look_anew, self._show_leases)
        methods = LibraryMethods(self.library, self.jobs, settings, self._tidings)
        self._methods = methods
        largest = self.server.stack_limits.largest_message
        await add_library(self._tree, methods, settings.limits, largest, self.insecure, settings.four_eyes)
        await add_edits(self._tree, EditMethods(self.library, self.jobs, settings))
        await add_audit(self._tree, AuditMethods(self.library))
        iserver = self.server.iserver
        self._standing = Standing(iserver, self.library, self._authenticator, self._record_standing)
        await add_sessions(self._tree, SessionMethods(iserver, iserver.end_session))

    async def _stop_jobs(self, starting: asyncio.Task[None]) -> None:
        """Give up a start that another part has spoiled."""
        starting.cancel()
        await asyncio.gather(starting, return_exceptions=True)
        await self.jobs.stop()

    async def stop(self) -> None:
        """Stop every motion, then close the endpoint, the workers and the library."""
        for task in (self._showing, self._mentioning, self._reading):
            if task is not None:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        await self._health.stop()
        await self.watchdog.stop()
        await self._standing.stop()
        await self.jobs.stop()
        await self.server.stop()
        self._authenticator.close()
        await self._audit.stop()
        await self._sharing.stop()
        await self.library.close()
        self._lock.release()
        self._logs.stop()

    async def _add_workstation(self, name: str) -> None:
        station = self.jobs.stations[name]
        lock = ArmLock(name)
        settings = next(one for one in self.settings.workstations if one.name == name)

        async def lock_changed() -> None:
            await self._show_lock(self._faces[name])

        methods = WorkstationMethods(self.library, self.jobs, station, lock, self.settings, self._tidings, lock_changed)
        skills = await add_workstation(self._tree, settings, station.model, methods, self._installation)
        await add_checking(self._tree, name, CheckingMethods(self.jobs, station))
        await add_homing(self._tree, name, HomingMethods(self.jobs, station, lock))
        await add_queue(self._tree, name, QueueMethods(station, lock))
        await self._show_deployed(name, skills)
        recording = RecorderMethods(name, self._methods, self.settings.limits, self.server.iserver.is_connected)
        recorder = await add_recorder(self._tree, recording)
        self._faces[name] = _Face(station, lock, skills, recorder)
        if "jobs" in self.settings.faces:
            from opcua_skill.server.faces.jobs.nodes import JobFace  # its cost is paid by who has configured it

            jobs = JobFace(self._tree, self.library, self.jobs, station, lock, self.settings.limits.max_job_orders)
            await jobs.add()
            self._faces[name].jobs = jobs
            self._tidings.on_job.append(jobs.job_changed)
            self._tidings.on_deployment.append(jobs.deployment_changed)
        if "machinery" in self.settings.faces:
            from opcua_skill.server.faces.machinery.nodes import MachineryFace

            machinery = MachineryFace(self._tree, station)
            await machinery.add()
            self._faces[name].machinery = machinery
            self._tidings.on_job.append(machinery.job_changed)

        async def set_override(value: Any) -> None:
            try:
                lock.check(caller().session_id)
            except LockedByAnother as locked:
                raise Refused(Code.BadLocked, str(locked)) from locked
            if not isinstance(value, float) or not LOWEST_OVERRIDE <= value <= 1.0:
                reason = f"SpeedOverride is {value}: it has to be {LOWEST_OVERRIDE} to 1; to stand still, pause the job"
                raise Refused(Code.BadOutOfRange, reason)
            try:
                await station.set_override(value)
            except ArmError as refused:
                raise Refused(Code.BadInvalidState, refused.text) from refused
            except LibraryUnusable as unusable:
                raise Refused(Code.BadResourceUnavailable, str(unusable)) from unusable

        self.server.obey_writes(self._tree.id(f"Machines/{name}/Arm/SpeedOverride"), set_override)

    async def _show_deployed(self, workstation: str, skills: SkillNodes) -> None:
        """Show what is deployed on a workstation; what is damaged is logged and left out, the rest is served."""
        after, more = "", True
        while more:
            found, after = await self.library.find(workstation=workstation, after=after, limit=PAGE)
            for one in found:
                try:
                    await skills.show(await self.library.description(one.name, one.version))
                except Damaged:
                    _log.exception("%s is not shown on %s", one.name, workstation)
            more = bool(after)

    async def _record(self, record: CallRecord) -> None:
        """Write a call into the audit trail; the stack raises the audit event afterwards."""
        await self._audit.add(
            AuditEntry(
                actor=record.caller.name,
                role=record.caller.role.value,
                action=record.method_name,
                target=record.object_id.to_string(),
                arguments={name: audit_value(value) for name, value in record.arguments},
                status=record.status_name,
                reason=record.reason,
            )
        )

    async def _record_sign_in(self, record: SignInRecord) -> None:
        """Write a sign-in, let in or not, into the audit trail."""
        await self._audit.add(
            AuditEntry(
                actor=record.user,
                role=record.role,
                action="SignIn",
                target=record.peer,
                arguments={"kind": record.kind},
                status=record.status_name,
            )
        )

    async def _record_standing(self, session: Session, action: str, why: str) -> None:
        """Write into the audit trail that a session was ended, or goes on with another role, and why."""
        about = told_of(session)
        await self._audit.add(
            AuditEntry("server", "", action, session.session_id.to_string(), about, status="Good", reason=why)
        )

    async def _record_write(self, record: WriteRecord) -> None:
        """Write what a variable was told to do, and whether it was, into the audit trail."""
        await self._audit.add(
            AuditEntry(
                actor=record.caller.name,
                role=record.caller.role.value,
                action="Write",
                target=record.node_id.to_string(),
                arguments={"Value": audit_value(record.new.Value)},
                status=record.status_name,
                reason=record.reason,
            )
        )

    async def _queue_changed(self, workstation: str, status: QueueStatus) -> None:
        if workstation in self._faces:
            await self._tidings.queue_changed(workstation, status)
            jobs = self._faces[workstation].jobs
            if jobs is not None:
                await jobs.orders.show()
            machinery = self._faces[workstation].machinery
            if machinery is not None:
                await machinery.show()

    async def _version_changed(self, description: SkillDescription, actor: str, comment: str) -> None:
        await self._tidings.version_changed(description, actor, comment)

    async def _job_changed(self, report: JobReport) -> None:
        face = self._faces.get(report.workstation)
        if face is not None:
            # First the arm: whoever is told how a job ended must not read what the arm was before.
            await self._show_arm(report.workstation, face)
            await face.skills.job_changed(report)
        await self._tidings.job_changed(report)

    async def _look_anew(self, workstation: str) -> None:
        """Show what is deployed on a workstation as it is in the library, however it came there."""
        skills, there = self._faces[workstation].skills, {}
        for description in await self.library.deployments(workstation):
            there[description.name] = description.version
            if skills.shown.get(description.name) != description.version:
                await self._tidings.deployment_changed(description, workstation, True, "another server")
        for name, version in list(skills.shown.items()):
            if name not in there:
                description = await self.library.description(name, version)
                await self._tidings.deployment_changed(description, workstation, False, "another server")

    async def _show_leases(self, leases: Sequence[Lease]) -> None:
        for name, values in (
            ("LeasedWorkstations", [one.workstation for one in leases]),
            ("LeasedBy", [one.endpoint for one in leases]),
        ):
            if self._tree.value(f"SkillLibrary/{name}") != values:
                await self._tree.write(f"SkillLibrary/{name}", texts(values))

    async def _deployment_changed(self, description: SkillDescription, workstation: str, there: bool) -> None:
        if workstation not in self._faces:
            return
        skills = self._faces[workstation].skills
        if there:
            await skills.show(description)
        else:
            await skills.hide(description.name)

    async def _session_closed(self, session_id: str) -> None:
        for face in self._faces.values():
            face.recorder.methods.session_closed(session_id)
            if face.lock.session_closed(session_id):
                await self._show_lock(face)

    async def _show_state(self) -> None:
        """Keep the arms' nodes true: only what changed is written, at most ten times a second."""
        while True:
            for name, face in self._faces.items():
                try:
                    await self._show_arm(name, face)
                    if face.machinery is not None:
                        await face.machinery.show()
                    await self._show_lock(face)
                    await face.recorder.show()
                except Exception:
                    _log.exception("showing the arm and the recorder of %s failed", name)
            await self._show_service_level()
            await asyncio.sleep(SHOW_STATE_EVERY)

    async def _show_service_level(self) -> None:
        """Tell clients when an arm waits for a reset, or the library is in trouble: the server serves, but not well."""
        waiting = [name for name, face in self._faces.items() if not ready_to_move(face.station.arm.state())]
        faults = (
            *self._health.told,
            *self._sharing.faults,
            *(Fault(FaultKind.ARM_WAITING, f"{name} waits for a reset") for name in waiting),
        )
        if faults == self._faults:
            return
        self._faults = faults
        words = [fault.words for fault in faults]
        await self._tree.write("SkillLibrary/Faults", texts(words))
        await self._tree.write("SkillLibrary/FaultKinds", texts([fault.kind.value for fault in faults]))
        level = DEGRADED if faults else HEALTHY
        await self.server.set_service_level(level, because="; ".join(words) or "every arm is ready")

    async def _mention_refusals(self) -> None:
        """Write down, now and then, how many refusals were only counted, so that nobody can fill the disk with them."""
        while True:
            await asyncio.sleep(MENTION_REFUSALS_EVERY)
            if dropped := self._logs.take_dropped():
                self._health.lost(FaultKind.RECORDS_DROPPED, f"{dropped} lines of the log were dropped: too many came")
            await self._tree.write("SkillLibrary/LongestHold", number(self.watchdog.longest))
            await self._tree.write("SkillLibrary/Holds", count_of(self.watchdog.holds))
            for who, count in self.server.iserver.method_service.refusals.take_beyond().items():
                name = who if isinstance(who, str) else ", ".join(str(part) for part in who)  # type: ignore[attr-defined]
                words = f"{count} more refusals of {name[:200]} were counted and not recorded one by one"
                _log.warning("%s", words)
                self._health.lost(FaultKind.RECORDS_DROPPED, words)
                await self._audit.add(
                    AuditEntry(actor=name, action="Refused", arguments={"count": count}, reason=words)
                )

    async def _show_arm(self, name: str, face: _Face) -> None:
        state, before, path = face.station.arm.state(), face.shown, f"Machines/{name}/Arm"
        if state == before:
            return
        boolean = ua.VariantType.Boolean
        for field, value, old in (
            ("Position", numbers(state.joints), before and numbers(before.joints)),
            ("ToolPose", numbers(state.tool_pose), before and numbers(before.tool_pose)),
            ("Mode", text(state.mode.value), before and text(before.mode.value)),
            ("AtRest", ua.Variant(state.at_rest, boolean), before and ua.Variant(before.at_rest, boolean)),
            ("Known", ua.Variant(state.known, boolean), before and ua.Variant(before.known, boolean)),
            ("Fault", text(state.fault), before and text(before.fault)),
            ("SpeedOverride", number(state.override), before and number(before.override)),
        ):
            if value != old:
                await self._tree.write(f"{path}/{field}", value)
        face.shown = state

    async def _show_lock(self, face: _Face) -> None:
        holder, path = face.lock.holder, f"Machines/{face.station.name}/Arm/Lock"
        shown = (holder is not None, holder.session_id if holder else "")
        if holder is not None:
            await self._tree.write(f"{path}/RemainingLockTime", number(1000.0 * face.lock.remaining_seconds))
        if shown == face.shown_lock:
            return
        face.shown_lock = shown
        await self._tree.write(f"{path}/Locked", ua.Variant(shown[0], ua.VariantType.Boolean))
        await self._tree.write(f"{path}/LockingUser", text(holder.user if holder else ""))
        await self._tree.write(f"{path}/LockingClient", text(holder.client if holder else ""))
        if holder is None:
            await self._tree.write(f"{path}/RemainingLockTime", number(0.0))

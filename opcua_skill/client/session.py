"""A signed-in, encrypted connection: calls with exact refusals, reads, and events."""

import asyncio
import contextlib
import functools
import logging
import struct
import uuid
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.subscription import DataChangeEvent, OpcEvent
from asyncua.crypto import uacrypto
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes
from asyncua.ua.ua_binary import struct_from_binary, variant_to_binary
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa

from opcua_skill.client.audit import AuditReasons
from opcua_skill.client.certificates import APPLICATION_URI, KnownServers, client_folder
from opcua_skill.client.errors import (
    NOT_TRUSTED,
    SIGN_IN_REFUSALS,
    ClientError,
    NotSignedIn,
    Refused,
    Unreachable,
    WrongArgument,
    meaning,
    status_name,
)
from opcua_skill.security import ApplicationCertificate, ensure_client_certificate
from opcua_skill.wire.structures import load_structures

TYPES = "urn:opcua-skill:types"
INSTANCES = "urn:opcua-skill:instances"
MACHINES = "Machines"
UNKNOWN_NODE = frozenset({"BadNodeIdUnknown", "BadNotFound"})
CANNOT_BE_SENT = (struct.error, TypeError, ValueError, AttributeError, ua.UaError)
PROBE_EVERY = 15.0
"""How often the connection is probed, in s, and how long a probe may take: a busy machine is no lost connection."""
log = logging.getLogger(__name__)


@functools.lru_cache(maxsize=8)
def private_key(pem: bytes) -> rsa.RSAPrivateKey:
    """Return the private key in a PEM file; that it is a sound one is checked once, most of the time of a sign-in."""
    refusal = "the client's private key is not an RSA key: move its file away to have a new one made"
    try:
        key = serialization.load_pem_private_key(pem, None)
    except (ValueError, TypeError) as error:
        raise ClientError(f"{refusal} ({error})") from error
    if not isinstance(key, rsa.RSAPrivateKey):
        raise ClientError(refusal)
    return key


@dataclass(frozen=True, slots=True)
class Event:
    """An event as a client sees it: what kind, who, the sentence, how bad (1 to 1000), its job and skill, if any."""

    kind: ua.NodeId
    source: str
    message: str
    severity: int
    job_id: str
    progress: float | None
    skill_name: str = ""


SESSION_ENDED = frozenset({StatusCodes.BadSessionClosed, StatusCodes.BadSessionIdInvalid})


class Session:
    """One connection. Its requests are served one after another: open a second one to watch a long call."""

    def __init__(
        self,
        url: str,
        user: str,
        password: str,
        *,
        folder: Path | None = None,
        timeout: float = 30.0,
        secure: bool = True,
    ) -> None:
        """``secure=False`` is for servers whose configuration says so in as many words; then nothing is encrypted."""
        self.url = url
        self.user = user
        self._folder = folder or client_folder()
        self._secure = secure
        self._client = Client(url, timeout=timeout, watchdog_intervall=PROBE_EVERY)
        self._client.session_timeout = 120_000
        self._client.name = self._client.description = "opcua-skill"
        self._client.application_uri = APPLICATION_URI
        if user:
            self._client.set_user(user)
            self._client.set_password(password)
        self._types = 0
        self._instances = 0
        self._structures: dict[str, type] = {}
        self._reasons: AuditReasons | None = None

    async def open(self) -> None:
        """Connect, sign in and read the server's structures."""
        try:
            if self._secure:
                await self._secure_channel()
            await self._client.connect()
        except ua.uaerrors.BadTooManySessions as error:
            raise NotSignedIn(f"{self.url}: {SIGN_IN_REFUSALS[error.code]}", status_name(error.code)) from error
        except ua.UaStatusCodeError as error:
            raise NotSignedIn(await self._why_not(error.code), status_name(error.code)) from error
        except (OSError, TimeoutError, ua.UaError) as error:
            raise Unreachable(f"no OPC UA server answers at {self.url}: is it running? ({describe(error)})") from error
        try:
            self._types = await self._client.get_namespace_index(TYPES)
            self._instances = await self._client.get_namespace_index(INSTANCES)
            await load_structures(self._client, self._types)
            self._reasons = await AuditReasons.subscribe(self._client)
        except ValueError as error:
            await self.close()
            raise ClientError(f"the server at {self.url} is not an opcua-skill server") from error
        except (OSError, TimeoutError, ua.UaError) as error:
            await self.close()
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Sign out and disconnect; a connection already lost is no fault here."""
        if self._reasons is not None:
            await self._reasons.close()
        with contextlib.suppress(OSError, TimeoutError, ua.UaError):
            await self._client.disconnect()

    async def __aenter__(self) -> "Session":
        await self.open()
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()

    async def _secure_channel(self) -> None:
        mine = await self._certificate()
        endpoints = await self._client.connect_and_get_server_endpoints()
        endpoint = Client.find_endpoint(
            endpoints, ua.MessageSecurityMode.SignAndEncrypt, SecurityPolicyBasic256Sha256.URI
        )
        KnownServers(self._folder / "servers").meet(self.url, endpoint.ServerCertificate)
        theirs = await uacrypto.load_certificate(endpoint.ServerCertificate)
        key = private_key(await asyncio.to_thread(mine.key_file.read_bytes))
        mode = ua.MessageSecurityMode.SignAndEncrypt
        policy = SecurityPolicyBasic256Sha256(theirs, mine.certificate(), key, mode, host_cert_chain=[])
        self._client.security_policy = policy
        self._client.uaclient.set_security(policy)

    async def _certificate(self) -> ApplicationCertificate:
        try:
            return await asyncio.to_thread(ensure_client_certificate, self._folder, APPLICATION_URI)
        except ValueError as unusable:
            raise ClientError(str(unusable)) from unusable

    async def _why_not(self, code: int) -> str:
        why = SIGN_IN_REFUSALS.get(code, meaning(code))
        if code in NOT_TRUSTED:  # only the server knows its data folder: its log has the whole command
            file = (await self._certificate()).certificate_file
            why += f"; the server's log has the command that lets it in (certificates trust); here it is kept in {file}"
        return f"{self.url} does not let {self.user or 'you'} in: {why} [{status_name(code)}]"

    def structure(self, name: str) -> type:
        """Return the class of one of the server's structures, by its name in INTERFACE section 4."""
        if name not in self._structures:
            self._structures[name] = getattr(ua, name)
        return self._structures[name]

    def node(self, path: str) -> ua.NodeId:
        """Return the NodeId of a browse path in the instance namespace."""
        return ua.NodeId(ua.String(path), ua.Int16(self._instances))

    async def children(self, name: str) -> list[str]:
        """Return the names of the objects under ``Objects/<name>``, a node that may belong to a companion standard."""
        for child in await self._client.nodes.objects.get_children_descriptions():
            if child.BrowseName.Name == name:
                below = await self._client.get_node(child.NodeId).get_children_descriptions()
                return list(dict.fromkeys(one.BrowseName.Name for one in below if one.NodeClass == ua.NodeClass.Object))
        return []

    async def read(self, *paths: str) -> list[Any]:
        """Return the values of variables, by browse path, in one request."""
        try:
            told = await self._client.uaclient.read_attributes([self.node(path) for path in paths], AttributeIds.Value)
        except ua.UaStatusCodeError as error:
            raise Refused("Read", status_name(error.code), "", f"{', '.join(paths)}: {meaning(error.code)}") from error
        except (OSError, TimeoutError) as error:
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error
        for path, one in zip(paths, told, strict=True):
            if one.StatusCode is not None and one.StatusCode.is_bad():
                await self._check_workstation(path, "Read", one.StatusCode.name)
                raise Refused("Read", one.StatusCode.name, "", f"{path}: {meaning(one.StatusCode.value)}")
        return [one.Value.Value if one.Value is not None else None for one in told]

    async def write(self, path: str, value: ua.Variant) -> None:
        """Write a variable that clients may set; the server may refuse like a call."""
        node = self._client.get_node(self.node(path))
        try:
            await node.write_attribute(AttributeIds.Value, ua.DataValue(value))
        except CANNOT_BE_SENT as error:
            if not isinstance(error, ua.UaStatusCodeError):
                raise _wrong(path.rsplit("/", 1)[-1], value) from error
            await self._check_workstation(path, "Write", status_name(error.code))
            raise Refused("Write", status_name(error.code), path.rsplit("/", 1)[-1], meaning(error.code)) from error
        except (OSError, TimeoutError) as error:
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error

    async def may(self, *methods: str) -> list[bool]:
        """Return for each method, by browse path, whether the server says that this user may call it."""
        nodes = [self.node(path) for path in methods]
        try:
            results = await self._client.uaclient.read_attributes(nodes, AttributeIds.UserExecutable)
        except (OSError, TimeoutError) as error:
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error
        return [bool(one.Value and one.Value.Value) for one in results]

    async def call(self, place: str, method: str, **arguments: ua.Variant) -> Sequence[Any]:
        """Call ``place/method`` and return its output values.

        ``arguments`` are named and ordered as in INTERFACE section 5, so that a refusal can name the one at fault.
        """
        entry = uuid.uuid4().hex
        request = ua.CallRequest()
        request.RequestHeader.AuditEntryId = entry
        request.Parameters.MethodsToCall = [
            ua.CallMethodRequest(self.node(place), self.node(f"{place}/{method}"), list(arguments.values()))
        ]
        try:
            result = await self._send(request)
        except ua.UaStatusCodeError as error:
            if error.code in SESSION_ENDED:
                raise Unreachable(f"the server at {self.url} has ended the session of {self.user}") from error
            raise Refused(method, status_name(error.code), "", meaning(error.code)) from error
        except (OSError, TimeoutError) as error:
            raise Unreachable(f"{method} got no answer from {self.url}: {describe(error)}") from error
        except CANNOT_BE_SENT as error:
            for name, variant in arguments.items():
                if not _can_be_sent(variant):
                    raise _wrong(name, variant) from error
            raise
        if not result.StatusCode.is_good():
            await self._check_workstation(place, method, result.StatusCode.name)
            raise await self._refusal(f"{place}/{method}", entry, arguments, result)
        return [variant.Value for variant in result.OutputArguments or ()]

    async def _send(self, request: ua.CallRequest) -> ua.CallMethodResult:
        protocol = self._client.uaclient.protocol
        if protocol is None:
            raise ConnectionError("the connection is closed")
        response = struct_from_binary(ua.CallResponse, await protocol.send_request(request))
        response.ResponseHeader.ServiceResult.check()
        return response.Results[0]

    async def _check_workstation(self, path: str, method: str, status: str) -> None:
        """Raise Refused with the workstations that there are, if a path leads to none of them."""
        parts = path.split("/")
        if parts[0] != MACHINES or len(parts) < 2 or status not in UNKNOWN_NODE:
            return
        there = await self.children(MACHINES)
        if parts[1] not in there:
            reason = f"there is no workstation {parts[1]} on this server: it has {', '.join(there) or 'none'}"
            raise Refused(method, "BadNotFound", "Workstation", reason)

    async def _refusal(
        self, path: str, entry: str, arguments: Mapping[str, ua.Variant], result: ua.CallMethodResult
    ) -> Refused:
        at_fault = [
            (name, code)
            for name, code in zip(arguments, result.InputArgumentResults or (), strict=False)
            if not code.is_good()
        ]
        argument, detail = at_fault[0] if at_fault else ("", result.StatusCode)
        told = await self._reasons.reason(entry, self.node(path), self.user) if self._reasons else ""
        status = result.StatusCode.name
        reason = told.partition(f"{status}: ")[2] or told or meaning(detail.value)
        return Refused(path.rsplit("/", 1)[-1], status, argument, reason, detail.name if argument else "")

    @contextlib.asynccontextmanager
    async def changes(self, *paths: str, every: float = 0.1) -> AsyncIterator[asyncio.Event]:
        """Yield an event that is set when one of these variables has changed, at most every ``every`` s."""
        nodes = [self._client.get_node(self.node(path)) for path in paths]
        changed = asyncio.Event()
        try:
            subscription = await self._client.create_subscription(1000.0 * every, None)
            await subscription.subscribe_data_change(nodes)
        except (OSError, TimeoutError, ua.UaError) as error:
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error
        telling = asyncio.create_task(_tell_changes(subscription, changed))
        try:
            yield changed
        finally:
            telling.cancel()
            await asyncio.gather(telling, return_exceptions=True)
            with contextlib.suppress(OSError, TimeoutError, ua.UaError):
                await subscription.delete()

    @contextlib.asynccontextmanager
    async def events(self) -> AsyncIterator["asyncio.Queue[Event]"]:
        """Yield a queue that receives every event the server tells, newest last, while the block runs."""
        queue: asyncio.Queue[Event] = asyncio.Queue(maxsize=1000)
        base = ua.NodeId(ua.Int32(ObjectIds.BaseEventType))
        names = ["EventType", "SourceName", "Message", "Severity"]
        paths = [[ua.QualifiedName(name)] for name in names] + [
            [ua.QualifiedName(name, self._types)] for name in ("JobId", "Progress", "SkillName")
        ]
        clauses = [ua.SimpleAttributeOperand(base, path, AttributeIds.Value) for path in paths]

        try:
            subscription = await self._client.create_subscription(100, None)
            await subscription.subscribe_events(
                self._client.nodes.server, evfilter=ua.EventFilter(SelectClauses=clauses), queuesize=1000
            )
        except (OSError, TimeoutError, ua.UaError) as error:
            raise Unreachable(f"the connection to {self.url} broke: {describe(error)}") from error
        try:
            pump = asyncio.create_task(pump_events(subscription, queue))
            try:
                yield queue
            finally:
                pump.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await pump
        finally:
            with contextlib.suppress(OSError, TimeoutError, ua.UaError):
                await subscription.delete()


async def _tell_changes(subscription: Any, changed: asyncio.Event) -> None:
    """Set ``changed`` whenever a subscription brings a value."""
    async for told in subscription:
        if isinstance(told, DataChangeEvent):
            changed.set()


async def pump_events(subscription: Any, queue: "asyncio.Queue[Event]") -> None:
    """Move a subscription's events into a queue; the oldest gives way when nobody reads."""
    async for told in subscription:
        if not isinstance(told, OpcEvent):
            continue
        fields = told.event.get_event_props_as_fields_dict()
        message = fields["Message"].Value
        if queue.full():
            queue.get_nowait()
        queue.put_nowait(
            Event(
                kind=fields["EventType"].Value,
                source=fields["SourceName"].Value or "",
                message=(message.Text or "") if message else "",
                severity=int(fields["Severity"].Value or 0),
                job_id=fields["JobId"].Value or "",
                progress=fields["Progress"].Value,
                skill_name=fields["SkillName"].Value or "",
            )
        )


def _can_be_sent(variant: ua.Variant) -> bool:
    try:
        variant_to_binary(variant)
    except CANNOT_BE_SENT:
        return False
    return True


def _wrong(name: str, variant: ua.Variant) -> WrongArgument:
    kind = variant.VariantType.name
    article = "an" if kind[0] in "AEIO" else "a"  # "a UInt32" begins with a consonant when it is said
    return WrongArgument(name, variant.Value, f"{article} {kind}{' array' if variant.is_array else ''}")


def describe(error: BaseException) -> str:
    """Return an exception as words: some of asyncio's have none of their own."""
    return str(error) or type(error).__name__

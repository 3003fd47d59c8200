"""The server's front: starts safe, says what is not, and delivers events to everybody who may hear them."""

import asyncio
import copy
import gc
import logging
import math
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import asyncua
from asyncua import ua
from asyncua.common.events import Event
from asyncua.common.node import Node
from asyncua.server.server import Server
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.security.access import SignIn
from opcua_skill.security.certificates import ApplicationCertificate, ensure_server_certificate
from opcua_skill.security.settings import SecuritySettings
from opcua_skill.stack.address_space.capabilities import capabilities, product_version, tell
from opcua_skill.stack.address_space.events import call_event, deliver
from opcua_skill.stack.address_space.languages import Languages
from opcua_skill.stack.address_space.standard_nodes import (
    list_modelling_rules,
    standard_values,
    take_away,
    tell_local_time,
)
from opcua_skill.stack.diagnostics.audit import OnSignIn, OnWrite
from opcua_skill.stack.internal_server import SkillInternalServer
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.calls import CallRecord, OnCall
from opcua_skill.stack.services.discovery import Registration
from opcua_skill.stack.services.server_methods import ServerMethods
from opcua_skill.stack.transport.decoding import install
from opcua_skill.stack.transport.transport import Acceptor, ReservedPort

log = logging.getLogger(__name__)
ASYNCUA_VERSION = "2.1.0"
DRAIN_SECONDS = 5.0
_POLICIES = {
    "Basic256Sha256": ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    "Aes128_Sha256_RsaOaep": ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    "Aes256_Sha256_RsaPss": ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
}


@contextmanager
def _no_garbage_collected() -> Iterator[None]:
    """Do without the search for circular garbage: going through all that stays takes half of a start."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _shutdown_in(seconds: int, reason: str) -> dict[int, ua.Variant]:
    return {
        Ids.Server_ServerStatus_SecondsTillShutdown: ua.Variant(seconds, ua.VariantType.UInt32),
        Ids.Server_ServerStatus_ShutdownReason: ua.Variant(ua.LocalizedText(reason), ua.VariantType.LocalizedText),
    }


class WrongAsyncua(RuntimeError):
    """The stack reaches into asyncua; only the version it was tested with may run."""

    def __init__(self, found: str) -> None:
        super().__init__(f"asyncua {found} is installed, the server runs with {ASYNCUA_VERSION} only: install that one")


class SkillServer(Server):
    """An OPC UA server a plant can leave running.

    ``await init()`` loads the address space and makes or loads the certificate, ``await start()`` opens the endpoint.
    ``on_call`` is awaited after every call of a method that changes something, and after every refusal, ``on_sign_in``
    after every sign-in that was let in or refused, ``on_written`` after every write to a variable that commands
    something; then the audit event is raised: what is told has been written. ``languages`` are those that its texts can
    be said in.
    """

    iserver: SkillInternalServer  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        authenticate: SignIn,
        security: SecuritySettings,
        *,
        on_call: OnCall | None = None,
        on_sign_in: OnSignIn | None = None,
        on_written: OnWrite | None = None,
        limits: Limits | None = None,
        languages: Languages | None = None,
    ) -> None:
        if asyncua.__version__ != ASYNCUA_VERSION:
            raise WrongAsyncua(asyncua.__version__)
        self.security = security
        self.stack_limits = limits or Limits()
        self.certificate: ApplicationCertificate | None = None
        self._on_call = on_call
        install(self.stack_limits)
        super().__init__(iserver=SkillInternalServer(authenticate, security, self.stack_limits))
        self.iserver.method_service.on_call = self._called
        self.iserver.method_service.on_unrecorded = self._told
        self.iserver.languages = languages or Languages()
        self.iserver.on_sign_in = on_sign_in
        self.iserver.on_written = on_written
        self._registrations: list[Registration] = []
        self.name = security.application_name
        self.set_endpoint(security.endpoint)
        self.application_type = ua.ApplicationType.Server
        self._application_uri = security.application_uri
        self.product_uri = "urn:opcua-skill"
        self.manufacturer_name = "opcua-skill"
        tokens: list[type] = [ua.UserNameIdentityToken, ua.X509IdentityToken]
        self.set_identity_tokens([*tokens, ua.AnonymousIdentityToken] if security.insecure_anonymous else tokens)
        policies = [_POLICIES[name] for name in security.policies]
        self.set_security_policy([*policies, ua.SecurityPolicyType.NoSecurity] if self._no_encryption else policies)
        self.limits.max_message_size = self.stack_limits.largest_message
        self.limits.max_chunk_count = math.ceil(self.stack_limits.largest_message / 8192) + 1

    @property
    def _no_encryption(self) -> bool:
        return self.security.insecure_no_encryption

    @property
    def insecure(self) -> tuple[str, ...]:
        """Return in words what protects less than it should: empty for a server as it comes."""
        return self.security.insecure

    @property
    def url(self) -> str:
        """Return the address clients connect to, with the port that was really taken."""
        if self.bserver is None:
            return self.endpoint.geturl()
        host = self.endpoint.hostname or "127.0.0.1"
        return self.endpoint._replace(netloc=f"{host}:{self.bserver.port}").geturl()

    async def init(self, shelf_file: Path | None = None) -> None:
        """Load the standard address space, and make or load the server's key and certificate."""
        with _no_garbage_collected():
            await super().init(shelf_file)
        hosts = tuple(name for name in (self.endpoint.hostname, *self.security.host_names) if name)
        self.certificate = await asyncio.to_thread(
            ensure_server_certificate,
            self.security.folder,
            self.security.application_uri,
            self.security.application_name,
            hosts,
        )
        await self.load_certificate(self.certificate.certificate_file)
        await self.load_private_key(self.certificate.key_file)
        take_away(self.iserver.aspace)
        list_modelling_rules(self.iserver)
        tell_local_time(self.iserver.aspace)
        await tell(
            self.iserver, capabilities(self.stack_limits, self.security, self.iserver.languages) | standard_values()
        )
        ServerMethods(self.iserver).offer()
        await self.iserver.diagnostics.offer()
        await tell(self.iserver, _shutdown_in(0, ""))
        now, release = datetime.now(UTC), product_version()
        await self.set_build_info(self.product_uri, self.manufacturer_name, self.name, release, release, now)

    async def start(self, reserved: ReservedPort | None = None) -> None:
        """Open the endpoint, on a port that was reserved if one was.

        Insecure settings are said in the log before the first client can connect.
        """
        for words in self.insecure:
            log.warning("insecure by configuration: %s", words)
        await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self._get_bind_socket_info()
        try:
            self.bserver = Acceptor(self.iserver, host or "", port or 0, self.limits)
            self.bserver.reserved = reserved
            self.bserver.set_policies(self._policies)
            await self.bserver.start()
        except BaseException:
            await self.iserver.stop()
            raise
        self.iserver.diagnostics.start()
        self._tell_real_port()
        log.info("listening on %s", self.url)
        for url in self.security.discovery_servers:
            registration = Registration(self, self.url, self.certificate, url)
            self._registrations.append(registration)
            registration.start()

    async def stop(self) -> None:
        """Close every connection and stop; calls that are still changing something get a moment to end."""
        await self._tell_shutdown()
        for registration in self._registrations:
            await registration.stop()
        await self.iserver.diagnostics.stop()
        await self.iserver.method_service.drain(DRAIN_SECONDS)
        await super().stop()

    async def _tell_shutdown(self) -> None:
        """Tell clients that the server ends; those who are connected see it while calls still end."""
        told = copy.copy(await self.iserver.server_status_node.read_value())
        values = _shutdown_in(int(DRAIN_SECONDS), "the server is stopped")
        told.State = ua.ServerState.Shutdown
        told.ShutdownReason = values[Ids.Server_ServerStatus_ShutdownReason].Value
        told.SecondsTillShutdown = values[Ids.Server_ServerStatus_SecondsTillShutdown].Value
        values[Ids.Server_ServerStatus] = ua.Variant(told, ua.VariantType.ExtensionObject)
        values[Ids.Server_ServerStatus_State] = ua.Variant(int(told.State), ua.VariantType.Int32)
        await tell(self.iserver, values)

    async def set_service_level(self, level: int, *, because: str) -> None:
        """Tell clients how well the server serves: from 200 healthy, from 2 degraded, 1 no data, 0 maintenance."""
        log.info("service level %d: %s", level, because)
        await tell(self.iserver, {Ids.Server_ServiceLevel: ua.Variant(level, ua.VariantType.Byte)})

    async def raise_event(self, node: Node | ua.NodeId, event: Event) -> None:
        """Give an event to the subscribers of a node, of its notifiers upwards, and of the Server object."""
        await deliver(self.iserver, node.nodeid if isinstance(node, Node) else node, event)

    def on_session_closed(self, hook: Callable[[str], Awaitable[None]]) -> None:
        """Have a coroutine awaited with the session's id whenever a session ends, for locks that end with it."""
        self.iserver.on_session_closed.append(hook)

    def restrict_writes(self, node: Node | ua.NodeId, roles: Any) -> None:
        """Say which roles may write a variable; without this a writable one may be written from operator upwards."""
        self.iserver.restrict_writes(node.nodeid if isinstance(node, Node) else node, frozenset(roles))

    def obey_writes(self, node: Node | ua.NodeId, obey: Callable[[Any], Awaitable[None]]) -> None:
        """Have a client's write to a variable carried out first; if ``obey`` raises Refused, nothing is written."""
        self.iserver.on_write[node.nodeid if isinstance(node, Node) else node] = obey

    async def _called(self, record: CallRecord) -> None:
        if self._on_call is not None:
            await self._on_call(record)
        await self._told(record)

    async def _told(self, record: CallRecord) -> None:
        await self.raise_event(record.object_id, call_event(record, self.security.application_uri))

    def _tell_real_port(self) -> None:
        """Put the port that was taken into the endpoint descriptions when port 0 asked for a free one."""
        if self.endpoint.port:
            return
        for endpoint in self.iserver.endpoints:
            endpoint.EndpointUrl = self.url
            endpoint.Server.DiscoveryUrls = [self.url]

    def _set_endpoints(self, policy: Any, mode: ua.MessageSecurityMode, level: int) -> None:
        super()._set_endpoints(policy, mode, level)
        for endpoint in self.iserver.endpoints:
            for token in endpoint.UserIdentityTokens:
                if (
                    token.TokenType == ua.UserTokenType.UserName
                    and endpoint.SecurityMode != ua.MessageSecurityMode.None_
                ):
                    token.SecurityPolicyUri = endpoint.SecurityPolicyUri

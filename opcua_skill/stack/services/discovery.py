"""Registration with a local discovery server, renewed while the server runs and taken back when it stops."""

import asyncio
import contextlib
import logging
from typing import Any

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto import security_policies
from asyncua.server.server import Server

from opcua_skill.security.certificates import ApplicationCertificate

log = logging.getLogger(__name__)
RENEW_SECONDS = 60.0
_POLICIES: dict[str, Any] = {
    policy.URI: policy
    for policy in (
        security_policies.SecurityPolicyAes256Sha256RsaPss,
        security_policies.SecurityPolicyAes128Sha256RsaOaep,
        security_policies.SecurityPolicyBasic256Sha256,
    )
}
FAULTS = (ua.UaError, OSError, TimeoutError, asyncio.TimeoutError)


class Registration:
    """Keeps a server registered at one discovery server. A discovery server that is away is tried again."""

    def __init__(
        self,
        server: Server,
        own_url: str,
        certificate: ApplicationCertificate | None,
        url: str,
        *,
        renew_seconds: float = RENEW_SECONDS,
    ) -> None:
        self.url = url
        self._own_url = own_url
        self._certificate = certificate
        self.registered = False
        self._server = server
        self._renew_seconds = renew_seconds
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Register, and go on registering."""
        self._task = asyncio.create_task(self._renew(), name=f"registration at {self.url}")

    async def stop(self) -> None:
        """Take the registration back."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self.registered:
            try:
                await self._tell(online=False)
            except FAULTS as error:
                log.warning("could not take back the registration at %s: %s", self.url, error)

    async def _renew(self) -> None:
        while True:
            try:
                await self._tell(online=True)
            except FAULTS as error:
                log.warning("could not register at %s, trying again: %s", self.url, error or type(error).__name__)
                self.registered = False
            else:
                if not self.registered:
                    log.info("registered at %s", self.url)
                self.registered = True
            await asyncio.sleep(self._renew_seconds)

    async def _tell(self, *, online: bool) -> None:
        client = await self._client()
        await client.connect_sessionless()
        try:
            entry: Any = ua.RegisteredServer()
            entry.ServerUri = self._server.get_application_uri()
            entry.ProductUri = self._server.product_uri
            entry.ServerNames = [ua.LocalizedText(self._server.name)]
            entry.ServerType = self._server.application_type
            entry.DiscoveryUrls = [self._own_url]
            entry.IsOnline = online
            await client.uaclient.register_server(entry)
        finally:
            with contextlib.suppress(*FAULTS):
                await client.disconnect_sessionless()

    async def _client(self) -> Client:
        """Return a client on the best encrypted channel the discovery server offers, or an open one if it has none."""
        client = Client(self.url, timeout=5)
        endpoints = await client.connect_and_get_server_endpoints()
        best = None
        for endpoint in endpoints:
            known = endpoint.SecurityPolicyUri in _POLICIES
            if known and endpoint.SecurityMode == ua.MessageSecurityMode.SignAndEncrypt:
                best = endpoint if best is None or endpoint.SecurityLevel > best.SecurityLevel else best
        own = self._certificate
        if best is not None and own is not None:
            client.application_uri = self._server.get_application_uri()
            await client.set_security(
                _POLICIES[best.SecurityPolicyUri],
                str(own.certificate_file),
                str(own.key_file),
                server_certificate=best.ServerCertificate,
                mode=ua.MessageSecurityMode.SignAndEncrypt,
            )
        return client

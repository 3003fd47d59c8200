"""Rights end when they end: the sessions that are open are held against users and trust list, twice a second.

Users and certificates are changed by other processes, on the database and in folders. Nothing here waits for a lock:
while the library does not answer, everybody keeps the rights that were last known.
"""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any

from cryptography import x509

from opcua_skill.security import Authenticator, CertificateFault, StoredUser, UserStore
from opcua_skill.security.access import Identity
from opcua_skill.stack.internal_server import SkillInternalServer
from opcua_skill.stack.sessions.sessions import Session

LOOK_EVERY = 0.5
ANSWER_WITHIN = 1.0
CERTIFICATES_AT_LEAST_EVERY = 30.0
"""s after which certificates are looked at again though no file has changed: they expire, and so do lists."""
# A list that is out of date lets nobody new in; it is no withdrawal, and must not end what runs at midnight.
OUTLIVED = frozenset({CertificateFault.UNKNOWN, CertificateFault.ISSUER_UNKNOWN})

log = logging.getLogger(__name__)
Record = Callable[[Session, str, str], Awaitable[None]]


class Standing:
    """Ends or changes sessions whose user, credential, role or client certificate is not what it was at sign-in.

    ``record`` is awaited with the session, what happened (EndSession, ChangeRole) and why.
    """

    def __init__(
        self, iserver: SkillInternalServer, store: UserStore, authenticator: Authenticator, record: Record
    ) -> None:
        self._iserver = iserver
        self._store = store
        self._authenticator = authenticator
        self._record = record
        self._asking: asyncio.Task[Any] | None = None
        self._watching: asyncio.Task[None] | None = None
        self._stamp: object = None
        self._looked_at = 0.0

    def start(self) -> None:
        """Go on looking."""
        self._watching = asyncio.create_task(self._watch(), name="standing of sessions")

    async def stop(self) -> None:
        """Look no more."""
        for task in (self._watching, self._asking):
            if task is not None:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(LOOK_EVERY)
            if not self._iserver.client_sessions():
                continue
            try:
                await self.look()
            except Exception:
                log.exception("the standing of sessions could not be looked at")

    async def look(self) -> None:
        """Compare every session with users and trust list as they are now."""
        users = await self._users()
        if users is not None:
            for session in self._iserver.client_sessions():
                if session.is_activated() and session.identity.mark:
                    await self._judge(session, users)
        for session, why in await self._withdrawn():
            await self.end(session, why)

    async def end(self, session: Session, why: str) -> None:
        """End a session, record it and tell it."""
        await self._record(session, "EndSession", why)
        await self._iserver.end_session(session, why)

    async def _users(self) -> dict[str, StoredUser] | None:
        """Return the users by name; None when the library does not answer in time: it is asked on, not again."""
        if self._asking is None:
            self._asking = asyncio.ensure_future(self._store.users())
        done, _ = await asyncio.wait({self._asking}, timeout=ANSWER_WITHIN)
        if not done:
            return None
        asked, self._asking = self._asking, None
        if error := asked.exception():
            log.warning("users cannot be read, sessions keep their rights: %s", error)
            return None
        return {user.name: user for user in asked.result()}

    async def _judge(self, session: Session, users: dict[str, StoredUser]) -> None:
        before = session.identity
        user = users.get(before.name)
        now = self._authenticator.still(before, user)
        if now is None:
            gone = user is None
            await self.end(session, "the user was removed" if gone else "the user's password or certificate changed")
        elif now != before:
            if self._watches_too_much(session, now):
                await self.end(session, f"the role changed from {before.role} to {now.role}")
                return
            session.change_identity(now)
            await self._record(session, "ChangeRole", f"the role changed from {before.role} to {now.role}")

    def _watches_too_much(self, session: Session, now: Identity) -> bool:
        """Whether a session is subscribed to what its new role may not read."""
        closed = {node for node, roles in self._iserver.readers.items() if now.role not in roles}
        own = (one for one in self._iserver.client_subscriptions() if one.session_id == session.session_id)
        return any(one.monitored_item_srv.watches(closed) for one in own)

    async def _withdrawn(self) -> list[tuple[Session, str]]:
        """Return the sessions whose client's certificate is not let in any more, and why."""
        trust = self._iserver.trust
        sessions = [one for one in self._iserver.client_sessions() if one.channel and one.channel.peer.certificate]
        if trust is None or not sessions:
            return []
        stamp, now = await asyncio.to_thread(trust.stamp), time.monotonic()
        if stamp == self._stamp and now - self._looked_at < CERTIFICATES_AT_LEAST_EVERY:
            return []
        shown = {(one.channel.peer.certificate, one.sent_along) for one in sessions if one.channel}

        def look() -> dict[tuple[bytes, bytes], CertificateFault | None]:
            return {one: trust.fault(x509.load_der_x509_certificate(one[0]), one[1]) for one in shown}

        found = await asyncio.to_thread(look)
        self._stamp, self._looked_at = stamp, now
        faults = [(one, found.get((one.channel.peer.certificate, one.sent_along))) for one in sessions if one.channel]
        return [
            (one, f"the client's certificate was withdrawn: {why.value}")
            for one, why in faults
            if why is not None and why not in OUTLIVED
        ]


def told_of(session: Session) -> dict[str, str]:
    """Return what the audit trail keeps of a session."""
    identity = session.identity if session.is_activated() else None
    return {
        "User": identity.name if identity else "",
        "Role": identity.role.value if identity else "",
        "Peer": str(session.channel.peer) if session.channel else "",
    }

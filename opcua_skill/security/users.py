"""Sign-in with passwords (argon2, off the event loop) and user certificates, and lock-out after failures."""

import asyncio
import hashlib
import hmac
import logging
import time
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Protocol

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError
from cryptography import x509

from library.names import named, same_user
from opcua_skill.security.access import Identity, Peer, Role

log = logging.getLogger(__name__)

# OWASP's second choice for argon2id: 19 MiB and two passes keep a sign-in near 20 ms and a burst of them small.
_HASHER = PasswordHasher(time_cost=2, memory_cost=19 * 1024, parallelism=1)
MIN_PASSWORD_LENGTH = 8
MAX_PASSWORD_BYTES = 1024


class StoredUser(Protocol):
    """A row of the user table. ``certificate`` is a user certificate in DER form, or empty."""

    @property
    def name(self) -> str: ...
    @property
    def role(self) -> str: ...
    @property
    def password_hash(self) -> str: ...
    @property
    def certificate(self) -> bytes | None: ...


class UserStore(Protocol):
    """Where users are kept; the skill library's store is one."""

    async def users(self) -> Sequence[StoredUser]:
        """Return all users."""
        ...

    async def set_password_hash(self, name: str, password_hash: str) -> object:
        """Replace a user's password hash."""
        ...


def hash_password(password: str) -> str:
    """Return the argon2id hash of a password; raises ValueError if it is too short or too long. Takes about 20 ms."""
    if len(password) < MIN_PASSWORD_LENGTH:
        raise ValueError(f"a password needs at least {MIN_PASSWORD_LENGTH} characters, this one has {len(password)}")
    if len(password.encode()) > MAX_PASSWORD_BYTES:
        raise ValueError(f"a password may have at most {MAX_PASSWORD_BYTES} bytes")
    return _HASHER.hash(password)


@dataclass(frozen=True, slots=True)
class LockOut:
    """After ``failures`` wrong sign-ins within ``seconds``, a name is refused from that peer for ``seconds``."""

    failures: int = 5
    seconds: float = 60.0


class Authenticator:
    """Proves passwords and user certificates against a user store.

    A name is locked for one peer (by its certificate, or its address without one) rather than for all, so that
    nobody can lock an operator out of another station. Hashing runs in two threads of its own; what waits for them
    waits without blocking the event loop.
    """

    def __init__(self, store: UserStore, lock_out: LockOut | None = None) -> None:
        self._store = store
        self._lock_out = lock_out or LockOut()
        self._failures: OrderedDict[tuple[str, bytes], list[float]] = OrderedDict()
        self._renewed: dict[str, str] = {}
        self._threads = ThreadPoolExecutor(max_workers=2, thread_name_prefix="argon2")
        self._nobody = self._threads.submit(_HASHER.hash, "no user has this password")

    async def by_password(self, name: str, password: str, peer: Peer) -> Identity | None:
        """Return the user, or None for a wrong name or password, or while the name is locked for this peer."""
        key = (same_user(name), peer.certificate or peer.address.encode())
        if self._locked(key):
            log.warning("sign-in of %r from %s refused: locked after %d failures", name, peer, self._lock_out.failures)
            return None
        users = {user.name: user for user in await self._store.users()}
        meant = named(users, name)
        user = users[meant] if meant is not None else None
        loop = asyncio.get_running_loop()
        nobody = await asyncio.wrap_future(self._nobody)  # compared with all the same: no name is found by the clock
        known = user.password_hash if user is not None and user.password_hash else nobody
        good = await loop.run_in_executor(self._threads, _verify, known, password)
        if user is None or known is nobody or not good:
            self._failed(key)
            log.warning("sign-in of %r from %s refused: wrong name or password", name, peer)
            return None
        self._failures.pop(key, None)
        if _HASHER.check_needs_rehash(known):
            stronger = await loop.run_in_executor(self._threads, _HASHER.hash, password)
            await self._store.set_password_hash(user.name, stronger)
            self._renewed[_mark(user, known)] = known = stronger
        return Identity(user.name, Role(user.role), _mark(user, known))

    def still(self, identity: Identity, user: StoredUser | None) -> Identity | None:
        """Return who a signed-in user is by what is stored now; None once removed, or proven with what has changed."""
        if user is None or user.role not in tuple(Role):
            return None
        mark = identity.mark
        while (stronger := self._renewed.get(mark)) is not None:
            mark = _mark(user, stronger)
        certificate = bytes(user.certificate or b"")
        proofs = [_mark(user, user.password_hash)] if user.password_hash else []
        if certificate and _valid_now(certificate):
            proofs.append(_mark(user, certificate.hex()))
        return Identity(user.name, Role(user.role), mark) if mark in proofs else None

    async def by_certificate(self, certificate: bytes, peer: Peer) -> Identity | None:
        """Return the user to whom this certificate (DER) belongs, or None."""
        for user in await self._store.users():
            if user.certificate and hmac.compare_digest(bytes(user.certificate), certificate):
                return Identity(user.name, Role(user.role), _mark(user, certificate.hex()))
        log.warning("sign-in by user certificate from %s refused: no user has it", peer)
        return None

    def close(self) -> None:
        """Release the hashing threads."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _locked(self, key: tuple[str, bytes]) -> bool:
        since = time.monotonic() - self._lock_out.seconds
        recent = [at for at in self._failures.get(key, []) if at > since]
        return len(recent) >= self._lock_out.failures

    def _failed(self, key: tuple[str, bytes]) -> None:
        now = time.monotonic()
        times = self._failures.setdefault(key, [])
        times[:] = [*(at for at in times if at > now - self._lock_out.seconds), now][-self._lock_out.failures :]
        self._failures.move_to_end(key)
        while len(self._failures) > 10_000:
            self._failures.popitem(last=False)


def _mark(user: StoredUser, proof: str) -> str:
    """Return what stands for a user and a proof, so that a user made anew under the old name is another one."""
    made = getattr(user, "created_at", "")
    return hashlib.sha256(f"{user.name}\0{made}\0{proof}".encode()).hexdigest()


def _valid_now(certificate: bytes) -> bool:
    try:
        read = x509.load_der_x509_certificate(certificate)
    except ValueError:
        return True  # its key was proven at sign-in, whatever it is
    return read.not_valid_before_utc <= datetime.now(UTC) <= read.not_valid_after_utc


def _verify(known: str, password: str) -> bool:
    if len(password.encode(errors="surrogatepass")) > MAX_PASSWORD_BYTES:
        return False
    try:
        return _HASHER.verify(known, password)
    except (Argon2Error, InvalidHashError):
        return False

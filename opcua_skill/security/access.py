"""Who is asking: roles, the identity of a session, and the caller of the method that runs now."""

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol


class Role(StrEnum):
    """What somebody may do; each role may also do all that the roles before it may."""

    OBSERVER = "observer"
    OPERATOR = "operator"
    TEACHER = "teacher"
    ENGINEER = "engineer"
    ADMIN = "admin"

    @property
    def and_above(self) -> "frozenset[Role]":
        """Return this role and every role that includes it: the usual value of ``MethodSpec.roles``."""
        order = tuple(Role)
        return frozenset(order[order.index(self) :])


@dataclass(frozen=True, slots=True)
class Identity:
    """A user whose password or certificate has been proven; ``mark`` stands for what it was proven with."""

    name: str
    role: Role
    mark: str = field(default="", compare=False, repr=False)

    def may_hear_of(self, user: str) -> bool:
        """Return whether audit events about a user are for these ears: one's own, and all for engineers and above."""
        return self.role in Role.ENGINEER.and_above or (bool(self.name) and self.name == user)


@dataclass(frozen=True, slots=True)
class Peer:
    """Where a sign-in comes from: the address of the connection and the certificate (DER) of its secure channel."""

    address: str
    certificate: bytes

    def __str__(self) -> str:
        return self.address


class SignIn(Protocol):
    """Proves who somebody is. Both answers take about as long for a stranger as for a user who mistypes."""

    async def by_password(self, name: str, password: str, peer: Peer) -> Identity | None:
        """Return the user, or None if name or password is wrong or the user is locked out for a while."""
        ...

    async def by_certificate(self, certificate: bytes, peer: Peer) -> Identity | None:
        """Return the user this certificate (DER) belongs to, or None. Possession of the key is proven already."""
        ...


@dataclass(frozen=True, slots=True)
class Caller:
    """Who called the method that runs now. ``name`` is empty for an anonymous session, which insecure modes allow."""

    name: str
    role: Role
    session_id: str
    peer: str


_caller: ContextVar[Caller] = ContextVar("opcua_skill_caller")
audit_entry_id: ContextVar[str] = ContextVar("opcua_skill_audit_entry_id", default="")
"""The id a client has given the request that is answered now, for the audit trail; empty if it gave none."""


def caller() -> Caller:
    """Return who called the OPC UA method that runs now.

    Raises LookupError outside a method call: code that needs a caller must not run without one.
    """
    try:
        return _caller.get()
    except LookupError:
        raise LookupError("no OPC UA method call is running: there is no caller") from None


@contextmanager
def calling_as(who: Caller):
    """Run a block on behalf of a caller: the session does this around every call, tests may."""
    token = _caller.set(who)
    try:
        yield who
    finally:
        _caller.reset(token)

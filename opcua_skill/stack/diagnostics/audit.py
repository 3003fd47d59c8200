"""Who came to the door: sign-ins, refused sign-ins and refused certificates, as records and as audit events."""

import base64
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common import event_objects
from asyncua.common.events import Event
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Caller, audit_entry_id
from opcua_skill.stack.address_space.values import SERVER, node_id, status, status_name


@dataclass(frozen=True, slots=True)
class SignInRecord:
    """How one sign-in ended. ``user`` is what the client claimed; ``role`` is empty unless it was let in."""

    user: str
    role: str
    kind: str
    peer: str
    session_id: str
    status: int

    @property
    def good(self) -> bool:
        """Return whether the user was let in."""
        return self.status == Codes.Good

    @property
    def status_name(self) -> str:
        """Return the status code in words."""
        return status_name(self.status)


@dataclass(frozen=True, slots=True)
class WriteRecord:
    """A client's write to a variable that commands something, and how it ended; ``old`` is what the variable held."""

    caller: Caller
    node_id: ua.NodeId
    old: ua.Variant | None
    new: ua.Variant
    status: int
    reason: str
    client_audit_entry_id: str = field(default_factory=audit_entry_id.get)

    @property
    def status_name(self) -> str:
        """Return the status code in words."""
        return status_name(self.status)


OnWrite = Callable[[WriteRecord], Awaitable[None]]
OnSignIn = Callable[[SignInRecord], Awaitable[None]]


def claimed(token: Any) -> tuple[str, str]:
    """Return the user name an identity token claims and what kind of token it is; never its secret."""
    if isinstance(token, ua.UserNameIdentityToken):
        return str(token.UserName or "")[:200], "password"
    if isinstance(token, ua.X509IdentityToken):
        return "", "certificate"
    return "", "anonymous"


def sign_in_event(record: SignInRecord, server_uri: str) -> Event:
    """Return the AuditActivateSessionEvent of a sign-in."""
    event = event_objects.AuditActivateSessionEvent()
    who = record.user or record.kind
    message = f"sign-in of {who} from {record.peer}: {'done' if record.good else record.status_name}"
    _fill(event, message, "Session/ActivateSession", server_uri, record.status, record.user)
    event.add_property("SessionId", _session(record.session_id), ua.VariantType.NodeId)
    return event


def session_ended_event(session_id: ua.NodeId, user: str, message: str, server_uri: str) -> Event:
    """Return the AuditSessionEvent of a session that the server or an administrator has ended."""
    event = event_objects.AuditSessionEvent()
    _fill(event, message, "Session/CloseSession", server_uri, Codes.Good, user)
    event.add_property("SessionId", session_id, ua.VariantType.NodeId)
    return event


def write_event(record: WriteRecord, server_uri: str) -> Event:
    """Return the AuditWriteUpdateEvent of a write to a variable that commands something (OPC 10000-5, 6.4.26)."""
    event = event_objects.AuditWriteUpdateEvent()
    who, name = record.caller.name or "anonymous", record.node_id.to_string()
    ended = "done" if not record.reason else f"{record.status_name}: {record.reason}"
    _fill(event, f"write of {name} by {who}: {ended}", "Attribute/Write", server_uri, record.status, record.caller.name)
    old = record.old or ua.Variant()
    event.add_property("SourceNode", record.node_id, ua.VariantType.NodeId)
    event.add_property("ClientAuditEntryId", record.client_audit_entry_id, ua.VariantType.String)
    event.add_property("AttributeId", int(AttributeIds.Value), ua.VariantType.UInt32)
    event.add_property("OldValue", old.Value, old.VariantType)
    event.add_property("NewValue", record.new.Value, record.new.VariantType)
    return event


def certificate_event(code: int, certificate: bytes, subject: str, peer: str, server_uri: str) -> Event:
    """Return the audit event of a client certificate that was refused."""
    kind = event_objects.AuditCertificateUntrustedEvent
    event = kind() if code == Codes.BadCertificateUntrusted else event_objects.AuditCertificateInvalidEvent()
    message = f"certificate {subject} from {peer}: {status_name(code)}"
    _fill(event, message, "Security/Certificate", server_uri, code, "")
    event.add_property("Certificate", certificate, ua.VariantType.ByteString)
    return event


def _fill(event: Event, message: str, source: str, server_uri: str, code: int, user: str) -> None:
    bad = code != Codes.Good
    event.add_property("Message", ua.LocalizedText(message), ua.VariantType.LocalizedText)
    event.add_property("Severity", 600 if bad else 100, ua.VariantType.UInt16)
    event.add_property("SourceNode", SERVER, ua.VariantType.NodeId)
    event.add_property("SourceName", source, ua.VariantType.String)
    event.add_property("ActionTimeStamp", datetime.now(UTC), ua.VariantType.DateTime)
    event.add_property("Status", not bad, ua.VariantType.Boolean)
    event.add_property("ServerId", server_uri, ua.VariantType.String)
    event.add_property("ClientUserId", user, ua.VariantType.String)
    event.add_property("StatusCodeId", status(code), ua.VariantType.StatusCode)


def _session(session_id: str) -> ua.NodeId:
    """Return the NodeId behind its text: asyncua takes a base64 identifier that begins with 0x for hexadecimal."""
    namespace, opaque, identifier = session_id.partition(";b=")
    if not opaque:
        return ua.NodeId.from_string(session_id)
    return node_id(base64.b64decode(identifier), int(namespace.removeprefix("ns=")))

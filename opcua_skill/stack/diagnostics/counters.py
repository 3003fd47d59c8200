"""What is counted while the server works: whole numbers that go up, and nothing that has to be worked out."""

from collections import defaultdict
from dataclasses import dataclass, field
from datetime import UTC, datetime

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

LONGEST_TEXT = 1_000
SECURITY_CODES = frozenset(
    {
        Codes.BadApplicationSignatureInvalid,
        Codes.BadCertificateChainIncomplete,
        Codes.BadCertificateHostNameInvalid,
        Codes.BadCertificateInvalid,
        Codes.BadCertificateIssuerRevocationUnknown,
        Codes.BadCertificateIssuerRevoked,
        Codes.BadCertificateIssuerTimeInvalid,
        Codes.BadCertificateIssuerUseNotAllowed,
        Codes.BadCertificatePolicyCheckFailed,
        Codes.BadCertificateRevocationUnknown,
        Codes.BadCertificateRevoked,
        Codes.BadCertificateTimeInvalid,
        Codes.BadCertificateUntrusted,
        Codes.BadCertificateUriInvalid,
        Codes.BadCertificateUseNotAllowed,
        Codes.BadIdentityChangeNotSupported,
        Codes.BadIdentityTokenInvalid,
        Codes.BadIdentityTokenRejected,
        Codes.BadNonceInvalid,
        Codes.BadSecureChannelIdInvalid,
        Codes.BadSecureChannelTokenUnknown,
        Codes.BadSecurityChecksFailed,
        Codes.BadSecurityModeInsufficient,
        Codes.BadSecurityModeRejected,
        Codes.BadSecurityPolicyRejected,
        Codes.BadSessionIdInvalid,
        Codes.BadSessionNotActivated,
        Codes.BadTcpSecureChannelUnknown,
        Codes.BadUserAccessDenied,
        Codes.BadUserSignatureInvalid,
    }
)
"""The codes of requests that were refused because of who asked, or how."""

_SESSION_REQUESTS = frozenset(
    {Ids.CreateSessionRequest_Encoding_DefaultBinary, Ids.ActivateSessionRequest_Encoding_DefaultBinary}
)


@dataclass(slots=True)
class Totals:
    """What the whole server has seen since it started, or since its diagnostics were last switched on."""

    sessions: int = 0
    sessions_rejected: int = 0
    sessions_rejected_for_security: int = 0
    sessions_timed_out: int = 0
    sessions_aborted: int = 0
    subscriptions: int = 0
    requests_rejected: int = 0
    requests_rejected_for_security: int = 0

    def request_refused(self, code: int) -> None:
        """Count a request that was answered with a fault, or by closing the connection."""
        self.requests_rejected += 1
        self.requests_rejected_for_security += code in SECURITY_CODES

    def session_refused(self, service: int | None, code: int) -> None:
        """Count a refused request, if it was one to make or to activate a session."""
        if service in _SESSION_REQUESTS:
            self.sessions_rejected += 1
            self.sessions_rejected_for_security += code in SECURITY_CODES

    def session_ended(self, *, by_client: bool, timed_out: bool) -> None:
        """Count how a session ended: as its client wished, after its time, or cut off."""
        self.sessions_timed_out += timed_out
        self.sessions_aborted += not by_client and not timed_out


@dataclass(slots=True)
class SessionCounts:
    """What one session has asked, by service, and what it has said of itself."""

    requests: defaultdict[int, int] = field(default_factory=lambda: defaultdict(int))
    errors: defaultdict[int, int] = field(default_factory=lambda: defaultdict(int))
    unauthorized: int = 0
    since: datetime = field(default_factory=lambda: datetime.now(UTC))
    name: str = ""
    client: ua.ApplicationDescription = field(default_factory=ua.ApplicationDescription)
    server_uri: str = ""
    endpoint_url: str = ""
    largest_response: int = 0
    locales: tuple[str, ...] = ()
    mechanism: str = ""

    def introduce(self, params: ua.CreateSessionParameters) -> None:
        """Keep what a client says of itself in CreateSession; long texts are cut, so that they cannot fill memory."""
        told, kept = params.ClientDescription, ua.ApplicationDescription()
        kept.ApplicationUri, kept.ProductUri = short(told.ApplicationUri), short(told.ProductUri)
        kept.ApplicationName = ua.LocalizedText(short(told.ApplicationName.Text if told.ApplicationName else ""))
        kept.ApplicationType = told.ApplicationType
        self.client, self.name = kept, short(params.SessionName)
        self.server_uri, self.endpoint_url = short(params.ServerUri), short(params.EndpointUrl)
        self.largest_response = int(params.MaxResponseMessageSize or 0)

    def restart(self) -> None:
        """Count from zero again; what the client has said of itself stays."""
        self.requests.clear()
        self.errors.clear()
        self.unauthorized = 0

    def refused(self, service: int, code: int) -> None:
        """Count a request of this session that was answered with a fault."""
        self.errors[service] += 1
        self.unauthorized += code == Codes.BadUserAccessDenied


@dataclass(slots=True)
class SubscriptionCounts:
    """What one subscription has been asked and has sent."""

    modified: int = 0
    enabled: int = 0
    disabled: int = 0
    republish_requests: int = 0
    republished: int = 0
    transfers: int = 0
    publish_requests: int = 0
    values: int = 0
    events: int = 0
    late: int = 0
    discarded_messages: int = 0
    value_overflows: int = 0
    event_overflows: int = 0


def short(text: object) -> str:
    """Return a text that a peer has sent, cut where it is longer than anybody reads."""
    return str(text or "")[:LONGEST_TEXT]

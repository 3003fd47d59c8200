"""What can go wrong for a client, each in one sentence for the person at the keyboard."""

from collections.abc import Sequence

from asyncua import ua
from asyncua.ua.status_codes import StatusCodes

from models.errors import SkillError


class ClientError(SkillError):
    """The base of everything a `SkillClient` raises. The message is one sentence."""


class Refused(ClientError):
    """The server said no, and nothing was stored and nothing moved.

    ``status`` is the name of the OPC UA status code (``BadNotFound``), ``argument`` the input argument at
    fault or empty, ``argument_status`` its own status, ``reason`` the server's own sentence from the audit event of
    this call, or else the code's meaning.
    """

    def __init__(self, method: str, status: str, argument: str, reason: str, argument_status: str = "") -> None:
        self.method = method
        self.status = status
        self.argument = argument
        self.argument_status = argument_status
        self.reason = reason
        at = f" (argument {argument})" if argument else ""
        super().__init__(f"{method} was refused: {reason}{at} [{status}]")


class WrongArgument(ClientError, ValueError):
    """A value that no server could take; it was not sent. ``choices`` are what may be given, where that is a list."""

    def __init__(self, argument: str, value: object, expected: str, choices: Sequence[str] = ()) -> None:
        self.argument = argument
        self.choices = tuple(choices)
        super().__init__(f"{argument} is {value!r}: it has to be {expected}")

    @classmethod
    def none_of(cls, argument: str, value: object, choices: Sequence[str]) -> "WrongArgument":
        """Return the fault of a word that is none of ``choices``."""
        return cls(argument, value, f"one of {', '.join(choices)}", choices)


class Unreachable(ClientError):
    """The server does not answer, or the connection broke."""


class NotSignedIn(ClientError):
    """The server does not know the user, the password or this client's certificate; ``status`` is its code's name."""

    def __init__(self, sentence: str, status: str = "") -> None:
        super().__init__(sentence)
        self.status = status

    @property
    def wrong_user(self) -> bool:
        """Whether it is user name or password that the server does not take."""
        return self.status in {"BadUserAccessDenied", "BadIdentityTokenRejected"}


class ServerChanged(ClientError):
    """Another certificate than the one this client has seen at that address before."""


class TookTooLong(ClientError):
    """A job has not ended within the limit the caller set. The job itself goes on."""


SIGN_IN_REFUSALS: dict[int, str] = {
    StatusCodes.BadUserAccessDenied: "the user name or the password is wrong",
    StatusCodes.BadIdentityTokenRejected: "the user name or the password is wrong",
    StatusCodes.BadIdentityTokenInvalid: "the server does not accept this way of signing in",
    StatusCodes.BadCertificateUntrusted: "the server does not trust this client's certificate yet",
    StatusCodes.BadSecurityChecksFailed: "the server does not trust this client's certificate yet",
    StatusCodes.BadCertificateInvalid: "the server does not accept this client's certificate",
    StatusCodes.BadCertificateTimeInvalid: "this client's certificate has expired or is not valid yet",
    StatusCodes.BadCertificateUriInvalid: "this client's certificate names another application",
    StatusCodes.BadTooManySessions: "the server has no session left",
    StatusCodes.BadTcpNotEnoughResources: "the server has no connection left",
}
NOT_TRUSTED = frozenset({StatusCodes.BadCertificateUntrusted, StatusCodes.BadSecurityChecksFailed})


def status_name(code: int) -> str:
    """Return the name of a status code, such as BadNotFound."""
    return ua.StatusCode(ua.UInt32(code)).name


def meaning(code: int) -> str:
    """Return what OPC UA says a status code means, as part of a sentence."""
    text = ua.status_codes.get_name_and_doc(code)[1].strip().rstrip(".")
    return text[:1].lower() + text[1:] if text else "no reason was given"

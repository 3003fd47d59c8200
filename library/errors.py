"""What the library refuses, each with what to do about it. No protocol codes here: the server translates."""

from enum import Enum, auto
from pathlib import Path

from models.errors import SkillError

LONGEST_SHOWN = 200


class Trouble(Enum):
    """What keeps a database from being used."""

    LOCKED = auto()
    FULL = auto()
    DAMAGED = auto()
    FORBIDDEN = auto()
    DISK = auto()
    UNREACHABLE = auto()
    OUTCOME_UNKNOWN = auto()
    OTHER = auto()


AWAY = (Trouble.UNREACHABLE, Trouble.OUTCOME_UNKNOWN)
"""What passes when a database server is there again: whoever can wait, waits."""


class LibraryError(SkillError):
    """Something the library refuses. The message is one sentence for the person who asked; nothing was stored."""


class NotFound(LibraryError):
    """There is no such thing. ``kind`` is one of skill, version, recipe, job, trace, user, recordings."""

    def __init__(self, kind: str, name: str) -> None:
        shown = repr(name if len(name) <= LONGEST_SHOWN else f"{name[:LONGEST_SHOWN]}…")
        super().__init__(f"there is no {kind} {shown}: look up the ones there are and check the spelling")
        self.kind = kind
        self.name = name


class InvalidValue(LibraryError):
    """A value that cannot be taken. ``field`` names it, ``value`` shows it, ``allowed`` says what can."""

    def __init__(self, field: str, value: object, allowed: str) -> None:
        shown = ascii(value[:LONGEST_SHOWN] if isinstance(value, str | bytes) else value)
        shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
        super().__init__(f"{field} is {shown}: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class NotAllowedInState(LibraryError):
    """What was asked for is not possible in the state the thing is in now."""

    def __init__(self, what: str, state: str, wanted: str) -> None:
        super().__init__(f"{what} is {state}: {wanted}")
        self.what = what
        self.state = state


class DigestDiffers(LibraryError):
    """The digest named by the caller is not the one of the stored model."""

    def __init__(self, name: str, version: int) -> None:
        super().__init__(
            f"the digest given is not that of {name} version {version}: read the version again and decide on that"
        )
        self.name = name
        self.version = version


class OwnVersion(LibraryError):
    """Four eyes: who taught, edited or imported a version, or anything it comes from, cannot approve it."""

    def __init__(self, name: str, version: int, actor: str, did: str = "taught") -> None:
        super().__init__(f"{actor} {did} {name} version {version} and cannot approve it: ask a second engineer")
        self.name = name
        self.version = version
        self.actor = actor


class AlreadyExists(LibraryError):
    """The name is taken."""

    def __init__(self, kind: str, name: str, remedy: str = "choose another name") -> None:
        super().__init__(f"the {kind} {name!r} exists already: {remedy}")
        self.kind = kind
        self.name = name


class InUse(LibraryError):
    """Something else still needs it."""

    def __init__(self, what: str, because: str, remedy: str) -> None:
        super().__init__(f"{what} is in use, {because}: {remedy}")
        self.what = what


class ServedElsewhere(LibraryError):
    """A workstation is another server's, of those that share the library."""

    def __init__(self, workstation: str, endpoint: str) -> None:
        super().__init__(f"the workstation {workstation} is served by {endpoint}: ask that server, or stop it first")
        self.workstation = workstation
        self.endpoint = endpoint


class LibraryUnusable(LibraryError):
    """The database cannot be opened, read or written."""

    def __init__(self, where: str, reason: str, remedy: str, trouble: Trouble = Trouble.OTHER) -> None:
        super().__init__(f"the library {where} cannot be used, {reason}: {remedy}")
        self.where = where
        self.trouble = trouble


class Damaged(LibraryError):
    """Something stored cannot be read back as what it was stored as: nobody who asks for it is at fault."""

    def __init__(self, what: str, reason: str) -> None:
        super().__init__(f"what is stored of {what} cannot be read, {reason}: restore it from a backup")
        self.what = what


class ReaderError(LibraryError):
    """A file that cannot be read as demonstrations: which file, which line if one is at fault, and what to do."""

    def __init__(self, path: Path, problem: str, remedy: str, line: int | None = None) -> None:
        place = str(path) if line is None else f"{path}, line {line}"
        super().__init__(f"{place}: {problem}; {remedy}")
        self.path = path
        self.problem = problem
        self.remedy = remedy
        self.line = line

    def named(self, path: Path, now: Path) -> "ReaderError":
        """Return the same complaint about a file that is called ``now`` and that its owner knows as ``path``."""
        return ReaderError(path, self.problem.replace(str(now), str(path)), self.remedy, self.line)


class ChoiceNeeded(ReaderError):
    """A good file that leaves something open: ``choice`` is the field of Choices to fill, ``options`` what there is."""

    def __init__(
        self, path: Path, problem: str, remedy: str, choice: str, options: tuple[str, ...], line: int | None = None
    ) -> None:
        super().__init__(path, problem, remedy, line)
        self.choice = choice
        self.options = options

    def named(self, path: Path, now: Path) -> "ChoiceNeeded":
        """Return the same question about a file that is called ``now`` and that its owner knows as ``path``."""
        return ChoiceNeeded(path, self.problem, self.remedy, self.choice, self.options, self.line)

"""What can be wrong with demonstrations, options and models, each with what to do about it."""

from models.findings import Finding


class SkillError(Exception):
    """The root of all that is refused here. The message is one sentence for a person: what is wrong, and what to do.

    ::

        SkillError
        ├── LearningError            demonstrations, options, edits, models
        ├── LibraryError             what is remembered: NotFound, InvalidValue, InUse, Damaged, …
        │   └── ReaderError          a file of recordings
        ├── MotionRefused            a plan: findings, each with its place and by how much
        ├── ArmError                 an arm that does not start, does not obey, or has failed
        ├── DescriptionError         the files of somebody's own robot
        ├── JobError                 a job that is not taken, or ends without a result
        ├── ProgramRefused           a program for a closed controller
        ├── BackupFault              a backup that cannot be made or restored
        └── ClientError              on the other side of the wire: Refused, Unreachable, NotSignedIn, …
    """


class LearningError(SkillError):
    """A demonstration, an option or a model that cannot be used. The message is one sentence for an operator.

    ``argument`` names what is at fault in the caller's terms: ``demonstrations``, ``options``, ``edits`` or ``model``.
    """

    argument = "demonstrations"


class TooFewDemonstrations(LearningError):
    """Fewer usable demonstrations than a mean needs. ``reasons`` tell, one each, why the others are not usable."""

    def __init__(self, usable: int, needed: int, reasons: tuple[str, ...] = ()) -> None:
        plural = "demonstration is" if usable == 1 else "demonstrations are"
        why = f" ({'; '.join(reasons)})" if reasons else ""
        super().__init__(f"{usable} {plural} usable, {needed} are needed{why}: record more, or include some again")
        self.usable = usable
        self.needed = needed
        self.reasons = reasons

    def __reduce__(self) -> tuple[type["TooFewDemonstrations"], tuple[int, int, tuple[str, ...]]]:
        """Cross process borders whole: the default would hand the sentence to ``__init__``."""
        return type(self), (self.usable, self.needed, self.reasons)


class UnusableDemonstration(LearningError):
    """One recording that cannot be learned from; among good ones it becomes a verdict instead."""


class MixedDemonstrations(LearningError):
    """Recordings that do not belong together: two and three dimensions, metres and millimetres, different shapes.

    ``finding``: which of them, where that is known.
    """

    def __init__(self, sentence: str, finding: Finding | None = None) -> None:
        super().__init__(sentence)
        self.finding = finding

    def __reduce__(self) -> tuple[type["MixedDemonstrations"], tuple[str, Finding | None]]:
        """Cross process borders whole."""
        return type(self), (str(self), self.finding)


class UnlikelyUnits(LearningError):
    """Positions that can hardly be metres."""


class OptionOutOfRange(LearningError):
    """A learning option outside what it may be."""

    argument = "options"


class TooManyComponents(LearningError):
    """More Gaussians than the demonstrations can feed."""

    argument = "options"

    def __init__(self, components: int) -> None:
        super().__init__(f"{components} components are too many for these demonstrations: ask for fewer")
        self.components = components

    def __reduce__(self) -> tuple[type["TooManyComponents"], tuple[int]]:
        """Cross process borders whole."""
        return type(self), (self.components,)


class UnknownDemonstration(LearningError):
    """An edit that names a recording or a sample that does not exist."""

    argument = "edits"


class InvalidModel(LearningError):
    """Means and covariances that are no mixture."""

    argument = "model"

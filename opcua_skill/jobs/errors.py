"""Why a job is not taken, or ends without a result while its caller still waits."""

from library.description import Failure, JobReport
from models.errors import SkillError


class JobError(SkillError):
    """A job that is not taken, or ends without a result."""


class QueueFull(JobError):
    """Too many jobs are waiting."""


class NotExecutable(JobError):
    """The version may not run in this mode: not approved, or not deployed here."""

    def __init__(self, failure: Failure, reason: str) -> None:
        super().__init__(reason)
        self.failure = failure


class LacksAtomicSkill(JobError):
    """The workstation's equipment cannot do what the skill needs."""


class LearningFailed(JobError):
    """A learning job that ended without a version while its caller still waited."""

    def __init__(self, argument: str, reason: str) -> None:
        super().__init__(reason)
        self.argument = argument


class ArmNotReady(JobError):
    """The arm cannot move until somebody acknowledges what stopped it."""


class MotionNotPossible(JobError):
    """A motion refused before anything moved; ``report`` is the failed job that says where on the path."""

    def __init__(self, report: JobReport) -> None:
        super().__init__(report.message)
        self.report = report

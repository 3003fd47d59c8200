"""States of skill versions and of jobs, and the moves that are allowed, as tables."""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import TypeVar

from library.errors import NotAllowedInState

State = TypeVar("State", bound=StrEnum)


class VersionState(StrEnum):
    """How far a version has come. Deployments hang on an approved version and are no state of it."""

    LEARNED = "Learned"
    APPROVED = "Approved"
    REJECTED = "Rejected"
    RETIRED = "Retired"


class JobState(StrEnum):
    """How far a job has come. ``Stopping`` ends only when the arm is at rest."""

    QUEUED = "Queued"
    RUNNING = "Running"
    PAUSED = "Paused"
    STOPPING = "Stopping"
    COMPLETED = "Completed"
    FAILED = "Failed"
    ABORTED = "Aborted"


NEXT_VERSION_STATES: Mapping[VersionState, frozenset[VersionState]] = MappingProxyType(
    {
        VersionState.LEARNED: frozenset({VersionState.APPROVED, VersionState.REJECTED}),
        VersionState.APPROVED: frozenset({VersionState.RETIRED}),
        VersionState.REJECTED: frozenset({VersionState.RETIRED}),
        VersionState.RETIRED: frozenset(),
    }
)

# A running job is aborted by way of Stopping, so that Aborted always means at rest; a run that ends before the stop
# reaches it is Completed.
NEXT_JOB_STATES: Mapping[JobState, frozenset[JobState]] = MappingProxyType(
    {
        JobState.QUEUED: frozenset({JobState.RUNNING, JobState.ABORTED, JobState.FAILED}),
        JobState.RUNNING: frozenset({JobState.PAUSED, JobState.STOPPING, JobState.COMPLETED, JobState.FAILED}),
        JobState.PAUSED: frozenset({JobState.RUNNING, JobState.STOPPING, JobState.FAILED}),
        JobState.STOPPING: frozenset({JobState.ABORTED, JobState.COMPLETED, JobState.FAILED}),
        JobState.COMPLETED: frozenset(),
        JobState.FAILED: frozenset(),
        JobState.ABORTED: frozenset(),
    }
)

FINAL_JOB_STATES = frozenset(state for state, following in NEXT_JOB_STATES.items() if not following)


def check_version_move(what: str, now: VersionState, to: VersionState) -> None:
    """Raise NotAllowedInState unless a version in state ``now`` may become ``to``."""
    if to not in NEXT_VERSION_STATES[now]:
        raise NotAllowedInState(what, now, _remedy(to, NEXT_VERSION_STATES))


def check_job_move(what: str, now: JobState, to: JobState) -> None:
    """Raise NotAllowedInState unless a job in state ``now`` may become ``to``."""
    if to not in NEXT_JOB_STATES[now]:
        raise NotAllowedInState(what, now, _remedy(to, NEXT_JOB_STATES))


def _remedy(to: State, following: Mapping[State, frozenset[State]]) -> str:
    sources = [state.value for state, targets in following.items() if to in targets]
    if not sources:
        return f"nothing becomes {to.value}"
    return f"only one that is {' or '.join(sources)} can become {to.value}"

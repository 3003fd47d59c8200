"""The tables of states: every pair of them is walked."""

from itertools import product

import pytest

from library.errors import NotAllowedInState
from library.lifecycle import (
    FINAL_JOB_STATES,
    NEXT_JOB_STATES,
    NEXT_VERSION_STATES,
    JobState,
    VersionState,
    check_job_move,
    check_version_move,
)

VERSION_MOVES = {
    ("Learned", "Approved"),
    ("Learned", "Rejected"),
    ("Approved", "Retired"),
    ("Rejected", "Retired"),
}
JOB_MOVES = {
    ("Queued", "Running"),
    ("Queued", "Aborted"),
    ("Queued", "Failed"),
    ("Running", "Paused"),
    ("Running", "Stopping"),
    ("Running", "Completed"),
    ("Running", "Failed"),
    ("Paused", "Running"),
    ("Paused", "Stopping"),
    ("Paused", "Failed"),
    ("Stopping", "Aborted"),
    ("Stopping", "Completed"),
    ("Stopping", "Failed"),
}


@pytest.mark.parametrize(("now", "to"), list(product(VersionState, VersionState)))
def test_a_version_moves_exactly_as_the_interface_says(now: VersionState, to: VersionState) -> None:
    if (now.value, to.value) in VERSION_MOVES:
        check_version_move("glue version 1", now, to)
        return
    with pytest.raises(NotAllowedInState, match=f"glue version 1 is {now.value}"):
        check_version_move("glue version 1", now, to)


@pytest.mark.parametrize(("now", "to"), list(product(JobState, JobState)))
def test_a_job_moves_only_along_the_table(now: JobState, to: JobState) -> None:
    if (now.value, to.value) in JOB_MOVES:
        check_job_move("job 7", now, to)
        return
    with pytest.raises(NotAllowedInState, match=f"job 7 is {now.value}"):
        check_job_move("job 7", now, to)


def test_the_tables_name_every_state() -> None:
    assert set(NEXT_VERSION_STATES) == set(VersionState)
    assert set(NEXT_JOB_STATES) == set(JobState)


def test_every_state_of_a_job_leads_to_an_end() -> None:
    for state in JobState:
        reached, frontier = {state}, {state}
        while frontier:
            frontier = {after for before in frontier for after in NEXT_JOB_STATES[before]} - reached
            reached |= frontier
        assert reached & FINAL_JOB_STATES


def test_a_running_job_is_aborted_only_by_way_of_stopping() -> None:
    assert {before for before, following in NEXT_JOB_STATES.items() if JobState.ABORTED in following} == {
        JobState.QUEUED,
        JobState.STOPPING,
    }


def test_a_refusal_says_from_where_the_move_would_be_possible() -> None:
    with pytest.raises(NotAllowedInState, match="only one that is Learned can become Approved"):
        check_version_move("glue version 1", VersionState.RETIRED, VersionState.APPROVED)

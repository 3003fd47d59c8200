"""Four eyes: who contributed to a version and everything it comes from, and how many people have to approve it.

Names are compared as users are: without regard to case.
"""

import json
from collections.abc import Iterable, Sequence

import sqlalchemy as sql

from library.description import SkillDescription
from library.names import same_user
from library.tables import decisions, users, version_recordings, versions

ONE, TWO = 1, 2


def of_learned(
    connection: sql.Connection,
    description: SkillDescription,
    actor: str,
    brought_by: Iterable[str],
    digests: Sequence[str],
) -> tuple[str, ...]:
    """Return who contributed to a version that is learned here.

    That is who had it learned, who ``brought_by`` its recordings, who demonstrated under the name of a user here,
    whoever brought one of the same recordings first, and everybody who contributed to the version it is based on.
    """
    here = _users(connection)
    people = {actor, *brought_by}
    people |= {one.operator for one in description.provenance.recordings if same_user(one.operator) in here}
    people |= _first_with(connection, digests)
    if (based_on := description.provenance.based_on) is not None:
        found = sql.select(versions.c.contributors).where(
            versions.c.skill_name == description.name, versions.c.version == based_on
        )
        people |= set(json.loads(connection.scalar(found) or "[]"))
    return _sorted(people)


def of_imported(
    connection: sql.Connection, description: SkillDescription, importer: str
) -> tuple[tuple[str, ...], int]:
    """Return who contributed to a version that is imported, and how many have to approve it.

    The names a document claims count, and the importer. If the model is here already, its contributors count: the
    origin is known. Else every claimed name has to be a user's here; where one is not, nobody knows who that is, and a
    third person is needed: two approve, neither of them a contributor.
    """
    told = description.provenance
    claimed = {told.taught_by, told.imported_by, *description.contributors} - {""}
    here = _users(connection)
    people = {importer, *claimed}
    people |= {one.operator for one in told.recordings if same_user(one.operator) in here}
    same = sql.select(versions.c.contributors).where(versions.c.model_digest == description.model_digest)
    known = [set(json.loads(found)) for found in connection.scalars(same)]
    strangers = [name for name in claimed if same_user(name) not in here]
    return _sorted(people.union(*known)), TWO if strangers and not known else ONE


def approved_by(connection: sql.Connection, name: str, version: int) -> set[str]:
    """Return who has approved a version so far, as names are compared."""
    found = sql.select(decisions.c.actor).where(
        decisions.c.skill_name == name, decisions.c.version == version, decisions.c.state == "Approved"
    )
    return {same_user(one) for one in connection.scalars(found)}


def _first_with(connection: sql.Connection, digests: Sequence[str]) -> set[str]:
    """Return who had the first version learned from each of these recordings, as far as they were here before."""
    used = version_recordings.c
    query = (
        sql.select(used.digest, versions.c.created_by)
        .join(versions, (versions.c.skill_name == used.skill_name) & (versions.c.version == used.version))
        .where(used.digest.in_(digests))
        .order_by(versions.c.created_at.desc(), used.version.desc())
    )
    return set({row.digest: row.created_by for row in connection.execute(query)}.values())


def _users(connection: sql.Connection) -> set[str]:
    return {same_user(one) for one in connection.scalars(sql.select(users.c.name))}


def _sorted(people: set[str]) -> tuple[str, ...]:
    return tuple(sorted(people - {""}))

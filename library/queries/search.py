"""Finding skills among very many: a page at a time, by index, each page after the last name before."""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sql

from library.description import SkillSummary
from library.errors import InvalidValue
from library.lifecycle import VersionState
from library.tables import deployments, versions

DEFAULT_LIMIT = 100
MAX_LIMIT = 1000
SUMMARY = (
    versions.c.skill_name,
    versions.c.version,
    versions.c.semantic_type,
    versions.c.state,
    versions.c.model_digest,
    versions.c.created_at,
    versions.c.created_by,
)


def page(
    *, semantic_type: str, state: str, workstation: str, name_prefix: str, after: str, limit: int
) -> sql.Select[Any, Any]:
    """Return the query for ``limit`` names after ``after`` and of each the newest version that fits; "" fits any."""
    source = deployments if workstation else versions
    key = source.c.skill_name
    query = sql.select(key.label("skill_name"), sql.func.max(source.c.version).label("version"))
    conditions = [key > after] if after else []
    if name_prefix:
        conditions.append(key >= name_prefix)
        following = _after_all_with(name_prefix)
        conditions += [key < following] if following else []
    if workstation:
        conditions.append(deployments.c.workstation == workstation)
        if semantic_type or state:
            same = (versions.c.skill_name == key) & (versions.c.version == deployments.c.version)
            query = query.join_from(deployments, versions, same)
    if semantic_type:
        conditions.append(versions.c.semantic_type == semantic_type)
    if state:
        conditions.append(versions.c.state == state)
    return query.where(*conditions).group_by(key).order_by(key).limit(limit)


def find(
    connection: sql.Connection,
    *,
    semantic_type: str,
    state: str,
    workstation: str,
    name_prefix: str,
    after: str,
    limit: int,
) -> tuple[list[SkillSummary], str]:
    """Return one page of summaries in the order of their names, and the name the next one comes after ("": none)."""
    if state and state not in set(VersionState):
        raise InvalidValue("state", state, f"it is one of {', '.join(VersionState)}, or empty for any")
    if not 0 <= limit <= MAX_LIMIT:
        raise InvalidValue("limit", limit, f"it is at most {MAX_LIMIT}; 0 stands for {DEFAULT_LIMIT}")
    limit = limit or DEFAULT_LIMIT
    names = page(
        semantic_type=semantic_type,
        state=state,
        workstation=workstation,
        name_prefix=name_prefix,
        after=after,
        limit=limit + 1,
    ).subquery()
    same = (versions.c.skill_name == names.c.skill_name) & (versions.c.version == names.c.version)
    rows = connection.execute(sql.select(*SUMMARY).join(names, same).order_by(versions.c.skill_name)).all()
    more = len(rows) > limit
    summaries = summarise(connection, rows[:limit])
    return summaries, summaries[-1].name if more else ""


def of_skill(connection: sql.Connection, name: str) -> list[SkillSummary]:
    """Return a summary of each version of a skill, the newest first."""
    query = sql.select(*SUMMARY).where(versions.c.skill_name == name).order_by(versions.c.version.desc())
    return summarise(connection, connection.execute(query).all())


def summarise(connection: sql.Connection, rows: Sequence[Any]) -> list[SkillSummary]:
    """Return the summaries of rows of versions."""
    stations: dict[tuple[str, int], list[str]] = {}
    names = {row.skill_name for row in rows}
    for station in connection.execute(
        sql.select(deployments).where(deployments.c.skill_name.in_(names)).order_by(deployments.c.workstation)
    ):
        stations.setdefault((station.skill_name, station.version), []).append(station.workstation)
    return [
        SkillSummary(
            name=row.skill_name,
            version=row.version,
            semantic_type=row.semantic_type,
            state=VersionState(row.state),
            model_digest=row.model_digest,
            created_at=row.created_at,
            created_by=row.created_by,
            workstations=tuple(stations.get((row.skill_name, row.version), ())),
        )
        for row in rows
    ]


def _after_all_with(prefix: str) -> str:
    """Return the least text that is greater than every text with this prefix; "" if there is none."""
    for end in range(len(prefix), 0, -1):
        code = ord(prefix[end - 1])
        if code < 0x10FFFF:
            return prefix[: end - 1] + chr(0xE000 if code == 0xD7FF else code + 1)
    return ""

"""Which version of a skill runs on which workstation: at most one of each skill."""

import sqlalchemy as sql

from library.description import SkillDescription
from library.errors import NotAllowedInState
from library.lifecycle import VersionState
from library.queries import versions
from library.tables import deployments
from library.values import now


def deploy(connection: sql.Connection, name: str, version: int, workstation: str, actor: str) -> VersionState:
    """Deploy an approved version; it takes the place of another version of that skill on that workstation."""
    version = versions.number(connection, name, version)
    versions.check_approved(connection, name, version)
    if deployed(connection, name, workstation) == version:
        return VersionState.APPROVED
    connection.execute(deployments.delete().where(*_at(name, workstation)))
    connection.execute(
        deployments.insert().values(
            workstation=workstation, skill_name=name, version=version, deployed_at=now(), deployed_by=actor
        )
    )
    return VersionState.APPROVED


def withdraw(connection: sql.Connection, name: str, version: int, workstation: str) -> VersionState:
    """Take a version (0: whichever is there) off a workstation; it stays approved."""
    if version:
        versions.number(connection, name, version)
    there = deployed(connection, name, workstation)
    if there is None or version not in {0, there}:
        versions.number(connection, name, 0)
        what = f"{name} version {version}" if version else name
        raise NotAllowedInState(what, f"not deployed on {workstation}", "only what is deployed there can be withdrawn")
    connection.execute(deployments.delete().where(*_at(name, workstation)))
    return VersionState.APPROVED


def deployed(connection: sql.Connection, name: str, workstation: str) -> int | None:
    """Return which version of a skill is deployed on a workstation, if any."""
    return connection.scalar(sql.select(deployments.c.version).where(*_at(name, workstation)))


def on_workstation(connection: sql.Connection, workstation: str) -> list[SkillDescription]:
    """Return all that is deployed on a workstation, in the order of names."""
    rows = connection.execute(
        sql.select(deployments.c.skill_name, deployments.c.version)
        .where(deployments.c.workstation == workstation)
        .order_by(deployments.c.skill_name)
    ).all()
    return [versions.read(connection, row.skill_name, row.version) for row in rows]


def _at(name: str, workstation: str) -> tuple[sql.ColumnElement[bool], sql.ColumnElement[bool]]:
    return deployments.c.workstation == workstation, deployments.c.skill_name == name

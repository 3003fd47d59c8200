"""Skill versions: added whole, read whole, moved through their life cycle, never changed otherwise."""

import json
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sql

from library.description import Decision, SkillDescription
from library.errors import DigestDiffers, InUse, InvalidValue, NotAllowedInState, NotFound, OwnVersion
from library.lifecycle import VersionState, check_version_move
from library.names import same_user
from library.queries import contributors
from library.queries.encoding import stored, to_text
from library.tables import aligned, decisions, deployments, skills, versions
from library.values import now


def newest(connection: sql.Connection, name: str) -> int:
    """Return the number of the newest version of a skill; 0 if there is no such skill."""
    found = connection.scalar(sql.select(sql.func.max(versions.c.version)).where(versions.c.skill_name == name))
    return int(found or 0)


def number(connection: sql.Connection, name: str, version: int) -> int:
    """Return ``version``, or the newest for 0; raise NotFound if the skill has no such version."""
    latest = newest(connection, name)
    if not latest:
        raise NotFound("skill", name)
    wanted = version or latest
    if not 1 <= wanted <= latest:
        raise NotFound("version", f"{name} {wanted}")
    return wanted


def insert(connection: sql.Connection, description: SkillDescription) -> None:
    """Store a version; its skill is there already."""
    content = description.model_dump(by_alias=False, mode="json")
    plain = ("name", "version", "semantic_type", "model_digest", "dimension", "frame", "clock", "duration", "time_step")
    row: dict[str, Any] = {("skill_name" if key == "name" else key): content[key] for key in plain}
    row |= {"covariance_rule": description.covariance_rule, "state": description.state.value}
    row |= {key: to_text(getattr(description, key)) for key in ("means", "covariances", "dispense")}
    row |= {key: to_text(content[key]) for key in ("required_atomic_skills", "parameters", "provenance", "report")}
    row["verdicts"] = to_text(content["verdicts"])
    row |= {"contributors": to_text(content["contributors"]), "approvals_needed": description.approvals_needed}
    summary = description.summary
    row |= {"created_at": summary.created_at, "created_by": summary.created_by}
    connection.execute(versions.insert().values(row))


def insert_aligned(connection: sql.Connection, rows: Sequence[dict[str, Any]], name: str, version: int) -> None:
    """Store the aligned demonstrations of a version."""
    for position, row in enumerate(rows):
        connection.execute(aligned.insert().values(skill_name=name, version=version, position=position, **row))


def read(connection: sql.Connection, name: str, version: int) -> SkillDescription:
    """Return a version (0: the newest) as it was stored, with its decisions and deployments of now."""
    version = number(connection, name, version)
    row = connection.execute(_rows_of(versions, name, version)).one()
    taken = connection.execute(_rows_of(decisions, name, version).order_by(decisions.c.decision_id)).all()
    stations = connection.scalars(
        sql.select(deployments.c.workstation)
        .where(deployments.c.skill_name == name, deployments.c.version == version)
        .order_by(deployments.c.workstation)
    ).all()
    with stored(f"{name} version {version}"):
        parts = {
            key: json.loads(getattr(row, key))
            for key in (
                "required_atomic_skills",
                "means",
                "covariances",
                "dispense",
                "parameters",
                "provenance",
                "report",
                "verdicts",
                "contributors",
            )
        }
        return SkillDescription(
            name=row.skill_name,
            version=row.version,
            semantic_type=row.semantic_type,
            state=VersionState(row.state),
            model_digest=row.model_digest,
            dimension=row.dimension,
            frame=row.frame,
            clock=row.clock,
            duration=row.duration,
            time_step=row.time_step,
            covariance_rule=row.covariance_rule,
            decisions=tuple(
                Decision(state=VersionState(made.state), actor=made.actor, at=made.at, comment=made.comment)
                for made in taken
            ),
            workstations=tuple(stations),
            approvals_needed=row.approvals_needed,
            **parts,
        )


def aligned_of(connection: sql.Connection, name: str, version: int) -> Sequence[sql.Row[Any]]:
    """Return the rows of the aligned demonstrations of a version, in order."""
    version = number(connection, name, version)
    return connection.execute(_rows_of(aligned, name, version).order_by(aligned.c.position)).all()


def decide(
    connection: sql.Connection,
    name: str,
    version: int,
    to: VersionState,
    actor: str,
    comment: str,
    digest: bytes | None = None,
    four_eyes: bool = False,
    with_reason: bool = False,
) -> VersionState:
    """Move a version to state ``to``, note who did, and return the state it is in now.

    ``digest``, if given, has to be that of the stored model; ``with_reason``: the comment must not
    be empty. A version that needs two approvals stays what it is after the first.
    """
    version = number(connection, name, version)
    row = connection.execute(
        sql.select(versions).where(versions.c.skill_name == name, versions.c.version == version)
    ).one()
    what = f"{name} version {version}"
    check_version_move(what, VersionState(row.state), to)
    if digest is not None and digest != bytes.fromhex(row.model_digest):
        raise DigestDiffers(name, version)
    outcome = to
    if four_eyes and to is VersionState.APPROVED:
        _refuse_own(row, name, version, actor)
        approved = contributors.approved_by(connection, name, version)
        if same_user(actor) in approved:
            raise OwnVersion(name, version, actor, "has approved")
        if len(approved) + 1 < row.approvals_needed:
            outcome = VersionState(row.state)
    if to is VersionState.RETIRED:
        _refuse_deployed(connection, name, version)
    if with_reason and not comment.strip():
        raise InvalidValue("comment", comment, "write a reason, it is kept with the decision")
    connection.execute(
        versions.update()
        .where(versions.c.skill_name == name, versions.c.version == version)
        .values(state=outcome.value)
    )
    connection.execute(
        decisions.insert().values(
            skill_name=name, version=version, state=to.value, actor=actor, at=now(), comment=comment
        )
    )
    return outcome


def _refuse_own(row: sql.Row[Any], name: str, version: int, actor: str) -> None:
    """Raise OwnVersion for somebody who contributed to a version, in the words for what they did."""
    provenance, me = json.loads(row.provenance), same_user(actor)
    did = {
        "taught": {provenance["taught_by"]},
        "imported": {provenance.get("imported_by", "")},
        "contributed to what became": {row.created_by, *json.loads(row.contributors)},
    }
    for words, people in did.items():
        if me in {same_user(one) for one in people}:
            raise OwnVersion(name, version, actor, words)


def check_approved(connection: sql.Connection, name: str, version: int) -> None:
    """Raise NotAllowedInState unless the version is approved."""
    state = connection.scalar(
        sql.select(versions.c.state).where(versions.c.skill_name == name, versions.c.version == version)
    )
    if state != VersionState.APPROVED:
        raise NotAllowedInState(f"{name} version {version}", str(state), "only one that is Approved can be deployed")


def add_skill(connection: sql.Connection, name: str, actor: str, default_recipe_id: str) -> None:
    """Store a new skill's name."""
    connection.execute(
        skills.insert().values(name=name, default_recipe_id=default_recipe_id, created_at=now(), created_by=actor)
    )


def default_recipe_id(connection: sql.Connection, name: str) -> str:
    """Return the id of the recipe that was made with the skill."""
    found = connection.scalar(sql.select(skills.c.default_recipe_id).where(skills.c.name == name))
    if found is None:
        raise NotFound("skill", name)
    return found


def _refuse_deployed(connection: sql.Connection, name: str, version: int) -> None:
    stations = connection.scalars(
        sql.select(deployments.c.workstation).where(deployments.c.skill_name == name, deployments.c.version == version)
    ).all()
    if stations:
        where = ", ".join(sorted(stations))
        raise InUse(f"{name} version {version}", f"deployed on {where}", "withdraw it there first")


def _rows_of(table: sql.Table, name: str, version: int) -> sql.Select[Any]:
    return sql.select(table).where(table.c.skill_name == name, table.c.version == version)

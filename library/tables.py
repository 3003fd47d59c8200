"""The tables. Numbers in SI units, matrices as JSON text that any tool can read, sampled data as npy blobs."""

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sql
from sqlalchemy import Column, ForeignKey, ForeignKeyConstraint, Index, Integer, LargeBinary, MetaData, String, Table

from library.values import MAX_NAME, MAX_RECIPE_ID

VERSION_TABLE = "alembic_version"
"""Alembic's own table: which step of the migrations the others are at."""

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class Moment(sql.types.TypeDecorator[datetime]):
    """A moment in UTC; zones are put back on reading, which SQLite forgets."""

    impl = sql.DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: sql.Dialect) -> datetime | None:
        """Return the moment in UTC."""
        if value is None:
            return None
        return value.astimezone(UTC) if value.tzinfo is not None else value.replace(tzinfo=UTC)

    def process_result_value(self, value: Any, dialect: sql.Dialect) -> datetime | None:
        """Return the moment with its zone."""
        if value is None:
            return None
        moment: datetime = value
        return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def name(length: int = MAX_NAME) -> String:
    """Return the type of a name: compared code point by code point in every database, as keyset paging needs."""
    return String(length).with_variant(String(length, collation="C"), "postgresql")  # pyright: ignore[reportReturnType]


# JSON as plain text: a database's own JSON type might rewrite numbers, and these have to come back bit for bit.
Json = sql.Text
Real = sql.Double
# SQLite counts up by itself only in a column that is exactly INTEGER.
Serial = sql.BigInteger().with_variant(Integer, "sqlite")

users = Table(
    "users",
    metadata,
    Column("name", name(), primary_key=True),
    Column("role", name(), nullable=False),
    Column("password_hash", sql.Text, nullable=False),
    Column("certificate", LargeBinary, nullable=False),
    Column("created_at", Moment, nullable=False),
    Column("created_by", sql.Text, nullable=False),
)

recordings = Table(
    "recordings",
    metadata,
    Column("digest", String(64), primary_key=True),
    Column("demonstration_id", sql.Text, nullable=False),
    Column("dimension", Integer, nullable=False),
    Column("samples", Integer, nullable=False),
    Column("times", LargeBinary, nullable=False),
    Column("points", LargeBinary, nullable=False),
    Column("triggers", LargeBinary, nullable=False),
    Column("orientations", LargeBinary),
    Column("operator", sql.Text, nullable=False),
    Column("source", sql.Text, nullable=False),
    Column("recorded_at", Moment),
)

skills = Table(
    "skills",
    metadata,
    Column("name", name(), primary_key=True),
    Column("default_recipe_id", name(MAX_RECIPE_ID), nullable=False),
    Column("created_at", Moment, nullable=False),
    Column("created_by", sql.Text, nullable=False),
)

versions = Table(
    "versions",
    metadata,
    Column("skill_name", name(), ForeignKey("skills.name"), primary_key=True),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("semantic_type", sql.Text, nullable=False),
    Column("state", String(16), nullable=False),
    Column("model_digest", String(64), nullable=False),
    Column("required_atomic_skills", Json, nullable=False),
    Column("dimension", Integer, nullable=False),
    Column("frame", sql.Text, nullable=False),
    Column("clock", String(16), nullable=False),
    Column("duration", Real, nullable=False),
    Column("time_step", Real, nullable=False),
    Column("covariance_rule", String(16), nullable=False),
    Column("means", Json, nullable=False),
    Column("covariances", Json, nullable=False),
    Column("dispense", Json, nullable=False),
    Column("parameters", Json, nullable=False),
    Column("provenance", Json, nullable=False),
    Column("report", Json, nullable=False),
    Column("verdicts", Json, nullable=False),
    Column("created_at", Moment, nullable=False),
    Column("created_by", sql.Text, nullable=False),
    Column("contributors", Json, nullable=False, server_default="[]"),
    Column("approvals_needed", Integer, nullable=False, server_default="1"),
    Index("ix_versions_by_state", "state", "skill_name", "version"),
    Index("ix_versions_by_type", "semantic_type", "skill_name", "version"),
    Index("ix_versions_by_type_and_state", "semantic_type", "state", "skill_name", "version"),
)

_OF_VERSION = ("versions.skill_name", "versions.version")

version_recordings = Table(
    "version_recordings",
    metadata,
    Column("skill_name", name(), primary_key=True),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("position", Integer, primary_key=True, autoincrement=False),
    Column("digest", String(64), ForeignKey("recordings.digest"), nullable=False),
    ForeignKeyConstraint(("skill_name", "version"), _OF_VERSION),
)

aligned = Table(
    "aligned",
    metadata,
    Column("skill_name", name(), primary_key=True),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("position", Integer, primary_key=True, autoincrement=False),
    Column("demonstration_id", sql.Text, nullable=False),
    Column("phases", LargeBinary, nullable=False),
    Column("times", LargeBinary, nullable=False),
    Column("points", LargeBinary, nullable=False),
    Column("triggers", LargeBinary, nullable=False),
    ForeignKeyConstraint(("skill_name", "version"), _OF_VERSION),
)

decisions = Table(
    "decisions",
    metadata,
    Column("decision_id", Serial, primary_key=True),
    Column("skill_name", name(), nullable=False),
    Column("version", Integer, nullable=False),
    Column("state", String(16), nullable=False),
    Column("actor", sql.Text, nullable=False),
    Column("at", Moment, nullable=False),
    Column("comment", sql.Text, nullable=False),
    ForeignKeyConstraint(("skill_name", "version"), _OF_VERSION),
    Index("ix_decisions_by_version", "skill_name", "version"),
    sqlite_autoincrement=True,
)

deployments = Table(
    "deployments",
    metadata,
    Column("workstation", name(), primary_key=True),
    Column("skill_name", name(), primary_key=True),
    Column("version", Integer, nullable=False),
    Column("deployed_at", Moment, nullable=False),
    Column("deployed_by", sql.Text, nullable=False),
    ForeignKeyConstraint(("skill_name", "version"), _OF_VERSION),
    Index("ix_deployments_by_version", "skill_name", "version"),
)

recipes = Table(
    "recipes",
    metadata,
    Column("recipe_id", name(MAX_RECIPE_ID), primary_key=True),
    Column("skill_name", name(), ForeignKey("skills.name"), nullable=False),
    Column("content", Json, nullable=False),
    Column("changed_at", Moment, nullable=False),
    Column("changed_by", sql.Text, nullable=False),
    Index("ix_recipes_by_skill", "skill_name", "recipe_id"),
)

jobs = Table(
    "jobs",
    metadata,
    Column("number", Serial, primary_key=True),
    Column("job_id", name(), nullable=False, unique=True),
    Column("state", String(16), nullable=False),
    Column("workstation", name(), nullable=False),
    Column("skill_name", sql.Text, nullable=False),
    Column("recipe_id", name(MAX_RECIPE_ID), nullable=False),
    Column("progress", Real, nullable=False),
    Column("report", Json, nullable=False),
    Column("recipe", Json, nullable=False),
    Column("server", sql.Text, nullable=False, server_default=""),
    Index("ix_jobs_by_state", "state", "number"),
    Index("ix_jobs_by_workstation", "workstation", "number"),
    sqlite_autoincrement=True,
)

job_orders = Table(
    "job_orders",
    metadata,
    Column("number", Serial, primary_key=True),
    Column("workstation", name(), nullable=False),
    Column("order_id", name(), nullable=False),
    Column("content", LargeBinary, nullable=False),
    Column("job_id", name(), nullable=False),
    Column("ended", String(16), nullable=False),
    Column("actor", sql.Text, nullable=False),
    Column("received_at", Moment, nullable=False),
    Index("uq_job_orders_workstation_order_id", "workstation", "order_id", unique=True),
    Index("ix_job_orders_by_job", "job_id"),
    sqlite_autoincrement=True,
)

stations = Table(
    "stations",
    metadata,
    Column("workstation", name(), primary_key=True),
    Column("held_because", String(32), nullable=False),
    Column("held_by", sql.Text, nullable=False),
    Column("held_since", Moment, nullable=False),
    Column("speed_override", Real, nullable=False),
)

leases = Table(
    "leases",
    metadata,
    Column("workstation", name(), primary_key=True),
    Column("server", sql.Text, nullable=False),
    Column("endpoint", sql.Text, nullable=False),
    Column("until", Moment, nullable=False),
)

traces = Table(
    "traces",
    metadata,
    Column("job_id", name(), ForeignKey("jobs.job_id"), primary_key=True),
    Column("columns", Json, nullable=False),
    Column("times", LargeBinary, nullable=False),
    Column("commanded", LargeBinary, nullable=False),
    Column("measured", LargeBinary, nullable=False),
)

audit = Table(
    "audit",
    metadata,
    Column("entry_id", Serial, primary_key=True),
    Column("at", Moment, nullable=False),
    Column("actor", sql.Text, nullable=False),
    Column("role", sql.Text, nullable=False),
    Column("action", sql.Text, nullable=False),
    Column("target", sql.Text, nullable=False),
    Column("arguments", Json, nullable=False),
    Column("status", sql.Text, nullable=False),
    Column("reason", sql.Text, nullable=False),
    sqlite_autoincrement=True,
)

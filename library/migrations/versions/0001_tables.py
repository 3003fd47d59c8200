"""The tables."""

import sqlalchemy as sql
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create all tables."""
    name = sql.String(128).with_variant(sql.String(128, collation="C"), "postgresql")
    recipe_id = sql.String(160).with_variant(sql.String(160, collation="C"), "postgresql")
    serial = sql.BigInteger().with_variant(sql.Integer, "sqlite")
    moment = sql.DateTime(timezone=True)
    real: sql.types.TypeEngine[float] = sql.Double()

    op.create_table(
        "audit",
        sql.Column("entry_id", serial, nullable=False),
        sql.Column("at", moment, nullable=False),
        sql.Column("actor", sql.Text(), nullable=False),
        sql.Column("role", sql.Text(), nullable=False),
        sql.Column("action", sql.Text(), nullable=False),
        sql.Column("target", sql.Text(), nullable=False),
        sql.Column("arguments", sql.Text(), nullable=False),
        sql.Column("status", sql.Text(), nullable=False),
        sql.Column("reason", sql.Text(), nullable=False),
        sql.PrimaryKeyConstraint("entry_id", name=op.f("pk_audit")),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "jobs",
        sql.Column("number", serial, nullable=False),
        sql.Column("job_id", name, nullable=False),
        sql.Column("state", sql.String(length=16), nullable=False),
        sql.Column("workstation", name, nullable=False),
        sql.Column("skill_name", sql.Text(), nullable=False),
        sql.Column("recipe_id", recipe_id, nullable=False),
        sql.Column("progress", real, nullable=False),
        sql.Column("report", sql.Text(), nullable=False),
        sql.Column("recipe", sql.Text(), nullable=False),
        sql.PrimaryKeyConstraint("number", name=op.f("pk_jobs")),
        sql.UniqueConstraint("job_id", name=op.f("uq_jobs_job_id")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_jobs_by_state", "jobs", ["state", "number"])
    op.create_index("ix_jobs_by_workstation", "jobs", ["workstation", "number"])
    op.create_table(
        "recordings",
        sql.Column("digest", sql.String(length=64), nullable=False),
        sql.Column("demonstration_id", sql.Text(), nullable=False),
        sql.Column("dimension", sql.Integer(), nullable=False),
        sql.Column("samples", sql.Integer(), nullable=False),
        sql.Column("times", sql.LargeBinary(), nullable=False),
        sql.Column("points", sql.LargeBinary(), nullable=False),
        sql.Column("triggers", sql.LargeBinary(), nullable=False),
        sql.Column("orientations", sql.LargeBinary(), nullable=True),
        sql.Column("operator", sql.Text(), nullable=False),
        sql.Column("source", sql.Text(), nullable=False),
        sql.Column("recorded_at", moment, nullable=True),
        sql.PrimaryKeyConstraint("digest", name=op.f("pk_recordings")),
    )
    op.create_table(
        "skills",
        sql.Column("name", name, nullable=False),
        sql.Column("default_recipe_id", recipe_id, nullable=False),
        sql.Column("created_at", moment, nullable=False),
        sql.Column("created_by", sql.Text(), nullable=False),
        sql.PrimaryKeyConstraint("name", name=op.f("pk_skills")),
    )
    op.create_table(
        "users",
        sql.Column("name", name, nullable=False),
        sql.Column("role", name, nullable=False),
        sql.Column("password_hash", sql.Text(), nullable=False),
        sql.Column("certificate", sql.LargeBinary(), nullable=False),
        sql.Column("created_at", moment, nullable=False),
        sql.Column("created_by", sql.Text(), nullable=False),
        sql.PrimaryKeyConstraint("name", name=op.f("pk_users")),
    )
    op.create_table(
        "recipes",
        sql.Column("recipe_id", recipe_id, nullable=False),
        sql.Column("skill_name", name, nullable=False),
        sql.Column("content", sql.Text(), nullable=False),
        sql.Column("changed_at", moment, nullable=False),
        sql.Column("changed_by", sql.Text(), nullable=False),
        sql.ForeignKeyConstraint(["skill_name"], ["skills.name"], name=op.f("fk_recipes_skill_name")),
        sql.PrimaryKeyConstraint("recipe_id", name=op.f("pk_recipes")),
    )
    op.create_index("ix_recipes_by_skill", "recipes", ["skill_name", "recipe_id"])
    op.create_table(
        "traces",
        sql.Column("job_id", name, nullable=False),
        sql.Column("columns", sql.Text(), nullable=False),
        sql.Column("times", sql.LargeBinary(), nullable=False),
        sql.Column("commanded", sql.LargeBinary(), nullable=False),
        sql.Column("measured", sql.LargeBinary(), nullable=False),
        sql.ForeignKeyConstraint(["job_id"], ["jobs.job_id"], name=op.f("fk_traces_job_id")),
        sql.PrimaryKeyConstraint("job_id", name=op.f("pk_traces")),
    )
    op.create_table(
        "versions",
        sql.Column("skill_name", name, nullable=False),
        sql.Column("version", sql.Integer(), autoincrement=False, nullable=False),
        sql.Column("semantic_type", sql.Text(), nullable=False),
        sql.Column("state", sql.String(length=16), nullable=False),
        sql.Column("model_digest", sql.String(length=64), nullable=False),
        sql.Column("required_atomic_skills", sql.Text(), nullable=False),
        sql.Column("dimension", sql.Integer(), nullable=False),
        sql.Column("frame", sql.Text(), nullable=False),
        sql.Column("clock", sql.String(length=16), nullable=False),
        sql.Column("duration", real, nullable=False),
        sql.Column("time_step", real, nullable=False),
        sql.Column("covariance_rule", sql.String(length=16), nullable=False),
        sql.Column("means", sql.Text(), nullable=False),
        sql.Column("covariances", sql.Text(), nullable=False),
        sql.Column("dispense", sql.Text(), nullable=False),
        sql.Column("parameters", sql.Text(), nullable=False),
        sql.Column("provenance", sql.Text(), nullable=False),
        sql.Column("report", sql.Text(), nullable=False),
        sql.Column("verdicts", sql.Text(), nullable=False),
        sql.Column("created_at", moment, nullable=False),
        sql.Column("created_by", sql.Text(), nullable=False),
        sql.ForeignKeyConstraint(["skill_name"], ["skills.name"], name=op.f("fk_versions_skill_name")),
        sql.PrimaryKeyConstraint("skill_name", "version", name=op.f("pk_versions")),
    )
    op.create_index("ix_versions_by_state", "versions", ["state", "skill_name", "version"])
    op.create_index("ix_versions_by_type", "versions", ["semantic_type", "skill_name", "version"])
    op.create_index("ix_versions_by_type_and_state", "versions", ["semantic_type", "state", "skill_name", "version"])
    op.create_table(
        "aligned",
        sql.Column("skill_name", name, nullable=False),
        sql.Column("version", sql.Integer(), autoincrement=False, nullable=False),
        sql.Column("position", sql.Integer(), autoincrement=False, nullable=False),
        sql.Column("demonstration_id", sql.Text(), nullable=False),
        sql.Column("phases", sql.LargeBinary(), nullable=False),
        sql.Column("times", sql.LargeBinary(), nullable=False),
        sql.Column("points", sql.LargeBinary(), nullable=False),
        sql.Column("triggers", sql.LargeBinary(), nullable=False),
        sql.ForeignKeyConstraint(
            ["skill_name", "version"],
            ["versions.skill_name", "versions.version"],
            name=op.f("fk_aligned_skill_name_version"),
        ),
        sql.PrimaryKeyConstraint("skill_name", "version", "position", name=op.f("pk_aligned")),
    )
    op.create_table(
        "decisions",
        sql.Column("decision_id", serial, nullable=False),
        sql.Column("skill_name", name, nullable=False),
        sql.Column("version", sql.Integer(), nullable=False),
        sql.Column("state", sql.String(length=16), nullable=False),
        sql.Column("actor", sql.Text(), nullable=False),
        sql.Column("at", moment, nullable=False),
        sql.Column("comment", sql.Text(), nullable=False),
        sql.ForeignKeyConstraint(
            ["skill_name", "version"],
            ["versions.skill_name", "versions.version"],
            name=op.f("fk_decisions_skill_name_version"),
        ),
        sql.PrimaryKeyConstraint("decision_id", name=op.f("pk_decisions")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_decisions_by_version", "decisions", ["skill_name", "version"])
    op.create_table(
        "deployments",
        sql.Column("workstation", name, nullable=False),
        sql.Column("skill_name", name, nullable=False),
        sql.Column("version", sql.Integer(), nullable=False),
        sql.Column("deployed_at", moment, nullable=False),
        sql.Column("deployed_by", sql.Text(), nullable=False),
        sql.ForeignKeyConstraint(
            ["skill_name", "version"],
            ["versions.skill_name", "versions.version"],
            name=op.f("fk_deployments_skill_name_version"),
        ),
        sql.PrimaryKeyConstraint("workstation", "skill_name", name=op.f("pk_deployments")),
    )
    op.create_index("ix_deployments_by_version", "deployments", ["skill_name", "version"])
    op.create_table(
        "version_recordings",
        sql.Column("skill_name", name, nullable=False),
        sql.Column("version", sql.Integer(), autoincrement=False, nullable=False),
        sql.Column("position", sql.Integer(), autoincrement=False, nullable=False),
        sql.Column("digest", sql.String(length=64), nullable=False),
        sql.ForeignKeyConstraint(["digest"], ["recordings.digest"], name=op.f("fk_version_recordings_digest")),
        sql.ForeignKeyConstraint(
            ["skill_name", "version"],
            ["versions.skill_name", "versions.version"],
            name=op.f("fk_version_recordings_skill_name_version"),
        ),
        sql.PrimaryKeyConstraint("skill_name", "version", "position", name=op.f("pk_version_recordings")),
    )

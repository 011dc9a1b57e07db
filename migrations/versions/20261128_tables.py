"""all tables, as they were before the first release

Revision ID: 2f8d61b4c7e0
Revises:
Create Date: 2026-11-28 09:40:00

Databases of earlier states end at other revisions, and are refused with what to do.
"""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "2f8d61b4c7e0"
down_revision = None
branch_labels = None
depends_on = None

LARGE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
TIME = sa.DateTime(timezone=True)
NULL_OR_JSON = sa.JSON(none_as_null=True)


def column(name: str, kind: Any, *more: Any, **options: Any) -> sa.Column[Any]:
    """A column that always has a value, unless something else is said."""
    return sa.Column(name, kind, *more, **{"nullable": False, **options})


def of(table: str, **options: Any) -> sa.Column[Any]:
    """A column with the row of another table that this one belongs to, and goes with."""
    key = sa.ForeignKey(f"{table}.id", ondelete="CASCADE")
    return column(
        f"{table}_id", sa.String(64) if table == "machine" else sa.Integer(), key, **options
    )


def number(**options: Any) -> sa.Column[Any]:
    return column("id", sa.Integer(), primary_key=True, **options)


def upgrade() -> None:
    op.create_table(
        "machine",
        column("id", sa.String(64), primary_key=True),
        column("name", sa.Text()),
        column("configuration", sa.String(8)),
        column("axes", sa.JSON()),
        column("sensors", sa.JSON()),
        column("out_of_range", sa.String(16)),
        column("extrapolation_margin_c", sa.Double()),
        column("extrapolation_error_ratio", sa.Double(), server_default="3.0"),
        column("same_temperature", sa.String(16)),
        column("serial_number", sa.Text(), nullable=True),
        column("active_version", sa.Integer(), nullable=True),
        column("waiting_version", sa.Integer(), nullable=True),
        column("revision", sa.Integer()),
        column("withdrawals", sa.Integer(), server_default=sa.text("0")),
        column("entries_after", sa.BigInteger(), server_default=sa.text("0")),
        column("created_at", TIME),
    )
    op.create_table(
        "error_map",
        number(),
        of("machine"),
        column("label", sa.Text()),
        column("measured_at", TIME),
        column("temperatures_c", sa.JSON()),
        column("measuring_lines_mm", sa.JSON()),
        column("repeatability_um", sa.Double(), nullable=True),
        column("instrument", sa.Text(), nullable=True),
        column("stored_at", TIME),
        column("withdrawn_at", TIME, nullable=True),
    )
    _index(
        "uq_error_map_label_in_use", "error_map", ["machine_id", "label"], "withdrawn_at IS NULL"
    )
    op.create_table(
        "error_map_component",
        of("error_map", primary_key=True),
        column("component", sa.String(8), primary_key=True),
        column("place", sa.Integer()),
        column("positions_mm", sa.LargeBinary()),
        column("errors", sa.LargeBinary()),
        column("backward_errors", sa.LargeBinary(), nullable=True),
        column("covariance", sa.LargeBinary(), nullable=True),
        column("backward_covariance", sa.LargeBinary(), nullable=True),
    )
    op.create_table(
        "model_version",
        of("machine", primary_key=True),
        column("version", sa.Integer(), primary_key=True, autoincrement=False),
        column("created_at", TIME),
        column("reason", sa.Text()),
        column("assignment", sa.JSON()),
        column("effects", sa.JSON()),
    )
    op.create_table(
        "model_version_map",
        column("machine_id", sa.String(64), primary_key=True),
        column("version", sa.Integer(), primary_key=True, autoincrement=False),
        of("error_map", primary_key=True),
        sa.ForeignKeyConstraint(
            ["machine_id", "version"],
            ["model_version.machine_id", "model_version.version"],
            ondelete="CASCADE",
        ),
    )
    _create_readings()
    op.create_table(
        "withdrawn_reading",
        column("id", LARGE, primary_key=True, autoincrement=False),
        of("machine"),
        column("time", TIME),
        column("temperatures_c", sa.JSON()),
        column("state", sa.JSON()),
        column("withdrawn_at", TIME),
    )
    op.create_table(
        "temperature_hour",
        of("machine", primary_key=True),
        column("hour", TIME, primary_key=True),
        column("is_stale", sa.Boolean()),
        column("minutes", sa.JSON()),
        column("whole", sa.LargeBinary()),
        column("bins", sa.LargeBinary()),
    )
    op.create_table(
        "temperature_hours_done", number(autoincrement=False), column("number", sa.BigInteger())
    )
    op.create_table(
        "verification",
        number(),
        of("machine"),
        column("label", sa.Text()),
        column("datum", sa.String(16)),
        column("repeatability_um", sa.Double(), nullable=True),
        column("instrument", sa.Text(), nullable=True),
        column("operator", sa.Text(), nullable=True),
        column("stored_at", TIME),
        column("first_at", TIME),
        column("last_at", TIME),
        column("observations", sa.Integer()),
        column("components", sa.JSON()),
        column("state_names", sa.JSON()),
        column("judgement", NULL_OR_JSON, nullable=True),
        column("times_s", sa.LargeBinary()),
        column("component", sa.LargeBinary()),
        column("measured", sa.LargeBinary()),
        column("points_mm", sa.LargeBinary()),
        column("tool_offsets_mm", sa.LargeBinary()),
        column("directions", sa.LargeBinary()),
        column("states", sa.LargeBinary()),
        column("setup_names", sa.JSON(), server_default="[]"),
        column("setup", sa.LargeBinary(), nullable=True),
        sa.UniqueConstraint("machine_id", "label"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "analysis",
        number(),
        of("machine"),
        column("model_version", sa.Integer()),
        column("verification_ids", sa.JSON()),
        column("holdout_fraction", sa.Double()),
        column("kinds", NULL_OR_JSON, nullable=True),
        column("seed", sa.Integer()),
        column("status", sa.String(16)),
        column("progress", sa.Double()),
        column("message", sa.Text()),
        column("created_at", TIME),
        column("started_at", TIME, nullable=True),
        column("finished_at", TIME, nullable=True),
        column("owner", sa.String(64), nullable=True),
        column("beats", sa.Integer()),
        column("tries", sa.Integer(), server_default=sa.text("0")),
        column("adopted_version", sa.Integer(), nullable=True),
        column("result", sa.Text(), nullable=True),
        column("confirmed", NULL_OR_JSON, nullable=True),
        sqlite_autoincrement=True,
    )
    _index("uq_analysis_running_machine", "analysis", ["machine_id"], "status = 'running'")
    op.create_table(
        "watch",
        of("machine", primary_key=True),
        column("model_version", sa.Integer(), primary_key=True, autoincrement=False),
        column("status", sa.String(16)),
        column("state", sa.JSON()),
        column("updated_at", TIME),
    )
    op.create_table(
        "access_key",
        number(),
        column("name", sa.String(64), unique=True),
        column("role", sa.String(16)),
        column("machines", sa.JSON(), nullable=True),
        column("digest", sa.String(64), unique=True),
        column("created_at", TIME),
        column("last_used_at", TIME, nullable=True),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "browser_session",
        column("digest", sa.String(64), primary_key=True),
        column("key_id", sa.Integer(), sa.ForeignKey("access_key.id", ondelete="CASCADE")),
        column("expires_at", TIME),
    )
    op.create_index("ix_browser_session_key_id", "browser_session", ["key_id"])
    op.create_table(
        "connection_report",
        column("owner", sa.String(200), primary_key=True),
        column("told_at", TIME),
        column("content", sa.Text()),
    )
    op.create_table(
        "receiver",
        column("name", sa.String(64), primary_key=True),
        column("service", sa.String(64)),
        column("machines", sa.JSON()),
        column("announced", sa.JSON()),
        column("settled", sa.BigInteger()),
        column("waiting", sa.JSON()),
        column("looked_at", TIME),
        column("sent_at", TIME, nullable=True),
        column("sent", sa.Text()),
        column("failing_since", TIME, nullable=True),
        column("failure", sa.Text()),
        column("test_asked_at", TIME, nullable=True),
        column("tested_at", TIME, nullable=True),
        column("test_failure", sa.Text()),
    )
    op.create_table(
        "event",
        column("id", LARGE, primary_key=True),
        column("time", TIME),
        column("kind", sa.String(16)),
        column("subject", sa.String(64)),
        column("machine_id", sa.String(64), nullable=True),
        column("who", sa.String(128)),
        column("text", sa.Text()),
        column("details", sa.JSON()),
        column("until", TIME, nullable=True),
        column("count", sa.Integer()),
        column("number", sa.BigInteger(), nullable=True),
    )
    op.create_index("ix_event_machine_id", "event", ["machine_id", "id"])
    op.create_index("ix_event_time", "event", ["time"])
    op.create_index("ix_event_number", "event", ["number"], unique=True)
    lasting = "until IS NULL AND subject <> ''"
    _index("ix_event_lasting", "event", ["machine_id"], lasting, unique=False)


def _create_readings() -> None:
    """Make the table of readings; on PostgreSQL by months (`app.storage.partitions`)."""
    by_months = op.get_bind().dialect.name == "postgresql"
    op.create_table(
        "reading",
        column("id", LARGE, primary_key=True, autoincrement=True),
        of("machine"),
        # What parts a table is in all of its unique keys.
        column("time", TIME, primary_key=by_months),
        column("temperatures_c", sa.JSON()),
        column("state", sa.JSON()),
        column("early_s", sa.Double(), nullable=True),
        sa.UniqueConstraint("machine_id", "time"),
        sqlite_autoincrement=True,
        postgresql_partition_by="RANGE (time)",
    )
    if by_months:
        op.execute("CREATE TABLE reading_default PARTITION OF reading DEFAULT")


def _index(name: str, table: str, columns: list[str], where: str, *, unique: bool = True) -> None:
    """Make an index of the rows for which something is so."""
    only = sa.text(where)
    op.create_index(name, table, columns, unique=unique, sqlite_where=only, postgresql_where=only)

"""readings in partitions of a month, on PostgreSQL

Revision ID: 4f7a1c92be60
Revises: 9c41e7d25ab8
Create Date: 2026-11-23 02:00:41.310775
"""

from datetime import UTC, datetime

import sqlalchemy as sa
from alembic import op

revision = "4f7a1c92be60"
down_revision = "9c41e7d25ab8"
branch_labels = None
depends_on = None

MOST_MONTHS = 240
"""Of those that have readings, the newest; older ones stay together."""

RENAMED = ("pk_reading", "uq_reading_machine_id_time", "fk_reading_machine")

CONSTRAINTS = """
    CONSTRAINT pk_reading PRIMARY KEY ({key}),
    CONSTRAINT uq_reading_machine_id_time UNIQUE (machine_id, time),
    CONSTRAINT fk_reading_machine FOREIGN KEY (machine_id) REFERENCES machine (id)
        ON DELETE CASCADE
"""


def upgrade() -> None:
    if op.get_bind().dialect.name != "postgresql":
        return
    _make_anew("id, time", "PARTITION BY RANGE (time)")
    op.execute("CREATE TABLE reading_default PARTITION OF reading DEFAULT")
    months = op.get_bind().scalars(
        sa.text(
            "SELECT DISTINCT date_trunc('month', time, 'UTC') AS month FROM reading_before "
            "ORDER BY month DESC LIMIT :most"
        ),
        {"most": MOST_MONTHS},
    )
    for month in [found.astimezone(UTC) for found in months]:
        after = datetime(month.year + month.month // 12, month.month % 12 + 1, 1, tzinfo=UTC)
        op.execute(
            f"CREATE TABLE reading_{month:%Ym%m} PARTITION OF reading "
            f"FOR VALUES FROM ('{month.isoformat()}') TO ('{after.isoformat()}')"
        )
    _move_back()


def downgrade() -> None:
    if op.get_bind().dialect.name != "postgresql":
        return
    _make_anew("id", "")
    _move_back()


def _make_anew(key: str, partitioned: str) -> None:
    """Make another table of readings, empty, beside the present one under another name."""
    op.execute("ALTER TABLE reading RENAME TO reading_before")
    for name in RENAMED:
        op.execute(f"ALTER TABLE reading_before RENAME CONSTRAINT {name} TO {name}_before")
    op.execute(
        f"CREATE TABLE reading (LIKE reading_before INCLUDING DEFAULTS, "
        f"{CONSTRAINTS.format(key=key)}) {partitioned}"
    )
    op.execute("ALTER SEQUENCE reading_id_seq OWNED BY reading.id")


def _move_back() -> None:
    op.execute("INSERT INTO reading SELECT * FROM reading_before")
    op.execute("DROP TABLE reading_before")

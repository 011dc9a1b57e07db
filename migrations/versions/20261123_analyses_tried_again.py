"""analyses that are tried again, one of a machine at a time

Revision ID: a86c2d5f4e17
Revises: 4f7a1c92be60
Create Date: 2026-11-23 01:20:00.000000
"""

import sqlalchemy as sa
from alembic import op

revision = "a86c2d5f4e17"
down_revision = "4f7a1c92be60"
branch_labels = None
depends_on = None

RUNNING = sa.text("status = 'running'")


def upgrade() -> None:
    op.add_column(
        "analysis", sa.Column("tries", sa.Integer(), nullable=False, server_default=sa.text("0"))
    )
    # Of what an older service ran several may be of one machine; nobody runs them any more.
    op.execute(
        "UPDATE analysis SET status = 'queued', owner = NULL, started_at = NULL, progress = 0, "
        "message = 'waits for its turn' WHERE status = 'running'"
    )
    op.create_index(
        "uq_analysis_running_machine",
        "analysis",
        ["machine_id"],
        unique=True,
        sqlite_where=RUNNING,
        postgresql_where=RUNNING,
    )


def downgrade() -> None:
    op.drop_index("uq_analysis_running_machine", table_name="analysis")
    op.drop_column("analysis", "tries")

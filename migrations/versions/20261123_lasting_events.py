"""an index of what has come and not gone

Revision ID: 6d2b9f40c1e7
Revises: a86c2d5f4e17
Create Date: 2026-11-23 06:25:12.480112
"""

import sqlalchemy as sa
from alembic import op

revision = "6d2b9f40c1e7"
down_revision = "a86c2d5f4e17"
branch_labels = None
depends_on = None

LASTS = sa.text("until IS NULL AND subject <> ''")


def upgrade() -> None:
    op.create_index(
        "ix_event_lasting", "event", ["machine_id"], postgresql_where=LASTS, sqlite_where=LASTS
    )


def downgrade() -> None:
    op.drop_index("ix_event_lasting", "event")

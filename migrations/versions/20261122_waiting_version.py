"""model versions that wait for their activation

Revision ID: 7b1d94c0e3a5
Revises: b3a6f0c41d27
Create Date: 2026-11-22 04:50:00.000000
"""

import sqlalchemy as sa
from alembic import op

revision = "7b1d94c0e3a5"
down_revision = "b3a6f0c41d27"
branch_labels = None
depends_on = None


# Not in a batch: that would make the table anew on SQLite, and with the old one everything
# that refers to its rows would go.


def upgrade() -> None:
    op.add_column("machine", sa.Column("waiting_version", sa.Integer(), nullable=True))


def downgrade() -> None:
    op.drop_column("machine", "waiting_version")

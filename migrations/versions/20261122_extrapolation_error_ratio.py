"""how uncertain an extrapolated value may be

Revision ID: b3a6f0c41d27
Revises: 8e51b7c3d0f4
Create Date: 2026-11-22 05:30:12.417903
"""

import sqlalchemy as sa
from alembic import op

revision = "b3a6f0c41d27"
down_revision = "8e51b7c3d0f4"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Machines of the former version get the default. Not in a batch: on SQLite that makes the
    # table anew when a column goes, and all that belongs to the machines would go with the old one.
    op.add_column(
        "machine",
        sa.Column("extrapolation_error_ratio", sa.Double(), nullable=False, server_default="3.0"),
    )


def downgrade() -> None:
    op.drop_column("machine", "extrapolation_error_ratio")

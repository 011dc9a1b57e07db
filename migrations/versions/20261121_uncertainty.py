"""uncertainty of error maps

Revision ID: 5d0c1f7a92e4
Revises: 869265db76ba
Create Date: 2026-11-21 11:52:10.318275
"""

import sqlalchemy as sa
from alembic import op

revision = "5d0c1f7a92e4"
down_revision = "869265db76ba"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # Maps of the former version state no uncertainty, and none stands for that.
    with op.batch_alter_table("error_map_component", schema=None) as batch_op:
        batch_op.add_column(sa.Column("covariance", sa.LargeBinary(), nullable=True))
        batch_op.add_column(sa.Column("backward_covariance", sa.LargeBinary(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("error_map_component", schema=None) as batch_op:
        batch_op.drop_column("backward_covariance")
        batch_op.drop_column("covariance")

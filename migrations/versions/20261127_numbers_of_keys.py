"""numbers of keys that are never given again, and where the log of a machine begins

Revision ID: 1e94b7c05ad8
Revises: c83f5e0a7d19
Create Date: 2026-11-27 22:30:11.730915
"""

import sqlalchemy as sa
from alembic import op

revision = "1e94b7c05ad8"
down_revision = "c83f5e0a7d19"
branch_labels = None
depends_on = None


def upgrade() -> None:
    # A number that was given again may have opened them for another key than was stated.
    op.execute("DELETE FROM browser_session")
    _make_keys_anew(sqlite_autoincrement=True)
    op.add_column(
        "machine",
        sa.Column("entries_after", sa.BigInteger(), nullable=False, server_default=sa.text("0")),
    )
    op.execute(
        "UPDATE machine SET entries_after = coalesce((SELECT max(number) FROM event "
        "WHERE machine_id = machine.id AND kind = 'machine' AND text = 'machine deleted'), 0)"
    )


def downgrade() -> None:
    op.drop_column("machine", "entries_after")
    op.execute("DELETE FROM browser_session")
    _make_keys_anew(sqlite_autoincrement=False)


def _make_keys_anew(*, sqlite_autoincrement: bool) -> None:
    """Make the table of keys anew on SQLite; a sequence of PostgreSQL gives no number twice."""
    if op.get_bind().dialect.name != "sqlite":
        return
    with op.batch_alter_table(
        "access_key",
        recreate="always",
        table_kwargs={"sqlite_autoincrement": sqlite_autoincrement},
    ) as keys:
        if not sqlite_autoincrement:  # a key that counts by itself has no name
            keys.create_primary_key("pk_access_key", ["id"])

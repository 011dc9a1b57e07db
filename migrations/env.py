"""Runs migrations on the connection that the service hands over, or on alembic.ini's URL."""

import os

from alembic import context
from sqlalchemy import Connection, create_engine
from sqlalchemy.types import TypeDecorator

from app.storage.tables import Base

config = context.config


def plain_type(kind: str, item: object, context: object) -> str | bool:
    """Write our own column types as the types they are stored as: migrations outlive them."""
    if kind == "type" and isinstance(item, TypeDecorator):
        return f"sa.{item.impl_instance!r}"
    return False


def is_ours(name: str | None, kind: str, parents: object) -> bool:
    """Leave PostgreSQL's partitions aside: they come and go with the months."""
    return not (kind == "table" and name is not None and name.startswith("reading_"))


def run(connection: Connection) -> None:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=connection.dialect.name == "sqlite",
        compare_type=True,
        render_item=plain_type,
        include_name=is_ours,
        transaction_per_migration=False,
    )
    with context.begin_transaction():
        context.run_migrations()


handed_over = config.attributes.get("connection")
if handed_over is not None:
    run(handed_over)
else:
    url = os.environ.get("THERMAP_DATABASE_URL") or config.get_main_option("sqlalchemy.url")
    with create_engine(url).begin() as connection:
        run(connection)

"""Tables can be made anew without the rows that refer to them being lost."""

import pytest
from alembic.operations import Operations
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Text, text

from app.storage.database import Database
from tests.service_examples import furnish_database

TABLES = ("machine", "error_map", "error_map_component", "model_version", "model_version_map")


def counts(database):
    with database.reading() as session:
        return [session.scalar(text(f"SELECT count(*) FROM {table}")) for table in TABLES]


@pytest.fixture
def database(furnished_url):
    opened = Database(furnished_url)
    yield opened
    opened.close()


def test_a_table_that_others_refer_to_is_made_anew_with_all_rows(database):
    before = counts(database)
    assert min(before) > 0
    with database.migrating() as connection:
        operations = Operations(MigrationContext.configure(connection))
        with operations.batch_alter_table("machine") as machine:
            machine.alter_column("name", existing_type=Text(), nullable=True)
    assert counts(database) == before
    with database.writing() as session:
        session.execute(text("DELETE FROM machine"))
    assert counts(database) == [0] * len(TABLES), "foreign keys hold again"


def test_a_migration_that_loses_what_rows_refer_to_is_rolled_back(databases):
    """On SQLite; PostgreSQL refuses the statement itself."""
    url = databases.prepared("sqlite", furnish_database)
    database = Database(url)
    before = counts(database)
    with pytest.raises(RuntimeError, match="lost"), database.migrating() as connection:
        connection.execute(text("DELETE FROM machine"))
    assert counts(database) == before
    database.close()
    databases.give_back(url)

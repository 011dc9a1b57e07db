"""Migrations: up from nothing, down again, agreed with the tables, and never past a newer one."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from alembic import command
from alembic.script import ScriptDirectory
from alembic.util.exc import CommandError
from sqlalchemy import inspect, make_url, text

from app.errors import StorageTooNew
from app.main import create_app
from app.settings import Settings
from app.storage import migrate as migrate_module
from app.storage.database import Database
from app.storage.migrate import alembic_config, current_revision, upgrade
from app.storage.tables import Base
from tests.service_examples import client_of, contents, furnish

PACKAGE_FOLDER = Path(__file__).parents[1]
SCRIPTS = ScriptDirectory.from_config(alembic_config())
REVISIONS = [script.revision for script in SCRIPTS.walk_revisions()][::-1]
TABLES = {table.name for table in Base.metadata.sorted_tables}


@pytest.fixture
def empty(empty_database_url):
    database = Database(empty_database_url)
    yield database
    database.close()


def tables(database):
    """Name all tables but PostgreSQL's partitions of readings."""
    found = inspect(database.engine).get_table_names()
    return {name for name in found if not name.startswith("reading_")}


def run(database, step, *arguments):
    """Run one of Alembic's commands in a transaction, as the service does."""
    with database.writing() as session:
        step(alembic_config(session.connection()), *arguments)


def check(database):
    """Hold the tables in the database against those in the code, with Alembic's own eyes."""
    run(database, command.check)


def schema(database):
    """Everything that a database says about its tables."""
    found = inspect(database.engine)
    return {
        name: (
            [(c["name"], repr(c["type"]), c["nullable"]) for c in found.get_columns(name)],
            found.get_pk_constraint(name),
            sorted(map(repr, found.get_foreign_keys(name))),
            sorted(map(_index, found.get_indexes(name))),
            sorted(map(repr, found.get_unique_constraints(name))),
        )
        for name in sorted(tables(database))
    }


def _index(index):
    options = {name: str(value) for name, value in index.get("dialect_options", {}).items()}
    return repr((index["name"], index["column_names"], index["unique"], sorted(options.items())))


def test_there_is_one_line_of_migrations():
    assert len(SCRIPTS.get_heads()) == 1
    assert len(SCRIPTS.get_bases()) == 1


def test_an_empty_database_is_brought_to_the_newest_tables(empty):
    assert tables(empty) == set()
    assert upgrade(empty).now == REVISIONS[-1]
    assert tables(empty) == TABLES | {"alembic_version"}
    with empty.reading() as session:
        assert current_revision(session.connection()) == REVISIONS[-1]


@pytest.mark.slow
def test_upgrading_again_changes_nothing(empty):
    upgrade(empty)
    before = schema(empty)
    assert upgrade(empty).now == REVISIONS[-1]
    assert schema(empty) == before


def test_migrations_and_tables_agree(empty):
    upgrade(empty)
    check(empty)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        "DROP INDEX uq_error_map_label_in_use",
        "ALTER TABLE machine ADD COLUMN colour TEXT",
        "ALTER TABLE error_map DROP COLUMN instrument",
        "DROP TABLE model_version_map",
        "CREATE TABLE forgotten (id INTEGER PRIMARY KEY)",
    ],
)
def test_a_disagreement_would_be_found(empty, change):
    upgrade(empty)
    with empty.writing() as session:
        session.execute(text(change))
    with pytest.raises(CommandError, match="New upgrade operations detected"):
        check(empty)


def test_the_partial_index_is_partial(empty):
    """Alembic compares no WHERE; the label of a withdrawn map has to be free."""
    upgrade(empty)
    (index,) = inspect(empty.engine).get_indexes("error_map")
    options = {k: str(v) for k, v in index["dialect_options"].items() if k.endswith("_where")}
    assert index["unique"]
    assert "withdrawn_at IS NULL" in str(list(options.values()))


@pytest.mark.slow
def test_every_step_up_can_be_taken_down_and_up_again(empty):
    up = [schema(empty)]
    for revision in REVISIONS:
        run(empty, command.upgrade, revision)
        up.append(schema(empty))
    down = [up[-1]]
    for _ in REVISIONS:
        run(empty, command.downgrade, "-1")
        down.append(schema(empty))
    for before, after in zip(up[1:], down[-2::-1], strict=True):
        assert after == before
    assert tables(empty) == {"alembic_version"}
    assert upgrade(empty).now == REVISIONS[-1]
    check(empty)
    assert schema(empty) == up[-1]


def test_what_is_stored_survives_an_upgrade_that_finds_nothing_to_do(furnished_url, new_app):
    first = new_app(furnished_url)
    before = contents(first)
    assert sum(map(len, before.values())) > 10
    assert contents(new_app(furnished_url)) == before


def _set_revision(database, revision):
    with database.writing() as session:
        session.execute(text("UPDATE alembic_version SET version_num = :r"), {"r": revision})


@pytest.mark.slow
def test_a_database_of_a_newer_version_is_refused_and_left_alone(furnished_url, new_app):
    app = new_app(furnished_url)
    database = app.state.context.database
    _set_revision(database, "ffffffffffff")
    before = (schema(database), contents(app))
    with pytest.raises(StorageTooNew) as refused:
        create_app(Settings(database_url=furnished_url))
    assert "ffffffffffff" in refused.value.detail
    assert REVISIONS[-1] in refused.value.detail
    assert (schema(database), contents(app)) == before
    with database.reading() as session:
        assert current_revision(session.connection()) == "ffffffffffff"
    _set_revision(database, REVISIONS[-1])


def test_a_sqlite_file_of_a_newer_version_is_not_even_written_to(sqlite_url):
    database = Database(sqlite_url)
    _set_revision(database, "ffffffffffff")
    database.close()
    path = Path(make_url(sqlite_url).database)
    before = path.read_bytes()
    with pytest.raises(StorageTooNew):
        create_app(Settings(database_url=sqlite_url))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.glob(f"{path.name}*")] == [path.name]


def test_a_password_is_not_shown_where_a_database_is_refused(postgresql_url):
    database = Database(postgresql_url)
    url = make_url(postgresql_url).set(password="hunter2")  # trust asks for none
    _set_revision(database, "ffffffffffff")
    with pytest.raises(StorageTooNew) as refused:
        create_app(Settings(database_url=url.render_as_string(hide_password=False)))
    assert "hunter2" not in refused.value.detail
    _set_revision(database, REVISIONS[-1])
    database.close()


@pytest.mark.slow
def test_an_upgrade_that_fails_in_the_middle_leaves_nothing(empty):
    """A table that stands in the way of one of the last: the first are not made either."""
    with empty.writing() as session:
        session.execute(text("CREATE TABLE error_map_component (x INTEGER)"))
    with pytest.raises(Exception, match="error_map_component"):
        upgrade(empty)
    assert tables(empty) == {"error_map_component"}
    with empty.writing() as session:
        session.execute(text("DROP TABLE error_map_component"))
    assert upgrade(empty).now == REVISIONS[-1]
    check(empty)


@pytest.mark.slow
def test_services_that_start_together_in_threads_all_succeed(empty_database_url):
    services, failures = [], []
    together = threading.Barrier(4, timeout=60)

    def start():
        together.wait()
        try:
            services.append(create_app(Settings(database_url=empty_database_url)))
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=start, daemon=True) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    for service in services:
        service.state.context.database.close()
    assert failures == []
    assert len(services) == 4
    database = Database(empty_database_url)
    check(database)
    database.close()


START_A_SERVICE = """
import sys
from app.main import create_app
print("ready", flush=True)
sys.stdin.readline()
create_app().state.context.database.close()
print("started", flush=True)
"""


@pytest.mark.slow
def test_services_that_start_together_in_processes_all_succeed(empty_database_url):
    environment = os.environ | {"THERMAP_DATABASE_URL": empty_database_url}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", START_A_SERVICE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=PACKAGE_FOLDER,
            env=environment | {"PYTHONPATH": str(PACKAGE_FOLDER)},
            text=True,
        )
        for _ in range(2)
    ]
    try:
        for process in processes:
            assert process.stdout.readline() == "ready\n"
        for process in processes:
            process.stdin.write("\n")
            process.stdin.flush()
        ends = [(*process.communicate(timeout=120), process.returncode) for process in processes]
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    for out, errors, status in ends:
        assert (out, status) == ("started\n", 0), errors
    database = Database(empty_database_url)
    assert tables(database) == TABLES | {"alembic_version"}
    check(database)
    database.close()


@pytest.mark.anyio
async def test_an_upgraded_database_serves(empty_database_url, new_app):
    async with client_of(new_app(empty_database_url)) as client:
        await furnish(client)
        assert len((await client.get("/v1/machines")).json()) == 1


@pytest.mark.slow
def test_alembics_own_command_line_finds_the_service_database(empty_database_url):
    """`alembic upgrade head`, as alembic.ini says for developers."""
    done = subprocess.run(
        [sys.executable, "-m", "alembic", "upgrade", "head"],
        cwd=PACKAGE_FOLDER,
        env=os.environ | {"THERMAP_DATABASE_URL": _with_driver(empty_database_url)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    database = Database(empty_database_url)
    assert upgrade(database).now == REVISIONS[-1]
    check(database)
    database.close()


def _with_driver(url):
    return url.replace("postgresql://", "postgresql+psycopg://")


def test_an_installed_package_finds_its_migrations_beside_the_code(tmp_path, monkeypatch):
    installed = tmp_path / "app"
    (installed / "migrations").mkdir(parents=True)
    monkeypatch.setattr(migrate_module.app, "__file__", str(installed / "__init__.py"))
    assert alembic_config().get_main_option("script_location") == str(installed / "migrations")


def test_a_folder_with_signs_of_alembics_own_is_found(tmp_path, monkeypatch):
    """Alembic reads % in options as the beginning of a placeholder."""
    installed = tmp_path / "100 % thermap" / "app"
    (installed / "migrations").mkdir(parents=True)
    monkeypatch.setattr(migrate_module.app, "__file__", str(installed / "__init__.py"))
    assert alembic_config().get_main_option("script_location") == str(installed / "migrations")


def test_sqlite_waits_for_another_that_is_upgrading(sqlite_url):
    one = Database(sqlite_url)
    entered, finished = threading.Event(), []

    def second():
        entered.wait()
        other = Database(sqlite_url)
        finished.append(upgrade(other).now)
        other.close()

    thread = threading.Thread(target=second)
    thread.start()
    with one.writing() as session:
        session.execute(text("UPDATE alembic_version SET version_num = version_num"))
        entered.set()
        thread.join(0.3)
        assert finished == []
    thread.join()
    one.close()
    assert finished == [REVISIONS[-1]]

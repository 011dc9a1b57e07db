"""Connections and transactions."""

import sqlite3
import sys
import threading
from contextlib import ExitStack, closing, suppress

import pytest
from sqlalchemy import text

from app.errors import InvalidContent, StorageBusy, StorageUnavailable
from app.geometry.chain import Chain
from app.storage.database import Database
from app.storage.limits import Limits
from app.storage.machines import RowLock, find_machine, insert_machine, list_machines
from app.thermal.machine import Machine
from tests.service_examples import START


@pytest.fixture
def database(database_url):
    database = Database(database_url)
    yield database
    database.close()


@pytest.fixture
def sqlite(sqlite_url):
    database = Database(sqlite_url)
    yield database
    database.close()


@pytest.fixture
def postgresql(postgresql_url):
    database = Database(postgresql_url)
    yield database
    database.close()


def machine(name):
    return Machine(name, name, Chain.parse("XYFZ"))


def names(database):
    with database.reading() as session:
        return [stored.machine.id for stored in list_machines(session)]


class Failed(Exception):
    """Something goes wrong in the middle."""


def test_what_is_written_is_there_afterwards(database):
    with database.writing() as session:
        insert_machine(session, machine("a"), START)
    assert names(database) == ["a"]


def test_a_transaction_that_fails_leaves_nothing(database):
    with suppress(Failed), database.writing() as session:
        insert_machine(session, machine("a"), START)
        session.flush()
        raise Failed
    assert names(database) == []


def test_what_is_not_committed_is_seen_by_nobody(database):
    with database.writing() as session:
        insert_machine(session, machine("a"), START)
        assert names(database) == []
    assert names(database) == ["a"]


def test_reading_commits_nothing(database):
    with database.reading() as session:
        insert_machine(session, machine("a"), START)
    assert names(database) == []


def test_every_connection_of_sqlite_keeps_what_was_answered(sqlite_url, monkeypatch):
    monkeypatch.setattr("tests.databases.WAITS_FOR_THE_DISK", True)
    sqlite = Database(sqlite_url)
    with ExitStack() as stack:
        stack.callback(sqlite.close)
        sessions = [stack.enter_context(sqlite.reading()) for _ in range(7)]
        for session in sessions:
            found = [
                session.execute(text(f"PRAGMA {name}")).scalar()
                for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
            ]
            assert found == ["wal", 2, 1, 10_000]  # 2 is FULL


def test_readers_of_sqlite_are_not_in_the_writers_way(sqlite):
    with sqlite.reading() as reader:
        assert list_machines(reader) == []
        with sqlite.writing() as writer:
            insert_machine(writer, machine("a"), START)
        assert list_machines(reader) == []  # one moment through the whole transaction


def test_a_writer_of_sqlite_waits_for_its_turn_and_gives_up_in_time(sqlite_url):
    """Here a writer of another process, which only the file's own lock keeps waiting."""
    database, other = Database(sqlite_url), Database(sqlite_url, Limits(lock_s=0.05))
    with database.writing() as first:
        assert list_machines(first) == []  # only reads, but means to write
        with pytest.raises(StorageUnavailable, match="locked"), other.writing() as second:
            list_machines(second)
    with other.writing() as session:
        insert_machine(session, machine("a"), START)
    assert names(database) == ["a"]
    database.close()
    other.close()


def test_those_who_open_a_new_sqlite_file_together_all_succeed(tmp_path):
    """SQLite refuses some of them at once to log ahead: one of thirteen, if nobody tries again."""

    def opened(database, together, failures):
        together.wait()
        try:
            with database.reading() as session:
                session.execute(text("SELECT 1"))
        except StorageUnavailable as error:
            failures.append(error)

    failures = []
    for number in range(40):
        together = threading.Barrier(4, timeout=60)
        databases = [Database(f"sqlite:///{tmp_path / f'{number}.db'}") for _ in range(4)]
        threads = [
            threading.Thread(target=opened, args=(database, together, failures))
            for database in databases
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        for database in databases:
            database.close()
    assert failures == []


def test_whoever_opens_a_sqlite_file_that_stays_locked_gives_up(tmp_path):
    file = tmp_path / "thermap.db"
    with closing(sqlite3.connect(file, isolation_level=None)) as other:
        other.execute("CREATE TABLE something (a)")
        other.execute("BEGIN EXCLUSIVE")
        database = Database(f"sqlite:///{file}", Limits(lock_s=0.2))
        with closing(database), pytest.raises(StorageBusy), database.reading() as session:
            session.execute(text("SELECT 1"))


def test_a_locked_machine_is_changed_by_one_at_a_time(database):
    """The second reads what the first has written, not what was there before."""
    with database.writing() as session:
        insert_machine(session, machine("a"), START)
    locked, done = threading.Event(), threading.Event()
    seen = []

    def second():
        locked.wait()
        with database.writing() as session:
            revision = find_machine(session, "a", RowLock.CHANGED).revision
            seen.append((done.is_set(), revision))

    thread = threading.Thread(target=second)
    thread.start()
    with database.writing() as session:
        row = find_machine(session, "a", RowLock.CHANGED)
        locked.set()
        thread.join(0.2)
        row.revision += 1
        session.flush()
        done.set()
    thread.join()
    assert seen == [(True, 2)]


def test_postgresql_gives_up_on_a_network_that_swallows_everything(postgresql):
    with postgresql.engine.connect() as connection:
        stated = connection.connection.driver_connection.info.get_parameters()
    assert stated["connect_timeout"] == "5"
    assert stated["tcp_user_timeout"] == "5000"
    assert stated["keepalives_idle"] == "5"


@pytest.mark.parametrize(
    "url",
    [
        "sqlite://",
        "sqlite:///:memory:",
        "mysql://root:hunter2@localhost/thermap",
        "oracle://x",
        "not a url",
        "",
    ],
)
def test_a_url_of_no_lasting_database_is_refused_without_its_password(url):
    with pytest.raises(InvalidContent) as refused:
        Database(url)
    assert "expected " in refused.value.detail
    assert "hunter2" not in refused.value.detail


@pytest.mark.parametrize("scheme", ["postgresql", "postgres", "postgresql+psycopg"])
def test_every_spelling_of_postgresql_is_understood_and_its_password_hidden(scheme):
    database = Database(f"{scheme}://user:hunter2@127.0.0.1:1/x")
    assert database.engine.dialect.driver == "psycopg"
    assert "hunter2" not in database.name
    assert "user" in database.name
    with pytest.raises(StorageUnavailable) as away, database.reading() as session:
        list_machines(session)
    assert "hunter2" not in away.value.detail
    database.close()


def test_without_its_driver_postgresql_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    monkeypatch.delitem(sys.modules, "app.storage.postgresql", raising=False)
    with pytest.raises(InvalidContent, match=r"pip install \"thermap\[postgresql\]\""):
        Database("postgresql://127.0.0.1/x")


def test_the_folder_of_a_sqlite_file_has_to_be_there(tmp_path):
    """A misspelt one would hold a new, empty database, and nobody would know."""
    said = r"^there is no folder .*/misspelt for the database thermap.db; make the folder"
    with pytest.raises(StorageUnavailable, match=said):
        Database(f"sqlite:///{tmp_path}/misspelt/thermap.db")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "b c % #").mkdir()
    database = Database(f"sqlite:///{tmp_path}/b c % #/thermap.db")
    with database.reading() as session:
        session.execute(text("SELECT 1"))
    database.close()
    assert (tmp_path / "b c % #" / "thermap.db").stat().st_size > 0


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageUnavailable, match="file"):
        Database(f"sqlite:///{tmp_path}/file/thermap.db")


def test_a_file_that_is_no_database_is_said(tmp_path):
    (tmp_path / "thermap.db").write_bytes(b"this is no database " * 100)
    database = Database(f"sqlite:///{tmp_path}/thermap.db")
    with pytest.raises(StorageUnavailable, match="not a database"), database.reading() as session:
        session.execute(text("SELECT 1"))
    database.close()
    assert (tmp_path / "thermap.db").read_bytes().startswith(b"this is no database")


@pytest.mark.parametrize("waits", [True, False])
def test_a_connection_at_work_is_closed_when_all_are_given_up(postgresql, waits):
    with postgresql.appending() as kept:
        kept.execute("SELECT 1")
    assert not kept.closed  # for the next one
    with suppress(StorageUnavailable), postgresql.appending() as one:
        assert one is kept
        if waits:
            postgresql.close()
    postgresql.close()
    assert one.closed

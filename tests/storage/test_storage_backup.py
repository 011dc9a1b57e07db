"""Backups: everything, of one moment, and back into either kind of database."""

import sqlite3
import threading
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from alembic import command
from alembic.script import ScriptDirectory
from sqlalchemy import make_url, select, text

from app.errors import Conflict, InvalidContent, StorageTooNew, StorageUnavailable
from app.storage import backup as module
from app.storage.backup import SEAL_BYTES, check_backup, restore_backup, write_backup
from app.storage.database import Database
from app.storage.migrate import alembic_config, upgrade
from app.storage.readings import insert_readings
from app.storage.tables import Base
from app.thermal.reading import Reading
from tests.databases import KINDS, reachable
from tests.service_examples import ROOM, START, client_of, error_map, reading

OLDEST = [s.revision for s in ScriptDirectory.from_config(alembic_config()).walk_revisions()][-1]
BATCH = 40


@pytest.fixture(params=KINDS)
def target_url(request, databases):
    """Where to restore: a database of each kind, without a table."""
    url = reachable(databases.empty, request.param)
    yield url
    databases.give_back(url)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "friday.thermap"


@pytest.fixture
def written(sqlite_example, file):
    """A backup of a SQLite file with the example machine."""
    write_backup(sqlite_example, file)
    return file


def everything(url):
    """All rows of all tables, as they can be compared."""
    database = Database(url)
    with database.snapshot() as connection:
        found = {
            table.name: [
                [v.tobytes() if isinstance(v, np.ndarray) else v for v in row]
                for row in connection.execute(select(table).order_by(*table.primary_key))
            ]
            for table in Base.metadata.sorted_tables
        }
    database.close()
    return found


def store_readings(url, first, number):
    database = Database(url)
    with database.writing() as session:
        times = [first + timedelta(seconds=s) for s in range(number)]
        insert_readings(session, {"mcfv5050": [Reading(t, {"spindle": 20.1}, {}) for t in times]})
    database.close()


@pytest.mark.slow
@pytest.mark.anyio
async def test_what_is_restored_is_what_was_there_and_new_numbers_go_on(
    furnished_url, target_url, file, new_app
):
    store_readings(furnished_url, START - timedelta(days=1), 3 * BATCH)
    database = Database(furnished_url)
    with database.writing() as session:  # their numbers must not be given again
        session.execute(text("DELETE FROM reading WHERE id > 100"))
    database.close()
    contents = write_backup(furnished_url, file)
    assert contents.counts["machines"] == 1
    assert contents.counts["maps"] == contents.counts["versions"] == 3
    assert contents.counts["readings"] == 100
    assert contents.size_bytes == file.stat().st_size
    before = everything(furnished_url)
    assert restore_backup(target_url, file).contents == contents
    assert everything(target_url) == before

    async with client_of(new_app(target_url)) as client:
        stored = await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
        assert stored.status_code == 201, stored.text
        assert (await client.post(f"{ROOM}/readings", json=reading(START, 25))).status_code == 201
        table = await client.get(f"{ROOM}/compensation")
        assert table.json()["model_version"] == 4
    assert everything(target_url)["reading"][-1][0] == 3 * BATCH + 1


def test_a_backup_of_a_running_database_is_of_one_moment(furnished_url, file):
    stop = threading.Event()
    stored = []

    def write():
        while not stop.is_set():
            store_readings(furnished_url, START + timedelta(hours=len(stored)), BATCH)
            stored.append(BATCH)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        contents = write_backup(furnished_url, file)
    finally:
        stop.set()
        writer.join()
    assert contents.counts["readings"] % BATCH == 0
    assert contents.counts["readings"] <= sum(stored)


def test_a_backup_is_a_sqlite_file_and_can_be_served(furnished_url, file):
    write_backup(furnished_url, file)
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("SELECT id FROM machine").fetchall() == [("mcfv5050",)]
    assert everything(f"sqlite:///{file}") == everything(furnished_url)


def test_a_backup_leaves_nothing_beside_it_and_replaces_nothing(furnished_url, file):
    write_backup(furnished_url, file)
    content = file.read_bytes()
    with pytest.raises(Conflict, match="is there already"):
        write_backup(furnished_url, file)
    assert file.read_bytes() == content
    assert list(file.parent.iterdir()) == [file]
    with pytest.raises(StorageUnavailable, match=r"cannot be written|no folder"):
        write_backup(furnished_url, file.parent / "nowhere" / "x")


def test_there_has_to_be_something_to_back_up(tmp_path, file, empty_database_url):
    with pytest.raises(StorageUnavailable, match="there is no database"):
        write_backup(f"sqlite:///{tmp_path}/misspelt.db", file)
    assert list(tmp_path.iterdir()) == []
    Database(empty_database_url).close()
    with pytest.raises(Conflict, match="nothing of thermap"):
        write_backup(empty_database_url, file)


@pytest.mark.parametrize("where", [20, 5000, -SEAL_BYTES - 1, -SEAL_BYTES, -1])
def test_a_changed_byte_is_noticed(written, tmp_path, where):
    content = bytearray(written.read_bytes())
    content[where] ^= 1
    written.write_bytes(content)
    with pytest.raises(InvalidContent, match=r"damaged|no backup"):
        restore_backup(f"sqlite:///{tmp_path}/new.db", written)
    assert not (tmp_path / "new.db").exists()


@pytest.mark.parametrize("bytes_left", [0, 10, 4096, -1])
def test_what_is_no_whole_backup_is_refused(written, tmp_path, bytes_left):
    written.write_bytes(written.read_bytes()[:bytes_left])
    with pytest.raises(InvalidContent, match="no backup, or not whole"):
        check_backup(written)


def test_a_database_or_nothing_is_no_backup(sqlite_example, tmp_path):
    with pytest.raises(InvalidContent, match="no backup"):
        check_backup(Path(make_url(sqlite_example).database))
    with pytest.raises(InvalidContent, match="cannot be read"):
        check_backup(tmp_path / "nothing")


def test_a_backup_of_a_newer_thermap_is_refused(sqlite_example, file, tmp_path, monkeypatch):
    write = module._copy_file

    def from_the_future(database, part):
        write(database, part)
        with closing(sqlite3.connect(part)) as connection:
            connection.execute("UPDATE alembic_version SET version_num = 'from-the-future'")
            connection.commit()

    monkeypatch.setattr(module, "_copy_file", from_the_future)
    write_backup(sqlite_example, file)
    with pytest.raises(StorageTooNew, match="from-the-future"):
        restore_backup(f"sqlite:///{tmp_path}/new.db", file)
    assert not (tmp_path / "new.db").exists()


@pytest.mark.slow
def test_an_older_backup_is_upgraded_and_stays_as_it_is(tmp_path, file, target_url):
    older = Database(f"sqlite:///{tmp_path}/older.db")
    with older.writing() as session:
        command.upgrade(alembic_config(session.connection()), OLDEST)
        session.execute(
            text(
                "INSERT INTO machine VALUES ('old', 'Old', 'XYFZ', '{}', '[]', 'clamp', 5.0, "
                "'average', NULL, 7, '2026-01-01 00:00:00')"
            )
        )
    older.close()
    write_backup(f"sqlite:///{tmp_path}/older.db", file)
    content = file.read_bytes()
    assert restore_backup(target_url, file).contents.counts["machines"] == 1
    assert file.read_bytes() == content
    assert [row[0] for row in everything(target_url)["machine"]] == ["old"]


def test_machines_that_are_there_go_only_when_that_is_said(written, furnished_url):
    store_readings(furnished_url, START, BATCH)
    before = everything(furnished_url)
    with pytest.raises(Conflict, match=r"has 1 machine: --replace"):
        restore_backup(furnished_url, written)
    assert everything(furnished_url) == before
    restore_backup(furnished_url, written, replace=True)
    assert everything(furnished_url)["reading"] == []


def test_a_restore_that_fails_leaves_everything_as_it_was(written, furnished_url, monkeypatch):
    def fail(*_arguments):
        raise ZeroDivisionError

    before = everything(furnished_url)
    monkeypatch.setattr(module, "_continue_numbers", fail)
    with pytest.raises(ZeroDivisionError):
        restore_backup(furnished_url, written, replace=True)
    assert everything(furnished_url) == before


def test_a_connection_that_was_just_closed_is_not_in_the_way(written, postgresql_url, monkeypatch):
    """PostgreSQL lists it a moment longer: a restore said that a service was running."""
    shown = iter((True, True, False))
    monkeypatch.setattr(Database, "_are_others_connected", lambda _: next(shown))
    restore_backup(postgresql_url, written)
    assert next(shown, None) is None


@pytest.mark.slow
def test_a_running_service_is_in_the_way(written, target_url, monkeypatch):
    monkeypatch.setattr("app.storage.database.LEAVES_WITHIN_S", 0.2)
    service = Database(target_url)
    upgrade(service)
    with pytest.raises(Conflict, match="a service is running"):
        restore_backup(target_url, written)
    service.close()
    restore_backup(target_url, written)

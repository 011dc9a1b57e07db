"""Which keys there are after a backup was restored: none that was revoked, without a word."""

import sqlite3
from contextlib import closing, contextmanager
from datetime import timedelta

import pytest
from sqlalchemy import func, select, update

from app.access.keys import Role
from app.events.event import EventKind
from app.main import create_app
from app.services.access_keys import (
    KeyRing,
    create_first_key,
    create_key,
    revoke_key,
    show_keys,
    show_unreadable_keys,
)
from app.services.context import Context
from app.services.machines import create_machine, delete_machine, show_machine
from app.settings import Settings
from app.storage.backup import restore_backup, write_backup
from app.storage.database import Database
from app.storage.events import list_events
from app.storage.restored_keys import RestoredKeys
from app.storage.tables import AccessKeyRow, BrowserSessionRow
from tests.databases import KINDS, reachable
from tests.service_examples import START


@pytest.fixture
def new_url(databases, furnished_url):
    """A database of the other kind without a table."""
    (kind,) = (kind for kind in KINDS if not furnished_url.startswith(kind))
    url = reachable(databases.empty, kind)
    yield url
    databases.give_back(url)


@pytest.fixture
def file(furnished_url, tmp_path):
    """A backup with three keys, of one of which a browser has a session."""
    file = tmp_path / "friday.thermap"
    with opened(furnished_url) as database:
        create_key(database, "boss", Role.ADMIN)
        create_key(database, "line-3", Role.VIEWER, ["mcfv5050"])
        guest = create_key(database, "guest", Role.VIEWER)
        assert KeyRing(lambda: Context(database)).open_browser(guest.secret) is not None
    write_backup(furnished_url, file)
    return file


@contextmanager
def opened(url):
    with closing(Database(url)) as database:
        yield database


def names(url):
    with opened(url) as database:
        return [key.name for key in show_keys(database)]


def sessions(url):
    with opened(url) as database, database.reading() as session:
        return session.scalar(select(func.count(BrowserSessionRow.digest)))


def test_a_database_that_never_had_a_key_takes_those_of_the_backup(file, new_url):
    keys = restore_backup(new_url, file).keys
    assert keys == RestoredKeys(restored=("boss", "line-3", "guest"))
    assert names(new_url) == ["boss", "guest", "line-3"]
    assert sessions(new_url) == 0
    with opened(new_url) as database, database.reading() as session:
        (event, *_) = list_events(session, None, kinds=[EventKind.KEY])
    assert event.text == "backup restored; keys restored: boss, line-3, guest"


def test_no_session_is_in_a_backup(file):
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("SELECT * FROM browser_session").fetchall() == []


def test_keys_that_were_revoked_since_do_not_come_back_unasked(file, furnished_url):
    with opened(furnished_url) as database:
        revoke_key(database, "guest")
        create_key(database, "later", Role.SENSOR)
    keys = restore_backup(furnished_url, file, replace=True).keys
    assert keys == RestoredKeys(remain=("boss", "later", "line-3"), left_out=("guest",))
    assert names(furnished_url) == ["boss", "later", "line-3"]
    assert sessions(furnished_url) == 0
    keys = restore_backup(furnished_url, file, replace=True, with_keys=True).keys
    assert (keys.restored, keys.left_out) == (("guest",), ())
    assert names(furnished_url) == ["boss", "guest", "later", "line-3"]


def test_a_database_whose_keys_were_all_revoked_gets_none_back_unasked(file, furnished_url):
    with opened(furnished_url) as database:
        for name in ("boss", "line-3", "guest"):
            revoke_key(database, name, last_admin=True)
    keys = restore_backup(furnished_url, file, replace=True).keys
    assert keys.left_out == ("boss", "line-3", "guest")
    assert names(furnished_url) == []


def test_a_key_made_anew_under_a_name_stays_and_the_older_one_does_not_come_back(
    file, furnished_url
):
    with opened(furnished_url) as database:
        revoke_key(database, "guest")
        number = create_key(database, "guest", Role.SENSOR).key.id
    keys = restore_backup(furnished_url, file, replace=True, with_keys=True).keys
    assert keys.left_out == ("guest",)
    with opened(furnished_url) as database:
        (guest,) = (key for key in show_keys(database) if key.name == "guest")
        assert (guest.role, guest.id) == (Role.SENSOR, number)
        assert create_key(database, "next", Role.VIEWER).key.id > number


def test_a_key_for_a_machine_that_the_backup_does_not_have_goes(file, furnished_url):
    """A machine made anew under the id is not the one that is restored."""
    with opened(furnished_url) as database:
        context = Context(database, now=lambda: START + timedelta(days=1))
        machine = show_machine(context, "mcfv5050").machine
        delete_machine(context, "mcfv5050")
        create_machine(context, machine)
        create_key(database, "new", Role.METROLOGIST, ["mcfv5050"])
    keys = restore_backup(furnished_url, file, replace=True).keys
    assert (keys.revoked, keys.left_out) == (("new",), ("line-3",))
    assert names(furnished_url) == ["boss", "guest"]


@pytest.mark.parametrize("values", [{"role": "owner"}, {"machines": {"mcfv5050": 1}}])
def test_a_key_that_is_none_here_is_left_out_and_the_service_starts(
    furnished_url, new_url, tmp_path, values
):
    file = tmp_path / "newer.thermap"
    with opened(furnished_url) as database:
        create_key(database, "boss", Role.VIEWER)
        with database.writing() as session:
            session.execute(update(AccessKeyRow).values(**values))
        assert show_keys(database) == []
        assert show_unreadable_keys(database) == ["boss"]
        assert create_first_key(database) is None
    write_backup(furnished_url, file)
    assert restore_backup(new_url, file).keys == RestoredKeys(unreadable=("boss",))
    for url in (furnished_url, new_url):
        service = create_app(Settings(database_url=url, require_keys=True))
        try:
            service.state.access.ring.refresh()
            assert service.state.access.ring.is_known
        finally:
            service.state.runner.stop()
            service.state.context.database.close()
    with opened(furnished_url) as database:
        revoke_key(database, "boss")
        assert show_unreadable_keys(database) == []

"""thermap backup and thermap restore."""

import pytest

from app.storage.database import Database
from app.storage.machines import list_machines
from tests.service_examples import furnish_database

CONTENTS = "1 machine, 3 maps, 3 versions, 0 readings, 0 verifications, 0 analyses; 0."


@pytest.fixture
def url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


def test_there_and_back(run, url, tmp_path):
    file, new = tmp_path / "friday.thermap", f"sqlite:///{tmp_path}/new.db"
    found = run("backup", file, "--database-url", url)
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.startswith(f"backup {file}: {CONTENTS}")
    found = run("restore", file, THERMAP_DATABASE_URL=new)
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.startswith(f"restored {file}: {CONTENTS}")
    database = Database(new)
    with database.reading() as session:
        assert [m.machine.id for m in list_machines(session)] == ["mcfv5050"]
    database.close()


def test_nothing_is_replaced_unless_that_is_said_twice(run, url, tmp_path):
    file = tmp_path / "friday.thermap"
    run("backup", file, "--database-url", url)
    for arguments, words in (
        (("backup",), f"{file} is there already"),
        (("restore",), "has 1 machine: --replace deletes"),
        (("restore", "--replace"), "nothing was restored or deleted: there is no terminal"),
    ):
        found = run(*arguments, file, "--database-url", url, columns=200)
        assert found.exit_code == 1
        assert words in found.stderr
        assert "Traceback" not in found.stderr
    found = run("restore", file, "--database-url", url, "--replace", "--yes")
    assert (found.exit_code, found.stderr) == (0, "")


def test_a_file_that_is_no_backup(run, tmp_path):
    letter = tmp_path / "letter.txt"
    letter.write_text("Dear Sir or Madam")
    found = run("restore", letter, "--database-url", f"sqlite:///{tmp_path}/new.db")
    assert found.exit_code == 1
    assert "is no backup, or not whole" in found.stderr
    assert not (tmp_path / "new.db").exists()


def test_a_user_without_a_folder_states_where_the_database_is(run, url, tmp_path, monkeypatch):
    """As in a container, whose user has no home."""

    def no_home(_name):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.setattr("app.settings.user_data_path", no_home)
    file = tmp_path / "friday.thermap"
    found = run("backup", file)
    assert found.exit_code == 1
    assert "THERMAP_DATABASE_URL" in found.stderr
    assert "Traceback" not in found.stderr
    assert run("backup", file, "--database-url", url).exit_code == 0
    new = f"sqlite:///{tmp_path}/new.db"
    assert run("restore", file, "--database-url", new).exit_code == 0


def test_which_keys_come_back_is_said(run, url, tmp_path):
    file, new = tmp_path / "friday.thermap", f"sqlite:///{tmp_path}/new.db"
    for name in ("boss", "guest"):
        run("keys", "create", name, "--role", "admin", "--database-url", url)
    run("backup", file, "--database-url", url)
    found = run("restore", file, "--database-url", new)
    assert "keys that came back with the backup: boss, guest" in found.stdout
    run("keys", "revoke", "guest", "--yes", "--database-url", url)
    restored = ("restore", file, "--database-url", url, "--replace", "--yes")
    found = run(*restored)
    assert (found.exit_code, found.stderr) == (0, "")
    assert "keys that stay as they are in the database: boss" in found.stdout
    assert "revoked since, or made elsewhere" in found.stdout
    assert found.stdout.rstrip().endswith("another key's): guest")
    found = run(*restored, "--with-keys")
    assert "keys that came back with the backup: guest" in found.stdout

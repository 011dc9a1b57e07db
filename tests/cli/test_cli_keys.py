"""thermap keys, and a service that other computers reach."""

import json

import pytest

from app.events.event import EventKind
from app.storage.database import Database
from app.storage.events import list_events
from tests.service_examples import furnish_database


@pytest.fixture
def url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


def test_a_key_is_made_listed_and_revoked(run, url):
    made = run(
        *("keys", "create", "line-3", "--role", "sensor", "--machine", "mcfv5050"),
        *("--database-url", url),
    )
    assert made.exit_code == 0, made.stderr
    secret = made.stdout.strip()
    assert secret.startswith("thermap_")
    assert len(secret) > 40
    assert "key line-3, sensor, for mcfv5050" in made.stderr
    listed = run("keys", "list", "--database-url", url, columns=200)
    assert "line-3" in listed.stdout
    assert "never" in listed.stdout
    assert secret not in listed.stdout
    (key,) = json.loads(run("keys", "list", "--json", "--database-url", url).stdout)
    assert (key["name"], key["role"], key["machines"]) == ("line-3", "sensor", ["mcfv5050"])
    assert run("keys", "revoke", "line-3", "--yes", "--database-url", url).exit_code == 0
    assert json.loads(run("keys", "list", "--json", "--database-url", url).stdout) == []


def test_who_revokes_the_last_key_of_an_admin_is_told(run, url):
    run("keys", "create", "boss", "--role", "admin", "--database-url", url)
    asked = run("keys", "revoke", "boss", "--database-url", url, columns=200)
    assert asked.exit_code == 1
    assert "the last one of an admin" in asked.stderr
    done = run("keys", "revoke", "boss", "--yes", "--database-url", url, columns=200)
    assert done.exit_code == 0
    assert "no key of an admin is left" in done.stderr
    database = Database(url)
    with database.reading() as session:
        revoked, made = list_events(session, None, kinds=[EventKind.KEY], limit=2)
    database.close()
    assert (made.who, revoked.who) == ("thermap keys", "thermap keys")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("create", "line-3", "--role", "viewer"), "there is a key 'line-3' already"),
        (("create", "a b", "--role", "viewer"), "expected 1 to 64 letters"),
        (("create", "b", "--role", "viewer", "-m", "vmc"), "expected one of mcfv5050, got 'vmc'"),
        (("create", "b", "--role", "admin", "-m", "mcfv5050"), "expected none for the role admin"),
        (("revoke", "line-4", "--yes"), "there is no key 'line-4'; there are: line-3"),
        (("revoke", "line-4"), "there is no key 'line-4'; there are: line-3"),
        (("revoke", "line-3"), "key 'line-3' was not revoked"),
    ],
)
def test_what_cannot_be_is_said_and_changes_nothing(run, url, arguments, words):
    run("keys", "create", "line-3", "--role", "viewer", "--database-url", url)
    found = run("keys", *arguments, "--database-url", url, columns=200)
    assert found.exit_code == 1
    assert words in found.stderr
    (key,) = json.loads(run("keys", "list", "--json", "--database-url", url).stdout)
    assert key["name"] == "line-3"


def test_a_role_that_there_is_none_of_is_told_with_those_that_there_are(run, url):
    found = run("keys", "create", "x", "--role", "boss", "--database-url", url, columns=200)
    assert found.exit_code == 2
    said = " ".join(found.stderr.split())
    assert "expected one of 'sensor', 'viewer', 'metrologist', 'admin', got 'boss'" in said


def test_the_demo_is_not_opened_to_others_unasked(run, tmp_path):
    found = run(
        *("demo", "--host", "0.0.0.0", "--port", "0"),
        *("--database-url", f"sqlite:///{tmp_path}/demo.db"),
        columns=200,
    )
    assert found.exit_code == 2
    assert "--insecure" in found.stderr
    assert not (tmp_path / "demo.db").exists()

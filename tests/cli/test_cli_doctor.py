"""thermap doctor: one sentence for each thing, on a database alone and on a service."""

import json
import os
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from alembic import command
from sqlalchemy import make_url, text

from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.services import doctor
from app.services.doctor import Grade, examine_clock, examine_database
from app.settings import Settings
from app.storage.backup import write_backup
from app.storage.database import Database
from app.storage.migrate import alembic_config
from tests.service_examples import MACHINE, furnish_database, temperatures


def examined(run, *arguments, **options):
    """Run it; give its exit code, its verdict, and the findings by what they are about."""
    found = run("doctor", *arguments, "--json", **options)
    assert found.stderr == ""
    document = json.loads(found.stdout)
    assert found.exit_code == (1 if document["verdict"] == "trouble" else 0)
    about = {one["about"]: (one["grade"], one["sentence"]) for one in document["findings"]}
    return document["verdict"], about


def test_a_database_on_which_no_service_runs(run, furnished_url):
    verdict, about = examined(run, "--database-url", furnished_url)
    assert verdict == "warning"
    assert about["database"][0] == "ok"
    assert about["migrations"][0] == "ok"
    assert about["keys"][0] == "ok"
    assert about["analyses"] == ("ok", "0 analyses running, 0 analyses waiting.")
    assert about["machine mcfv5050"] == (
        "warning",
        "No reading has come yet: there is no compensation table.",
    )
    assert ("clock of the database" in about) == furnished_url.startswith("postgresql")
    assert ("free on the disk" in about["disk"][1]) == furnished_url.startswith("sqlite")
    assert "service" not in about


def test_it_changes_nothing(run, sqlite_url):
    file = Path(make_url(sqlite_url).database)
    with closing(sqlite3.connect(file)) as connection:
        before = list(connection.iterdump())
    examined(run, "--database-url", sqlite_url)
    with closing(sqlite3.connect(file)) as connection:
        assert list(connection.iterdump()) == before


def test_a_name_that_is_misspelt_makes_no_database(run, tmp_path):
    verdict, about = examined(run, "--database-url", f"sqlite:///{tmp_path}/shpo.db")
    assert verdict == "trouble"
    assert about["database"] == ("trouble", f"There is no database {tmp_path}/shpo.db.")
    assert list(tmp_path.iterdir()) == []


def test_a_database_of_another_kind_is_none_of_thermap(run, empty_database_url):
    if empty_database_url.startswith("sqlite"):
        Path(make_url(empty_database_url).database).touch()
    verdict, about = examined(run, "--database-url", empty_database_url)
    assert verdict == "trouble"
    assert "holds nothing of thermap" in about["database"][1]


@pytest.mark.parametrize(
    ("revision", "grade", "about", "words"),
    [
        ("ffffffffffff", "trouble", "database", "newer thermap"),
        ("older", "warning", "migrations", "`thermap serve` upgrades it when it starts"),
    ],
)
def test_a_database_of_another_version(run, sqlite_url, revision, grade, about, words):
    database = Database(sqlite_url)
    with database.writing() as session:
        if revision == "older":
            command.downgrade(alembic_config(session.connection()), "-1")
        else:
            session.execute(text("UPDATE alembic_version SET version_num = :r"), {"r": revision})
    database.close()
    verdict, found = examined(run, "--database-url", sqlite_url)
    assert verdict == grade
    assert found[about][0] == grade
    assert words in found[about][1]


def test_damage_in_a_file_is_found(run, databases):
    url = databases.prepared("sqlite", furnish_database)
    with closing(sqlite3.connect(make_url(url).database, isolation_level=None)) as connection:
        connection.execute("PRAGMA foreign_keys = OFF")
        connection.execute("UPDATE error_map SET machine_id = 'gone'")
    verdict, about = examined(run, "--database-url", url)
    databases.give_back(url)
    assert verdict == "trouble"
    assert "is damaged" in about["database"][1]
    assert "error_map" in about["database"][1]


def test_a_disk_that_is_nearly_full(run, sqlite_url, monkeypatch):
    for free, grade in ((50e6, "trouble"), (500e6, "warning"), (50e9, "ok")):
        usage = type("Usage", (), {"free": int(free)})
        monkeypatch.setattr("app.storage.condition.shutil.disk_usage", lambda _, u=usage: u)
        assert examined(run, "--database-url", sqlite_url)[1]["disk"][0] == grade


def test_a_service_whose_disk_is_nearly_full(run, service_url, monkeypatch):
    for free, grade in ((0.0, "trouble"), (500e6, "warning"), (50e9, "ok")):
        usage = type("Usage", (), {"free": int(free)})
        monkeypatch.setattr("app.storage.condition.shutil.disk_usage", lambda _, u=usage: u)
        about = examined(run, "--url", service_url)[1]
        assert about["disk of the service"][0] == grade
        assert f"{free / 1e6:,.0f} MB are free" in about["disk of the service"][1]


@pytest.mark.slow
def test_an_analysis_that_nobody_works_on_and_one_that_waits_too_long(
    run, furnished_url, monkeypatch
):
    monkeypatch.setattr(doctor, "sleep", lambda _seconds: None)
    database = Database(furnished_url)
    row = (
        "INSERT INTO analysis (machine_id, model_version, verification_ids, holdout_fraction, "
        "seed, status, progress, message, created_at, beats) VALUES "
        "('mcfv5050', 1, '[]', 0.3, 1, :status, 0, '', :made, 4)"
    )
    made = {"made": datetime.now(UTC) - timedelta(hours=3)}
    with database.writing() as session:
        session.execute(text(row), {"status": "queued"} | made)
    about = examined(run, "--database-url", furnished_url)[1]
    assert about["analyses"] == (
        "warning",
        "1 analysis waiting, the oldest for 3 hours: does a service run?",
    )
    with database.writing() as session:
        session.execute(text(row), {"status": "running"} | made)
    about = examined(run, "--database-url", furnished_url)[1]
    assert about["analyses"][0] == "trouble"
    assert about["analyses"][1] == (
        "Analysis 2 is running, but nobody works on it: in 24 s there was no sign of life, and no "
        "service took it up again; one that starts does."
    )
    beats = iter(range(5, 100))

    def work(_seconds):
        with database.writing() as session:
            statement = text("UPDATE analysis SET beats = :n WHERE status = 'running'")
            session.execute(statement, {"n": next(beats)})

    monkeypatch.setattr(doctor, "sleep", work)
    about = examined(run, "--database-url", furnished_url)[1]
    assert about["analyses"] == (
        "warning",
        "1 analysis running, 1 analysis waiting, the oldest for 3 hours.",
    )
    looks = iter(range(100))

    def take_up(_seconds):
        """Be a service that has just been restarted: it waits before it takes up what was left."""
        if next(looks) == 5:
            with database.writing() as session:
                session.execute(text("UPDATE analysis SET status = 'queued', owner = NULL"))

    monkeypatch.setattr(doctor, "sleep", take_up)
    about = examined(run, "--database-url", furnished_url)[1]
    assert about["analyses"][1].startswith("2 analyses waiting, the oldest for 3 hours")
    database.close()


@pytest.mark.parametrize(
    ("ahead_s", "unsure_s", "grade"),
    [
        *((0.4, 0.0, Grade.OK), (-1.9, 0.0, Grade.OK), (2.5, 0.0, Grade.WARNING)),
        *((2.5, 1.0, Grade.OK), (-30.0, 1.0, Grade.WARNING), (-3600.0, 1.0, Grade.TROUBLE)),
    ],
)
def test_clocks(ahead_s, unsure_s, grade):
    found = examine_clock("clock", "Its", timedelta(seconds=ahead_s), timedelta(seconds=unsure_s))
    assert found.grade is grade
    assert ("ahead of" if ahead_s > 0 else "behind") in found.sentence


def test_a_servers_clock_that_is_off(postgresql_url, monkeypatch):
    def now():
        return datetime.now(UTC) - timedelta(minutes=10)

    monkeypatch.setattr(doctor, "utc_now", now)
    (clock,) = (one for one in examine_database(postgresql_url) if one.about.startswith("clock"))
    assert clock.grade is Grade.TROUBLE
    assert "600." in clock.sentence


def test_backups(run, sqlite_url, tmp_path):
    def found():
        return examined(run, "--database-url", sqlite_url, "--backups", tmp_path)[1]["backups"]

    assert found() == ("trouble", f"There is no backup in {tmp_path}.")
    (tmp_path / "letter.txt").write_text("Dear Sir or Madam")
    assert found()[0] == "trouble"
    file = tmp_path / "friday.thermap"
    write_backup(sqlite_url, file)
    assert found()[0] == "ok"
    long_ago = (datetime.now(UTC) - timedelta(days=30)).timestamp()
    os.utime(file, (long_ago, long_ago))
    assert found() == (
        "warning",
        f"The newest backup, {file}, is whole and 30 days old: what came since is in no backup.",
    )
    content = bytearray(file.read_bytes())
    content[5000] ^= 1
    file.write_bytes(content)
    assert found()[0] == "trouble"
    assert "is damaged" in found()[1]


def test_a_config_is_read_as_the_service_would(run, sqlite_url, tmp_path):
    file = tmp_path / "thermap.toml"
    for words, grade in (("[intake]\ncollect_s = 2.0\n", "ok"), ("[intak]\n", "trouble")):
        file.write_text(words)
        about = examined(run, "--database-url", sqlite_url, "--config", file)[1]
        assert about["config"][0] == grade
    assert "intak" in about["config"][1]


def test_a_service(run, service_url, client):
    verdict, about = examined(run, "--url", service_url)
    assert "database" not in about
    assert about["service"][0] == "ok"
    assert about["clock of the service"][0] == "ok"
    assert about["readiness"] == (
        "ok",
        "The service is ready: 1 of 1 machines are in memory, its database answers.",
    )
    assert about["machine mcfv5050"] == (
        "warning",
        "No reading has come yet: there is no compensation table.",
    )
    now = datetime.now(UTC).isoformat()
    client.store_readings("mcfv5050", [{"time": now, "temperatures_c": temperatures(24.0)}])
    verdict, about = examined(run, "--url", service_url)
    assert about["machines"] == ("ok", "1 of 1 machine can be trusted now."), about
    assert verdict == "ok", about


def test_a_service_that_does_not_run(run, no_service_url, sqlite_url):
    verdict, about = examined(run, "--url", no_service_url)
    assert verdict == "trouble"
    assert no_service_url in about["service"][1]
    _, about = examined(run, THERMAP_URL=no_service_url, THERMAP_DATABASE_URL=sqlite_url)
    assert about["service"][0] == "ok"
    assert about["database"][0] == "ok"


def test_whoever_needs_no_key_from_elsewhere_is_said(run, databases):
    database_url = databases.prepared("sqlite", furnish_database)
    for options, grade in (({"insecure": True}, "trouble"), ({}, "ok")):
        settings = Settings(database_url=database_url, host="0.0.0.0", **options)
        service = create_app(settings)
        with listening("0.0.0.0", 0, "serve") as opened, serving(service, opened, "error"):
            about = examined(run, "--url", url_of(opened))[1]
        if "keys asked for" not in about:
            pytest.skip("this computer has no address but its own")
        assert about["keys asked for"][0] == grade, about
    assert about["service"][0] == "warning"  # no key was stated
    databases.give_back(database_url)


def test_every_sensor_that_fails_is_told_by_its_machine(run, service_url, client):
    now = datetime.now(UTC).isoformat()
    came = temperatures(24.0)
    del came["z-column"]
    client.store_readings(MACHINE["id"], [{"time": now, "temperatures_c": came}])
    verdict, about = examined(run, "--url", service_url)
    assert verdict == "trouble"
    assert "z-column" in about["machine mcfv5050"][1]


def test_for_people_it_is_a_table(run, sqlite_url):
    found = run("doctor", "--database-url", sqlite_url, columns=200)
    assert found.exit_code == 0
    assert "ok" in found.stdout
    assert "No machine is stored yet." in found.stdout

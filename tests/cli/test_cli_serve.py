"""thermap serve, and what all commands share: versions, help, one sentence for a failure."""

import json
import signal
import socket
import sqlite3
import subprocess
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from types import SimpleNamespace

import httpx
import pytest
from sqlalchemy import make_url

from app import __version__
from app.api.turns import AT_WORK
from app.cli.application import COMMANDS as ALL_COMMANDS
from app.cli.application import load
from app.cli.listening import CannotListen, listening, url_of
from app.cli.options import by_name, named
from app.decimal_text import read_number
from app.storage.database import Database
from app.storage.readings import list_readings
from tests.cli.conftest import ENVIRONMENT, ended, wait_until_it_answers
from tests.databases import KINDS, locked, reachable
from tests.service_examples import ROOM, START, furnish_database, reading
from tests.services.tcp_proxy import TcpProxy

SOON_S = 60.0
"""A machine may be slow, but nothing hangs."""

COMMANDS = (
    *("serve", "demo", "import", "compensate", "accuracy", "picture", "replay"),
    *("simulate step-diagonal", "simulate verification"),
    *("machines list", "machines show", "machines set", "machines delete"),
    *("maps list", "maps show", "maps delete"),
    *("models list", "models show", "models activate", "models compare"),
    *("sensors show", "sensors assign", "sensors correlate", "readings list"),
    *("verifications store", "verifications list"),
    *("verifications residuals", "verifications delete"),
    *("analyses list", "analyses show", "analyses cancel", "analyses delete"),
    *("backup", "restore"),
)


@pytest.mark.slow
def test_it_says_where_it_listens_answers_and_ends_with_0(start, free_port, tmp_path):
    file = tmp_path / "shop.db"
    url = f"http://127.0.0.1:{free_port}"
    for number, is_new in ((signal.SIGTERM, True), (signal.SIGINT, False)):
        process = start("serve", "--port", free_port, "--database-url", f"sqlite:///{file}")
        assert wait_until_it_answers(url) == {"status": "ok", "version": __version__}
        code, out, err = ended(process, number)
        assert (code, err) == (0, "")
        assert f"listens on {url}\n" in out
        assert f"dashboard         {url}/\n" in out
        assert f"{url}/docs" in out
        assert f"{file}{' (a new database, made just now)' * is_new}\n" in out


def test_a_folder_that_is_not_there_is_refused(run, tmp_path):
    found = run("serve", "--port", "0", "--database-url", f"sqlite:///{tmp_path}/typo/x.db")
    assert (found.exit_code, found.stdout) == (1, "")
    said = f"thermap: there is no folder {tmp_path}/typo for the database"
    assert found.stderr.startswith(said)
    assert "--database-url sqlite:///FILE" in found.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_it_ends_in_time_though_the_database_hangs(start, free_port, databases):
    """Its requests wait for PostgreSQL, which takes what is sent and answers nothing."""
    direct = reachable(lambda kind: databases.prepared(kind, furnish_database), "postgresql")
    parsed = make_url(direct)
    wire = TcpProxy(parsed.host, parsed.port or 5432)
    through = parsed.set(host="127.0.0.1", port=wire.port).render_as_string(hide_password=False)
    process = start(
        *("serve", "--port", free_port, "--database-url", through),
        *("--statement-limit-s", "3600"),
    )
    url = f"http://127.0.0.1:{free_port}"
    wait_until_it_answers(url)
    with httpx.Client(base_url=url, trust_env=False, timeout=60) as client:
        stored = client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        assert stored.status_code == 201
    wire.freeze()
    waiting = [threading.Thread(target=given_up, args=(f"{url}/v1/machines",)) for _ in range(30)]
    for thread in waiting:
        thread.start()
    time.sleep(2.0)
    code, _, err = ended(process)
    assert code == 0, err
    for thread in waiting:
        thread.join()
    wire.cut()
    database = Database(direct)
    with database.reading() as session:
        assert [r.time for r in list_readings(session, "mcfv5050")] == [START]
    database.close()
    databases.give_back(direct)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_whoever_waits_when_it_ends_is_told(start, free_port, databases, kind, monkeypatch):
    """Twenty are at work in a database that others hold, the rest wait for their turn."""
    for limit in ("LOCK_LIMIT", "STATEMENT_LIMIT", "WAITING_LIMIT", "PATIENCE"):
        monkeypatch.setitem(ENVIRONMENT, f"THERMAP_{limit}_S", "300")
    url = reachable(lambda kind: databases.prepared(kind, furnish_database), kind)
    process = start(
        *("serve", "--port", free_port, "--database-url", url),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until_it_answers(f"http://127.0.0.1:{free_port}")
    body = json.dumps(reading(START, 25.5)).encode()
    asked = (
        b"POST %s/readings HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        b"Content-Length: %d\r\n\r\n%s" % (ROOM.encode(), len(body), body)
    )
    half = asked[: -len(body) // 2]
    with ExitStack() as opened:
        opened.enter_context(locked(url, "IMMEDIATE"))
        address = ("127.0.0.1", free_port)
        clients = [
            opened.enter_context(socket.create_connection(address, timeout=SOON_S))
            for _ in range(AT_WORK + 30)
        ]
        for client in clients[:-1]:
            client.sendall(asked)
        clients[-1].sendall(half)
        for _ in range(3):  # who asked before has been read by then
            wait_until_it_answers(f"http://127.0.0.1:{free_port}")
        code, _, err = ended(process)
        answers = [everything_of(client) for client in clients]
    assert code == 0, err
    said = Counter()
    for head, content in answers:
        assert head[0] == "HTTP/1.1 503 Service Unavailable"
        assert "connection: close" in head
        assert "retry-after: 5" in head
        said[json.loads(content)["detail"].partition(":")[0]] += 1
    waited, at_work = "the service ends", "the service ends before the answer is there"
    assert said == {waited: 29, at_work: AT_WORK + 1}
    databases.give_back(url)


def everything_of(client):
    """Read until the connection is closed; return the lines of the head, and the content."""
    came = b""
    while piece := client.recv(65536):
        came += piece
    head, _, content = came.decode().partition("\r\n\r\n")
    return [line if i == 0 else line.lower() for i, line in enumerate(head.splitlines())], content


def given_up(url):
    with suppress(httpx.TransportError):
        httpx.get(url, trust_env=False, timeout=120)


def test_a_port_in_use(run, tmp_path):
    with listening("127.0.0.1", 0, "serve") as opened:
        port = opened.getsockname()[1]
        found = run("serve", "--port", port, "--database-url", f"sqlite:///{tmp_path}/x.db")
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr == (
        f"thermap: port {port} on 127.0.0.1 is in use: try `thermap serve --port {port + 1}`\n"
    )
    assert not list(tmp_path.iterdir()), "the database was touched before the port was free"


def test_a_newer_database_is_refused(run, sqlite_url):
    connection = sqlite3.connect(make_url(sqlite_url).database)
    connection.execute("UPDATE alembic_version SET version_num = 'from-the-future'")
    connection.commit()
    connection.close()
    found = run("serve", "--port", "0", "--database-url", sqlite_url)
    assert (found.exit_code, found.stdout) == (1, "")
    assert "was written by a newer thermap" in found.stderr
    assert found.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("database_url", "code", "words"),
    [
        ("postgresql://u@127.0.0.1:1/x", 1, "the database is away"),
        ("sqlite:////proc/nowhere/x.db", 1, "there is no folder /proc/nowhere"),
        ("mysql://host/x", 2, "expected sqlite:///FILE"),
        ("no-url", 2, "expected sqlite:///FILE"),
    ],
)
def test_databases_that_are_not_there(run, database_url, code, words):
    found = run("serve", "--port", "0", "--database-url", database_url, columns=200)
    assert (found.exit_code, found.stdout) == (code, "")
    assert words in found.stderr
    assert "Traceback" not in found.stderr


def test_a_file_that_is_no_database(run, tmp_path):
    file = tmp_path / "letter.db"
    file.write_text("Dear Sir or Madam, " * 100)
    found = run("serve", "--port", "0", "--database-url", f"sqlite:///{file}")
    assert found.exit_code == 1
    assert found.stderr == "thermap: the database cannot be read: file is not a database\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("serve", "--port", "70000"),
        ("serve", "--log-level", "loud"),
        ("serve", "--refresh-s", "0"),
        ("compensate",),
        ("compensate", "m", "--temperature", "warm"),
        ("compensate", "m", "-t", "a=1", "-t", "a=2"),
        ("compensate", "m", "--state", "spindle_rpm=1"),
        ("compensate", "m", "--url", "shop"),
        ("import", "x.csv", "y.csv", "--label", "Run #1"),
        ("replay", "m", "x.csv", "--speed", "-1"),
        ("dance",),
    ],
)
def test_wrong_usage_has_exit_code_2(run, arguments):
    found = run(*arguments)
    assert found.exit_code == 2, found.output
    assert found.stdout == ""
    assert "Traceback" not in found.stderr


def test_options_come_from_the_environment(run):
    found = run("serve", THERMAP_PORT="70000")
    assert found.exit_code == 2
    assert "'--port'" in found.stderr
    found = run("compensate", "m", "-t", "a=1", THERMAP_URL="nowhere")
    assert found.exit_code == 2
    assert "nowhere" in found.stderr


@pytest.mark.parametrize("command", ALL_COMMANDS)
def test_every_option_can_be_set_in_the_environment(command):
    todo = [load(command)]
    while todo:
        some = todo.pop()
        todo += getattr(some, "commands", {}).values()
        unset = [o.opts for o in some.params if o.param_type_name == "option" and not o.envvar]
        assert [opts for opts in unset if "--help" not in opts] == []


@pytest.mark.parametrize("host", ["no-such-host.invalid", "203.0.113.7"])
def test_addresses_that_are_not_this_computers(host):
    with pytest.raises(CannotListen, match="cannot listen on"), listening(host, 0, "serve"):
        pass


@pytest.mark.parametrize(
    ("name", "url"),
    [
        (("127.0.0.1", 80), "http://127.0.0.1:80"),
        (("0.0.0.0", 80), "http://127.0.0.1:80"),
        (("::1", 80, 0, 0), "http://[::1]:80"),
        (("::", 80, 0, 0), "http://[::1]:80"),
    ],
)
def test_the_url_is_one_that_this_computer_reaches(name, url):
    assert url_of(SimpleNamespace(getsockname=lambda: name)) == url


def test_version(run):
    found = run("--version")
    assert (found.exit_code, found.stdout) == (0, f"thermap {__version__}\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_and_the_environment(run, command):
    found = run(*command.split(), "--help")
    assert found.exit_code == 0
    assert f"Example: thermap {command}" in found.stdout
    assert "THERMAP_" in found.stdout
    assert max(map(len, found.stdout.splitlines())) <= 80


@pytest.mark.parametrize("command", ["compensate", "replay", "import"])
def test_nobody_listens(run, no_service_url, tmp_path, command):
    file = tmp_path / "machine.json"
    file.write_text('{"id": "m", "name": "M", "configuration": "XYFZ"}')
    arguments = {"compensate": ["m"], "replay": ["m", file], "import": [file]}[command]
    found = run(command, *arguments, "--url", no_service_url)
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr == (
        f"thermap: no thermap at {no_service_url}: is `thermap serve` running there?\n"
    )


def test_named_numbers_take_decimal_commas():
    read = named("NAME=NUMBER", read_number)
    stated = by_name({"temperature": [read("x-middle=24,1"), read("bed left = -3.5")]})
    assert stated == {"temperature": {"x-middle": 24.1, "bed left": -3.5}}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--keep-readings", "3"), "expected at least 31 days, got '3'"),
        (("--keep-readings", "a year"), "expected a whole number in days, got 'a year'"),
        (("--patience-s", "soon"), "expected a number in s, got 'soon'"),
        (("--port", "99999"), "expected at most 65535, got '99999'"),
    ],
)
def test_what_came_for_an_option_is_told_with_its_unit(run, arguments, said):
    found = run("serve", *arguments, columns=200)
    assert found.exit_code == 2
    assert said in found.stderr

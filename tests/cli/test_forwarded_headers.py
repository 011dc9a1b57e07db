"""Whom X-Forwarded-For and X-Forwarded-Proto are believed from: proxies that are named, no other.

The header states whose wrong keys are counted, who is named in the event log, and whether a
browser's session is for HTTPS alone.
"""

from contextlib import contextmanager

import httpx
import pytest

from app.access.failures import AT_MOST
from app.access.keys import Role
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.services.access_keys import create_key
from app.settings import Settings
from app.storage.database import Database
from tests.cli.conftest import wait_until_it_answers
from tests.service_examples import ROOM, UNHURRIED, furnish_database

PEER = "203.0.113.9"
"""What the header states; the connection itself comes from 127.0.0.1."""

NOT_BELIEVED = pytest.mark.parametrize(
    "proxies", [(), ("10.0.0.0/8", "::1")], ids=["none", "others"]
)
BELIEVED = pytest.mark.parametrize("proxies", [("127.0.0.1",), ("127.0.0.0/8", "::1")])


@pytest.fixture
def database_url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@contextmanager
def client_behind(url, **headers):
    with httpx.Client(base_url=url, headers=headers, trust_env=False, timeout=60) as client:
        yield client


@pytest.fixture
def boss(database_url):
    """The key of an administrator, made before any service starts that has to know it."""
    database = Database(database_url)
    secret = create_key(database, "boss", Role.ADMIN).secret
    database.close()
    return secret


@pytest.fixture
def client(database_url, proxies, boss, monkeypatch):
    """A client on 127.0.0.1 of a service that listens, asks for keys and believes these proxies."""
    # A variable of the server inside, which is none of the service's.
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "*")
    settings = Settings(
        database_url=database_url, require_keys=True, forwarded_allow_ips=proxies, **UNHURRIED
    )
    service = create_app(settings)
    with (
        listening("127.0.0.1", 0, "serve") as opened,
        serving(service, opened, "warning"),
        client_behind(url_of(opened)) as client,
    ):
        yield client


def code_of_wrong_key(client, forwarded_for):
    headers = {"Authorization": "Bearer wrong", "X-Forwarded-For": forwarded_for}
    return client.get(ROOM, headers=headers).status_code


def who_changes(client, boss):
    """Change something behind a header; give who did it by the event log."""
    headers = {"Authorization": f"Bearer {boss}", "User-Agent": "cell/7"}
    forwarded = headers | {"X-Forwarded-For": PEER}
    changed = client.patch(ROOM, json={"name": "Mine"}, headers=forwarded)
    assert changed.status_code == 200, changed.text
    return client.get(f"{ROOM}/events", headers=headers).json()["events"][0]["who"]


def login_cookie(client, boss, proto):
    answer = client.post("/login", data={"key": boss}, headers={"X-Forwarded-Proto": proto})
    assert answer.status_code == 303
    return answer.headers["Set-Cookie"].split("; ")


@NOT_BELIEVED
def test_wrong_keys_are_counted_by_the_connections_address_whatever_is_stated(client):
    codes = [code_of_wrong_key(client, f"203.0.113.{i}") for i in range(AT_MOST + 1)]
    assert codes == [401] * AT_MOST + [429]


@BELIEVED
def test_wrong_keys_are_counted_by_the_address_that_the_proxy_states(client):
    """The last one: what stands before it, whoever asks has written into the header himself."""
    others = [code_of_wrong_key(client, f"198.51.100.{i}") for i in range(AT_MOST + 1)]
    assert others == [401] * (AT_MOST + 1)
    codes = [code_of_wrong_key(client, f"198.51.100.{i}, {PEER}") for i in range(AT_MOST + 1)]
    assert codes == [401] * AT_MOST + [429]
    assert code_of_wrong_key(client, "192.0.2.7") == 401


@NOT_BELIEVED
def test_the_event_log_names_the_connections_address(client, boss):
    assert who_changes(client, boss) == "boss, 127.0.0.1, cell/7"


@BELIEVED
def test_the_event_log_names_the_address_that_the_proxy_states(client, boss):
    assert who_changes(client, boss) == f"boss, {PEER}, cell/7"


@NOT_BELIEVED
def test_a_session_is_not_for_https_alone_because_somebody_states_it(client, boss):
    assert "Secure" not in login_cookie(client, boss, "https")


@BELIEVED
def test_a_session_is_for_https_alone_where_the_proxy_states_it(client, boss):
    assert "Secure" in login_cookie(client, boss, "https")
    assert "Secure" not in login_cookie(client, boss, "http")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "address"),
    [((), "127.0.0.1"), (("--forwarded-allow-ips", "127.0.0.1"), PEER)],
    ids=["nothing", "option"],
)
def test_the_command_line_says_who_is_believed(
    start, free_port, database_url, boss, options, address
):
    start(
        *("serve", "--port", free_port, "--database-url", database_url, "--require-keys"), *options
    )
    url = f"http://127.0.0.1:{free_port}"
    wait_until_it_answers(url)
    with client_behind(url) as client:
        assert who_changes(client, boss) == f"boss, {address}, cell/7"


@pytest.mark.parametrize("stated", ["*", "0.0.0.0/0 *", "proxy.example.org", "10.0.0.1/8"])
def test_who_would_believe_everybody_or_nobody_is_refused(run, tmp_path, stated):
    # The folder is not there, so that what takes the option ends as well, with other words.
    database = f"sqlite:///{tmp_path}/nowhere/x.db"
    for options, variables in (
        (("--forwarded-allow-ips", stated), {}),
        ((), {"THERMAP_FORWARDED_ALLOW_IPS": stated}),
    ):
        refused = run(
            "serve", "--port", 0, "--database-url", database, *options, columns=400, **variables
        )
        assert refused.exit_code == 2
        assert "--forwarded-allow-ips" in refused.stderr
        assert "expected an address or a network" in refused.stderr

"""What others wrote, where it is repeated: short, on one line, without secrets."""

import io
import json
import logging

import pytest

from app.cli.logs import _Json, _Text
from app.errors import InvalidContent, ThermapError
from app.foreign_text import shown, without_secrets
from app.storage.database import Database

URLS = [
    "http://me:s3cret@10.0.0.5:5000/probe",
    "opc.tcp://me:s3cret@h:4840",
    "mqtt://me:s3c@ret@h",
    "postgresql://me:s3/cret@h/db",
    "postgresql://h/db?sslmode=require&password=s3cret&user=me",
    "postgresql://h/db?PASSWORD=s3cret",
    "postgresql://h/db?sslpassword=s3cret",
    "me:s3cret@broker",
]


@pytest.mark.parametrize("url", URLS)
def test_no_secret_is_left(url):
    for text in (url, f"no answer from {url!r} in time", f"{url} and {url}"):
        assert "s3c" not in shown(text)
        assert "ret@" not in shown(text)


@pytest.mark.parametrize("text", ["the sensor at 12:00 said a@b.org", "http://h:80/a?b=c", "x@y"])
def test_what_is_no_secret_stays(text):
    assert without_secrets(text) == text


def test_what_a_terminal_obeys_is_escaped():
    said = "a\x1b[2J\x9b1m\u2028\u202e\r\n\0\ud800b °C µm"
    assert shown(said) == "a\\x1b[2J\\x9b1m\\u2028\\u202e\\r\\n\\x00\\ud800b °C µm"


def test_three_megabytes_are_a_sentence():
    assert len(shown("\x9b" * 3_000_000)) < 600


@pytest.mark.parametrize("form", [_Text, _Json])
def test_a_line_of_the_log_is_one_line(form):
    out = io.StringIO()
    handler = logging.StreamHandler(out)
    handler.setFormatter(form())
    log = logging.Logger("thermap")
    log.addHandler(handler)
    log.warning("the agent says %s", "\x1b[2J\n2026-01-01 ERROR\x85" + "x" * 3_000_000)
    log.warning("no answer from %s", URLS[0])
    try:
        raise ValueError("\x9b2J s3cret:" + URLS[0] + "y" * 100_000)
    except ValueError:
        log.exception("unforeseen")
    written = out.getvalue()
    assert len(written) < 30_000
    assert "me:s3cret" not in written
    assert not set(written) & set("\x1b\x85\x9b")
    first = written.split("\n")[0]
    assert "ERROR" in (json.loads(first)["message"] if form is _Json else first)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("postgresql+foo://me:s3cret@h/d", "expected sqlite:///FILE or postgresql://"),
        ("postgresql+asyncpg://h/d?password=s3cret", "expected sqlite:///FILE or postgresql://"),
        ("sqlite+aiosqlite:////tmp/x.db", "expected sqlite:///FILE or postgresql://"),
        ("sqlite+foo:///x.db", "expected sqlite:///FILE or postgresql://"),
        ("postgresql://h/d?bogus=s3cret", 'invalid connection option "bogus"'),
        ("postgresql://h/d?host=a&host=b&port=1", "multihost"),
        ("postgresql://me:s3cret@h:port/d", "no URL"),
        ("://", "no URL"),
    ],
)
def test_a_database_url_that_cannot_be_used_is_refused(url, words):
    with pytest.raises(InvalidContent) as refused:
        Database(url)
    assert words in refused.value.detail
    assert "s3cret" not in refused.value.detail


@pytest.mark.parametrize("option", ["password=s3cret", "sslpassword=s3cret"])
def test_a_password_among_a_urls_options_is_not_shown(option):
    pytest.importorskip("psycopg")
    database = Database(f"postgresql://me@127.0.0.1:1/d?{option}")
    assert "s3cret" not in database.name
    with pytest.raises(ThermapError) as away, database.reading() as session:
        session.connection()
    assert "s3cret" not in away.value.detail
    database.close()

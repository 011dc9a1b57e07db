"""Every request has a number, in its answer and in the log."""

import json
import logging

import pytest

from app.cli.logs import write_log_as
from tests.service_examples import ROOM, temperatures

pytestmark = pytest.mark.anyio


@pytest.fixture
def logged(caplog):
    caplog.set_level(logging.INFO, "thermap.requests")
    return lambda: [record for record in caplog.records if record.name == "thermap.requests"]


async def test_a_number_is_answered_and_logged_whatever_is_asked(client, logged):
    body = {"temperatures_c": temperatures(25.0)}
    answers = [
        await client.post(f"{ROOM}/compensation", json=body),
        await client.get(f"{ROOM}?secret=hidden"),
        await client.get("/nothing", headers={"X-Request-ID": "cell-7.42"}),
        await client.get(ROOM, headers={"X-Request-ID": "two words\t"}),
    ]
    numbers = [answer.headers["X-Request-ID"] for answer in answers]
    assert numbers[2] == "cell-7.42"
    assert len(set(numbers)) == 4
    assert " " not in numbers[3]
    lines = logged()
    assert [(line.method, line.status) for line in lines] == [
        ("POST", 200),
        ("GET", 422),
        ("GET", 404),
        ("GET", 200),
    ]
    assert lines[0].bytes == len(answers[0].content)
    assert not any("hidden" in line.getMessage() for line in lines)


async def test_who_only_watches_leaves_no_line_and_no_line_is_forged(client, logged):
    for path in ("/healthz", "/readyz", "/metrics", "/assets/dashboard.css"):
        await client.get(path)
    assert logged() == []
    await client.get("/a%0A2026-11-22 ERROR forged")
    (line,) = logged()
    assert "\n" not in line.getMessage()


def test_json_has_a_field_for_each_thing(capsys, caplog):
    caplog.set_level(logging.WARNING, "thermap")
    before = logging.root.handlers[:], logging.root.level
    try:
        write_log_as("json")
        logging.getLogger("thermap").warning("it is %d °C", 21, extra={"status": 200})
    finally:
        logging.root.handlers[:], logging.root.level = before
    line = json.loads(capsys.readouterr().err)
    assert (line["message"], line["level"], line["status"]) == ("it is 21 °C", "warning", 200)

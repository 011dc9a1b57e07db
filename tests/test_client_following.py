"""Following a stream through the client: what is told, breaks, and what comes after them."""

import asyncio
import json
from contextlib import closing, contextmanager
from datetime import timedelta

import httpx
import pytest

from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from tests.service_examples import MACHINE, START, furnish_database, reading
from thermap import (
    AsyncThermapClient,
    NotListeningError,
    ServiceUnavailableError,
    ThermapClient,
    UnexpectedAnswerError,
    UnknownThingError,
    following,
)
from thermap.following import EventReader


@pytest.fixture
def database_url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@contextmanager
def running(database_url, port=0):
    service = create_app(Settings(database_url=database_url, refresh_s=0.05))
    with listening("127.0.0.1", port, "serve") as opened, serving(service, opened, "warning"):
        yield url_of(opened)


def of_kind(stream, kind):
    return next(told for told in stream if told.kind == kind)


def test_tables_and_verdicts_come_as_they_change(database_url):
    with running(database_url) as url, ThermapClient(url) as client:
        client.store_readings("mcfv5050", reading(START, 25.0))
        with closing(client.follow("mcfv5050")) as stream:
            assert of_kind(stream, "status").status.machine == "mcfv5050"
            first = of_kind(stream, "table")
            assert first.machine == "mcfv5050"
            assert not first.stepping
            client.store_readings("mcfv5050", reading(START + timedelta(seconds=5), 26.0))
            second = of_kind(stream, "table")
        assert second.table.reading_time == START + timedelta(seconds=5)
        assert second.table.components != first.table.components


def test_why_there_is_no_table_is_told_and_all_machines_at_once(database_url):
    with running(database_url) as url, ThermapClient(url) as client:
        client.create_machine(MACHINE | {"id": "second"})
        details = {}
        with closing(client.follow_all()) as stream:
            while len(details) < 2:
                told = of_kind(stream, "state")
                assert told.table is None
                details[told.machine] = told.detail
        assert "no reading yet" in details["mcfv5050"]
        assert details["second"]


def test_a_service_that_is_gone_is_told_once_and_followed_again(database_url, monkeypatch):
    monkeypatch.setattr(following, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr(following, "LONGEST_PAUSE_S", 0.1)
    with running(database_url) as url:
        client = ThermapClient(url)
        client.store_readings("mcfv5050", reading(START, 25.0))
        stream = client.follow("mcfv5050")
        of_kind(stream, "table")
    lost = of_kind(stream, "lost")
    assert lost.machine == ""
    assert url in lost.detail
    with running(database_url, int(url.rpartition(":")[2])):
        with ThermapClient(url) as other:
            other.store_readings("mcfv5050", reading(START + timedelta(seconds=5), 26.0))
        told = next(told for told in stream if told.kind in ("table", "lost"))
        assert told.kind == "table"  # the break is not told again
        assert told.table.reading_time == START + timedelta(seconds=5)
        stream.close()
    client.close()


def test_a_machine_that_is_deleted_ends_it(database_url, monkeypatch):
    monkeypatch.setattr(following, "FIRST_PAUSE_S", 0.05)
    with running(database_url) as url, ThermapClient(url) as client:
        stream = client.follow("mcfv5050")
        next(stream)
        client.delete_machine("mcfv5050")
        with pytest.raises(UnknownThingError, match="mcfv5050"):
            of_kind(stream, "table")


def test_who_is_not_there_from_the_beginning_is_an_error():
    with ThermapClient("http://127.0.0.1:9") as client, pytest.raises(NotListeningError):
        next(client.follow("mcfv5050"))
    away = httpx.MockTransport(lambda _request: httpx.Response(503, json={"detail": "not yet"}))
    with ThermapClient(transport=away) as client, pytest.raises(ServiceUnavailableError):
        next(client.follow_all())


@pytest.mark.anyio
async def test_the_awaiting_client_follows_too(database_url):
    context = running(database_url)
    url = await asyncio.to_thread(context.__enter__)
    try:
        async with AsyncThermapClient(url) as client:
            await client.store_readings("mcfv5050", reading(START, 25.0))
            stream = client.follow("mcfv5050")
            async for told in stream:
                if told.kind == "table":
                    break
            assert told.table.reading_time == START
            await stream.aclose()
    finally:
        await asyncio.to_thread(context.__exit__, None, None, None)


def taken(reader, *lines):
    return [told for told in map(reader.take, lines) if told is not None]


NO_TABLE = json.dumps({"machine": "vmc", "components": [], "detail": "no reading yet"})
PARTS = NO_TABLE.replace(", ", ",\n").split("\n")


def test_what_is_no_event_of_ours_is_passed_over():
    reader = EventReader()
    reader.begin()
    assert taken(reader, ": alive", "", "event: heartbeat", "data: {}", "id: 3", "") == []
    assert reader.headers == {"Last-Event-ID": "3"}
    assert taken(reader, "event: news of another version", "data: []", "") == []
    (told,) = taken(reader, "event:state", *(f"data:{part}" for part in PARTS), "")
    assert (told.kind, told.machine, told.detail) == ("state", "vmc", "no reading yet")


def test_half_an_event_is_none():
    reader = EventReader()
    reader.begin()
    assert taken(reader, "event: state", f"data: {NO_TABLE}", "id: 7") == []
    reader.begin()
    assert reader.headers == {}
    assert taken(reader, "") == []


def test_pauses_grow_until_something_comes():
    reader = EventReader()
    pauses = [reader.pause_s() for _ in range(9)]
    assert pauses[:3] == [0.5, 1.0, 2.0]
    assert pauses[-1] == following.LONGEST_PAUSE_S
    assert reader.lost("why").detail == "why"
    assert reader.lost("why") is None
    taken(reader, ": alive", "")
    assert reader.pause_s() == following.FIRST_PAUSE_S
    assert reader.lost("again").detail == "again"


def test_what_cannot_be_read_is_an_unexpected_answer():
    body = b"event: status\ndata: {}\n\n"
    other = httpx.MockTransport(lambda _request: httpx.Response(200, content=body))
    with ThermapClient(transport=other) as client, pytest.raises(UnexpectedAnswerError):
        next(client.follow("vmc"))


def test_news_come_typed_and_go_on_after_a_break(database_url, monkeypatch):
    monkeypatch.setattr(following, "FIRST_PAUSE_S", 0.05)
    kinds = ("event", "watch", "analysis")
    with running(database_url) as url:
        client = ThermapClient(url)
        stream = client.follow_all(kinds=("status", *kinds))
        of_kind(stream, "status")
        client.change_machine("mcfv5050", {"name": "Mill"})
        first = of_kind(stream, "event")
        assert (first.machine, first.event.kind) == ("mcfv5050", "machine")
        assert first.event.text.startswith("settings changed: name from ")
    assert of_kind(stream, "lost").machine == ""
    with running(database_url) as url, ThermapClient(url) as other:
        other.change_machine("mcfv5050", {"name": "Lathe"})
    with running(database_url, int(client.base_url.rpartition(":")[2])):
        missed = of_kind(stream, "event")
        assert missed.event.id > first.event.id
        client.activate_model("mcfv5050", 2)
        assert of_kind(stream, "event").event.kind == "model"
        stream.close()
    client.close()


def test_every_kind_of_news_is_read():
    entry = {"machine": "vmc", "time": "2026-03-01T06:00:00Z", "who": "service"}
    watch = {"watch": "beyond", "before": "within", "model_version": 3, "drifting_since": None}
    job = {"analysis": 7, "status": "running", "progress": 0.4, "message": "searching"}
    reader = EventReader()
    reader.begin()
    (told,) = taken(reader, "event: watch", f"data: {json.dumps(entry | watch)}", "id: 1-4", "")
    assert (told.kind, told.machine, told.watch.watch) == ("watch", "vmc", "beyond")
    (told,) = taken(reader, "event: analysis", f"data: {json.dumps(entry | job)}", "id: 1-5", "")
    assert (told.analysis.status, told.analysis.progress) == ("running", 0.4)
    missed = json.dumps({"count": 12, "detail": "12 entries"})
    (told,) = taken(reader, "event: missed", f"data: {missed}", "id: 1-17", "")
    assert (told.kind, told.missed, told.detail) == ("missed", 12, "12 entries")
    assert taken(reader, "id: 1-18", "") == []
    assert reader.headers == {"Last-Event-ID": "1-18"}


def test_who_follows_nothing_is_refused_and_what_all_are_told_is_not_named():
    with pytest.raises(ValueError, match="analysis"):
        following.query_of(0.1, None, ())
    assert "kind" not in following.query_of(0.1, 2.0, ("status", "table"))
    assert following.query_of(0.1, None, ("watch",))["kind"] == ["watch"]

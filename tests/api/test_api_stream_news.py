"""What streams tell of the event log, of watches and of analyses: promptly, each once, bounded."""

import socket
from contextlib import ExitStack, closing, contextmanager
from datetime import timedelta
from time import monotonic, sleep

import pytest

import app.services.events
import app.storage.events
from app.access.keys import Role
from app.api import streamed_log, streams
from app.events.event import EventKind
from app.services import log_tail
from app.services.access_keys import create_key
from app.services.events import AlarmLog
from app.storage.analyses import begin_analysis, record_heartbeat
from app.storage.database import Database
from app.storage.events import write_event
from tests.api.test_api_analyses import QUICK
from tests.api.test_api_watch import BEGIN, T_C, visit
from tests.campaign_examples import LATER, campaign_database
from tests.campaign_examples import ROOM as CAMPAIGN
from tests.databases import reachable
from tests.followed_streams import PATH, Stream, opened
from tests.service_examples import MACHINE, ROOM, Clock, furnish_database, reading, table

pytestmark = pytest.mark.slow

NEWS = {"kind": ["event", "watch", "analysis"]}
EVERYTHING = {"kind": ["table", "status", *NEWS["kind"]]}
FAR_OFF_S = 3600.0


@pytest.fixture(autouse=True)
def by_hand(monkeypatch):
    """The log of alarms looks when it is told to: its clock is not the tests' one."""
    monkeypatch.setattr(app.services.events, "LOOK_EVERY_S", FAR_OFF_S)


@pytest.fixture
def told_only(monkeypatch):
    """The log is read when it is said to have changed, and not now and then."""
    monkeypatch.setattr(streamed_log, "ASK_EVERY_S", FAR_OFF_S)
    monkeypatch.setattr(streamed_log, "ASK_FILE_EVERY_S", FAR_OFF_S)


@pytest.fixture
def shop(furnished_url, clock):
    with opened(furnished_url, clock, analyses=False) as shop:
        yield shop


def rename(shop, name):
    shop("PATCH", ROOM, json={"name": name})


def write(shop, texts, machine="mcfv5050"):
    """Write entries into the log, in one transaction."""
    context = shop.service.state.context
    with context.database.writing() as session:
        for text in texts:
            write_event(session, machine, EventKind.MACHINE, text, context.now())


def texts_until(stream, last):
    """Give the texts of events until one of them comes."""
    found = []
    while not found or found[-1] != last:
        event = stream.next()
        assert event.name == "event"
        found.append(event.content["text"])
    return found


def test_changes_and_alarms_come_as_the_log_has_them(shop, told_only):
    log = AlarmLog(shop.service.state.context)

    def at(t_c, seconds=0):
        shop.feed_after(seconds, t_c)
        log.look()
        log.look()

    with shop.follow(**NEWS) as stream:
        rename(shop, "Mill")
        change = stream.next()
        assert change.name == "event"
        assert change.content["text"].startswith("settings changed: name from ")
        at(29.8)
        at(30.5, 60)
        came = stream.next()
        assert (came.name, came.content["kind"]) == ("event", "alarm")
        assert (came.content["details"], came.content["until"]) == (
            {"state": "clamped", "about": "x-middle, z-column"},
            None,
        )
        for _ in range(2):
            at(29.8, 60)
        went = stream.next()
        assert went.content["id"] == came.content["id"]
        assert went.content["until"] > went.content["time"]
        at(30.5, 60)
        again = stream.next()
        assert (again.content["id"], again.content["count"]) == (came.content["id"], 2)
        assert again.content["until"] is None
    logged = shop("GET", f"{ROOM}/events?limit=2").json()["events"]
    assert logged == [again.content, change.content]


def test_the_watch_is_told_when_it_says_something_else(shop, told_only):
    body = [reading(BEGIN + timedelta(minutes=m), T_C) for m in range(61)]
    shop("POST", f"{ROOM}/readings", json=body)

    def stored(number, shift_um=0.0):
        return shop("POST", f"{ROOM}/verifications", json=visit(number, shift_um)).json()

    with shop.follow(kind=["watch"]) as stream:
        for number in range(3):
            stored(number)
        first = stream.next().content
        assert (first["before"], first["watch"], first["model_version"]) == (
            ("not-judged", "within", 3)
        )
        assert first["drifting_since"] is None
        number = 3
        while stored(number, 10.0)["judgement"]["status"] != "beyond":
            number += 1
        drifts = stream.next().content
        assert (drifts["before"], drifts["watch"]) == ("within", "beyond")
        since = shop("GET", f"{ROOM}/watch").json()["beyond_since"]
        assert drifts["drifting_since"] == since
        assert drifts["who"].startswith("127.0.0.1")
        shop("POST", f"{ROOM}/models/2/activate")
        other = stream.next().content
        assert (other["before"], other["watch"], other["model_version"]) == (
            ("beyond", "not-judged", 2)
        )
    kinds = [one["kind"] for one in shop("GET", f"{ROOM}/events?kind=watch").json()["events"]]
    assert kinds == ["watch"] * 3


@pytest.mark.slow
def test_an_analysis_is_told_from_the_queue_to_its_end(shop, monkeypatch):
    monkeypatch.setattr(streamed_log, "ASK_EVERY_S", 0.01)
    monkeypatch.setattr(streamed_log, "ASK_FILE_EVERY_S", 0.01)
    monkeypatch.setattr(streamed_log, "PROGRESS_EVERY_S", 0.0)
    context = shop.service.state.context
    shop("POST", f"{ROOM}/verifications", json=visit(0))

    def told(stream):
        event = stream.next()
        assert (event.name, event.content["machine"]) == ("analysis", "mcfv5050")
        one = event.content
        return one["analysis"], one["status"], one["progress"], one["message"]

    with shop.follow(kind=["analysis"]) as stream:
        body = {"verifications": [1]}
        number = shop("POST", f"{ROOM}/analyses", json=body).json()["id"]
        assert told(stream) == (number, "queued", 0.0, "queued")
        with context.database.writing() as session:
            assert begin_analysis(session, number, "somebody", context.now())
        assert told(stream) == (number, "running", 0.0, "begins")
        with context.database.writing() as session:
            assert record_heartbeat(session, number, "somebody", 0.42, "searching")
        assert told(stream) == (number, "running", 0.42, "searching")
        with shop.follow(kind=["analysis"]) as late:
            assert told(late) == (number, "running", 0.42, "searching")
        shop("POST", f"{ROOM}/analyses/{number}/cancel")
        assert told(stream) == (number, "cancelled", 0.0, "cancelled")
        shop("DELETE", f"{ROOM}/analyses/{number}")
        assert told(stream) == (number, "deleted", 0.0, "deleted")


def test_progress_is_told_sparingly(clock):
    log = streamed_log.StreamedLog(lambda: None)
    job = streamed_log.AnalysisNews("m", 1, "running", 0.1, "searching", clock(), "service")
    known = log._paced(job, 10.0)
    log.running = {"m": known}
    for after_s, progress, is_told in ((11.0, 0.2, False), (12.5, 0.1, False), (12.5, 0.2, True)):
        now = streamed_log.replace(job, progress=progress, time=clock() + timedelta(seconds=1))
        assert (log._paced(now, after_s) is not known) is is_told


@pytest.mark.slow
def test_an_analysis_that_is_really_run_is_told(databases):
    url = databases.prepared("sqlite", campaign_database)
    path = f"{CAMPAIGN}/compensation/stream"
    with opened(url, Clock(LATER)) as shop, shop.follow(path, kind=["analysis"]) as stream:
        shop("POST", f"{CAMPAIGN}/analyses", json=QUICK)
        told = [stream.next().content]
        while told[-1]["status"] not in ("done", "failed"):
            told.append(stream.next().content)
        shop("POST", f"{CAMPAIGN}/analyses", json=QUICK | {"verifications": [1]})
        while (last := stream.next().content)["status"] in ("queued", "running"):
            pass
    databases.give_back(url)
    assert [one["status"] for one in told] == ["queued", *["running"] * (len(told) - 2), "done"]
    shares = [one["progress"] for one in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    found = (last["analysis"], last["status"])
    assert found in ((2, "done"), (2, "failed"))


def test_who_does_not_ask_for_news_is_told_none(shop):
    shop.feed(25.0)
    with shop.follow() as stream:
        first = stream.until("table")
        assert first.id.isdigit()
        rename(shop, "Mill")
        shop.feed_after(10, 26.0)
        while (event := stream.next()).name != "table":
            assert event.name == "status"
        assert event.id.isdigit()
    with shop.follow(kind=["status"]) as stream:
        assert stream.next().content["state"] == "fresh"
        shop.clock.advance(121)
        assert stream.next().content["state"] == "stale"
    shop.refused(f"{PATH}?kind=weather", 422)
    shop.refused(f"{PATH}?kind=", 422)


def test_a_break_between_table_and_news_loses_neither_and_doubles_none(shop):
    shop.feed(25.0)
    with shop.follow(**EVERYTHING) as stream:
        first = stream.until("table")
        write(shop, ["1", "2"])
        events = [stream.until("event"), stream.until("event")]
        shop.feed_after(10, 26.0)
        second = stream.until("table")
    write(shop, ["3", "end"])
    for last, texts, has_table in (
        (first, ["1", "2", "3", "end"], True),
        (events[0], ["2", "3", "end"], True),
        (events[1], ["3", "end"], True),
        (second, ["3", "end"], False),
    ):
        with shop.follow(last=last.id, **EVERYTHING) as stream:
            came = [stream.next()]
            while came[-1].content.get("text") != "end":
                came.append(stream.next())
        assert [e.content["text"] for e in came if e.name == "event"] == texts
        assert ("table" in {e.name for e in came}) is has_table
        assert came[0].name == "status"
    with shop.follow(last=came[-1].id, **NEWS) as stream:
        write(shop, ["later"])
        assert texts_until(stream, "later") == ["later"]


def test_who_breaks_off_before_anything_happened_has_the_news_all_the_same(shop):
    with shop.follow(**NEWS) as stream:
        write(shop, ["1"], machine="another")
        with shop.follow("/v1/stream", **NEWS) as everything:
            rename(shop, "Mill")
            assert stream.next().name == everything.next().name == "event"
    with shop.follow(**NEWS) as stream:
        pass
    write(shop, ["2"])
    with shop.follow(last=stream.last, **NEWS) as again:
        assert texts_until(again, "2") == ["2"]


@pytest.mark.slow
def test_another_service_goes_on_where_one_stopped(furnished_url, clock):
    with ExitStack() as running:
        one, other = (
            running.enter_context(opened(furnished_url, clock, analyses=False)) for _ in range(2)
        )
        with one.follow(**NEWS) as here, other.follow(**NEWS) as there:
            rename(one, "Mill")
            rename(other, "Lathe")
            names = [here.next(), here.next(), there.next(), there.next()]
            assert [event.id for event in names[:2]] == [event.id for event in names[2:]]
        write(one, ["1", "2"])
        with other.follow(last=names[0].id, **NEWS) as stream:
            assert texts_until(stream, "2") == [
                "settings changed: name from 'Mill' to 'Lathe'",
                "1",
                "2",
            ]
        with other.follow(**NEWS) as stream:
            write(one, ["3"])
            told = stream.next()
        # One that has not read as far yet tells nothing twice.
        with one.follow(last=told.id, **NEWS) as stream:
            write(other, ["4"])
            assert texts_until(stream, "4") == ["4"]


@pytest.mark.slow
def test_others_are_told_at_once_on_postgresql(databases, clock, told_only):
    """Nobody reads now and then: what PostgreSQL tells is enough."""
    url = reachable(lambda kind: databases.prepared(kind, furnish_database), "postgresql")
    with ExitStack() as running:
        one, other = (
            running.enter_context(opened(url, clock, analyses=False, refresh_s=FAR_OFF_S))
            for _ in range(2)
        )
        with other.follow(**NEWS) as stream:
            for name in ("a", "b", "c"):
                rename(one, name)
                assert stream.next().content["text"].startswith("settings changed: name from ")
    databases.give_back(url)


def test_a_machine_that_is_deleted_says_so_last(shop):
    with shop.follow(**EVERYTHING) as stream, shop.follow("/v1/stream", **NEWS) as everything:
        shop("DELETE", ROOM)
        assert stream.until("event").content["text"] == "machine deleted"
        assert stream.until("event") is None
        assert everything.until("event").content["text"] == "machine deleted"


def test_a_key_for_one_machine_is_told_its_news_alone(furnished_url, clock):
    with closing(Database(furnished_url)) as before:
        keys = {
            "own": create_key(before, "own", Role.VIEWER, ["mcfv5050"]).secret,
            "all": create_key(before, "all", Role.ADMIN).secret,
        }
    with opened(furnished_url, clock, analyses=False, require_keys=True) as shop:
        database = shop.service.state.context.database
        headers = {name: {"Authorization": f"Bearer {key}"} for name, key in keys.items()}
        with (
            shop.follow("/v1/stream", headers=headers["own"], **NEWS) as own,
            shop.follow("/v1/stream", headers=headers["all"], **NEWS) as everything,
        ):
            shop("POST", "/v1/machines", json=MACHINE | {"id": "b"}, headers=headers["all"])
            create_key(database, "third", Role.VIEWER)
            shop("PATCH", "/v1/machines/b", json={"name": "B"}, headers=headers["all"])
            shop("PATCH", ROOM, json={"name": "A"}, headers=headers["all"])
            told = own.next()
            assert (told.name, told.content["machine"]) == ("event", "mcfv5050")
            machines = [everything.next().content["machine"] for _ in range(4)]
        assert machines == ["b", None, "b", "mcfv5050"]


@pytest.mark.parametrize("kept", [10, 25])
def test_too_much_that_was_missed_is_counted(shop, monkeypatch, kept):
    monkeypatch.setattr(streamed_log, "MOST_ENTRIES", kept)
    with shop.follow(**NEWS) as stream:
        write(shop, ["begin"])
        begin = stream.next()
    for part in range(4):
        write(shop, [f"{part}.{i}" for i in range(10)])
    write(shop, ["not ours"] * 5, machine="another")
    write(shop, ["end"])
    told = kept - 5
    with shop.follow(last=begin.id, **NEWS) as stream:
        missed = stream.next()
        assert (missed.name, missed.content["count"]) == ("missed", 41 - told)
        assert f"{41 - told} entries" in missed.content["detail"]
        assert len(texts_until(stream, "end")) == told
    with shop.follow(last=missed.id, **NEWS) as stream:  # broken off behind it
        assert len(texts_until(stream, "end")) == told
    with shop.follow(last=begin.id, kind=["watch"]) as stream:
        write(shop, ["nothing of the watch"])
        shop("DELETE", ROOM)
        assert stream.next() is None


@pytest.mark.slow
def test_an_entry_that_is_not_known_is_said_to_be_none(shop):
    with shop.follow(last="1-999999999", **NEWS) as stream:
        missed = stream.next()
        assert (missed.name, missed.content["count"]) == ("missed", None)
        assert "unknown number" in missed.content["detail"]
        write(shop, ["later"])
        assert texts_until(stream, "later") == ["later"]
    for unknown in ("yesterday", "1-2-3", "-5", "9" * 19 + "-1", "5-" + "9" * 19):
        with shop.follow(last=unknown, **NEWS) as stream:
            write(shop, ["now"])
            assert texts_until(stream, "now") == ["now"]


def test_a_flood_arrives_in_its_order_each_once(shop):
    with shop.follow(**EVERYTHING) as stream:
        for part in range(20):
            write(shop, [f"{part}.{i}" for i in range(40)])
        shop.feed(25.0)
        found, names = [], set()
        while len(found) < 800 or "table" not in names:
            event = stream.next()
            names.add(event.name)
            if event.name == "event":
                found.append(event.content["text"])
    assert found == [f"{part}.{i}" for part in range(20) for i in range(40)]
    assert "missed" not in names


@pytest.mark.slow
def test_the_log_is_read_once_for_all_who_follow(shop, told_only, monkeypatch):
    reads = []
    whole = log_tail.read_tail

    def read(*asked):
        reads.append(asked)
        return whole(*asked)

    monkeypatch.setattr(log_tail, "read_tail", read)
    with ExitStack() as following:
        followers = [following.enter_context(shop.follow(**NEWS)) for _ in range(30)]
        write(shop, ["begin"])
        for stream in followers:
            texts_until(stream, "begin")
        reads.clear()
        for number in range(5):
            write(shop, [f"{number}"])
            for stream in followers:
                texts_until(stream, f"{number}")
    assert len(reads) == 5


@contextmanager
def not_reading(shop, query):
    """Open a stream over a small buffer, without reading from it."""
    host, port = shop._client.base_url.host, shop._client.base_url.port
    with closing(socket.socket()) as opened:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        opened.settimeout(60.0)
        opened.connect((host, port))
        opened.sendall(f"GET {PATH}?{query} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        yield opened


def events_of(opened):
    """Read a stream on, from a socket: HTTP's chunks are of no interest."""
    with opened.makefile("rb") as lines:
        text = (line.decode().rstrip("\r\n") for line in lines)
        yield from iter(Stream(_without_chunks(text)).next, None)


def _without_chunks(lines):
    """Leave out head and sizes of chunks; each event is one chunk."""
    for line in lines:
        if ": " in line or not line:
            yield line


def until(is_so):
    end = monotonic() + 60.0
    while not is_so():
        assert monotonic() < end, "it never was"
        sleep(0.005)


@pytest.mark.slow
def test_who_reads_slowly_is_told_what_is_kept_and_how_much_is_not(databases, clock, monkeypatch):
    monkeypatch.setattr(streamed_log, "MOST_ENTRIES", 20)
    url = databases.prepared("sqlite", furnish_database)
    count, long = 600, "x" * 50_000
    with opened(url, clock, analyses=False) as shop, not_reading(shop, "kind=event") as opened_:
        log = shop.service.state.streams._log
        until(lambda: log._followers == 1 and log.newest is not None)
        for number in range(count // 10):
            write(shop, [f"{10 * number + i} {long}" for i in range(10)])
            newest = log_newest(shop)
            until(lambda newest=newest: log.newest == newest)
        write(shop, ["end"])
        told, missed = [], 0
        for event in events_of(opened_):
            if event.name == "missed":
                missed += event.content["count"]
            elif event.content["text"] == "end":
                break
            else:
                told.append(int(event.content["text"].split()[0]))
        assert len(log._entries) == 20
    databases.give_back(url)
    assert told == sorted(set(told))
    assert len(told) + missed == count
    assert missed > count // 3  # the rest is what lay in buffers


def log_newest(shop):
    with shop.service.state.context.database.reading() as session:
        return app.storage.events.read_tail(session, None, 1).newest


@pytest.mark.slow
def test_who_reads_slowly_has_the_newest_table_and_not_all_between(databases, clock, monkeypatch):
    monkeypatch.setattr(streams, "LOOK_EVERY_S", 0.005)
    url = databases.prepared("sqlite", furnish_database)
    count = 150
    with opened(url, clock, analyses=False) as shop:
        positions = [i / 8 for i in range(4001)]
        for label, t_c in (("Run #10", 20.5), ("Run #11", 29.5)):
            grown = [(t_c - 20.0) * x / 100 for x in positions]
            body = {
                "label": label,
                "measured_at": "2026-02-20T00:00:00Z",
                "temperatures_c": reading(clock.time, t_c)["temperatures_c"],
                "components": [table("EYX", positions, grown)],
            }
            shop("POST", f"{ROOM}/error-maps", json=body)
        shop.feed(21.0)
        with not_reading(shop, "min_change_um=0") as opened_:
            feeds = shop.service.state.streams._feeds
            until(lambda: feeds and feeds["mcfv5050"].table is not None)
            for i in range(count):
                number = feeds["mcfv5050"].table.number
                shop.feed_after(1, 21.0 + 0.05 * (i + 1))
                until(lambda number=number: feeds["mcfv5050"].table.number > number)
            newest = shop("GET", f"{ROOM}/compensation").json()["reading_time"]
            times = []
            for event in events_of(opened_):
                if event.name == "table":
                    times.append(event.content["reading_time"])
                    if times[-1] == newest:
                        break
    databases.give_back(url)
    assert times == sorted(times)
    assert len(times) < count // 2


@pytest.mark.slow
def test_who_does_not_read_at_all_is_let_go(databases, clock):
    url = databases.prepared("sqlite", furnish_database)
    with opened(url, clock, analyses=False, patience_s=0.2) as shop:
        log = shop.service.state.streams._log
        with not_reading(shop, "kind=event"):
            until(lambda: log._followers == 1)
            for _ in range(200):
                write(shop, ["x" * 50_000] * 5)
                if not log._followers:
                    break
            until(lambda: log._followers == 0)
    databases.give_back(url)

"""Followers of streams, of services that really listen, for tests."""

import json
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import httpx

from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from tests.service_examples import ROOM, UNHURRIED, problem, reading

NEWS = frozenset(("event", "watch", "analysis"))

PATH = f"{ROOM}/compensation/stream"


class Event(NamedTuple):
    name: str
    id: str
    content: dict

    @property
    def number(self):
        return int(self.id.partition("-")[0])


class Stream:
    """What one follower is told, event by event."""

    def __init__(self, lines):
        self._lines = lines
        self.last = None

    def begin(self):
        """Wait for the id with which news begin: what is written from here on is told."""
        self.last = next(line for line in self._lines if line.startswith("id: ")).removeprefix(
            "id: "
        )
        assert next(self._lines) == ""

    def next(self):
        """Give the next event, None at the end of the stream; heartbeats are passed over."""
        found, heartbeats = {}, 0
        for line in self._lines:
            heartbeats += line.startswith(":")
            assert heartbeats < 4, "nothing came for a minute"
            name, _, value = line.partition(": ")
            if line and name:
                found[name] = value
            elif found:
                self.last = found.get("id", self.last)
                if found.get("event") not in (None, "heartbeat"):
                    return Event(found["event"], found["id"], json.loads(found["data"]))
                found = {}
        return None

    def until(self, name):
        """Pass over other events."""
        while (event := self.next()) is not None:
            if event.name == name:
                return event
        return None


class Shop:
    """A service and its clock."""

    def __init__(self, url, clock, service):
        self.url, self.clock, self.service = url, clock, service
        self._client = httpx.Client(base_url=url, trust_env=False, timeout=60.0)

    def __call__(self, method, path, **stated):
        answer = self._client.request(method, path, **stated)
        assert answer.status_code < 300, answer.text
        return answer

    def close(self):
        self._client.close()

    def refused(self, path, status):
        return problem(self._client.get(path), status)

    def feed(self, t_c, **changes):
        self("POST", f"{ROOM}/readings", json=[reading(self.clock.time, t_c, **changes)])

    def feed_after(self, seconds, t_c, **changes):
        self.clock.advance(seconds)
        self.feed(t_c, **changes)

    @contextmanager
    def follow(self, path=PATH, last=None, headers=(), **query):
        headers = dict(headers)
        if last is not None:
            headers["Last-Event-ID"] = str(last)
        with self._client.stream("GET", path, params=query, headers=headers) as answer:
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith("text/event-stream")
            assert answer.headers["cache-control"] == "no-cache"
            stream = Stream(answer.iter_lines())
            if NEWS.intersection(query.get("kind", ())):
                stream.begin()
            yield stream


@contextmanager
def opened(database_url, clock, **options):
    """Serve a database, with a clock that is told the time."""
    service = create_app(Settings(database_url=database_url, **UNHURRIED | options))
    service.state.context = replace(service.state.context, now=clock)
    with listening("127.0.0.1", 0, "serve") as socket, serving(service, socket, "warning"):
        shop = Shop(url_of(socket), clock, service)
        try:
            yield shop
        finally:
            shop.close()

"""Long bodies without the collector of cycles, and what bounds that."""

import asyncio
import gc
import json
import threading
import weakref
from dataclasses import replace

import httpx
import pytest

from app.api import bodies, collector, uploads
from app.api.collector import uncollected
from app.api.long_bodies import AT_ONCE
from app.api.routes import loop
from app.api.turns import AT_WORK
from app.errors import InvalidContent
from app.services.verifications import store_verification
from tests.service_examples import ROOM, START, iso

OBSERVATION = {"time": iso(START), "component": "EXX", "position_mm": 250.0}
MANY = 12_000
"""Observations that make more than a megabyte."""


@pytest.fixture(autouse=True)
def collecting_afterwards():
    assert gc.isenabled()
    yield
    assert gc.isenabled()


def test_the_collector_comes_back_when_the_last_one_ends():
    with uncollected():
        with uncollected():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()


def test_it_comes_back_after_an_error():
    with pytest.raises(ValueError, match="wrong"), uncollected():
        raise ValueError("wrong")
    assert gc.isenabled()


def test_an_unbroken_row_of_long_bodies_does_not_keep_it_away_for_ever(monkeypatch):
    seconds = iter([0.0, collector.LONGEST_S - 1.0, collector.LONGEST_S + 1.0])
    monkeypatch.setattr(collector, "monotonic", lambda: next(seconds))
    with uncollected():
        with uncollected():
            assert not gc.isenabled()
        with uncollected():
            assert gc.isenabled()


@pytest.mark.anyio
@pytest.mark.parametrize(("count", "collects"), [(1, True), (MANY, False)])
async def test_what_a_long_body_said_is_gone_before_the_collector_is_back(
    client, monkeypatch, count, collects
):
    met = {}
    said = []

    def store_the_first(context, machine, verification):
        met["collects"] = gc.isenabled()
        met["observations"] = len(verification.observations)
        first = verification.observations[:1]
        return store_verification(context, machine, replace(verification, observations=first))

    class Noting(bodies.ReadRequest):
        def __init__(self, request, body, what):
            super().__init__(request, body, what)
            said.append(weakref.ref(what))

        def release(self):
            met["collects when let go"] = gc.isenabled()
            super().release()

    monkeypatch.setattr(loop, "store_verification", store_the_first)
    monkeypatch.setattr(bodies, "ReadRequest", Noting)
    observations = [OBSERVATION | {"measured_um": 0.001 * i} for i in range(count)]
    body = json.dumps({"label": "long", "observations": observations})
    assert (len(body) > bodies.MEGABYTE) is not collects
    headers = {"content-type": "application/json"}
    answer = await client.post(f"{ROOM}/verifications", content=body, headers=headers)
    assert answer.status_code == 201
    assert met == {
        "collects": collects,
        "observations": count,
        "collects when let go": collects,
    }
    assert said[0]() is None


def sending_from(app, address):
    transport = httpx.ASGITransport(app=app, client=(address, 1), raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://localhost")


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("path", "routes", "read"),
    [
        (f"{ROOM}/files?kind=check", uploads, "read_uploaded_verification"),
        (f"{ROOM}/files?kind=map", uploads, "read_uploaded_map"),
        (f"{ROOM}/files?expected=map", uploads, "read_uploaded_map"),
    ],
)
async def test_few_files_are_read_at_once_and_without_it_and_hold_no_turn(
    client, app, monkeypatch, path, routes, read
):
    going_on, lock = threading.Event(), threading.Lock()
    now, met = [], []

    def wait(*_asked, **_stated):
        with lock:
            now.append(1)
            met.append((len(now), gc.isenabled(), app.state.turns._free.value))
        try:
            assert going_on.wait(60)
        finally:
            with lock:
                now.pop()
        raise InvalidContent.of_field("file", "expected nothing at all, got this")

    monkeypatch.setattr(routes, read, wait)
    headers = {"content-type": "text/csv"}
    senders = [sending_from(app, f"192.0.2.{i}") for i in (1, 1, 2, 2, 3)]
    asked = [asyncio.create_task(one.post(path, content="1", headers=headers)) for one in senders]
    async with asyncio.timeout(60):
        while len(met) < AT_ONCE:
            await asyncio.sleep(0.01)
        # Others could begin to read now, and are asked whether the service answers.
        assert (await client.get(ROOM)).status_code == 200
        assert len(met) == AT_ONCE
        going_on.set()
        answers = await asyncio.gather(*asked)
    assert [one.status_code for one in answers] == [422] * 5
    assert len(met) == 5
    assert max(count for count, _, _ in met) == AT_ONCE
    assert {(collects, free) for _, collects, free in met} == {(False, AT_WORK)}

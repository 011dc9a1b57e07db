"""Long bodies without the collector of cycles, and what bounds that."""

import gc
import json
import weakref
from dataclasses import replace

import pytest

from app.api import bodies, collector
from app.api.collector import uncollected
from app.api.routes import verifications
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

    class Noting(bodies._ReadRequest):
        def __init__(self, request, body, what):
            super().__init__(request, body, what)
            said.append(weakref.ref(what.observations[0]))

        def release(self):
            met["collects when let go"] = gc.isenabled()
            super().release()

    monkeypatch.setattr(verifications, "store_verification", store_the_first)
    monkeypatch.setattr(bodies, "_ReadRequest", Noting)
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

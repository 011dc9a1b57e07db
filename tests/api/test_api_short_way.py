"""The short way to the table says what the ordinary way says, to the last byte but the time."""

import json
from datetime import datetime

import pytest
from fastapi import FastAPI

from app.api.schemas.compensation import CompensationAnswer
from app.api.short_way import LARGEST_PLAIN_BODY, plain_answer
from tests.service_examples import client_of

pytestmark = pytest.mark.anyio
PATH = "/v1/machines/mcfv5050/compensation"
PLAIN = {"x-middle": 24.1, "y-front": 23.9, "z-column": 25.2, "spindle": 26.0}
BODIES = {
    "plain": {"temperatures_c": PLAIN},
    "with a state": {"temperatures_c": PLAIN, "state": {"spindle_rpm": 8000}},
    "at a map": {"temperatures_c": PLAIN | {"x-middle": 20.0}},
    "clamped": {"temperatures_c": PLAIN | {"z-column": 60.0}},
    "stand-in": {"temperatures_c": {k: t for k, t in PLAIN.items() if k != "x-middle"}},
    "out of range": {"temperatures_c": PLAIN | {"x-middle": 120.0}},
    "kelvin": {"temperatures_c": PLAIN | {"x-middle": 297.0}},
    "unknown sensor": {"temperatures_c": PLAIN | {"nowhere": 20.0}},
    "none": {"temperatures_c": {}},
    "unknown field": {"temperatures_c": PLAIN, "more": 1},
    "no object": [1],
}


class OrdinaryWay:
    """The same service without its short way."""

    def __init__(self, service):
        self.service = service
        self.state = service.state

    async def __call__(self, scope, receive, send):
        await FastAPI.__call__(self.service, scope, receive, send)


@pytest.fixture
async def both(app):
    async with client_of(app) as short, client_of(OrdinaryWay(app)) as ordinary:
        yield short, ordinary


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("machine", ["mcfv5050", "nowhere"])
async def test_both_ways_answer_alike(both, machine, body):
    path = PATH.replace("mcfv5050", machine)
    first = await both[0].post(path, json=body)
    again = await both[0].post(path, json=body)
    ordinary = await both[1].post(path, json=body)
    assert first.status_code == again.status_code == ordinary.status_code
    assert first.content == again.content == ordinary.content
    assert first.headers["content-type"] == ordinary.headers["content-type"]


async def test_the_time_is_the_present_one_however_often_it_is_asked(both, clock):
    for _ in range(3):
        answer = (await both[0].post(PATH, json=BODIES["plain"])).json()
        assert datetime.fromisoformat(answer["computed_at"]) == clock()
        clock.advance(0.25)


async def test_what_is_remembered_does_not_outlive_the_model(both):
    client = both[0]
    before = (await client.post(PATH, json=BODIES["clamped"])).json()
    await client.patch("/v1/machines/mcfv5050", json={"out_of_range": "reject"})
    refused = await client.post(PATH, json=BODIES["clamped"])
    assert refused.status_code == 422
    await client.patch("/v1/machines/mcfv5050", json={"out_of_range": "clamp"})
    after = (await client.post(PATH, json=BODIES["clamped"])).json()
    assert after["components"] == before["components"]


async def test_it_steps_aside_while_the_database_is_away(app, both, clock):
    await both[0].post(PATH, json=BODIES["plain"])
    app.state.context.live.database_away_since = clock()
    answer = (await both[0].post(PATH, json=BODIES["plain"])).json()
    assert "the database has been away" in answer["warnings"][0]


async def test_a_plain_request_takes_it_and_no_other(app, both):
    body = json.dumps(BODIES["plain"]).encode()
    assert plain_answer(app.state.context, "mcfv5050", body) is None, "not in memory yet"
    await both[0].post(PATH, json=BODIES["plain"])
    CompensationAnswer.model_validate_json(plain_answer(app.state.context, "mcfv5050", body))
    assert plain_answer(app.state.context, "mcfv5050", body[:-1]) is None
    assert plain_answer(app.state.context, "nowhere", body) is None


@pytest.mark.parametrize("spaces", [0, LARGEST_PLAIN_BODY, 100_000])
async def test_long_bodies_are_answered_too(both, spaces):
    body = json.dumps(BODIES["plain"]).encode() + b" " * spaces
    answer = await both[0].post(PATH, content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 200


@pytest.mark.parametrize("parts", [1, 2, 7])
async def test_a_body_in_parts_is_read_whole(both, parts):
    body = json.dumps(BODIES["plain"]).encode()
    size = -(-len(body) // parts)

    async def pieces():
        for start in range(0, len(body), size):
            yield body[start : start + size]

    answer = await both[0].post(
        PATH, content=pieces(), headers={"content-type": "application/json"}
    )
    assert answer.status_code == 200
    assert answer.content == (await both[1].post(PATH, json=BODIES["plain"])).content

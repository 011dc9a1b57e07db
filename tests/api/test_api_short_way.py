"""The short way to the table says what the ordinary way says, to the last byte but the time."""

import asyncio
import gc
import json
from datetime import datetime
from weakref import ref

import pytest
from fastapi import FastAPI
from hypothesis import given, settings
from hypothesis import strategies as st

from app.api.schemas.compensation import CompensationAnswer
from app.api.short_way.tables import LARGEST_PLAIN_BODY, Answers, plain_answer
from app.live.database_watch import TroubleKind
from tests.service_examples import client_of, furnish_database, running

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
        refused = self.state.gate.refusal(scope)
        if refused is None:
            await FastAPI.__call__(self.service, scope, receive, send)
        else:
            await refused(scope, receive, send)


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


@pytest.mark.slow
async def test_a_model_is_not_held_by_what_is_remembered_of_it(app, both):
    client = both[0]
    for _ in range(2):  # the first brings the machine into memory, the second is remembered
        await client.post(PATH, json=BODIES["clamped"])
    former = ref(app.state.context.live.get("mcfv5050").current)
    await client.patch("/v1/machines/mcfv5050", json={"out_of_range": "reject"})
    await client.post(PATH, json=BODIES["clamped"])
    gc.collect()
    assert former() is None


async def test_what_is_remembered_has_a_bounded_size(app, both, monkeypatch):
    kept = Answers(100_000)
    monkeypatch.setattr("app.api.short_way.tables.ANSWERS", kept)
    sizes = []
    for i in range(100):
        body = {"temperatures_c": PLAIN | {"spindle": 26.0 + 0.01 * i}}
        answer = await both[0].post(PATH, json=body)
        assert answer.content == (await both[0].post(PATH, json=body)).content
        sizes.append(kept.bytes)
    assert max(sizes) <= 100_000
    assert sizes[-1] > 50_000, "nothing was kept"
    for text in (answer for pair in kept._kept.values() for answer in pair):
        kept.bytes -= len(text)
    assert 0 < kept.bytes < 50_000, "what is kept was not all counted"


async def test_it_steps_aside_while_the_database_is_away(app, both, clock):
    await both[0].post(PATH, json=BODIES["plain"])
    app.state.context.live.database.note_trouble(TroubleKind.AWAY, clock())
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


NAMES = st.sampled_from([*PLAIN, "nowhere", "", "a:b", "temperatures_c", "x\\u002dmiddle"])
NUMBERS = st.one_of(
    st.floats(-300, 400).map(repr),
    st.sampled_from(
        [
            *["24", "-0", "1e400", "NaN", "-Infinity", "1e-400", "01", "1.", "+1", "true", "null"],
            *['"24.1"', "[]", "{}", "[[[[]]]]", '"\\ud800"', "24.100000000000001"],
            *["9" * 30, "9" * 5000],
        ]
    ),
)
OBJECTS = st.lists(st.tuples(NAMES, NUMBERS), max_size=6).map(
    lambda pairs: "{" + ", ".join(f'"{name}": {number}' for name, number in pairs) + "}"
)
PLAIN_TEXT = json.dumps(PLAIN)
FIELDS = st.lists(
    st.tuples(
        st.sampled_from(["temperatures_c"] * 2 + ["state", "more", "temperatures\\u005fc"]),
        st.one_of(OBJECTS, st.just(PLAIN_TEXT), NUMBERS),
    ),
    max_size=3,
)
WRITTEN = st.one_of(
    OBJECTS.map(lambda stated: f'{{"temperatures_c": {PLAIN_TEXT}, "state": {stated}}}'),
    OBJECTS.map(lambda stated: f'{{"temperatures_c": {stated}}}'),
    FIELDS.map(lambda pairs: "{" + ",".join(f'"{k}":{v}' for k, v in pairs) + "}"),
).map(str.encode)
DAMAGED = st.tuples(WRITTEN, st.integers(0, 400), st.binary(max_size=3)).map(
    lambda drawn: drawn[0][: drawn[1]] + drawn[2] + drawn[0][drawn[1] + 1 :]
)
REPEATED = st.sampled_from(
    [
        '{"temperatures_c": {"x-middle": 21, "z-column": 23, "x-middle": 21}}',
        '{"temperatures_c": {"x-middle": 21, "z-column": 23, "x\\u002dmiddle": 22}}',
        f'{{"temperatures_c": {{}}, "temperatures_c": {PLAIN_TEXT}}}',
        f'{{"temperatures_c": {PLAIN_TEXT}, "state": {{"a": 1, "a": 1}}}}',
        f'{{"state": {{"a:b": 1, "a": 1}}, "temperatures_c": {PLAIN_TEXT}, "state": {{}}}}',
    ]
).map(str.encode)
BYTES = st.one_of(
    WRITTEN,
    REPEATED,
    DAMAGED,
    WRITTEN.map(lambda body: b"\xef\xbb\xbf" + body),
    WRITTEN.map(lambda body: body.decode().encode("utf-16")),
    WRITTEN.map(lambda body: body + b" " * LARGEST_PLAIN_BODY),
    st.binary(max_size=8),
)
TYPES = st.sampled_from(
    ["application/json"] * 8
    + [
        "application/json; charset=utf-8",
        "APPLICATION/JSON",
        "text/plain",
        "",
        "application/a+json",
    ]
)
HEADERS = st.fixed_dictionaries(
    {"content-type": TYPES},
    optional={
        "accept": st.sampled_from(["text/html", "*/*"]),
        "origin": st.sampled_from(["http://localhost", "http://evil.example", "null"]),
        "host": st.sampled_from(["localhost", "127.0.0.1:1", "evil.example"]),
        "sec-fetch-site": st.sampled_from(["same-origin", "cross-site"]),
        "if-none-match": st.just("*"),
        "content-encoding": st.just("gzip"),
    },
)
MACHINES = st.sampled_from(["mcfv5050"] * 6 + ["nowhere", "", "mcfv5050/", "%6dcfv5050", "a/b"])
QUERIES = st.sampled_from([""] * 6 + ["?", "?detail=full", "?temperatures_c=1", "?=", "?%"])


@pytest.fixture(scope="module")
def two_ways(databases):
    """The same service by both ways, with the machine in memory."""
    url = databases.prepared("sqlite", furnish_database)
    with running(url) as service:
        yield service, OrdinaryWay(service)
    databases.give_back(url)


@pytest.mark.slow
@settings(max_examples=300)
@given(machine=MACHINES, query=QUERIES, headers=HEADERS, body=BYTES, in_parts=st.booleans())
def test_whatever_is_asked_both_ways_answer_alike(
    two_ways, machine, query, headers, body, in_parts
):
    path = f"/v1/machines/{machine}/compensation{query}"

    async def ask():
        answers = []
        for service in two_ways:
            async with client_of(service) as client:
                for _ in range(2):
                    content = pieces() if in_parts else body
                    answer = await client.post(path, content=content, headers=headers)
                    # Each request has a number of its own.
                    headed = {k: v for k, v in answer.headers.items() if k != "x-request-id"}
                    answers.append((answer.status_code, headed, answer.content))
        return answers

    async def pieces():
        yield body[: len(body) // 2]
        yield body[len(body) // 2 :]

    first, *others = asyncio.run(ask())
    assert all(other == first for other in others)

"""A table is asked for in whatever bytes: it is given, or what is wrong is said."""

import asyncio
import json
from datetime import datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.api.table_json import CompensationAnswer
from tests.service_examples import client_of, furnish_database, problem, running

pytestmark = pytest.mark.anyio
PATH = "/v1/machines/mcfv5050/compensation"
PLAIN = {"x-middle": 24.1, "y-front": 23.9, "z-column": 25.2, "spindle": 26.0}
AS_JSON = {"content-type": "application/json"}


async def test_the_time_is_the_present_one_however_often_it_is_asked(client, clock):
    for _ in range(3):
        answer = (await client.post(PATH, json={"temperatures_c": PLAIN})).json()
        assert datetime.fromisoformat(answer["computed_at"]) == clock()
        clock.advance(0.25)


@pytest.mark.parametrize("spaces", [0, 4096, 100_000])
async def test_long_bodies_are_answered_too(client, spaces):
    body = json.dumps({"temperatures_c": PLAIN}).encode() + b" " * spaces
    assert (await client.post(PATH, content=body, headers=AS_JSON)).status_code == 200


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
        f'{{"temperatures_c": {PLAIN_TEXT}, "state": {{"": 1, "": 1}}}}',
        f'{{"state": {{"a:b": 1, "a": 1}}, "temperatures_c": {PLAIN_TEXT}, "state": {{}}}}',
    ]
).map(str.encode)
BYTES = st.one_of(
    WRITTEN,
    REPEATED,
    DAMAGED,
    WRITTEN.map(lambda body: b"\xef\xbb\xbf" + body),
    WRITTEN.map(lambda body: body.decode().encode("utf-16")),
    WRITTEN.map(lambda body: body + b" " * 20_000),
    st.binary(max_size=8),
)


def expect_unlike_names(pairs):
    """Refuse what stands twice in an object."""
    if len(dict(pairs)) < len(pairs):
        raise ValueError("a name twice")
    return dict(pairs)


def is_clear(body):
    """Whether the standard library takes it for JSON in UTF-8 without a name twice."""
    try:
        json.loads(body.decode(), object_pairs_hook=expect_unlike_names)
    except ValueError:
        return False
    return True


@pytest.fixture(scope="module")
def service(databases):
    url = databases.prepared("sqlite", furnish_database)
    with running(url) as service:
        yield service
    databases.give_back(url)


@pytest.mark.slow
@settings(max_examples=300)
@given(body=BYTES, in_parts=st.booleans())
def test_whatever_is_written_is_answered_or_refused_in_words(service, body, in_parts):
    async def pieces():
        yield body[: len(body) // 2]
        yield body[len(body) // 2 :]

    async def ask():
        async with client_of(service) as client:
            content = pieces() if in_parts else body
            return await client.post(PATH, content=content, headers=AS_JSON)

    answer = asyncio.run(ask())
    if answer.status_code == 200:
        assert is_clear(body)
        CompensationAnswer.model_validate_json(answer.content)
    else:
        assert problem(answer, 422)["errors"]

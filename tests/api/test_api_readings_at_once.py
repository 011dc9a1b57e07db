"""Readings that are stored at once: answered, stored and held as what is looked at closely."""

import asyncio
import json
import threading
from contextlib import contextmanager, nullcontext
from datetime import timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from app.api.bodies import _checked
from app.api.routes import readings as routes
from app.api.routes import readings as schemas
from app.api.routes.readings import _MOST_AT_ONCE, OneOrMoreReadings
from app.errors import StorageFull, StorageUnavailable
from app.live.database_watch import TroubleKind
from app.services import readings as service_of_readings
from app.services.readings import store_at_once
from app.services.together import MOST_TOGETHER
from app.storage.readings import insert_readings, list_readings
from app.thermal.reading import Reading
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    furnish_database,
    iso,
    reading,
    running,
    temperatures,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/readings"
ROUTE = "/v1/machines/{machine}/readings"
OTHER = "mcfv5051"
"""A machine with the same sensors, to which the same is sent and looked at closely."""

AS_JSON = {"content-type": "application/json"}


def at(seconds, t_c=22.0, **changes):
    """A reading so long after the clock's time."""
    return reading(START + timedelta(seconds=seconds), t_c, **changes)


def without(stated, *names):
    return {name: value for name, value in stated.items() if name not in names}


def text(time="2026-03-01T05:00:00Z", temperatures_c='{"spindle": 20}', more=""):
    """A reading as JSON text, to write what no library would."""
    return f'{{"time": "{time}", "temperatures_c": {temperatures_c}{more}}}'


PLAIN = {
    "one": at(-60),
    "a list": [at(-50), at(-49)],
    "one in a list": [at(-50)],
    "without a state": without(at(-40), "state"),
    "with states": [at(-40, state={"rpm": 8000, "x:y": -0.5}), at(-39, state={"rpm": 0})],
    "one sensor": at(-30, temperatures_c={"spindle": 20}),
    "other sensors each": [
        at(-30, temperatures_c={"spindle": 20}),
        at(-29, temperatures_c={"z-column": 20.5, "spindle": 20.0}),
        at(-28, temperatures_c={"spindle": 20, "z-column": 20.5}),
    ],
    "not in order": [at(-20), at(-22), at(-21)],
    "twice the same": [at(-20), at(-20)],
    "out of range": [at(-10, temperatures_c={"x-middle": 140.0}), at(-9)],
    "ahead by what clocks differ": at(2),
    "ahead": [at(0), at(2.000001), at(60), at(3600)],
    "fractions": text("2026-03-01T05:00:00.1+00:00"),
    "microseconds": text("2026-03-01T05:00:00.123456Z"),
    "long ago": text("1900-01-01T00:00:00Z"),
    "spaces": f" \r\n[ {text()} ]\t",
    "escapes": text(temperatures_c='{"s\\u0070indle": 2.0e1}'),
    "many digits": text(temperatures_c='{"spindle": 24.100000000000001, "z-column": -0}'),
    "a hundred": [at(-600 + i, temperatures_c={"spindle": 20.0 + i / 100}) for i in range(100)],
    "a day ahead": at(24 * 3600),
}
ODD = {
    "nothing": "",
    "no JSON": "[",
    "an empty list": [],
    "a number": 1,
    "null": None,
    "a list in a list": [[at(-60)]],
    "a named list": {"readings": [at(-60)]},
    "unknown sensor": [at(-60), at(-59, temperatures_c={"nose": 20.0})],
    "unknown sensor first": [at(-60, temperatures_c={"nose": 20.0}), at(-59)],
    "kelvin": [at(-60), at(-59, temperatures_c={"spindle": 295.0})],
    "no temperature": [at(-60), at(-59, temperatures_c={})],
    "no temperatures": without(at(-60), "temperatures_c"),
    "no time": without(at(-60), "time"),
    "unknown field": at(-60) | {"early_s": 1.0},
    "unknown field in a list": [at(-60), at(-59) | {"more": 1}],
    "a boolean": at(-60, temperatures_c={"spindle": True}),
    "a text": at(-60, temperatures_c={"spindle": "20"}),
    "nothing measured": at(-60, temperatures_c={"spindle": None}),
    "NaN": text(temperatures_c='{"spindle": NaN}'),
    "infinity": text(temperatures_c='{"spindle": Infinity}'),
    "too large": text(temperatures_c='{"spindle": 1e400}'),
    "a sensor twice": text(temperatures_c='{"spindle": 20, "spindle": 20}'),
    "a sensor twice, escaped": text(temperatures_c='{"spindle": 20, "s\\u0070indle": 21}'),
    "a field twice": text(more=', "time": "2026-03-01T05:00:00Z"'),
    "a state twice": text(more=', "state": {"a": 1, "a": 1}'),
    "no state": at(-60, state=None),
    "state without name": at(-60, state={"": 1}),
    "state with a long name": at(-60, state={"a" * 201: 1}),
    "state with a control character": at(-60, state={"a\n": 1}),
    "state that is no number": at(-60, state={"a": False}),
    "without zone": text("2026-03-01T05:00:00"),
    "another zone": text("2026-03-01T07:00:00+02:00"),
    "in words of ISO 8601": text("2026-03-01T05:00Z"),
    "small letters": text("2026-03-01t05:00:00z"),
    "a day only": text("2026-03-01"),
    "seconds since 1970": text("1772341200"),
    "a number as time": at(-60) | {"time": 1772341200},
    "no such day": text("2026-02-30T05:00:00Z"),
    "no such hour": text("2026-03-01T24:00:00Z"),
    "a leap second": text("2016-12-31T23:59:60Z"),
    "no such minute": text("2026-03-01T05:60:00Z"),
    "nanoseconds": text("2026-03-01T05:00:00.123456789Z"),
    "before 1900": text("1899-12-31T23:59:59Z"),
    "after 2999": text("3000-01-01T00:00:00Z"),
    "more than a day ahead": [at(-60), at(24 * 3600 + 1)],
    "other content at one time": [at(-60), at(-60, 23.0)],
    "another": f"{text()} {text()}",
    "no UTF-8": b'{"time": "\xff"}',
    "with a mark": b"\xef\xbb\xbf" + text().encode(),
    "too long": [at(-i, state={"filled": 0}) for i in range(_MOST_AT_ONCE + 1)],
}


def written(body):
    if isinstance(body, bytes):
        return body
    return body.encode() if isinstance(body, str) else json.dumps(body).encode()


CHECKED = TypeAdapter(OneOrMoreReadings)


@pytest.fixture
async def both(app):
    """A client, and a machine for each of two ways, in memory."""
    async with client_of(app) as client:
        assert (await client.post("/v1/machines", json=MACHINE | {"id": OTHER})).is_success
        for machine in (MACHINE["id"], OTHER):
            path = f"/v1/machines/{machine}/readings"
            assert (await client.post(path, json=at(-7200))).status_code == 201
        yield client


@contextmanager
def looked_at_closely():
    """Let nothing be plain: each reading is explained, and stored by who looks closer."""

    async def never(*_asked):
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schemas, "_MOST_AT_ONCE", -1)
        patch.setattr(routes, "store_at_once", never)
        yield


async def by_both(client, body):
    """Send the same at once and to be looked at; give what is said, without the machine's name."""
    answers = []
    for machine, how in ((MACHINE["id"], nullcontext()), (OTHER, looked_at_closely())):
        path = f"/v1/machines/{machine}/readings"
        with how:
            answer = await client.post(path, content=written(body), headers=AS_JSON)
        headed = {k: v for k, v in answer.headers.items() if k != "x-request-id"}
        said = answer.content.replace(OTHER.encode(), MACHINE["id"].encode())
        answers.append((answer.status_code, headed, said))
    return answers


def kept(app, machine):
    """What the database and memory have of a machine, with all that equality leaves out."""
    context = app.state.context
    with context.database.reading() as session:
        stored = list(list_readings(session, machine))
    live = context.live.get(machine)
    held = live.readings.held
    return [
        [(r.time, list(r.temperatures_c.items()), dict(r.state), r.early_s) for r in part]
        for part in (stored, held.used, held.ahead)
    ]


@pytest.mark.parametrize("body", (PLAIN | ODD).values(), ids=PLAIN | ODD)
async def test_looked_at_or_not_it_is_answered_and_stored_alike(app, both, body):
    for _ in range(2):  # the second time they are there already
        at_once, looked_at = await by_both(both, body)
        assert at_once == looked_at
        assert kept(app, MACHINE["id"]) == kept(app, OTHER)


@pytest.mark.parametrize("body", PLAIN.values(), ids=PLAIN)
async def test_what_is_right_and_new_is_stored_at_once(app, both, body):
    sent = _checked(CHECKED, written(body))
    stored = await store_at_once(app.state.context, MACHINE["id"], sent.readings)
    assert stored.stored >= 1


async def test_who_would_be_told_something_else_is_looked_at(app, both, clock):
    context, sent = app.state.context, _checked(CHECKED, written(at(-60))).readings
    assert await store_at_once(context, "nowhere", sent) is None
    context.live.database.note_trouble(TroubleKind.AWAY, clock())
    assert await store_at_once(context, MACHINE["id"], sent) is None
    context.live.database.note_recovery()
    assert (await store_at_once(context, MACHINE["id"], sent)).stored == 1
    assert await store_at_once(context, MACHINE["id"], sent) is None, "it is there already"


async def test_a_body_longer_than_the_service_allows_is_refused(new_app, furnished_url):
    service = new_app(furnished_url, max_body_bytes=4096)
    async with client_of(service) as client:
        assert (await client.post(PATH, json=at(-60))).status_code == 201
        body = written(at(-30)) + b" " * 4096
        assert (await client.post(PATH, content=body, headers=AS_JSON)).status_code == 413


@pytest.mark.parametrize("size", [1, 2, 40])
async def test_many_at_once_are_all_stored(app, both, size):
    bodies = [[at(-3600 + size * i + j) for j in range(size)] for i in range(MOST_TOGETHER + 30)]
    answers = await asyncio.gather(*(both.post(PATH, json=body) for body in bodies))
    assert {a.status_code for a in answers} == {201}
    assert sum(a.json()["stored"] for a in answers) == size * len(bodies)
    stored, used, _ = kept(app, MACHINE["id"])
    assert len(stored) == size * len(bodies) + 1
    assert used[-1] == stored[-1]


async def test_what_was_stored_elsewhere_meanwhile_is_found(app, both):
    there = Reading(START - timedelta(seconds=30), temperatures(22.0), {})
    for machine in (MACHINE["id"], OTHER):
        with app.state.context.database.writing() as session:
            insert_readings(session, {machine: [there]})
    for body in (at(-30), [at(-31), at(-30)], [at(-29), at(-30, 23.0)]):
        at_once, looked_at = await by_both(both, body)
        assert at_once == looked_at
        assert kept(app, MACHINE["id"])[0] == kept(app, OTHER)[0]


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (StorageUnavailable("the database is away: gone"), 503),
        (StorageFull("the disk of the database is full, nothing was stored"), 507),
        (RuntimeError("nobody expects it"), 500),
    ],
)
async def test_what_keeps_it_from_being_stored_is_said_alike(both, monkeypatch, error, status):
    def fails(*_asked, **_named):
        raise error

    monkeypatch.setattr(service_of_readings, "readings_inserted", fails)
    at_once, looked_at = await by_both(both, at(-60))
    assert at_once[0] == looked_at[0] == status
    if status != 500:  # each says at which request the log has the details
        assert at_once[1]["retry-after"] == "5"
        assert at_once == looked_at


async def test_others_are_answered_while_the_database_takes_its_time(both, monkeypatch):
    insert = service_of_readings.readings_inserted
    began, goes_on = threading.Event(), threading.Event()

    def slow(*asked, **named):
        began.set()
        assert goes_on.wait(60.0)
        return insert(*asked, **named)

    monkeypatch.setattr(service_of_readings, "readings_inserted", slow)
    sent = asyncio.create_task(both.post(PATH, json=at(-60)))
    while not began.is_set():
        await asyncio.sleep(0.01)
    table = await both.post(f"{ROOM}/compensation", json={"temperatures_c": temperatures(24.0)})
    assert table.status_code == 200
    assert not sent.done()
    goes_on.set()
    assert (await sent).status_code == 201


async def test_it_is_counted(both):
    def count(metrics):
        wanted = f'method="POST",route="{ROUTE}",status="201"}}'
        return sum(
            float(line.split()[-1])
            for line in metrics.text.splitlines()
            if line.startswith("thermap_requests_total") and wanted in line
        )

    before = count(await both.get("/metrics"))
    assert (await both.post(PATH, json=at(-60))).status_code == 201
    assert count(await both.get("/metrics")) == before + 1


SENSORS = st.sampled_from(["spindle", "z-column", "x-middle", "y-front", "nose", "", "a:b"])
NUMBERS = st.one_of(
    st.floats(-300, 400).map(repr),
    st.sampled_from(["20", "-0", "1e400", "NaN", "01", "true", "null", '"20"', "[]", "9" * 400]),
)
NAMED = st.lists(st.tuples(SENSORS, NUMBERS), max_size=4).map(
    lambda pairs: "{" + ", ".join(f'"{name}": {number}' for name, number in pairs) + "}"
)
GOOD = st.floats(-5, 70).map(lambda t_c: f'{{"spindle": {t_c!r}}}')
TIMES = st.one_of(
    st.integers(-4000, 100).map(lambda s: iso(START + timedelta(seconds=s))),
    st.sampled_from(
        [
            "2026-03-01T05:00:00",
            "2026-03-01T05:00:00+00:00",
            "2026-03-01T05:00:00-00:00",
            "2026-03-01T05:00:00+01:00",
            "2026-02-29T05:00:00Z",
            "2026-03-01 05:00:00Z",
            "2026-03-01T05:00:00,5Z",
            "2026-03-01T05:00:00.5Z",
            "2026-W09-7T05:00:00Z",
            "20260301T050000Z",
            "0001-01-01T00:00:00Z",
            "9999-12-31T23:59:59Z",
            "1772341200",
            "",
        ]
    ),
)
MORE = st.sampled_from(
    [""] * 6
    + [
        ', "state": {}',
        ', "state": {"rpm": 1}',
        ', "state": null',
        ', "early_s": 1',
        ', "state": 1',
    ]
)
ENTRIES = st.builds(text, TIMES, st.one_of(GOOD, GOOD, GOOD, NAMED), MORE)
WRITTEN = st.one_of(
    ENTRIES, st.lists(ENTRIES, max_size=4).map(lambda entries: f"[{', '.join(entries)}]")
).map(str.encode)
DAMAGED = st.tuples(WRITTEN, st.integers(0, 200), st.binary(max_size=2)).map(
    lambda drawn: drawn[0][: drawn[1]] + drawn[2] + drawn[0][drawn[1] + 1 :]
)


@pytest.fixture(scope="module")
def two_machines(databases):
    """A service with two machines alike in memory."""
    url = databases.prepared("sqlite", furnish_database)
    with running(url) as service:

        async def make():
            async with client_of(service) as client:
                assert (await client.post("/v1/machines", json=MACHINE | {"id": OTHER})).is_success
                for machine in (MACHINE["id"], OTHER):
                    path = f"/v1/machines/{machine}/readings"
                    assert (await client.post(path, json=at(-7200))).status_code == 201

        asyncio.run(make())
        yield service
    databases.give_back(url)


@pytest.mark.slow
@settings(max_examples=300)
@given(body=st.one_of(WRITTEN, WRITTEN, DAMAGED))
def test_whatever_is_sent_is_answered_and_stored_alike(two_machines, body):
    async def send():
        async with client_of(two_machines) as client:
            return await by_both(client, body)

    at_once, looked_at = asyncio.run(send())
    assert at_once == looked_at
    assert kept(two_machines, MACHINE["id"]) == kept(two_machines, OTHER)

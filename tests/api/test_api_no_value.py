"""A sensor whose sender says that it has no value is named at once, until a value comes."""

import json
from datetime import timedelta

import pytest

from app.connections.intake import Intake
from app.connections.known_values import KnownValues
from tests.api.test_api_dashboard import feed, shown
from tests.service_examples import ROOM, START, iso, problem, reading

pytestmark = pytest.mark.anyio

MACHINE = "mcfv5050"


async def status(client):
    return (await client.get(f"{ROOM}/status")).json()


async def since_of(client, sensor="x-middle"):
    sensors = {one["sensor"]: one for one in (await status(client))["sensors"]}
    return sensors[sensor]["no_value_since"]


def at(seconds):
    return START + timedelta(seconds=seconds)


def without(time, *names, **values):
    return {"time": iso(time), "temperatures_c": {**dict.fromkeys(names), **values}}


async def test_null_in_a_reading_is_named_at_once_and_until_a_value_comes(client, clock):
    await feed(client, reading(START, 27.0))
    assert (await status(client))["state"] == "fresh"
    clock.time = at(2)
    answer = await client.post(f"{ROOM}/readings", json=without(at(2), "x-middle", spindle=30.0))
    assert (answer.status_code, answer.json()["stored"]) == (201, 1)
    found = await status(client)
    assert (found["verdict"], found["state"], found["about"]) == ("limited", "late", ["x-middle"])
    assert found["since"] == iso(at(2))
    assert found["sentences"][0].startswith(
        "x-middle has no value since 06:00 UTC, by what its sender says: "
    )
    assert "rest on its last one" in found["sentences"][0]
    assert await since_of(client) == iso(at(2))
    assert "no value" in (await shown(client, f"/machines/{MACHINE}")).text
    # It lasts since it was said first, and what was measured before does not end it.
    clock.time = at(5)
    await client.post(f"{ROOM}/readings", json=without(at(5), "x-middle", spindle=30.0))
    await feed(client, reading(at(1), 27.0))
    assert await since_of(client) == iso(at(2))
    clock.time = at(6)
    await feed(client, reading(at(6), 27.0))
    assert await since_of(client) is None
    assert (await status(client))["state"] == "fresh"


async def test_of_several_readings_the_latest_word_counts(client, clock):
    await feed(client, reading(START, 27.0))
    clock.time = at(9)
    value = {"x-middle": 27.0}
    several = [without(at(1), "x-middle", spindle=30.0), without(at(2), **value)]
    await client.post(f"{ROOM}/readings", json=several)
    assert await since_of(client) is None
    several = [without(at(t), "x-middle", spindle=30.0) for t in (5, 6)]
    await client.post(f"{ROOM}/readings", json=[without(at(4), "x-middle"), *several])
    assert await since_of(client) == iso(at(4))
    # A recording of before does not take away what is known since.
    await feed(client, reading(at(8), 27.0))
    await client.post(f"{ROOM}/readings", json=without(at(7), "x-middle", spindle=30.0))
    assert await since_of(client) is None


async def test_a_reading_without_any_value_is_not_stored_and_an_unknown_sensor_refused(client):
    answer = await client.post(f"{ROOM}/readings", json=without(START, "x-middle"))
    assert answer.status_code == 201
    assert answer.json() == {
        "stored": 0,
        "duplicates": 0,
        "warnings": ["1 reading without a value not stored"],
    }
    assert await since_of(client) is not None
    first = "; ".join((await status(client))["sentences"])
    assert "x-middle has no value since" in first
    for body in (without(START, "nobody"), [without(START, "x-middle"), without(START, "nobody")]):
        errors = problem(await client.post(f"{ROOM}/readings", json=body), 422)["errors"]
        assert errors[0]["field"].endswith("temperatures_c.nobody")
    other = {"time": iso(START), "temperatures_c": {"x-middle": None}}
    problem(await client.post("/v1/machines/none/readings", json=other), 404)


def followers(intake):
    """Give what each kind of follower does when a value goes and comes."""
    from app.connections.mqtt_readers import MessageValues
    from tests.connections.test_mqtt_limits import connection_of

    known = KnownValues(intake, MACHINE, ["x-middle"], ["load"])
    yield lambda value: known.take({"x-middle": value, "load": 1.0})
    mqtt = connection_of(intake, machine=MACHINE, sensor="x-middle", value="v")
    topic = mqtt._table.topics[0]

    def send(value):
        told = {} if value is None else {"x-middle": value}
        gone = ("x-middle",) if value is None else ()
        mqtt._offer(topic, MessageValues(MACHINE, told, without=gone), "t")

    yield send


@pytest.mark.parametrize("kind", [0, 1])
async def test_followers_say_at_once_that_a_value_is_gone_and_that_it_is_back(
    client, app, clock, kind
):
    await feed(client, reading(START, 27.0))
    take = list(followers(Intake(lambda: app.state.context)))[kind]
    take(27.0)
    assert await since_of(client) is None
    clock.time = at(3)
    take(None)
    assert await since_of(client) == iso(at(3))
    clock.time = at(4)
    take(None)
    assert await since_of(client) == iso(at(3))
    take(27.1)
    assert await since_of(client) is None


async def test_what_holds_is_said_again_to_a_machine_that_was_not_in_memory(client, app, clock):
    context = app.state.context
    known = KnownValues(Intake(lambda: context), "later", ["t"])
    known.take({"t": None})
    machine = json.loads((await client.get(ROOM)).text)
    asked = {"id": "later", "name": "Later", "configuration": "XYFZ", "axes": machine["axes"]}
    made = await client.post("/v1/machines", json=asked | {"sensors": [{"name": "t"}]})
    assert made.status_code == 201, made.text
    known.repeat()
    sensors = (await client.get("/v1/machines/later/status")).json()["sensors"]
    assert sensors[0]["no_value_since"] == iso(clock.time)

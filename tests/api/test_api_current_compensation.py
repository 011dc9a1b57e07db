"""The compensation table at the latest reading, over HTTP."""

from datetime import timedelta

import pytest

from app.api.table_json import CurrentCompensationAnswer
from tests.service_examples import (
    ROOM,
    START,
    by_code,
    client_of,
    error_map,
    iso,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/compensation"
READINGS = f"{ROOM}/readings"


async def current(client):
    answer = await client.get(PATH)
    assert answer.status_code == 200, answer.text
    CurrentCompensationAnswer.model_validate_json(answer.content)
    return answer.json()


async def feed(client, *readings):
    answer = await client.post(READINGS, json=list(readings))
    assert answer.status_code == 201, answer.text


def sensors_of(document):
    return {s["sensor"]: s for s in document["sensors"]}


async def test_before_the_first_reading_there_is_no_table(client):
    found = problem(await client.get(PATH), 409)
    assert "reading" in found["detail"]


async def test_the_table_at_the_latest_reading(client, clock):
    await feed(client, reading(START - timedelta(seconds=60), 25.4), reading(START, 25.5))
    clock.advance(4.5)
    document = await current(client)
    stated = await client.post(
        PATH, json={"temperatures_c": reading(START, 25.5)["temperatures_c"]}
    )
    assert document["components"] == stated.json()["components"]
    assert document["computed_at"] == iso(clock.time)
    assert document["reading_time"] == iso(START)
    assert document["reading_age_s"] == 4.5
    assert document["stale"] is False
    assert document["warnings"] == []
    assert document["sensors"] == [
        {"sensor": name, "health": "ok", "temperature_c": t_c, "age_s": 4.5, "detail": ""}
        for name, t_c in (
            ("x-middle", 25.5),
            ("y-front", 24.5),
            ("z-column", 27.5),
            ("spindle", 30.5),
        )
    ]


async def test_a_reading_that_comes_late_does_not_take_the_newer_ones_place(client):
    await feed(client, reading(START, 25.5))
    await feed(client, reading(START - timedelta(seconds=30), 22.0))
    assert (await current(client))["reading_time"] == iso(START)


async def test_the_etag_answers_304_until_something_changes(client, clock):
    await feed(client, reading(START, 25.5))
    first = await client.get(PATH)
    tag = first.headers["etag"]
    clock.advance(10)
    for header in (tag, f'"another", {tag}', tag.removeprefix("W/"), "*"):
        answer = await client.get(PATH, headers={"If-None-Match": header})
        assert (answer.status_code, answer.content) == (304, b"")
        assert answer.headers["etag"] == tag
    answer = await client.get(PATH, headers={"If-None-Match": '"another"'})
    assert answer.status_code == 200
    assert answer.headers["etag"] == tag


async def new_etag(client, tag):
    answer = await client.get(PATH, headers={"If-None-Match": tag})
    assert answer.status_code == 200, "answered 304 although something has changed"
    return answer.headers["etag"]


async def test_every_change_makes_another_etag(client, clock):
    await feed(client, reading(START, 25.5))
    tags = [(await client.get(PATH)).headers["etag"]]

    clock.advance(5)
    await feed(client, reading(clock.time, 25.5))
    tags.append(await new_etag(client, tags[-1]))
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    tags.append(await new_etag(client, tags[-1]))
    await client.post(f"{ROOM}/models/3/activate")
    tags.append(await new_etag(client, tags[-1]))
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "spindle"})
    tags.append(await new_etag(client, tags[-1]))
    await client.patch(ROOM, json={"out_of_range": "reject"})
    tags.append(await new_etag(client, tags[-1]))
    clock.advance(121)
    tags.append(await new_etag(client, tags[-1]))
    assert len(set(tags)) == len(tags)


async def test_a_sensor_whose_value_changes_back_in_time_does_not_reuse_an_etag(client, clock):
    await feed(client, reading(START, 25.5))
    first = (await client.get(PATH)).headers["etag"]
    clock.advance(5)
    await feed(client, reading(clock.time, 25.6))
    clock.advance(5)
    await feed(client, reading(clock.time, 25.5))
    assert (await client.get(PATH)).headers["etag"] != first


async def test_stale_readings_serve_and_are_said_with_their_age(client, clock):
    await feed(client, reading(START, 25.5))
    clock.advance(120)
    assert (await current(client))["stale"] is False
    clock.advance(1)
    document = await current(client)
    assert document["stale"] is True
    assert document["complete"] is False
    assert document["reading_age_s"] == 121
    assert by_code(document)["EXX"]["errors_um"] == [0.0, 5.5, 27.5]
    assert by_code(document)["EXX"]["sensor"] == "x-middle"
    states = sensors_of(document)
    assert {s["health"] for s in states.values()} == {"stale"}
    assert states["x-middle"]["age_s"] == 121
    assert any("x-middle" in w and "121 s" in w and "120 s" in w for w in document["warnings"])


async def test_a_sensor_that_never_read_is_missing(client):
    await feed(
        client,
        {"time": iso(START), "temperatures_c": {"y-front": 24.5, "z-column": 27.5}},
    )
    document = await current(client)
    state = sensors_of(document)["x-middle"]
    assert (state["health"], state["temperature_c"], state["age_s"]) == ("missing", None, None)
    assert by_code(document)["EXX"]["stand_in_for"] == "x-middle"
    assert any("x-middle is missing" in w for w in document["warnings"])


async def test_without_any_usable_sensor_the_answer_is_409_and_says_which(client):
    await feed(client, {"time": iso(START), "temperatures_c": {"spindle": 24.5}})
    found = problem(await client.get(PATH), 409)
    for word in ("x-middle", "z-column", "EXX", "EZZ"):
        assert word in found["detail"]


async def test_a_reading_slightly_ahead_of_the_clock_is_no_younger_than_now(client):
    await feed(client, reading(START + timedelta(seconds=2), 25.5))
    document = await current(client)
    assert document["stale"] is False
    assert document["warnings"] == []
    assert all(s["age_s"] == 0 for s in document["sensors"])


async def test_readings_come_back_after_a_restart(client, app, new_app, clock):
    rising = [reading(START - timedelta(minutes=m), 25.5 - 0.05 * m) for m in range(90)]
    for r in rising:
        r["temperatures_c"]["x-middle"] = 25.5
    await feed(client, *rising)
    before = await current(client)
    assert sensors_of(before)["x-middle"]["health"] == "stuck"
    restarted = new_app(app.state.context.database.engine.url.render_as_string(False))
    async with client_of(restarted) as again:
        assert await current(again) == before

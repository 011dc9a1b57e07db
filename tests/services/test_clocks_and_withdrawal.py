"""Readings that lie in the future wait for their time, and readings can be withdrawn."""

import asyncio
import re
from datetime import timedelta

import pytest
from sqlalchemy import func, select

from app.services.events import AlarmLog
from app.services.follow_database import DatabaseFollower
from app.storage.tables import ReadingRow, WithdrawnReadingRow
from tests.service_examples import (
    ROOM,
    START,
    Clock,
    client_of,
    iso,
    problem,
    reading,
    running,
    temperatures,
)

pytestmark = pytest.mark.anyio

READINGS = f"{ROOM}/readings"
MONTH_S = 30 * 86_400


def at(seconds, t_c=25.5):
    return reading(START + timedelta(seconds=seconds), t_c)


async def feed(client, *readings):
    answer = await client.post(READINGS, json=list(readings))
    assert answer.status_code == 201, answer.text
    return answer.json()


async def current(client):
    answer = await client.get(f"{ROOM}/compensation")
    assert answer.status_code == 200, answer.text
    return answer.json()


async def withdraw(client, **query):
    query = {name.rstrip("_"): value for name, value in query.items()}
    answer = await client.delete(READINGS, params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()["withdrawn"]


def x_middle(document):
    return {s["sensor"]: s["temperature_c"] for s in document["sensors"]}["x-middle"]


@pytest.fixture
def other_app(new_app, furnished_url, app):
    service = new_app(furnished_url)
    service.follower = DatabaseFollower(service.state.context, every_s=1.0)
    service.follower.look()
    return service


@pytest.fixture
async def other(other_app):
    async with client_of(other_app) as other:
        yield other


# --- the sender's clock ---------------------------------------------------------------------


async def test_a_reading_ahead_does_not_freeze_the_table(client, clock):
    await feed(client, at(58, 27.0))
    await feed(client, at(0, 25.5))
    document = await current(client)
    assert (document["reading_time"], x_middle(document)) == (iso(START), 25.5)
    (warning,) = document["warnings"]
    assert iso(START + timedelta(seconds=58)) in warning
    clock.advance(30)
    await feed(client, at(30, 26.0))
    assert x_middle(await current(client)) == 26.0
    clock.advance(28)
    assert x_middle(await current(client)) == 27.0


def early(seconds, by_s):
    """What is said of a reading in use that arrived so long before its time."""
    return (
        f"the reading of {iso(START + timedelta(seconds=seconds))}, which the table rests on, "
        f"arrived {by_s} s before its time"
    )


@pytest.mark.parametrize("restarted", [False, True])
async def test_a_reading_that_came_early_is_named_as_long_as_it_is_used(
    client, app, new_app, clock, restarted
):
    await feed(client, at(0, 25.0), at(6, 25.9))
    clock.advance(6)
    url = app.state.context.database.engine.url.render_as_string(False)
    async with client_of(new_app(url) if restarted else app) as now:
        document = await current(now)
        assert (x_middle(document), document["complete"]) == (25.9, False)
        (warning,) = document["warnings"]
        assert warning.startswith(early(6, 6))
        body = {"points_mm": [[0, 0, 0]], "missing_components": "zero"}
        answer = (await now.post(f"{ROOM}/volumetric-error", json=body)).json()
        assert warning in answer["warnings"]
        clock.advance(1)
        await feed(now, at(7, 25.1))
        document = await current(now)
        assert (document["complete"], document["warnings"]) == (True, [])


async def test_an_early_value_is_named_while_its_sensor_has_no_newer_one(client, clock):
    await feed(client, at(0, 25.0), at(6, 25.9))
    clock.advance(8)
    of_one = {"time": at(7)["time"], "temperatures_c": {"z-column": 27.9}}
    await feed(client, of_one)
    document = await current(client)
    assert document["reading_time"] == of_one["time"]
    assert document["warnings"][0].startswith(early(6, 6))
    tag = (await client.get(f"{ROOM}/compensation")).headers["etag"]
    # It comes late and says the same of x-middle: the table stays, but for what is said of it.
    await feed(client, at(6.5, 25.9))
    answer = await client.get(f"{ROOM}/compensation", headers={"If-None-Match": tag})
    assert (answer.status_code, answer.json()["warnings"]) == (200, [])


async def test_clocks_that_differ_a_little_are_no_matter(client, clock):
    await feed(client, at(0, 25.0), at(2, 25.9))
    document = await current(client)
    assert (x_middle(document), document["complete"], document["warnings"]) == (25.9, True, [])


async def test_an_early_reading_is_named_by_the_other_service_too(client, other_app, other, clock):
    await feed(client, at(0, 25.5), at(58, 27.0))
    other_app.follower.look()
    clock.advance(58)
    assert (await current(other))["warnings"] == (await current(client))["warnings"]
    assert (await current(other))["warnings"][0].startswith(early(58, 58))


async def test_stored_again_after_its_time_it_is_a_duplicate_and_was_early_all_the_same(
    client, clock
):
    await feed(client, at(6, 25.9))
    clock.advance(10)
    assert (await feed(client, at(6, 25.9)))["duplicates"] == 1
    assert (await current(client))["warnings"][0].startswith(early(6, 6))
    await withdraw(client, time=at(6)["time"])
    await feed(client, at(6, 25.9))
    assert (await current(client))["warnings"] == []


async def test_the_etag_says_when_a_reading_waits_and_when_its_time_has_come(client, clock):
    await feed(client, at(0))
    tags = []
    for change in (lambda: feed(client, at(58, 27.0)), None):
        tags.append((await client.get(f"{ROOM}/compensation")).headers["etag"])
        if change is not None:
            await change()
    clock.advance(58)
    tags.append((await client.get(f"{ROOM}/compensation")).headers["etag"])
    assert len(set(tags)) == 3


async def test_with_readings_of_the_future_alone_the_refusal_names_them(client):
    await feed(client, at(58), at(3600))
    found = problem(await client.get(f"{ROOM}/compensation"), 409)
    for time in (START, START + timedelta(seconds=58), START + timedelta(hours=1)):
        assert iso(time) in found["detail"]


async def test_a_jump_in_a_reading_ahead_judges_no_sensor(client, clock):
    await feed(client, *(at(s - 300, 25.5) for s in range(0, 301, 60)))
    before = await current(client)
    await feed(client, at(58, 79.0))
    after = await current(client)
    assert after["sensors"] == before["sensors"]
    assert after["components"] == before["components"]


async def test_a_prediction_does_not_look_into_the_future(client, clock):
    """Between a reading of now and one of the future nothing has been measured."""
    await feed(client, at(0, 20.0), at(60, 24.0))
    asked = {"time": iso(START + timedelta(seconds=30)), "component": "EXX", "position_mm": 500}
    early = await client.post(f"{ROOM}/predictions", json={"observations": [asked]})
    clock.advance(60)
    late = await client.post(f"{ROOM}/predictions", json={"observations": [asked]})
    assert late.json()["predicted_um"] == [pytest.approx(10.0)]  # (22 − 20)·500/100 µm
    assert early.json()["predicted_um"] != late.json()["predicted_um"]


# --- the service's clock --------------------------------------------------------------------


@pytest.mark.parametrize("restarted", [False, True])
async def test_a_service_whose_clock_was_a_month_ahead(client, app, new_app, clock, restarted):
    await feed(client, at(-60, 25.0))
    clock.advance(MONTH_S)
    await feed(client, at(MONTH_S, 30.0))
    assert x_middle(await current(client)) == 30.0
    clock.advance(-MONTH_S)
    url = app.state.context.database.engine.url.render_as_string(False)
    async with client_of(new_app(url) if restarted else app) as now:
        document = await current(now)
        assert x_middle(document) == 25.0
        assert iso(START + timedelta(seconds=MONTH_S)) in document["warnings"][0]
        await feed(now, at(0, 25.5))
        assert x_middle(await current(now)) == 25.5
        clock.advance(MONTH_S)
        assert x_middle(await current(now)) == 30.0


async def test_two_services_with_different_clocks_each_go_by_their_own(client, furnished_url):
    with running(furnished_url, Clock(START + timedelta(seconds=58))) as fast:
        async with client_of(fast) as ahead:
            await feed(ahead, at(58, 27.0))
            assert x_middle(await current(ahead)) == 27.0
    await feed(client, at(0, 25.5))
    document = await current(client)
    assert x_middle(document) == 25.5
    assert len(document["warnings"]) == 1


async def test_a_reading_ahead_reaches_the_other_and_waits_there_too(
    client, other_app, other, clock
):
    await feed(client, at(0, 25.5), at(58, 27.0))
    other_app.follower.look()
    assert x_middle(await current(other)) == 25.5
    assert (await current(other))["warnings"] == (await current(client))["warnings"]
    clock.advance(58)
    assert x_middle(await current(other)) == 27.0


HOUR_S = 3600


def backwards(found, now, at=""):
    """List every age below zero, everything that lasts since later than now, and every end before
    its beginning, in an answer at any depth."""
    if isinstance(found, list):
        for i, one in enumerate(found):
            yield from backwards(one, now, f"{at}[{i}]")
    if not isinstance(found, dict):
        return
    for name, value in found.items():
        if name.endswith("age_s") and value is not None and value < 0.0:
            yield f"{at}.{name} is {value}"
        if name == "since" and value is not None and value > iso(now):
            yield f"{at}.{name} is {value}, now is {iso(now)}"
        yield from backwards(value, now, f"{at}.{name}")
    if found.get("until") is not None and found["until"] < found["time"]:
        yield f"{at} ends {found['until']}, before it began {found['time']}"


@pytest.mark.slow
async def test_nothing_is_older_than_now_or_ends_before_it_began_however_the_clock_jumps(
    client, app, clock
):
    """Forward and back by parts of a second, an hour and a month, with and without a reading."""
    alarms = AlarmLog(app.state.context)
    await feed(client, *(at(s, 25.0) for s in range(-600, 1, 60)))
    wrong, verdicts = [], set()
    jumps = (0, 1.5, -1.5, HOUR_S, 0, -HOUR_S, MONTH_S, -HOUR_S, -MONTH_S, -10, HOUR_S + 10)
    for i, jump in enumerate(jumps):
        clock.advance(jump)
        if i % 2:
            # The sender's clock is a little ahead.
            seconds = (clock() - START).total_seconds() + 1.9
            await client.post(READINGS, json=[at(seconds, 25.0 + i)])
        for _ in range(2):  # a state is written when it is there at two looks
            await asyncio.to_thread(alarms.look)
        for path in (f"{ROOM}/compensation", f"{ROOM}/status", "/v1/status", f"{ROOM}/events"):
            answer = await client.get(path)
            assert answer.status_code in (200, 409), answer.text
            wrong += [f"jump {i}: {path}{one}" for one in backwards(answer.json(), clock())]
            if path.endswith("/status") and "verdict" in answer.json():
                verdicts.add(answer.json()["verdict"])
        metrics = (await client.get("/metrics")).text
        ages = re.findall(r"^(thermap_\w*age_seconds\S*) (-\S+)$", metrics, re.MULTILINE)
        wrong += [f"jump {i}: {name} is {value}" for name, value in ages]
        assert (await client.get("/machines/mcfv5050")).status_code == 200
    assert wrong == []
    assert len(verdicts) > 1
    events = (await client.get(f"{ROOM}/events?kind=alarm")).json()["events"]
    assert events


# --- withdrawing ----------------------------------------------------------------------------


async def test_a_withdrawn_reading_counts_nowhere_and_is_kept_as_withdrawn(client, app):
    await feed(client, at(-60, 25.0), at(0, 27.0))
    first = await client.get(f"{ROOM}/compensation")
    assert await withdraw(client, time=iso(START)) == 1
    second = await client.get(f"{ROOM}/compensation")
    assert x_middle(second.json()) == 25.0
    assert first.headers["etag"] != second.headers["etag"]
    assert [r["time"] for r in (await client.get(READINGS)).json()] == [at(-60)["time"]]
    asked = {"time": iso(START), "component": "EXX", "position_mm": 500}
    answer = await client.post(f"{ROOM}/predictions", json={"observations": [asked]})
    assert answer.json()["predicted_um"] == [pytest.approx(25.0)]  # (25 − 20)·500/100 µm
    with app.state.context.database.reading() as session:
        (kept,) = session.scalars(select(WithdrawnReadingRow))
        assert (kept.time, kept.temperatures_c, kept.withdrawn_at) == (
            START,
            temperatures(27.0),
            START,
        )
        assert session.scalar(select(func.count(ReadingRow.id))) == 1


async def test_the_same_may_be_stored_again_and_withdrawn_again(client):
    for _ in range(2):
        assert (await feed(client, at(0)))["stored"] == 1
        assert (await current(client))["reading_time"] == iso(START)
        assert await withdraw(client, time=iso(START)) == 1
        problem(await client.get(f"{ROOM}/compensation"), 409)
    assert (await feed(client, at(0, 22.0)))["stored"] == 1, "other content is no conflict now"
    assert x_middle(await current(client)) == 22.0


async def test_what_was_withdrawn_is_listed(client, clock):
    path = f"{READINGS}/withdrawn"
    assert (await client.get(path)).json() == []
    times = [START - timedelta(seconds=s) for s in (30, 20, 10)]
    await client.post(READINGS, json=[reading(t, 25.0) for t in times])
    assert await withdraw(client, **{"from": iso(times[0]), "to": iso(times[1])}) == 2
    clock.advance(60)
    await client.post(READINGS, json=reading(times[1], 26.0))
    assert await withdraw(client, time=iso(times[1])) == 1
    later = iso(START + timedelta(seconds=60))
    expected = [
        reading(times[0], 25.0) | {"withdrawn_at": iso(START)},
        reading(times[1], 25.0) | {"withdrawn_at": iso(START)},
        reading(times[1], 26.0) | {"withdrawn_at": later},
    ]
    assert (await client.get(path)).json() == expected
    of_one = {"from": iso(times[1]), "to": iso(times[1])}
    assert (await client.get(path, params=of_one)).json() == expected[1:]
    assert (await client.get(path, params={"limit": 1})).json() == expected[:1]
    problem(await client.get("/v1/machines/nobody/readings/withdrawn"), 404)


async def test_a_range_is_withdrawn_with_both_its_ends(client):
    await feed(client, *(at(-10 * i, 20 + 0.1 * i) for i in range(6)))
    gone = {"from": at(-40)["time"], "to": at(-10)["time"]}
    assert await withdraw(client, **gone) == 4
    assert await withdraw(client, **gone) == 0
    assert [r["time"] for r in (await client.get(READINGS)).json()] == [
        at(-50)["time"],
        at(0)["time"],
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "status", "field"),
    [
        ({}, 422, "time"),
        ({"from": iso(START)}, 422, "to"),
        ({"to": iso(START)}, 422, "from"),
        ({"time": iso(START), "from": iso(START)}, 422, "time"),
        ({"time": iso(START), "from": iso(START), "to": iso(START)}, 422, "time"),
        ({"from": iso(START), "to": iso(START - timedelta(seconds=1))}, 422, "to"),
        ({"form": iso(START), "to": iso(START)}, 422, "form"),
        ({"time": iso(START + timedelta(seconds=1))}, 404, None),
    ],
)
async def test_a_forgotten_parameter_withdraws_nothing(client, query, status, field):
    await feed(client, at(-60), at(0))
    found = problem(await client.delete(READINGS, params=query), status)
    assert [e["field"] for e in found["errors"]] == ([field] if field else [])
    assert len((await client.get(READINGS)).json()) == 2


@pytest.mark.slow
async def test_a_withdrawn_reading_leaves_the_other_services_table_too(client, other_app, other):
    await feed(client, at(-60, 25.0), at(0, 27.0))
    other_app.follower.look()
    assert x_middle(await current(other)) == 27.0
    await withdraw(client, time=iso(START))
    other_app.follower.look()
    assert x_middle(await current(other)) == 25.0
    await feed(other, at(0, 22.0))
    assert x_middle(await current(other)) == 22.0
    other_app.follower.look()
    assert x_middle(await current(other)) == 22.0


async def test_a_withdrawn_reading_ahead_is_named_no_more(client, clock):
    await feed(client, at(0), at(58, 27.0))
    await withdraw(client, time=iso(START + timedelta(seconds=58)))
    assert (await current(client))["warnings"] == []
    clock.advance(58)
    assert x_middle(await current(client)) == 25.5


async def test_a_sensor_that_jumped_long_ago_is_judged_alike_after_a_restart(
    client, app, new_app, furnished_url
):
    """Its last two values are far older than what else is looked at."""
    alone = [at(-20_000, 25.5), at(-19_990, 60.0)]
    for one in alone:
        one["temperatures_c"] = {"spindle": one["temperatures_c"]["spindle"]}
    await feed(client, *alone)
    others = [at(seconds) for seconds in (-30, -20, -10)]
    for one in others:
        del one["temperatures_c"]["spindle"]
    for one in others:
        await feed(client, one)
    before = (await current(client))["sensors"]
    assert {s["sensor"]: s["health"] for s in before}["spindle"] == "jump"
    async with client_of(new_app(furnished_url)) as again:
        assert (await current(again))["sensors"] == before

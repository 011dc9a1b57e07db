"""Readings over HTTP."""

from datetime import timedelta

import pytest

from tests.service_examples import MACHINE, ROOM, START, contents, iso, problem, reading

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/readings"


def series(count, step_s=60.0, before_s=0.0):
    """Readings up to the present, oldest first; x-middle rises by 0.01 °C each."""
    newest = START - timedelta(seconds=before_s)
    return [
        reading(newest - timedelta(seconds=step_s * (count - 1 - i)), 20.0 + 0.01 * i)
        for i in range(count)
    ]


async def times(client, **query):
    answer = await client.get(PATH, params=query)
    assert answer.status_code == 200, answer.text
    return [r["time"] for r in answer.json()]


async def test_one_reading_comes_back_as_it_was_stated(client):
    stated = reading(START, 24.1, state={"spindle_rpm": 8000, "payload_kg": 0.1})
    answer = await client.post(PATH, json=stated)
    assert answer.status_code == 201
    assert answer.json() == {"stored": 1, "duplicates": 0}
    assert (await client.get(PATH)).json() == [stated]


async def test_a_list_is_stored_whatever_its_order_and_listed_in_order_of_time(client):
    stated = series(50)
    answer = await client.post(PATH, json=stated[::-1])
    assert answer.status_code == 201
    assert answer.json() == {"stored": 50, "duplicates": 0}
    assert (await client.get(PATH)).json() == stated


@pytest.mark.parametrize(
    ("stated", "shown"),
    [
        ("2026-03-01T07:30:00+02:00", "2026-03-01T05:30:00Z"),
        ("2026-02-28T23:00:00-06:30", "2026-03-01T05:30:00Z"),
        ("2026-03-01T05:30:00.000001Z", "2026-03-01T05:30:00.000001Z"),
        ("2026-03-01t05:30:00z", "2026-03-01T05:30:00Z"),
        ("1999-12-31T23:59:59.999999Z", "1999-12-31T23:59:59.999999Z"),
    ],
)
async def test_times_are_utc(client, stated, shown):
    body = {"time": stated, "temperatures_c": {"spindle": 20.0}}
    assert (await client.post(PATH, json=body)).status_code == 201
    assert await times(client) == [shown]
    again = await client.post(PATH, json=body | {"time": shown})
    assert (again.json()["stored"], again.json()["duplicates"]) == (0, 1)


async def test_a_reading_need_not_have_all_sensors(client):
    body = {"time": iso(START), "temperatures_c": {"spindle": 20.0}}
    assert (await client.post(PATH, json=body)).status_code == 201
    assert (await client.get(PATH)).json() == [body | {"state": {}}]


async def test_the_same_again_is_a_duplicate(client, app):
    stated = series(5)
    await client.post(PATH, json=stated[:3])
    answer = await client.post(PATH, json=stated)
    assert (answer.status_code, answer.json()) == (201, {"stored": 2, "duplicates": 3})
    before = contents(app)
    answer = await client.post(PATH, json=[*stated, *stated])
    assert (answer.status_code, answer.json()) == (201, {"stored": 0, "duplicates": 10})
    answer = await client.post(PATH, json=stated[0])
    assert (answer.status_code, answer.json()) == (201, {"stored": 0, "duplicates": 1})
    assert contents(app) == before


async def test_a_time_twice_in_one_list_is_stored_once(client):
    stated = reading(START, 20.0)
    answer = await client.post(PATH, json=[stated, stated])
    assert answer.json() == {"stored": 1, "duplicates": 1}


@pytest.mark.parametrize(
    "change",
    [
        {"temperatures_c": {"x-middle": 20.000000000000004}},
        {"temperatures_c": {"x-middle": 20.0, "spindle": 20.0}},
        {"state": {"spindle_rpm": 1}},
    ],
    ids=["last bit", "sensor more", "state"],
)
@pytest.mark.parametrize("stored_before", [True, False], ids=["known", "in one list"])
async def test_other_content_at_a_known_time_is_a_conflict(client, app, change, stored_before):
    known = {"time": iso(START), "temperatures_c": {"x-middle": 20.0}}
    new = [reading(START - timedelta(seconds=s), 20.0) for s in (30, 60)]
    other = [new[0], known | change, new[1]]
    if stored_before:
        await client.post(PATH, json=known)
    else:
        other.append(known)
    before = contents(app)
    found = problem(await client.post(PATH, json=other), 409)
    assert "2026-03-01T06:00:00" in found["detail"]
    assert contents(app) == before


@pytest.mark.slow
async def test_10_000_readings_are_one_request_and_one_more_is_too_many(client, app):
    stated = series(10_001, step_s=1.0)
    before = contents(app)
    problem(await client.post(PATH, json=stated), 422)
    assert contents(app) == before
    answer = await client.post(PATH, json=stated[1:])
    assert answer.json() == {"stored": 10_000, "duplicates": 0}
    answer = await client.post(PATH, json=stated[:10_000])
    assert answer.json() == {"stored": 1, "duplicates": 9_999}
    assert len(await times(client)) == 10_000  # as many as are listed unless more are asked for
    assert len(await times(client, limit=100_000)) == 10_001


async def test_nothing_is_stored_of_a_list_with_one_wrong_reading(client, app):
    stated = series(30)
    stated[29]["temperatures_c"] = {"x-middel": 20.0}
    before = contents(app)
    found = problem(await client.post(PATH, json=stated), 422)
    assert found["errors"][0]["field"] == "29.temperatures_c.x-middel"
    assert "x-middle, y-front, z-column, spindle" in found["errors"][0]["message"]
    assert contents(app) == before


async def test_both_ends_of_from_and_to_are_included(client):
    stated = series(10)
    await client.post(PATH, json=stated)
    all_times = [r["time"] for r in stated]
    assert await times(client, **{"from": all_times[3], "to": all_times[6]}) == all_times[3:7]
    assert await times(client, **{"from": all_times[8]}) == all_times[8:]
    assert await times(client, to=all_times[1]) == all_times[:2]
    assert await times(client, **{"from": all_times[5], "to": all_times[4]}) == []
    in_another_zone = (START - timedelta(seconds=60)).isoformat().replace("06:", "08:")
    in_another_zone = in_another_zone.replace("05:59:00+00:00", "07:59:00+02:00")
    assert await times(client, **{"from": in_another_zone}) == all_times[8:]


async def test_every_s_thins_and_limit_cuts_off(client):
    stated = series(100, step_s=10.0)
    await client.post(PATH, json=stated)
    all_times = [r["time"] for r in stated]
    assert await times(client, every_s=60) == all_times[::6]
    assert await times(client, every_s=9.999) == all_times
    assert await times(client, every_s=10.001) == all_times[::2]
    assert await times(client, every_s=60, limit=3) == [all_times[0], all_times[6], all_times[12]]
    assert await times(client, limit=1) == all_times[:1]


async def test_each_machine_has_its_own_readings(client):
    await client.post("/v1/machines", json=(await _another(client)))
    stated = reading(START, 20.0)
    await client.post(PATH, json=stated)
    assert (await client.get("/v1/machines/other/readings")).json() == []
    answer = await client.post("/v1/machines/other/readings", json=reading(START, 30.0))
    assert answer.json() == {"stored": 1, "duplicates": 0}
    assert (await client.get(PATH)).json() == [stated]


async def _another(client):
    machine = (await client.get(ROOM)).json() | {"id": "other"}
    return {k: v for k, v in machine.items() if k in MACHINE}


async def test_a_value_out_of_its_sensors_range_is_stored_and_one_in_kelvin_is_not(client, app):
    broken = reading(START, 20.0)
    broken["temperatures_c"]["x-middle"] = -200.0
    assert (await client.post(PATH, json=broken)).status_code == 201
    before = contents(app)
    kelvin = reading(START - timedelta(seconds=60), 20.0)
    kelvin["temperatures_c"]["x-middle"] = 293.15
    found = problem(await client.post(PATH, json=kelvin), 422)
    assert "20.00 °C if it was meant in kelvin" in found["detail"]
    assert contents(app) == before


@pytest.mark.parametrize("ahead_s", [0.001, 2])
async def test_clocks_that_differ_a_little_are_not_worth_a_word(client, ahead_s):
    body = reading(START + timedelta(seconds=ahead_s), 20.0)
    answer = await client.post(PATH, json=body)
    assert (answer.status_code, answer.json()) == (201, {"stored": 1, "duplicates": 0})


@pytest.mark.parametrize("ahead_s", [3, 58, 61, 86_400])
async def test_what_lies_in_the_future_is_stored_and_named(client, ahead_s):
    time = START + timedelta(seconds=ahead_s)
    answer = await client.post(PATH, json=[reading(START, 20.0), reading(time, 20.0)])
    assert answer.status_code == 201
    found = answer.json()
    assert (found["stored"], found["duplicates"], found["ahead"]) == (2, 0, 1)
    assert "1 reading from the future" in found["warnings"][0]
    assert iso(time) in found["warnings"][0]
    again = (await client.post(PATH, json=reading(time, 20.0))).json()
    assert (again["stored"], again["duplicates"], again["ahead"]) == (0, 1, 1)
    assert len((await client.get(PATH)).json()) == 2


@pytest.mark.parametrize("past_days", [1, 3651])
async def test_what_may_have_been_recorded_is_stored_without_a_word(client, past_days):
    answer = await client.post(PATH, json=reading(START - timedelta(days=past_days), 20.0))
    assert (answer.status_code, answer.json()) == (201, {"stored": 1, "duplicates": 0})


async def test_what_a_clock_without_the_time_may_have_stamped_is_stored_and_named(client):
    """As those do that begin at 1970 or 2000 after a loss of power."""
    old = [START - timedelta(days=days) for days in (30 * 365, 3653)]
    answer = await client.post(PATH, json=[reading(time, 20.0) for time in (START, *old)])
    assert answer.status_code == 201
    assert answer.json() == {
        "stored": 3,
        "duplicates": 0,
        "warnings": [
            f"2 readings from more than ten years ago: {iso(old[0])} to {iso(old[1])}; if they "
            "were not recorded then, a clock is wrong: set it right and withdraw what is stamped "
            "wrongly"
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize("ahead_s", [86_401, 30 * 86_400, 10**9])
async def test_a_time_more_than_a_day_in_the_future_is_refused(client, app, ahead_s):
    before = contents(app)
    body = [reading(START, 20.0), reading(START + timedelta(seconds=ahead_s), 20.0)]
    found = problem(await client.post(PATH, json=body), 422)
    assert found["errors"][0]["field"] == "1.time"
    assert "it is 2026-03-01T06:00:00Z" in found["detail"]
    assert contents(app) == before

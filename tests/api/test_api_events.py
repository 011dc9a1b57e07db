"""The event log: changes with who made them, alarms that come and go."""

import csv
import io

import httpx
import pytest

from app.access.keys import Role
from app.events.event import LONGEST_NAME
from app.services.access_keys import create_key
from app.services.events import AlarmLog
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    error_map,
    furnish,
    iso,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio


async def events(client, query="", path=f"{ROOM}/events"):
    answer = await client.get(f"{path}{query}")
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_changes_are_told_with_who_made_them_newest_first(client):
    named = {"User-Agent": "cell-controller/7\x01"}
    stored = await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 33.0), headers=named)
    assert stored.status_code == 201
    await client.post(f"{ROOM}/models/2/activate")
    await client.patch(ROOM, json={"name": "Mill", "extrapolation_margin_c": 4})
    await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
    await client.delete(f"{ROOM}/readings", params={"time": iso(START)})
    found = (await events(client))["events"]
    texts = [event["text"] for event in found]
    assert texts[0] == "1 reading withdrawn"
    assert texts[1] == (
        "settings changed: name from 'MCFV5050LN' to 'Mill'; extrapolation_margin_c from 5 to 4"
    )
    assert texts[2] == "went back from v4 to v2"
    assert found[2]["details"] == {"version": 2, "from": 4, "to": 2}
    assert texts[3].startswith("v4 active: ")
    assert "Run #9" in texts[3]
    assert found[3]["who"] == "127.0.0.1, cell-controller/7"
    assert texts[-1] == "machine created"
    assert {event["kind"] for event in found} == {"readings", "machine", "model"}
    assert all((e["machine"], e["count"], e["until"]) == ("mcfv5050", 1, None) for e in found)


async def test_a_long_name_of_who_asks_is_cut_and_stored(new_app, furnished_url):
    """On PostgreSQL too, which takes no letter more than a column has."""
    service = new_app(furnished_url, require_keys=True)
    database = service.state.context.database
    secret = create_key(database, "k" * 64, Role.ADMIN).secret
    client = httpx.AsyncClient(
        transport=httpx.ASGITransport(service, client=("2001:db8:" + "f" * 30, 1)),
        base_url="http://localhost",
        headers={"Authorization": f"Bearer {secret}", "User-Agent": "p" * 300},
    )
    async with client:
        assert (await client.patch(ROOM, json={"name": "n"})).status_code == 200
        (newest, *_) = (await events(client))["events"]
    assert len(newest["who"]) == LONGEST_NAME
    assert newest["who"].startswith("k" * 64)


async def test_what_is_refused_leaves_no_event(client):
    before = await events(client)
    wrong = error_map("Run #9", 33.0, measured_at="2030-01-01T00:00:00Z")
    assert (await client.post(f"{ROOM}/error-maps", json=wrong)).status_code == 422
    assert (await client.patch(ROOM, json={"configuration": "ZZZ"})).status_code == 422
    await client.patch(ROOM, json={"name": MACHINE["name"]})
    await client.post(f"{ROOM}/error-maps?preview=true", json=error_map("Run #9", 33.0))
    assert await events(client) == before


async def test_pages_filters_and_csv(client):
    for i in range(5):
        await client.patch(ROOM, json={"name": f"Mill {i}"})
    first = await events(client, "?kind=machine&limit=4")
    assert len(first["events"]) == 4
    rest = await events(client, f"?kind=machine&limit=4&before={first['next']}")
    assert len(rest["events"]) == 2  # the fifth name, and that the machine was made
    assert rest["next"] is None
    assert (await events(client, "?from=2026-03-02T00:00:00Z"))["events"] == []
    answer = await client.get(f"{ROOM}/events?kind=machine", headers={"Accept": "text/csv"})
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert len(rows) == 6
    assert rows[0]["text"].startswith("settings changed: name from ")
    same = await client.get(f"{ROOM}/events?kind=machine&format=csv")
    assert same.text == answer.text
    assert problem(await client.get(f"{ROOM}/events?kind=weather"), 422)
    assert problem(await client.get("/v1/machines/none/events"), 404)


async def test_a_machine_that_is_gone_is_in_the_log_of_all(client):
    assert (await client.delete(ROOM)).status_code == 204
    (newest, *_) = (await events(client, path="/v1/events"))["events"]
    assert (newest["text"], newest["machine"]) == ("machine deleted", "mcfv5050")


async def test_an_alarm_is_one_row_that_comes_goes_and_is_counted(app, client, clock):
    log = AlarmLog(app.state.context)

    async def at(t_c, seconds):
        clock.advance(seconds)
        answer = await client.post(f"{ROOM}/readings", json=reading(clock(), t_c))
        assert answer.status_code == 201, answer.text
        log.look()
        log.look()

    async def alarms():
        return (await events(client, "?kind=alarm"))["events"]

    await at(29.8, 0)
    assert await alarms() == []
    await at(30.5, 60)
    (alarm,) = await alarms()
    assert alarm["details"] == {"state": "clamped", "about": "x-middle, z-column"}
    assert (alarm["who"], alarm["until"], alarm["count"]) == ("service", None, 1)
    assert "0.50 K above" in alarm["text"]
    assert alarm["text_now"] is None
    await at(30.9, 60)
    (alarm,) = await alarms()
    assert "0.50 K above" in alarm["text"]  # what it said when it came
    assert "0.90 K above" in alarm["text_now"]
    page = (await client.get("/machines/mcfv5050/events")).text
    assert "0.90 K above" in page
    assert "0.50 K above" in page
    await at(29.8, 60)
    await at(29.8, 60)
    (alarm,) = await alarms()
    assert (alarm["until"] is None, alarm["text_now"]) == (False, None)
    await at(30.7, 60)
    (alarm,) = await alarms()
    assert (alarm["count"], alarm["until"]) == (2, None)
    assert "0.50 K above" in alarm["text"]
    assert "0.70 K above" in alarm["text_now"]
    # Another service, or the same after a restart, writes nothing twice.
    other = AlarmLog(app.state.context)
    other.look()
    other.look()
    assert await alarms() == [alarm]
    await at(29.8, 60)
    await at(29.8, 60)
    await at(29.8, 3600)
    await at(30.5, 60)
    assert len(await alarms()) == 2


async def test_an_alarm_about_another_sensor_is_another_alarm(app, client, clock):
    log = AlarmLog(app.state.context)
    for t_c in ({"x-middle": 30.5}, {}, {"z-column": 32.6}):
        clock.advance(60)
        body = reading(clock(), 29.0)
        body["temperatures_c"] |= t_c
        assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
        log.look()
        log.look()
    found = (await events(client, "?kind=alarm"))["events"]
    assert [one["details"]["about"] for one in found] == ["z-column", "x-middle"]
    assert [one["text"].split(" is ")[0] for one in found] == ["z-column", "x-middle"]
    assert [one["count"] for one in found] == [1, 1]
    assert found[1]["until"] is not None


async def test_a_sensor_s_settings_are_told_with_what_they_were(client):
    sensors = (await client.get(ROOM)).json()["sensors"]
    sensors[0] |= {"max_age_s": 300.0}
    answer = await client.patch(ROOM, json={"sensors": sensors})
    assert answer.status_code == 200, answer.text
    (newest, *_) = (await events(client, "?kind=machine"))["events"]
    words = "settings changed: sensors x-middle max_age_s from 120 to 300"
    assert newest["text"] == words


@pytest.fixture
def one_at_a_look(monkeypatch):
    """The log of alarms looks when it is told to, and has time for one machine."""
    monkeypatch.setattr("app.services.events.LOOK_EVERY_S", 3600.0)
    monkeypatch.setattr("app.services.events.AT_MOST_S", 0.0)


async def test_where_there_is_time_for_one_machine_alone_they_take_turns(
    one_at_a_look, app, client
):
    rooms = [f"/v1/machines/{name}" for name in ("a", "b", "z")]
    for room in rooms:
        await furnish(client, MACHINE | {"id": room.rsplit("/", 1)[-1]})
        await client.post(f"{room}/readings", json=reading(START, 30.5))
    log = AlarmLog(app.state.context)

    async def alarmed(looks):
        for _ in range(looks):
            log.look()
        every = (await events(client, "?kind=alarm", "/v1/events"))["events"]
        return sorted(event["machine"] for event in every)

    log.look()
    turns = len(app.state.context.live)
    # An alarm is written when it was there at two looks at its machine.
    assert await alarmed(turns - 1) == []
    assert await alarmed(turns - 1) == ["a", "b"]
    await client.delete(rooms[0], params={"confirm": "a"})
    assert "z" in await alarmed(1)
    await furnish(client, MACHINE | {"id": "c"})
    await client.post("/v1/machines/c/readings", json=reading(START, 30.5))
    assert "c" in await alarmed(5)


async def test_a_sensor_that_is_lost_and_comes_back(app, client, clock):
    log = AlarmLog(app.state.context)

    async def at(seconds, **temperatures_c):
        clock.advance(seconds)
        content = reading(clock(), 25.0)
        content["temperatures_c"] |= temperatures_c
        assert (await client.post(f"{ROOM}/readings", json=content)).status_code == 201
        log.look()
        log.look()

    await at(0)
    await at(60, **{"x-middle": 95.0})
    (lost,) = (await events(client, "?kind=sensor"))["events"]
    assert lost["details"] == {"sensor": "x-middle", "health": "out-of-range"}
    assert lost["text"].startswith("x-middle ")
    await at(60)
    await at(60)
    (back,) = (await events(client, "?kind=sensor"))["events"]
    assert back["until"] is not None


async def test_a_sensor_that_fails_in_another_way_is_told_anew(app, client, clock):
    """What it failed by before lasts no longer."""
    log = AlarmLog(app.state.context)
    out_of_range = {"x-middle": -127.0}
    await client.post(f"{ROOM}/readings", json=reading(clock(), 25.0))
    for seconds, temperatures_c in ((700, {}), (1, out_of_range), (1, {}), (9, {})):
        clock.advance(seconds)
        if temperatures_c:
            content = reading(clock(), 25.0)
            content["temperatures_c"] |= temperatures_c
            assert (await client.post(f"{ROOM}/readings", json=content)).status_code == 201
        log.look()
        log.look()
    found = (await events(client, "?kind=sensor"))["events"]
    of_one = [one for one in found if one["details"]["sensor"] == "x-middle"]
    assert [(e["details"]["health"], e["until"] is None, e["count"]) for e in of_one] == [
        ("out-of-range", True, 1),
        ("stale", False, 1),
    ]
    assert "got -127" in of_one[0]["text"]

"""Whether a machine can be trusted now: one verdict for every state that a table can be in.

The maps lie on one straight line (`error_map`): EXX grows by 5 µm/K at X 500, EZZ by 10 µm/K at
Z 500, and the hottest map is Run #6, 30 °C at x-middle and 32 °C at z-column.
"""

import math
from datetime import timedelta

import pytest

from app.errors import StorageUnavailable
from app.identification.watch.watching import WatchState
from app.services.events import AlarmLog
from app.storage.analyses import insert_analysis
from app.storage.records import AnalysisTask
from app.storage.watches import write_watch
from tests.effect_examples import SPEED, adopt, learnt
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    error_map,
    iso,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/status"


async def feed(client, *readings):
    answer = await client.post(f"{ROOM}/readings", json=list(readings))
    assert answer.status_code == 201, answer.text


async def status(client):
    answer = await client.get(PATH)
    assert answer.status_code == 200, answer.text
    (listed,) = (await client.get("/v1/status")).json()
    assert listed == answer.json()
    table = await client.get(f"{ROOM}/compensation")
    assert answer.json()["complete"] == (table.status_code == 200 and table.json()["complete"])
    return answer.json()


def verdict(found):
    return found["verdict"], found["state"]


def sensor(found, name):
    return next(s for s in found["sensors"] if s["sensor"] == name)


@pytest.mark.parametrize("policy", ["clamp", "reject"])
@pytest.mark.parametrize(("t_c", "is_asked"), [(72.5, True), (31.4, False), (25.0, False)])
async def test_what_may_be_in_fahrenheit_from_the_first_reading_on_is_asked(
    client, policy, t_c, is_asked
):
    await client.patch(ROOM, json={"out_of_range": policy})
    await feed(client, reading(START, t_c))
    asked = [one for one in (await status(client))["sentences"] if "are they in °F?" in one]
    assert [one.partition(":")[0] for one in asked] == (
        ["Its temperatures are 71.5 to 77.5 °C"] if is_asked else []
    )


async def test_a_machine_that_is_hot_indeed_is_not_asked_about(client):
    """A little beyond maps at 56 °C is nearer to them than 14 °C are."""
    for label, t_c in (("hot", 51.0), ("hotter", 56.0)):
        answer = await client.post(f"{ROOM}/error-maps", json=error_map(label, t_c))
        assert answer.status_code == 201, answer.text
    await feed(client, reading(START, 57.0))
    found = await status(client)
    assert verdict(found) == ("limited", "clamped")
    assert not [one for one in found["sentences"] if "°F" in one]


async def test_a_fresh_machine_between_its_maps_is_trusted(client, clock):
    minutes = [reading(START + timedelta(minutes=m), 25.0 + 0.01 * m) for m in range(31)]
    await feed(client, *minutes[:1])
    clock.advance(1800)
    await feed(client, *minutes[1:])
    clock.advance(4)
    found = await status(client)
    assert verdict(found) == ("trusted", "fresh")
    assert found["sentences"] == ["All 4 components lie between their maps, on fresh temperatures."]
    assert (found["machine"], found["name"], found["configuration"]) == (
        "mcfv5050",
        "MCFV5050LN",
        "XYFZ",
    )
    assert (found["model_version"], found["components"]) == (3, 4)
    assert found["reading_time"] == iso(START + timedelta(minutes=30))
    assert found["reading_age_s"] == 4.0
    # EZZ at Z 500 is 10 µm/K times 5.3 K above 20 °C, and 0.6 K/h warmer.
    place = {"component": "EZZ", "unit": "µm", "axis": "z", "position_mm": 500.0}
    place |= {"is_backward": False}
    assert found["largest"] == {**place, "value": -53.0}
    assert found["change_per_h"] == {**place, "value": -6.0}
    assert found["watch"] == "not-judged"
    assert found["analysis"] is None
    assert [s["sensor"] for s in found["sensors"]] == [
        *("x-middle", "z-column", "y-front", "spindle")
    ]
    assert sensor(found, "x-middle") == {
        "sensor": "x-middle",
        "temperature_c": 25.3,
        "age_s": 4.0,
        "interval_s": 60.0,
        "is_late": False,
        "no_value_since": None,
        "rate_k_per_h": 0.6,
        "health": "ok",
        "detail": "",
        "outside_maps_k": 0.0,
        "maps_c": [20.0, 30.0],
        "assigned_to": ["EXX", "EBX", "SXY"],
    }
    assert sensor(found, "spindle")["outside_maps_k"] is None


async def test_few_readings_give_no_rate(client):
    await feed(client, reading(START, 25.0))
    found = await status(client)
    assert found["change_per_h"] is None
    assert {s["rate_k_per_h"] for s in found["sensors"]} == {None}


async def test_beyond_the_hottest_map_it_says_how_far_and_what_going_on_would_add(client, clock):
    await feed(client, reading(START, 29.9))
    clock.advance(60)
    await feed(client, reading(clock.time, 31.4))
    found = await status(client)
    assert verdict(found) == ("limited", "clamped")
    assert found["since"] == iso(clock.time)
    assert found["sentences"] == [
        "x-middle is 1.40 K above the hottest map: 3 components are held at Run #6.",
        "If its errors continue in a straight line, EXX lacks 7.0 µm of compensation at X 500.",
        "z-column is 1.40 K above the hottest map: 1 component is held at Run #6.",
        "If its errors continue in a straight line, EZZ lacks 14.0 µm of compensation at Z 500.",
    ]
    ((first, second)) = found["beyond"]
    assert first["components"] == ["EXX", "EBX", "SXY"]
    assert (first["outside_k"], first["held_at"]) == (1.4, "Run #6")
    assert second["lacks"] == {
        "is_backward": False,
        "component": "EZZ",
        "value": -14.0,
        "unit": "µm",
        "axis": "z",
        "position_mm": 500.0,
    }
    assert sensor(found, "z-column")["outside_maps_k"] == 1.4


async def test_what_is_inside_its_maps_can_be_trusted_all_the_same(client):
    await feed(
        client,
        reading(
            START,
            19.0,
            temperatures_c={
                "x-middle": 19.0,
                "y-front": 18.0,
                "z-column": 25.0,
                "spindle": 25.0,
            },
        ),
    )
    found = await status(client)
    assert verdict(found) == ("limited", "clamped")
    assert found["sentences"][0] == (
        "x-middle is 1.00 K below the coldest map: 3 components are held at Run #1."
    )
    assert found["sentences"][-1] == "The other component can be trusted."
    assert sensor(found, "x-middle")["outside_maps_k"] == -1.0


async def test_a_state_goes_half_a_minute_after_its_cause(client, clock):
    await feed(client, reading(START, 30.4))
    clock.advance(5)
    await feed(client, reading(clock.time, 29.9))
    clock.advance(20)
    found = await status(client)
    assert verdict(found) == ("limited", "clamped")
    assert found["sentences"][0] == "x-middle was 0.40 K above the hottest map until 06:00:00 UTC."
    assert found["beyond"] == []
    clock.advance(6)
    assert verdict(await status(client)) == ("trusted", "fresh")


async def test_what_was_never_believed_was_not_outside_the_maps(client, clock):
    """A value that jumps, as in °F, is no temperature of the machine: no table rested on it."""
    for value in (24.0, 75.2, 24.0):
        await feed(client, reading(clock.time, value))
        clock.advance(5)
    found = await status(client)
    assert verdict(found) == ("trusted", "fresh")


async def test_extrapolated_and_refused_tables(client):
    await feed(client, reading(START, 31.4))
    change = {"out_of_range": "extrapolate", "extrapolation_margin_c": 5}
    assert (await client.patch(ROOM, json=change)).status_code == 200
    found = await status(client)
    assert verdict(found) == ("limited", "extrapolated")
    assert found["sentences"][0] == (
        "x-middle is 1.40 K above the hottest map: 3 components are extrapolated."
    )
    assert found["beyond"][0]["lacks"] is None
    assert (await client.patch(ROOM, json={"out_of_range": "reject"})).status_code == 200
    found = await status(client)
    assert verdict(found) == ("not-trusted", "outside-maps")
    assert found["sentences"][0].startswith("There is no table: ")
    assert (found["components"], found["largest"]) == (0, None)


async def test_old_temperatures(client, clock):
    await feed(client, reading(START, 25.0))
    clock.advance(121)
    found = await status(client)
    assert verdict(found) == ("limited", "stale")
    assert found["since"] == iso(START + timedelta(seconds=120))
    assert found["sentences"][0] == (
        "x-middle has not been read since 06:00 UTC: 3 components rest on it."
    )
    assert (
        "spindle has not been read since 06:00 UTC: no component rests on it."
        in (found["sentences"])
    )
    clock.advance(1080)
    found = await status(client)
    assert verdict(found) == ("not-trusted", "no-reading")
    assert found["since"] == iso(START)
    assert found["sentences"][0] == (
        "No reading since 06:00 UTC. The table has stood still since then."
    )
    assert found["largest"] is not None


async def test_without_readings_and_without_maps(client, empty):
    found = await status(client)
    assert verdict(found) == ("not-trusted", "no-reading")
    assert (found["reading_time"], found["since"]) == (None, None)
    assert (await empty.post("/v1/machines", json=MACHINE)).status_code == 201
    answer = await empty.post(f"{ROOM}/error-maps", json=error_map("Run #1", 20.0))
    assert answer.status_code == 201
    await feed(empty, reading(START, 25.0))
    found = await status(empty)
    assert verdict(found) == ("not-trusted", "no-model")
    assert sensor(found, "x-middle")["temperature_c"] == 25.0
    assert problem(await client.get("/v1/machines/another/status"), 404)


async def test_a_failed_sensor_and_its_stand_in(client, clock):
    def at(t_c, **other):
        return reading(
            clock.time,
            t_c,
            temperatures_c={
                "x-middle": t_c,
                "y-front": t_c - 1.0,
                "z-column": t_c + 2.0,
                "spindle": t_c + 5.0,
            }
            | other,
        )

    await feed(client, at(25.0))
    clock.advance(10)
    await feed(client, at(25.0, **{"x-middle": 99.0}))
    found = await status(client)
    assert verdict(found) == ("trusted", "stand-in")
    assert found["since"] == iso(clock.time)
    assert found["sentences"][0].startswith("y-front stands in for x-middle in 3 components: ")
    clock.advance(10)
    failed_at = clock.time
    await feed(client, at(25.0, **{"x-middle": 99.0, "y-front": 99.0}))
    found = await status(client)
    assert verdict(found) == ("not-trusted", "sensor-fault")
    assert found["sentences"][0].startswith("There is no table: x-middle is out of range: ")
    assert "3 components cannot be computed" in found["sentences"][0]
    assert found["since"] == iso(failed_at - timedelta(seconds=10))
    assert found["components"] == 0


async def test_a_stand_in_is_judged_alike_whether_its_sensor_failed_or_is_silent(client, clock):
    await feed(client, reading(START, 25.0))
    clock.advance(130)  # x-middle is too old after 120 s
    others = {"y-front": 24.0, "z-column": 27.0, "spindle": 30.0}
    await feed(client, reading(clock.time, 25.0, temperatures_c=others))
    found = await status(client)
    assert verdict(found) == ("trusted", "stand-in")
    assert found["since"] == iso(START + timedelta(seconds=120))
    assert found["sentences"] == [
        "y-front stands in for x-middle in 3 components: x-middle has not been read since 06:00 "
        "UTC."
    ]


async def test_one_bad_reading_spoils_no_rate(client, clock):
    """A temperature that stood still: 999 °C once, then warmer by 6 K for some seconds."""
    steady = [reading(START + timedelta(seconds=10 * i), 25.0) for i in range(180)]
    for i, t_c in ((90, 999.0), (91, 31.0)):
        steady[i] |= at_x_middle(t_c)
    await feed(client, *steady[:1])
    clock.advance(1790)
    await feed(client, *steady[1:])
    found = await status(client)
    assert verdict(found) == ("trusted", "fresh")
    assert sensor(found, "x-middle")["rate_k_per_h"] == 0.0
    change = found["change_per_h"]["value"]
    assert (change, math.copysign(1.0, change)) == (0.0, 1.0)


def every(seconds, since_s, until_s, t_c=25.0, **changes):
    count = round((until_s - since_s) / seconds)
    times = [START + timedelta(seconds=since_s + seconds * i) for i in range(count)]
    return [reading(time, t_c, **changes) for time in times]


async def test_a_sensor_that_came_every_second_is_missed_at_once(client, clock):
    await feed(client, *every(1.0, -60.0, 0.0))
    others = {"y-front": 24.0, "z-column": 27.0, "spindle": 30.0}
    clock.advance(14)
    await feed(client, *every(1.0, 0.0, 14.0, temperatures_c=others))
    assert verdict(await status(client)) == ("trusted", "fresh")
    clock.advance(6)
    await feed(client, *every(1.0, 14.0, 20.0, temperatures_c=others))
    found = await status(client)
    assert verdict(found) == ("limited", "late")
    assert found["sentences"][0] == (
        "x-middle has not been read since 05:59:59 UTC, where a reading usually comes every 1 s: "
        "3 components rest on it."
    )
    late = sensor(found, "x-middle")
    assert (late["is_late"], late["interval_s"], late["age_s"]) == (True, 1.0, 21.0)
    assert not sensor(found, "z-column")["is_late"]
    # All of them stop: none is left to compare with, but the clock goes on.
    clock.advance(80)
    assert [s["sensor"] for s in (await status(client))["sensors"] if not s["is_late"]] == []


async def test_who_sends_many_at_once_is_not_missed(client, clock):
    """Once a minute come the sixty readings of each second: none is late for a minute."""
    for minute in range(4):
        clock.advance(60)
        await feed(client, *every(1.0, 60.0 * minute, 60.0 * minute + 60.0))
    clock.advance(59)
    assert verdict(await status(client)) == ("trusted", "fresh")
    assert sensor(await status(client), "x-middle")["interval_s"] == 1.0


async def test_who_sends_on_change_only_is_not_missed(client, clock):
    for i, wait_s in enumerate((3, 8, 20, 4, 11, 30, 6, 2, 15, 9, 5, 40, 7, 3, 12)):
        clock.advance(wait_s)
        await feed(client, reading(clock.time, 25.0 + 0.1 * (i % 3)))
    clock.advance(110)
    assert verdict(await status(client)) == ("trusted", "fresh")


async def test_a_failed_sensor_on_which_nothing_rests_is_said_and_harms_nothing(client):
    temperatures_c = {"x-middle": 25.0, "y-front": 24.0, "z-column": 27.0, "spindle": 160.0}
    await feed(client, reading(START, 25.0, temperatures_c=temperatures_c))
    found = await status(client)
    assert verdict(found) == ("trusted", "fresh")
    assert found["sentences"][1].startswith("spindle is out of range: ")
    assert found["sentences"][1].endswith("; no component rests on it.")


async def test_components_with_one_map_only_make_the_table_incomplete(client):
    extra = error_map("Run #9", 33.0)
    both = ("EYY", "EXY")
    line = {"positions_mm": [0, 500], "errors_um": [0.0, 1.0]}
    extra["components"] += [{"component": code, **line} for code in both]
    assert (await client.post(f"{ROOM}/error-maps", json=extra)).status_code == 201
    assert (await client.post(f"{ROOM}/models/4/activate")).status_code == 200
    await feed(client, reading(START, 25.0))
    found = await status(client)
    assert verdict(found) == ("limited", "incomplete")
    words = "EXY, EYY are not in the table: measured in Run #9 only, at least two maps are needed"
    assert found["sentences"][0] == f"{words}."
    table = (await client.get(f"{ROOM}/compensation")).json()
    assert table["warnings"] == [words]


async def test_while_the_database_is_away_the_verdict_goes_on_from_memory(app, client, monkeypatch):
    await feed(client, reading(START, 25.0))
    assert verdict(await status(client)) == ("trusted", "fresh")

    def away(*_):
        raise StorageUnavailable("the database cannot be reached")

    monkeypatch.setattr(type(app.state.context.database), "reading", away)
    found = await status(client)
    assert verdict(found) == ("trusted", "fresh")
    assert found["watch"] == "not-judged"


async def test_an_effect_that_lacks_what_drives_it_is_missing(client, app):
    adopt(app, SPEED)
    await feed(client, reading(START, 25.0))
    found = await status(client)
    assert verdict(found) == ("limited", "effect-missing")
    assert found["sentences"][0].startswith(f"{SPEED.kind} of EXX is not in the table: ")
    assert found["sentences"][-1] == "The 3 other components can be trusted."


async def test_an_effect_at_the_edge_of_where_it_was_learnt_is_held(client, app):
    adopt(app, learnt(SPEED, state={"spindle_rpm": (0.0, 4000.0)}))
    await feed(client, reading(START, 25.0, state={"spindle_rpm": 12000.0}))
    found = await status(client)
    assert verdict(found) == ("limited", "held")
    assert "12000" in found["sentences"][0].replace(",", "")


async def test_verifications_beyond_their_limits_and_an_analysis_that_waits(client, app):
    await feed(client, reading(START, 25.0))
    context = app.state.context
    with context.database.writing() as session:
        state = WatchState(beyond_since_s=START.timestamp())
        write_watch(session, "mcfv5050", 3, state, START)
        task = AnalysisTask(3, [1], 0.3, None, 1)
        number = insert_analysis(session, "mcfv5050", task, START).id
    found = await status(client)
    assert verdict(found) == ("limited", "drifting")
    assert (found["watch"], found["since"]) == ("beyond", iso(START))
    assert found["sentences"] == [
        "Verifications are beyond what the model allows: the machine has changed."
    ]
    assert found["analysis"] == {"id": number, "progress": 0.0}


async def test_nothing_is_called_trusted_beside_what_may_touch_everything(client, app):
    temperatures_c = {"x-middle": 31.0, "y-front": 30.0, "z-column": 25.0, "spindle": 25.0}
    await feed(client, reading(START, 31.0, temperatures_c=temperatures_c))
    assert (await status(client))["sentences"][-1] == "The other component can be trusted."
    with app.state.context.database.writing() as session:
        write_watch(session, "mcfv5050", 3, WatchState(beyond_since_s=START.timestamp()), START)
    found = await status(client)
    assert verdict(found) == ("limited", "clamped")
    assert not any("can be trusted" in sentence for sentence in found["sentences"])


@pytest.fixture
def begun_anew(new_app, furnished_url, clock):
    """Make the service that comes after one which saw a machine at these temperatures."""

    async def begin(*hours):
        before = new_app(furnished_url)
        log = AlarmLog(before.state.context)
        async with client_of(before) as client:
            for hour, content in hours:
                clock.time = START + timedelta(hours=hour)
                await feed(client, reading(clock.time, 25.0) | content)
                log.look()
                log.look()
        return new_app(furnished_url)

    return begin


def at_x_middle(t_c):
    return {"temperatures_c": reading(START, 25.0)["temperatures_c"] | {"x-middle": t_c}}


async def test_since_when_survives_the_service(begun_anew, clock):
    after = await begun_anew(
        (0, at_x_middle(25.0)), (2, at_x_middle(31.0)), (60, at_x_middle(31.0))
    )
    clock.advance(600)
    async with client_of(after) as client:
        await feed(client, reading(clock.time, 25.0) | at_x_middle(31.0))
        assert len(after.state.context.live.get("mcfv5050").readings.held.used) == 2
        found = await status(client)
        assert verdict(found) == ("limited", "clamped")
        assert found["since"] == iso(START + timedelta(hours=2))
        # Where readings in memory say it, they say it better.
        clock.advance(60)
        await feed(client, reading(clock.time, 25.0))
        clock.advance(60)
        await feed(client, reading(clock.time, 25.0) | at_x_middle(31.0))
        assert (await status(client))["since"] == iso(clock.time)


async def test_since_when_a_sensor_has_failed_survives_the_service(begun_anew, clock):
    lost = at_x_middle(99.0)
    after = await begun_anew((0, at_x_middle(25.0)), (2, lost), (60, lost))
    clock.advance(600)
    async with client_of(after) as client:
        await feed(client, reading(clock.time, 25.0) | lost)
        found = await status(client)
        assert verdict(found) == ("trusted", "stand-in")
        assert found["since"] == iso(START + timedelta(hours=2))


async def test_what_no_reading_tells_has_begun_when_it_was_seen_first(begun_anew, app, clock):
    adopt(app, learnt(SPEED, state={"spindle_rpm": (0.0, 4000.0)}))
    fast = {"state": {"spindle_rpm": 12000.0}}
    after = await begun_anew((0, {}), (2, fast), (60, fast))
    async with client_of(after) as client:
        found = await status(client)
        assert (found["state"], found["since"]) == ("held", iso(START + timedelta(hours=2)))
        # The clock was set back: nobody has seen it yet.
        clock.time = START + timedelta(hours=1)
        await feed(client, reading(clock.time, 25.0) | fast)
        assert (await status(client))["since"] is None


async def test_what_comes_and_goes_lasts_since_it_came_last(begun_anew, clock):
    after = await begun_anew(
        *((hour, at_x_middle(t_c)) for hour, t_c in [(0, 31.0), (0.1, 25.0), (0.2, 31.0)])
    )
    clock.advance(86400)
    async with client_of(after) as client:
        await feed(client, reading(clock.time, 25.0) | at_x_middle(31.0))
        found = await status(client)
        # The log has when it came first, readings when it came last.
        assert (found["state"], found["since"]) == ("clamped", iso(START + timedelta(hours=0.2)))

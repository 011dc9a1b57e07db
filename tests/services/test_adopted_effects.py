"""Adopted effects over restarts, processes, orders of arrival, and model versions."""

import math
import random
import threading
from contextlib import nullcontext
from dataclasses import replace
from datetime import datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from app.effects.conditions import recorded_conditions
from app.effects.driver import AboveReference
from app.effects.effect import Effect, Provenance
from app.effects.shape import Everywhere
from app.effects.term import Term
from app.errors import Conflict, InvalidContent, StorageUnavailable, UnknownThing
from app.identification.analysis.found_effect import RefittedEffect
from app.services import adopt_analysis
from app.services.adopt_analysis import version_with_effects
from app.services.change_model import changing_machine
from app.services.follow_database import DatabaseFollower
from app.services.readings import store_readings
from app.thermal.machine import Sensor
from app.thermal.reading import Reading
from app.thermal.temperature_history import TemperatureHistory
from tests.effect_examples import (
    ALL,
    BACKLASH,
    LAG,
    OUTDATED,
    SPEED,
    SPEED_LATE,
    adopt,
    current,
    numbers,
    predicted,
    response_of_all,
    stored,
    warm_up,
)
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    by_code,
    client_of,
    error_map,
    iso,
    problem,
    reading,
    table,
)

pytestmark = pytest.mark.anyio


@pytest.mark.parametrize(("variant", "is_refused"), [("cold: slope", True), ("warm: shift", False)])
def test_one_map_that_is_wrong_is_not_another_one_in_other_figures(
    monkeypatch, variant, is_refused
):
    """It was refused as similar, whatever map the active version had learnt of since."""
    cold = Effect("wrong-map", ("EXX",), ("bed",), (), "cold: shift")
    change = SimpleNamespace(
        version=SimpleNamespace(version=4), session=None, row=SimpleNamespace(id="m")
    )
    monkeypatch.setattr(adopt_analysis, "find_version", lambda *_: None)
    monkeypatch.setattr(
        adopt_analysis, "adopted_effects", lambda version: [cold] if version else []
    )
    monkeypatch.setattr(adopt_analysis, "explain", lambda effect: effect.variant)
    analysed = SimpleNamespace(model_version=3)
    with pytest.raises(Conflict, match="twice: cold") if is_refused else nullcontext():
        adopt_analysis._check_unlike(change, analysed, [replace(cold, variant=variant)])


@pytest.mark.slow
async def test_a_restart_changes_nothing(client, app, new_app, furnished_url):
    readings = warm_up(90)
    readings[30]["temperatures_c"]["z-column"] += 30.0  # a jump that is not to be believed
    await stored(client, readings[:25])
    adopt(app, *ALL)
    for one in readings[25:]:
        await stored(client, one)
    before = await current(client)
    assert before["complete"] is True
    async with client_of(new_app(furnished_url)) as again:
        after = await current(again)
    np.testing.assert_allclose(numbers(after), numbers(before), rtol=0, atol=1e-9)
    assert [e["effects"] for e in after["components"]] == [
        e["effects"] for e in before["components"]
    ]


@pytest.mark.slow
async def test_two_services_over_one_database_agree(client, app, new_app, furnished_url):
    other_app = new_app(furnished_url)
    follower = DatabaseFollower(other_app.state.context, every_s=1.0)
    follower.look()
    readings = warm_up(90)
    async with client_of(other_app) as other:
        await stored(client, readings[:60])
        adopt(app, *ALL)
        follower.look()
        for i, one in enumerate(readings[60:]):
            await stored(client if i % 3 else other, one)
            if i % 5 == 0:
                follower.look()
        ours = DatabaseFollower(app.state.context, every_s=1.0)
        ours.look()
        follower.look()
        here, there = await current(client), await current(other)
        assert here["complete"] is True
        np.testing.assert_allclose(numbers(there), numbers(here), rtol=0, atol=1e-9)
        tags = [(await c.get(f"{ROOM}/compensation")).headers["etag"] for c in (client, other)]
        assert tags[0] == tags[1]


STUCK_AFTER_S = 900.0
"""Sensors are judged over twice as long; of faster readings some are left out of the window."""


def fast_warm_up(minutes=80, every_s=2.0):
    """Readings faster than they are kept, in one of which a sensor jumps, and then stands still."""
    found = []
    for i in range(int(60 * minutes / every_s) + 1):
        before_s = 60.0 * minutes - every_s * i
        t_c = 22.0 + 0.002 * i + 0.4 * math.sin(i / 90.0)
        state = {"spindle_rpm": 1000.0 * (i // 200 % 4)}
        one = reading(START - timedelta(seconds=before_s), round(t_c, 3), state=state)
        one["temperatures_c"]["z-column"] += 30.0 * (i == 700)
        if i > 900:
            one["temperatures_c"]["y-front"] = 23.5
        found.append(one)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
async def test_services_agree_to_the_bit_in_whatever_order_readings_came(
    client, app, new_app, furnished_url, seed
):
    """Also one that starts later: every byte of the table, and what the lags are."""
    rng = random.Random(seed)
    changed = [s | {"stuck_after_s": STUCK_AFTER_S} for s in MACHINE["sensors"]]
    assert (await client.patch(ROOM, json={"sensors": changed})).status_code == 200
    adopt(app, LAG, SPEED, SPEED_LATE)
    other_app = new_app(furnished_url)
    services = (app, other_app)
    followers = [DatabaseFollower(one.state.context, every_s=1.0) for one in services]
    for follower in followers:
        follower.look()
    left = fast_warm_up()
    async with client_of(other_app) as other:
        while left:
            batch = [left.pop(0) for _ in range(min(len(left), rng.choice([1, 2, 30, 200])))]
            if rng.random() < 0.3:
                rng.shuffle(batch)
            if len(batch) > 2 and rng.random() < 0.2:  # some of these come after later ones
                place = rng.randrange(min(len(left), 400) + 1)
                left[place:place], batch = batch[:-2], batch[-2:]
            await stored(rng.choice([client, other]), batch)
            if rng.random() < 0.5:
                rng.choice(followers).look()
        for follower in followers:
            follower.look()
        late = new_app(furnished_url)
        async with client_of(late) as later:
            answers = [await one.get(f"{ROOM}/compensation") for one in (client, other, later)]
    assert answers[0].json()["effects"][0]["missing"] == ""
    assert {answer.content for answer in answers} == {answers[0].content}
    assert {answer.headers["etag"] for answer in answers} == {answers[0].headers["etag"]}
    pasts = [s.state.context.live.get("mcfv5050").past.now for s in (*services, late)]
    assert pasts[0].states == pasts[1].states == pasts[2].states
    assert pasts[0].lags.filters == pasts[1].lags.filters == pasts[2].lags.filters


@pytest.mark.slow
@pytest.mark.parametrize("order", ["backwards", "late ones", "in one"])
async def test_the_order_of_arrival_does_not_count(client, app, new_app, furnished_url, order):
    adopt(app, LAG, SPEED_LATE)
    readings = warm_up(90)
    if order == "in one":
        await stored(client, readings)
    else:
        late = readings[::-1] if order == "backwards" else readings[::7]
        first = [] if order == "backwards" else [r for r in readings if r not in late]
        for i in range(0, len(first), 20):
            await stored(client, first[i : i + 20])
        for i in range(0, len(late), 13):
            await stored(client, late[i : i + 13])
    document = await current(client)
    assert document["complete"] is True
    async with client_of(new_app(furnished_url)) as again:
        np.testing.assert_allclose(numbers(await current(again)), numbers(document), atol=1e-9)


@pytest.mark.slow
async def test_sensors_that_report_apart_need_no_rebuilding(client, app, monkeypatch):
    adopt(app, LAG)
    readings = warm_up(60)
    await stored(client, readings[0])
    reads = []
    monkeypatch.setattr(
        "app.services.load_machine.recent_readings", lambda *a: reads.append(a) or []
    )
    for one in readings[1:]:
        z_column = {"z-column": one["temperatures_c"].pop("z-column")}
        await stored(client, one)
        earlier = {**one, "temperatures_c": z_column, "state": {}}
        earlier["time"] = one["time"].replace(":00Z", ":00.5Z").replace(":00+", ":00.5+")
        await stored(client, earlier)
    assert reads == []
    assert (await current(client))["complete"] is True


async def test_a_lag_waits_until_a_gap_is_forgotten(client, app, clock):
    adopt(app, LAG)
    readings = warm_up(70)
    await stored(client, readings)
    assert (await current(client))["complete"] is True
    clock.advance(1800)
    await stored(client, reading(START + timedelta(seconds=1800), 25.5))
    document = await current(client)
    assert document["complete"] is False
    # 1 − exp(−30/10) of it; that is a twentieth after 10 ln(0.95/0.05) = 29.4 min.
    missing = document["effects"][0]["missing"]
    assert "95% of what follows it with a time constant of 10 min" in missing
    assert "30 min without another one" in missing
    clock.advance(1800)
    for minute in range(31):
        await stored(client, reading(START + timedelta(minutes=30 + minute), 25.5))
    assert (await current(client))["complete"] is True


def not_read(readings, since_min, until_min):
    return [r for i, r in enumerate(readings) if not since_min < i < until_min]


def not_believed(readings, since_min, until_min):
    """One sensor reads nonsense: too hot for it."""
    return [
        r | {"temperatures_c": r["temperatures_c"] | {"y-front": 999.0}}
        if since_min < i < until_min
        else r
        for i, r in enumerate(readings)
    ]


def state_not_read(readings, since_min, until_min):
    return [r | {"state": {}} if since_min < i < until_min else r for i, r in enumerate(readings)]


def expected_of(driver, readings):
    """What a response says at the last of a whole record of readings."""
    times_s = [datetime.fromisoformat(r["time"]).timestamp() for r in readings]
    sensors = {name: Sensor(name, max_age_s=120.0) for name in readings[0]["temperatures_c"]}
    history = TemperatureHistory.of_readings(
        sensors, [(t, r["temperatures_c"]) for t, r in zip(times_s, readings, strict=True)]
    )
    states = [(t, r["state"]) for t, r in zip(times_s, readings, strict=True)]
    return driver.at(recorded_conditions(sensors, history, states, np.array(times_s[-1:])))[0]


@pytest.mark.parametrize("gap_min", [4, 45])
@pytest.mark.parametrize("lose", [not_read, not_believed, state_not_read])
async def test_after_a_gap_a_response_is_that_of_the_whole_record_or_missing(
    client, app, lose, gap_min
):
    """Its short filters began anew on the warm machine and counted from there, unseen."""
    warm = response_of_all("EXX")
    adopt(app, warm)
    whole = warm_up(420)
    spoilt = lose(whole, 150, 150 + gap_min)
    said = []
    for at in (150 + gap_min, 224 + gap_min, 420):
        await stored(client, [r for r in spoilt if r["time"] <= whole[at]["time"]])
        now = await current(client)
        (effect,) = now["effects"]
        asked = {"component": "EXX", "position_mm": 250.0}
        then = await predicted(client, asked, time=datetime.fromisoformat(whole[at]["time"]))
        said.append(effect["missing"])
        assert (then["status"] == ["effect-missing"]) == (effect["missing"] != "")
        if effect["missing"]:
            assert now["complete"] is False
        else:
            (sure,) = effect["sureness"]
            expected = expected_of(warm.terms[0].driver, whole[: at + 1])
            assert sure["corrected"] == pytest.approx(expected, abs=0.25)
    assert "were missing" in said[0]
    assert gap_min > 12 or said[-1] == ""


async def test_the_etag_changes_with_what_drives_effects(client, app):
    adopt(app, LAG)
    await stored(client, warm_up(70)[1:])
    path = f"{ROOM}/compensation"
    first = await client.get(path)
    same = await client.get(path, headers={"if-none-match": first.headers["etag"]})
    assert same.status_code == 304
    await stored(client, reading(START - timedelta(seconds=90), 28.0))  # late, within the past
    other = await client.get(path, headers={"if-none-match": first.headers["etag"]})
    assert other.status_code == 200
    assert other.json()["components"] != first.json()["components"]


async def test_a_past_that_could_not_be_restored_is_restored_later(client, app, monkeypatch):
    adopt(app, LAG)
    readings = warm_up(70)
    late = readings.pop(60)
    await stored(client, readings)
    before = await current(client)
    with monkeypatch.context() as patched:

        def away(*_arguments):
            raise StorageUnavailable("the database is away: cut in the middle")

        patched.setattr("app.services.load_machine.recent_readings", away)
        await stored(client, late)
        assert numbers(await current(client)).tolist() == numbers(before).tolist()
    DatabaseFollower(app.state.context, every_s=1.0).look()
    after = await current(client)
    assert after["complete"] is True
    assert numbers(after).tolist() != numbers(before).tolist()
    said = await predicted(client, {"component": "EZZ", "position_mm": 500})
    expected = by_code(after)["EZZ"]["errors_um"][-1:]
    assert said["predicted_um"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
async def test_readings_from_many_sides_while_effects_are_adopted_are_all_taken_in(app, client):
    readings = warm_up(90)
    adopt(app, SPEED_LATE)

    def store(k):
        context = app.state.context
        for one in readings[k::3]:
            time = datetime.fromisoformat(one["time"])
            store_readings(
                context, "mcfv5050", [Reading(time, one["temperatures_c"], one["state"])]
            )

    threads = [threading.Thread(target=store, args=(k,)) for k in range(3)]
    for thread in threads:
        thread.start()
    adopt(app, LAG)
    for thread in threads:
        thread.join()
    document = await current(client)
    assert document["complete"] is True
    said = await predicted(
        client,
        {"component": "EZZ", "position_mm": 500},
        {"component": "EXX", "position_mm": 0},
    )
    table = by_code(document)
    expected = [table["EZZ"]["errors_um"][-1], table["EXX"]["errors_um"][0]]
    assert said["predicted_um"] == pytest.approx(expected, abs=1e-9)


# --- versions -------------------------------------------------------------------------------


@pytest.mark.slow
async def test_activating_the_version_before_takes_effects_back(client, app):
    readings = warm_up()
    await stored(client, readings)
    without = await current(client)
    adopt(app, LAG, BACKLASH)
    with_effects = await current(client)
    assert numbers(with_effects).size > numbers(without).size
    await client.post(f"{ROOM}/models/3/activate")
    assert (await current(client))["components"] == without["components"]
    await client.post(f"{ROOM}/models/4/activate")
    again = await current(client)
    np.testing.assert_allclose(numbers(again), numbers(with_effects), rtol=0, atol=1e-9)
    old = await client.post(
        f"{ROOM}/predictions",
        json={
            "model_version": 3,
            "observations": [{"time": iso(START), "component": "EZZ", "position_mm": 500}],
        },
    )
    assert old.json()["predicted_um"] == pytest.approx([by_code(without)["EZZ"]["errors_um"][-1]])


async def test_what_is_refitted_takes_its_place_and_what_is_dropped_goes(client, app):
    adopt(app, LAG, SPEED, BACKLASH)
    origin = Provenance(1, (7,), (1, 2))
    later = replace(LAG, parameters={"time_constant_min": 14.0, "share": 1.0}, provenance=origin)
    becomes = [
        RefittedEffect(LAG, later, "refitted", True, "10 → 14 min"),
        RefittedEffect(SPEED, None, "dropped", True, "dropped"),
    ]
    context = app.state.context
    with changing_machine(context, "mcfv5050") as change:
        made = version_with_effects(
            *(context, change, [], "refitted in a test"), refitted=becomes, accept_losses=True
        )
    document = (await client.get(f"{ROOM}/models/{made.version.version}")).json()
    assert [e["kind"] for e in document["effects"]] == ["thermal-lag", "backlash"]
    lag = document["effects"][0]
    assert lag["parameters"]["time_constant_min"] == 14.0
    assert (lag["found_by"], lag["refitted_by"]) == (1, [7])


async def test_a_version_shows_its_effects(client, app):
    adopt(app, LAG)
    version = adopt(app, SPEED).version
    document = (await client.get(f"{ROOM}/models/{version.version}")).json()
    assert [e["kind"] for e in document["effects"]] == ["thermal-lag", "state-variable"]
    assert document["effects"][0] == {
        "kind": "thermal-lag",
        "variant": "",
        "components": ["EZZ"],
        "sensors": ["z-column"],
        "states": [],
        "parameters": {"time_constant_min": 10.0, "share": 1.0},
        "standard_errors": {},
        "explanation": "EZZ follows z-column 10 min late",
        "valid": LAG.learnt_fields,
        "found_by": None,
        "refitted_by": [],
        "measure_again": "",
    }
    assert document["reason"] == "adopted in a test"


async def test_effects_are_carried_over_to_the_next_version(client, app):
    adopt(app, LAG, SPEED, OUTDATED)
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "y-front"})
    versions = (await client.get(f"{ROOM}/models")).json()
    kinds = [e["kind"] for e in versions[-1]["effects"]]
    assert kinds == ["thermal-lag", "state-variable", "outdated-map"]
    await client.put(f"{ROOM}/sensor-assignment", json={"EZZ": "spindle"})
    newest = (await client.get(f"{ROOM}/models")).json()[-1]
    assert [e["kind"] for e in newest["effects"]] == ["state-variable", "outdated-map"]
    assert newest["reason"] == (
        "assigned EZZ to spindle; thermal-lag of EZZ left out: EZZ follows spindle now"
    )


@pytest.mark.slow
async def test_a_component_that_is_measured_again_is_not_corrected_twice(client, app):
    adopt(app, OUTDATED, SPEED)
    await stored(client, reading(START, 35.0, state={"spindle_rpm": 0.0}))
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    newest = (await client.get(f"{ROOM}/models")).json()[-1]
    assert [e["kind"] for e in newest["effects"]] == ["state-variable"]
    assert newest["reason"] == (
        "map 'Run #9' stored; outdated-map of EXX left out: it was measured again in map 'Run #9'"
    )
    assert by_code(await current(client))["EXX"]["errors_um"][0] == pytest.approx(0.0)
    elsewhere = error_map("Run #10", 44.0, components=[table("EYY", [0, 500], [0.0, 1.0])])
    adopt(app, OUTDATED)
    await client.post(f"{ROOM}/error-maps", json=elsewhere)
    newest = (await client.get(f"{ROOM}/models")).json()[-1]
    assert [e["kind"] for e in newest["effects"]] == ["state-variable", "outdated-map"]


async def test_a_sensor_that_an_effect_needs_cannot_go(client, app):
    await client.patch(ROOM, json={"sensors": [*MACHINE["sensors"], {"name": "bed"}]})
    needs_bed = Effect(
        "nonrigid-slope",
        ("EXX^z",),
        ("bed",),
        variant="with temperature",
        parameters={"slope_um_per_m_per_k": 2.0},
        terms=(Term("EXX^z", AboveReference("bed", 25.0), Everywhere(), 2.0),),
    )
    adopt(app, needs_bed)
    found = problem(await client.patch(ROOM, json={"sensors": MACHINE["sensors"]}), 409)
    assert "bed" in found["detail"]
    assert "adopted effects" in found["detail"]


# --- what is refused ------------------------------------------------------------------------


async def test_effects_that_cannot_be_evaluated_are_refused(client, app):
    with pytest.raises(InvalidContent, match="at least one effect"):
        adopt(app)
    nowhere = Effect(
        "nonrigid-slope",
        ("EXX^z",),
        ("nose",),
        variant="with temperature",
        parameters={"slope_um_per_m_per_k": 2.0},
        terms=(Term("EXX^z", AboveReference("nose", 25.0), Everywhere(), 2.0),),
    )
    with pytest.raises(InvalidContent, match="got nose"):
        adopt(app, OUTDATED, nowhere)
    adopt(app, OUTDATED)
    with pytest.raises(Conflict, match="already has this effect"):
        adopt(app, OUTDATED)
    with pytest.raises(UnknownThing):
        adopt(app, OUTDATED, machine_id="nowhere")
    versions = (await client.get(f"{ROOM}/models")).json()
    assert [len(v["effects"]) for v in versions] == [0, 0, 0, 1]
    await client.post("/v1/machines", json=MACHINE | {"id": "bare"})
    with pytest.raises(Conflict, match="no model yet"):
        adopt(app, OUTDATED, machine_id="bare")

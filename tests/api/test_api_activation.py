"""Model versions that lose something against the active one: shown before, stored, not activated.

The example machine has EXX, EBX and EZZ from 0 to 500 mm in maps at 20, 24 and 30 °C of x-middle.
"""

from datetime import timedelta

import pytest

from tests.effect_examples import ROLL, SPEED, adopt, current, stored
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    by_code,
    contents,
    error_map,
    iso,
    problem,
    reading,
    table,
    temperatures,
)

pytestmark = pytest.mark.anyio

POSITIONING = {
    "label": "short",
    "measured_at": iso(START - timedelta(days=1)),
    "axis": "x",
    "targets_mm": [0, 50, 100],
    "forward_um": [[0.0, 5.0, 10.0], [0.2, 5.2, 10.2]],
}
"""An axis of 500 mm, measured from 0 to 100 mm."""


def short(label, t_c, code="EXX", to_mm=100):
    """A map of one component over a part of its axis."""
    components = [table(code, [0, to_mm], [0.0, t_c - 20.0])]
    return error_map(label, t_c, components=components)


async def model_numbers(client):
    machine = (await client.get(ROOM)).json()
    return machine["active_model"], machine["waiting_model"]


async def labels(client, version):
    return [m["label"] for m in (await client.get(f"{ROOM}/models/{version}")).json()["maps"]]


def losses(document):
    return [
        (part["component"], part["what"], part.get("from_mm"), part.get("to_mm"))
        for part in document
    ]


@pytest.mark.parametrize(
    ("t_c", "from_c", "to_c"), [(22.0, 20.0, 24.0), (40.0, 30.0, None)],
    ids=["between the maps", "beside them, where the last one was held"],
)  # fmt: skip
async def test_a_short_positioning_measurement_is_stored_and_not_activated(
    client, t_c, from_c, to_c
):
    await stored(client, [reading(START, 29.0)])
    before = await current(client)
    body = POSITIONING | {"temperatures_c": temperatures(t_c)}
    answer = await client.post(f"{ROOM}/measurements/positioning?store=true", json=body)
    assert answer.status_code == 200
    document = answer.json()
    assert (document["stored"], document["activated"], document["model_version"]) == (
        True,
        False,
        4,
    )
    short_of = [part for part in document["loses"] if part["what"] == "positions"]
    (lost,) = short_of
    assert (lost["component"], lost["from_mm"], lost["to_mm"]) == ("EXX", 100, 500)
    assert (lost["sensor"], lost["from_c"], lost["to_c"]) == ("x-middle", from_c, to_c)
    assert "Version 4 is stored and waits" in document["next_step"]
    assert "activat" in document["next_step"]
    after = await current(client)
    assert after["model_version"] == 3
    assert by_code(after)["EXX"] == by_code(before)["EXX"]
    assert await model_numbers(client) == (3, 4)
    listed = (await client.get(f"{ROOM}/models")).json()
    assert [(v["active"], v["waiting"]) for v in listed[2:]] == [(True, False), (False, True)]


async def test_activating_the_version_that_waits_says_what_is_lost(client):
    answer = await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    assert answer.status_code == 201
    assert answer.json()["in_active_model"] is False
    lost = answer.json()["loses"]
    look = (await client.post(f"{ROOM}/models/4/activate?preview=true")).json()
    assert losses(look["loses"]) == losses(lost)
    assert await model_numbers(client) == (3, 4)
    activated = (await client.post(f"{ROOM}/models/4/activate")).json()
    assert (activated["active"], activated["activated"]) == (True, True)
    assert losses(activated["loses"]) == losses(lost)
    assert await model_numbers(client) == (4, None)


async def test_the_status_names_the_version_that_waits_until_none_does(client):
    await stored(client, [reading(START, 25.0)])
    before = (await client.get(f"{ROOM}/status")).json()
    await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    waits = (await client.get(f"{ROOM}/status")).json()
    assert waits["verdict"] == before["verdict"]
    said = [one for one in waits["sentences"] if one not in before["sentences"]]
    assert [one.partition(",")[0] for one in said] == ["Version 4 waits to be activated"]
    await client.post(f"{ROOM}/models/3/activate")
    assert (await client.get(f"{ROOM}/status")).json()["sentences"] == before["sentences"]


async def test_losses_that_are_accepted_are_activated_at_once(client):
    path = f"{ROOM}/error-maps?accept_losses=true"
    document = (await client.post(path, json=short("short", 40.0))).json()
    assert (document["activated"], document["in_active_model"]) == (True, True)
    assert losses(document["loses"])[0] == ("EXX", "positions", 100, 500)
    assert "next_step" not in document
    assert await model_numbers(client) == (4, None)


async def test_the_same_map_again_with_losses_accepted_activates_what_waits(client):
    await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    again = await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    assert again.status_code == 200
    assert (again.json()["activated"], again.json()["model_version"]) == (False, 4)
    assert again.json()["loses"]
    accepted = await client.post(f"{ROOM}/error-maps?accept_losses=true", json=short("short", 40.0))
    assert accepted.json()["activated"] is True
    assert await model_numbers(client) == (4, None)
    assert len((await client.get(f"{ROOM}/models")).json()) == 4


async def test_maps_stored_one_after_another_while_a_version_waits_are_all_in_it(client):
    for number, (label, t_c) in enumerate({"a": 35.0, "b": 40.0, "c": 45.0}.items(), start=4):
        document = (await client.post(f"{ROOM}/error-maps", json=short(label, t_c))).json()
        assert (document["activated"], document["model_version"]) == (False, number)
    assert await model_numbers(client) == (3, 6)
    assert (await labels(client, 6))[3:] == ["a", "b", "c"]
    await client.post(f"{ROOM}/models/6/activate")
    listed = (await client.get(f"{ROOM}/error-maps")).json()
    assert all(m["in_active_model"] for m in listed)


async def test_losses_of_what_waits_already_are_told_from_new_ones(client):
    await client.post(f"{ROOM}/error-maps", json=short("first", 40.0))
    look = (await client.post(f"{ROOM}/error-maps?preview=true", json=short("x", 45.0))).json()
    document = (await client.post(f"{ROOM}/error-maps", json=short("second", 45.0))).json()
    listed = (await client.get(f"{ROOM}/error-maps")).json()
    number = next(m["id"] for m in listed if m["label"] == "first")
    for answer in (look, document):
        before = answer["waited_before"]
        assert (before["model_version"], before["maps"]) == (4, [{"id": number, "label": "first"}])
        assert before["loses"]
        assert all(part in answer["loses"] for part in before["loses"])
    assert document["stays_active"] == 3


async def test_what_waits_goes_live_by_itself_once_nothing_is_lost(client):
    """A component that one map has makes tables incomplete; with a second map they have it."""
    one = error_map("Run #9", 40.0)
    one["components"].append(table("EYY", [0, 500], [0, 1]))
    document = (await client.post(f"{ROOM}/error-maps", json=one)).json()
    assert document["activated"] is False
    (lost,) = document["loses"]
    assert (lost["component"], lost["what"]) == ("EYY", "completeness")
    assert "at least two maps" in lost["text"]
    two = error_map("Run #10", 45.0)
    two["components"].append(table("EYY", [0, 500], [0, 2]))
    document = (await client.post(f"{ROOM}/error-maps", json=two)).json()
    assert (document["activated"], document["loses"]) == (True, [])
    assert "EYY" in (await client.get(f"{ROOM}/models/5/coverage")).json()["components"]
    assert await model_numbers(client) == (5, None)
    assert await labels(client, 5) == ["Run #1", "Run #3", "Run #6", "Run #9", "Run #10"]


async def test_deleting_the_map_that_makes_a_version_wait_ends_its_waiting(client):
    first = (await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))).json()
    await client.post(f"{ROOM}/error-maps", json=error_map("long", 50.0))
    assert await model_numbers(client) == (3, 5)
    assert (await client.delete(f"{ROOM}/error-maps/{first['id']}")).status_code == 204
    assert await model_numbers(client) == (6, None)  # the long map loses nothing
    assert await labels(client, 6) == ["Run #1", "Run #3", "Run #6", "long"]


async def test_deleting_the_only_map_that_waits_leaves_the_active_version(client):
    first = (await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))).json()
    await client.delete(f"{ROOM}/error-maps/{first['id']}")
    assert await model_numbers(client) == (3, None)
    assert len((await client.get(f"{ROOM}/models")).json()) == 4


async def test_a_look_at_a_deletion_says_what_it_does_and_deletes_nothing(client, app):
    await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
    before = contents(app)
    table_before = by_code(await current(client))
    answer = await client.delete(f"{ROOM}/error-maps/3", params={"preview": "true"})
    assert answer.status_code == 200
    look = answer.json()
    assert (look["preview"], look["activated"], look["active_version"]) == (True, True, 3)
    assert look["reason"] == "map 'Run #6' deleted"
    assert contents(app) == before
    # At 25 °C the tables lie between the maps at 24 and 30 °C, and end at 24 °C without the latter.
    assert {part["component"] for part in look["loses"]} == {"EXX", "EBX", "EZZ", "SXY"}
    assert (await client.delete(f"{ROOM}/error-maps/3")).status_code == 204
    table_after = by_code(await current(client))
    change = next(change for change in look["changes"] if change["component"] == "EXX")
    before_um, after_um = (t["EXX"]["errors_um"][-1] for t in (table_before, table_after))
    assert (before_um, after_um) == (25.0, 20.0)
    assert (change["position_mm"], change["change"]) == (500.0, -5.0)


async def test_a_look_at_the_deletion_of_a_map_that_no_table_has(client, app):
    await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    assert await model_numbers(client) == (3, 4)
    before = contents(app)
    answer = await client.delete(f"{ROOM}/error-maps/4", params={"preview": "true"})
    look = answer.json()
    assert look["reason"] == "map 'short' deleted, which the active model does not have"
    assert (look["loses"], look["gains"], look["changes"]) == ([], [], [])
    assert contents(app) == before
    missing = await client.delete(f"{ROOM}/error-maps/9", params={"preview": "true"})
    assert "has no error map 9" in problem(missing, 404)["detail"]


async def test_deleting_an_active_map_does_not_activate_what_waits(client):
    await client.post(f"{ROOM}/error-maps", json=short("short", 27.0))
    run_1 = (await client.get(f"{ROOM}/error-maps")).json()[0]["id"]
    await client.delete(f"{ROOM}/error-maps/{run_1}")
    active, waiting = await model_numbers(client)
    assert await labels(client, active) == ["Run #3", "Run #6"]
    assert await labels(client, waiting) == ["Run #3", "Run #6", "short"]


async def test_activating_the_active_version_gives_up_what_waits(client):
    await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    answer = await client.post(f"{ROOM}/models/3/activate")
    assert answer.status_code == 200
    assert await model_numbers(client) == (3, None)
    document = (await client.post(f"{ROOM}/error-maps", json=error_map("long", 50.0))).json()
    assert document["activated"] is True
    assert await labels(client, 5) == ["Run #1", "Run #3", "Run #6", "long"]


async def test_activating_an_older_version_says_what_is_lost(client):
    document = (await client.post(f"{ROOM}/models/2/activate")).json()
    assert document["active"] is True
    found = {(p["component"], p["what"], p["sensor"], p["from_c"], p["to_c"])
             for p in document["loses"]}  # fmt: skip
    assert ("EXX", "temperatures", "x-middle", 24.0, 30.0) in found
    assert ("EZZ", "temperatures", "z-column", 26.0, 32.0) in found
    back = (await client.post(f"{ROOM}/models/3/activate")).json()
    assert back["loses"] == []
    assert len(back["gains"]) == len(document["loses"])


async def test_an_assignment_that_loses_is_stored_and_not_activated(empty):
    """Maps at one temperature count as one here, and one is too few: EXX would be gone."""
    await empty.post("/v1/machines", json=MACHINE | {"same_temperature": "mean"})
    for label, t_c in {"a": 20.0, "b": 25.0}.items():
        content = error_map(label, t_c)
        content["temperatures_c"]["spindle"] = 30.0
        await empty.post(f"{ROOM}/error-maps", json=content)
    path, wish = f"{ROOM}/sensor-assignment", {"EXX": "spindle"}
    before = (await empty.get(path)).json()
    look = (await empty.put(f"{path}?preview=true", json=wish)).json()
    assert (look["activated"], losses(look["loses"])) == (False, [("EXX", "component", None, None)])
    answer = await empty.put(path, json=wish)
    assert answer.status_code == 202
    document = answer.json()
    assert (document["activated"], document["model_version"]) == (False, 3)
    assert document["loses"] == look["loses"]
    assert document["assignment"] == before | wish
    assert (await empty.get(path)).json() == before
    assert await model_numbers(empty) == (2, 3)
    accepted = await empty.put(f"{path}?accept_losses=true", json=wish)
    assert (accepted.status_code, accepted.json()) == (200, before | wish)
    assert await model_numbers(empty) == (3, None)


async def test_an_effect_that_needs_a_state_that_readings_lack_waits(client, app):
    await stored(client, [reading(START, 25.0)])
    made = adopt(app, SPEED, accept_losses=False)
    assert not made.is_active
    (lost,) = made.change.loses
    assert lost.what == "completeness"
    assert "spindle_rpm" in lost.text
    await client.post(f"{ROOM}/models/3/activate")
    later = reading(START + timedelta(seconds=1), 25.0, state={"spindle_rpm": 8000.0})
    await stored(client, [later])
    assert adopt(app, SPEED, accept_losses=False).is_active


async def test_effects_are_adopted_by_the_active_version_and_by_the_one_that_waits(client, app):
    await client.post(f"{ROOM}/error-maps", json=short("short", 27.0, "EZZ"))
    assert adopt(app, ROLL, accept_losses=False).is_active
    active, waiting = await model_numbers(client)
    assert (active, waiting) == (5, 6)
    for version, expected in ((active, []), (waiting, ["short"])):
        shown = (await client.get(f"{ROOM}/models/{version}")).json()
        assert [e["kind"] for e in shown["effects"]] == ["angular"]
        assert [m["label"] for m in shown["maps"]][3:] == expected


async def test_effects_that_wait_wait_together_with_the_maps_that_do(client, app):
    await stored(client, [reading(START, 25.0)])
    await client.post(f"{ROOM}/error-maps", json=short("short", 27.0, "EZZ"))
    assert not adopt(app, SPEED, accept_losses=False).is_active
    active, waiting = await model_numbers(client)
    assert (active, waiting) == (3, 5)
    shown = (await client.get(f"{ROOM}/models/{waiting}")).json()
    assert [e["states"] for e in shown["effects"]] == [["spindle_rpm"]]
    assert [m["label"] for m in shown["maps"]][3:] == ["short"]


async def test_a_preview_stores_nothing_and_says_by_how_much_tables_would_change(client, app):
    """At 40 °C the tables are held at the 30 °C map; the new map has EXX 30 µm at 500 mm."""
    await stored(client, [reading(START, 40.0)])
    before = contents(app)
    new = error_map("new", 40.0)
    new["components"][0] = table("EXX", [0, 100, 500], [0.0, 10.0, 30.0])
    answer = await client.post(f"{ROOM}/error-maps?preview=true", json=new)
    assert answer.status_code == 200
    document = answer.json()
    assert document["preview"] is True
    assert document["activated"] is True
    assert document["loses"] == []
    assert document["active_version"] == 3
    assert document["reading_time"] == iso(START)
    assert document["temperatures_c"]["x-middle"] == 40.0
    # Before: EXX 50 µm at 500 mm, EBX 100 µrad, EZZ 100 µm, SXY −30 µm/m, all held.
    changes = {c["component"]: c for c in document["changes"]}
    assert changes["EXX"]["change"] == pytest.approx(-20.0)
    assert changes["EXX"]["position_mm"] == 500
    assert (changes["EXX"]["status_before"], changes["EXX"]["status_after"]) == (
        "clamped",
        "at-map",
    )
    assert changes["EBX"]["change"] == pytest.approx(100.0)
    assert changes["SXY"]["change"] == pytest.approx(-10.0)
    sizes = [abs(c["change"]) for c in document["changes"]]
    assert sizes == sorted(sizes, reverse=True)
    assert contents(app) == before


async def test_a_preview_says_what_would_have_changed_at_what_was_recorded(client):
    """As where a map's sensors were swapped, while the machine now is as cold as its first map."""
    warm = START - timedelta(hours=2)
    cold = [reading(START - timedelta(minutes=minutes), 20.0) for minutes in (60, 30, 0)]
    await stored(client, [reading(warm, 28.0), *cold])
    new = error_map("new", 27.0)
    new["components"] = [table("EXX", [0, 100, 500], [0.0, 14.0, 70.0])]
    path = f"{ROOM}/error-maps?preview=true"
    document = (await client.post(path, json=new)).json()
    assert [c["change"] for c in document["changes"] if c["component"] == "EXX"] == [0.0]
    recorded = document["recorded"]
    assert (recorded["count"], recorded["first_at"], recorded["last_at"]) == (
        4,
        iso(warm),
        iso(START),
    )
    # Before: 40 µm between 20 and 50 µm; afterwards a third of the way from 70 to 50 µm.
    (change,) = recorded["changes"]
    assert change["component"] == "EXX"
    assert change["change"] == pytest.approx(70.0 - 20.0 / 3.0 - 40.0)
    assert (change["position_mm"], change["time"]) == (500, iso(warm))
    assert change["temperatures_c"]["x-middle"] == 28.0


async def test_a_spread_of_many_readings_finds_the_few_that_were_warm(client):
    """One hour in ten days: evenly chosen readings alone might miss it, warmth does not."""
    minutes = range(0, 14400, 10)
    await stored(
        client,
        [
            reading(START - timedelta(minutes=m), 28.0 if 7200 < m <= 7400 else 20.0 + m % 7 / 10)
            for m in minutes
        ],
    )
    new = error_map("new", 27.0)
    new["components"] = [table("EXX", [0, 100, 500], [0.0, 14.0, 70.0])]
    recorded = (await client.post(f"{ROOM}/error-maps?preview=true", json=new)).json()["recorded"]
    assert recorded["count"] <= 24
    assert recorded["changes"][0]["change"] == pytest.approx(70.0 - 20.0 / 3.0 - 40.0)


async def test_a_preview_of_a_measurement_stores_nothing(client, app):
    before = contents(app)
    body = POSITIONING | {"temperatures_c": temperatures(40.0)}
    answer = await client.post(f"{ROOM}/measurements/positioning?preview=true", json=body)
    document = answer.json()
    assert (document["stored"], document["activated"]) == (False, False)
    assert ("EXX", "positions", 100, 500) in losses(document["loses"])
    assert document["preview"]["loses"] == document["loses"]
    assert document["preview"]["not_compared"]  # there is no reading
    assert contents(app) == before


@pytest.mark.slow
async def test_what_a_preview_says_is_what_storing_does(client):
    for new in (short("x", 27.0), short("y", 10.0, "EZZ", 300), error_map("z", 50.0)):
        look = (await client.post(f"{ROOM}/error-maps?preview=true", json=new)).json()
        done = (await client.post(f"{ROOM}/error-maps", json=new)).json()
        for field in ("activated", "loses", "gains"):
            assert look[field] == done[field]


async def test_a_preview_refuses_what_storing_refuses(client, app):
    before = contents(app)
    path = f"{ROOM}/error-maps?preview=true"
    assert (await client.post(path, json=error_map("Run #1", 21.0))).status_code == 409
    assert (await client.post(path, json=error_map("new", 30.01))).status_code == 409
    assert (await client.post(f"{ROOM}/models/9/activate?preview=true")).status_code == 404
    assert contents(app) == before


async def test_a_sensor_of_the_version_that_waits_cannot_go(client):
    await client.post(f"{ROOM}/error-maps", json=short("short", 40.0))
    await client.put(f"{ROOM}/sensor-assignment", json={"SXY": "spindle"})
    answer = await client.patch(ROOM, json={"sensors": MACHINE["sensors"][:3]})
    assert answer.status_code == 409


async def test_a_version_says_which_components_its_tables_have(client):
    await client.patch(ROOM, json={"sensors": [*MACHINE["sensors"], {"name": "c-axis"}]})
    new = error_map("Run #9", 40.0)
    new["components"].append({"component": "XOC", "value_um": 1.0})
    await client.post(f"{ROOM}/error-maps", json=new)
    assert (await client.get(f"{ROOM}/models/4/coverage")).json() == {
        "model_version": 4,
        "components": ["EXX", "EBX", "EZZ", "SXY"],
        "omitted": {"XOC": "no sensor is assigned to it"},
    }

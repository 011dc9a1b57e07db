"""Sensor assignment and model versions over HTTP."""

import pytest

from tests.service_examples import (
    MACHINE,
    MAPS,
    ROOM,
    START,
    by_code,
    contents,
    error_map,
    iso,
    problem,
    table,
)

pytestmark = pytest.mark.anyio

DEFAULTS = {"EXX": "x-middle", "EBX": "x-middle", "EZZ": "z-column", "SXY": "x-middle"}
STATED = {"temperatures_c": {"x-middle": 22.0, "z-column": 30.0}}


async def versions(client):
    return (await client.get(f"{ROOM}/models")).json()


async def active(client):
    (found,) = [v["version"] for v in await versions(client) if v["active"]]
    return found


async def test_every_stored_map_makes_the_next_version(client):
    listed = await versions(client)
    assert [v["version"] for v in listed] == [1, 2, 3]
    assert [v["active"] for v in listed] == [False, False, True]
    labels = [[m["label"] for m in v["maps"]] for v in listed]
    assert labels == [["Run #1"], ["Run #1", "Run #3"], ["Run #1", "Run #3", "Run #6"]]
    newest = listed[-1]
    assert newest["created_at"] == iso(START)
    assert newest["assignment"] == DEFAULTS
    assert newest["effects"] == []
    assert newest["maps"][2]["temperatures_c"]["x-middle"] == MAPS["Run #6"]
    assert (await client.get(f"{ROOM}/models/3")).json() == newest
    assert (await client.get(ROOM)).json()["active_model"] == 3


@pytest.mark.parametrize("version", [0, 4, 10**40])
async def test_an_unknown_version_is_told_with_those_that_exist(client, app, version):
    before = contents(app)
    for answer in (
        await client.get(f"{ROOM}/models/{version}"),
        await client.post(f"{ROOM}/models/{version}/activate"),
    ):
        assert "1, 2, 3" in problem(answer, 404)["detail"]
    assert contents(app) == before


async def test_any_old_version_can_be_activated_again(client):
    answer = await client.post(f"{ROOM}/models/2/activate")
    assert answer.status_code == 200
    assert answer.json()["version"] == 2
    assert answer.json()["active"] is True
    assert await active(client) == 2
    assert [v["version"] for v in await versions(client)] == [1, 2, 3]
    document = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    assert document["model_version"] == 2
    assert by_code(document)["EZZ"]["status"] == "clamped"  # Run #6 is not in it
    await client.post(f"{ROOM}/models/3/activate")
    document = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    assert document["model_version"] == 3
    assert by_code(document)["EZZ"]["status"] == "interpolated"


async def test_activating_the_active_version_changes_nothing(client, app):
    before = contents(app)
    assert (await client.post(f"{ROOM}/models/3/activate")).status_code == 200
    assert contents(app) == before


async def test_a_map_stored_after_an_old_version_was_activated_derives_from_that(client):
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "y-front"})  # version 4
    await client.post(f"{ROOM}/models/2/activate")
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    newest = (await versions(client))[-1]
    assert newest["version"] == 5
    assert newest["active"] is True
    assert [m["label"] for m in newest["maps"]] == ["Run #1", "Run #3", "Run #9"]
    assert newest["assignment"] == DEFAULTS


async def test_versions_never_change(client):
    before = await versions(client)
    ids = [m["id"] for m in (await client.get(f"{ROOM}/error-maps")).json()]
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "spindle"})
    await client.delete(f"{ROOM}/error-maps/{ids[0]}")
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #1", 15.0))
    await client.patch(ROOM, json={"sensors": [*MACHINE["sensors"], {"name": "new"}]})
    await client.post(f"{ROOM}/models/1/activate")
    after = await versions(client)
    unchanged = [{**v, "active": None} for v in before]
    assert [{**v, "active": None} for v in after[:3]] == unchanged
    assert len(after) == 6


async def test_a_version_keeps_a_map_that_was_deleted(client):
    stated = {"temperatures_c": {"x-middle": 22.0, "z-column": 24.0}}
    table_before = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    run_3 = (await client.get(f"{ROOM}/error-maps")).json()[1]["id"]
    await client.delete(f"{ROOM}/error-maps/{run_3}")
    assert [m["label"] for m in (await versions(client))[3]["maps"]] == ["Run #1", "Run #6"]
    await client.post(f"{ROOM}/models/3/activate")
    assert (await client.post(f"{ROOM}/compensation", json=stated)).json() == table_before


async def test_deleting_a_map_that_the_active_version_lacks_makes_no_version(client):
    await client.post(f"{ROOM}/models/2/activate")
    run_6 = (await client.get(f"{ROOM}/error-maps")).json()[2]
    assert run_6["in_active_model"] is False
    assert (await client.delete(f"{ROOM}/error-maps/{run_6['id']}")).status_code == 204
    assert await active(client) == 2
    assert len(await versions(client)) == 3


async def test_the_assignment_is_shown_in_the_order_of_the_components(client):
    shown = (await client.get(f"{ROOM}/sensor-assignment")).json()
    assert list(shown.items()) == list(DEFAULTS.items())


async def test_assigning_changes_the_named_components_and_makes_a_version(client):
    answer = await client.put(
        f"{ROOM}/sensor-assignment", json={"D_x(x)": "spindle", "C0Y": "y-front"}
    )
    assert answer.status_code == 200
    expected = DEFAULTS | {"EXX": "spindle", "SXY": "y-front"}
    assert answer.json() == expected
    assert (await client.get(f"{ROOM}/sensor-assignment")).json() == expected
    newest = (await versions(client))[-1]
    assert newest["version"] == 4
    assert newest["assignment"] == expected
    assert "EXX" in newest["reason"]
    # Run #3 has spindle at 29 °C and Run #6 at 35 °C.
    stated = {"temperatures_c": {"x-middle": 21, "y-front": 29, "z-column": 24, "spindle": 30.5}}
    entries = by_code((await client.post(f"{ROOM}/compensation", json=stated)).json())
    assert entries["EXX"]["sensor"] == "spindle"
    assert entries["EXX"]["weight"] == 0.25
    assert entries["SXY"]["status"] == "at-map"
    assert entries["EBX"]["sensor"] == "x-middle"


async def test_the_same_assignment_again_makes_no_version(client, app):
    before = contents(app)
    for same in (DEFAULTS, {"EXX": "x-middle"}, {}):
        answer = await client.put(f"{ROOM}/sensor-assignment", json=same)
        assert answer.json() == DEFAULTS
    assert contents(app) == before


async def test_sensors_can_be_assigned_before_the_first_map(empty):
    await empty.post("/v1/machines", json=MACHINE)
    assert (await empty.get(f"{ROOM}/sensor-assignment")).json() == {}
    await empty.put(f"{ROOM}/sensor-assignment", json={"EXX": "spindle"})
    await empty.post(f"{ROOM}/error-maps", json=error_map("Run #1", 20.0))
    assert (await empty.get(f"{ROOM}/sensor-assignment")).json() == DEFAULTS | {"EXX": "spindle"}


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"EXX": "nose"}, "EXX"),
        ({"EXX": "x-middle", "EQQ": "x-middle"}, "EQQ"),
        ({"EXX": "spindle", "D_x(x)": "y-front"}, "D_x(x)"),
        ({"EXX": None}, "EXX"),
        ({"EXX": 3}, "EXX"),
        ([], "body"),
        (None, "body"),
    ],
)
async def test_a_wrong_assignment_changes_nothing(client, app, body, field):
    before = contents(app)
    found = problem(await client.put(f"{ROOM}/sensor-assignment", json=body), 422)
    assert field in [e["field"] for e in found["errors"]]
    assert contents(app) == before


async def test_a_sensor_without_temperatures_in_the_maps_cannot_be_followed(client, app):
    sensors = [*MACHINE["sensors"], {"name": "nose"}]
    await client.patch(ROOM, json={"sensors": sensors})
    before = contents(app)
    found = problem(await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "nose"}), 422)
    assert "nose" in found["detail"]
    assert "Run #1" in found["detail"]
    assert contents(app) == before


@pytest.mark.slow
async def test_correlating_proposes_and_changes_nothing(client, app):
    for t_c, spindle_c in ((33.0, 27.0), (36.0, 22.0), (39.0, 31.0), (42.0, 24.0), (45.0, 21.0)):
        content = error_map(f"Run at {t_c}", t_c)
        content["temperatures_c"]["spindle"] = spindle_c  # goes its own way
        await client.post(f"{ROOM}/error-maps", json=content)
    before = contents(app)
    answer = await client.post(f"{ROOM}/sensor-assignment/correlate")
    assert answer.status_code == 200
    document = answer.json()
    assert document["proposal"] == DEFAULTS
    assert [c["component"] for c in document["components"]] == list(DEFAULTS)
    exx = document["components"][0]
    assert exx["chapter"] == "D_x(x)"
    assert exx["current"] == exx["proposed"] == "x-middle"
    assert exx["maps"] == 8
    sensors = {c["sensor"]: c for c in exx["correlations"]}
    assert list(sensors) == ["x-middle", "y-front", "z-column", "spindle"]
    assert sensors["x-middle"]["r"] == pytest.approx(1.0)
    assert sensors["y-front"]["ties_with_best"] is True
    assert sensors["spindle"]["ties_with_best"] is False
    low, high = sensors["spindle"]["confidence_95"]
    assert -1 <= low < sensors["spindle"]["r"] < high <= 1
    assert contents(app) == before
    assert (await client.put(f"{ROOM}/sensor-assignment", json=document["proposal"])).is_success
    assert contents(app) == before


async def test_correlating_without_maps_proposes_nothing(empty):
    await empty.post("/v1/machines", json=MACHINE)
    answer = await empty.post(f"{ROOM}/sensor-assignment/correlate")
    assert answer.json() == {"proposal": {}, "components": []}


async def test_a_component_that_only_one_map_has_is_said_to_be_left_out(client):
    content = error_map("Run #9", 40.0)
    content["components"].append(table("EYY", [0, 1], [0, 1]))
    await client.post(f"{ROOM}/error-maps?accept_losses=true", json=content)
    document = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    assert document["complete"] is False
    assert any("EYY" in w and "Run #9" in w for w in document["warnings"])
    assert "EYY" not in by_code(document)


async def test_a_version_that_needs_a_sensor_that_is_gone_cannot_be_activated(client, app):
    """Version 4 follows the spindle; nothing that is in use does any more."""
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "spindle"})
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "x-middle"})
    for stored_map in (await client.get(f"{ROOM}/error-maps")).json():
        await client.delete(f"{ROOM}/error-maps/{stored_map['id']}")
    answer = await client.patch(ROOM, json={"sensors": MACHINE["sensors"][:3]})
    assert answer.status_code == 200
    before = contents(app)
    found = problem(await client.post(f"{ROOM}/models/4/activate"), 409)
    assert "spindle" in found["detail"]
    assert contents(app) == before

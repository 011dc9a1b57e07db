"""Machines over HTTP."""

from dataclasses import asdict

import pytest

from app.thermal.machine import Sensor
from tests.service_examples import MACHINE, ROOM, START, contents, error_map, iso, problem

pytestmark = pytest.mark.anyio


async def test_a_machine_comes_back_as_it_was_stated_with_defaults_written_out(empty):
    answer = await empty.post("/v1/machines", json=MACHINE)
    assert answer.status_code == 201
    assert answer.headers["location"] == ROOM
    created = answer.json()
    assert created["id"] == "mcfv5050"
    assert created["name"] == "MCFV5050LN"
    assert created["configuration"] == "XYFZ"
    assert created["axes"]["x"] == {"min_mm": 0, "max_mm": 500}
    assert created["out_of_range"] == "clamp"
    assert created["extrapolation_margin_c"] == 5
    assert created["extrapolation_error_ratio"] == 3
    assert created["same_temperature"] == "refuse"
    assert created["active_model"] is None
    assert created["created_at"] == iso(START)
    usual = Sensor("x-middle", stand_in="y-front")  # the chapter's default, 8.2.9
    stated = {"min_c": -10, "max_c": 80, "max_age_s": 120}
    assert created["sensors"][0] == asdict(usual) | stated
    assert created["sensors"][0]["resolution_c"] == 0.1
    assert [s["stand_in"] for s in created["sensors"][1:]] == [None, None, None]
    assert (await empty.get(ROOM)).json() == created
    assert (await empty.get("/v1/machines")).json() == [created]


async def test_machines_are_listed_by_id(empty):
    for name in ("b", "a", "C"):
        await empty.post("/v1/machines", json=MACHINE | {"id": name})
    listed = (await empty.get("/v1/machines")).json()
    assert sorted(m["id"] for m in listed) == ["C", "a", "b"]


async def test_a_second_machine_of_one_id_is_a_conflict(empty, empty_app):
    await empty.post("/v1/machines", json=MACHINE)
    before = contents(empty_app)
    found = problem(await empty.post("/v1/machines", json=MACHINE | {"name": "other"}), 409)
    assert "mcfv5050" in found["detail"]
    assert contents(empty_app) == before


@pytest.mark.parametrize(
    "path", ["", "/error-maps", "/models", "/sensor-assignment", "/readings", "/compensation"]
)
async def test_an_unknown_machine_is_told_with_those_that_exist(client, path):
    found = problem(await client.get(f"/v1/machines/mcvf5050{path}"), 404)
    assert "mcvf5050" in found["detail"]
    assert "mcfv5050" in found["detail"]


async def test_a_patch_changes_what_it_states_and_nothing_else(client):
    before = (await client.get(ROOM)).json()
    answer = await client.patch(ROOM, json={"name": "Left cell", "out_of_range": "extrapolate"})
    assert answer.status_code == 200
    expected = before | {"name": "Left cell", "out_of_range": "extrapolate"}
    assert answer.json() == expected
    assert (await client.get(ROOM)).json() == expected


async def test_axes_are_changed_one_by_one_and_null_removes_one(client):
    axes = {"x": {"min_mm": -5, "max_mm": 505}, "Y": None}
    changed = (await client.patch(ROOM, json={"axes": axes})).json()
    assert changed["axes"] == {
        "x": {"min_mm": -5, "max_mm": 505},
        "z": {"min_mm": 0, "max_mm": 500},
    }


@pytest.mark.parametrize("ends", [(0, 0.5), (1000, 2000)], ids=["in metres", "elsewhere"])
async def test_a_travel_that_no_stored_map_can_be_of_is_refused(client, app, ends):
    before = contents(app)
    body = {"axes": {"x": dict(zip(("min_mm", "max_mm"), ends, strict=True))}}
    found = problem(await client.patch(ROOM, json=body), 409)
    got = f"got {ends[0]:g} to {ends[1]:g} mm, where map 'Run #1' has EXX from 0 to 500 mm"
    assert got in found["detail"]
    assert contents(app) == before
    longer = {"axes": {"x": {"min_mm": -100, "max_mm": 900}}}
    assert (await client.patch(ROOM, json=longer)).status_code == 200


@pytest.mark.parametrize("name", [["x-middle"], {}, 7, None])
async def test_a_sensor_whose_name_is_no_text_is_refused(client, name):
    sensors = [{"name": name}, {"name": "y-front"}]
    found = problem(await client.patch(ROOM, json={"sensors": sensors}), 422)
    assert [error["field"] for error in found["errors"]] == ["sensors.0.name"]


async def test_a_patch_reaches_the_live_table_at_once(client):
    hot = {"temperatures_c": {"x-middle": 40.0, "z-column": 42.0}}
    table = (await client.post(f"{ROOM}/compensation", json=hot)).json()
    assert {c["status"] for c in table["components"]} == {"clamped"}
    await client.patch(ROOM, json={"out_of_range": "reject"})
    problem(await client.post(f"{ROOM}/compensation", json=hot), 422)


@pytest.mark.parametrize(
    "change",
    [
        {"sensors": MACHINE["sensors"][1:]},
        {"sensors": MACHINE["sensors"][:3]},
        {"configuration": "FXY", "axes": {"z": None}},
    ],
    ids=["sensor that components follow", "sensor that maps have", "axis of maps"],
)
async def test_what_maps_need_cannot_be_taken_away(client, app, change):
    before = contents(app)
    problem(await client.patch(ROOM, json=change), 409)
    assert contents(app) == before
    table = await client.post(
        f"{ROOM}/compensation", json={"temperatures_c": {"x-middle": 25.0, "z-column": 25.0}}
    )
    assert table.status_code == 200


async def test_a_resolution_that_merges_two_maps_is_refused(client, app):
    sensors = [{**s, "resolution_c": 5.0} for s in MACHINE["sensors"]]
    before = contents(app)
    found = problem(await client.patch(ROOM, json={"sensors": sensors}), 409)
    assert "Run #1" in found["detail"]
    assert "Run #3" in found["detail"]
    assert contents(app) == before


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"name": None}, "name"),
        ({"sensors": None}, "sensors"),
        ({"id": "other"}, "id"),
        ({"extrapolation_margin_c": -1}, "extrapolation_margin_c"),
        ({"extrapolation_error_ratio": 0.9}, "extrapolation_error_ratio"),
        ({"configuration": "XYZ"}, "configuration"),
        ({"sensors": [{"name": "a"}, {"name": "a"}]}, "sensors"),
        ({"sensors": [{"name": "a", "stand_in": "b"}]}, "sensors.a.stand_in"),
        ({"axes": {"x": {"min_mm": 5, "max_mm": 5}}}, "axes.x"),
        ({"axes": {"w": {"min_mm": 0, "max_mm": 5}}}, "axes"),
    ],
)
async def test_a_patch_that_makes_no_sense_names_its_field(client, app, change, field):
    before = contents(app)
    found = problem(await client.patch(ROOM, json=change), 422)
    assert field in [e["field"] for e in found["errors"]]
    assert contents(app) == before


async def test_deleting_a_machine_deletes_everything_of_it_and_of_no_other(client, app):
    await client.post("/v1/machines", json=MACHINE | {"id": "other"})
    await client.post("/v1/machines/other/error-maps", json=error_map("Run #1", 20.0))
    reading = {"time": iso(START), "temperatures_c": {"x-middle": 20.0}}
    await client.post(f"{ROOM}/readings", json=reading)
    seen = {"time": iso(START), "component": "EXX", "position_mm": 5, "measured_um": 1.0}
    for machine in (ROOM, "/v1/machines/other"):
        body = {"label": "seen", "observations": [seen]}
        assert (await client.post(f"{machine}/verifications", json=body)).status_code == 201
    answer = await client.delete(ROOM)
    assert (answer.status_code, answer.content) == (204, b"")
    for path in ("", "/compensation", "/readings", "/models"):
        problem(await client.get(f"{ROOM}{path}"), 404)
    problem(await client.delete(ROOM), 404)
    left = contents(app)
    log = left.pop("event")  # what happened is told of a machine that is gone, too
    assert "machine deleted" in log[-1]
    assert all("mcfv5050" not in row for rows in left.values() for row in rows)
    assert {table: len(rows) for table, rows in left.items()} == {
        "machine": 1,
        "error_map": 1,
        "error_map_component": 4,
        "model_version": 1,
        "model_version_map": 1,
        "reading": 0,
        "withdrawn_reading": 0,
        "verification": 1,
        "analysis": 0,
        "watch": 0,
        "access_key": 0,
        "browser_session": 0,
        "connection_report": 0,
        "receiver": 0,
        "temperature_hour": 0,
        "temperature_hours_done": 0,
    }


@pytest.mark.slow
async def test_a_machine_made_again_has_nothing_of_the_old_one(client):
    await client.post(
        f"{ROOM}/readings", json={"time": iso(START), "temperatures_c": {"x-middle": 20.0}}
    )
    await client.delete(ROOM)
    await client.post("/v1/machines", json=MACHINE)
    assert (await client.get(ROOM)).json()["active_model"] is None
    assert (await client.get(f"{ROOM}/error-maps")).json() == []
    assert (await client.get(f"{ROOM}/models")).json() == []
    problem(await client.get(f"{ROOM}/compensation"), 409)
    temperatures = {"temperatures_c": {"x-middle": 25.0}}
    problem(await client.post(f"{ROOM}/compensation", json=temperatures), 422)
    answer = await client.post(f"{ROOM}/error-maps", json=error_map("Run #1", 20.0))
    assert answer.status_code == 201

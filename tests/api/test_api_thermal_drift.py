"""Drift tests over HTTP: figures, maps of thermal states, and a verification in one import."""

from datetime import timedelta

import numpy as np
import pytest

from tests.service_examples import ROOM, START, contents, iso, problem, temperatures

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.parametrize("furnished_url", ["sqlite"], indirect=True),
]

BEGUN = START - timedelta(hours=3)
MINUTES = range(0, 121, 10)


def warm_up(**changes):
    """Two hours of a nest of three: X stands, Y and Z grow with the time, x-middle by 2 K."""
    return {
        "label": "Warm-up",
        "test": "spindle",
        "point_mm": [250, 200, 300],
        "tool_offset_mm": [0, 0, 160],
        "readings": [
            {
                "time": iso(BEGUN + timedelta(minutes=m)),
                "x_um": 1.0,
                "y_um": -0.01 * m,
                "z_um": 4.0 + 0.1 * m,
                "temperatures_c": temperatures(22.0 + m / 60.0),
                "state": {"spindle_rpm": 8000 if 10 <= m <= 100 else 0},
            }
            for m in MINUTES
        ],
    } | changes


def of_a_spindle(**changes):
    """The same, counted as components that the example machine has no map of."""
    components = {"x": "EXY", "y": "EYY", "z": "EZY"}
    return warm_up(components=components, **changes)


async def posted(client, body, query=""):
    answer = await client.post(f"{ROOM}/measurements/thermal-drift?{query}", json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_figures_of_the_running_that_the_state_says(app, client):
    before = contents(app)
    found = await posted(client, warm_up())
    figures = found["figures"]
    # The spindle turns from 10 to 100 min; it was started after the reading at 0 min.
    assert figures["d_Z_60min_um"] == pytest.approx(6.0)
    assert figures["d_Z_running_um"] == pytest.approx(10.0)
    assert figures["Z_at_end_um"] == pytest.approx(12.0)
    assert figures["d_X_running_um"] == 0.0
    assert [s["after_min"] for s in found["states"]] == [0.0, 100.0]
    assert found["states"][1]["temperatures_c"]["x-middle"] == pytest.approx(22.0 + 100 / 60)
    assert found["stored"] is False
    assert found["verification"] is None
    assert contents(app) == before


async def test_stated_running_goes_before_the_state(client):
    stated = {"running_from": iso(BEGUN), "running_to": iso(BEGUN + timedelta(minutes=50))}
    figures = (await posted(client, warm_up(**stated)))["figures"]
    assert figures["Z_at_stop_um"] == pytest.approx(5.0)
    assert "d_Z_60min_um" not in figures


async def test_states_become_maps_whose_tables_lie_between_them(client):
    body = of_a_spindle(states_min=[0, 60, 120])
    assignment = {"EXY": "x-middle", "EYY": "x-middle", "EZY": "z-column"}
    await client.put(f"{ROOM}/sensor-assignment", json=assignment)
    found = await posted(client, body, "store=true")
    assert found["stored"] is True
    labels = [state["label"] for state in found["states"]]
    assert labels == ["Warm-up, 0 min", "Warm-up, 60 min", "Warm-up, 120 min"]
    stored = [
        (await client.get(f"{ROOM}/error-maps/{state['map_id']}")).json()
        for state in found["states"]
    ]
    assert [m["label"] for m in stored] == labels
    assert stored[1]["measured_at"] == iso(BEGUN + timedelta(hours=1))
    table = (
        await client.post(f"{ROOM}/compensation", json={"temperatures_c": temperatures(22.5)})
    ).json()
    grown = {c["component"]: c for c in table["components"]}
    assert grown["EZY"]["errors_um"] == pytest.approx([3.0])  # a quarter of 2 K, of 12 µm
    assert grown["EYY"]["errors_um"] == pytest.approx([-0.3])
    again = await posted(client, body, "store=true")
    assert [s["map_id"] for s in again["states"]] == [s["map_id"] for s in found["states"]]


async def test_maps_of_another_zero_are_refused_whole(app, client):
    """Run #1, #3 and #6 hold whole errors of EZZ; the test knows changes since it began."""
    before = contents(app)
    path = f"{ROOM}/measurements/thermal-drift"
    for query in ("store=true", "store=true&store_verification=true", "preview=true"):
        found = problem(await client.post(f"{path}?{query}", json=warm_up()), 409)
        assert "with another zero" in found["detail"]
        assert "verification" in found["detail"]
    assert contents(app) == before
    # Who only looks is told too.
    notes = (await posted(client, warm_up()))["notes"]
    assert any("would be refused" in note and "with another zero" in note for note in notes)
    assert not any("would be refused" in n for n in (await posted(client, of_a_spindle()))["notes"])


@pytest.mark.parametrize(
    "queries",
    [
        ("store=true&store_verification=true",),
        ("store=true", "store_verification=true"),
        ("store_verification=true", "store=true"),
    ],
)
async def test_maps_and_verification_of_one_test_are_said_to_be_the_same_readings(client, queries):
    body = of_a_spindle(states_min=[0, 120])
    *before, last = [(await posted(client, body, query))["notes"] for query in queries]
    assert sum("comparing them shows nothing" in note for note in last) == 1
    assert not any("comparing" in note for notes in before for note in notes)
    other = of_a_spindle(label="Another day")
    verified = (await posted(client, other, "store_verification=true"))["notes"]
    assert not any("comparing" in note for note in verified)


async def test_the_course_is_a_verification_with_its_temperatures(client):
    found = await posted(client, warm_up(), "store_verification=true")
    assert found["stored"] is False
    kept = found["verification"]
    assert kept["components"] == ["points"]
    assert (kept["observations"], kept["stored_readings"]) == (13, 13)
    whole = (await client.get(f"{ROOM}/verifications/{kept['id']}")).json()
    assert whole["datum"] == "first"
    assert {o["setup"] for o in whole["observations"]} == {"Warm-up"}
    first, *_, last = whole["observations"]
    assert first["measured_um"] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(last["measured_um"], [0.0, -1.2, 12.0])
    assert last["point_mm"] == [250, 200, 300]
    assert last["tool_offset_mm"] == [0, 0, 160]
    readings = (await client.get(f"{ROOM}/readings")).json()
    assert len(readings) == 13
    assert readings[3]["state"] == {"spindle_rpm": 8000}
    # What the model says of the same place and times can be held against it.
    residuals = await client.get(f"{ROOM}/verifications/{kept['id']}/residuals")
    assert residuals.status_code == 200, residuals.text
    again = await posted(client, warm_up(), "store_verification=true")
    assert kept["is_new"] is True
    assert again["verification"] == kept | {"stored_readings": 0, "is_new": False}
    assert len((await client.get(f"{ROOM}/verifications")).json()) == 1


async def test_each_target_of_a_moving_axis_is_a_set_up(client):
    body = warm_up(test="linear-axis", axis="x")
    for i, reading in enumerate(body["readings"]):
        reading["position_mm"] = 450.0 if i % 2 else 50.0
    kept = (await posted(client, body, "store_verification=true"))["verification"]
    assert kept["components"] == ["EXX", "EYX", "EZX"]
    whole = (await client.get(f"{ROOM}/verifications/{kept['id']}")).json()
    setups = {(o["setup"], o["position_mm"]) for o in whole["observations"]}
    assert setups == {("Warm-up, 50 mm", 50.0), ("Warm-up, 450 mm", 450.0)}


WRONG = [
    ({"label": None}, "store_verification=true", "label"),
    ({"label": None}, "store=true", "label"),
    ({"point_mm": None}, "store_verification=true", "point_mm"),
    ({"point_mm": [250, 200, 900]}, "store_verification=true", "observations.0.point_mm"),
    ({"components": {"c": "ECZ"}}, "", "components.c"),
    ({"components": {"x": "EYX"}}, "", "components.x"),
    ({"running_from": iso(START)}, "", "running_from"),
    ({"states_min": [0, 500]}, "", "states_min"),
    ({"readings": []}, "", "readings"),
]


@pytest.mark.parametrize(("changes", "query", "field"), WRONG)
async def test_what_cannot_be_kept_is_refused_whole(app, client, changes, query, field):
    before = contents(app)
    path = f"{ROOM}/measurements/thermal-drift?{query}"
    body = of_a_spindle() | changes if "components" not in changes else warm_up(**changes)
    if query == "store_verification=true":
        body.pop("components", None)
    found = problem(await client.post(path, json=body), 422)
    assert any(e["field"].startswith(field) for e in found["errors"]), found
    assert contents(app) == before


async def test_a_reading_that_lacks_a_displacement_is_named(client):
    body = warm_up()
    del body["readings"][4]["z_um"]
    found = problem(await client.post(f"{ROOM}/measurements/thermal-drift", json=body), 422)
    assert found["errors"][0]["field"] == "readings.4.z_um"


async def test_without_temperatures_there_is_nothing_to_compare(app, client):
    before = contents(app)
    body = warm_up()
    for reading in body["readings"]:
        del reading["temperatures_c"]
    path = f"{ROOM}/measurements/thermal-drift"
    for query in ("store_verification=true", "store=true"):
        found = problem(await client.post(f"{path}?{query}", json=body | {"components": {
            "x": "EXY", "y": "EYY", "z": "EZY"}}), 422)  # fmt: skip
        assert "temperatures_c" in found["detail"]
    assert contents(app) == before


async def test_what_the_whole_states_of_temperature_is_said_to_be_unused(client):
    found = await posted(client, warm_up(temperatures_c={"x-middle": 20.0}))
    assert any("not used" in note for note in found["notes"])

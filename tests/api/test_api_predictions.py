"""Predictions with the stored readings' history, over HTTP.

The readings rise from 24 °C (Run #3) to 30 °C (Run #6) within 100 s, so that at a
quarter of that time x-middle has 25.5 °C; see `error_map` for the errors.
"""

from datetime import timedelta

import pytest

from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    contents,
    error_map,
    iso,
    problem,
    reading,
    table,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/predictions"
FIRST = START - timedelta(seconds=100)
QUARTER = START - timedelta(seconds=75)


def at(seconds_after_first, component, position_mm=None, **more):
    when = iso(FIRST + timedelta(seconds=seconds_after_first))
    position = {} if position_mm is None else {"position_mm": position_mm}
    return {"time": when, "component": component, **position, **more}


@pytest.fixture
async def warmed(client):
    """The example machine with two readings, 24 °C and 30 °C, 100 s apart."""
    both = [reading(FIRST, 24.0), reading(START, 30.0)]
    assert (await client.post(f"{ROOM}/readings", json=both)).status_code == 201
    return client


async def predict(client, *observations, **more):
    """Ask; the example's maps lack most components that a point needs."""
    body = {"observations": list(observations), "missing_components": "zero", **more}
    answer = await client.post(PATH, json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_readings_are_interpolated_in_time_and_maps_in_temperature(warmed, app):
    before = contents(app)
    document = await predict(
        warmed,
        at(0, "EXX", 100.0),
        at(25, "EXX", 50.0),
        at(25, "D_x(x)", 300),
        at(25, "EBX", 500.0),
        at(50, "EZZ", 25.0),
        at(25, "SXY"),
        at(100, "EXX", 500.0),
    )
    assert document == {
        "model_version": 3,
        "predicted_um": [4.0, 2.75, 16.5, 55.0, 3.5, -25.5, 50.0],
        "status": ["at-map", *["interpolated"] * 5, "at-map"],
        "counted_as_zero": [],
        "warnings": [],
    }
    assert contents(app) == before


async def test_isos_name_of_a_squareness_has_isos_sign(warmed):
    document = await predict(warmed, at(25, "SXY"), at(25, "S_xy"), at(25, "C0Y"))
    assert document["predicted_um"] == [-25.5, -25.5, 25.5]


async def test_a_point_gains_from_rotation_squareness_and_tool(warmed):
    document = await predict(
        warmed,
        {"time": iso(QUARTER), "point_mm": [100, 200, 50], "tool_offset_mm": [0, 0, 160]},
        {"time": iso(QUARTER), "point_mm": [100, 200, 50]},
    )
    # EXX 5.5 µm, EBX 11 µrad on an arm of 210 mm, SXY −25.5 µm/m over 200 mm; EZZ 5.5 µm.
    assert document["predicted_um"][0] == pytest.approx([5.5 + 2.31 - 5.1, 0.0, 5.5 - 1.1])
    assert document["predicted_um"][1] == pytest.approx([5.5 + 0.55 - 5.1, 0.0, 5.5 - 1.1])
    (warning,) = document["warnings"]
    assert "counted as zero" in warning
    assert "EYY" in warning
    assert "EXX" not in warning


async def test_at_a_point_components_that_are_missing_are_refused_as_elsewhere(warmed):
    """As `volumetric-error` does; a component that is asked for by itself needs no other."""
    point = {"time": iso(QUARTER), "point_mm": [100, 200, 50]}
    found = problem(await warmed.post(PATH, json={"observations": [point]}), 422)
    assert found["errors"][0]["field"] == "missing_components"
    assert "no map has EYX, EZX" in found["detail"]
    assert "state 'zero' where these may count as zero" in found["detail"]
    document = await predict(warmed, point)
    assert {"EYX", "EYY", "SYZ"} <= set(document["counted_as_zero"])
    assert not {"EXX", "EZZ", "EBX", "SXY"} & set(document["counted_as_zero"])
    alone = await predict(warmed, at(25, "EXX", 100.0), missing_components="refuse")
    assert (alone["predicted_um"], alone["counted_as_zero"]) == ([5.5], [])


async def test_components_and_points_keep_their_places_in_one_request(warmed):
    document = await predict(
        warmed,
        at(25, "SXY"),
        {"time": iso(QUARTER), "point_mm": [0, 0, 0]},
        at(25, "EXX", 100.0),
        at(50, "SXY"),
    )
    assert document["predicted_um"] == [-25.5, pytest.approx([0, 0, 0]), 5.5, -27.0]


async def test_without_a_reading_near_enough_there_is_null_and_the_reason(warmed):
    document = await predict(
        warmed,
        at(-1, "EXX", 100.0),
        at(220, "EXX", 100.0),
        at(221, "EXX", 100.0),
        {"time": iso(FIRST - timedelta(days=1)), "point_mm": [0, 0, 0]},
    )
    assert document["predicted_um"] == [None, 10.0, None, None]
    assert document["status"] == ["no-reading", "at-map", "no-reading", "no-reading"]


async def test_a_gap_longer_than_a_sensor_allows_is_not_bridged(client):
    for seconds, bridged in ((250, False), (120, True)):
        two = [reading(START - timedelta(seconds=seconds), 24.0), reading(START, 30.0)]
        await client.delete(ROOM)
        await _again(client)
        await client.post(f"{ROOM}/readings", json=two)
        middle = iso(START - timedelta(seconds=seconds / 2))
        document = await predict(client, {"time": middle, "component": "EXX", "position_mm": 100})
        assert document["predicted_um"] == [7.0 if bridged else None]
        assert document["status"] == ["interpolated" if bridged else "no-reading"]


async def _again(client):
    await client.post("/v1/machines", json=MACHINE)
    for label, t_c in (("A", 20.0), ("B", 30.0)):
        await client.post(f"{ROOM}/error-maps", json=error_map(label, t_c))


async def test_any_version_can_be_asked(warmed):
    asked = at(50, "EXX", 100.0)  # x-middle has 27 °C
    assert (await predict(warmed, asked))["predicted_um"] == [7.0]
    document = await predict(warmed, asked, model_version=2)
    assert document["model_version"] == 2
    assert (document["predicted_um"], document["status"]) == ([4.0], ["clamped"])
    await warmed.post(f"{ROOM}/models/2/activate")
    assert (await predict(warmed, asked))["model_version"] == 2
    assert (await predict(warmed, asked, model_version=3))["predicted_um"] == [7.0]


async def test_at_a_point_each_axis_has_its_direction(client):
    for t in (32.0, 36.0):
        tables = [
            table("EXX", [0, 100], [0.0, 1.0], backward_errors_um=[5.0, 6.0]),
            table("EYY", [0, 100], [0.0, 2.0], backward_errors_um=[10.0, 12.0]),
        ]
        await client.post(f"{ROOM}/error-maps", json=error_map(f"At {t}", t, components=tables))
    for stored_map in (await client.get(f"{ROOM}/error-maps")).json()[:3]:
        await client.delete(f"{ROOM}/error-maps/{stored_map['id']}")
    await client.post(f"{ROOM}/readings", json=reading(START, 34.0))
    point = {"time": iso(START), "point_mm": [100, 100, 0]}
    asked = [point | {"direction": d} for d in ("+", "-", {"x": "+", "y": "-"}, {"x": "-"})]
    document = await predict(client, *asked)
    expected = [[1, 2, 0], [6, 12, 0], [1, 12, 0], [6, 7, 0]]
    assert document["predicted_um"] == expected


@pytest.mark.parametrize(
    ("observation", "field"),
    [
        ({"component": "EXX"}, "observations.1.position_mm"),
        ({"component": "EQQ", "position_mm": 1}, "observations.1.component"),
        ({}, "observations.1.component"),
        ({"component": "SXY", "point_mm": [0, 0, 0]}, "observations.1.component"),
        ({"component": "EXX", "position_mm": 501}, "observations.1"),
        ({"point_mm": [0, 0, -1]}, "observations.1"),
        ({"point_mm": [0, 0]}, "observations.1.point_mm"),
        ({"point_mm": [0, 0, None]}, "observations.1.point_mm.2"),
        ({"component": "EXX", "position_mm": 1, "direction": "up"}, "observations.1.direction"),
        ({"component": "EXX", "position_mm": "1"}, "observations.1.position_mm"),
        ({"component": "EXX", "position_mm": 1, "position_um": 1}, "observations.1.position_um"),
        ({"component": "EXX", "position_mm": 1, "time": "2026-03-01"}, "observations.1.time"),
    ],
)
async def test_a_wrong_observation_is_named(warmed, observation, field):
    body = {"observations": [at(25, "SXY"), {"time": iso(QUARTER)} | observation]}
    found = problem(await warmed.post(PATH, json=body), 422)
    assert field in [e["field"] for e in found["errors"]]


async def test_a_component_that_the_model_lacks_is_told_with_those_it_has(warmed):
    answer = await warmed.post(PATH, json={"observations": [at(25, "EYY", 1.0)]})
    found = problem(answer, 422)
    assert "EXX, EBX, EZZ, SXY" in found["detail"]
    assert "EYY" in found["detail"]


@pytest.mark.parametrize("version", [0, 4, 2**64])
async def test_an_unknown_version_is_told_with_those_that_exist(warmed, version):
    body = {"observations": [at(25, "SXY")], "model_version": version}
    assert "1, 2, 3" in problem(await warmed.post(PATH, json=body), 404)["detail"]


async def test_without_a_model_there_is_a_conflict(empty):
    await empty.post("/v1/machines", json=MACHINE)
    problem(await empty.post(PATH, json={"observations": [at(0, "SXY")]}), 409)


async def test_with_one_map_there_is_nothing_to_interpolate(empty):
    await empty.post("/v1/machines", json=MACHINE)
    await empty.post(f"{ROOM}/error-maps", json=error_map("Run #1", 20.0))
    await empty.post(f"{ROOM}/readings", json=reading(START, 20.0))
    for observation in (at(100, "SXY"), {"time": iso(START), "point_mm": [0, 0, 0]}):
        answer = await empty.post(PATH, json={"observations": [observation]})
        assert "at least two" in problem(answer, 422)["detail"]


async def test_observations_from_end_to_end_of_the_calendar_are_answered(warmed):
    """Readings are looked for around each time: not before the first nor after the last year."""
    for time in ("1900-01-01T00:00:00Z", "2999-12-31T23:59:59Z"):
        document = await predict(warmed, {"time": time, "component": "SXY"})
        assert document["status"] == ["no-reading"]

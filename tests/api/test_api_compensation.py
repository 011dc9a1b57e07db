"""The compensation table at stated temperatures, over HTTP.

The numbers follow from `error_map` in service_examples: 25.5 °C lies a quarter of the
way from Run #3 (24 °C) to Run #6 (30 °C), and at 5.5 °C above 20 °C the errors are
5.5 times those at 21 °C, because all maps lie on one straight line.
"""

import pytest

from app.api.table_json import CompensationAnswer
from app.geometry.components import COMPONENTS
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    by_code,
    contents,
    error_map,
    furnish,
    iso,
    problem,
    table,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/compensation"


async def ask(client, path=PATH, **temperatures_c):
    body = {"temperatures_c": {k.replace("_", "-"): v for k, v in temperatures_c.items()}}
    answer = await client.post(path, json=body)
    assert answer.status_code == 200, answer.text
    document = answer.json()
    CompensationAnswer.model_validate_json(answer.content)
    return document


async def refused(client, **temperatures_c):
    body = {"temperatures_c": {k.replace("_", "-"): v for k, v in temperatures_c.items()}}
    return problem(await client.post(PATH, json=body), 422)


async def test_the_table_between_two_maps(client):
    document = await ask(client, x_middle=25.5, y_front=25.0, z_column=29.0)
    assert {k: v for k, v in document.items() if k != "components"} == {
        "machine": "mcfv5050",
        "model_version": 3,
        "computed_at": iso(START),
        "complete": True,
        "warnings": [],
        "effects": [],
    }
    on_x = {
        "sensor": "x-middle",
        "temperature_c": 25.5,
        "lower_map": "Run #3",
        "upper_map": "Run #6",
        "weight": 0.25,
        "status": "interpolated",
        "effects": [],
    }
    on_z = on_x | {"sensor": "z-column", "temperature_c": 29.0, "weight": 0.5}
    assert document["components"] == [
        {
            "component": "EXX",
            "chapter": "D_x(x)",
            "axis": "x",
            "positions_mm": [0.0, 100.0, 500.0],
            "errors_um": [0.0, 5.5, 27.5],
            "compensation_um": [0.0, -5.5, -27.5],
            **on_x,
        },
        {
            "component": "EBX",
            "chapter": "A_y(x)",
            "axis": "x",
            "positions_mm": [0.0, 500.0],
            "errors_urad": [0.0, 55.0],
            "compensation_urad": [0.0, -55.0],
            **on_x,
        },
        {
            "component": "EZZ",
            "chapter": "D_z(z)",
            "axis": "z",
            "positions_mm": [0.0, 50.0, 500.0],
            "errors_um": [0.0, 7.0, 70.0],
            "compensation_um": [0.0, -7.0, -70.0],
            **on_z,
        },
        {
            "component": "SXY",
            "chapter": "S_xy",
            "axis": None,
            "error_um_per_m": -25.5,
            "compensation_um_per_m": 25.5,
            "iso": "C0Y",
            "iso_error_urad": 25.5,
            **on_x,
        },
    ]


async def test_asking_stores_nothing(client, app):
    before = contents(app)
    await ask(client, x_middle=25.5, z_column=29.0)
    assert contents(app) == before


@pytest.mark.parametrize(
    ("t_c", "nearest", "weight", "grown"), [(12.0, "Run #1", 0.0, 0.0), (70.0, "Run #6", 1.0, 10.0)]
)
async def test_outside_the_maps_the_nearest_is_held_and_said(client, t_c, nearest, weight, grown):
    document = await ask(client, x_middle=t_c, z_column=29.0)
    entries = by_code(document)
    assert entries["EXX"]["status"] == "clamped"
    assert entries["EXX"]["weight"] == weight
    assert entries["EXX"]["errors_um"] == [0.0, grown, 5 * grown]
    assert entries["EZZ"]["status"] == "interpolated"
    (warning,) = document["warnings"]
    for word in ("x-middle", f"{t_c:g} °C", "EXX, EBX, SXY", nearest):
        assert word in warning
    assert "EZZ" not in warning


@pytest.mark.parametrize("x_middle", [None, 85.0, -100.0], ids=["missing", "too hot", "too cold"])
async def test_a_failed_sensor_is_replaced_by_its_stand_ins_own_scale(client, x_middle):
    stated = {"y_front": 24.5, "z_column": 29.0} | ({"x_middle": x_middle} if x_middle else {})
    document = await ask(client, **stated)
    exx = by_code(document)["EXX"]
    # y-front had 23 °C in Run #3 and 29 °C in Run #6.
    assert (exx["lower_map"], exx["upper_map"], exx["weight"]) == ("Run #3", "Run #6", 0.25)
    assert exx["errors_um"] == [0.0, 5.5, 27.5]
    assert (exx["sensor"], exx["stand_in_for"]) == ("y-front", "x-middle")
    assert exx["temperature_c"] == 24.5
    assert exx["status"] == "stand-in"
    assert by_code(document)["EZZ"]["status"] == "interpolated"
    assert "stand_in_for" not in by_code(document)["EZZ"]
    assert any("y-front" in w and "x-middle" in w for w in document["warnings"])
    if x_middle is not None:
        assert any(f"{x_middle:g}" in w for w in document["warnings"])


async def test_without_sensor_and_stand_in_the_components_are_named(client):
    found = await refused(client, z_column=29.0, spindle=22.0)
    assert found["errors"][0]["field"] == "temperatures_c.x-middle"
    for word in ("x-middle", "EXX, EBX, SXY", "°C", "y-front"):
        assert word in found["errors"][0]["message"]
    found = await refused(client, x_middle=25.0)
    assert [e["field"] for e in found["errors"]] == ["temperatures_c.z-column"]
    found = await refused(client)
    assert [e["field"] for e in found["errors"]] == [
        "temperatures_c.x-middle",
        "temperatures_c.z-column",
    ]


async def test_a_bidirectional_component_has_both_tables(client):
    both = [
        error_map(
            f"Both at {t}",
            t,
            components=[
                table("EYY", [0, 100], [0.0, t], backward_errors_um=[-t, 3 * t]),
                table("ECY", [0, 100], [0.0, t], "urad", backward_errors_urad=[1.0, 2 * t]),
            ],
        )
        for t in (32.0, 36.0)
    ]
    for content in both:
        assert (await client.post(f"{ROOM}/error-maps", json=content)).status_code == 201
    entries = by_code(await ask(client, x_middle=33.0, z_column=29.0))
    eyy = entries["EYY"]
    assert eyy["errors_um"] == [0.0, 33.0]
    assert eyy["compensation_um"] == [0.0, -33.0]
    assert eyy["backward_errors_um"] == [-33.0, 99.0]
    assert eyy["backward_compensation_um"] == [33.0, -99.0]
    assert entries["ECY"]["backward_errors_urad"] == [1.0, 66.0]
    assert entries["ECY"]["backward_compensation_urad"] == [-1.0, -66.0]
    assert "backward_errors_um" not in entries["EXX"]


async def test_components_come_in_the_order_of_the_component_table(empty):
    codes = list(COMPONENTS)
    stated = [_any_component(code) for code in reversed(codes)]
    machine = MACHINE | {"sensors": [{"name": "only"}]}
    await empty.post("/v1/machines", json=machine)
    for label, t_c in (("A", 20.0), ("B", 24.0)):
        content = error_map(label, t_c, components=stated, temperatures_c={"only": t_c})
        answer = await empty.post(f"{ROOM}/error-maps", json=content)
        assert answer.status_code == 201, answer.text
        assert [c["component"] for c in answer.json()["components"]] == codes[::-1]
    document = await ask(empty, only=21.0)
    assert [c["component"] for c in document["components"]] == codes
    assert document["complete"] is True
    for entry in document["components"]:
        component = COMPONENTS[entry["component"]]
        assert entry["chapter"] == component.chapter
        assert entry["axis"] == component.axis
        expected = [1.5, -2.0] if component.is_table else 1.5
        minus = [-1.5, 2.0] if component.is_table else -1.5
        assert entry[component.error_field] == expected
        assert entry[component.compensation_field] == minus


def _any_component(code):
    component = COMPONENTS[code]
    if not component.is_table:
        return {"component": code, component.input_field: 1.5}
    return {"component": code, "positions_mm": [0, 10], component.input_field: [1.5, -2.0]}


async def test_minus_zero_is_not_answered_as_compensation(client):
    answer = await client.post(PATH, json={"temperatures_c": {"x-middle": 25.5, "z-column": 29}})
    assert b"-0.0" not in answer.content


async def test_one_map_is_stored_and_a_table_of_it_is_refused(empty):
    await furnish(empty, maps={"Run #1": 20.0})
    found = await refused(empty, x_middle=20.0, z_column=22.0)
    assert "at least two" in found["detail"]
    assert "Run #1" in found["detail"]


@pytest.mark.parametrize(
    "header",
    ["application/json", "application/json; charset=utf-8", "Application/JSON"],
)
async def test_however_it_is_sent_the_table_is_the_same(client, header):
    body = b'{"temperatures_c": {"x-middle": 25.5, "z-column": 29.0}, "state": {"spindle_rpm": 1}}'
    plain = await client.post(PATH, content=body, headers={"content-type": "application/json"})

    async def pieces():
        yield body[:20]
        yield body[20:]

    for content in (body, pieces()):
        answer = await client.post(PATH, content=content, headers={"content-type": header})
        assert answer.status_code == 200
        assert answer.content == plain.content
        assert answer.headers["content-type"] == "application/json"

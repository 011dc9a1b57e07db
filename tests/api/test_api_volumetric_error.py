"""The volumetric error at points, over HTTP.

At 25.5 °C of x-middle (z-column 27.5 °C) the example machine, XYFZ, has EXX = 5.5·x/100 µm,
EBX twice that in µrad, EZZ = 5.5·z/50 µm and SXY = −25.5 µm/m: see service_examples. By
8.77–8.79 with 8.71–8.73, lengths in m,

    E_x = EXX + (z + Z_t)·EBX + y·SXY,  E_z = EZZ − (x + X_t)·EBX.
"""

import io
import json

import numpy as np
import pyarrow
import pytest

from app.geometry.components import COMPONENTS
from app.json_text import SHORT_TEXT
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
    temperatures,
)

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.parametrize("furnished_url", ["sqlite"], indirect=True),
]

PATH = f"{ROOM}/volumetric-error"
NPY = "application/x-npy"
ARROW = "application/vnd.apache.arrow.stream"
ASKED = {"temperatures_c": temperatures(25.5), "missing_components": "zero"}
POINTS = [[0, 0, 0], [300, 200, 100], [500, 500, 500]]
TOOL = [10, -20, 160]


def expected_um(points, t_c, tool=(0, 0, 0)):
    x, y, z = np.array(points, dtype=float).T
    xt, _, zt = tool
    grown = t_c - 20.0
    ebx = 2 * grown * x / 100
    along_x = grown * x / 100 + ebx * (z + zt) / 1000 - t_c * y / 1000
    return np.stack([along_x, 0 * x, grown * z / 50 - ebx * (x + xt) / 1000], axis=-1)


async def ask(client, accept="application/json", **changes):
    answer = await client.post(
        PATH, json=ASKED | {"points_mm": POINTS} | changes, headers={"Accept": accept}
    )
    assert answer.status_code == 200, answer.text
    return answer


async def document_of(client, **changes):
    answer = await ask(client, **changes)
    return answer.json()


@pytest.mark.parametrize("tool", [[0, 0, 0], TOOL])
async def test_it_is_the_sum_of_the_components_with_their_lever_arms(client, tool):
    document = await document_of(client, tool_offset_mm=tool)
    np.testing.assert_allclose(document["errors_um"], expected_um(POINTS, 25.5, tool), atol=1e-12)
    ebx = [2 * 5.5 * x / 100 for x, _, _ in POINTS]
    np.testing.assert_allclose(document["orientation_urad"], [[b, 0, 0] for b in ebx], atol=1e-12)
    assert document["machine"] == "mcfv5050"
    assert document["model_version"] == 3
    assert document["computed_at"] == iso(START)
    assert document["outside_travel"] == []


async def test_components_without_maps_are_named_and_zero_only_when_the_user_says_so(client):
    body = {"temperatures_c": temperatures(25.5), "points_mm": POINTS, "tool_offset_mm": TOOL}
    found = problem(await client.post(PATH, json=body), 422)
    assert [e["field"] for e in found["errors"]] == ["missing_components"]
    for code in ("EYY", "EYX", "EXY", "EAX", "ECZ", "SYZ"):
        assert code in found["detail"]
    document = await document_of(client, tool_offset_mm=TOOL)
    have = {"EXX", "EBX", "EZZ", "SXY"}
    rigid = {
        c.code for c in COMPONENTS.values() if (c.axis and not c.times) or c.code.startswith("S")
    }
    assert set(document["counted_as_zero"]) == rigid - have
    assert document["complete"] is False


async def test_a_complete_machine_has_nothing_to_be_named(client):
    """21 components, each in two maps; the sum of unit errors by hand."""
    rigid = [c for c in COMPONENTS.values() if c.axis and c.times is None]
    tables = [
        table(c.code, [0, 500], [1.0, 1.0], unit="urad" if c.is_rotation else "um") for c in rigid
    ]
    tables += [{"component": s, "value_um_per_m": 0.0} for s in ("SXY", "SYZ", "SZX")]
    for t in (40.0, 44.0):
        answer = await client.post(
            f"{ROOM}/error-maps", json=error_map(f"Rigid {t}", t, components=tables)
        )
        assert answer.status_code == 201, answer.text
    body = {"temperatures_c": temperatures(42.0), "points_mm": [[0, 0, 0]]}
    answer = await client.post(PATH, json=body | {"tool_offset_mm": TOOL})
    document = answer.json()
    assert document["counted_as_zero"] == []
    assert document["complete"] is True
    # Three translations of 1 µm each; Σω = (3, 3, 3) µrad with T; EXX and EZZ are as extrapolated.
    x, y, z = (np.array(TOOL) / 1000).tolist()
    assert document["orientation_urad"][0] == [3.0, -3.0, 0.0]
    turned = [3 * (z - y), 3 * (x - z), 3 * (y - x)]
    np.testing.assert_allclose(document["errors_um"][0], np.array(turned) + 3.0, atol=1e-9)


async def test_several_thermal_states_at_once_are_each_alone(client):
    states = [temperatures(t) for t in (20.0, 25.5, 30.0)]
    together = await document_of(client, temperatures_c=states)
    assert np.shape(together["errors_um"]) == (3, len(POINTS), 3)
    for i, state in enumerate(states):
        alone = await document_of(client, temperatures_c=state)
        np.testing.assert_allclose(together["errors_um"][i], alone["errors_um"], atol=1e-13)
    one = await document_of(client, temperatures_c=states[:1])
    assert np.shape(one["errors_um"]) == (1, len(POINTS), 3)


async def test_without_temperatures_it_is_the_latest_reading(client):
    body = {"points_mm": POINTS, "missing_components": "zero"}
    problem(await client.post(PATH, json=body), 409)
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    document = (await client.post(PATH, json=body)).json()
    np.testing.assert_allclose(document["errors_um"], expected_um(POINTS, 25.5), atol=1e-12)


async def test_numpys_form_has_the_same_numbers_and_says_the_rest_in_a_header(client):
    document = await document_of(client)
    answer = await ask(client, accept=NPY)
    assert answer.headers["content-type"] == NPY
    numbers = np.load(io.BytesIO(answer.content), allow_pickle=False)
    assert numbers.dtype == np.float64
    np.testing.assert_array_equal(numbers[:, :3].round(4), document["errors_um"])
    np.testing.assert_array_equal(numbers[:, 3:].round(4), document["orientation_urad"])
    head = json.loads(answer.headers["Thermap-Answer"])
    beside = {"errors_um", "orientation_urad", "outside_travel"}
    assert head == {k: v for k, v in document.items() if k not in beside}


async def test_an_arrow_stream_is_read_by_arrow_itself(client):
    states = [temperatures(t) for t in (20.0, 25.5)]
    document = await document_of(client, temperatures_c=states)
    answer = await ask(client, accept=ARROW, temperatures_c=states)
    read = pyarrow.ipc.open_stream(answer.content).read_all()
    assert read.column("thermal_state").to_pylist() == [0, 0, 0, 1, 1, 1]
    errors = np.stack([read.column(f"error_{u}_um").to_numpy() for u in "xyz"], axis=-1)
    turned = np.stack([read.column(f"orientation_{u}_urad").to_numpy() for u in "xyz"], axis=-1)
    np.testing.assert_array_equal(errors.round(4), np.reshape(document["errors_um"], (-1, 3)))
    np.testing.assert_array_equal(
        turned.round(4), np.reshape(document["orientation_urad"], (-1, 3))
    )
    assert json.loads(read.schema.metadata[b"thermap"])["model_version"] == 3
    alone = pyarrow.ipc.open_stream((await ask(client, accept=ARROW)).content).read_all()
    assert "thermal_state" not in alone.column_names


async def test_more_than_a_million_numbers_are_refused(client):
    points = [[1.0, 2.0, 3.0]] * 1001
    body = ASKED | {"points_mm": points, "temperatures_c": [temperatures(25.5)] * 1000}
    found = problem(await client.post(PATH, json=body), 422)
    assert "at most 1000000 points" in found["detail"]


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ([1, 2], "points_mm.25000"),
        ([1, 2, True], "points_mm.25000.2"),
        ([1, 2, "3"], "points_mm.25000.2"),
        ([1, 2, None], "points_mm.25000.2"),
        ("point", "points_mm.25000"),
    ],
)
async def test_among_many_points_the_wrong_one_is_named(client, wrong, field):
    points = [[1.0, 2.0, 3.0]] * 30_000
    points[25_000] = wrong
    found = problem(await client.post(PATH, json=ASKED | {"points_mm": points}), 422)
    assert found["errors"][0]["field"] == field


async def test_of_a_long_body_everything_else_is_checked_too(client):
    points = [[1.0, 2.0, 3.0]] * 30_000
    for changes, field in (({"colour": 1}, "colour"), ({"tool_offset_mm": [1]}, "tool_offset_mm")):
        body = ASKED | {"points_mm": points} | changes
        found = problem(await client.post(PATH, json=body), 422)
        assert found["errors"][0]["field"] == field
    for content in (b"[" * 200_000, b'{"points_mm": [' + b"[1, 2, NaN]," * 20_000 + b"[1, 2, 3]]}"):
        headers = {"Content-Type": "application/json"}
        problem(await client.post(PATH, content=content, headers=headers), 422)
    text = json.dumps(ASKED | {"points_mm": [[1, 2, 3]]})
    problem(await client.post(PATH, content=text, headers={"Content-Type": "text/plain"}), 415)


@pytest.mark.parametrize("space", ["", " ", "\r\n\t"])
async def test_a_long_body_is_read_however_it_is_spaced(client, space):
    points = np.random.default_rng(2).uniform(0, 500, (30_000, 3)).round(3)
    rows = f"{space},{space}".join(
        f"[{space}{x}{space},{y},{z}{space}]" for x, y, z in points.tolist()
    )
    rest = json.dumps(ASKED | {"tool_offset_mm": TOOL})[1:]
    text = f'{{{space}"points_mm"{space}:{space}[{space}{rows}{space}]{space},{rest}'
    headers = {"Content-Type": "application/json", "Accept": NPY}
    answer = await client.post(PATH, content=text.encode(), headers=headers)
    numbers = np.load(io.BytesIO(answer.content))
    np.testing.assert_allclose(numbers[:, :3], expected_um(points, 25.5, TOOL), atol=1e-10)


async def test_a_long_body_without_one_of_its_commas_is_refused_wherever_it_lacks(client):
    rows = b",".join([b"[1, 2, 3]"] * 60_000)
    text = json.dumps(ASKED)[:-1].encode() + b', "points_mm": [%s]}'
    headers = {"Content-Type": "application/json"}
    assert (await client.post(PATH, content=text % rows, headers=headers)).status_code == 200
    where_it_is_cut = rows.find(b"]", SHORT_TEXT) + 1
    for comma in (len(b"[1, 2, 3]"), where_it_is_cut):
        bad = rows[:comma] + b" " + rows[comma + 1 :]
        problem(await client.post(PATH, content=text % bad, headers=headers), 422)


async def test_points_outside_the_travel_are_refused_or_flagged(client):
    points = [[0, 0, 0], [0, 0, 501], [-1, 0, 0]]
    body = ASKED | {"points_mm": points}
    found = problem(await client.post(PATH, json=body), 422)
    assert [e["field"] for e in found["errors"]] == ["points_mm.1"]
    assert "z 0 to 500 mm" in found["detail"]
    assert "1 more" in found["detail"]
    document = await document_of(client, points_mm=points, outside_travel="allow")
    assert document["outside_travel"] == [1, 2]
    assert any("2 points outside the axes' travel" in w for w in document["warnings"])
    assert any("beyond the tables of z" in w for w in document["warnings"])
    # End values hold in the tables; arms and squareness go on.
    assert document["errors_um"][1][2] == pytest.approx(5.5 * 500 / 50)


async def test_an_end_of_the_travel_written_in_rounded_inches_is_within_it(client):
    """A map may have it, so points, volumes and grids may too."""
    end = 19.685042 * 25.4  # 500.0000668 mm
    document = await document_of(client, points_mm=[[0, 0, end], [0, 0, -end + 500.0]])
    assert "outside_travel" not in document or document["outside_travel"] == []
    asked = {
        "missing_components": "zero",
        "tolerance_um": 100.0,
        "volume": {"z": {"min_mm": 0, "max_mm": end}},
    }
    answer = await client.post(
        f"{ROOM}/compensation/grid", json={"temperatures_c": temperatures(24.0)} | asked
    )
    assert answer.status_code == 200, answer.text


async def test_each_axis_has_its_direction_of_approach(client):
    for t in (40.0, 44.0):
        both = [
            table("EXX", [0, 100], [1.0, 1.0], backward_errors_um=[5.0, 5.0]),
            table("EYY", [0, 100], [2.0, 2.0], backward_errors_um=[10.0, 10.0]),
        ]
        await client.post(f"{ROOM}/error-maps", json=error_map(f"At {t}", t, components=both))
    for stored_map in (await client.get(f"{ROOM}/error-maps")).json()[:3]:
        await client.delete(f"{ROOM}/error-maps/{stored_map['id']}")
    asked = {"temperatures_c": temperatures(42.0), "points_mm": [[0, 0, 0]]}
    cases = {"+": [1, 2], "-": [5, 10], None: [3, 6]}
    for direction, expected in cases.items():
        document = await document_of(client, **asked, direction=direction)
        assert document["errors_um"][0][:2] == expected
    document = await document_of(client, **asked, direction={"x": "-", "y": "+"})
    assert document["errors_um"][0][:2] == [5, 2]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"points_mm": []}, "points_mm"),
        ({"points_mm": [[1, 2]]}, "points_mm.0"),
        ({"points_mm": [[1, 2, 3], [1, 2, "3"]]}, "points_mm.1.2"),
        ({"points_mm": [[1, 2, 1e9]]}, "points_mm.0.2"),
        ({"tool_offset_mm": [1, 2]}, "tool_offset_mm"),
        ({"direction": {"q": "+"}}, "direction.q"),
        ({"direction": "up"}, "direction"),
        ({"temperatures_c": {"nose": 20.0}}, "temperatures_c.nose"),
        ({"temperatures_c": [temperatures(25.0), {"z-column": 313.15}]}, "temperatures_c.1.z-col"),
        ({"points": []}, "points"),
    ],
)
async def test_what_is_wrong_is_named(app, client, changes, field):
    before = contents(app)
    body = ASKED | {"points_mm": POINTS} | changes
    found = problem(await client.post(PATH, json=body), 422)
    assert any(e["field"].startswith(field) for e in found["errors"])
    assert contents(app) == before


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
async def test_what_is_not_finite_is_refused(client, number):
    body = json.dumps(ASKED | {"points_mm": [[1, 2, 12345]]}).replace("12345", number)
    headers = {"Content-Type": "application/json"}
    found = problem(await client.post(PATH, content=body, headers=headers), 422)
    assert found["errors"][0]["field"] == "points_mm.0.2"


async def test_an_unknown_machine_and_one_without_maps(client):
    body = ASKED | {"points_mm": POINTS}
    problem(await client.post("/v1/machines/nobody/volumetric-error", json=body), 404)
    await client.post("/v1/machines", json=MACHINE | {"id": "new"})
    found = problem(await client.post("/v1/machines/new/volumetric-error", json=body), 422)
    assert "at least two" in found["detail"]


async def test_a_lathe_with_two_axes_needs_the_errors_of_two(client):
    lathe = MACHINE | {"id": "lathe", "configuration": "FZX"}
    lathe["axes"] = {a: MACHINE["axes"][a] for a in "xz"}
    assert (await client.post("/v1/machines", json=lathe)).status_code == 201
    for t in (20.0, 30.0):
        await client.post("/v1/machines/lathe/error-maps", json=error_map(f"At {t}", t))
    path = "/v1/machines/lathe/volumetric-error"
    body = {"temperatures_c": temperatures(25.5), "points_mm": [[100, 0, 100]]}
    detail = problem(await client.post(path, json=body), 422)["detail"]
    assert "SZX" in detail
    assert not {"EYY", "SYZ", "EXY"} & set(detail.replace(",", " ").split())
    document = (await client.post(path, json=body | {"missing_components": "zero"})).json()
    assert document["errors_um"] == [[5.5, 0.0, 11.0]]
    beside = body | {"missing_components": "zero", "points_mm": [[100, 5, 100]]}
    assert "no y" in problem(await client.post(path, json=beside), 422)["detail"]
    grid = {"tolerance_um": 1.0, "missing_components": "zero"} | {
        "temperatures_c": body["temperatures_c"]
    }
    found = problem(await client.post("/v1/machines/lathe/compensation/grid", json=grid), 422)
    assert "FZX without y" in found["detail"]

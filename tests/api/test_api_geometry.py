"""Grids, accuracy, compensation levels and rotary axes, over HTTP.

The machine and its errors at 25.5 °C are those of test_api_volumetric_error.
"""

import math

import numpy as np
import pytest

from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    contents,
    error_map,
    problem,
    reading,
    temperatures,
)

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.parametrize("furnished_url", ["sqlite"], indirect=True),
]

ASKED = {"temperatures_c": temperatures(25.5), "missing_components": "zero"}
GRID = f"{ROOM}/compensation/grid"
LEVELS = f"{ROOM}/compensation/levels"
ACCURACY = f"{ROOM}/volumetric-accuracy"
ROTARY = f"{ROOM}/rotary-axis-error"
FROM_LINES = "/v1/volumetric-accuracy/from-lines"
TOOL = [10, -20, 160]
NODES = {"x_mm": [0, 100, 500], "y_mm": [0, 500], "z_mm": [50, 250, 450]}


async def ask(client, path, **changes):
    answer = await client.post(path, json=ASKED | changes)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def errors_at(client, points, **changes):
    asked = {"points_mm": np.asarray(points).tolist(), "outside_travel": "allow"} | changes
    return np.array((await ask(client, f"{ROOM}/volumetric-error", **asked))["errors_um"])


# -- the grid ------------------------------------------------------------------------------


async def test_corner_values_are_the_volumetric_error_at_the_nodes(client):
    document = await ask(client, GRID, **NODES, tool_offset_mm=TOOL)
    errors = np.array(document["errors_um"])
    assert errors.shape == (3, 2, 3, 3)
    points = np.stack(np.meshgrid(*NODES.values(), indexing="ij"), axis=-1).reshape(-1, 3)
    expected = await errors_at(client, points, tool_offset_mm=TOOL)
    np.testing.assert_allclose(errors.reshape(-1, 3), expected, atol=1e-12)
    np.testing.assert_array_equal(document["compensation_um"], 0.0 - errors)


@pytest.mark.parametrize("tolerance_um", [0.2, 1.0, 10.0])
async def test_a_tolerance_gives_the_coarsest_grid_that_keeps_it(client, tolerance_um):
    document = await ask(client, GRID, tolerance_um=tolerance_um)
    assert document["largest_um"] <= tolerance_um
    # 0.11e-3·(500/n)²/4 µm is left by n intervals; y and z are straight.
    wanted = math.ceil(math.sqrt(0.11e-3 * 500**2 / 4 / tolerance_um))
    counts = [len(document[f"{a}_mm"]) - 1 for a in "xyz"]
    assert counts == [wanted, 1, 1]
    assert document["x_mm"][-1] == 500


async def test_a_tolerance_may_be_asked_of_a_part_of_the_travel(client):
    part = {"x": {"min_mm": 100, "max_mm": 200}}
    document = await ask(client, GRID, tolerance_um=1.0, volume=part)
    assert document["x_mm"] == [100, 200]
    assert document["y_mm"] == [0, 500]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({}, "x_mm"),
        ({"x_mm": [0, 1]}, "y_mm"),
        (NODES | {"tolerance_um": 1.0}, "x_mm"),
        (NODES | {"volume": {"x": {"min_mm": 0, "max_mm": 1}}}, "volume"),
        (NODES | {"x_mm": [0, 0]}, "x_mm"),
        (NODES | {"x_mm": [0, 501]}, "x_mm"),
        ({a: list(range(101)) for a in NODES}, "x_mm"),
        ({"tolerance_um": 0}, "tolerance_um"),
        ({"tolerance_um": 1, "volume": {"x": {"min_mm": 5, "max_mm": 5}}}, "volume.x"),
        ({"tolerance_um": 1, "volume": {"x": {"min_mm": 0, "max_mm": 600}}}, "volume.x"),
        ({"tolerance_um": 1, "volume": {"w": {"min_mm": 0, "max_mm": 6}}}, "volume.w"),
    ],
)
async def test_what_is_no_grid_is_refused(app, client, changes, field):
    before = contents(app)
    found = problem(await client.post(GRID, json=ASKED | changes), 422)
    assert field in [e["field"] for e in found["errors"]]
    assert contents(app) == before


async def test_a_grid_needs_no_rotation_that_only_turns_the_tool(client):
    """XYFZ: with the tool along z, ECZ and EAZ·0 … have no arm; EAZ and EBZ need a tool."""
    asked = ASKED | NODES | {"missing_components": "refuse"}
    without = problem(await client.post(GRID, json=asked), 422)["detail"]
    with_tool = problem(await client.post(GRID, json=asked | {"tool_offset_mm": [0, 0, 9]}), 422)
    assert "EAZ" not in without
    assert "EAZ" in with_tool["detail"]
    assert "ECZ" not in with_tool["detail"]


# -- accuracy ------------------------------------------------------------------------------


async def test_every_definition_by_hand(client):
    """At 25.5 °C: EXX to 27.5 µm, EBX to 55 µrad, EZZ to 55 µm, SXY·y to −12.75 µm."""
    document = await ask(client, ACCURACY)
    assert document["linear"]["ranges_um"] == pytest.approx([27.5 + 12.75, 0, 55])
    assert document["linear"]["definition_1_um"] == pytest.approx(math.hypot(27.5, 55))
    assert document["linear"]["definition_2_um"] == pytest.approx(math.hypot(40.25, 55))
    assert document["linear"]["worst_point_mm"] == [500, 0, 500]
    assert document["angular"]["ranges_urad"] == pytest.approx([0, 55, 0])
    assert document["angular"]["definition_1_urad"] == pytest.approx(55)
    # With arms: E_x = 27.5 + 0.5·55 at z = 500, E_z = 55 at x = 0 and 55 − 27.5 at x = 500.
    assert document["with_arms"]["ranges_um"] == pytest.approx([55 + 12.75, 0, 55 + 27.5])
    # Edges along x at z = 0 and 500: 27.5 and 55 µm; along z: 55 µm; along y nothing.
    assert document["ELv_um"] == pytest.approx(math.hypot((27.5 + 55) / 2, 0, 55))
    along_x = (27.5 + 55) / 2 + 12.75
    assert document["ELSv_um"] == pytest.approx(math.hypot(along_x, 0, 55))
    ratio = math.hypot(along_x, 0, 55) / math.hypot(41.25, 0, 55)
    assert document["ratios"]["M1"] == pytest.approx(ratio)
    assert document["volume"]["x"] == {"min_mm": 0, "max_mm": 500}


async def test_table_8_2_of_machine_1(client):
    body = {
        "linear_um": {"x": [9.5, 7.2], "y": [15.8, 12.0], "z": [14.3, 25.2]},
        "straightness_um": {
            "EYX": 2.9, "EZX": 2.4, "EXY": 2.4, "EZY": 2.3, "EXZ": 15.9, "EYZ": 6.1,
        },
    }  # fmt: skip
    found = (await client.post(FROM_LINES, json=body)).json()
    assert {k: round(v, 2) for k, v in found.items()} == {
        "ELv_um": 25.55,
        "ELSv_um": 42.81,
        "ratio": 1.68,
    }
    del body["straightness_um"]["EYZ"]
    assert "EYZ" in problem(await client.post(FROM_LINES, json=body), 422)["detail"]
    zero = {axis: [0] for axis in "xyz"}
    straight = dict.fromkeys(("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"), 1)
    answer = await client.post(FROM_LINES, json={"linear_um": zero, "straightness_um": straight})
    assert answer.json()["ratio"] is None
    for wrong in ({"x": [-1], "y": [1], "z": [1]}, {"x": [1], "y": [1]}, {"x": [], "y": [1]}):
        problem(
            await client.post(FROM_LINES, json={"linear_um": wrong, "straightness_um": straight}),
            422,
        )


async def test_without_a_travel_the_tables_range_serves_and_is_said(client):
    open_ended = MACHINE | {"id": "open", "axes": {"x": MACHINE["axes"]["x"]}}
    await client.post("/v1/machines", json=open_ended)
    for t in (20.0, 30.0):
        await client.post("/v1/machines/open/error-maps", json=error_map(f"At {t}", t))
    path = "/v1/machines/open/volumetric-accuracy"
    found = problem(await client.post(path, json=ASKED), 422)
    assert [e["field"] for e in found["errors"]] == ["volume.y"]
    stated = ASKED | {"volume": {"y": {"min_mm": 0, "max_mm": 300}}}
    document = (await client.post(path, json=stated)).json()
    assert document["volume"]["z"] == {"min_mm": 0, "max_mm": 500}
    assert any("no travel of z" in warning for warning in document["warnings"])


# -- compensation levels -------------------------------------------------------------------


async def test_each_level_leaves_what_its_tables_do_not_know(client):
    document = await ask(client, LEVELS, tool_offset_mm=TOOL)
    levels = {level["level"]: level for level in document["levels"]}
    assert list(levels) == ["nothing", "displacement", "straightness", "angular", "nonrigid"]
    # With EXX and EZZ gone, x and y of SXY and the rotation are left.
    lattice = np.stack(np.meshgrid(*[np.linspace(0, 500, 11)] * 3, indexing="ij"), -1).reshape(
        -1, 3
    )
    errors = await errors_at(client, lattice, tool_offset_mm=TOOL)
    x, y, z = lattice.T
    displacement = np.stack([5.5 * x / 100, 0 * x, 5.5 * z / 50], axis=-1)
    squareness = np.stack([-25.5 * y / 1000, 0 * x, 0 * x], axis=-1)
    for name, taken in {
        "nothing": 0,
        "displacement": displacement,
        "straightness": displacement + squareness,
        "angular": errors,
    }.items():
        left = np.linalg.norm(errors - taken, axis=1)
        assert levels[name]["max_um"] == pytest.approx(left.max(), abs=2e-4)
        assert levels[name]["mean_um"] == pytest.approx(left.mean(), abs=2e-4)
        assert levels[name]["rms_um"] == pytest.approx(np.sqrt((left**2).mean()), abs=2e-4)
    folded = {t["component"]: t for t in levels["straightness"]["tables"]}
    assert set(folded) == {"EXX", "EZZ", "EXY"}
    assert folded["EXY"]["positions_mm"] == [0, 500]
    assert folded["EXY"]["errors_um"] == pytest.approx([0, -12.75])
    assert folded["EXY"]["compensation_um"] == pytest.approx([0, 12.75])
    angular = {t["component"]: t for t in levels["angular"]["tables"]}
    assert angular["EBX"]["errors_urad"] == pytest.approx([0, 55])


@pytest.mark.parametrize(("points", "status"), [(1, 422), (2, 200), (60, 200), (61, 422)])
async def test_the_lattice_has_a_size(client, points, status):
    answer = await client.post(LEVELS, json=ASKED | {"points_per_axis": points})
    assert answer.status_code == status


# -- rotary axes ---------------------------------------------------------------------------


@pytest.fixture
async def with_rotary(client):
    """Two maps whose C axis moves by 1 µm/°C in x; XOC is 5.5 µm at 25.5 °C."""
    for t in (20.0, 30.0):
        components = [
            {"component": "XOC", "value_um": t - 20.0},
            {"component": "YOC", "value_um": 2.0},
            {"component": "AOC", "value_urad": 0.0},
            {"component": "BOC", "value_urad": 10.0},
        ]
        answer = await client.post(
            f"{ROOM}/error-maps", json=error_map(f"Rotary {t}", t + 0.5, components=components)
        )
        assert answer.status_code == 201, answer.text
    assignment = dict.fromkeys(("XOC", "YOC", "AOC", "BOC"), "x-middle")
    answer = await client.put(f"{ROOM}/sensor-assignment", json=assignment)
    assert answer.status_code == 200, answer.text
    return client


async def test_a_turned_table_by_hand(with_rotary):
    """Half a turn throws a point by twice the axis' offset; a tilt b lifts it by 2·b·x."""
    asked = {"temperatures_c": temperatures(26.0), "missing_components": "refuse", "order": "C"}
    asked |= {"angles_deg": {"C": [0, 180]}, "points_mm": [[100, 0, 0], [100, 0, 0]]}
    document = await ask(with_rotary, ROTARY, **asked)
    assert document["locations"] == pytest.approx({"XOC": 5.5, "YOC": 2, "AOC": 0, "BOC": 10})
    assert document["complete"] is True
    still, turned = document["errors_um"]
    assert still == [0, 0, 0]
    assert turned == pytest.approx([11, 4, 2], abs=1e-3)


async def test_what_a_control_that_knows_the_position_leaves_of_the_path_errors(with_rotary):
    """Of XOC 5.5, YOC 2 µm and BOC 10 µrad at half a turn, (11, 4, 2) µm: the tilt's 2 µm."""
    asked = {"temperatures_c": temperatures(26.0), "missing_components": "zero", "order": "C"}
    asked |= {"angles_deg": {"C": [0, 180]}, "points_mm": [[100, 0, 0]]}
    known = {"compensated": {"XOC": 5.5, "YOC": 2.0}}
    document = await ask(with_rotary, ROTARY, **asked, **known)
    assert document["errors_um"][1] == pytest.approx([11, 4, 2], abs=1e-3)
    assert document["left_um"][1] == pytest.approx([0, 0, 2], abs=1e-3)
    longest = (121 + 16 + 4) ** 0.5
    assert document["max_um"] == pytest.approx(longest, abs=1e-3)
    assert document["rms_um"] == pytest.approx(longest / 2**0.5, abs=1e-3)
    assert document["left_max_um"] == pytest.approx(2, abs=1e-3)
    assert document["left_rms_um"] == pytest.approx(2**0.5, abs=1e-3)
    plain = await ask(with_rotary, ROTARY, **asked)
    assert plain["left_um"] == plain["errors_um"]
    assert plain["left_max_um"] == plain["max_um"]


async def test_one_point_at_many_angles_and_about_a_pivot(with_rotary):
    asked = {"temperatures_c": temperatures(26.0), "missing_components": "zero", "order": "AC"}
    angles = {"C": [0, 90, 180, 270], "A": 0}
    one = asked | {"angles_deg": angles, "points_mm": [[350, 250, 0]]}
    document = await ask(with_rotary, ROTARY, **one, pivots_mm={"C": [250, 250, 0]})
    assert document["counted_as_zero"] == ["YOA", "ZOA", "BOA", "COA"]
    assert np.shape(document["errors_um"]) == (4, 3)
    assert document["errors_um"][2] == pytest.approx([11, 4, 2], abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"order": "CX"}, "order"),
        ({"angles_deg": {"D": 1}, "order": "C"}, "angles_deg.D"),
        ({"angles_deg": {"C": [1, 2, 3]}, "points_mm": [[0, 0, 0]] * 2}, "angles_deg.C"),
        ({"angles_deg": {"C": "90"}}, "angles_deg.C.0"),
        ({"points_mm": [[0, 0]]}, "points_mm.0"),
        ({"pivots_mm": {"D": [0, 0, 0]}}, "pivots_mm.D"),
        ({"compensated": {"YOA": 1}, "order": "C"}, "compensated"),
        ({"order": "AC", "angles_deg": {"A": [0, 1], "C": [0, 1, 2]}}, "angles_deg.A"),
    ],
)
async def test_what_is_no_turn_is_refused(client, changes, field):
    asked = {"order": "C", "angles_deg": {"C": 90}, "points_mm": [[100, 0, 0]]}
    found = problem(await client.post(ROTARY, json=ASKED | asked | changes), 422)
    assert field in [e["field"] for e in found["errors"]]


async def test_location_errors_that_no_map_has_are_named(client):
    asked = {"order": "C", "angles_deg": {"C": 90}, "points_mm": [[100, 0, 0]]}
    body = {"temperatures_c": temperatures(25.5)} | asked
    detail = problem(await client.post(ROTARY, json=body), 422)["detail"]
    assert "XOC, YOC, AOC, BOC" in detail


# -- what they share -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "more"),
    [
        (GRID, NODES),
        (ACCURACY, {}),
        (LEVELS, {}),
        (ROTARY, {"order": "C", "angles_deg": {"C": 90}, "points_mm": [[100, 0, 0]]}),
    ],
)
async def test_each_answers_at_the_latest_reading_and_tells_what_it_lacks(client, path, more):
    body = {"missing_components": "zero"} | more
    problem(await client.post(path, json=body), 409)
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    document = (await client.post(path, json=body)).json()
    stated = await ask(client, path, **more)
    assert {k: v for k, v in document.items() if k != "computed_at"} == {
        k: v for k, v in stated.items() if k != "computed_at"
    }
    problem(await client.post(path, json=ASKED | more | {"nonsense": 1}), 422)
    problem(await client.post(path.replace("mcfv5050", "nobody"), json=ASKED | more), 404)


async def test_what_a_large_gantry_must_have_measured_and_what_the_model_lacks(client):
    """8.37–8.54: the errors of a rigid body and ten slopes, of which the maps have none."""
    answer = await client.get(f"{ROOM}/needed-components", params={"preset": "large-gantry"})
    assert answer.status_code == 200, answer.text
    document = answer.json()
    slopes = [one for one in document["components"] if one["kind"] == "nonrigid slope"]
    assert {one["component"] for one in slopes} == set(document["preset"]["slopes"])
    assert len(slopes) == 10
    assert not any(one["in_model"] for one in slopes)
    assert slopes[0] == {
        "component": "EXY^x", "chapter": "D_x^x(y)", "kind": "nonrigid slope", "unit": "µm/m",
        "in_model": False,
    }  # fmt: skip
    present = {one["component"] for one in document["components"] if one["in_model"]}
    assert "EXX" in present
    missing = [one["component"] for one in document["components"] if not one["in_model"]]
    assert document["missing"] == missing
    assert document["warnings"] == []


async def test_a_rigid_machine_needs_no_slopes_and_a_presets_chain_may_be_another(client):
    rigid = (await client.get(f"{ROOM}/needed-components")).json()
    assert rigid["preset"] is None
    assert not any(one["kind"] == "nonrigid slope" for one in rigid["components"])
    asked = {"temperatures_c": temperatures(26.0), "points_mm": [[1, 2, 3]]}
    refusal = await client.post(f"{ROOM}/volumetric-error", json=asked)
    # What the volumetric error counts as missing is what this route says.
    assert refusal.status_code == 422
    assert all(code in refusal.text for code in rigid["missing"][:3])
    asked = {"preset": "horizontal-counterweight", "tool_length_mm": 160}
    other = (await client.get(f"{ROOM}/needed-components", params=asked)).json()
    # Of a tool along z all 21 but ECZ, which has no lever and does not turn it.
    assert len(other["components"]) == 20 + 5
    assert "given for XFYZ (8.19–8.36); this machine is XYFZ" in other["warnings"][0]


async def test_kinds_of_machines_are_listed_and_an_unknown_one_is_refused(client):
    listed = (await client.get("/v1/nonrigid-presets")).json()
    assert [(one["name"], len(one["slopes"])) for one in listed] == [
        ("horizontal-counterweight", 5),
        ("large-gantry", 10),
    ]
    answer = await client.get(f"{ROOM}/needed-components", params={"preset": "gantry"})
    assert (
        "(horizontal-counterweight, large-gantry), got 'gantry'" in problem(answer, 404)["detail"]
    )

"""Measurements over HTTP: readings in, components with their uncertainty out, stored if asked.

What each method computes is tested in tests/measurement; here is what HTTP adds.
"""

import numpy as np
import pytest

from app.api.methods.body_diagonal import BodyDiagonalRequest
from app.api.methods.drilled_plate import DrilledPlateRequest
from app.api.methods.machined_part import MachinedPartRequest
from app.api.methods.positioning import PositioningRequest
from app.api.methods.rotary_axis import RotaryAxisRequest
from app.api.methods.six_dof import SixDofRequest
from app.api.methods.step_diagonal import StepDiagonalRequest
from app.api.methods.thermal_drift import ThermalDriftRequest
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    contents,
    error_map,
    iso,
    problem,
    temperatures,
)

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.parametrize("furnished_url", ["sqlite"], indirect=True),
]

EXAMPLES = {
    "step-diagonal": StepDiagonalRequest,
    "body-diagonal": BodyDiagonalRequest,
    "positioning": PositioningRequest,
    "six-dof": SixDofRequest,
    "machined-part": MachinedPartRequest,
    "drilled-plate": DrilledPlateRequest,
    "rotary-axis": RotaryAxisRequest,
}
HEADER = {"label": "Measured", "measured_at": iso(START), "temperatures_c": temperatures(50.0)}


def example(method):
    """The documentation's own example of a method."""
    return EXAMPLES[method].model_config["json_schema_extra"]["example"]


def path_of(method, store=None):
    query = "" if store is None else f"?store={str(store).lower()}"
    return f"{ROOM}/measurements/{method}{query}"


async def measured(client, method, store=None, **changes):
    answer = await client.post(path_of(method, store), json=example(method) | changes)
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize("method", EXAMPLES)
async def test_the_documented_example_is_answered_and_nothing_stored(app, client, method):
    before = contents(app)
    document = await measured(client, method)
    assert document["method"] == method
    assert document["stored"] is False
    assert document["map_id"] is None
    assert document["components"]
    assert document["figures"]
    assert document["notes"]
    assert contents(app) == before


@pytest.mark.parametrize("method", EXAMPLES)
async def test_stored_it_is_a_map_with_the_same_components(client, method):
    document = await measured(client, method, store=True, **HEADER)
    assert document["stored"] is True
    stored = (await client.get(f"{ROOM}/error-maps/{document['map_id']}")).json()
    assert stored["label"] == "Measured"
    shown = [{k: v for k, v in c.items() if v is not None} for c in document["components"]]
    for kept, written in zip(stored["components"], shown, strict=True):
        assert kept.keys() - written.keys() <= {"covariance"}  # of nothing but rounding errors
        for name, value in written.items():
            if isinstance(value, str):
                assert kept[name] == value
            else:  # written to 0.1 nm, uncertainties to nine digits; stored in full
                np.testing.assert_allclose(kept[name], value, rtol=1e-8, atol=5.01e-5)
    assert stored.get("measuring_lines_mm", {}) == document["measuring_lines_mm"]
    again = await measured(client, method, store=True, **HEADER)
    assert again["map_id"] == document["map_id"]


@pytest.mark.parametrize("method", EXAMPLES)
async def test_a_map_needs_a_label_a_time_and_temperatures(app, client, method):
    before = contents(app)
    body = {k: v for k, v in example(method).items() if k != "temperatures_c"}
    found = problem(await client.post(path_of(method, True), json=body), 422)
    fields = [e["field"] for e in found["errors"]]
    assert fields == ["label", "measured_at", "temperatures_c"]
    assert contents(app) == before


@pytest.mark.parametrize("method", EXAMPLES)
async def test_an_unknown_machine_or_field(client, method):
    body = example(method)
    path = path_of(method).replace("mcfv5050", "nobody")
    problem(await client.post(path, json=body), 404)
    problem(await client.post(path_of(method), json=body | {"colour": "red"}), 422)
    problem(await client.post(path_of(method) + "?store=perhaps", json=body), 422)


async def test_an_unknown_method(client):
    problem(await client.post(f"{ROOM}/measurements/dowsing", json={}), 404)


WRONG = [
    ("step-diagonal", {"step_mm": [0, 100, 80]}, "step_mm"),
    ("step-diagonal", {"step_mm": [100, 100, 300]}, "step_mm"),  # leaves the travel of z
    ("step-diagonal", {"diagonals": {"ppp": [[0, 0, 0]]}}, "diagonals"),
    ("step-diagonal", {"angular": [{"component": "EQQ"}]}, "angular.0.component"),
    ("body-diagonal", {"volume": {"w": {"min_mm": 0, "max_mm": 1}}}, "volume.w"),
    ("positioning", {"axis": "c"}, "axis"),
    ("positioning", {"forward_um": [[0, 1]]}, "forward_um"),
    ("positioning", {"forward_um": [[0, 1, "2"]]}, "forward_um.0.2"),
    ("six-dof", {"straightness_um": {"x": [0, 0, 0]}}, "straightness_um"),
    ("six-dof", {"linear_um": [0, 1]}, "linear_um"),
    ("machined-part", {"positions_mm": [0, 50]}, "positions_mm"),
    ("drilled-plate", {"holes": [{"nominal_mm": [0, 0], "measured_mm": [0, 0]}]}, "holes"),
    ("rotary-axis", {"axis": "D"}, "axis"),
    ("rotary-axis", {"points": [{"angle_deg": 0, "position_mm": [1, 0, 0]}]}, "points"),
]


@pytest.mark.parametrize(("method", "changes", "field"), WRONG)
async def test_what_cannot_be_a_measurement_is_refused_whole(app, client, method, changes, field):
    before = contents(app)
    body = example(method) | HEADER | changes
    found = problem(await client.post(path_of(method, True), json=body), 422)
    assert any(e["field"].startswith(field) for e in found["errors"]), found
    assert contents(app) == before


async def test_readings_of_the_simulated_machine_give_its_errors_back(client):
    """The stored machine at 25.5 °C has EXX 5.5·x/100 µm, EZZ 5.5·z/50 µm, SXY −25.5 µm/m.

    Its pitch EBX is known: without it the translations would hold it.
    """
    asked = {"temperatures_c": temperatures(25.5), "missing_components": "zero", "steps": 10}
    simulated = await client.post(f"{path_of('step-diagonal')}/simulate", json=asked)
    assert simulated.status_code == 200, simulated.text
    readings = simulated.json()
    assert readings["step_mm"] == [50, 50, 50]
    assert np.shape(readings["diagonals"]["pnp"]) == (10, 3)
    body = {k: readings[k] for k in ("origin_mm", "step_mm", "tool_offset_mm", "diagonals")}
    pitch = {"component": "EBX", "positions_mm": [0, 500], "errors_urad": [0, 55]}
    answer = await client.post(path_of("step-diagonal"), json=body | {"angular": [pitch]})
    components = {c["component"]: c for c in answer.json()["components"]}
    z_arm = 2 * 5.5 * 0.25  # EBX at the lines through the centre, z = 250 mm
    np.testing.assert_allclose(
        components["EXX"]["errors_um"], np.linspace(0, 27.5 + z_arm * 5, 11), atol=1e-4
    )
    assert components["EZZ"]["errors_um"][-1] == pytest.approx(55)
    assert components["SXY"]["value_um_per_m"] == pytest.approx(-25.5)
    assert max(map(abs, np.ravel(answer.json()["closure_um"]))) == 0.0


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"steps": 1001}, "steps"),
        ({"step_mm": [100, 100, 100]}, "step_mm"),
        ({"origin_mm": [-1, 0, 0], "step_mm": [1, 1, 1]}, "step_mm"),
        ({"mirror_tilts_urad": {"ppp": [1]}}, "mirror_tilts_urad.ppp"),
    ],
)
async def test_a_plan_that_cannot_be_is_refused(client, changes, field):
    asked = {"temperatures_c": temperatures(25.5), "missing_components": "zero", "steps": 10}
    answer = await client.post(f"{path_of('step-diagonal')}/simulate", json=asked | changes)
    assert field in [e["field"] for e in problem(answer, 422)["errors"]]


async def test_a_part_is_compared_with_the_model_at_its_temperatures(client):
    """Two maps of EXY, a parabola that grows with temperature; the part shows 42 °C's."""
    positions = [0, 125, 250, 375, 500]
    shape = np.array([0.0, 3.0, 4.0, 3.0, 0.0])
    for t in (40.0, 44.0):
        straightness = {
            "component": "EXY",
            "positions_mm": positions,
            "errors_um": (shape * (t - 39.0)).tolist(),
        }
        content = error_map(f"At {t}", t, components=[straightness])
        assert (await client.post(f"{ROOM}/error-maps", json=content)).status_code == 201
    part = {
        "component": "D_x(y)",
        "positions_mm": positions,
        "measured_um": (shape * 3.0 + [5.0, 5.1, 4.9, 5.0, 5.0]).tolist(),
        "temperatures_c": temperatures(42.0),
    }
    document = (await client.post(path_of("machined-part"), json=part)).json()
    comparison = document["comparison"]
    assert comparison["predicted_um"] == pytest.approx((shape * 3.0).tolist())
    assert comparison["bias_um"] == pytest.approx(5.0)
    assert comparison["r"] > 0.99
    assert comparison["confidence_95"][0] < comparison["r"] < comparison["confidence_95"][1]
    # On its path through x = 300, z = 100 the machine's other errors are in the prediction.
    on_path = part | {"measuring_line_mm": [300, 0, 100]}
    document = (await client.post(path_of("machined-part"), json=on_path)).json()
    assert any("counts as zero" in note for note in document["notes"])
    del part["temperatures_c"]
    document = (await client.post(path_of("machined-part"), json=part)).json()
    assert document["comparison"] is None


async def test_a_machine_without_travel_has_body_diagonals_without_squareness(client):
    await client.post("/v1/machines", json=MACHINE | {"id": "open", "axes": {}})
    path = "/v1/machines/open/measurements/body-diagonal"
    document = (await client.post(path, json=example("body-diagonal"))).json()
    assert document["components"] == []
    assert document["Ed_um"] == pytest.approx(12.1)
    box = {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"}
    stated = (await client.post(path, json=example("body-diagonal") | {"volume": box})).json()
    assert {c["component"] for c in stated["components"]} == {"SXY", "SYZ", "SZX"}


async def test_a_misspelt_query_parameter_is_no_wish_of_nothing(app, client):
    before = contents(app)
    body = example("positioning") | HEADER
    answer = await client.post(f"{path_of('positioning')}?stroe=true", json=body)
    found = problem(answer, 422)
    assert found["errors"][0]["field"] == "stroe"
    assert "store" in found["detail"]
    assert contents(app) == before
    problem(await client.get(f"{ROOM}/readings?since=2026"), 422)


async def test_what_was_measured_tomorrow_is_refused(app, client):
    before = contents(app)
    body = example("positioning") | HEADER | {"measured_at": "2036-03-01T06:00:00Z"}
    found = problem(await client.post(path_of("positioning", True), json=body), 422)
    assert found["errors"][0]["field"] == "measured_at"
    content = error_map("Tomorrow", 50.0, measured_at="2036-03-01T06:00:00Z")
    problem(await client.post(f"{ROOM}/error-maps", json=content), 422)
    assert contents(app) == before


async def test_a_map_says_by_which_method_it_was_made(client):
    document = await measured(client, "positioning", store=True, **HEADER)
    stored = (await client.get(f"{ROOM}/error-maps/{document['map_id']}")).json()
    assert stored["instrument"] == "positioning"
    body = {"instrument": "XL-80", "label": "Other", "temperatures_c": temperatures(60.0)}
    document = await measured(client, "positioning", store=True, **(HEADER | body))
    stored = (await client.get(f"{ROOM}/error-maps/{document['map_id']}")).json()
    assert stored["instrument"] == "XL-80"


async def test_positions_beyond_the_travel_are_said_and_an_axis_that_is_not_there_refused(client):
    document = await measured(client, "positioning", targets_mm=[0, 250, 900])
    assert any("beyond the axis' travel" in note for note in document["notes"])
    await client.post(
        "/v1/machines", json=MACHINE | {"id": "l", "configuration": "FZX", "axes": {}}
    )
    path = "/v1/machines/l/measurements/positioning"
    found = problem(await client.post(path, json=example("positioning") | {"axis": "y"}), 422)
    assert "FZX" in found["detail"]


async def test_a_b_axis_is_measured_and_stored_under_its_own_components(client):
    points = [
        {"angle_deg": 0, "position_mm": [101.0, 20.0, 0.0]},
        {"angle_deg": 90, "position_mm": [0.0, 20.0, -101.0]},
        {"angle_deg": 180, "position_mm": [-101.0, 20.0, 0.0]},
    ]
    body = HEADER | {"axis": "B", "points": points}
    answer = await client.post(path_of("rotary-axis"), params={"store": True}, json=body)
    assert answer.status_code in (200, 201), answer.text
    components = answer.json()["components"]
    assert {one["component"] for one in components} == {"XOB", "ZOB", "AOB", "COB"}


@pytest.mark.parametrize("method", [*EXAMPLES, "thermal-drift"])
async def test_every_number_is_rounded_as_tables_are(client, method):
    """Thirds of what the documentation's example reads: whatever is not rounded has 16 digits."""
    shape = ThermalDriftRequest if method == "thermal-drift" else EXAMPLES[method]
    body = scaled(shape.model_config["json_schema_extra"]["example"])
    answer = await client.post(path_of(method), json=body)
    assert answer.status_code == 200, answer.text
    fields = answer.json()
    fields.pop("measuring_lines_mm")  # as it was stated
    found = list(numbers_in(fields))
    assert found
    for name, value in found:
        assert len(f"{value!r}".partition("e")[0].replace(".", "").strip("-0")) <= 9, (name, value)
        assert (value, f"{value!r}") != (0.0, "-0.0"), name
        if "errors_u" in name and "standard" not in name:
            assert value == round(value, 4), name


def scaled(value, name=""):
    """The same with thirds of everything that was read; what was stated of it stays."""
    if isinstance(value, dict):
        return {key: scaled(inner, key) for key, inner in value.items()}
    if isinstance(value, list):
        return [scaled(inner, name) for inner in value]
    is_read = isinstance(value, float | int) and name.endswith(("_um", "_urad", "nnn", "nmm"))
    return value / 3 if is_read or name in ("ppp", "npp", "pnp", "ppn") else value


def numbers_in(value, name=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from numbers_in(inner, key if "figures" not in name else f"figures {key}")
    elif isinstance(value, list):
        for inner in value:
            yield from numbers_in(inner, name)
    elif isinstance(value, float):
        yield name, value

"""Standard errors and covariances over HTTP: into maps, out of them, and into tables."""

import math
from copy import deepcopy

import numpy as np
import pytest

from app.geometry.components import COMPONENTS
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    by_code,
    contents,
    error_map,
    problem,
    reading,
    table,
)
from thermap.answers import CompensationAnswer

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/error-maps"
TABLE = f"{ROOM}/compensation"
COVARIANCE = [[0.04, 0.03, 0.0], [0.03, 0.09, 0.01], [0.0, 0.01, 0.16]]
ADDED = {"chapter", "iso", "iso_value_urad"}
"""What an answer has beside what was stated."""

KINDS = {
    "EXX": (table("EXX", [0, 500], [0.0, 1.2]), "standard_errors_um"),
    "EBX": (table("EBX", [0, 500], [0.0, 1.2], "urad"), "standard_errors_urad"),
    "EYY^x": (
        {"component": "EYY^x", "positions_mm": [0, 500], "slopes_um_per_m": [0.0, 3.0]},
        "standard_errors_um_per_m",
    ),
    "EAY^x": (
        {"component": "EAY^x", "positions_mm": [0, 500], "slopes_urad_per_m": [0.0, 3.0]},
        "standard_errors_urad_per_m",
    ),
    "SXY": ({"component": "SXY", "value_um_per_m": -12.1}, "standard_error_um_per_m"),
    "XOC": ({"component": "XOC", "value_um": 4.0}, "standard_error_um"),
    "AOC": ({"component": "AOC", "value_urad": 4.0}, "standard_error_urad"),
}


def whole(*components, label="Run #9", t_c=40.0):
    return error_map(label, t_c, components=list(components))


async def stored(client, *components, **more):
    answer = await client.post(PATH, json=whole(*components, **more))
    assert answer.status_code == 201, answer.text
    return answer.json()


def exx(**more):
    return table("EXX", [0, 100, 500], [0.0, 1.0, 2.0], **more)


# --- maps --------------------------------------------------------------------------------


@pytest.mark.parametrize("code", KINDS)
async def test_every_kind_of_component_keeps_its_standard_errors(client, code):
    component, field = KINDS[code]
    stated = 0.3 if "errors" not in field else [0.1, 0.7]
    assert COMPONENTS[code].standard_error_field == field
    (shown,) = (await stored(client, component | {field: stated}))["components"]
    assert shown[field] == stated
    assert not {"covariance", "backward_covariance"} & set(shown)


async def test_both_directions_keep_their_own(client):
    both = exx(
        backward_errors_um=[1.0, 2.0, 3.0],
        standard_errors_um=[0.1, 0.2, 0.3],
        backward_covariance=COVARIANCE,
    )
    made = await stored(client, both)
    (shown,) = made["components"]
    assert both.items() <= shown.items()
    assert shown["backward_standard_errors_um"] == [math.sqrt(v) for v in (0.04, 0.09, 0.16)]
    assert "covariance" not in shown
    assert (await client.get(f"{PATH}/{made['id']}")).json() == made


async def test_a_covariance_is_shown_where_it_is_not_diagonal(client):
    (shown,) = (await stored(client, exx(covariance=COVARIANCE)))["components"]
    assert shown["covariance"] == COVARIANCE
    assert shown["standard_errors_um"] == pytest.approx([0.2, 0.3, 0.4])
    diagonal = np.diag(np.diagonal(COVARIANCE)).tolist()
    (shown,) = (await stored(client, exx(covariance=diagonal), label="diagonal", t_c=44.0))[
        "components"
    ]
    assert "covariance" not in shown
    assert shown["standard_errors_um"] == pytest.approx([0.2, 0.3, 0.4])


async def test_a_map_without_uncertainty_shows_none(client):
    for shown in (await client.get(PATH)).json()[0]["components"]:
        assert not [field for field in shown if "standard" in field or "covariance" in field]


async def test_iso_names_turn_signs_but_no_uncertainty(client):
    c0y = {"component": "C0Y", "value_um_per_m": 12.1, "standard_error_um_per_m": 0.8}
    (shown,) = (await stored(client, c0y))["components"]
    assert (shown["value_um_per_m"], shown["standard_error_um_per_m"]) == (-12.1, 0.8)


# --- the same again ----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
async def test_what_is_shown_can_be_sent_again(client, app, seed):
    """Also where the root of a variance, squared, is another number in its last bit."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    content = whole(
        exx(covariance=(root @ root.T).tolist(), backward_errors_um=[0.0, 0.0, 0.0]),
        table("EYX", [0, 1, 2], [0.0, 0.0, 0.0], covariance=np.diag(rng.uniform(0, 1, 3)).tolist()),
        table("EZX", [0, 1, 2], [0.0, 0.0, 0.0], standard_errors_um=rng.uniform(0, 1, 3).tolist()),
        {"component": "SXY", "value_um_per_m": 1.0, "covariance": [[float(rng.uniform())]]},
    )
    first = await client.post(PATH, json=content)
    assert first.status_code == 201, first.text
    before = contents(app)
    shown = [
        {field: value for field, value in component.items() if field not in ADDED}
        for component in first.json()["components"]
    ]
    for again in (content, content | {"components": shown}):
        answer = await client.post(PATH, json=again)
        assert answer.status_code == 200, answer.text
        assert answer.json() == first.json()
    assert contents(app) == before


KNOWN = exx(
    standard_errors_um=[0.2, 0.3, 0.4],
    backward_errors_um=[0.0, 0.0, 0.0],
    backward_covariance=COVARIANCE,
)


@pytest.mark.parametrize(
    "change",
    [
        {"standard_errors_um": None},
        {"standard_errors_um": [0.2, 0.3, 0.4000000000000001]},
        {"standard_errors_um": None, "covariance": COVARIANCE},
        {"backward_covariance": None},
        {"backward_covariance": np.diag(np.diagonal(COVARIANCE)).tolist()},
        {"backward_covariance": (np.array(COVARIANCE) * (1 + 1e-15)).tolist()},
    ],
    ids=["none", "last bit", "correlated", "none backward", "uncorrelated", "last bits"],
)
async def test_another_uncertainty_under_a_label_is_a_conflict(client, app, change):
    await stored(client, KNOWN)
    before = contents(app)
    other = {k: v for k, v in (KNOWN | change).items() if v is not None}
    assert "'Run #9'" in problem(await client.post(PATH, json=whole(other)), 409)["detail"]
    assert contents(app) == before


# --- refusals ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("component", "field", "sentence"),
    [
        (
            exx(standard_errors_um=[0.1, 0.2]),
            "standard_errors_um",
            "expected 3 standard errors of EXX in µm, one for each position, got 2",
        ),
        (
            exx(standard_errors_um=[0.1, -0.2, 0.3]),
            "standard_errors_um.1",
            "expected at least 0 in µm, got -0.2",
        ),
        (
            exx(standard_error_um=0.1),
            "standard_error_um",
            "expected errors_um [µm] for EXX (linear displacement), got standard_error_um",
        ),
        (
            {"component": "SXY", "value_um_per_m": 1.0, "backward_covariance": [[1.0]]},
            "backward_covariance",
            "expected value_um_per_m [µm/m] for SXY (squareness), got backward_covariance",
        ),
        (
            exx(backward_standard_errors_um=[0.1, 0.2, 0.3]),
            "backward_standard_errors_um",
            "expected backward_errors_um of EXX beside it, got none",
        ),
        (
            exx(backward_covariance=COVARIANCE),
            "backward_covariance",
            "expected backward_errors_um of EXX beside it, got none",
        ),
        (
            exx(covariance=[*COVARIANCE[:2], [0.0]]),
            "covariance",
            "expected 3 rows of 3 numbers in (µm)², got 3 rows of 1 or 3",
        ),
        (
            exx(covariance=COVARIANCE, standard_errors_um=[0.2, 0.3, 0.5]),
            "covariance",
            "got 0.5 µm there and 0.4 µm here (at index 2)",
        ),
    ],
)  # fmt: skip
async def test_what_is_no_uncertainty_is_refused_whole(client, app, component, field, sentence):
    before = contents(app)
    found = problem(await client.post(PATH, json=whole(component)), 422)
    assert found["errors"][0]["field"] == f"components.0.{field}"
    assert sentence in found["errors"][0]["message"]
    assert contents(app) == before


# --- tables ------------------------------------------------------------------------------


async def ask(client, t_c, z_column=42.0):
    body = {"temperatures_c": {"x-middle": t_c, "z-column": z_column}}
    answer = await client.post(TABLE, json=body)
    assert answer.status_code == 200, answer.text
    CompensationAnswer.model_validate_json(answer.content)
    return answer


@pytest.fixture
async def two_maps(empty):
    """Two maps at 20 °C and 30 °C, in which not every component states its uncertainty."""
    await empty.post("/v1/machines", json=MACHINE)
    for t_c, spread in ((20.0, 0.3), (30.0, 0.4)):
        components = [
            exx(standard_errors_um=[spread, 0.0, 10 * spread]),
            table("EYX", [0, 500], [0.0, 1.0]),
            table(
                "EZX", [0, 500], [0.0, 1.0],
                backward_errors_um=[1.0, 2.0], backward_standard_errors_um=[spread, 0.0],
            ),
            table("EBX", [0, 500], [0.0, 10.0], "urad", covariance=[[spread**2, 0.1], [0.1, 1]]),
            {"component": "SXY", "value_um_per_m": -t_c, "standard_error_um_per_m": spread},
        ]  # fmt: skip
        components += [] if t_c < 25 else [table("EXY", [0, 5], [0, 1], standard_errors_um=[1, 2])]
        await stored(empty, *components, label=f"at {t_c}", t_c=t_c)
    third = [table("EXY", [0, 5], [0, 1])]
    await stored(empty, *third, label="at 40", t_c=40.0)
    return empty


async def test_a_table_has_standard_errors_beside_its_errors(two_maps):
    found = by_code((await ask(two_maps, 25.0)).json())
    assert found["EXX"]["standard_errors_um"] == pytest.approx([0.25, 0.0, 2.5])
    assert found["EBX"]["standard_errors_urad"] == pytest.approx([0.25, math.sqrt(0.5)], abs=5.1e-5)
    assert found["SXY"]["standard_error_um_per_m"] == pytest.approx(0.25)
    assert found["EZX"]["backward_standard_errors_um"] == pytest.approx([0.25, 0.0])
    fields = list(found["EXX"])
    assert fields[fields.index("errors_um") + 1] == "standard_errors_um"


async def test_where_a_map_that_enters_states_none_there_is_none(two_maps):
    found = by_code((await ask(two_maps, 25.0)).json())
    for code, fields in {"EYX": {"standard_errors_um"}, "EZX": {"standard_errors_um"}}.items():
        assert not fields & set(found[code])
    exy = [by_code((await ask(two_maps, t)).json())["EXY"] for t in (30.0, 35.0, 40.0)]
    assert [entry.get("standard_errors_um") for entry in exy] == [[1.0, 2.0], None, None]


async def test_extrapolated_it_grows(two_maps):
    await two_maps.patch(ROOM, json={"out_of_range": "extrapolate"})
    entry = by_code((await ask(two_maps, 34.0)).json())["SXY"]
    w = entry["weight"]
    assert (entry["status"], w) == ("extrapolated", pytest.approx(1.4))
    # SXY falls by 1 µm/m per K; the maps' temperatures are read to 0.1 °C, each ±0.1/√12.
    from_temperatures = math.sqrt(2.0 * w * (w - 1.0)) * 0.1 / math.sqrt(12.0)
    expected = math.hypot(0.4 * w, 0.3 * (1 - w), from_temperatures)
    assert entry["standard_error_um_per_m"] == pytest.approx(expected, abs=5.1e-5)


async def test_the_table_at_the_latest_reading_has_them_too(two_maps):
    await two_maps.post(f"{ROOM}/readings", json=reading(START, 25.0))
    answer = await two_maps.get(TABLE)
    assert answer.status_code == 200, answer.text
    found = by_code(answer.json())
    assert found["EXX"]["standard_errors_um"] == pytest.approx([0.25, 0.0, 2.5])


@pytest.mark.parametrize("code", KINDS)
async def test_every_kind_has_its_field_in_the_table_too(empty, code):
    await empty.post("/v1/machines", json=MACHINE | {"sensors": [{"name": "only"}]})
    component, field = KINDS[code]
    stated = [3.0, 4.0] if COMPONENTS[code].is_table else 3.0
    for t_c in (20.0, 30.0):
        content = whole(deepcopy(component) | {field: stated}, label=f"{t_c}", t_c=t_c)
        answer = await empty.post(PATH, json=content | {"temperatures_c": {"only": t_c}})
        assert answer.status_code == 201, answer.text
    await empty.put(f"{ROOM}/sensor-assignment", json={code: "only"})
    answer = await empty.post(TABLE, json={"temperatures_c": {"only": 20.0}})
    (entry,) = answer.json()["components"]
    assert entry[field] == stated
    (parsed,) = CompensationAnswer.model_validate_json(answer.content).components
    assert parsed.standard_errors == stated

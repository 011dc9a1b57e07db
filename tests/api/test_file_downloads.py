"""What is downloaded is read again as what it was; what is filled in is read as what it is."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.api.uploads import parse_error_map
from app.effects.observations import Observation, Verification
from app.files.csv_comments import Header
from app.files.csv_verification import parse_csv_verification
from app.files.csv_writing import csv_of_check, csv_of_map
from app.geometry.components import COMPONENTS
from app.search.rows import Datum
from app.services.observations import VerificationRequest
from app.thermal.error_map import ComponentTable, ErrorMap
from tests.service_examples import ROOM, START, problem

FILE = Path("file.csv")
TABLES = [code for code, one in COMPONENTS.items() if one.is_table]
SINGLE = [code for code, one in COMPONENTS.items() if not one.is_table]
errors = st.floats(-500.0, 500.0).map(lambda v: round(v, 6) + 0.0)
spread = st.floats(0.01, 5.0).map(lambda v: round(v, 6))
labels = st.text(
    st.characters(codec="utf-8", categories=("L", "N", "P", "S")), min_size=1, max_size=30
).map(lambda t: f"M{t}M")
moments = st.datetimes(datetime(2020, 1, 1), datetime(2030, 1, 1)).map(
    lambda t: t.replace(tzinfo=UTC)
)


@st.composite
def tables(draw, code):
    n = draw(st.integers(1, 5)) if COMPONENTS[code].is_table else 1
    positions = sorted(draw(st.sets(st.integers(-900, 900), min_size=n, max_size=n)))
    both = draw(st.booleans()) if COMPONENTS[code].is_table else False
    values = st.lists(errors, min_size=n, max_size=n).map(np.array)
    variances = st.none() | st.lists(spread, min_size=n, max_size=n).map(lambda v: np.array(v) ** 2)
    return ComponentTable(
        component=COMPONENTS[code],
        positions_mm=np.array(positions if COMPONENTS[code].is_table else [], dtype=float),
        errors=draw(values),
        backward_errors=draw(values) if both else None,
        covariance=draw(variances),
        backward_covariance=draw(variances) if both else None,
    )


@st.composite
def error_maps(draw):
    codes = draw(st.sets(st.sampled_from(TABLES[:21] + SINGLE[:3]), min_size=1, max_size=4))
    return ErrorMap(
        label=draw(labels),
        measured_at=draw(moments),
        temperatures_c=draw(
            st.dictionaries(
                st.from_regex(r"[A-Za-z][A-Za-z0-9._ -]{0,8}[A-Za-z0-9]", fullmatch=True),
                errors.map(lambda t: t / 10.0),
                min_size=1,
                max_size=3,
            )
        ),
        tables={code: draw(tables(code)) for code in codes},
        repeatability_um=draw(st.none() | spread),
        instrument=draw(st.none() | labels),
    )


def same(one, other):
    if one is None or other is None:
        return one is other
    return np.allclose(one, other, rtol=1e-12, atol=0.0)


@given(error_maps())
def test_a_map_comes_back_as_it_was(error_map):
    text = csv_of_map("mill", error_map)
    read = parse_error_map({"": text}, FILE, Header())
    back = read.error_map
    assert read.machine == "mill"
    assert (back.label, back.measured_at) == (error_map.label, error_map.measured_at)
    assert back.temperatures_c == error_map.temperatures_c
    assert back.repeatability_um == error_map.repeatability_um
    assert back.instrument == error_map.instrument
    assert back.tables.keys() == error_map.tables.keys()
    for code, table in error_map.tables.items():
        other = back.tables[code]
        assert same(other.positions_mm, table.positions_mm)
        assert same(other.errors, table.errors)
        assert same(other.backward_errors, table.backward_errors)
        assert same(other.covariance, table.covariance)
        assert same(other.backward_covariance, table.backward_covariance)


@st.composite
def observations(draw):
    state = draw(st.dictionaries(st.sampled_from(["spindle_rpm", "feed"]), errors, max_size=2))
    beside = {
        "time_s": draw(moments).timestamp(),
        "state": state,
        "setup": draw(st.none() | st.sampled_from(["first", "2"])),
    }
    signs = st.sampled_from([-1, 0, 1])
    if draw(st.booleans()):
        code = draw(st.sampled_from(TABLES[:18] + SINGLE[:3]))
        # Of a component one approach is stated, and stands for all axes.
        directions = [draw(signs) if COMPONENTS[code].is_table else 0] * 3
        return Observation(
            component=code,
            position_mm=draw(errors) if COMPONENTS[code].is_table else None,
            measured=(draw(errors),),
            directions=tuple(directions),
            **beside,
        )
    three = st.tuples(errors, errors, errors)
    return Observation(
        point_mm=draw(three),
        measured=draw(three),
        tool_offset_mm=draw(three),
        directions=draw(st.tuples(signs, signs, signs)),
        **beside,
    )


@given(
    st.lists(observations(), min_size=1, max_size=6),
    labels,
    st.sampled_from(list(Datum)),
    st.none() | spread,
    st.none() | labels,
)
def test_a_check_comes_back_as_it_was(observed, label, datum, repeatability_um, name):
    check = Verification(label, observed, datum, repeatability_um, instrument=name, operator=name)
    read = parse_csv_verification({"": csv_of_check("mill", check)}, FILE)
    assert read.machine == "mill"
    back = VerificationRequest.model_validate(read.body).to_verification()
    assert (back.label, back.datum) == (label, datum)
    assert back.instrument == back.operator == name
    assert back.repeatability_um == repeatability_um
    for one, other in zip(observed, back.observations, strict=True):
        assert abs(one.time_s - other.time_s) < 1e-3
        for field in ("component", "position_mm", "measured", "directions", "state", "setup"):
            assert getattr(other, field) == getattr(one, field), field
        assert same(other.point_mm, one.point_mm)
        assert same(other.tool_offset_mm, one.tool_offset_mm)


@pytest.mark.anyio
async def test_what_was_downloaded_is_stored_already(client):
    for number in (1, 2, 3):
        file = await client.get(f"{ROOM}/error-maps/{number}/file")
        assert file.status_code == 200, file.text
        assert file.headers["content-type"].startswith("text/csv")
        again = await client.post(
            f"{ROOM}/files?name=a.csv", content=file.content, headers={"Content-Type": "text/csv"}
        )
        assert again.status_code == 200, again.text
        assert again.json()["id"] == number
    problem(await client.get(f"{ROOM}/error-maps/99/file"), 404)
    problem(await client.get(f"{ROOM}/verifications/99/file"), 404)


@pytest.mark.anyio
@pytest.mark.parametrize("kind", ["map", "check"])
async def test_a_template_is_filled_in_and_read_as_what_it_is(client, kind):
    file = await client.get(f"{ROOM}/files/template", params={"kind": kind})
    assert file.status_code == 200, file.text
    empty = await client.post(
        f"{ROOM}/files?name=a.csv&preview=true",
        content=file.content,
        headers={"Content-Type": "text/csv"},
    )
    problem(empty, 422)
    filled = re.sub(r",$", ",1.5", file.text, flags=re.MULTILINE)
    measured_at = (START - timedelta(hours=1)).isoformat()
    filled = filled.replace("# label:", "# label: warm").replace("\n,", f"\n{measured_at},")
    filled = filled.replace("measured_at:", f"measured_at: {measured_at}")
    filled = re.sub(r"(?<=# temperature )(\S+):", r"\1: 26.5", filled)
    filled = filled.replace("repeatability_um:", "repeatability_um: 0.4")
    read = await client.post(
        f"{ROOM}/files?name=a.csv&preview=true",
        content=filled.encode(),
        headers={"Content-Type": "text/csv"},
    )
    assert read.status_code == 200, read.text


@pytest.mark.anyio
async def test_before_the_first_map_a_template_has_the_errors_of_a_rigid_machine(empty):
    machine = {"id": "mill", "name": "Mill", "configuration": "XYFZ", "sensors": [{"name": "bed"}]}
    await empty.post("/v1/machines", json=machine | {"axes": {"x": {"min_mm": -10, "max_mm": 30}}})
    file = (await empty.get("/v1/machines/mill/files/template")).text
    assert "# temperature bed:\n" in file
    assert "EXX,-10.0,\nEXX,0.0,\nEXX,10.0,\nEXX,20.0,\nEXX,30.0,\n" in file
    assert "SXY,,\n" in file
    assert len({line[:3] for line in file.splitlines() if line[0] in "ES"}) == 21

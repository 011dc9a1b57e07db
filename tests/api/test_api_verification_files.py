"""Verifications from files over HTTP: stored as in JSON, refused with line and column."""

import io
import json

import pytest
from openpyxl import Workbook

from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import UnreadableFile
from tests.api.test_api_verifications import PATH, observation, verification
from tests.service_examples import ROOM, START, iso, problem

pytestmark = pytest.mark.anyio

ROUTE = f"{ROOM}/files"
CSV = {"Content-Type": "text/csv"}
ROWS = [
    ["time", "component", "position_mm", "measured_um"],
    [observation()["time"], "EXX", 250.0, 4.31],
]
NIGHT = "\n".join(",".join(map(str, row)) for row in ROWS) + "\n"


async def store(client, content, name="night shift.csv", headers=CSV):
    return await client.post(
        ROUTE, params={"name": name, "kind": "check"}, content=content, headers=headers
    )


async def refused(client, content, name="run-9.csv"):
    """Upload what cannot be stored, and see that nothing is; give what is said."""
    errors = problem(await store(client, content, name), 422)["errors"]
    assert (await client.get(PATH)).json() == []
    assert {one["field"] for one in errors} == {"file"}
    return [one["message"] for one in errors]


async def test_a_file_is_stored_as_the_same_in_json(client):
    stored = await store(client, NIGHT)
    assert stored.status_code == 201, stored.text
    assert stored.json()["warnings"] == []
    assert stored.headers["location"] == f"{PATH}/{stored.json()['id']}"
    again = await client.post(PATH, json=verification())
    assert again.status_code == 200
    assert again.json() == stored.json()


XLSX = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"


@pytest.mark.parametrize("kind", [XLSX, "application/vnd.ms-excel", "application/octet-stream"])
async def test_a_workbook_is_read_as_csv_is(client, kind):
    book = Workbook()
    for row in ROWS:
        book.active.append(row)
    file = io.BytesIO()
    book.save(file)
    binary = {"Content-Type": kind}
    assert (await store(client, file.getvalue(), "night shift.xlsx", binary)).status_code == 201
    assert (await store(client, NIGHT)).status_code == 200


async def test_what_is_not_read_is_told(client):
    file = NIGHT.replace("measured_um", "measured_um,operator").replace("4.31", "4.31,me")
    (warning,) = (await store(client, file)).json()["warnings"]
    assert "not read" in warning
    assert "operator" in warning


@pytest.mark.parametrize(
    "wrong",
    [
        NIGHT.replace("4.31", "n/a"),
        NIGHT.replace("EXX", "EQQ"),
        NIGHT.replace("4.31", "99999"),
        NIGHT.replace("component,", "part,"),
        NIGHT.splitlines()[0],
        "",
    ],
)
async def test_what_is_wrong_is_said_in_the_command_lines_words(
    client, wrong, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run-9.csv").write_text(wrong, encoding="utf-8")
    with pytest.raises(UnreadableFile) as caught:
        read_csv_verification((tmp_path / "run-9.csv").relative_to(tmp_path))
    assert await refused(client, wrong) == caught.value.detail.splitlines()


async def test_what_the_model_refuses_is_said_with_its_line(client):
    at = observation()["time"]
    (said,) = await refused(client, f"{NIGHT}\n{at},EXX,1e9,1\n")
    assert said.startswith("run-9.csv, line 4, ")
    later = iso(START.replace(year=START.year + 5))
    (said,) = await refused(client, f"{NIGHT}{later},EXX,250,1\n")
    assert said.startswith("run-9.csv, line 3, time: ")


@pytest.mark.parametrize("sign", [1, -1])
async def test_measured_positions_are_no_deviations(client, sign):
    """Of a stage of 8 mm: within the largest error that a machine can have."""
    at = observation()["time"]
    rows = "".join(f"{at},EXX,{mm},{sign * (1000 * mm + 0.3)}\n" for mm in (0, 4, 8))
    (said,) = await refused(client, NIGHT.splitlines()[0] + "\n" + rows)
    assert said.startswith("run-9.csv, line 2, measured_um: expected deviations")
    assert f"a slope of {sign} mm/mm" in said


@pytest.mark.parametrize("name", ["night.csv", "night.json"])
async def test_what_was_read_is_shown_before_it_is_stored(client, name):
    content = NIGHT.replace("time,", "# datum,first\ntime,", 1)
    if name.endswith("json"):
        content = json.dumps(verification(label="night", datum="first"))
    shown = await client.post(
        ROUTE,
        params={"name": name, "expected": "check", "preview": True},
        content=content,
        headers=CSV | {"Accept": "text/html"},
    )
    assert shown.status_code == 200, shown.text
    for said in ("night", "first: each component", "not stated", "EXX", "4.31", "polyline"):
        assert said in shown.text
    assert (await client.get(PATH)).json() == []
    stored = await store(client, content, name)
    assert (stored.status_code, stored.json()["datum"]) == (201, "first")


async def test_json_that_is_none_is_refused_as_a_file(client):
    (said,) = await refused(client, "{", "x.json")
    assert said.startswith("x.json: expected JSON, got none")


async def test_other_machines_files_and_other_kinds_are_refused(client):
    (said,) = await refused(client, "# machine: another\n" + NIGHT)
    assert "'another'" in said
    (said,) = await refused(client, "HEADER::\nFile type: Linear\nTARGETS ::\n", "x.rtl")
    assert said == (
        "x.rtl: expected check measurements with their times, got an error map: "
        "`thermap import x.rtl` makes a map of it"
    )
    problem(await client.post(ROUTE, content=NIGHT), 415)

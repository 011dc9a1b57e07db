"""The page of maps and versions, what it shows before something is stored, and maps from files."""

import json
from pathlib import Path

import pytest

from app.files.instrument_files.renishaw_rtl import read_renishaw_rtl
from tests.api.test_api_dashboard import feed, shown
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.service_examples import ROOM, START, error_map, iso, problem, reading

pytestmark = pytest.mark.anyio

MAPS = "/machines/mcfv5050/maps"
CSV = {"Content-Type": "text/csv"}
AS_PAGE = {"Accept": "text/html"}

SHORT = """# label: short
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 27.0
# temperature y-front: 26.0
# temperature z-column: 29.0
# temperature spindle: 30.0
component,position_mm,error_um
EXX,0,0.0
EXX,100,5.0
"""


async def test_the_active_version_stands_first_and_two_are_compared(client):
    await feed(client, reading(START, 27.0))
    page = await shown(client, MAPS)
    assert "v3 is active" in page.text
    assert "3 maps and no effect" in page.text
    assert "A v2, B v3, at the latest temperatures" in page.text
    assert "outside its maps interpolated" in page.text
    assert "clamped" not in page.text
    assert "Compare v1 as A" in page.text
    assert "A v3, B v2" in (await shown(client, f"{MAPS}?a=3&b=2")).text
    problem(await client.get(f"{MAPS}?a=9"), 404)


async def test_a_file_is_shown_before_it_is_stored_and_then_waits(client):
    await feed(client, reading(START, 27.0))
    before = (await client.get(f"{ROOM}/error-maps")).json()
    asked = {"name": "run-9.csv"}
    look = asked | {"preview": True}
    found = await client.post(f"{ROOM}/files", params=look, content=SHORT, headers=CSV | AS_PAGE)
    assert found.status_code == 200, found.text
    assert "Storing this map would lose EXX" in found.text
    assert "Keep as waiting" in found.text
    route = f"{ROOM}/files"
    preview = await client.post(route, params=asked | {"preview": True}, content=SHORT, headers=CSV)
    assert preview.json()["loses"][0]["component"] == "EXX"
    assert (await client.get(f"{ROOM}/error-maps")).json() == before
    stored = await client.post(route, params=asked, content=SHORT, headers=CSV)
    assert stored.status_code == 201
    assert stored.json()["activated"] is False
    assert "waits" in (await shown(client, MAPS)).text
    again = await client.post(route, params=asked, content=SHORT, headers=CSV)
    assert again.status_code == 200


async def test_a_stored_map_and_check_are_shown_and_can_be_downloaded(client):
    page = await shown(client, f"{MAPS}/1")
    assert "Run #1" in page.text
    assert "In the active version." in page.text
    assert f"{ROOM}/error-maps/1/file" in page.addresses
    problem(await client.get(f"{MAPS}/99"), 404)
    await feed(client, reading(START, 27.0))
    observation = {"time": iso(START), "component": "EXX", "position_mm": 250.0, "measured_um": 4.5}
    check = {"label": "<b>night</b>", "observations": [observation]}
    stored = await client.post(f"{ROOM}/verifications", json=check)
    assert stored.status_code == 201, stored.text
    page = await shown(client, "/machines/mcfv5050/loop/checks/1")
    assert "<b>night</b>" in page.text
    assert f"{ROOM}/verifications/1/file" in page.addresses
    problem(await client.get("/machines/mcfv5050/loop/checks/99"), 404)


async def test_what_is_wrong_in_a_file_is_said_with_line_and_column(client):
    route = f"{ROOM}/files"
    for preview in (False, True):
        answer = await client.post(
            route,
            params={"name": "run-9.csv", "preview": preview},
            content=SHORT.replace("5.0", "n/a"),
            headers=CSV,
        )
        errors = problem(answer, 422)["errors"]
        assert errors == [
            {
                "field": "file",
                "message": "run-9.csv, line 9, column 3 (error_um): expected a number in µm, "
                "got 'n/a'",
            }
        ]
    problem(await client.post(route, content=SHORT), 415)
    other = "# machine: another\n" + SHORT
    assert "another" in problem(await client.post(route, content=other, headers=CSV), 422)["detail"]


async def test_going_back_says_what_it_changes(client):
    await feed(client, reading(START, 27.0))
    answer = await client.get(f"{MAPS}/preview/2")
    assert "Activating v2" in answer.text
    assert "Keep v3" in answer.text
    assert "Go back to v2" in answer.text
    assert (await client.get(f"{ROOM}/models")).json()[2]["active"]


RTL = BOTH_WAYS.replace("Axis: X", "Axis: U-Achse")
"""A measurement of six targets in two runs each way, whose free text names no axis."""

BESIDE = {
    "name": "x.rtl",
    "axis": "x",
    "measured_at": "2026-03-01T05:30:00Z",
    "temperature": ["x-middle=27.0", "y-front=26.0", "z-column=29.0", "spindle=30.0"],
}
BINARY = {"Content-Type": "application/octet-stream"}


async def test_what_an_instruments_file_does_not_say_is_asked_by_name(client):
    for preview in (False, True):

        async def send(preview=preview, **beside):
            query = {"name": "x.rtl", "preview": preview} | beside
            headers = BINARY | AS_PAGE
            return await client.post(f"{ROOM}/files", params=query, content=RTL, headers=headers)

        asked = {one["field"]: one["message"] for one in problem(await send(), 422)["errors"]}
        assert asked == {"axis": "expected Axis: x, y or z, got 'U-Achse'"}
        found = problem(await send(axis="x"), 422)["errors"]
        assert [one["field"] for one in found] == ["measured_at", "temperatures_c"]
        found = problem(await send(axis="a", **{k: BESIDE[k] for k in ("measured_at",)}), 422)
        assert found["errors"][0]["field"] == "axis"
        warm = await send(**BESIDE | {"temperature": ["x-middle=warm", "=3", "y-front=1"]})
        assert [one["field"] for one in problem(warm, 422)["errors"]] == [
            "temperatures_c.x-middle",
            "temperature",
        ]
        unzoned = await send(**BESIDE | {"measured_at": "2026-03-01T05:30:00"})
        assert problem(unzoned, 422)["errors"][0]["field"] == "measured_at"
        other = await send(**BESIDE | {"method": "six-dof"})
        assert problem(other, 422)["errors"][0]["field"] == "method"
        unknown = await send(**BESIDE | {"method": "guess"})
        assert "expected one of" in problem(unknown, 422)["errors"][0]["message"]


async def test_an_instruments_file_is_shown_and_stored_as_its_measurement_is(client):
    """A file makes the map that its readings make when they are sent as a measurement."""
    await feed(client, reading(START, 27.0))
    shown_before = await client.post(
        f"{ROOM}/files",
        params=BESIDE | {"preview": True},
        content=RTL,
        headers=BINARY | AS_PAGE,
    )
    assert shown_before.status_code == 200, shown_before.text
    assert "map by positioning ‘cold’" in shown_before.text
    assert "2026-03-01 05:30:00 UTC" in shown_before.text
    assert "approach" in shown_before.text
    assert "x-middle 27.00 °C" in shown_before.text
    assert "compare the first value, 0 µm at 0 mm" in shown_before.text
    assert "R_um" in shown_before.text
    before = (await client.get(f"{ROOM}/error-maps")).json()
    route = f"{ROOM}/files"
    preview = await client.post(
        route, params=BESIDE | {"preview": True}, content=RTL, headers=BINARY
    )
    assert preview.status_code == 200
    assert (await client.get(f"{ROOM}/error-maps")).json() == before
    stored = await client.post(route, params=BESIDE, content=RTL, headers=BINARY)
    assert stored.status_code == 201, stored.text
    body = read_renishaw_rtl(RTL, Path("x.rtl"), "x").body | {
        "measured_at": BESIDE["measured_at"],
        "temperatures_c": {
            name: float(t) for name, t in (one.split("=") for one in BESIDE["temperature"])
        },
    }
    again = await client.post(f"{ROOM}/measurements/positioning", params={"store": True}, json=body)
    assert again.status_code == 200, again.text
    assert again.json()["map_id"] == stored.json()["map_id"]


SIX_ERRORS = """# label: axis X
position_mm,linear_um,straightness_y_um
0,0.0,0.0
250,1.2,0.4
500,2.9,0.1
"""


async def test_a_table_of_readings_is_read_by_its_method(client):
    route = f"{ROOM}/files"
    query = BESIDE | {"name": "x.csv", "method": "six-dof", "preview": True}
    answer = await client.post(route, params=query, content=SIX_ERRORS, headers=CSV)
    assert answer.status_code == 200, answer.text
    without = {name: value for name, value in query.items() if name != "axis"}
    answer = await client.post(route, params=without, content=SIX_ERRORS, headers=CSV)
    assert problem(answer, 422)["errors"] == [
        {"field": "axis", "message": "expected axis, got none"}
    ]
    wrong = SIX_ERRORS.replace("1.2", "n/a")
    answer = await client.post(route, params=query, content=wrong, headers=CSV)
    assert problem(answer, 422)["errors"][0]["field"] == "file"
    asked = {"name": "run.csv"}
    bare = SHORT.split("\n", 2)[2]
    answer = await client.post(route, params=asked, content=bare, headers=CSV)
    found = problem(answer, 422)["errors"]
    assert [one["field"] for one in found] == ["label", "measured_at"]


async def test_versions_without_a_check_say_so(client):
    answer = await client.get(f"{MAPS}/residuals?a=2&b=3")
    assert answer.status_code == 200
    assert "no check is stored" in answer.text
    problem(await client.get("/machines/nobody/maps/residuals?a=2&b=3"), 404)


async def test_a_check_that_neither_version_can_be_held_against_stands_beside_the_others(client):
    """Nothing was read at its time, as where somebody stored a visit of before the sensors."""
    await feed(client, reading(START, 22.0))
    line = {"component": "EXX", "position_mm": 250.0, "measured_um": 4.0}
    for label, time in (("now", iso(START)), ("long ago", "2020-03-01T06:00:00Z")):
        body = {"label": label, "observations": [line | {"time": time}]}
        answer = await client.post(f"{ROOM}/verifications", json=body)
        assert answer.status_code == 201, answer.text
    answer = await client.get(f"{MAPS}/residuals?a=2&b=3")
    assert answer.status_code == 200
    assert "no length that both can be held against" in answer.text
    assert "RMS of lengths" in answer.text


async def test_a_map_that_is_stored_already_is_not_offered_to_be_stored(client):
    """The same file again makes no version."""
    content = json.dumps(error_map("again", 27.0)).encode()
    query = {"name": "again.json", "preview": True}

    async def looked():
        answer = await client.post(
            f"{ROOM}/files", params=query, content=content, headers=BINARY | AS_PAGE
        )
        assert answer.status_code == 200, answer.text
        return answer.text

    assert "nothing is stored yet" in (first := await looked())
    assert 'data-do="store"' in first
    stored = await client.post(
        f"{ROOM}/files", params={"name": "again.json"}, content=content, headers=BINARY
    )
    assert stored.status_code == 201
    again = await looked()
    assert "it is stored already" in again
    assert "Storing this map again changes nothing." in again
    assert "as the next version" not in again
    assert 'data-do="store' not in again

"""The page of maps and versions, what it shows before something is stored, and maps from files."""

import pytest

from tests.api.test_api_dashboard import feed, shown
from tests.service_examples import ROOM, START, problem, reading

pytestmark = pytest.mark.anyio

MAPS = "/machines/mcfv5050/maps"
CSV = {"Content-Type": "text/csv"}

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
    assert "A v2, B v3, at the temperatures of now" in page.text
    assert "Compare v1 as A" in page.text
    assert "A v3, B v2" in (await shown(client, f"{MAPS}?a=3&b=2")).text
    problem(await client.get(f"{MAPS}?a=9"), 404)


async def test_a_file_is_shown_before_it_is_stored_and_then_waits(client):
    await feed(client, reading(START, 27.0))
    before = (await client.get(f"{ROOM}/error-maps")).json()
    asked = {"name": "run-9.csv"}
    found = await client.post(f"{MAPS}/preview", params=asked, content=SHORT, headers=CSV)
    assert found.status_code == 200, found.text
    assert "Storing this map would lose EXX" in found.text
    assert "Keep as waiting" in found.text
    route = f"{ROOM}/error-maps/from-file"
    preview = await client.post(route, params=asked | {"preview": True}, content=SHORT, headers=CSV)
    assert preview.json()["loses"][0]["component"] == "EXX"
    assert (await client.get(f"{ROOM}/error-maps")).json() == before
    stored = await client.post(route, params=asked, content=SHORT, headers=CSV)
    assert stored.status_code == 201
    assert stored.json()["activated"] is False
    assert "waits" in (await shown(client, MAPS)).text
    again = await client.post(route, params=asked, content=SHORT, headers=CSV)
    assert again.status_code == 200


async def test_what_is_wrong_in_a_file_is_said_with_line_and_column(client):
    route = f"{ROOM}/error-maps/from-file"
    for path in (route, f"{MAPS}/preview"):
        answer = await client.post(
            path,
            params={"name": "run-9.csv"},
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

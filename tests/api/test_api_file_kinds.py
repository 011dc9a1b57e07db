"""Which kind a file is of is seen wherever it is sent: an error map, or a check."""

import io
import json
from datetime import timedelta
from pathlib import Path

import pytest
from openpyxl import Workbook

from app.files.file_kind import FileKind, kind_of_file
from tests.api.test_api_dashboard import feed
from tests.api.test_api_verification_files import NIGHT
from tests.files.test_renishaw_rtl import BOTH_WAYS
from tests.service_examples import ROOM, START, problem, reading

pytestmark = pytest.mark.anyio

BINARY = {"Content-Type": "application/octet-stream"}
HEAD = """# label: cold
# measured_at: 2026-03-01T06:00:00Z
# temperature x-middle: 27.0
# temperature y-front: 26.0
# temperature z-column: 29.0
# temperature spindle: 30.0
"""
LONG_MAP = HEAD + "component,position_mm,error_um\nEXX,0,0\nEXX,500,8.2\n"
WIDE = "Position [mm];EXX [µm];EYX [µm]\n0;0;0\n500;8,2;1,1\n"
WIDE_CHECK = "time;Position [mm];EXX [µm]\n2026-03-01T06:00:00Z;0;0\n2026-03-01T06:00:10Z;500;8,2\n"
MAP_JSON = {
    "label": "cold",
    "measured_at": "2026-03-01T06:00:00Z",
    "temperatures_c": {"x-middle": 27.0, "y-front": 26.0, "z-column": 29.0, "spindle": 30.0},
    "components": [{"component": "EXX", "positions_mm": [0, 500], "errors_um": [0, 8.2]}],
}
CHECK_JSON = {
    "label": "night",
    "observations": [
        {
            "time": "2026-03-01T06:00:00Z",
            "component": "EXX",
            "position_mm": 250.0,
            "measured_um": 4.3,
        }
    ],
}


def workbook(text):
    book = Workbook()
    for line in text.splitlines():
        book.active.append(
            [
                float(c) if c[:1].isdigit() and "T" not in c else c
                for c in line.replace(",", ".").split(";")
            ]
        )
    file = io.BytesIO()
    book.save(file)
    return file.getvalue()


MAPS = {
    "long.csv": LONG_MAP,
    "wide.csv": HEAD + WIDE,
    "wide.xlsx": workbook(HEAD.replace(": ", ";") + WIDE),
    "map.json": json.dumps(MAP_JSON),
    "map.txt": json.dumps(MAP_JSON),
    "maps.json": json.dumps([MAP_JSON]),
}
CHECKS = {
    "long.csv": NIGHT,
    "points.csv": "time,point_x_mm,point_y_mm,point_z_mm,"
    "measured_x_um,measured_y_um,measured_z_um\n2026-03-01T06:00:00Z,250,250,-200,1,2,3\n",
    "wide.csv": WIDE_CHECK,
    "wide.xlsx": workbook(WIDE_CHECK),
    "check.json": json.dumps(CHECK_JSON),
    "check.txt": json.dumps(CHECK_JSON),
}
BOTH = {FileKind.MAP: MAPS, FileKind.CHECK: CHECKS}
FILES = [(kind, name) for kind, files in BOTH.items() for name in files]
OTHER = {FileKind.MAP: FileKind.CHECK, FileKind.CHECK: FileKind.MAP}
ROUTE = f"{ROOM}/files"


def content_of(kind, name):
    content = BOTH[kind][name]
    return content if isinstance(content, bytes) else content.encode()


async def preview(client, content, name, expected):
    asked = {"name": name, "expected": expected, "preview": True}
    as_page = BINARY | {"Accept": "text/html"}
    return await client.post(ROUTE, params=asked, content=content, headers=as_page)


@pytest.mark.parametrize("expected", FileKind)
@pytest.mark.parametrize(("kind", "name"), FILES)
async def test_a_file_is_shown_as_what_it_is_wherever_it_is_dropped(client, kind, name, expected):
    await feed(client, reading(START, 27.0))
    content = content_of(kind, name).replace(b",-200,", b",200,")  # within this machine's travel
    answer = await preview(client, content, name, expected)
    assert answer.status_code == 200, answer.text
    words = {FileKind.MAP: "an error map", FileKind.CHECK: "a check"}[kind]
    shown = {FileKind.MAP: "upload", FileKind.CHECK: "check"}[kind]
    assert f'data-what="{shown}"' in answer.text
    # The page shows this where it expects the other kind.
    assert f'data-unless="{kind}" hidden><div><h3>{name} is {words}.' in answer.text
    assert "EXX" in answer.text or "points" in answer.text
    assert "<polyline" in answer.text
    # With a time for all values a map may be read as a check, and no check as a map.
    assert ('data-as="check"' in answer.text) == (kind is FileKind.MAP)
    assert 'data-as="map"' not in answer.text


async def test_what_says_nothing_of_its_kind_is_read_as_what_is_expected(client):
    await feed(client, reading(START, 27.0))
    either = "# measured_at: 2026-03-01T06:00:00Z\n" + WIDE
    shown = await preview(client, either, "either.csv", FileKind.CHECK)
    assert 'data-what="check"' in shown.text
    errors = problem(await preview(client, either, "either.csv", FileKind.MAP), 422)["errors"]
    assert {one["field"] for one in errors} == {"label", "temperatures_c"}


@pytest.mark.parametrize(("kind", "name"), FILES)
async def test_the_api_says_of_which_other_kind_a_file_is(client, kind, name):
    expected = OTHER[kind]
    content = content_of(kind, name)
    if kind is FileKind.MAP and name.startswith("wide"):
        content = content.replace(b"measured_at", b"noted")
        if name.endswith("xlsx"):
            pytest.skip("its text is packed")
    query = {"name": name, "kind": expected}
    answer = await client.post(ROUTE, params=query, content=content, headers=BINARY)
    (said,) = problem(answer, 422)["errors"]
    assert said["field"] == "file"
    assert said["message"].startswith(
        f"{name}: expected {expected.words}, got {kind.words}: `thermap"
    )
    assert (await client.get(f"{ROOM}/verifications")).json() == []


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (NIGHT.replace("4.31", "n/a"), FileKind.CHECK),
        (NIGHT.replace("measured_um", "measured"), FileKind.CHECK),
        (LONG_MAP.replace("8.2", "n/a"), FileKind.MAP),
        (LONG_MAP.replace("error_um", "error_furlong"), FileKind.MAP),
        (WIDE, FileKind.MAP),
        (WIDE_CHECK.replace("8,2", "n/a"), FileKind.CHECK),
        (BOTH_WAYS, FileKind.MAP),
        ("# measured_at: 2026-03-01T06:00:00Z\n" + WIDE, None),
        ("time,x-middle\n2026-03-01T06:00:00Z,20.1\n", None),
        ("a,b\n1,2\n", None),
        ("", None),
        ("{", None),
        ('{"observations": 3}', FileKind.CHECK),
        ('{"id": "vmc"}', None),
    ],
)
def test_the_kind_is_seen_although_the_file_is_wrong(content, kind):
    assert kind_of_file(content.encode(), Path("x.csv")) is kind


async def test_what_is_wrong_in_a_file_of_the_other_kind_is_said(client):
    wrong = NIGHT.replace("4.31", "n/a")
    errors = problem(await preview(client, wrong, "night.csv", "map"), 422)["errors"]
    assert [one["message"] for one in errors] == [
        "night.csv, line 2, column 4 (measured_um): expected a number in µm, got 'n/a'",
    ]


async def test_a_map_that_the_service_answered_is_read_again(client):
    stored = (await client.get(f"{ROOM}/error-maps/1")).json()

    async def send(content, **stated):
        return await send_file(client, json.dumps(content), "map.json", kind="map", **stated)

    again = await send(stored)
    assert (again.status_code, again.json()["id"]) == (200, 1)
    renamed = await send(stored, label="again")
    assert "'again'" in problem(renamed, 409)["detail"]
    twice = problem(await send([MAP_JSON, MAP_JSON | {"label": "b"}]), 422)["detail"]
    assert "expected one error map, got 2 entries" in twice
    machine = (await client.get(ROOM)).json()
    assert "expected an error map, got a machine" in problem(await send(machine), 422)["detail"]


async def send_file(client, content, name, **stated):
    query = {"name": name} | stated
    return await client.post(ROUTE, params=query, content=content, headers=BINARY)


@pytest.mark.parametrize(("kind", "name"), FILES)
async def test_a_file_is_stored_as_what_it_is(client, kind, name):
    content = content_of(kind, name).replace(b",-200,", b",200,")  # within this machine's travel
    before = [(await client.get(f"{ROOM}/{what}")).json() for what in ("error-maps", "models")]
    look = await send_file(client, content, name, preview=True)
    assert (look.status_code, look.json()["preview"]) == (200, True), look.text
    after = [(await client.get(f"{ROOM}/{what}")).json() for what in ("error-maps", "models")]
    assert after == before
    stored = await send_file(client, content, name)
    assert stored.status_code == 201, stored.text
    shown = (await client.get(stored.headers["location"])).json()
    where = {FileKind.MAP: "error-maps", FileKind.CHECK: "verifications"}[kind]
    assert f"/{where}/" in stored.headers["location"]
    assert shown["label"] == stored.json()["label"]
    if kind is FileKind.CHECK:
        of_preview = {"label", "datum", "count", "components", "first_at", "last_at"}
        assert {n: look.json()[n] for n in of_preview} == {n: shown[n] for n in of_preview}
    again = await send_file(client, content, name)
    assert (again.status_code, again.json()["id"]) == (200, stored.json()["id"])


async def test_what_may_be_either_is_stored_as_what_is_stated(client):
    either = "# measured_at: 2026-03-01T06:00:00Z\n" + WIDE
    refused = problem(await send_file(client, either, "either.csv"), 422)
    assert "temperature" in refused["detail"]
    stored = await send_file(client, either, "either.csv", kind="check")
    assert stored.json()["components"] == ["EXX", "EYX"]


@pytest.mark.parametrize("preview", [False, True])
async def test_what_is_wrong_with_a_file_is_said_with_its_line(client, preview):
    outside = NIGHT.replace("250.0", "900.0")
    (said,) = problem(await send_file(client, outside, "x.csv", preview=preview), 422)["errors"]
    assert said["field"] == "file"
    assert said["message"].startswith("x.csv, line 2")
    stated = {"label": "mine", "temperature": "x-middle=20", "preview": preview}
    errors = problem(await send_file(client, NIGHT, "x.csv", **stated), 422)["errors"]
    assert [one["field"] for one in errors] == ["label", "temperature"]
    assert "x.csv holds check measurements" in errors[0]["message"]
    assert (await client.get(f"{ROOM}/verifications")).json() == []


async def test_a_parameter_that_is_wrong_is_refused_once_and_an_unknown_one_with_each_known(client):
    path = f"{ROOM}/files?name=run.csv"
    answer = await client.post(f"{path}&kind=verification", content=b"a", headers=BINARY)
    assert problem(answer, 422)["detail"] == "kind: expected 'map' or 'check', got 'verification'"
    answer = await client.post(f"{path}&expect=check", content=b"a", headers=BINARY)
    known = problem(answer, 422)["detail"].split(" parameters ")[1].split(" and ")[0].split(", ")
    assert len(set(known)) == len(known)


@pytest.mark.parametrize(("minutes", "is_said"), [(None, True), (0, False), (-1, False), (9, True)])
async def test_the_preview_of_a_check_says_that_no_reading_is_of_its_time(client, minutes, is_said):
    if minutes is not None:
        await feed(client, reading(START + timedelta(minutes=minutes), 25.0))
    content = json.dumps(CHECK_JSON).encode()
    looked = await send_file(client, content, "check.json", preview=True)
    said = [one for one in looked.json()["warnings"] if one.startswith("no reading is stored of")]
    assert bool(said) == is_said

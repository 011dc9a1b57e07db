"""Controllers' files over HTTP.

At 25.5 °C of x-middle and 29 °C of z-column the example machine (see `error_map`) has EXX 0, 5.5,
27.5 µm at 0, 100, 500 mm, EZZ 0, 7, 70 µm at 0, 50, 500 mm, EBX 0 to 55 µrad and SXY −25.5 µm/m.
"""

import io
import json
import math
import zipfile

import pytest

from tests.service_examples import ROOM, START, contents, iso, problem, reading

pytestmark = pytest.mark.anyio

AT = {"x-middle": 25.5, "y-front": 25.0, "z-column": 29.0}
EXPORT = f"{ROOM}/compensation/export"
COMPARE = f"{ROOM}/compensation/compare"


async def export(client, controller, **body):
    answer = await client.post(
        EXPORT, params={"controller": controller}, json={"temperatures_c": AT} | body
    )
    assert answer.status_code == 200, answer.text
    return answer.json()


def named(answer):
    return {file["name"]: file["content"] for file in answer["files"]}


async def test_every_format_says_how_surely_it_is_known(client):
    answer = await client.get("/v1/controllers")
    assert answer.status_code == 200
    found = {one["name"]: one for one in answer.json()["controllers"]}
    assert found["linuxcnc"]["status"] == "verified on the running controller"
    assert found["linuxcnc"]["sign"] == "compensation"
    assert found["linuxcnc"]["holds"] == ["EXX", "EYY", "EZZ"]
    for one in found.values():
        required = {option["name"] for option in one["options"] if option["required"]}
        assert ("sign" in required) == (one["sign"] is None)


async def test_the_files_of_linuxcnc(client, app):
    before = contents(app)
    found = await export(client, "linuxcnc")
    assert named(found)["x.comp"] == "0 0 0\n100 -0.0055 -0.0055\n500 -0.0275 -0.0275\n"
    assert named(found)["z.comp"] == "0 0 0\n50 -0.007 -0.007\n500 -0.07 -0.07\n"
    assert "[JOINT_2]\nCOMP_FILE = z.comp\nCOMP_FILE_TYPE = 1\n" in named(found)["thermap.ini"]
    assert (found["machine"], found["model_version"], found["computed_at"]) == (
        "mcfv5050",
        3,
        iso(START),
    )
    assert found["temperatures_c"] == {"x-middle": 25.5, "z-column": 29.0}
    assert (found["sign"], found["complete"], found["bands"]) == ("compensation", True, None)
    # EBX of 55 µrad at x = z = 500 mm: 27.5 µm in x and in z. SXY of 25.5 µm/m at y = 500 mm.
    sizes = {one["component"]: one["largest"] for one in found["not_held"]}
    assert sizes == {"EBX": pytest.approx(27.5 * math.sqrt(2.0), abs=1e-4), "SXY": 12.75}
    assert [(one["component"], one["largest_deviation"]) for one in found["resampling"]] == [
        ("EXX", 0.0),
        ("EZZ", 0.0),
    ]
    assert found["check"][0] == {
        "component": "EXX",
        "axis": "x",
        "position_mm": 500.0,
        "direction": "+",
        "moved_axis": "x",
        "expected_movement_um": -27.5,
    }
    assert contents(app) == before


async def test_squareness_goes_into_siemens_straightness_with_the_stated_sign(client):
    errors = await export(client, "siemens-cec", options={"sign": "error"})
    compensation = await export(client, "siemens-cec", options={"sign": "compensation"})
    (written, opposite) = (named(one)["N_NC_CEC_INI.INI"] for one in (errors, compensation))
    # EXY = -25.5 µm/m · y over the travel of 0 to 500 mm; positions end at the travel.
    assert "$AN_CEC[1,1]=-0.0128\n" in written or "$AN_CEC[1,1]=-0.0127\n" in written
    assert "$AN_CEC[1,1]=+0.0128\n" in opposite or "$AN_CEC[1,1]=+0.0127\n" in opposite
    assert "model version 3" in written
    assert {one["component"] for one in errors["not_held"]} == {"EBX"}
    assert any("sign is not verified" in warning for warning in errors["warnings"])


async def test_the_latest_reading_serves_where_no_temperature_is_stated(client):
    answer = await client.post(EXPORT, params={"controller": "linuxcnc"}, json={})
    problem(answer, 409)
    await client.post(f"{ROOM}/readings", json=[reading(START, 24.0)])
    answer = await client.post(EXPORT, params={"controller": "linuxcnc"}, json={})
    assert "500 -0.02 -0.02\n" in named(answer.json())["x.comp"]


async def test_a_zip_has_the_files_and_what_is_said_of_them(client):
    answer = await client.post(
        EXPORT,
        params={"controller": "linuxcnc"},
        json={"temperatures_c": AT},
        headers={"Accept": "application/zip"},
    )
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/zip")
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert archive.testzip() is None
        packed = {name: archive.read(name).decode() for name in archive.namelist()}
    told = json.loads(packed.pop("thermap-answer.json"))
    exported = await export(client, "linuxcnc")
    assert packed == named(exported)
    assert told["not_held"] == exported["not_held"]
    assert told["warnings"] == exported["warnings"]


async def test_bands_over_a_range_of_temperatures(client):
    cold, hot = {"x-middle": 20.0, "z-column": 22.0}, {"x-middle": 30.0, "z-column": 32.0}
    bands = {"from_c": cold, "to_c": hot, "largest_step_um": 25}
    found = await export(
        client, "siemens-cec", options={"sign": "error", "components": ["EXX", "EZZ"]}, bands=bands
    )
    # EZZ at 500 mm goes from 0 to 100 µm: four tables, 25 µm apart.
    assert [one["folder"] for one in found["bands"]] == [f"band-0{i}" for i in range(1, 5)]
    at = [one["at_c"]["x-middle"] for one in found["bands"]]
    assert at == pytest.approx([21.25, 23.75, 26.25, 28.75], abs=1e-6)
    assert found["bands"][0]["from_c"] == cold | {"y-front": 25.0}
    files = named(found)
    written = [files[f"band-0{i}/N_NC_CEC_INI.INI"] for i in range(1, 5)]
    for number, content in enumerate(written):  # the PLC switches them: each has its own tables
        assert f"$AN_CEC_STEP[{2 * number}]=" in content
        assert f"$AN_CEC_STEP[{2 * number + 1}]=" in content
    assert found["check"] == []
    assert [c["expected_movement_um"] for c in found["bands"][0]["check"]] == pytest.approx(
        [-6.25, -12.5], abs=0.06
    )


async def test_heidenhains_bands_have_one_cma_that_switches_them(client):
    cold, hot = {"x-middle": 20.0, "z-column": 22.0}, {"x-middle": 30.0, "z-column": 32.0}
    bands = {"from_c": cold, "to_c": hot, "largest_step_um": 50}
    options = {"sign": "error", "components": ["EXX", "EZZ"]}
    found = await export(client, "heidenhain", options=options, bands=bands)
    files = named(found)
    assert files["thermap.CMA"] == (
        "BEGIN thermap.CMA ACT: 0\nNR 1 2 3\n"
        "0 thermap1_X - thermap1_Z\n1 thermap2_X - thermap2_Z\n[END]\n"
    )
    assert any("2 lines from 0, and ACT: 0 makes the first" in line for line in found["warnings"])
    # With the tables beside it, the active line is what the control holds.
    tables = [{"name": n, "content": c} for n, c in files.items() if n.endswith(".COM")]
    assert len(tables) == 4
    for act in (0, 1):
        cma = files["thermap.CMA"].replace("ACT: 0", f"ACT: {act}")
        told = {"files": [*tables, {"name": "t.CMA", "content": cma}], "options": options}
        held = (await client.post("/v1/controllers/heidenhain/parse", json=told)).json()
        exx = next(one for one in held["components"] if one["component"] == "EXX")
        # EXX at 500 mm is 5 µm for each kelvin above 20 °C; the bands' middles are 22.5 and 27.5.
        assert exx["compensation"][-1] == pytest.approx([-12.5, -37.5][act], abs=0.02)
        left = "band-02/thermap2_X.COM" if act == 0 else "band-01/thermap1_X.COM"
        assert any(left in line for line in held["warnings"])


async def test_files_are_read_and_compared(client):
    exported = await export(client, "linuxcnc")
    files = [{"name": f["name"], "content": f["content"]} for f in exported["files"]]
    answer = await client.post("/v1/controllers/linuxcnc/parse", json={"files": files})
    assert answer.status_code == 200, answer.text
    parsed = answer.json()
    assert (parsed["machine"], parsed["warnings"]) == ("mcfv5050", [])
    exx = parsed["components"][0]
    assert exx["positions_mm"] == [0.0, 100.0, 500.0]
    assert exx["compensation"] == [0.0, -5.5, -27.5]
    assert exx["unit"] == "µm"
    # The same files at 30 °C: EXX should be 50 µm at 500 mm.
    later = {"temperatures_c": {"x-middle": 30.0, "z-column": 29.0}, "files": files}
    answer = await client.post(COMPARE, params={"controller": "linuxcnc"}, json=later)
    assert answer.status_code == 200, answer.text
    found = {one["component"]: one for one in answer.json()["components"]}
    assert (found["EXX"]["largest"], found["EXX"]["position_mm"]) == (-22.5, 500.0)
    # From 0 to −4.5 at 100 mm and −22.5 at 500 mm: one line, its RMS a root of three less.
    assert found["EXX"]["rms"] == pytest.approx(22.5 / math.sqrt(3.0), abs=1e-3)
    assert found["EZZ"]["largest"] == 0.0
    # And one of them forgotten.
    del later["files"][1]
    answer = await client.post(COMPARE, params={"controller": "linuxcnc"}, json=later)
    states = {one["component"]: one["state"] for one in answer.json()["components"]}
    assert states == {"EXX": "both", "EZZ": "missing"}


@pytest.mark.parametrize(
    ("controller", "body", "status", "words"),
    [
        ("haas", {}, 404, "expected a controller of linuxcnc"),
        ("siemens-cec", {}, 422, "options.sign: expected a value, got none"),
        ("linuxcnc", {"options": {"sign": "error"}}, 422, "expected the options of linuxcnc"),
        ("linuxcnc", {"options": {"components": ["EYY"]}}, 422, "there is no map of it"),
        ("linuxcnc", {"options": {"joints": {"w": 3}}}, 422, "options.joints.w"),
        ("linuxcnc", {"temperatures_c": {"x-middle": 25.0}}, 422, "z-column"),
        (
            "linuxcnc",
            {"bands": {"from_c": {"x-middle": 20}, "to_c": {"spindle": 30}, "largest_step_um": 5}},
            422,
            "expected the sensors",
        ),
        (
            "fanuc",
            {"options": {"sign": "error", "magnification": 1, "largest_increment": 2}},
            422,
            "increments of at most 2 units of 1 µm",
        ),
    ],
)
async def test_what_cannot_be_written_is_refused(client, controller, body, status, words):
    stated = {"temperatures_c": AT} | body
    answer = await client.post(EXPORT, params={"controller": controller}, json=stated)
    assert words in problem(answer, status)["detail"]


async def test_files_that_would_be_read_wrongly_are_refused(client):
    async def refused(files, **body):
        answer = await client.post(
            COMPARE,
            params={"controller": "linuxcnc"},
            json={"temperatures_c": AT, "files": files} | body,
        )
        return problem(answer, 422)["detail"]

    head = [{"name": "x.comp", "content": "# head\n0 0 0\n"}]
    assert "line 1: expected three numbers" in await refused(head)
    far = [{"name": "x.comp", "content": "2000 0 0\n3000 0 0\n"}]
    assert "within the axis' 0 to 500 mm, got 2000 to 3000 mm" in await refused(far)
    ours = [
        {"name": "x.comp", "content": "0 0 0\n500 0 0\n"},
        {"name": "m.ini", "content": "# thermap: machine lathe (Lathe), model version 1\n"},
    ]
    assert "expected files of machine 'mcfv5050', got those of 'lathe'" in await refused(ours)
    assert "each name once" in await refused([*head, *head])


# -- what a controller cannot hold -------------------------------------------------------------

LARGE = {
    "id": "large",
    "name": "in both directions, nonrigid, with a rotary axis",
    "configuration": "XYFZ",
    "axes": {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"},
    "sensors": [{"name": "s"}],
}


def large_map(share):
    at = {"positions_mm": [0, 250, 500]}
    rows = [
        {"component": "EXX", "errors_um": [0, 5, 9], "backward_errors_um": [-4, 1, 5]} | at,
        {"component": "EBX", "errors_urad": [0, 20, 30], "backward_errors_urad": [-10, 10, 20]}
        | at,
        {"component": "EZX^y", "slopes_um_per_m": [0, 2, 8]} | at,
        {"component": "XOC", "value_um": 7},
        {"component": "BOC", "value_urad": -40},
    ]
    for row in rows:
        for name, values in row.items():
            if isinstance(values, list) and name != "positions_mm":
                row[name] = [share * value for value in values]
            elif name.startswith("value"):
                row[name] = share * values
    return {
        "label": f"share {share}",
        "measured_at": iso(START),
        "temperatures_c": {"s": 20.0 + 10.0 * share},
        "components": rows,
    }


async def test_what_is_not_held_is_as_large_as_what_it_displaces(client):
    """At 28 °C, of corners 500 mm away in two directions: 500·√2 mm times the angle.

    EBX is 24 µrad at most forward; half of its reversal is 4 µrad. What a rotary axis' tilt
    displaces depends on where the workpiece is: it stays an angle.
    """
    assert (await client.post("/v1/machines", json=LARGE)).status_code == 201
    for share in (0.0, 1.0):
        stored = await client.post("/v1/machines/large/error-maps", json=large_map(share))
        assert stored.status_code == 201, stored.text

    async def not_held(controller, **options):
        answer = await client.post(
            "/v1/machines/large/compensation/export",
            params={"controller": controller},
            json={"temperatures_c": {"s": 28.0}, "options": options},
        )
        assert answer.status_code == 200, answer.text
        whole = named(answer.json())["thermap-check.txt"]
        found = {}
        for one in answer.json()["not_held"]:
            what = next(w for w in ("no table", "both directions", "reference") if w in one["why"])
            found[one["component"], what] = (one["largest"], one["unit"])
            unit = one["unit"].replace("µ", "u")
            assert f"{one['component']}  {one['largest']:.2f} {unit}  " in whole
        return found

    halves = {
        ("EXX", "both directions"): (1.6, "µm"),
        ("EBX", "both directions"): (pytest.approx(4e-3 * 500 * math.sqrt(2), abs=1e-4), "µm"),
    }
    slope = {("EZX^y", "no table"): (3.2, "µm")}
    assert await not_held("isg-csv") == halves | slope
    assert await not_held("etalon") == halves | slope
    assert await not_held("fanuc", sign="error") == slope | {
        ("EXX", "both directions"): (1.6, "µm"),
        ("EXX", "reference"): (1.6, "µm"),
        ("EBX", "no table"): (pytest.approx(24e-3 * 500 * math.sqrt(2), abs=1e-4), "µm"),
        ("XOC", "no table"): (5.6, "µm"),
        ("BOC", "no table"): (32.0, "µrad"),
    }
    assert await not_held("csv") == {}

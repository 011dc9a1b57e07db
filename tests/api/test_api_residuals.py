"""Residuals over HTTP, against errors of the example machine that are computed by hand."""

import csv
import io
from datetime import timedelta

import pytest

from app.effects import observations
from tests.service_examples import ROOM, START, error_map, iso, problem, reading

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/verifications"

BEGIN = START - timedelta(minutes=60)


def temperature(minutes):
    """x-middle so many minutes after the first reading [°C]: 0.6 °C in an hour."""
    return 21.0 + minutes / 100.0


def exx(minutes, x_mm, residual, **more):
    """EXX is (t − 20)·x/100 µm; measured is that and a residual."""
    return {
        "time": iso(BEGIN + timedelta(minutes=minutes)),
        "component": "EXX",
        "position_mm": x_mm,
        "measured_um": (temperature(minutes) - 20.0) * x_mm / 100.0 + residual,
        **more,
    }


RESIDUALS = [3.0, -4.0, 1.0, 2.0, -2.0, 0.0, 1.0, -1.0]


@pytest.fixture
async def room(client):
    """A client of the example machine with an hour of readings."""
    body = [reading(BEGIN + timedelta(minutes=m), temperature(m)) for m in range(61)]
    assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    return client


async def stored(client, observations, label="v", **fields):
    body = {"label": label, "observations": observations, **fields}
    answer = await client.post(PATH, json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


async def test_residuals_are_measured_minus_predicted(room):
    observations = [exx(5 * i, 40.0 * i + 100, r) for i, r in enumerate(RESIDUALS)]
    observations.append({"time": iso(BEGIN), "component": "SXY", "measured_um": -21.0 + 5.0})
    number = await stored(room, observations, repeatability_um=1.5)
    found = (await room.get(f"{PATH}/{number}/residuals", params={"rows": 3})).json()
    assert (found["model_version"], found["verifications"]) == (3, [number])
    length, square = found["components"]
    assert (length["component"], length["unit"], length["count"]) == ("EXX", "µm", 8)
    assert length["mean"] == pytest.approx(0.0, abs=1e-9)
    assert length["rms"] == pytest.approx((36 / 8) ** 0.5)
    assert (length["repeatability"], length["repeatability_origin"]) == (1.5, "declared")
    assert length["share_above_repeatability"] == 0.5
    assert (square["unit"], square["rms"]) == ("µm/m", pytest.approx(5.0))
    # A squareness is no length: it is in no sum with lengths.
    assert found["overall"] == length | {"component": "all"}
    over = {s["over"]: s["bins"] for s in found["summaries"]}
    assert [b["label"] for b in over["component"]] == ["EXX", "SXY"]
    assert sum(b["count"] for b in over["position x [mm]"]) == 8
    assert "temperature x-middle [°C]" in over
    assert "time [s]" in over
    assert found["excluded"] == []
    assert [r["residual"] for r in found["rows"]] == pytest.approx(RESIDUALS[:3])
    assert found["rows"][0]["time"] == iso(BEGIN)
    assert found["rows"][0]["y_mm"] is None


async def test_what_cannot_be_compared_is_counted_with_its_reason(room):
    good = [exx(i, 100.0, r) for i, r in enumerate(RESIDUALS)]
    early = [exx(-500 - i, 100.0, 0.0) for i in range(3)]
    other = {"time": iso(BEGIN), "component": "EYY", "position_mm": 1.0, "measured_um": 1.0}
    number = await stored(room, [*good, *early, other])
    found = (await room.get(f"{PATH}/{number}/residuals")).json()
    counts = {e["reason"]: e["count"] for e in found["excluded"]}
    assert counts["before the first reading"] == 3
    assert counts["the model does not have the component"] == 1
    alone = await stored(room, early, label="early")
    refused = problem(await room.get(f"{PATH}/{alone}/residuals"), 422)
    assert "before the first reading: 3" in refused["detail"]


async def test_nothing_is_before_the_first_reading_where_older_ones_exist(room):
    good = [exx(i, 100.0, r) for i, r in enumerate(RESIDUALS)]
    early = [exx(-500 - i, 100.0, 0.0) for i in range(3)]
    long_ago = {"time": iso(BEGIN - timedelta(days=40)), "temperatures_c": {"x-middle": 20.0}}
    assert (await room.post(f"{ROOM}/readings", json=long_ago)).status_code == 201
    number = await stored(room, [*good, *early])
    found = (await room.get(f"{PATH}/{number}/residuals")).json()
    assert found["excluded"] == [{"reason": "no reading near enough in time", "count": 3}]


async def test_several_verifications_together_and_all_rows_as_csv(room):
    one = await stored(room, [exx(i, 100.0, 1.0, direction="-") for i in range(4)], "one")
    point = {
        "time": iso(BEGIN),
        "point_mm": [500.0, 0.0, 0.0],
        "tool_offset_mm": [0.0, 0.0, 0.0],
        # 10 µrad of EBX lower a point 500 mm away by 5 µm.
        "measured_um": [5.0 + 1.0, -2.0, -5.0 + 3.0],
    }
    two = await stored(room, [point], "two")
    asked = {"verifications": [two, one]}
    found = (await room.post(f"{ROOM}/residuals", json=asked)).json()
    assert found["rows"] == []
    # What was measured is not refused; it is said what the residuals at points contain whole.
    assert {"EYX", "EYY", "SYZ"} <= set(found["counted_as_zero"])
    assert "EXX" not in found["counted_as_zero"]
    alone = (await room.post(f"{ROOM}/residuals", json={"verifications": [one]})).json()
    assert alone["counted_as_zero"] == []
    assert {c["component"]: c["count"] for c in found["components"]} == {
        "EXX": 4,
        "points x": 1,
        "points y": 1,
        "points z": 1,
    }
    answer = await room.post(f"{ROOM}/residuals", json=asked, headers={"Accept": "text/csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert [int(r["verification"]) for r in rows] == [two] * 3 + [one] * 4
    assert [float(r["residual"]) for r in rows] == pytest.approx([1, -2, 3, 1, 1, 1, 1], abs=1e-9)
    # A component has one direction of approach, that of its own axis.
    assert [r["direction"] for r in rows] == ["000"] * 3 + ["-"] * 4


BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"


async def test_a_browser_gets_a_page_and_everybody_else_json(room):
    observations = [exx(5 * i, 40.0 * i + 100, r) for i, r in enumerate(RESIDUALS)]
    number = await stored(room, observations, "<night>", repeatability_um=1.5)
    path, asked = f"{PATH}/{number}/residuals", {"verifications": [number]}
    for page in (
        await room.get(path, headers={"Accept": BROWSER}),
        await room.post(f"{ROOM}/residuals", json=asked, headers={"Accept": "text/html"}),
    ):
        assert (page.status_code, page.headers["vary"]) == (200, "Accept")
        assert page.headers["cache-control"] == "no-cache"
        assert page.headers["content-type"].startswith("text/html")
        assert "&lt;night&gt;" in page.text
        assert "temperature x-middle" in page.text
        assert "2.12 µm (root mean square)" in page.text
    for accept in ("*/*", "application/json", "application/pdf"):
        answer = await room.get(path, headers={"Accept": accept})
        assert answer.headers["content-type"] == "application/json"
        assert answer.headers["vary"] == "Accept"
    missing = await room.get(f"{PATH}/99/residuals", headers={"Accept": BROWSER})
    assert missing.status_code == 404


async def test_versions_side_by_side_on_what_both_can_judge(room):
    """In version 4 a map at 22 °C says half as much again of EXX as the maps beside it."""
    steeper = error_map("Run #2", 22.0)
    steeper["components"][0]["errors_um"] = [0.0, 3.0, 15.0]
    assert (await room.post(f"{ROOM}/error-maps", json=steeper)).status_code == 201
    number = await stored(room, [exx(i, 100.0, r) for i, r in enumerate(RESIDUALS)])
    asked = {"verifications": [number], "versions": [3, 4]}
    found = (await room.post(f"{ROOM}/models/compare", json=asked)).json()
    before, after = found["versions"]
    assert (found["values"], before["version"], after["version"]) == (8, 3, 4)
    assert (before["active"], after["active"]) == (False, True)
    assert before["overall"]["mean"] == pytest.approx(0.0, abs=1e-9)
    assert after["overall"]["mean"] == pytest.approx(-0.5 * 1.035)
    old = (await room.get(f"{PATH}/{number}/residuals", params={"model_version": 3})).json()
    assert old["overall"] == before["overall"]
    page = (await room.get("/machines/mcfv5050/maps/residuals?a=3&b=4")).text
    a, b = (f"{one['overall']['rms']:.2f}" for one in (before, after))
    assert f"leaves less of 8 lengths: v3 {a}, v4 {b} µm RMS." in page
    assert "Figures count from the model" in page


async def test_without_numbers_all_stored_verifications_are_meant(room):
    numbers = [await stored(room, [exx(i, 100.0, r)], f"v{i}") for i, r in enumerate(RESIDUALS)]
    for path, stated in (("residuals", {}), ("models/compare", {"versions": [2, 3]})):
        named = await room.post(f"{ROOM}/{path}", json=stated | {"verifications": numbers})
        assert named.json()["verifications"] == numbers
        for asked in (stated, stated | {"verifications": None}):
            assert (await room.post(f"{ROOM}/{path}", json=asked)).json() == named.json()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "body", "status", "words"),
    [
        ("residuals", {"verifications": [77]}, 404, "no verification 77"),
        ("residuals", {"verifications": []}, 422, "at least 1"),
        ("residuals", {"verifications": [1, 1]}, 422, "each once"),
        ("residuals", {"verifications": [1], "model_version": 99}, 404, "no model version 99"),
        ("residuals", {"verifications": [1], "rows": 10_001}, 422, "10000"),
        ("residuals", {"verifications": [1], "model_version": 1}, 422, "model version 1: "),
        ("models/compare", {"verifications": [1], "versions": [3, 1]}, 422, "model version 1: "),
        ("models/compare", {"verifications": [1], "versions": []}, 422, "at least 1"),
        ("models/compare", {"verifications": [1], "versions": [3, 3]}, 422, "each once"),
        ("models/compare", {"verifications": [1], "versions": [99]}, 404, "no model version 99"),
    ],
)
async def test_wrong_questions(room, path, body, status, words):
    await stored(room, [exx(0, 100.0, 0.0)])
    found = problem(await room.post(f"{ROOM}/{path}", json=body), status)
    assert words in found["detail"]


async def test_names_of_states_times_observations_are_limited(room, monkeypatch):
    """A table of both is stored with a verification, and searched with all of them."""
    one, other = (
        [exx(5 * i, 40.0 * i + 100, 1.0, state={f"{name}{i}": 1.0}) for i in range(4)]
        for name in "ab"
    )
    monkeypatch.setattr(observations, "MOST_STATE_VALUES", 15)
    answer = await room.post(PATH, json={"label": "v", "observations": one})
    assert "at most 3 names of states for 4 obs" in problem(answer, 422)["detail"]
    monkeypatch.setattr(observations, "MOST_STATE_VALUES", 63)
    number = await stored(room, one)
    assert (await room.get(f"{PATH}/{number}/residuals")).status_code == 200
    await stored(room, other, label="w")
    answer = await room.post(f"{ROOM}/residuals", json={})
    assert "at most 7 names of states for 8 obs" in problem(answer, 422)["detail"]

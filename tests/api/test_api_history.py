"""A machine over time: bins of the readings, the compensation, checks and events."""

import csv
import io
from datetime import timedelta

import numpy as np
import pytest

from app.services import history as history_service
from app.services.bin_readings import ReadingBinner
from app.storage.tables import TemperatureHourRow
from tests.service_examples import ROOM, START, error_map, iso, problem, reading

pytestmark = pytest.mark.anyio

HISTORY = f"{ROOM}/history"


async def store(client, times, t_c=25.0):
    body = [reading(time, t_c + 0.1 * (i % 7)) for i, time in enumerate(times)]
    for i in range(0, len(body), 5000):
        answer = await client.post(f"{ROOM}/readings", json=body[i : i + 5000])
        assert answer.status_code == 201, answer.text


async def history(client, since, until, **query):
    asked = {"from": iso(since), "to": iso(until)} | query
    answer = await client.get(HISTORY, params=asked)
    assert answer.status_code == 200, answer.text
    return answer.json()


def bin_all(app):
    """Bin what is stored: on PostgreSQL too at once, for nobody else writes."""
    binner = ReadingBinner(app.state.context)
    binner._settled = lambda newest: newest
    binner.look()


def every(seconds, since, until):
    count = int((until - since).total_seconds() // seconds)
    return [since + timedelta(seconds=seconds * i) for i in range(count)]


async def test_bins_are_the_same_before_and_after_they_are_summed_up(
    app, client, clock, monkeypatch
):
    """Of the latest two hours, read as they are, and of the same when they have become old."""
    since, until = START - timedelta(minutes=90), START
    await store(client, every(40, since, until))
    asked = {"sensor": "x-middle", "points": 90}
    live = await history(client, since, until, **asked)
    clock.advance(86_400)
    assert (await history(client, since, until, **asked))["sensors"] == live["sensors"]
    monkeypatch.setattr(history_service, "MOST_UNBINNED", 0)
    assert "not all shown yet" in (await history(client, since, until, **asked))["notes"][0]
    bin_all(app)
    binned = await history(client, since, until, **asked)
    assert binned["sensors"] == live["sensors"]
    assert binned["notes"] == []
    (course,) = binned["sensors"]
    assert binned["bin_s"] == 60.0
    assert sum(course["count"]) == 135
    assert min(course["low_c"]) == 25.0
    assert max(course["high_c"]) == pytest.approx(25.6)
    assert max(course["gap_s"]) == 40.0


async def test_a_gap_is_said_at_every_width(app, client, clock):
    since = START - timedelta(days=20)
    until = since + timedelta(days=10)
    times = every(1200, since, until)
    gone = [t for t in times if not timedelta(days=3) < t - since < timedelta(days=3, hours=5)]
    await store(client, gone)
    bin_all(app)
    clock.advance(1)
    for points in (10, 60, 240, 720):
        (course,) = (await history(client, since, until, sensor="spindle", points=points))[
            "sensors"
        ]
        # From the last reading before it, three days after the first, to the next.
        assert [gap for gap in course["gap_s"] if gap > 1200.0] == [5 * 3600.0]
        assert sum(course["count"]) == len(gone)


async def test_late_and_withdrawn_readings_change_what_was_summed_up(app, client, clock):
    since = START - timedelta(days=2)
    until = since + timedelta(hours=5)
    await store(client, every(300, since, until))
    bin_all(app)
    asked = {"sensor": "spindle", "points": 300}

    async def counts():
        return sum((await history(client, since, until, **asked))["sensors"][0]["count"])

    assert await counts() == 60
    await store(client, [since + timedelta(minutes=12)])
    assert await counts() == 61
    bin_all(app)
    assert await counts() == 61
    withdrawn = {"from": iso(since), "to": iso(since + timedelta(minutes=59))}
    assert (await client.delete(f"{ROOM}/readings", params=withdrawn)).status_code == 200
    assert await counts() == 48  # not what was withdrawn, even before it is summed up again
    bin_all(app)
    assert await counts() == 48
    with app.state.context.database.reading() as session:
        assert session.query(TemperatureHourRow).filter_by(is_stale=True).count() == 0


async def test_the_compensation_is_what_the_table_had(client, clock):
    """EXX is (t − 20)·x/100 µm: at 27 °C and 250 mm 17.5 µm, and the compensation minus that."""
    since = START - timedelta(minutes=30)
    body = [reading(since + timedelta(minutes=i), 20.0 + 0.3 * i) for i in range(30)]
    assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    found = await history(client, since, START, component="EXX", position_mm=250, points=30)
    course = found["compensation"]
    temperatures = {s["sensor"]: s["mean_c"] for s in found["sensors"]}["x-middle"]
    expected = [-(t - 20.0) * 2.5 for t in temperatures]
    np.testing.assert_allclose(course["values"], expected, atol=1e-3)
    assert course["model_version"] == 3
    assert course["unit"] == "µm"


async def test_what_cannot_be_computed_is_null_and_said(client, clock):
    since = START - timedelta(minutes=30)
    await store(client, every(60, since, START))
    found = await history(client, since, START, component="EAX", position_mm=250)
    assert set(found["compensation"]["values"]) == {None}
    assert found["compensation"]["warnings"]


async def test_versions_and_checks_are_there(client, clock):
    clock.advance(60)
    stored = await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 33.0))
    assert stored.status_code == 201
    found = await history(client, START - timedelta(hours=1), clock())
    assert any(event["text"].startswith("v4 active") for event in found["events"])
    assert found["checks"] == []
    check = {
        "label": "Morning",
        "observations": [
            {"time": iso(START), "component": "EXX", "position_mm": 250.0, "measured_um": 4.0}
        ],
    }
    assert (await client.post(f"{ROOM}/verifications", json=check)).status_code == 201
    (mark,) = (await history(client, START - timedelta(hours=1), clock()))["checks"]
    assert (mark["label"], mark["time"]) == ("Morning", iso(START))
    assert (mark["left_um"], mark["why_not"]) == (None, "")
    await store(client, every(60, START - timedelta(minutes=5), START + timedelta(minutes=1)))
    (mark,) = (await history(client, START - timedelta(hours=1), clock(), residuals=True))["checks"]
    # EXX is 5 · 250 / 100 µm at 25 °C; one value that the check's own reading of 25.5 °C meets.
    assert mark["left_um"] == pytest.approx(abs(4.0 - 5.5 * 2.5), abs=0.01)


async def test_csv_has_the_same_numbers(client, clock):
    since = START - timedelta(minutes=30)
    await store(client, every(60, since, START))
    asked = {"component": "SXY", "points": 30}
    found = await history(client, since, START, **asked)
    answer = await client.get(
        HISTORY, params={"from": iso(since), "to": iso(START), "format": "csv"} | asked
    )
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    own = [row for row in rows if row["of"] == "z-column"]
    (course,) = [one for one in found["sensors"] if one["sensor"] == "z-column"]
    assert [float(row["mean"]) for row in own] == course["mean_c"]
    assert next(row["unit"] for row in rows if row["of"] == "compensation SXY") == "µm/m"


async def test_what_cannot_be_right_is_refused(client):
    def asked(**query):
        return client.get(HISTORY, params=query)

    assert problem(await asked(**{"from": iso(START), "to": iso(START)}), 422)
    old = {"from": "1990-01-01T00:00:00Z", "to": iso(START)}
    assert "3660 days" in problem(await asked(**old), 422)["detail"]
    assert problem(await asked(sensor="nothing"), 404)
    assert problem(await asked(component="EXX"), 422)
    assert problem(await asked(component="EQX", position_mm=1), 422)
    assert problem(await asked(component="EXX", position_mm=900), 422)
    assert problem(await client.get("/v1/machines/none/history"), 404)


async def test_an_empty_machine_has_an_empty_history(client):
    found = (await client.get(HISTORY)).json()
    assert all(one["after_s"] == [] for one in found["sensors"])
    assert (found["since"], found["until"]) == (iso(START - timedelta(days=1)), iso(START))

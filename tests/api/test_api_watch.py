"""Every verification is judged on arrival, after those that came before."""

import asyncio
from datetime import timedelta

import numpy as np
import pytest
from sqlalchemy import select

from app.storage.tables import WatchRow
from tests.service_examples import (
    ROOM,
    START,
    client_of,
    error_map,
    iso,
    reading,
)

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/verifications"
BEGIN = START - timedelta(minutes=60)
T_C = 21.0


@pytest.fixture
async def room(client):
    """A client of the example machine with an hour of readings, x-middle near 21 °C."""
    body = [reading(BEGIN + timedelta(minutes=m), T_C) for m in range(61)]
    assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    return client


def visit(number, shift_um=0.0, scale=1.0, **fields):
    """Nine values of EXX, which is x/100 µm at 21 °C, scattering by 0.5 µm."""
    scatter_um = np.random.default_rng(abs(number)).normal(0.0, 0.5, 9)
    observations = [
        {
            "time": iso(BEGIN + timedelta(minutes=number, seconds=i)),
            "component": "EXX",
            "position_mm": 50.0 * i + 50.0,
            "measured_um": float(scale * (0.5 * i + 0.5 + scatter_um[i] + shift_um)),
        }
        for i in range(9)
    ]
    fields = {"label": f"visit {number}", "repeatability_um": 0.5} | fields
    return fields | {"observations": observations}


async def judged(client, body):
    answer = await client.post(PATH, json=body)
    assert answer.status_code == 201, answer.text
    return answer.json()["judgement"]


async def test_a_machine_as_its_model_says_stays_within_and_a_changed_one_is_noticed(room):
    before = (await room.get(f"{ROOM}/watch")).json()
    assert (before["status"], before["evidence"], before["verifications"]) == (
        "no-verification",
        1.0,
        [],
    )
    for number in range(8):
        judgement = await judged(room, visit(number))
        assert (judgement["status"], judgement["model_version"]) == ("within", 3)
        assert judgement["evidence"] < judgement["limit"] == 200.0
    for number in range(8, 12):
        judgement = await judged(room, visit(number, shift_um=10.0))
    assert judgement["status"] == "beyond"
    assert (judgement["beyond"][0]["component"], judgement["beyond"][0]["unit"]) == ("EXX", "µm")
    watch = (await room.get(f"{ROOM}/watch")).json()
    assert (watch["status"], watch["model_version"]) == ("beyond", 3)
    assert iso(BEGIN + timedelta(minutes=8)) <= watch["beyond_since"] <= iso(START)
    assert [v["label"] for v in watch["verifications"]] == [f"visit {i}" for i in range(12)]
    assert watch["verifications"][-1]["evidence"] == watch["evidence"] == judgement["evidence"]
    assert watch["numbers"][0]["component"] == "EXX"
    assert watch["contradiction"] is None
    assert (await room.get(ROOM)).json()["watch"] == "beyond"
    assert (await room.patch(ROOM, json={"name": "moved"})).json()["watch"] == "beyond"
    assert [m["watch"] for m in (await room.get("/v1/machines")).json()] == ["beyond"]
    stored = (await room.get(PATH)).json()
    assert stored[-1]["judgement"] == judgement


async def test_each_version_has_a_sequence_of_its_own(room):
    for number in range(3):
        await judged(room, visit(number, shift_um=10.0))
    watched = (await room.get(f"{ROOM}/watch")).json()
    await room.post(f"{ROOM}/error-maps", json=error_map("Run #9", 36.0))
    fresh = (await room.get(f"{ROOM}/watch")).json()
    assert (fresh["model_version"], fresh["status"]) == (4, "no-verification")
    assert (await room.get(ROOM)).json()["watch"] is None
    await room.post(f"{ROOM}/models/3/activate")
    assert (await room.get(f"{ROOM}/watch")).json() == watched


@pytest.mark.slow
async def test_what_cannot_be_judged_is_stored_all_the_same(room, client):
    early = visit(-600)
    judgement = await judged(room, early)
    assert judgement["status"] == "not-judged"
    assert judgement["awaits_readings"] is True
    assert "as soon as there are readings up to its last observation" in judgement["summary"]
    assert "before the first reading" in judgement["summary"]
    watch = (await room.get(f"{ROOM}/watch")).json()
    assert (watch["status"], watch["verifications"][0]["status"]) == (
        "no-verification",
        "not-judged",
    )


def readings_of(number, minutes):
    """Readings around a visit, as many minutes of them."""
    begin = BEGIN + timedelta(minutes=number)
    return [reading(begin + timedelta(minutes=m), T_C) for m in minutes]


async def late(client, path):
    """Ask in one of the ways in which a judgement is seen."""
    answer = await client.get(path)
    assert answer.status_code == 200
    return (await client.get(PATH)).json()[-1]["judgement"]


@pytest.mark.parametrize("path", [PATH, f"{PATH}/2", f"{ROOM}/watch", "/machines/mcfv5050/loop"])
async def test_what_was_stored_before_its_readings_is_judged_once_they_are_there(room, path):
    """As it would have been after them: the watch goes on with it, once, and the log says so."""
    await judged(room, visit(0))
    early = await judged(room, visit(-300, shift_um=20.0))
    assert (early["status"], early["awaits_readings"]) == ("not-judged", True)
    assert (await late(room, path)) == early
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 3)))
    now = await late(room, path)
    assert (now["status"], now["awaits_readings"], now["visits"]) == ("beyond", False, 1)
    watch = (await room.get(f"{ROOM}/watch")).json()
    assert watch["status"] == "beyond"
    assert [v["status"] for v in watch["verifications"]] == ["within", "beyond"]
    assert (await late(room, path)) == now
    events = (await room.get(f"{ROOM}/events")).json()
    said = [one["text"] for one in events["events"] if "readings that came after" in one["text"]]
    assert said == ["verification 'visit -300' judged with readings that came after it"]


async def test_readings_that_come_in_pieces_are_waited_for(room):
    early = visit(-300)
    early["observations"][-1]["time"] = iso(BEGIN - timedelta(minutes=285))
    await judged(room, early)
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 3)))
    assert (await late(room, PATH))["awaits_readings"] is True
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(3, 16)))
    assert (await late(room, PATH))["visits"] == 1


async def test_many_that_waited_do_not_hold_up_who_asks(room, monkeypatch):
    monkeypatch.setattr("app.services.judge_verifications.AT_MOST_S", 0.0)
    for number in (-300, -299):
        await judged(room, visit(number))
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 5)))
    for expected in ([False, True], [False, False]):
        listed = (await room.get(PATH)).json()
        assert [one["judgement"]["awaits_readings"] for one in listed] == expected


async def test_a_judgement_that_was_made_stays_whatever_readings_come_later(room):
    known = await judged(room, visit(0))
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(20)))
    assert (await late(room, PATH)) == known


async def test_what_waits_is_judged_before_what_is_stored_after_it(room):
    await judged(room, visit(-300, shift_um=20.0))
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 3)))
    await judged(room, visit(1, shift_um=20.0))
    first, second = (await room.get(PATH)).json()
    assert first["judgement"]["evidence"] < second["judgement"]["evidence"]


async def test_a_verification_that_waits_is_in_no_watch_when_another_is_deleted(room):
    await judged(room, visit(0))
    await judged(room, visit(-300, shift_um=20.0))
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 3)))
    await room.delete(f"{PATH}/1")
    judgement = await late(room, PATH)
    assert (judgement["awaits_readings"], judgement["visits"]) == (False, 1)
    steps = [one["evidence"] for one in (await room.get(f"{ROOM}/watch")).json()["verifications"]]
    assert steps == [judgement["evidence"]]


async def test_a_value_that_was_mistyped_is_named_where_all_else_agrees(room):
    """It makes the scatter itself in which it hides from the watch."""
    body = visit(0)
    body["observations"][3]["measured_um"] += 90.0
    summary = (await judged(room, body))["summary"]
    assert "But one value is 8" in summary
    assert "EXX at 200 mm of 2026-03-01 05:00:03 UTC, where they scatter by ±" in summary
    assert summary.endswith("was it misread or mistyped?")
    numbers = (await room.get(f"{ROOM}/watch")).json()["numbers"]
    (level,) = (one for one in numbers if one["what"] == "level")
    assert level["expected_sd"] < 4.0  # 3.1 µm of the maps; with that value it would be 6 µm
    assert "mistyped" not in (await judged(room, visit(1)))["summary"]


async def test_values_in_another_unit_are_said_where_they_come_to_light_later(room):
    await judged(room, visit(-300, scale=0.001))
    await room.post(f"{ROOM}/readings", json=readings_of(-300, range(-1, 3)))
    judgement = await late(room, PATH)
    assert (judgement["status"], judgement["awaits_readings"]) == ("not-judged", False)
    assert "meant in mm" in judgement["summary"]


async def test_a_state_that_a_newer_version_wrote_loses_no_verification(room, app):
    await judged(room, visit(0))
    with app.state.context.database.writing() as session:
        row = session.scalars(select(WatchRow)).one()
        row.state = row.state | {"shape": 1000}
    judgement = await judged(room, visit(1))
    assert judgement["status"] == "not-judged"
    assert "newer version" in judgement["summary"]
    with app.state.context.database.reading() as session:
        assert session.scalars(select(WatchRow)).one().state["shape"] == 1000


@pytest.mark.slow
async def test_many_at_once_on_two_services_are_judged_one_after_the_other(
    room, new_app, furnished_url
):
    async with client_of(new_app(furnished_url)) as other:
        clients = [room, other] * 4
        answers = await asyncio.gather(
            *(c.post(PATH, json=visit(i, shift_um=3.0)) for i, c in enumerate(clients))
        )
    assert {a.status_code for a in answers} == {201}
    watch = (await room.get(f"{ROOM}/watch")).json()
    evidence = [v["evidence"] for v in watch["verifications"]]
    assert len(set(evidence)) == 8
    assert watch["evidence"] == evidence[-1]


async def test_a_deleted_verification_counts_no_more(room):
    """A slip of a millimetre is stored and deleted: the watch is as if it had never come."""
    for number in range(3):
        await judged(room, visit(number))
    quiet = (await room.get(f"{ROOM}/watch")).json()
    slip = visit(3, shift_um=200.0)
    assert (await judged(room, slip))["status"] == "beyond"
    number = (await room.get(PATH)).json()[-1]["id"]
    assert (await room.delete(f"{PATH}/{number}")).status_code == 204
    watch = (await room.get(f"{ROOM}/watch")).json()
    assert watch["status"] == "within"
    assert watch["evidence"] == pytest.approx(quiet["evidence"], rel=0.1)
    assert (await room.get(ROOM)).json()["watch"] == "within"
    assert (await judged(room, visit(4)))["status"] == "within"
    for one in (await room.get(PATH)).json():
        assert (await room.delete(f"{PATH}/{one['id']}")).status_code == 204
    assert (await room.get(f"{ROOM}/watch")).json()["status"] == "no-verification"
    assert (await room.get(ROOM)).json()["watch"] is None


async def test_metrics_tell_what_the_latest_verification_left(room):
    def sample(text, name):
        found = [line for line in text.splitlines() if line.startswith(f"{name}{{")]
        assert len(found) <= 1
        return float(found[0].rpartition(" ")[2]) if found else None

    text = (await room.get("/metrics")).text
    assert sample(text, "thermap_verification_rms_meters") is None
    await judged(room, visit(0))
    judgement = await judged(room, visit(1, shift_um=-10.0))
    text = (await room.get("/metrics")).text
    # Of the second alone: its scatter as `visit` draws it, and the shift.
    left_um = np.random.default_rng(1).normal(0.0, 0.5, 9) - 10.0
    rms_m = sample(text, "thermap_verification_rms_meters")
    assert rms_m == pytest.approx(np.sqrt(np.mean(left_um**2)) * 1e-6)
    assert sample(text, "thermap_verification_largest_meters") == pytest.approx(
        left_um.min() * 1e-6
    )
    assert sample(text, "thermap_verification_largest_radians") is None
    assert sample(text, "thermap_verification_time_seconds") == pytest.approx(
        (BEGIN + timedelta(minutes=1, seconds=8)).timestamp()
    )
    evidence = sample(text, "thermap_machine_watch_evidence")
    assert evidence == pytest.approx(judgement["evidence"])
    followed = (await room.get(f"{ROOM}/watch")).json()["numbers"]
    assert sample(text, "thermap_machine_watch_largest_sigmas") == pytest.approx(
        max(abs(one["deviation"]) / one["expected_sd"] for one in followed)
    )


async def test_of_an_instrument_that_was_zeroed_no_constant_is_told(room):
    body = visit(3, shift_um=300.0, datum="free")
    await judged(room, body)
    text = (await room.get("/metrics")).text
    (line,) = [x for x in text.splitlines() if x.startswith("thermap_verification_largest_meters{")]
    left_um = np.random.default_rng(3).normal(0.0, 0.5, 9)
    assert abs(float(line.rpartition(" ")[2])) == pytest.approx(
        np.abs(left_um - left_um.mean()).max() * 1e-6
    )


async def last_check(client):
    found = (await client.get(f"{ROOM}/status")).json()
    return found["verdict"], found["state"], found["last_check"], found["sentences"]


async def test_one_value_far_off_is_never_called_trusted(room):
    assert await last_check(room) == ("trusted", "fresh", None, (await last_check(room))[3])
    body = visit(1)
    body["observations"] = body["observations"][:1]
    body["observations"][0]["measured_um"] = 0.5 + 11.3
    assert (await judged(room, body))["status"] == "within"
    verdict, state, check, sentences = await last_check(room)
    assert (verdict, state) == ("limited", "check-off")
    assert (check["component"], check["count"], check["off"]) == ("EXX", 1, 11.3)
    # 0.5 µm, and the maps' uncertainty.
    assert check["scatter"] == pytest.approx(0.57, abs=0.01)
    assert check["at_most"] == pytest.approx(2.0 * check["scatter"], abs=1e-3)
    assert check["as_expected"] is False
    words = (
        "11.3 µm off in EXX; one observation scatters by ±0.57 µm, so at most 1.1 µm is expected"
    )
    assert check["text"] == words
    assert sentences[0] == f"The last check was {words}."


async def test_a_check_that_is_as_expected_says_so_and_takes_back_one_that_was_not(room):
    await judged(room, visit(1, 8.0))
    assert (await last_check(room))[:2] == ("limited", "check-off")
    await judged(room, visit(2))
    verdict, state, check, _ = await last_check(room)
    assert (verdict, state, check["as_expected"]) == ("trusted", "fresh", True)
    assert check["off"] < check["at_most"]
    assert check["text"].startswith(f"{check['off']:.2f} µm off in EXX (root mean square of 9")


async def test_a_check_of_another_component_takes_back_nothing(room):
    await judged(room, visit(1, 8.0))
    other = visit(2, scale=0.0)
    for observation in other["observations"]:
        place = observation["position_mm"]
        observation |= {"component": "EZZ", "measured_um": place / 50.0}
    await judged(room, other)
    verdict, _, check, _ = await last_check(room)
    assert (verdict, check["component"]) == ("limited", "EXX")


async def test_a_reversal_is_off_although_neither_level_nor_slope_is(room):
    """To and fro by 2.7 µm: the level is right, and so is every slope."""
    for number in range(1, 6):
        body = visit(number)
        for i, observation in enumerate(body["observations"]):
            observation["measured_um"] += 2.7 * (-1) ** i
        assert (await judged(room, body))["status"] != "beyond"
        assert (await last_check(room))[:2] == ("limited", "check-off")


async def test_set_ups_that_are_seen_to_scatter_are_expected_to(room):
    """By 4 µm, a repeatability is 0.5 µm: at first nobody knows, later it is expected."""
    shifts_um = (3.9, -4.2, 2.5, -3.0, 4.4, -1.9, 3.5, -3.6)
    states = []
    for number, shift_um in enumerate(shifts_um, 1):
        await judged(room, visit(number, shift_um))
        states.append((await last_check(room))[1])
    assert states[0] == "check-off"
    assert states[-1] == "fresh"
    check = (await last_check(room))[2]
    assert check["setup_scatter"] > 1.0
    assert " and set-ups by ±" in check["text"]


async def test_nothing_is_said_of_what_was_expected_where_nothing_tells_the_scatter(room):
    body = visit(1, repeatability_um=None)
    body["observations"] = body["observations"][:1]
    assert (await judged(room, body))["status"] == "not-judged"
    verdict, _, check, _ = await last_check(room)
    assert (verdict, check["off"], check["as_expected"]) == ("trusted", None, None)
    assert check["text"] == "what was to be expected of it is not known"

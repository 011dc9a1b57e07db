"""Verifications over HTTP: stored once, shown as they came, refused whole."""

from datetime import timedelta

import pytest

from tests.service_examples import MACHINE, ROOM, START, contents, iso, problem

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/verifications"


def observation(component="EXX", minutes=-60, **fields):
    """One observation, an hour before the clock's time if nothing else is said."""
    stated = {"component": component, "position_mm": 250.0, "measured_um": 4.31}
    return {"time": iso(START + timedelta(minutes=minutes))} | stated | fields


def verification(*observations, label="night shift", **fields):
    return {"label": label, "observations": list(observations) or [observation()]} | fields


POINT = {
    "time": iso(START - timedelta(minutes=50)),
    "point_mm": [250.0, 100.0, 300.0],
    "tool_offset_mm": [0.0, 0.0, 160.0],
    "direction": {"x": "+", "z": "-"},
    "measured_um": [1.2, -0.4, 3.3],
    "state": {"spindle_rpm": 8000.0},
}


async def test_what_nothing_can_be_compared_with_is_said_when_it_is_stored(client):
    fine = (await client.post(PATH, json=verification())).json()
    assert fine["warnings"] == []
    body = verification(observation(), observation("EYY"), label="with EYY")
    (warning,) = (await client.post(PATH, json=body)).json()["warnings"]
    assert "no table of model version 3 has EYY, and nothing is compared with them" in warning
    again = await client.post(PATH, json=body)
    assert (again.status_code, again.json()["warnings"]) == (200, [warning])


async def test_copied_observations_are_stored_and_said(client):
    """As repeats of no scatter they would make the noise too small."""
    one, later = observation(), observation(time=iso(START - timedelta(minutes=9)))
    answer = await client.post(PATH, json=verification(one, later, one, one | {"measured_um": 9.0}))
    assert answer.status_code == 201
    (warning,) = answer.json()["warnings"]
    assert warning.startswith("2 observations have the time, place and direction of another one")
    assert "EXX at " in warning
    other = one | {"measured_um": 4.4}
    apart = verification(other, later, other | {"direction": "-"}, label="apart")
    assert (await client.post(PATH, json=apart)).json()["warnings"] == []


async def test_the_same_observations_under_another_label_are_said(client):
    """Visits are the evidence: the same one twice would count as two."""
    rows = observation(), observation(minutes=-50, measured_um=4.5)
    first = (await client.post(PATH, json=verification(*rows))).json()
    assert first["warnings"] == []
    (warning,) = (await client.post(PATH, json=verification(*rows, label="copy"))).json()[
        "warnings"
    ]
    assert warning.startswith(f"verification 'night shift' (number {first['id']}) has the same")
    other = observation(), observation(minutes=-50, measured_um=4.6)
    answer = await client.post(PATH, json=verification(*other, label="measured again"))
    assert answer.json()["warnings"] == []


@pytest.mark.parametrize(
    ("kept", "changed", "shared"),
    [
        (range(5), None, "5 of these 5"),
        (range(6), 2, "5 of these 6"),
        ([0, 3], None, "2 of these"),
    ],
    ids=["one dropped", "one changed", "most dropped"],
)
async def test_parts_of_a_verification_under_another_label_are_asked_about(
    client, kept, changed, shared
):
    rows = [observation(minutes=i - 60, position_mm=50.0 * i, measured_um=i) for i in range(6)]
    assert (await client.post(PATH, json=verification(*rows))).json()["warnings"] == []
    part = [rows[i] | {"setup": "anew"} for i in kept]
    if changed is not None:
        part[changed]["measured_um"] = 9.0
    answer = await client.post(PATH, json=verification(*part, label="part"))
    (warning,) = answer.json()["warnings"]
    assert warning.startswith(f"verification 'night shift' (number 1) has {shared}")


@pytest.mark.parametrize("honest", ["other values", "other times", "one in common"])
async def test_a_repeat_of_a_measurement_is_not_asked_about(client, honest):
    rows = [observation(minutes=i - 60, position_mm=50.0 * i, measured_um=i) for i in range(6)]
    await client.post(PATH, json=verification(*rows))
    again = {
        "other values": [one | {"measured_um": one["measured_um"] + 0.1} for one in rows],
        "other times": [
            one | {"time": iso(START - timedelta(minutes=58.5 - i))} for i, one in enumerate(rows)
        ],
        "one in common": [rows[-1], observation(minutes=-20, measured_um=3.0)],
    }[honest]
    answer = await client.post(PATH, json=verification(*again, label="again"))
    assert answer.json()["warnings"] == []


async def test_lengths_that_may_be_in_mm_are_stored_and_said(client):
    small = verification(observation(measured_um=0.012))
    (warning,) = (await client.post(PATH, json=small)).json()["warnings"]
    assert warning.startswith("No reading is larger than 0.012 µm (measured_um): they may be in mm")


@pytest.mark.parametrize(
    ("places", "is_asked"), [([0, 0.25, 0.5], True), ([0, 0.25, 250], False), ([0, 0.25], False)]
)
async def test_positions_that_may_be_in_metres_are_asked_about(client, places, is_asked):
    rows = [observation(position_mm=place, minutes=-60 + i) for i, place in enumerate(places)]
    warnings = (await client.post(PATH, json=verification(*rows))).json()["warnings"]
    asked = "all positions of x are from 0 to 0.5 mm, on an axis of 0 to 500 mm: are they in mm?"
    assert warnings == [asked] * is_asked


@pytest.mark.parametrize(("stated", "unit"), [(0.0005, "mm"), (500.0, "nm"), (0.5, None)])
async def test_a_repeatability_in_another_unit_is_asked_about(client, stated, unit):
    body = verification(repeatability_um=stated)
    warnings = (await client.post(PATH, json=body)).json()["warnings"]
    expected = f"A repeatability of {stated:g} µm is stated (repeatability_um): is it in {unit}?"
    assert [one.startswith(expected) for one in warnings] == ([True] if unit else [])


async def test_observations_without_a_set_up_beside_others_with_one_are_said(client):
    """As in a spreadsheet in which only the first line of each set-up is filled in."""
    first, *below = (
        observation(time=iso(START - timedelta(minutes=minutes))) for minutes in (10, 9, 8)
    )
    named = first | {"setup": "morning"}
    answer = await client.post(PATH, json=verification(named, *below))
    (warning,) = answer.json()["warnings"]
    assert warning.startswith("2 observations name no set-up beside others that do")
    for value, label, setup in ((5.0, "none", {}), (6.0, "all", {"setup": "morning"})):
        alike = [one | setup | {"measured_um": value} for one in (first, *below)]
        answer = await client.post(PATH, json=verification(*alike, label=label))
        assert answer.json()["warnings"] == []


async def test_without_a_model_a_verification_is_stored_with_a_warning(client):
    await client.post("/v1/machines", json=MACHINE | {"id": "new"})
    answer = await client.post("/v1/machines/new/verifications", json=verification())
    assert answer.status_code == 201
    (warning,) = answer.json()["warnings"]
    assert "no model yet" in warning


async def test_what_was_stored_is_shown_as_it_came(client):
    stated = verification(
        observation(direction="-", state={"spindle_rpm": 0.0, "payload_kg": 12.5}),
        {"time": iso(START - timedelta(microseconds=1)), "component": "SXY", "measured_um": -8.2},
        POINT,
        observation("EBX", measured_urad=7.5, measured_um=None),
        datum="first",
        repeatability_um=0.5,
    )
    answer = await client.post(PATH, json=stated)
    assert answer.status_code == 201, answer.text
    made = answer.json()
    assert answer.headers["Location"] == f"{PATH}/{made['id']}"
    assert {k: made[k] for k in ("label", "datum", "repeatability_um", "count", "components")} == {
        "label": "night shift",
        "datum": "first",
        "repeatability_um": 0.5,
        "count": 4,
        "components": ["EXX", "EBX", "SXY", "points"],
    }
    assert (made["stored_at"], made["last_at"]) == (
        iso(START),
        iso(START - timedelta(microseconds=1)),
    )
    shown = (await client.get(f"{PATH}/{made['id']}")).json()
    first, square, point, angle = shown["observations"]
    assert first == stated["observations"][0]
    assert square == {
        "time": iso(START - timedelta(microseconds=1)),
        "component": "SXY",
        "measured_um_per_m": -8.2,
        "state": {},
    }
    assert point == POINT
    assert angle["measured_urad"] == 7.5
    listed = (await client.get(PATH)).json()
    assert listed == [{name: said for name, said in made.items() if name != "warnings"}]


async def test_the_end_of_an_axis_in_inches_is_on_the_axis(client):
    """500 mm are 19.68504 in, which is 500.000016 mm."""
    end = observation(position_mm=19.68504 * 25.4)
    assert (await client.post(PATH, json=verification(end))).status_code == 201
    beyond = observation(position_mm=500.01)
    answer = await client.post(PATH, json=verification(beyond, label="beyond"))
    assert "got 500.01 mm" in problem(answer, 422)["detail"]


async def test_setups_are_kept_and_are_part_of_the_content(client):
    stated = verification(
        observation(setup="first clamping"), observation(), POINT | {"setup": "second, Straße 7"}
    )
    made = (await client.post(PATH, json=stated)).json()
    shown = (await client.get(f"{PATH}/{made['id']}")).json()["observations"]
    assert [one.get("setup") for one in shown] == ["first clamping", None, "second, Straße 7"]
    assert (await client.post(PATH, json=stated)).status_code == 200
    for other in (None, "second clamping"):
        changed = [observation(setup=other), *stated["observations"][1:]]
        problem(await client.post(PATH, json=stated | {"observations": changed}), 409)
    problem(await client.post(PATH, json=verification(observation(setup=""))), 422)


async def test_iso_names_and_signs_become_ours(client):
    stated = verification(
        {"time": iso(START), "component": "C0Y", "measured_um_per_m": 8.2},
        observation("D_x(x)", measured_um=1.5),
    )
    made = (await client.post(PATH, json=stated)).json()
    square, linear = (await client.get(f"{PATH}/{made['id']}")).json()["observations"]
    assert (square["component"], square["measured_um_per_m"]) == ("SXY", -8.2)
    assert (linear["component"], linear["measured_um"]) == ("EXX", 1.5)


async def test_the_same_again_is_the_stored_one_and_other_content_a_conflict(client):
    first = await client.post(PATH, json=verification())
    again = await client.post(PATH, json=verification())
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json()
    for other in (
        verification(observation(measured_um=4.32)),
        verification(datum="free"),
        verification(observation(), observation(minutes=-59)),
    ):
        found = problem(await client.post(PATH, json=other), 409)
        assert "'night shift'" in found["detail"]
    assert len((await client.get(PATH)).json()) == 1


async def test_instrument_and_operator_are_named_with_it_or_later_and_not_changed(client):
    first = await client.post(PATH, json=verification(instrument="XL-80, no. 4711"))
    later = await client.post(PATH, json=verification(operator="M. Weber"))
    assert (first.status_code, later.status_code) == (201, 200)
    stored = (await client.get(f"{PATH}/{first.json()['id']}")).json()
    assert (stored["instrument"], stored["operator"]) == ("XL-80, no. 4711", "M. Weber")
    other = await client.post(PATH, json=verification(operator="K. Braun"))
    assert "has another verification 'night shift'" in problem(other, 409)["detail"]


async def test_a_deleted_verifications_number_is_not_used_again(client):
    made = (await client.post(PATH, json=verification())).json()
    assert (await client.delete(f"{PATH}/{made['id']}")).status_code == 204
    problem(await client.delete(f"{PATH}/{made['id']}"), 404)
    again = (await client.post(PATH, json=verification())).json()
    assert again["id"] > made["id"]
    assert "(night shift)" in problem(await client.get(f"{PATH}/{made['id']}"), 404)["detail"]
    problem(await client.get(f"{PATH}/{10**12}"), 404)
    problem(await client.get("/v1/machines/nope/verifications"), 404)
    await client.delete(ROOM)
    problem(await client.get(PATH), 404)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "field", "words"),
    [
        (verification(observation("EXQ")), "observations.0.component", "EXQ"),
        (verification(observation(position_mm=None)), "observations.0.position_mm", "in mm"),
        (verification(observation(position_mm=501)), "observations.0.position_mm", "0 to 500 mm"),
        (verification(POINT | {"point_mm": [0, 0, -1]}), "observations.0.point_mm", "0 to 500 mm"),
        (
            verification(observation(position_mm=500.01)),
            "observations.0.position_mm",
            "got 500.01 mm",
        ),
        (verification(observation(minutes=2)), "observations.0.time", "not in the future"),
        (
            verification(observation(minutes=2)),
            "observations.0.time",
            f"got {iso(START + timedelta(minutes=2))}",
        ),
        (verification(observation(measured_um=True)), "observations.0.measured_um", "got true"),
        (
            verification(observation(state={"x" * 5000: "fast"})),
            f"observations.0.state.{'x' * 77}…",
            "got 'fast'",
        ),
        (
            verification(observation("SXY", position_mm=1.0)),
            "observations.0.position_mm",
            "which has no position",
        ),
        (
            verification(observation("SXY", position_mm=None, direction="+")),
            "observations.0.direction",
            "which has no position",
        ),
        (
            verification(observation(direction={"y": "+"})),
            "observations.0.direction",
            "the approach of x alone for EXX, got y",
        ),
        (verification(observation(measured_um=None)), "observations.0.measured_um", "got none"),
        (
            verification(observation(), observation(measured_urad=1.0)),
            "observations.1.measured_urad",
            "one measured value of EXX",
        ),
        (
            verification(observation(measured_um=None, measured_urad=1.0)),
            "observations.0.measured_urad",
            "measured_um",
        ),
        (
            verification(observation(measured_um=[1, 2, 3])),
            "observations.0.measured_um",
            "one numb",
        ),
        (verification(POINT | {"measured_um": 1.0}), "observations.0.measured_um", "x, y and z"),
        (verification(POINT | {"measured_um": [1.0]}), "observations.0.measured_um", "at least 3"),
        (verification(observation(measured_um=2e4)), "observations.0.measured_um", "±10000 µm"),
        (verification(observation(measured_um="4")), "observations.0.measured_um", "a number"),
        (verification(POINT | {"component": "EXX"}), "observations.0.component", "not both"),
        (verification(observation(direction="up")), "observations.0.direction", "`+`"),
        (verification(observation(colour=1)), "observations.0.colour", "unknown field"),
        (verification(datum="second"), "datum", "'absolute'"),
        (verification(repeatability_um=0), "repeatability_um", "more than 0"),
        ({"label": "none", "observations": []}, "observations", "at least 1"),
        ({"observations": [observation()]}, "label", "got nothing"),
    ],
)
async def test_what_cannot_be_right_is_refused_and_nothing_stored(
    client, app, stated, field, words
):
    before = contents(app)
    found = problem(await client.post(PATH, json=stated), 422)
    assert field in [e["field"] for e in found["errors"]]
    assert words in found["detail"]
    assert contents(app) == before


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
async def test_numbers_that_are_none_are_refused(client, number):
    body = f'{{"label": "x", "observations": [{{"time": "{iso(START)}", "component": "EXX", '
    body += f'"position_mm": 1.0, "measured_um": {number}}}]}}'
    json = {"content-type": "application/json"}
    found = problem(await client.post(PATH, content=body, headers=json), 422)
    assert found["errors"][0]["field"] in ("observations.0.measured_um", "body")


async def test_a_long_verification_is_read_in_pieces_and_its_mistakes_named(client):
    many = [observation(position_mm=i % 500, measured_um=i / 7) for i in range(3000)]
    answer = await client.post(PATH, json=verification(*many))
    assert (answer.status_code, answer.json()["count"]) == (201, 3000)
    shown = (await client.get(f"{PATH}/{answer.json()['id']}")).json()["observations"]
    assert [o["measured_um"] for o in shown] == [o["measured_um"] for o in many]
    many[2345] = observation(measured_um="much")
    found = problem(await client.post(PATH, json=verification(*many, label="b")), 422)
    assert found["errors"][0]["field"] == "observations.2345.measured_um"
    many[2345] = observation(position_mm=-1)
    found = problem(await client.post(PATH, json=verification(*many, label="b")), 422)
    assert found["errors"][0]["field"] == "observations.2345.position_mm"
    wrong_head = verification(*many, label="")
    assert problem(await client.post(PATH, json=wrong_head), 422)["errors"][0]["field"] == "label"


@pytest.mark.slow
async def test_more_observations_than_the_limit_are_refused(client):
    many = [observation()] * 100_001
    found = problem(await client.post(PATH, json=verification(*many)), 422)
    assert "at most 100000" in found["detail"]


async def test_text_that_nobody_said_is_json_is_refused(client):
    plain = {"content-type": "text/plain"}
    found = problem(await client.post(PATH, content=b"{}", headers=plain), 415)
    assert "Content-Type" in found["detail"]


async def test_a_measured_value_may_have_the_name_that_residuals_give_it(client):
    stated = verification()
    renamed = verification()
    for one in renamed["observations"]:
        one["measured"] = one.pop("measured_um")
    stored = await client.post(PATH, json=renamed)
    assert stored.status_code == 201, stored.text
    again = await client.post(PATH, json=stated)
    assert (again.status_code, again.json()) == (200, stored.json())

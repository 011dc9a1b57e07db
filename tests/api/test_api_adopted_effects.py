"""Adopted effects of each kind in everything that the service gives out, over HTTP."""

from dataclasses import replace
from datetime import timedelta
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from app.cli.compensate import table_view
from app.effects.driver import Always, SinceReference
from app.effects.effect import Effect
from app.effects.shape import Everywhere, Exchange
from app.effects.term import Term
from tests.effect_examples import (
    BACKLASH,
    DRIFT,
    LAG,
    OUTDATED,
    ROLL,
    SINE,
    SLOPE,
    SPEED,
    SPEED_LATE,
    SPINDLE_LATE,
    TAU_S,
    adopt,
    current,
    fault,
    learnt,
    low_pass_by_steps,
    predicted,
    response,
    stored,
    warm_up,
)
from tests.service_examples import (
    ROOM,
    START,
    by_code,
    client_of,
    reading,
    temperatures,
)
from thermap.answers import CompensationAnswer

pytestmark = pytest.mark.anyio


async def test_without_effects_the_model_and_the_table_have_none(client):
    await stored(client, [reading(START, 25.5)])
    document = await current(client)
    assert document["effects"] == []
    assert {tuple(entry["effects"]) for entry in document["components"]} == {()}


async def test_a_lag_is_carried_along_and_is_what_predictions_say(client, app):
    readings = warm_up()
    await stored(client, readings[:40])
    version = adopt(app, LAG).version
    for one in readings[40:]:
        await stored(client, one)
    document = await current(client)
    assert document["model_version"] == version.version == 4
    assert document["complete"] is True
    assert document["effects"] == [
        {
            "kind": "thermal-lag",
            "components": ["EZZ"],
            "sensors": ["z-column"],
            "explanation": "EZZ follows z-column 10 min late",
            "in_table": True,
            "missing": "",
            "held": [],
            "valid": LAG.learnt_fields,
            "measure_again": "",
            "sureness": [],
        }
    ]
    ezz = by_code(document)["EZZ"]
    assert ezz["effects"] == ["thermal-lag"]
    assert by_code(document)["EXX"]["effects"] == []
    late_c = low_pass_by_steps(readings, lambda r: r["temperatures_c"]["z-column"], TAU_S)
    # EZZ is (t − 20)·z/50 µm where z-column reads t + 2.
    expected = [(late_c - 22.0) * z / 50.0 for z in ezz["positions_mm"]]
    assert ezz["errors_um"] == pytest.approx(expected, abs=1e-3)
    assert ezz["compensation_um"] == [-e for e in ezz["errors_um"]]
    said = await predicted(client, *({"component": "EZZ", "position_mm": z} for z in (0, 50, 500)))
    assert said["status"] == ["interpolated"] * 3
    assert said["predicted_um"] == pytest.approx(ezz["errors_um"], abs=5.1e-5)


async def test_a_lag_needs_five_time_constants_and_says_so(client, app):
    adopt(app, LAG)
    await stored(client, warm_up(49))
    document = await current(client)
    assert document["complete"] is False
    (effect,) = document["effects"]
    assert effect["in_table"] is False
    lacking = (
        "expected 50 min of readings of z-column without a gap (five time constants), got 49 min"
    )
    assert effect["missing"] == lacking
    assert f"thermal-lag of EZZ is not in the table: {lacking}" in document["warnings"]
    assert by_code(document)["EZZ"]["effects"] == []
    said = await predicted(client, {"component": "EZZ", "position_mm": 500})
    assert said["status"] == ["effect-missing"]
    assert said["predicted_um"] == pytest.approx([by_code(document)["EZZ"]["errors_um"][-1]])
    assert "thermal-lag of EZZ is not in some predictions of EZZ" in said["warnings"][0]


async def test_responses_of_two_components_are_predicted_as_the_table_has_them(client, app):
    """Each of them shows in no row of the other component."""
    await stored(client, warm_up())
    adopt(app, response("EXX", "x-middle"), response("EZZ", "z-column"))
    entries = by_code(await current(client))
    both = ({"component": code, "position_mm": 500.0} for code in ("EXX", "EZZ"))
    said = await predicted(client, *both)
    assert said["status"] == ["interpolated"] * 2
    assert said["warnings"] == []
    expected = [entries[code]["errors_um"][-1] for code in ("EXX", "EZZ")]
    assert said["predicted_um"] == pytest.approx(expected, abs=5.1e-5)
    # The maps say (t − 20)·500/100 µm, and the sensor has risen by 3.3 K.
    last_c = warm_up()[-1]["temperatures_c"]["x-middle"]
    assert said["predicted_um"][0] > 5.0 * (last_c - 20.0) + 2.0 * 3.0


async def test_a_late_second_sensor_is_carried_along_and_is_what_predictions_say(
    client, app, new_app, furnished_url
):
    readings = warm_up()
    await stored(client, readings[:40])
    adopt(app, SPINDLE_LATE)
    for one in readings[40:]:
        await stored(client, one)
    document = await current(client)
    assert document["complete"] is True
    (effect,) = document["effects"]
    assert effect["explanation"] == "EXX also moves with spindle, 10 min late, by 1.5 µm/K"
    assert effect["valid"]["made_of"] == {
        "spindle 10 min late above what it was in the maps [K]": [-3.0, 3.0]
    }
    late_c = low_pass_by_steps(readings, lambda r: r["temperatures_c"]["spindle"], TAU_S)
    # EXX is (t − 20)·x/100 µm; where x-middle reads t the maps had the spindle at t + 5.
    t_c = readings[-1]["temperatures_c"]["x-middle"]
    exx = by_code(document)["EXX"]
    added = 1.5 * (late_c - (t_c + 5.0))
    assert abs(added) > 0.2
    expected = [(t_c - 20.0) * x / 100.0 + added for x in exx["positions_mm"]]
    assert exx["errors_um"] == pytest.approx(expected, abs=1e-3)
    said = await predicted(client, *({"component": "EXX", "position_mm": x} for x in (0, 100, 500)))
    assert said["status"] == ["interpolated"] * 3
    assert said["predicted_um"] == pytest.approx(exx["errors_um"], abs=5.1e-5)
    async with client_of(new_app(furnished_url)) as again:
        restarted = by_code(await current(again))["EXX"]
    assert restarted["errors_um"] == pytest.approx(exx["errors_um"], abs=1e-9)


async def test_a_late_second_sensor_needs_its_past_and_says_so(client, app):
    adopt(app, SPINDLE_LATE)
    await stored(client, warm_up(49))
    document = await current(client)
    assert document["complete"] is False
    (effect,) = document["effects"]
    lacking = (
        "expected 50 min of readings of spindle without a gap (five time constants), got 49 min"
    )
    assert (effect["in_table"], effect["missing"]) == (False, lacking)
    assert by_code(document)["EXX"]["effects"] == []
    said = await predicted(client, {"component": "EXX", "position_mm": 500})
    assert said["status"] == ["effect-missing"]
    answer = await client.post(f"{ROOM}/compensation", json={"temperatures_c": temperatures(25.5)})
    assert answer.json()["warnings"] == [
        "additional-sensor of EXX is not in the table: the history of spindle is not known here"
    ]


async def test_a_late_second_sensor_is_held_where_it_was_learnt(client, app):
    """The spindle runs 20 K hotter than beside any map: its low-pass counts, not its reading."""
    adopt(app, SPINDLE_LATE)
    readings = warm_up(90)
    for one in readings[30:]:
        one["temperatures_c"]["spindle"] += 20.0
    await stored(client, readings)
    document = await current(client)
    exx = by_code(document)["EXX"]
    assert exx["status"] == "held"
    assert exx["errors_um"][0] == pytest.approx(1.5 * 3.0, abs=1e-4)
    (warning,) = document["effects"][0]["held"]
    assert "spindle 10 min late above what it was in the maps is" in warning
    assert "learnt from -3 to 3 K" in warning


async def test_stated_temperatures_have_no_past(client, app):
    adopt(app, LAG, OUTDATED)
    await stored(client, warm_up())
    stated = {"temperatures_c": temperatures(25.5)}
    answer = await client.post(f"{ROOM}/compensation", json=stated)
    document = answer.json()
    assert document["complete"] is False
    assert document["warnings"] == [
        "thermal-lag of EZZ is not in the table: the history of z-column is not known here"
    ]
    assert by_code(document)["EXX"]["errors_um"] == pytest.approx([3.0, 8.5, 30.5])
    assert by_code(document)["EXX"]["effects"] == ["outdated-map"]


async def test_a_state_acts_at_once_from_readings_and_from_requests(client, app):
    adopt(app, SPEED)
    await stored(client, reading(START, 25.5, state={"spindle_rpm": 8000.0}))
    exx = by_code(await current(client))["EXX"]
    assert exx["errors_um"] == pytest.approx([8.0, 13.5, 35.5])
    stated = {"temperatures_c": temperatures(25.5), "state": {"spindle_rpm": 2000}}
    exx = by_code((await client.post(f"{ROOM}/compensation", json=stated)).json())["EXX"]
    assert exx["errors_um"] == pytest.approx([2.0, 7.5, 29.5])
    del stated["state"]
    document = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    assert document["complete"] is False
    assert "no state spindle_rpm" in document["warnings"][0]
    own = {"component": "EXX", "position_mm": 100}
    said = await predicted(client, own, own | {"state": {"spindle_rpm": 0}})
    assert said["predicted_um"] == pytest.approx([13.5, 5.5])


async def test_a_state_counts_for_as_long_as_a_reading(client, app, clock):
    adopt(app, SPEED)
    await stored(client, reading(START, 25.5, state={"spindle_rpm": 8000.0}))
    later = START + timedelta(seconds=120)
    clock.advance(121)
    await stored(client, reading(later, 25.5))
    document = await current(client)
    assert document["complete"] is True
    assert by_code(document)["EXX"]["errors_um"][0] == pytest.approx(8.0)
    await stored(client, reading(later + timedelta(seconds=1), 25.5))
    assert (await current(client))["complete"] is False


async def test_a_late_state_is_filtered_while_it_stands(client, app):
    adopt(app, SPEED_LATE)
    readings = warm_up(100)
    await stored(client, readings)
    exx = by_code(await current(client))["EXX"]
    late = low_pass_by_steps(readings, lambda r: r["state"]["spindle_rpm"], 900.0)
    assert exx["errors_um"][0] == pytest.approx(0.001 * late, abs=1e-3)
    said = await predicted(client, {"component": "EXX", "position_mm": 0})
    assert said["predicted_um"] == pytest.approx(exx["errors_um"][:1], abs=5.1e-5)


async def test_a_reversal_gives_both_directions(client, app):
    adopt(app, BACKLASH)
    await stored(client, reading(START, 25.5))
    exx = by_code(await current(client))["EXX"]
    assert exx["errors_um"] == pytest.approx([1.5, 7.0, 29.0])
    assert exx["backward_errors_um"] == pytest.approx([-1.5, 4.0, 26.0])
    assert exx["backward_compensation_um"] == [-e for e in exx["backward_errors_um"]]
    asked = [{"component": "EXX", "position_mm": 100, "direction": d} for d in ("+", "-", None)]
    said = await predicted(client, *asked)
    assert said["predicted_um"] == pytest.approx([7.0, 4.0, 5.5])
    body = {"points_mm": [[100, 0, 0]], "missing_components": "zero"}
    for direction, expected in (("+", 7.0), ("-", 4.0)):
        answer = await client.post(f"{ROOM}/volumetric-error", json=body | {"direction": direction})
        assert answer.json()["errors_um"][0][0] == pytest.approx(expected)
        assert not any("reversal" in w for w in answer.json()["warnings"])
    document = (await client.post(f"{ROOM}/volumetric-error", json=body)).json()
    assert document["errors_um"][0][0] == pytest.approx(5.5)
    assert "the reversal of EXX is left out: no direction is stated" in document["warnings"]


async def test_a_sine_refines_the_positions(client, app):
    adopt(app, SINE)
    await stored(client, reading(START, 25.5))
    exx = by_code(await current(client))["EXX"]
    positions = np.array(exx["positions_mm"])
    assert positions.size > 16 * 25
    assert {0.0, 100.0, 500.0} <= set(exx["positions_mm"])
    expected = 5.5 * positions / 100.0 + 2.0 * np.sin(2.0 * np.pi * positions / 20.0)
    np.testing.assert_allclose(exx["errors_um"], expected, rtol=0, atol=5.1e-5)
    where = np.linspace(0.0, 500.0, 97)
    said = await predicted(client, *({"component": "EXX", "position_mm": x} for x in where))
    on_table = np.interp(where, positions, exx["errors_um"])
    np.testing.assert_allclose(said["predicted_um"], on_table, atol=0.02 * 2.0)


async def test_a_rotation_that_no_map_has_acts_through_the_lever(client, app):
    adopt(app, ROLL, SLOPE)
    await stored(client, reading(START, 25.5))
    document = await current(client)
    eax = by_code(document)["EAX"]
    assert eax["status"] == "effects-only"
    assert (eax["sensor"], eax["lower_map"], eax["weight"]) == (None, None, None)
    assert eax["positions_mm"] == [0.0, 500.0]
    assert eax["errors_urad"] == pytest.approx([3.0, 11.0])
    point, tool = [500.0, 100.0, 200.0], [0.0, 0.0, 150.0]
    body = {"points_mm": [point], "tool_offset_mm": tool, "missing_components": "zero"}
    answer = (await client.post(f"{ROOM}/volumetric-error", json=body)).json()
    assert "EAX" not in answer["counted_as_zero"]
    said = await predicted(client, {"point_mm": point, "tool_offset_mm": tool})
    assert answer["errors_um"][0] == pytest.approx(said["predicted_um"][0], abs=1e-9)
    grid = {"x_mm": [0, 500], "y_mm": [0, 100], "z_mm": [0, 200], "tool_offset_mm": tool}
    corner = (
        await client.post(f"{ROOM}/compensation/grid", json=grid | {"missing_components": "zero"})
    ).json()["errors_um"]
    assert corner[1][1][1] == pytest.approx(answer["errors_um"][0], abs=1e-9)
    await client.post(f"{ROOM}/models/3/activate")
    without = (await client.post(f"{ROOM}/volumetric-error", json=body)).json()
    assert "EAX" in without["counted_as_zero"]
    # XYFZ: the bed carries x, so a rotation of x turns the workpiece below the tool's tip.
    difference = np.subtract(answer["errors_um"][0], without["errors_um"][0])
    assert abs(difference[1]) > 1.0
    slope_um_per_m = 2.0 * (30.5 - 25.0)
    assert difference[0] == pytest.approx(slope_um_per_m * 0.2, rel=1e-6)


async def test_a_drift_goes_on_with_the_readings(client, app, clock):
    adopt(app, DRIFT)
    await stored(client, reading(START, 25.5))
    assert by_code(await current(client))["SXY"]["error_um_per_m"] == pytest.approx(-25.5 + 2.0)
    assert by_code(await current(client))["SXY"]["iso_error_urad"] == pytest.approx(25.5 - 2.0)
    clock.advance(86400)
    # What stands is the table at the latest reading: it does not move while no reading comes.
    assert by_code(await current(client))["SXY"]["error_um_per_m"] == pytest.approx(-25.5 + 2.0)
    stated = {"temperatures_c": temperatures(25.5)}
    for advance, expected in ((0, 4.0), (43200, 5.0)):
        clock.advance(advance)
        document = (await client.post(f"{ROOM}/compensation", json=stated)).json()
        assert by_code(document)["SXY"]["error_um_per_m"] == pytest.approx(-25.5 + expected)


# --- faulty sensors ------------------------------------------------------------------------


async def test_a_bias_is_taken_off_though_a_stand_in_could_serve(client, app):
    """y-front stands in for x-middle: it reads 1 °C less in every map."""
    adopt(app, fault("x-middle", ("EXX", "EBX", "SXY")))
    wrong = reading(START, 25.5)
    wrong["temperatures_c"]["x-middle"] += 1.5
    await stored(client, wrong)
    document = await current(client)
    exx = by_code(document)["EXX"]
    assert (exx["sensor"], exx["status"]) == ("x-middle", "interpolated")
    assert "stand_in_for" not in exx
    assert exx["errors_um"] == pytest.approx([0.0, 5.5, 27.5])
    assert exx["effects"] == ["sensor-fault"]
    assert document["effects"][0]["in_table"] is True
    assert {s["sensor"]: s["health"] for s in document["sensors"]}["x-middle"] == "ok"
    assert any("x-middle has read wrong by 1.5" in w for w in document["warnings"])
    assert any("the bias is taken off until" in w for w in document["warnings"])
    stated = {"temperatures_c": wrong["temperatures_c"]}
    same = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    assert same["components"] == document["components"]
    asked = {"component": "EXX", "position_mm": 500}
    said = await predicted(client, asked)
    assert (said["predicted_um"], said["status"]) == (pytest.approx([27.5]), ["interpolated"])
    before = START - timedelta(hours=2)
    await stored(client, reading(before, 25.5))
    said = await predicted(client, asked, time=before)
    assert said["status"] == ["interpolated"]


async def test_without_a_stand_in_the_bias_is_taken_off(client, app):
    adopt(app, fault("z-column", ("EZZ",)))
    wrong = reading(START, 25.5)
    wrong["temperatures_c"]["z-column"] += 1.5
    await stored(client, wrong)
    document = await current(client)
    ezz = by_code(document)["EZZ"]
    assert ezz["errors_um"] == pytest.approx([0.0, 5.5, 55.0])
    assert ezz["sensor"] == "z-column"
    assert ezz["effects"] == ["sensor-fault"]
    assert any("the bias is taken off" in w for w in document["warnings"])
    said = await predicted(client, {"component": "EZZ", "position_mm": 500})
    assert said["predicted_um"] == pytest.approx([55.0])


# --- everything else ------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["volumetric-accuracy", "compensation/levels", "picture"])
async def test_what_is_made_of_the_field_contains_effects(app, client, path):
    body = {"temperatures_c": temperatures(25.5), "missing_components": "zero"}
    before = await client.post(f"{ROOM}/{path}", json=body)
    assert before.status_code == 200, before.text
    adopt(app, ROLL, SLOPE, OUTDATED)
    after = await client.post(f"{ROOM}/{path}", json=body)
    assert after.status_code == 200, after.text
    ignored = {"model_version", "counted_as_zero", "warnings", "complete", "computed_at"}
    first, second = (
        {name: value for name, value in answer.json().items() if name not in ignored}
        for answer in (before, after)
    )
    assert first != second


async def test_a_state_beside_questions_about_the_field(app, client):
    adopt(app, SPEED)
    body = {"points_mm": [[100, 0, 0]], "missing_components": "zero", "direction": "+"}
    stated = body | {"temperatures_c": temperatures(25.5)}
    answer = (await client.post(f"{ROOM}/volumetric-error", json=stated)).json()
    assert answer["complete"] is False
    assert any("no state spindle_rpm" in warning for warning in answer["warnings"])
    with_state = stated | {"state": {"spindle_rpm": 2000}}
    answer = (await client.post(f"{ROOM}/volumetric-error", json=with_state)).json()
    assert answer["errors_um"][0][0] == pytest.approx(5.5 + 2.0)
    await stored(client, reading(START, 25.5, state={"spindle_rpm": 8000.0}))
    for state, expected in (({}, 13.5), ({"spindle_rpm": 1000}, 6.5)):
        answer = await client.post(f"{ROOM}/volumetric-error", json=body | {"state": state})
        assert answer.json()["errors_um"][0][0] == pytest.approx(expected)
    several = stated | {"temperatures_c": [temperatures(25.5), temperatures(22.0)]}
    several |= {"state": {"spindle_rpm": 2000}}
    answer = (await client.post(f"{ROOM}/volumetric-error", json=several)).json()
    assert [rows[0][0] for rows in answer["errors_um"]] == pytest.approx([7.5, 4.0])


# --- outside what was learnt ----------------------------------------------------------------

DRIFT_S = START.timestamp() - 30 * 86400.0
OLD_DRIFT = learnt(
    Effect(
        "drift",
        ("EXX",),
        variant="since the first visit",
        parameters={"drift_um_per_day": 0.1},
        terms=(Term("EXX", SinceReference(DRIFT_S), Everywhere(), 0.1),),
    ),
    days=10.0,
    from_s=DRIFT_S,
    to_s=START.timestamp(),
    use_until_s=START.timestamp() + 10 * 86400.0,
)
FOLLOWS_SPINDLE = learnt(
    Effect(
        "other-sensor",
        ("EXX",),
        ("x-middle", "spindle"),
        parameters={"share": 1.0},
        terms=(
            Term(
                *("EXX", Always()),
                Exchange.of("spindle", {"Run #1": 25.0, "Run #3": 29.0, "Run #6": 35.0}),
            ),
        ),
    )
)


async def test_a_drift_is_not_continued_for_months_in_anything_that_is_given_out(
    client, app, clock
):
    """Three hundred days after it was last observed, 30 days' worth of it is all there is."""
    adopt(app, OLD_DRIFT)
    await stored(client, reading(START, 25.5))
    assert (await current(client))["complete"] is True
    clock.advance(300 * 86400)
    await stored(client, reading(clock(), 25.5))
    stated = {"temperatures_c": temperatures(25.5)}
    answer = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    for document in (await current(client), answer):
        exx = by_code(document)["EXX"]
        assert exx["errors_um"] == pytest.approx([3.0, 8.5, 30.5])
        assert exx["status"] == "held"
        assert by_code(document)["EZZ"]["status"] == "interpolated"
        assert document["complete"] is False
        (effect,) = document["effects"]
        (warning,) = document["warnings"]
        assert effect["held"] == [warning]
        assert "may be used until 2026-03-11" in warning
        assert effect["valid"]["use_until"] == "2026-03-11T06:00:00Z"
        assert "Measure EXX again" in effect["measure_again"]
    point = {"points_mm": [[100, 0, 0]], "missing_components": "zero", **stated}
    field = (await client.post(f"{ROOM}/volumetric-error", json=point)).json()
    assert field["complete"] is False
    assert field["errors_um"][0][0] == pytest.approx(8.5)
    assert any("drift of EXX is held" in w for w in field["warnings"])
    said = await predicted(client, {"component": "EXX", "position_mm": 100}, time=clock())
    assert said["predicted_um"] == pytest.approx([8.5])
    assert said["status"] == ["held"]
    assert any("drift of EXX is held" in w for w in said["warnings"])


async def test_a_state_far_beyond_what_was_learnt_is_held_and_said(client, app):
    adopt(app, SPEED)
    stated = {"temperatures_c": temperatures(25.5), "state": {"spindle_rpm": 1e6}}
    document = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    assert by_code(document)["EXX"]["errors_um"] == pytest.approx([12.0, 17.5, 39.5])
    assert by_code(document)["EXX"]["status"] == "held"
    assert document["complete"] is False
    await stored(client, reading(START, 25.5))
    at_once = {"component": "EXX", "position_mm": 0}
    said = await predicted(
        client, *(at_once | {"state": {"spindle_rpm": rpm}} for rpm in (12_000, 1e6))
    )
    assert said["predicted_um"] == pytest.approx([12.0, 12.0])
    assert said["status"] == ["interpolated", "held"]


async def test_effects_that_were_adopted_before_ranges_were_kept_say_so(client, app):
    adopt(app, replace(SPEED, valid=None))
    await stored(client, reading(START, 25.5, state={"spindle_rpm": 1000.0}))
    document = await current(client)
    assert by_code(document)["EXX"]["errors_um"][0] == pytest.approx(1.0)
    assert document["complete"] is False
    assert "is not known" in document["warnings"][0]
    assert document["effects"][0]["valid"] is None
    said = await predicted(client, {"component": "EXX", "position_mm": 0})
    assert any("is not known" in w for w in said["warnings"])
    models = (await client.get(f"{ROOM}/models")).json()
    assert models[-1]["effects"][0]["valid"] is None


async def test_the_row_names_the_sensor_that_it_now_follows(client, app):
    """The spindle at 32 °C is half way from Run #3 to Run #6; x-middle is at Run #1."""
    adopt(app, FOLLOWS_SPINDLE)
    stated = {"temperatures_c": temperatures(20.0) | {"spindle": 32.0}}
    document = (await client.post(f"{ROOM}/compensation", json=stated)).json()
    exx = by_code(document)["EXX"]
    assert exx["errors_um"] == pytest.approx([0.0, 7.0, 35.0])
    assert (exx["sensor"], exx["temperature_c"]) == ("spindle", 32.0)
    assert (exx["lower_map"], exx["upper_map"]) == ("Run #3", "Run #6")
    assert exx["weight"] == pytest.approx(0.5)
    assert exx["status"] == "interpolated"
    assert exx["follows"] == [{"sensor": "spindle", "temperature_c": 32.0, "share": 1.0}]
    assert by_code(document)["EBX"]["sensor"] == "x-middle"
    assert "follows" not in by_code(document)["EBX"]
    assert document["complete"] is True
    view = Console(width=120, record=True, file=StringIO())
    view.print(table_view(CompensationAnswer.model_validate(document), 120))
    assert "spindle 32.00 °C, Run #3 to Run #6, weight 0.50, interpolated" in view.export_text()

"""Of every kind of effect: the live table, the prediction and the training column agree."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from app.compensation.table import compensation_table
from app.compensation.table_field import table_field
from app.effects.adopted.in_table import add_effects, faulty_marked
from app.effects.adopted.prediction import AskedPlaces, predict_with_effects
from app.effects.conditions import Conditions, recorded_conditions
from app.effects.driver import Always, State, StepAfter
from app.effects.effect import Effect, effect_from_json
from app.effects.hypothesis import Estimate
from app.effects.observations import POINT_CHANNELS
from app.effects.past import needed_past
from app.effects.projection import sum_of_terms
from app.effects.shape import Everywhere, Sensitivity
from app.effects.term import Term
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.identification.residuals.residuals import compute_residuals
from app.thermal.compile_model import compile_model
from app.thermal.machine import sensors_by_name
from app.thermal.sensor_health import Health, SensorState
from tests.effects.example_campaign_view import (
    ASSIGNMENT,
    START_S,
    example_view,
    machine,
    maps,
    readings,
)
from tests.effects.test_effects_all_kinds import (
    EACH,
    example,
    fitted,
    hypotheses,
    moment_of,
)

NOW = datetime(2026, 3, 2, tzinfo=UTC)


def table_of(model, effects, moment):
    """The table as the service makes it."""
    sensors = [
        SensorState(name, Health.OK, float(t[0])) for name, t in moment.temperatures_c.items()
    ]
    marked = faulty_marked(model, effects, moment, sensors)
    plain = compensation_table(model, 1, marked, NOW)
    return add_effects(plain, model, effects, moment) if effects else plain


def in_table(table, rows, row):
    """Read one row's value off a table or its field."""
    channel = rows.channels[rows.channel[row]]
    if channel in POINT_CHANNELS:
        field = table_field(example().model, [table], tuple(int(d) for d in rows.directions[row]))
        errors, _ = field.at(rows.points_mm[row], rows.tool_offsets_mm[row])
        return errors[0, POINT_CHANNELS.index(channel)]
    (entry,) = [e for e in table.components if e.component.code == channel]
    axis = COMPONENTS[channel].axis
    if axis is None:
        return entry.errors[0]
    along = "xyz".index(axis)
    backward = entry.errors if entry.backward_errors is None else entry.backward_errors
    errors = entry.errors if rows.directions[row, along] > 0 else backward
    return np.interp(rows.points_mm[row, along], entry.positions_mm, errors)


def prediction(model, effects, rows, row, conditions):
    channel = rows.channels[rows.channel[row]]
    at_point = channel in POINT_CHANNELS
    places = AskedPlaces(
        None if at_point else channel,
        rows.points_mm[[row]],
        rows.tool_offsets_mm[[row]],
        rows.directions[[row]],
    )
    found = predict_with_effects(model, effects, places, conditions.take(np.array([row])))
    assert not found.missing
    return found.values[0, POINT_CHANNELS.index(channel)] if at_point else found.values[0]


@pytest.mark.parametrize("each", EACH)
def test_table_prediction_and_training_agree(each):
    effect, own = fitted(each), example()
    trained = sum_of_terms(own.projection, effect.terms)
    moved = np.flatnonzero(trained)
    chosen = np.random.default_rng(11).choice(moved, size=min(5, moved.size), replace=False)
    for row in chosen.tolist():
        moment = moment_of(row)
        without = in_table(table_of(own.model, [], moment), own.rows, row)
        table = table_of(own.model, [effect], moment)
        assert [e.missing for e in table.effects] == [""]
        lost = (0.02 if effect.kind == "periodic" else 1e-9) * np.abs(trained).max()
        live = in_table(table, own.rows, row) - without
        assert live == pytest.approx(trained[row], abs=lost)
        plain = prediction(own.model, [], own.rows, row, own.conditions)
        with_effect = prediction(own.model, [effect], own.rows, row, own.conditions)
        assert plain == pytest.approx(without, abs=1e-9)
        assert with_effect - plain == pytest.approx(trained[row], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("each", EACH)
def test_the_table_says_which_effects_are_in_which_component(each):
    effect = fitted(each)
    table = table_of(example().model, [effect], moment_of(100))
    said = {e.component.code: e.effects for e in table.components}
    assert {code for code, kinds in said.items() if kinds} == set(effect.components)
    assert set(said[effect.components[0]]) == {effect.kind}
    for entry in table.corrected:
        assert entry.standard_errors is None


def test_standard_errors_stay_where_no_effect_is():
    """And go where one is: the maps do not know how sure an effect is."""
    shift = Effect("outdated-map", ("EXX",), variant="shift", parameters={"shift_um": 1.0})
    shift = replace(shift, terms=(Term("EXX", Always(), Everywhere(), 1.0),))
    own = [replace(m, tables={**m.tables, **_with_errors(m)}) for m in maps()]
    model = compile_model(machine(), own, ASSIGNMENT)
    found = {e.component.code: e for e in table_of(model, [shift], moment_of(100)).components}
    assert found["EXX"].standard_errors is None
    assert found["EYX"].standard_errors is not None


def _with_errors(error_map):
    return {
        code: replace(error_map.tables[code], covariance=np.full(5, 0.25))
        for code in ("EXX", "EYX")
    }


def test_several_tables_make_one_field():
    """One state lacks an effect: its numbers stand beside those that have it."""
    own = example()
    roll = Effect("angular", ("EAX",), parameters={"angle_urad": 5.0}, variant="constant")
    roll = replace(roll, terms=(Term("EAX", State("spindle_rpm"), Everywhere(), 0.001),))
    with_speed, without = moment_of(200), replace(moment_of(200), states={})
    tables = [table_of(own.model, [roll], moment) for moment in (with_speed, without)]
    points, tool = [[100.0, 200.0, 300.0], [400.0, 100.0, 50.0]], (0.0, 0.0, 150.0)
    both, _ = table_field(own.model, tables).at(points, tool)
    for i, table in enumerate(tables):
        alone, _ = table_field(own.model, [table]).at(points, tool)
        np.testing.assert_allclose(both[i], alone, atol=1e-12)


# --- faulty sensors ------------------------------------------------------------------------


def with_stand_in():
    """The example machine, where y-front stands in for x-middle."""
    sensors = list(machine().sensors.values())
    sensors[0] = replace(sensors[0], stand_in="y-front")
    return compile_model(replace(machine(), sensors=sensors_by_name(sensors)), maps(), ASSIGNMENT)


def fault(codes=("EXX", "EYX", "EYY")):
    since_s = START_S + 2 * 86400.0
    term = (StepAfter(since_s), Sensitivity(is_local=True), -2.0)
    return Effect(
        "sensor-fault",
        codes,
        ("x-middle",),
        variant="bias",
        parameters={"bias_k": 2.0, "changed_at_unix_s": since_s},
        terms=tuple(Term(code, *term) for code in codes),
    )


def stuck():
    """The same sensor, which tells no temperature: its effect adds nothing."""
    terms = tuple(replace(term, coefficient=0.0) for term in fault().terms)
    parameters = fault().parameters | {"lasted_h": 9.0}
    return replace(fault(), variant="stuck", parameters=parameters, terms=terms)


def test_a_bias_is_taken_off_though_a_stand_in_could_serve():
    """What was found is E(T - bias), and no visit has tested what the stand-in would say."""
    model, own = with_stand_in(), example_view()
    rows, conditions = own.rows, own.conditions
    since_s = START_S + 2 * 86400.0
    after = conditions.times_s >= since_s
    exx = rows.of_channel("EXX")
    term = (StepAfter(since_s, height=-2.0), Sensitivity(is_local=False))
    bias = replace(fault(), terms=tuple(Term(code, *term) for code in fault().components))
    found = compute_residuals(model, rows, conditions, [bias])
    plain = compute_residuals(model, rows, conditions)
    assert (found.kept == plain.kept).all()
    np.testing.assert_allclose(
        found.predicted - plain.predicted,
        sum_of_terms(found.projection, bias.terms),
        atol=1e-9,
    )
    for row in exx[::5].tolist():
        t_c = conditions.temperature("x-middle")[row] - 2.0 * after[row]
        expected = (min(max(t_c, 20.0), 30.0) - 20.0) * rows.points_mm[row, 0] / 500.0
        value = prediction(model, [bias], rows, row, conditions)
        assert value == pytest.approx(expected, abs=1e-9)
        table = table_of(model, [bias], moment_of(row))
        assert in_table(table, rows, row) == pytest.approx(value, abs=1e-9)
        (entry,) = [e for e in table.components if e.component.code == "EXX"]
        assert entry.basis.stand_in_for is None


def test_a_stand_in_serves_tables_predictions_and_residuals_from_the_fault_on():
    model, own = with_stand_in(), example_view()
    rows, conditions = own.rows, own.conditions
    after = conditions.times_s >= START_S + 2 * 86400.0
    exx = rows.of_channel("EXX")
    for row in exx[::5].tolist():
        value = prediction(model, [stuck()], rows, row, conditions)
        sensor, offset = ("y-front", 1.0) if after[row] else ("x-middle", 0.0)
        t_c = conditions.temperature(sensor)[row] + offset
        # EXX grows by 1 µm/K at the end of travel; at y-front's own temperatures of the maps.
        expected = (min(max(t_c, 20.0), 30.0) - 20.0) * rows.points_mm[row, 0] / 500.0
        assert value == pytest.approx(expected, abs=1e-9)
        table = table_of(model, [stuck()], moment_of(row))
        (entry,) = [e for e in table.components if e.component.code == "EXX"]
        assert entry.effects == ("sensor-fault",)
        assert (entry.basis.stand_in_for == "x-middle") == after[row]
        assert in_table(table, rows, row) == pytest.approx(value, abs=1e-9)
    predicted = compute_residuals(model, rows, conditions, [stuck()])
    kept = np.flatnonzero(predicted.kept).tolist()
    for row in exx[::5].tolist():
        if row in kept:
            value = prediction(model, [stuck()], rows, row, conditions)
            assert predicted.predicted[kept.index(row)] == pytest.approx(value, abs=1e-9)


def test_where_the_stand_in_is_silent_the_bias_is_taken_off():
    model, moment = with_stand_in(), moment_of(len(example().rows) - 1)
    alone = replace(
        moment,
        temperatures_c={s: t for s, t in moment.temperatures_c.items() if s != "y-front"},
    )
    table = table_of(model, [fault()], alone)
    (entry,) = [e for e in table.components if e.component.code == "EXX"]
    t_c = float(alone.temperatures_c["x-middle"][0])
    assert entry.errors[-1] == pytest.approx(t_c - 2.0 - 20.0, abs=1e-9)
    assert any("the bias is taken off" in warning for warning in table.warnings)


@pytest.mark.parametrize("variant", ["bias", "stuck"])
def test_a_fault_is_set_aside_though_its_sensor_is_silent(variant):
    """Unplugged, or judged stuck by itself: the stand-in serves, and nothing is lacking."""
    model, moment = with_stand_in(), moment_of(len(example().rows) - 1)
    temperatures_c = {s: t for s, t in moment.temperatures_c.items() if s != "x-middle"}
    silent = replace(moment, temperatures_c=temperatures_c)
    effect = replace(fault(), variant=variant, parameters=fault().parameters | {"lasted_h": 9.0})
    sensors = [SensorState(s, Health.OK, float(t[0])) for s, t in temperatures_c.items()]
    sensors.append(SensorState("x-middle", Health.STUCK, detail="x-middle is stuck"))
    marked = faulty_marked(model, [effect], silent, sensors)
    assert marked == sensors
    table = add_effects(compensation_table(model, 1, marked, NOW), model, [effect], silent)
    assert table.complete
    assert [e.missing for e in table.effects] == [""]
    assert table.warnings == [
        "x-middle is stuck",
        "y-front stands in for x-middle: EXX, EYX, EYY, SXY",
    ]


def test_only_a_bias_is_taken_off():
    model, moment = example().model, moment_of(len(example().rows) - 1)
    spikes = replace(
        fault(),
        variant="spikes",
        parameters=fault().parameters | {"spike_k": 4.0, "share": 0.03},
        terms=tuple(replace(term, coefficient=0.0) for term in fault().terms),
    )
    (warning,) = table_of(model, [spikes], moment).warnings
    assert warning.endswith("no other sensor can stand in, so it is used as it is")
    warning = table_of(model, [fault()], moment).warnings[-1]
    assert warning.endswith(": the bias is taken off until the sensor is repaired")


@pytest.mark.parametrize(
    ("code", "sensor", "read_c", "bias_k", "error"),
    [
        ("EXX", "x-middle", 27.0, 2.0, 5.0),
        ("EXX", "x-middle", 33.0, 5.0, 8.0),  # from beyond the maps back into them
        ("EZZ", "z-column", 27.0, 3.0, 4.0),  # 12 µm at 27 °C, across the map at 26 °C
        ("EZZ", "z-column", 24.0, -3.0, 12.0),
    ],
)
def test_a_bias_that_was_found_moves_the_temperature(code, sensor, read_c, bias_k, error):
    """EXX 1 µm/K from 20 °C of x-middle; EZZ 2 µm/K from 22 °C of z-column, 4 from 26 °C."""
    since_s = START_S - 3600.0
    own = (h for h in hypotheses().values() if h.kind == "sensor-fault" and h.sensors == (sensor,))
    effect = next(own).fitted(Estimate(since_s, None, np.array([-bias_k]), np.eye(1)))
    assert effect.parameters["bias_k"] == bias_k
    temperatures_c = {"x-middle": 22.0, "y-front": 21.0, "z-column": 24.0, "spindle": 34.0}
    moment = Conditions.of_moment(START_S, temperatures_c | {sensor: read_c})
    (entry,) = [
        e
        for e in table_of(example().model, [effect], moment).components
        if e.component.code == code
    ]
    assert entry.errors[-1] == pytest.approx(error)


def test_a_bias_that_was_stored_as_a_slope_is_read_as_it_was():
    stored = fault().to_json()
    for term in stored["terms"]:
        term["driver"].pop("height")
    assert effect_from_json(stored) == fault()


def test_a_component_of_effects_alone_can_be_measured_again():
    """A level measures the rotation itself that points have shown: it is held against it."""
    model, own = example().model, example_view(False)
    roll = Effect("angular", ("EAX",), parameters={"angle_urad": 5.0}, variant="constant")
    roll = replace(roll, terms=(Term("EAX", Always(), Everywhere(), 5.0),))
    channels = tuple("EAX" if c == "EXX" else c for c in own.rows.channels)
    rows = replace(own.rows, channels=channels)
    found = compute_residuals(model, rows, own.conditions, [roll])
    chosen = rows.of_channel("EAX")
    assert found.kept[chosen].sum() > chosen.size / 2
    assert set(found.predicted[found.rows.of_channel("EAX")]) == {5.0}
    without = compute_residuals(model, rows, own.conditions)
    assert not without.kept[chosen].any()


# --- what is missing -----------------------------------------------------------------------


def test_predictions_that_lack_an_effect_say_so_one_by_one():
    """The first hours have no five time constants of history."""
    model = example().model
    lag = fitted("thermal-lag|")
    tau_s = max(tau for _, tau in needed_past([lag]).lags)
    history, states = readings()
    times = START_S + np.array([4.9, 5.1]) * tau_s
    conditions = recorded_conditions(model.machine.sensors, history, states, times)
    code = lag.components[0]
    places = AskedPlaces(code, np.full((2, 3), 300.0), np.zeros((2, 3)), np.zeros((2, 3)))
    found = predict_with_effects(model, [lag], places, conditions)
    assert found.status == ["effect-missing", "interpolated"]
    assert np.isfinite(found.values).all()
    plain = predict_with_effects(model, [], places, conditions)
    assert found.values[0] == plain.values[0]
    assert found.values[1] != plain.values[1]
    assert "(1 values)" in found.missing[0].reason


def test_a_component_of_effects_alone_is_predicted_and_any_other_refused():
    model, conditions = example().model, example().conditions.take(np.arange(2))
    roll = Effect("angular", ("EAX",), parameters={"angle_urad": 5.0}, variant="constant")
    roll = replace(roll, terms=(Term("EAX", Always(), Everywhere(), 5.0),))
    somewhere = (np.full((2, 3), 300.0), np.zeros((2, 3)), np.zeros((2, 3)))
    found = predict_with_effects(model, [roll], AskedPlaces("EAX", *somewhere), conditions)
    assert (found.values.tolist(), found.status) == ([5.0, 5.0], ["effects-only"] * 2)
    with pytest.raises(InvalidContent, match="got EBX"):
        predict_with_effects(model, [roll], AskedPlaces("EBX", *somewhere), conditions)


def test_a_fault_that_the_readings_show_is_told_and_adds_nothing():
    """Readings that cannot be believed are left out by themselves."""
    stuck = Effect(
        "sensor-fault",
        ("EXX",),
        ("x-middle",),
        variant="stuck",
        parameters={"changed_at_unix_s": START_S, "lasted_h": 5.0},
    )
    model, moment = with_stand_in(), moment_of(100)
    table, plain = table_of(model, [stuck], moment), table_of(model, [], moment)
    assert (table.complete, table.corrected, table.warnings) == (True, [], plain.warnings)
    assert "x-middle was stuck for 5 h" in table.effects[0].explanation

"""Outside the range in which it was learnt, an effect is held at the edge, and that is said."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.compensation.table import compensation_table
from app.effects.adopted.contributions import contributions
from app.effects.adopted.in_table import add_effects
from app.effects.adopted.learnt_ranges import AGAIN, growths, limited_in_time, with_ranges
from app.effects.adopted.live_effects import corrected_tables
from app.effects.adopted.live_lags import LiveLags
from app.effects.adopted.prediction import AskedPlaces, predict_with_effects
from app.effects.conditions import Conditions, Signal
from app.effects.driver import (
    Always,
    Behind,
    BeyondMaps,
    Difference,
    SinceReference,
    State,
    StepAfter,
)
from app.effects.effect import Effect, effect_from_json
from app.effects.low_pass import LagState
from app.effects.projection import sum_of_terms
from app.effects.shape import Everywhere, Exchange, Places, Rising, Sensitivity, Wave
from app.effects.term import Term
from app.effects.valid import DRIVER_MARGIN, POSITION_MARGIN, Valid
from app.errors import OutsideMaps
from app.thermal.compile_model import compile_model
from app.thermal.machine import OutOfRange
from app.thermal.sensor_health import Health, SensorState
from app.units import SECONDS_PER_DAY
from tests.effect_examples import as_stored, read_back
from tests.effects.example_campaign_view import ASSIGNMENT, START_S, machine, maps
from tests.effects.test_effects_all_kinds import EACH, MOVED, example, fitted, moment_of

NOW = datetime(2026, 3, 2, tzinfo=UTC)
TEMPERATURES = {"x-middle": 22.0, "y-front": 21.0, "z-column": 24.0, "spindle": 34.0}
MONTH_S = 30 * SECONDS_PER_DAY
SPEEDS = (0.0, 12_000.0)


def valid(**ranges):
    return Valid(**{"from_s": START_S, "to_s": START_S + MONTH_S} | ranges)


def speed(**ranges):
    """EXX grows by 4 µm at 12,000 rpm, the same everywhere."""
    return Effect(
        "state-variable",
        ("EXX",),
        states=("spindle_rpm",),
        variant="at once",
        parameters={"slope_um_per_spindle_rpm": 4.0 / 12_000.0},
        terms=(Term("EXX", State("spindle_rpm"), Everywhere(), 4.0 / 12_000.0),),
        valid=valid(state={"spindle_rpm": SPEEDS}, **ranges),
    )


def drift(days=20.0):
    """EYX drifts by 0.1 µm a day from the beginning on; it may be used for some days more."""
    return Effect(
        "drift",
        ("EYX",),
        variant="since the first visit",
        parameters={"drift_um_per_day": 0.1},
        terms=(Term("EYX", SinceReference(START_S), Everywhere(), 0.1),),
        valid=valid(use_until_s=START_S + MONTH_S + days * SECONDS_PER_DAY),
    )


def sensor_states(temperatures_c):
    return [SensorState(name, Health.OK, t) for name, t in temperatures_c.items()]


def table_of(effects, temperatures_c=None, time_s=START_S, states=None, lags=None, **policies):
    temperatures_c = TEMPERATURES | (temperatures_c or {})
    model = compile_model(machine(**policies), maps(), ASSIGNMENT)
    plain = compensation_table(model, 1, sensor_states(temperatures_c), NOW)
    moment = Conditions.of_moment(time_s, temperatures_c, states, lags)
    return add_effects(plain, model, effects, moment)


def row_of(table, code):
    (entry,) = [e for e in table.components if e.component.code == code]
    return entry


# --- what issue it came from: an effect far outside where it was learnt ---------------------


def test_a_drift_of_thirty_days_does_not_go_on_for_ten_months():
    """292 days later it said +36 µm more than was ever seen, and called itself complete."""
    at_the_end = row_of(table_of([drift()], time_s=START_S + MONTH_S), "EYX").errors
    table = table_of([drift()], time_s=START_S + MONTH_S + 292 * SECONDS_PER_DAY)
    entry = row_of(table, "EYX")
    assert entry.errors.tolist() == at_the_end.tolist()
    assert entry.basis.status == "held"
    assert table.complete is False
    assert table.warnings == [
        "drift of EYX is held at its value of 2026-03-31 00:00 UTC, when it was last observed, and "
        "may be used until 2026-04-20 00:00 UTC; this is for 2027-01-17 00:00 UTC: measure EYX "
        "again, and analyse again"
    ]
    assert table.effects[0].held == table.warnings
    assert table.effects[0].measure_again.startswith(
        "The drift of EYX is not continued beyond its last observation at 2026-03-31 00:00 UTC. "
        "It may be used until 2026-04-20 00:00 UTC"
    )


def test_until_its_time_a_drift_is_complete_and_stands_still():
    table = table_of([drift()], time_s=START_S + MONTH_S + 20 * SECONDS_PER_DAY)
    assert table.complete is True
    assert table.warnings == []
    entry = row_of(table, "EYX")
    assert entry.basis.status == "interpolated"
    # 0.1 µm/day for 30 days beside what the maps say at the home position.
    assert entry.errors[0] == pytest.approx(3.0, abs=1e-12)


def test_before_it_was_learnt_a_drift_is_held_too():
    table = table_of([drift()], time_s=START_S - 21 * SECONDS_PER_DAY)
    assert row_of(table, "EYX").errors[0] == pytest.approx(0.0, abs=1e-12)
    assert row_of(table, "EYX").basis.status == "held"
    assert "held at its value of 2026-03-01 00:00 UTC, when it was first" in table.warnings[0]
    near = table_of([drift()], time_s=START_S - 19 * SECONDS_PER_DAY)
    assert near.complete is True


def test_a_million_turns_are_not_what_was_learnt_up_to_twelve_thousand():
    """It said +403 µm with the status `interpolated`."""
    at_the_edge = row_of(table_of([speed()], states={"spindle_rpm": 12_000.0}), "EXX").errors
    table = table_of([speed()], states={"spindle_rpm": 1e6})
    entry = row_of(table, "EXX")
    assert entry.errors.tolist() == at_the_edge.tolist()
    assert entry.basis.status == "held"
    assert row_of(table, "EYX").basis.status == "interpolated"
    assert table.complete is False
    assert table.warnings == [
        "state-variable of EXX is held at the edge of where it was learnt: spindle_rpm is 1e+06 "
        "1/min, learnt from 0 to 12000 1/min"
    ]


@pytest.mark.parametrize(("beyond", "is_held"), [(0.9, False), (1.1, True)])
def test_nobody_cries_wolf_within_the_margin(beyond, is_held):
    rpm = SPEEDS[1] * (1.0 + beyond * DRIVER_MARGIN)
    table = table_of([speed()], states={"spindle_rpm": rpm})
    assert (row_of(table, "EXX").basis.status == "held") is is_held
    assert table.complete is not is_held


@pytest.mark.parametrize(("t_c", "is_held"), [(25.04, False), (25.06, True)])
def test_a_temperature_counts_from_its_sensors_resolution_on(t_c, is_held):
    """The example's sensors resolve 0.05 °C."""
    own = Effect(
        "sensor-fault",
        ("EXX",),
        ("x-middle",),
        variant="bias",
        parameters={"bias_k": 1.0, "changed_at_unix_s": START_S},
        terms=(Term("EXX", StepAfter(START_S, -1.0), Sensitivity(is_local=False)),),
        valid=valid(temperatures_c={"x-middle": (21.0, 25.0)}),
    )
    table = table_of([own], {"x-middle": t_c})
    assert (row_of(table, "EXX").basis.status == "held") is is_held
    if is_held:
        assert "x-middle is 25.06 °C, learnt from 21 to 25 °C" in table.warnings[0]


def test_what_the_maps_have_to_say_goes_first_and_both_are_said():
    table = table_of([speed()], {"x-middle": 33.0}, states={"spindle_rpm": 1e6})
    assert row_of(table, "EXX").basis.status == "clamped"
    assert row_of(table, "EYX").basis.status == "clamped"
    assert table.complete is False
    assert any("outside the maps: EXX" in w for w in table.warnings)
    assert any("state-variable of EXX is held" in w for w in table.warnings)


def test_beyond_the_positions_a_line_does_not_rise_on():
    """Learnt from 100 to 300 mm: 5 % of the span more, then it stays; the table has the bend."""
    along = Effect(
        "outdated-map",
        ("EXX",),
        variant="slope",
        parameters={"slope_at_end_um": 5.0},
        terms=(Term("EXX", Always(), Rising(250.0, 250.0), 5.0),),
        valid=valid(positions_mm={"EXX": (100.0, 300.0)}),
    )
    table = table_of([along])
    entry = row_of(table, "EXX")
    assert {90.0, 310.0} <= set(entry.positions_mm.tolist())
    added = np.interp(entry.positions_mm, [0.0, 500.0], [0.0, 2.0])  # the maps at 22 °C
    expected = (np.clip(entry.positions_mm, 90.0, 310.0) - 250.0) / 50.0
    np.testing.assert_allclose(entry.errors - added, expected, atol=1e-12)
    assert entry.basis.status == "held"
    assert table.warnings == [
        "outdated-map of EXX is held at the edge of where it was learnt: positions of EXX reach "
        "500 mm, learnt from 100 to 300 mm"
    ]


def test_what_is_the_same_everywhere_is_not_held_along_the_axis():
    ranges = {"positions_mm": {"EXX": (200.0, 210.0)}}
    assert table_of([speed(**ranges)], states={"spindle_rpm": 100.0}).complete is True


def test_a_lag_is_held_where_the_sensor_is_further_behind_than_it_was_learnt():
    behind = Term("EXX", Behind("x-middle", 600.0), Sensitivity(is_local=False), learnt=(-1.0, 0.5))
    lag = Effect(
        "thermal-lag",
        ("EXX",),
        ("x-middle",),
        parameters={"time_constant_min": 10.0, "share": 1.0},
        terms=(behind,),
        valid=valid(temperatures_c={"x-middle": (20.0, 30.0)}),
    )
    signal = Signal("temperature", "x-middle")

    def at(late_c):
        state = LagState(600.0, START_S - 1e5, START_S, late_c, late_c)
        return table_of([lag], {"x-middle": 26.0}, lags=LiveLags({(signal, 600.0): state}))

    # EXX is 1 µm/K at the end of travel.
    assert row_of(at(25.5), "EXX").errors[-1] == pytest.approx(5.5)
    assert at(25.5).complete is True
    assert row_of(at(22.0), "EXX").errors[-1] == pytest.approx(5.0)
    assert at(22.0).warnings == [
        "thermal-lag of EXX is held at the edge of where it was learnt: x-middle 10 min late minus "
        "x-middle is -4 K, learnt from -1 to 0.5 K"
    ]


def test_a_difference_that_was_seen_is_not_held_though_both_sensors_are_warmer():
    """It is said all the same: nobody has measured there."""
    driver = Difference("spindle", "x-middle", 10.0)
    bend = Effect(
        "sensor-gradient",
        ("EXX",),
        ("spindle", "x-middle"),
        parameters={"slope_um_per_k": 1.0},
        terms=(Term("EXX", driver, Everywhere(), 1.0, learnt=(-2.0, 3.0)),),
        valid=valid(temperatures_c={"spindle": (28.0, 35.0), "x-middle": (20.0, 25.0)}),
    )
    table = table_of([bend], {"spindle": 40.0, "x-middle": 29.0})
    # The maps' EXX is 0 at home, 40 − 29 − 10 = 1 K.
    assert row_of(table, "EXX").errors[0] == pytest.approx(1.0)
    assert row_of(table, "EXX").basis.status == "interpolated"
    assert table.complete is False
    assert table.effects[0].held == []
    assert (
        "sensor-gradient of EXX was not learnt here: x-middle is 29 °C, learnt from 20 to 25 °C; "
        "it depends on several signals together, so its value is left as it is"
    ) in table.warnings
    far = table_of([bend], {"spindle": 35.0, "x-middle": 20.0})
    assert row_of(far, "EXX").errors[0] == pytest.approx(3.0)
    assert "spindle minus x-middle is 15 K, learnt from 8 to 13 K" in far.warnings[0]


def test_effects_of_older_databases_load_and_say_that_their_range_is_not_known():
    stored = {k: v for k, v in speed().to_json().items() if k != "valid"}
    for term in stored["terms"]:
        del term["learnt"]
    old = effect_from_json(json.loads(json.dumps(stored)))
    assert old == replace(speed(), valid=None)
    table = table_of([old], states={"spindle_rpm": 6000.0})
    assert row_of(table, "EXX").errors[0] == pytest.approx(2.0)
    assert row_of(table, "EXX").basis.status == "interpolated"
    assert table.complete is False
    (warning,) = table.warnings
    assert "state-variable of EXX: the range in which it was learnt is not known" in warning
    assert "analyse" in warning
    assert table.effects[0].learnt_in is None


def test_predictions_are_held_where_and_only_where_it_is_outside():
    model = compile_model(machine(), maps(), ASSIGNMENT)
    rpm = np.array([6_000.0, 1e6, 12_000.0, np.nan])
    n = len(rpm)
    conditions = Conditions(
        np.full(n, START_S),
        {name: np.full(n, t) for name, t in TEMPERATURES.items()},
        {"spindle_rpm": rpm},
    )
    places = AskedPlaces("EXX", np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)))
    found = predict_with_effects(model, [speed()], places, conditions)
    assert found.values.tolist() == pytest.approx([2.0, 4.0, 4.0, 0.0])
    assert found.status == ["interpolated", "held", "interpolated", "effect-missing"]
    (remark,) = found.held
    assert "spindle_rpm is 1e+06 1/min" in remark.sentence
    assert "(1 values)" in remark.sentence
    at_points = predict_with_effects(model, [speed()], replace(places, component=None), conditions)
    assert at_points.status == found.status
    assert at_points.values[1].tolist() == at_points.values[2].tolist()


# --- what an analysis makes of its rows -----------------------------------------------------


@pytest.mark.parametrize("each", EACH)
def test_inside_what_was_learnt_nothing_changes_by_a_bit(each):
    own = example()
    use = np.ones(len(own.rows), dtype=bool)
    ranged = with_ranges(fitted(each), own.projection, use)
    raw = contributions(own.projection, [replace(ranged, valid=None)])
    found = contributions(own.projection, [ranged])
    assert found.errors.tobytes() == raw.errors.tobytes()
    np.testing.assert_allclose(found.errors, sum_of_terms(own.projection, ranged.terms), atol=1e-12)
    assert not found.is_held.any()
    # A temperature that is moved far lies beyond the maps, which is said as of any table.
    assert found.held == () or each in MOVED
    assert effect_from_json(json.loads(json.dumps(ranged.to_json(), allow_nan=False))) == ranged
    row = int(np.flatnonzero(raw.errors)[0])
    live, plain = (
        corrected_tables(own.model, [effect], moment_of(row))
        for effect in (ranged, replace(ranged, valid=None))
    )
    assert live.held == ()
    for one, other in zip(live.tables, plain.tables, strict=True):
        inside = np.isin(one.positions_mm, other.positions_mm)
        assert one.positions_mm.size == 0 or inside.any()


def test_ranges_are_those_of_the_rows_that_were_used_and_of_no_others():
    own = example()
    effect = fitted("state-variable|at once")
    (code,) = effect.components
    view = own.projection.view(code)
    use = np.zeros(len(own.rows), dtype=bool)
    use[view.rows[: view.rows.size // 3]] = True
    found = with_ranges(effect, own.projection, use).valid
    times = own.conditions.times_s[use]
    assert (found.from_s, found.to_s) == (times.min(), times.max())
    assert found.temperatures_c == {}
    speeds = own.conditions.state(effect.states[0])[use]
    assert found.state == {effect.states[0]: (speeds.min(), speeds.max())}
    at = view.places.positions_mm[: view.rows.size // 3]
    assert found.positions_mm.get(code, (0.0, 0.0)) == (
        (at.min(), at.max()) if np.isfinite(at).all() else (0.0, 0.0)
    )


def rows_with(effect, keep):
    """Say which of the example's rows of an effect's component satisfy something."""
    own = example()
    view = own.projection.view(effect.components[0])
    use = np.zeros(len(own.rows), dtype=bool)
    use[view.rows[keep(view.conditions)]] = True
    return use


@pytest.mark.parametrize("variant", ["between maps", "over all maps"])
def test_a_curvature_that_was_learnt_half_way_ends_at_the_next_map(variant):
    """Held where it was largest, it would be added to the map itself, which is right."""
    own = example()
    effect = fitted(f"temperature-curvature|{variant}")
    (sensor,) = effect.sensors
    scale = np.array(effect.terms[0].driver.temperatures_c)
    middle = float(scale[:2].mean())
    use = rows_with(effect, lambda at: np.abs(at.temperature(sensor) - middle) < 1.0)
    found = with_ranges(effect, own.projection, use)
    low, high = found.valid.temperatures_c[sensor]
    seen_c = own.projection.conditions.temperature(sensor)[use]
    assert (low, high) == (scale[0], scale[1 if variant == "between maps" else -1])
    assert low < seen_c.min()
    assert seen_c.max() < high
    term = found.terms[0]
    for t, is_there in ((low, False), (low - 5.0, False), (float(np.median(seen_c)), True)):
        moment = Conditions(np.array([START_S]), {sensor: np.array([t])})
        values = term.at(own.model, Places(np.array([100.0]), np.zeros(1)), moment, found.valid)
        assert bool(abs(values[0]) > 1e-9) is is_there


def test_what_is_beyond_the_maps_is_not_held_away_from_them():
    own = example()
    effect = fitted("additional-sensor|beyond the maps")
    driver = effect.terms[0].driver
    use = rows_with(effect, lambda at: driver.at(at) > 0.1)
    low, high = with_ranges(effect, own.projection, use).terms[0].learnt
    assert low == 0.0
    assert high == driver.at(own.projection.conditions)[use].max()


def test_a_lag_that_was_learnt_while_it_warmed_up_is_known_as_it_cools_down():
    own = example()
    effect = fitted("thermal-lag|")
    term = effect.terms[0]
    use = rows_with(effect, lambda at: term.driver.at(at) < -0.1)
    farthest = np.abs(term.driver.at(own.projection.conditions))[use].max()
    found = with_ranges(effect, own.projection, use)
    assert found.terms[0].learnt == (-farthest, farthest)


RANGED = {
    each: with_ranges(fitted(each), example().projection, np.ones(len(example().rows), dtype=bool))
    for each in EACH
}


def largest(effect, code):
    """The largest that a component's correction can be while all it is made of was seen."""
    found = 0.0
    ranges = effect.valid
    for term in (t for t in effect.terms if t.component == code):
        driver = term.driver
        if driver.grows_with_time:
            ends = [driver.at(Conditions(np.array([t]), {})) for t in (ranges.from_s, ranges.to_s)]
            most = float(np.abs(ends).max())
        elif term.learnt is not None:
            most = max(map(abs, term.learnt))
        else:
            most = abs(getattr(driver, "height", 1.0))
        found += abs(term.coefficient) * _height(term, ranges, code, most)
    return found


def _height(term, ranges, code, most):
    """The shape's largest value within its ranges, times the driver's."""
    if isinstance(term.shape, Sensitivity | Exchange):
        # No table of the example changes by more than 4 µm/K, and none lies above 32 µm.
        return 2.0 * 32.0 if isinstance(term.shape, Exchange) else 4.0 * most
    if not term.shape.changes_along:
        return most
    if isinstance(term.shape, Wave):
        return most
    low, high = ranges.edges_mm(code)
    at = np.linspace(low, high, 101)
    places = np.column_stack([at]).T[0]
    one = term.shape.along(None, code, _Places(places), None, np.ones(101))
    return most * float(np.abs(one).max())


class _Places:
    def __init__(self, positions_mm):
        self.positions_mm = positions_mm


@settings(max_examples=60, deadline=None)
@given(
    each=st.sampled_from(EACH),
    days=st.floats(-4000.0, 4000.0),
    temperatures_c=st.fixed_dictionaries({name: st.floats(-50.0, 150.0) for name in TEMPERATURES}),
    rpm=st.floats(-1e7, 1e7),
    late_c=st.floats(-50.0, 150.0),
)
def test_no_correction_is_ever_larger_than_within_what_was_learnt(
    each, days, temperatures_c, rpm, late_c
):
    effect, own = RANGED[each], example()
    needed = {key for t in effect.terms for key in t.driver.signals if key[1] is not None}
    time_s = START_S + days * SECONDS_PER_DAY
    lags = LiveLags(
        {
            (signal, tau): LagState(
                tau,
                time_s - 1e9,
                time_s,
                x := late_c if signal.kind == "temperature" else rpm**signal.power,
                x,
            )
            for signal, tau in needed
        }
    )
    states = {"spindle_rpm": rpm, "payload_kg": rpm}
    moment = Conditions.of_moment(time_s, temperatures_c, states, lags)
    found = corrected_tables(own.model, [effect], moment)
    for one in found.tables:
        most = largest(effect, one.component.code) * (1.0 + 1e-9) + 1e-9
        assert np.abs(one.errors).max() <= most
        assert one.backward_errors is None or np.abs(one.backward_errors).max() <= most


def test_growth_is_left_out_until_it_may_reach_the_scatter():
    """|slope| + 2 standard errors is 0.14 µm/day: 0.7 µm of scatter are reached in 5 days."""
    own = example()
    exx = own.rows.channels.index("EXX")
    terms = [[Term("EXX", SinceReference(START_S), Everywhere())]]
    ends = valid(to_s=START_S + MONTH_S, positions_mm={"EXX": (0.0, 500.0)})
    arguments = (np.array([-0.1]), np.array([[0.02**2]]), own.projection)
    limited = limited_in_time(ends, growths(ends, terms, *arguments, {exx: 0.7}))
    assert (limited.use_until_s - ends.to_s) / SECONDS_PER_DAY == pytest.approx(5.0)
    assert limited.continued_until_s is None
    step = [[Term("EXX", StepAfter(START_S), Everywhere())]]
    assert limited_in_time(ends, growths(ends, step, *arguments, {exx: 0.7})) == ends


@pytest.mark.parametrize(
    ("scatter", "continued", "until"),
    [
        # Two standard errors are 0.04 µm/day: 0.8 µm in two thirds of the thirty days; 0.1 µm are
        # left for what grows by 0.14 µm/day.
        (0.9, 20.0, 20.0 + 0.1 / 0.14),
        # 0.4 µm are reached in ten days.
        (0.4, 10.0, 10.0),
    ],
)
def test_a_growth_that_was_foretold_goes_on_while_its_error_is_small(scatter, continued, until):
    own = example()
    exx = own.rows.channels.index("EXX")
    terms = [[Term("EXX", SinceReference(START_S), Everywhere())]]
    ends = valid(to_s=START_S + 30 * SECONDS_PER_DAY, positions_mm={"EXX": (0.0, 500.0)})
    found = growths(
        ends, terms, np.array([-0.1]), np.array([[0.02**2]]), own.projection, {exx: scatter}
    )
    limited = limited_in_time(ends, found, goes_on=True)
    assert pytest.approx(2.0 / 3.0) == AGAIN
    for until_s, days in ((limited.continued_until_s, continued), (limited.use_until_s, until)):
        assert (until_s - ends.to_s) / SECONDS_PER_DAY == pytest.approx(days)
    again = read_back(Valid, as_stored(limited))
    assert again.continued_until_s == pytest.approx(limited.continued_until_s, abs=1e-3)
    older = {k: v for k, v in as_stored(limited).items() if k != "continued_until"}
    assert read_back(Valid, older).grows_until_s == ends.to_s


def test_a_drift_that_goes_on_does_so_for_its_time_and_no_longer():
    """0.1 µm/day for thirty days and ten more."""
    plain = drift(days=12.0)
    on_s = START_S + MONTH_S + 10 * SECONDS_PER_DAY
    one = replace(plain, valid=replace(plain.valid, continued_until_s=on_s))
    values = []
    for days in (5.0, 10.0, 12.0, 300.0):
        table = table_of([one], time_s=START_S + MONTH_S + days * SECONDS_PER_DAY)
        values.append(row_of(table, "EYX").errors[0])
        assert table.complete is (days <= 12.0)
    np.testing.assert_allclose(values, [3.5, 4.0, 4.0, 4.0], atol=1e-12)
    assert table.warnings == [
        "drift of EYX is held at its value of 2026-04-10 00:00 UTC, the end of its "
        "continuation (it was last observed at 2026-03-31 00:00 UTC), and may be used until "
        "2026-04-12 00:00 UTC; this is for 2027-01-25 00:00 UTC: measure EYX again, and analyse "
        "again"
    ]
    assert "continued as it was found until 2026-04-10 00:00 UTC and then held. It may be used" in (
        table.effects[0].measure_again
    )


def test_the_growth_that_counts_is_the_largest_along_the_axis():
    """0.1 + 0.05·(x − 250)/250 a day, both known exactly: 0.15 at the far end."""
    own = example()
    exx = own.rows.channels.index("EXX")
    driver, line = SinceReference(START_S), Rising(250.0, 250.0)
    terms = [[Term("EXX", driver, Everywhere())], [Term("EXX", driver, line)]]
    margin = POSITION_MARGIN / (1.0 + 2.0 * POSITION_MARGIN) * 500.0
    ends = valid(positions_mm={"EXX": (margin, 500.0 - margin)})
    found = growths(
        ends, terms, np.array([0.1, 0.05]), np.zeros((2, 2)), own.projection, {exx: 0.3}
    )
    until_s = limited_in_time(ends, found).use_until_s
    assert (until_s - ends.to_s) / SECONDS_PER_DAY == pytest.approx(2.0)


def test_beyond_maps_keeps_its_range_when_the_maps_change():
    before = BeyondMaps("spindle", "", "x-middle", ((20.0, 30.0), (30.0, 50.0)))
    after = BeyondMaps("spindle", "", "x-middle", ((20.0, 30.0), (25.0, 44.0), (30.0, 50.0)))
    low, high = before.moved((-1.0, 2.0), after)
    # At 25 °C the maps now say 44 where the line said 40: 4 K lower there, the same at the ends.
    assert (low, high) == (-5.0, 2.0)


# --- another sensor is followed -------------------------------------------------------------

OTHER = Exchange.of("spindle", {"Run #1": 30.0, "Run #3": 38.0, "Run #6": 50.0})
WIDE = {"x-middle": (0.0, 60.0), "spindle": (0.0, 80.0)}


def other(share=1.0, **ranges):
    return Effect(
        "other-sensor",
        ("EXX",),
        ("x-middle", "spindle"),
        parameters={"share": share},
        terms=(Term("EXX", Always(), OTHER, share),),
        valid=valid(**{"temperatures_c": WIDE} | ranges),
    )


def test_a_component_that_follows_another_sensor_names_it():
    """Spindle at 44 °C is half way from Run #3 (38) to Run #6 (50): EXX is 7 µm at the end."""
    table = table_of([other()], {"x-middle": 21.0, "spindle": 44.0})
    entry = row_of(table, "EXX")
    assert entry.errors[-1] == pytest.approx(7.0)
    basis = entry.basis
    assert (basis.sensor, basis.temperature_c) == ("spindle", 44.0)
    assert (basis.lower_map, basis.upper_map, basis.weight) == ("Run #3", "Run #6", 0.5)
    assert (basis.status, basis.stand_in_for) == ("interpolated", None)
    assert basis.follows == (("spindle", 44.0, 1.0),)
    assert row_of(table, "EYX").basis.sensor == "x-middle"
    assert table.complete is True
    assert table.warnings == []


def test_a_share_names_both_sensors_and_the_maps_that_give_the_numbers():
    """Both between the same maps: 0.75 of the weight of the one and 0.25 of the other's."""
    basis = row_of(table_of([other(0.75)], {"x-middle": 27.0, "spindle": 41.0}), "EXX").basis
    assert basis.follows == (("spindle", 41.0, 0.75), ("x-middle", 27.0, 0.25))
    assert (basis.sensor, basis.temperature_c) == ("spindle", 41.0)
    assert (basis.lower_map, basis.upper_map) == ("Run #3", "Run #6")
    assert basis.weight == pytest.approx(0.75 * 0.25 + 0.25 * 0.5)


def test_three_maps_are_not_called_two():
    entry = row_of(table_of([other(0.5)], {"x-middle": 21.0, "spindle": 44.0}), "EXX")
    assert (entry.basis.lower_map, entry.basis.upper_map, entry.basis.weight) == (None,) * 3
    assert {f.sensor for f in entry.basis.follows} == {"x-middle", "spindle"}


@settings(max_examples=50, deadline=None)
@given(
    share=st.floats(-0.5, 1.5),
    own_c=st.floats(15.0, 35.0),
    other_c=st.floats(20.0, 60.0),
)
def test_the_maps_of_a_row_are_those_that_its_numbers_come_from(share, own_c, other_c):
    entry = row_of(table_of([other(share)], {"x-middle": own_c, "spindle": other_c}), "EXX")
    basis = entry.basis
    assert sum(f.share for f in basis.follows) == pytest.approx(1.0)
    at_end = {"Run #1": 0.0, "Run #3": 4.0, "Run #6": 10.0}  # µm at the end of travel
    if basis.weight is not None:
        w = basis.weight
        said = (1.0 - w) * at_end[basis.lower_map] + w * at_end[basis.upper_map]
        assert entry.errors[-1] == pytest.approx(said, abs=1e-9)
    by = {"x-middle": [20.0, 24.0, 30.0], "spindle": [30.0, 38.0, 50.0]}
    followed = sum(
        f.share * np.interp(f.temperature_c, by[f.sensor], [0.0, 4.0, 10.0]) for f in basis.follows
    )
    assert entry.errors[-1] == pytest.approx(followed, abs=1e-9)


def test_the_sensor_that_is_no_longer_followed_does_not_clamp_the_row():
    table = table_of([other()], {"x-middle": 33.0, "spindle": 44.0})
    assert row_of(table, "EXX").basis.status == "interpolated"
    assert row_of(table, "EYX").basis.status == "clamped"
    (warning,) = table.warnings
    assert "EYX" in warning
    assert "EXX" not in warning


def test_the_sensor_that_is_followed_clamps_it_and_is_refused_where_the_policy_says_so():
    warm = {"x-middle": 25.0, "spindle": 60.0}
    table = table_of([other()], warm)
    assert row_of(table, "EXX").basis.status == "clamped"
    assert table.warnings == ["spindle at 60 °C is outside the maps: EXX held at 'Run #6'"]
    with pytest.raises(OutsideMaps, match=r"spindle, for EXX: .*got 60 °C"):
        table_of([other()], warm, out_of_range=OutOfRange.REJECT)


def test_beyond_what_was_learnt_it_is_held_and_says_which_temperatures_it_is_read_at():
    learnt = {"x-middle": (20.0, 26.0), "spindle": (30.0, 42.0)}
    table = table_of([other(temperatures_c=learnt)], {"x-middle": 27.0, "spindle": 48.0})
    basis = row_of(table, "EXX").basis
    assert basis.status == "held"
    assert table.complete is False
    # E by x-middle at 27, plus E by the spindle at 42 instead of x-middle at 26.
    assert basis.follows == (
        ("spindle", 42.0, 1.0),
        ("x-middle", 27.0, 1.0),
        ("x-middle", 26.0, -1.0),
    )
    assert (basis.sensor, basis.temperature_c) == ("spindle", 42.0)
    assert row_of(table, "EXX").errors[-1] == pytest.approx(7.0 + 6.0 - 6.0)


def test_predictions_say_what_the_followed_sensor_has_to_say():
    """The maps end at 50 °C of the spindle: clamped beyond, refused where the policy says so."""
    spindle_c = np.array([44.0, 60.0, np.nan])
    temperatures = {name: np.full(3, t) for name, t in TEMPERATURES.items()}
    conditions = Conditions(np.full(3, START_S), temperatures | {"spindle": spindle_c})
    at_end = np.tile([500.0, 0.0, 0.0], (3, 1))
    places = AskedPlaces("EXX", at_end, np.zeros((3, 3)), np.zeros((3, 3)))
    model = compile_model(machine(), maps(), ASSIGNMENT)
    found = predict_with_effects(model, [other()], places, conditions)
    assert found.values.tolist() == pytest.approx([7.0, 10.0, 2.0])
    assert found.status == ["interpolated", "clamped", "effect-missing"]
    elsewhere = predict_with_effects(model, [other()], replace(places, component="EYX"), conditions)
    assert elsewhere.status == ["interpolated"] * 3
    model = compile_model(machine(out_of_range=OutOfRange.REJECT), maps(), ASSIGNMENT)
    found = predict_with_effects(model, [other()], places, conditions)
    assert found.status == ["interpolated", "outside-maps", "effect-missing"]
    assert np.isnan(found.values).tolist() == [False, True, False]

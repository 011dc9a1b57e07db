"""People's mistakes: each leaves in the rows what right data would say, less what was noted."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from app.effects.campaign_view import CampaignView
from app.effects.claim import claim_of
from app.effects.hypothesis import Estimate
from app.effects.kinds.map_factor import MapFactor
from app.effects.kinds.map_temperature import MapTemperature
from app.effects.kinds.wrong_map import WrongMap
from app.effects.projection import Projection, sum_of_terms
from app.effects.registry import KINDS, explain, kind_of, repertoire
from app.identification.residuals.residuals import compute_residuals
from app.search.candidate import Expected
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from tests.effects.example_campaign_view import (
    ASSIGNMENT,
    START_S,
    example_view,
    machine,
    maps,
    observations,
    temperatures,
)

MISTAKES = [name for name, kind in KINDS.items() if kind.not_adopted]


@pytest.fixture(scope="module")
def view():
    return example_view()


def proposed(view, kind, variant="", components=None, sensors=None):
    """The one hypothesis of a kind that acts on these components, with these sensors."""
    (found,) = (
        h
        for h in kind_of(kind).candidates(view).hypotheses
        if h.variant == variant
        and (components is None or h.components == components)
        and (sensors is None or set(h.sensors) == set(sensors))
    )
    return found


def column(view, hypothesis, theta=None):
    """What one unit of a hypothesis' one amplitude leaves in every row."""
    found = np.zeros(len(view.rows))
    for part in hypothesis.parts(view.projection, theta):
        found[part.rows] = part.columns[:, 0]
    return found


def predicted(view, own_maps):
    """What the model of some maps says of the view's rows."""
    model = compile_model(machine(), own_maps, ASSIGNMENT)
    return compute_residuals(model, view.rows, view.conditions).predicted


def with_tables(change):
    """The example's maps, each table as `change(label, code, errors)` makes it."""
    return [
        replace(
            m,
            tables={
                code: ComponentTable.make(
                    table.component, change(m.label, code, table.errors), table.positions_mm
                )
                for code, table in m.tables.items()
            },
        )
        for m in maps()
    ]


def seen_with(view, own_maps):
    """The same campaign with other maps stored."""
    model = compile_model(machine(), own_maps, ASSIGNMENT)
    return CampaignView(model, own_maps, view.rows, view.conditions)


def test_exchanged_plugs_leave_each_sensors_components_at_the_others_temperature(view):
    """EXX grows by 1 µm/K of x-middle at 500 mm, EZZ by 2 then 4 µm/K of z-column."""
    pair = ("x-middle", "z-column")
    left = column(view, proposed(view, "exchanged-sensors", sensors=pair))
    t_x, t_z = (view.conditions.temperature(sensor) for sensor in pair)
    rows = view.rows.of_channel("EXX")
    along = view.rows.points_mm[rows, 0] / 500.0
    inside = (t_z[rows] > 20.0) & (t_z[rows] < 30.0)
    expected = along * (t_z - t_x)[rows]
    np.testing.assert_allclose(left[rows][inside], expected[inside], atol=1e-12)
    rows = view.rows.of_channel("EZZ")
    along = view.rows.points_mm[rows, 2] / 500.0
    errors = [np.interp(t[rows], [22.0, 26.0, 32.0], [0.0, 8.0, 32.0]) for t in (t_x, t_z)]
    np.testing.assert_allclose(left[rows], along * (errors[0] - errors[1]), atol=1e-12)


def test_sensors_of_which_no_component_follows_either_cannot_be_seen_exchanged(view):
    pairs = {frozenset(h.sensors) for h in kind_of("exchanged-sensors").candidates(view).hypotheses}
    assert frozenset(("y-front", "spindle")) not in pairs
    assert frozenset(("x-middle", "spindle")) in pairs


@pytest.mark.parametrize("stored_times", [-1.0, 10.0, 1 / 25.4])
@pytest.mark.parametrize("label", ["", "Run #3"])
def test_a_table_stored_times_a_factor_leaves_its_own_multiple(view, stored_times, label):
    wrong = with_tables(
        lambda name, code, errors: (
            errors * stored_times if code == "EZZ" and label in ("", name) else errors
        )
    )
    seen = seen_with(view, wrong)
    left = predicted(view, maps()) - predicted(view, wrong)
    own = column(seen, proposed(seen, "map-factor", label, ("EZZ",)))
    np.testing.assert_allclose(left, (1.0 / stored_times - 1.0) * own, atol=1e-9)


def test_a_map_in_another_unit_is_one_mistake(view):
    wrong = with_tables(lambda name, code, errors: errors * (10.0 if name == "Run #6" else 1.0))
    seen = seen_with(view, wrong)
    left = predicted(view, maps()) - predicted(view, wrong)
    together = proposed(seen, "map-factor", "Run #6", seen.components)
    np.testing.assert_allclose(left, -0.9 * column(seen, together), atol=1e-9)


@pytest.mark.parametrize(
    ("amplitude", "words", "factor"),
    [
        (-2.0, "has the wrong sign", "by -1,"),
        (-0.9, "is 10 times too large", "by 1/10,"),
        (24.4, "is 25.4 times too small", "by 25.4,"),
    ],
)
def test_the_factor_is_named_and_what_puts_it_right(view, amplitude, words, factor):
    hypothesis = proposed(view, "map-factor", "Run #3", ("EXX",))
    error = 0.01 * abs(amplitude)
    effect = hypothesis.fitted(Estimate(None, None, np.array([amplitude]), np.array([[error**2]])))
    assert explain(effect) == f"the table of EXX in map 'Run #3' {words}"
    assert factor in MapFactor().what_to_do(effect)


@pytest.mark.parametrize(
    ("multiply_by", "error", "is_sure"),
    [
        (0.001, 0.0002, True),  # µm read as mm: what is left of the table is seen
        (1 / 25.4, 0.002, True),
        (0.1, 0.02, True),
        (-1.0, 0.1, True),
        (0.001, 0.03, False),
        (-0.106, 0.032, False),  # something was in the machine only while it was mapped
        (0.6, 0.01, False),  # no factor of a unit
    ],
)
def test_a_factor_is_sure_only_if_what_it_leaves_of_the_table_is_seen(
    view, multiply_by, error, is_sure
):
    hypothesis = proposed(view, "map-factor", "Run #3", ("EXX",))
    estimate = Estimate(None, None, np.array([multiply_by - 1.0]), np.array([[error**2]]))
    assert (not MapFactor().doubt(hypothesis.fitted(estimate))) is is_sure


def test_a_table_of_which_nothing_is_seen_may_be_wrong_in_any_way(view):
    hypothesis = proposed(view, "map-factor", "Run #3", ("EXX",))
    effect = hypothesis.fitted(Estimate(None, None, np.array([-1.106]), np.array([[0.032**2]])))
    assert explain(effect) == (
        "the measured values show nothing of the table of EXX in map 'Run #3': it is wrong as a "
        "whole, or 1000 times too large"
    )
    assert "measure them again" in MapFactor().what_to_do(effect)


def test_factors_that_the_estimate_cannot_tell_apart_are_both_named(view):
    hypothesis = proposed(view, "map-factor", "", ("EXX",))
    effect = hypothesis.fitted(Estimate(None, None, np.array([-0.93]), np.array([[0.01**2]])))
    assert "25.4 times too large or 10 times too large" in explain(effect)


@pytest.mark.parametrize(
    ("label", "noted_c"), [("Run #3", 26.5), ("Run #3", 22.0), ("Run #1", 17.0)]
)
def test_a_map_noted_at_another_temperature_leaves_what_the_right_scale_says(view, label, noted_c):
    wrong = [
        replace(m, temperatures_c={**m.temperatures_c, "x-middle": noted_c})
        if m.label == label
        else m
        for m in maps()
    ]
    seen = seen_with(view, wrong)
    left = predicted(view, maps()) - predicted(view, wrong)
    (really,) = (m.temperatures_c["x-middle"] for m in maps() if m.label == label)
    hypothesis = proposed(seen, "map-temperature", label, sensors=("x-middle",))
    np.testing.assert_allclose(left, column(seen, hypothesis, really - noted_c), atol=1e-9)
    effect = hypothesis.fitted(
        Estimate(really - noted_c, 0.2, np.array([1.0]), np.array([[0.01**2]]))
    )
    assert effect.parameters["really_c"] == pytest.approx(really)
    told = explain(effect)
    assert f"map {label!r} is recorded at {noted_c:.1f} °C of x-middle" in told
    assert f"the data say {really:.1f} ± 0.2 °C" in told
    assert label in MapTemperature().what_to_do(effect)
    adopted = sum_of_terms(Projection(seen.model, seen.rows, seen.conditions), effect.terms)
    np.testing.assert_allclose(adopted, left, atol=1e-9)


@pytest.mark.parametrize("label", ["Run #1", "Run #3", "Run #6"])
@pytest.mark.parametrize(
    ("form", "lacking"), [("shift", np.ones(5)), ("slope", np.linspace(-1.0, 1.0, 5))]
)
def test_a_wrong_map_leaves_what_tables_are_made_of_it(view, label, form, lacking):
    """Three maps of EXX, one of which lacks something: exactly the column is left of 1 µm."""
    wrong = with_tables(lambda m, code, e: e - lacking if (m, code) == (label, "EXX") else e)
    left = predicted(view, maps()) - predicted(view, wrong)
    seen = seen_with(view, wrong)
    hypothesis = proposed(seen, "wrong-map", f"{label}: {form}", ("EXX",))
    np.testing.assert_allclose(left, column(seen, hypothesis), atol=1e-9)
    effect = hypothesis.fitted(Estimate(None, None, np.array([3.0]), np.array([[0.2**2]])))
    assert f"map {label!r} of EXX is wrong, while its other maps hold: it is" in explain(effect)
    assert "3.0 ± 0.2 µm" in explain(effect)
    assert f"Measure EXX of map {label!r} again" in WrongMap().what_to_do(effect)
    adopted = sum_of_terms(Projection(seen.model, seen.rows, seen.conditions), effect.terms)
    np.testing.assert_allclose(adopted, 3.0 * left, atol=1e-9)


@pytest.mark.parametrize("by_min", [60.0, -40.0])
def test_clocks_apart_leave_what_all_sensors_read_then(view, by_min):
    """EXX at the temperature that the example's wave has an hour later, less that of now."""
    left = column(view, proposed(view, "clock-offset"), by_min * 60.0)
    rows = view.rows.of_channel("EXX")
    now_c, then_c = (
        temperatures(view.rows.times_s[rows] + by_s)["x-middle"] for by_s in (0.0, by_min * 60.0)
    )
    along = view.rows.points_mm[rows, 0] / 500.0
    # Readings every two minutes, straight between them.
    np.testing.assert_allclose(left[rows], along * (then_c - now_c), atol=2e-3)
    late = column(view, proposed(view, "late-sensor", sensors=("x-middle",)), by_min * 60.0)
    np.testing.assert_array_equal(late[rows], left[rows])
    assert not late[view.rows.of_channel("EZZ")].any()


def test_a_sensor_that_reports_late_did_so_in_the_maps(view):
    """The right clock leaves what the late sensor leaves, but for maps that it was late in."""
    by_s, at_s = 3600.0, START_S + 2.0 * 86400.0
    measured = [replace(view.maps[0], measured_at=datetime.fromtimestamp(at_s, UTC))]
    within = CampaignView(view.model, [*measured, *view.maps[1:]], view.rows, view.conditions)
    late = column(within, proposed(within, "late-sensor", sensors=("x-middle",)), by_s)
    before_c, after_c = (temperatures(np.array([at_s + d]))["x-middle"].item() for d in (0.0, by_s))
    right = [
        replace(m, temperatures_c=m.temperatures_c | {"x-middle": m.temperatures_c["x-middle"] + k})
        for m, k in zip(view.maps, (after_c - before_c, 0.0, 0.0), strict=True)
    ]
    rows = view.rows.of_channel("EXX")
    then_c = temperatures(view.rows.times_s + by_s)["x-middle"]
    then = replace(
        view.conditions, temperatures_c=dict(view.conditions.temperatures_c) | {"x-middle": then_c}
    )
    model = compile_model(machine(), right, ASSIGNMENT)
    supposed = compute_residuals(model, view.rows, then).predicted - predicted(view, view.maps)
    np.testing.assert_allclose(late[rows], supposed[rows], atol=5e-3)


def test_rows_whose_readings_end_too_early_are_moved_as_far_as_is_known(view):
    """The likelihood would jump with each row that stopped to be moved."""
    late = proposed(view, "late-sensor", sensors=("x-middle",))
    known_s = view.conditions.lags.recordings["temperature", "x-middle"].times_s[-1] + 600.0
    rows = view.rows.of_channel("EXX")
    ends = view.rows.times_s[rows].max()
    by_s = known_s - ends + np.arange(-240.0, 241.0, 60.0)
    last = rows[(view.rows.times_s[rows] == ends) & (view.rows.points_mm[rows, 0] > 0.0)]
    left = np.array([column(view, late, float(by))[last] for by in by_s])
    assert np.isnan(view.conditions.temperature_later("x-middle", float(by_s[-1]))).any()
    assert np.abs(left).min() > 0.0
    assert np.abs(np.diff(left, axis=0)).max() < 0.1 * np.abs(left).max()


@pytest.mark.parametrize(("kind", "on"), [("late-sensor", "x-middle"), ("clock-offset", "clocks")])
def test_one_component_alone_does_not_tell_times_that_are_wrong(view, kind, on):
    lines = [
        replace(v, observations=[o for o in v.observations if o.component == "EXX"])
        for v in observations(with_points=False)
    ]
    found = kind_of(kind).candidates(example_view(verifications=lines))
    assert not found.hypotheses
    (said,) = found.not_testable
    assert said.on == on
    assert "EXX" in said.reason
    assert proposed(view, kind, sensors=None if on == "clocks" else (on,))


@pytest.mark.parametrize(
    ("apart_min", "error", "words"),
    [
        (60.3, 0.8, "60.3 ± 0.8 min: the observations are stamped too early, by whole hours"),
        (-34.2, 0.3, "34.2 ± 0.3 min: the observations are stamped too late (seen"),
    ],
)
def test_clocks_apart_are_told_with_the_way(view, apart_min, error, words):
    hypothesis = proposed(view, "clock-offset")
    effect = hypothesis.fitted(Estimate(apart_min * 60.0, error * 60.0, np.ones(1), np.eye(1)))
    assert words in explain(effect)
    way = "later" if apart_min > 0 else "earlier"
    whole = " (by whole hours, if it is a time zone)" if "whole hours" in words else ""
    assert f"min {way}{whole}, then analyse again" in KINDS["clock-offset"].what_to_do(effect)


def test_a_mirrored_line_leaves_the_difference_of_both_ends(view):
    """EXX is (T − 20) x/500: at 500 − x less at x that is (T − 20)(1 − x/250)."""
    left = column(view, proposed(view, "mirrored-axis", "", ("EXX",)))
    rows = view.rows.of_channel("EXX")
    above = view.conditions.temperature("x-middle")[rows] - 20.0
    along = view.rows.points_mm[rows, 0] / 500.0
    np.testing.assert_allclose(left[rows], above * (1.0 - 2.0 * along), atol=1e-12)
    assert not np.delete(left, rows).any()
    both = column(view, proposed(view, "mirrored-axis", "sign reversed too", ("EXX",)))
    np.testing.assert_allclose(both[rows], -above, atol=1e-12)


def test_points_that_were_mirrored_are_those_at_the_other_end(view):
    """Everything at the mirrored point, the lever arms of rotations included."""
    own = example_view(with_rotations=True)
    codes = tuple(c for c in own.tables if c in ("EXX", "EYX", "EBX"))
    left = column(own, proposed(own, "mirrored-axis", "points", codes))
    points_mm = own.rows.points_mm.copy()
    points_mm[:, 0] = np.where(own.rows.at_points, 500.0 - points_mm[:, 0], points_mm[:, 0])
    mirrored = replace(own.rows, points_mm=points_mm)
    said = [
        compute_residuals(own.model, rows, own.conditions).predicted
        for rows in (mirrored, own.rows)
    ]
    np.testing.assert_allclose(left, said[0] - said[1], atol=1e-9)
    assert not left[own.rows.of_channel("EXX")].any()


def test_a_longer_tool_acts_through_the_angles_alone(view):
    """EBX turns 2 µrad/K at 500 mm: 1 mm of tool moves the point by 0.002 µm/K in X."""
    own = example_view(with_rotations=True)
    left = column(own, proposed(own, "tool-length", ""))
    rows = own.rows.of_channel("points x")
    above = own.conditions.temperature("x-middle")[rows] - 20.0
    expected = 2.0e-3 * above * own.rows.points_mm[rows, 0] / 500.0
    np.testing.assert_allclose(np.abs(left[rows]), np.abs(expected), atol=1e-12)
    assert not left[own.rows.of_channel("EXX")].any()
    one = column(own, proposed(own, "tool-length", "100 mm"))
    is_short = own.rows.tool_offsets_mm[:, 2] == 100.0
    np.testing.assert_array_equal(one[is_short], left[is_short])
    assert not one[~is_short].any()


def test_without_angles_no_tools_length_can_be_seen(view):
    found = kind_of("tool-length").candidates(view)
    assert not found.hypotheses
    assert "no map has an angular error" in found.not_testable[0].reason


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_sensor_that_came_half_off_is_read_at_its_bodys_temperature(view, share):
    """T = share · body + (1 − share) · around: what is adopted asks the maps at the body."""
    hypothesis = proposed(view, "detached-sensor", sensors=("x-middle", "spindle"))
    k = (1.0 - share) / share
    effect = hypothesis.fitted(Estimate(None, None, np.array([k]), np.array([[0.01**2]])))
    assert effect.parameters["share"] == pytest.approx(share)
    read_c, around_c = (view.conditions.temperature(s) for s in ("x-middle", "spindle"))
    body_c = (read_c - (1.0 - share) * around_c) / share
    rows = view.rows.of_channel("EXX")
    along = view.rows.points_mm[rows, 0] / 500.0
    held = [np.clip(t[rows], 20.0, 30.0) for t in (body_c, read_c)]
    added = sum_of_terms(view.projection, effect.terms)[rows]
    np.testing.assert_allclose(added, along * (held[0] - held[1]), atol=1e-9)


def test_an_ageing_sensor_is_corrected_by_what_it_has_grown_by(view):
    hypothesis = proposed(view, "ageing-sensor", "since the first visit", sensors=("x-middle",))
    effect = hypothesis.fitted(Estimate(None, None, np.array([-0.3]), np.array([[0.01**2]])))
    assert effect.parameters == {"bias_k_per_day": 0.3}
    assert (
        "x-middle ages: its reading has drifted up by 0.300 ± 0.010 K/day since the first visit"
        in explain(effect)
    )
    rows = view.rows.of_channel("EXX")
    days = (view.rows.times_s[rows] - view.rows.times_s.min()) / 86400.0
    read_c = view.conditions.temperature("x-middle")[rows]
    along = view.rows.points_mm[rows, 0] / 500.0
    expected = along * (np.clip(read_c - 0.3 * days, 20.0, 30.0) - np.clip(read_c, 20.0, 30.0))
    added = sum_of_terms(view.projection, effect.terms)[rows]
    np.testing.assert_allclose(added, expected, atol=1e-9)


@pytest.mark.parametrize("kind", MISTAKES)
def test_what_is_put_right_where_it_was_made_adds_nothing_to_the_model(kind):
    own = example_view(with_rotations=True)
    for hypothesis in kind_of(kind).candidates(own).hypotheses[:5]:
        theta = hypothesis.nonlinear.grid[0] if hypothesis.nonlinear else None
        effect = hypothesis.fitted(Estimate(theta, None, np.array([1.0]), np.eye(1)))
        assert effect.terms == ()
        assert kind_of(kind).what_to_do(effect).endswith(".")
        assert claim_of(effect).key == hypothesis.key


def test_keys_of_all_mistakes_are_unique(view):
    every = [h for name in MISTAKES for h in kind_of(name).candidates(view).hypotheses]
    assert len({h.key for h in every}) == len(every)
    assert len(repertoire(view, MISTAKES).candidates) == len(every)


def test_an_expected_amplitude_costs_what_it_misses_by():
    """A normal prior of deviation 0.1 about 2: ten deviations off cost a hundred."""
    expected = Expected((2.0,), 0.05)
    assert expected.cost(1.0, 0.0) == pytest.approx(100.0)
    # As wide as the prior: half the squared distance, and ln 2 of Occam's factor.
    assert expected.cost(1.0, 0.01) == pytest.approx(50.0 + np.log(2.0))
    assert Expected((2.0, -2.0), 0.05).cost(-2.0, 0.0) == pytest.approx(2.0 * np.log(2.0))


def test_an_instrument_settles_from_the_beginning_of_each_visit_in_its_own_channel(view):
    """1 − exp(−t/τ), t since the first row of the visit, whatever it measured; 1 in the longest."""
    tau_s = 600.0
    left = column(view, proposed(view, "instrument-warm-up", components=("EXX",)), tau_s)
    rows = view.rows
    began_s = np.array([rows.times_s[rows.visit == v].min() for v in rows.visit])
    longest_s = (rows.times_s - began_s)[rows.channel == 0].max()
    whole = 1.0 - np.exp(-longest_s / tau_s)
    for visit in np.unique(rows.visit):
        own = rows.visit == visit
        since_s = rows.times_s[own] - rows.times_s[own].min()
        expected = np.where(rows.channel[own] == 0, (1.0 - np.exp(-since_s / tau_s)) / whole, 0.0)
        assert rows.channels[0] == "EXX"
        np.testing.assert_allclose(left[own], expected, atol=1e-12)


def test_an_instruments_time_constant_is_told_with_its_unit(view):
    hypothesis = proposed(view, "instrument-warm-up", components=("EXX",))
    size = np.array([-2.0]), np.eye(1) * 0.01
    effect = hypothesis.fitted(Estimate(600.0, 120.0, *size))
    within = f"{effect.parameters['within_min']:.3g} min"
    told = f"in every visit EXX settles by -2.00 ± 0.10 µm within {within}"
    assert explain(effect).startswith(f"{told}, with a time constant of 10 ± 2 min: ")
    # Of visits that end long before nobody knows how long it takes, nor what it comes to.
    for error_s in (400.0, np.inf):
        effect = hypothesis.fitted(Estimate(600.0, error_s, *size))
        assert explain(effect).startswith(f"{told}: the instrument")
        assert "until its reading no longer moves" in KINDS["instrument-warm-up"].what_to_do(effect)


def test_directions_at_points_settle_by_themselves(view):
    left = column(view, proposed(view, "instrument-warm-up", components=("points y",)), 600.0)
    moved = {view.rows.channels[c] for c in view.rows.channel[left > 0.0]}
    assert moved == {"points y"}


@pytest.mark.parametrize("channel", ["EXX", "points x"])
def test_what_has_no_row_left_is_not_looked_for(view, channel):
    """All of its rows were beyond the maps, and those of other channels were not."""
    lost = view.rows.channels.index(channel)
    kept = view.rows.channel != lost
    conditions = view.conditions.take(np.flatnonzero(kept))
    found = repertoire(CampaignView(view.model, view.maps, view.rows.take(kept), conditions))
    assert found.hypotheses
    assert channel not in view.rows.take(kept).channels_left


LENGTHS = "instrument-compensation"
LINES = ("EXX", "EYY", "EZZ")


def test_an_instruments_lengths_grow_alike_on_all_axes_and_nothing_else_does(view):
    """c (T − 20 °C) x: at 500 mm and 24 °C one µm/(m K) is 2 µm."""
    everywhere = ("EXX", "EYY", "EZZ", "points x", "points y", "points z")
    hypothesis = proposed(view, LENGTHS, "along lines and at points", LINES, ("z-column",))
    left = column(view, hypothesis, 20.0)
    above_k = view.conditions.temperature("z-column") - 20.0
    expected = np.zeros(len(view.rows))
    for channel in everywhere:
        own = view.rows.of_channel(channel)
        at_mm = view.rows.points_mm[own, "xyz".index(channel[-1].lower())]
        expected[own] = above_k[own] * at_mm / 1000.0
    np.testing.assert_allclose(left, expected, atol=1e-12)
    assert np.abs(left).max() > 1.0
    assert not left[view.rows.of_channel("SXY")].any()


@pytest.mark.parametrize(
    ("variant", "shown"),
    [
        ("", {*LINES}),
        ("at points", {"points x", "points y", "points z"}),
        ("along lines and at points", {*LINES, "points x", "points y", "points z"}),
    ],
)
def test_one_instrument_measured_lines_or_points_or_both(view, variant, shown):
    left = column(view, proposed(view, LENGTHS, variant, LINES, ("y-front",)), 20.0)
    assert {view.rows.channels[c] for c in view.rows.channel[left != 0.0]} == shown


def test_maps_measured_with_the_same_instrument_contain_what_it_was_then(view):
    """At the maps' own temperatures nothing is left: x-middle and y-front are 1 K apart there."""
    hypothesis = proposed(view, LENGTHS, "beyond the maps", LINES, ("y-front",))
    left, rows = column(view, hypothesis), view.rows.of_channel("EXX")
    own, other = (view.conditions.temperature(s)[rows] for s in ("x-middle", "y-front"))
    beyond_k = other - (np.clip(own, 20.0, 30.0) - 1.0)
    np.testing.assert_allclose(left[rows], beyond_k * view.rows.points_mm[rows, 0] / 1000.0)


def test_one_axis_of_several_says_nothing_of_the_others(view):
    """EXX and EYY follow x-middle, and their maps contain all of it: only EZZ could show it."""
    every = kind_of(LENGTHS).candidates(view).hypotheses
    beyond = [h for h in every if h.variant.endswith("beyond the maps")]
    assert {h.sensors for h in beyond} == {("z-column",), ("y-front",), ("spindle",)}
    of_column = next(h for h in beyond if h.sensors == ("z-column",))
    assert len(of_column.apart) == 2


def test_apart_each_axis_has_its_own_part_of_the_same(view):
    hypothesis = proposed(view, LENGTHS, "", LINES, ("y-front",))
    parts = hypothesis.candidate(view.projection).apart.columns(20.0)
    assert {part.columns.shape[1] for part in parts} == {3}
    together = np.zeros(len(view.rows))
    for part in parts:
        assert np.count_nonzero(np.abs(part.columns).max(axis=0)) == 1
        together[part.rows] += part.columns.sum(axis=1)
    np.testing.assert_array_equal(together, column(view, hypothesis, 20.0))


def only(*codes):
    return example_view(
        verifications=[
            replace(v, observations=[o for o in v.observations if o.component in codes])
            for v in observations(with_points=False)
        ]
    )


def test_on_one_axis_alone_a_length_must_grow_as_air_or_steel_would_have_it(view):
    """Nothing but its size tells it there from the machine's own expansion."""
    one = {h.expected for h in kind_of(LENGTHS).candidates(only("EXX")).hypotheses}
    two = {h.expected for h in kind_of(LENGTHS).candidates(only("EXX", "EYY")).hypotheses}
    (expected,) = one
    assert set(expected.values) == {-0.93, 11.7, -11.7}
    assert two == {None}


def test_without_lengths_no_instruments_compensation_can_be_seen():
    found = kind_of(LENGTHS).candidates(only("SXY"))
    assert not found.hypotheses
    assert "two or more positions" in found.not_testable[-1].reason


@pytest.mark.parametrize(
    ("size", "error", "words"),
    [
        (-0.91, 0.05, "a laser that is not corrected for air temperature"),
        (11.2, 0.2, "not told the temperature of the steel"),
        (-12.0, 0.2, "not told the temperature of the steel"),
        (4.0, 0.2, "corrects lengths wrongly"),
    ],
)
def test_what_has_such_a_size_is_said_and_that_a_machine_may_have_it(view, size, error, words):
    hypothesis = proposed(view, LENGTHS, "", LINES, ("y-front",))
    estimate = Estimate(20.4, 0.5, np.array([size]), np.array([[error**2]]))
    effect = hypothesis.fitted(estimate)
    told = explain(effect)
    assert "all change alike" in told
    assert "µm/(m K) with y-front (zero at 20.4 ± 0.5 °C)" in told
    assert words in told
    assert told.endswith("or with a machine whose scales all expand alike with it")
    assert "weather station" in kind_of(LENGTHS).what_to_do(effect)

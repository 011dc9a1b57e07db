"""Values of every kind of effect that can be computed by hand, with their units and signs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import Conditions, Signal
from app.effects.driver import (
    AboveReference,
    Always,
    Behind,
    BeyondMaps,
    Curvature,
    Difference,
    ShareOfMap,
    SinceReference,
    State,
    StepAfter,
)
from app.effects.effect import Effect
from app.effects.hypothesis import Estimate
from app.effects.low_pass import LagState
from app.effects.projection import unit_errors
from app.effects.registry import explain, kind_of
from app.effects.shape import (
    Everywhere,
    Exchange,
    Places,
    Profile,
    Rising,
    Sensitivity,
    Wave,
)
from app.effects.term import Term
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.map_weights import maps_at, read_maps
from tests.effect_examples import as_stored, read_back
from tests.effects.example_campaign_view import START_S, example_view, machine, maps

HALF = Rising(250.0, 250.0)
IN_MAPS = ((20.0, 30.0), (24.0, 38.0), (30.0, 50.0))
EXTRAPOLATED = BeyondMaps("spindle", "", "x-middle", ((15.0, 24.0), (18.0, 30.0)), goes_on=True)
APART = ((20.0, 10.0), (24.0, 14.0), (30.0, 20.0))
SCALE = (20.0, 24.0, 30.0)
MODEL = compile_model(machine(), maps(), dict.fromkeys(("EXX", "EYX", "EYY"), "x-middle"))


def moment(state=None, lags=None, **temperatures):
    names = {name.replace("_", "-"): t for name, t in temperatures.items()}
    return Conditions.of_moment(START_S, names, state, lags)


def settled(signal, tau_s, output):
    """A filter that has just given this output."""
    state = LagState(tau_s, 0.0, START_S, output, output)
    return LiveLags({(signal, tau_s): state})


def value(term, conditions, at_mm=500.0, direction=0.0):
    places = Places(np.array([at_mm]), np.array([direction]))
    return term.at(MODEL, places, conditions).item()


def test_a_lag_reads_the_tables_at_the_late_temperature():
    # At z = 500 mm EZZ grows by 2 µm/K below 26 °C of z-column and by 4 above: from 29 °C two
    # kelvin down is above that map, four kelvin down crosses it.
    tau = 600.0
    behind = Term("EZZ", Behind("z-column", tau), Sensitivity(is_local=False))
    signal = Signal("temperature", "z-column")
    within = moment(z_column=29.0, lags=settled(signal, tau, 27.0))
    assert value(behind, within) == pytest.approx(-2.0 * 4.0)
    assert value(behind, within, at_mm=250.0) == pytest.approx(-4.0)
    across = moment(z_column=29.0, lags=settled(signal, tau, 25.0))
    assert value(behind, across) == pytest.approx(-(3.0 * 4.0 + 1.0 * 2.0))


@pytest.mark.parametrize(
    ("t_c", "lag_c", "total"),
    [
        (29.0, 26.0, 6.0),  # inside: E at the late temperature
        (33.0, 27.0, 7.0),  # the late temperature is inside: E there
        (15.0, 19.0, 0.0),  # both below: the table stands at the end of the maps
        (35.0, 31.0, 10.0),
        (35.0, 35.0, 10.0),  # nothing is late: adopting a lag extrapolates nothing
        (29.0, 31.0, 10.0),  # the late temperature is beyond the maps: held there as any is
        (29.0, 39.0, 10.0),
    ],
)
def test_a_lag_beyond_the_maps(t_c, lag_c, total):
    """Maps at 20 to 30 °C, 1 µm/K at the end of travel; the policy is to clamp."""
    signal = Signal("temperature", "x-middle")
    term = Term("EXX", Behind("x-middle", 600.0), Sensitivity(is_local=False))
    added = value(term, moment(x_middle=t_c, lags=settled(signal, 600.0, lag_c)))
    assert min(max(t_c, 20.0), 30.0) - 20.0 + added == pytest.approx(total)


@pytest.mark.parametrize(("share", "total"), [(1.0, 6.25), (0.5, 6.125)])
def test_a_late_structure_is_read_by_maps_that_it_was_late_in(share, total):
    """EXX is 0, 4, 10 µm at the end of travel in maps at 20, 24, 30 °C; in the second 2 K late.

    At 26 °C, one kelvin late: E by 20, 22, 30 °C at 25 °C.
    """
    signal = Signal("temperature", "x-middle")
    shape = Sensitivity(is_local=False, in_maps_k=(("Run #3", -2.0),))
    term = Term("EXX", Behind("x-middle", 600.0), shape, share)
    here = moment(x_middle=26.0, lags=settled(signal, 600.0, 25.0))
    assert 6.0 + value(term, here) == pytest.approx(total)
    assert read_back(Term, json.loads(json.dumps(as_stored(term)))) == term


@pytest.mark.parametrize("late_k", [-3.999, -4.0, -4.001])
def test_maps_that_were_as_warm_as_each_other_when_all_is_late_are_not_read_so(late_k):
    """A thousandth of a kelvin between two maps made 15 µm of half a millikelvin."""
    signal = Signal("temperature", "x-middle")
    shape = Sensitivity(is_local=False, in_maps_k=(("Run #3", late_k),))
    term = Term("EXX", Behind("x-middle", 600.0), shape)
    here = moment(x_middle=26.0, lags=settled(signal, 600.0, 25.0))
    assert np.isnan(value(term, here))
    assert "apart at x-middle, too close" in shape.why_missing(MODEL, "EXX")
    assert shape.readable(MODEL, "EXX") == Sensitivity(is_local=False)
    apart = Sensitivity(is_local=False, in_maps_k=(("Run #3", -2.0),))
    assert apart.readable(MODEL, "EXX") == apart


def test_what_expands_evenly_and_late_is_put_right_by_maps_that_were_measured_late():
    """3 µm/K of T′, in the maps as at any other time: all of it is told."""
    t_c, in_maps_k = np.array([20.0, 24.0, 30.0]), np.array([0.0, -2.5, 0.5])

    def error(t, behind):
        return 3.0 * (t + behind)

    own = [
        replace(m, tables={"EXX": ComponentTable.make(COMPONENTS["EXX"], [e, e], [0.0, 500.0])})
        for m, e in zip(maps(), error(t_c, in_maps_k), strict=True)
    ]
    model = compile_model(machine(), own, {"EXX": "x-middle"})
    labels = [m.label for m in own]
    shape = Sensitivity(False, tuple(zip(labels, in_maps_k.tolist(), strict=True)))
    term = Term("EXX", Behind("x-middle", 600.0), shape)
    signal = Signal("temperature", "x-middle")
    places = Places(np.array([100.0]), np.zeros(1))
    for now_c, late_c in ((26.0, 24.0), (23.0, 24.5), (28.0, 26.0), (22.0, 22.0)):
        here = moment(x_middle=now_c, lags=settled(signal, 600.0, late_c))
        said = read_maps(
            *model.find("EXX"),
            maps_at(model, model.find("EXX")[0], here.temperatures_c, 1).weights,
            *places,
        )
        total = said + term.at(model, places, here)
        assert total.item() == pytest.approx(error(now_c, late_c - now_c))


def test_a_lag_that_was_stored_before_maps_were_late_reads_them_as_they_are():
    term = Term("EXX", Behind("x-middle", 600.0), Sensitivity(is_local=False), 0.7)
    written = as_stored(term)
    assert written["shape"].pop("in_maps_k") == []
    assert read_back(Term, written) == term


def test_another_sensor_reads_the_same_maps():
    # The spindle read 30, 38, 50 °C where x-middle read 20, 24, 30: 40 °C is x-middle's 25.
    stated = {"Run #1": 30.0, "Run #3": 38.0, "Run #6": 50.0}
    term = Term("EXX", Always(), Exchange.of("spindle", stated))
    here = moment(x_middle=23.0, spindle=40.0)
    assert value(term, here) == pytest.approx(5.0 - 3.0)
    assert value(term, here, at_mm=250.0) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("term", "here", "at_mm", "expected"),
    [
        # 0.3 µm/K times 4 K, at the end of travel and halfway to the middle.
        (Term("EXX", AboveReference("spindle", 36.0), Everywhere(), 0.3), {}, 10.0, 1.2),
        (Term("EXX", AboveReference("spindle", 36.0), HALF, 0.3), {}, 375.0, 0.6),
        # Spindle 40, x-middle 22, usually 15 K apart: 3 K of bending.
        (Term("EYX", Difference("spindle", "x-middle", 15.0), Everywhere(), 0.5), {}, 0.0, 1.5),
        # At x-middle's 22 °C the maps saw the spindle at 34 °C and a difference of 12 K.
        (
            Term("EXX", BeyondMaps("spindle", "", "x-middle", IN_MAPS), Everywhere(), 0.5),
            {},
            0,
            3.0,
        ),
        (
            Term("EXX", BeyondMaps("spindle", "x-middle", "x-middle", APART), Everywhere(), 0.5),
            {},
            0,
            3.0,
        ),
        # (22 − 20)(22 − 24) = −4 K² between neighbours, (22 − 20)(22 − 30) = −16 K² overall.
        (Term("EXX", Curvature("x-middle", (20.0, 24.0, 30.0)), Everywhere(), 0.1), {}, 0, -0.4),
        (Term("EXX", Curvature("x-middle", (20.0, 30.0)), Everywhere(), 0.1), {}, 0.0, -1.6),
        # Beyond the maps what the line of the last two lacks: (22 − 15)(22 − 18) = 28 K².
        (Term("EXX", Curvature("x-middle", (12.0, 15.0, 18.0)), Everywhere(), 0.1), {}, 0.0, 2.8),
        # There the maps' spindle goes on by 2 K/K, from 30 °C at 18 °C to 38 °C: 2 K are lacking.
        # If the machine does not extrapolate, it stays at 30 °C.
        (Term("EXX", EXTRAPOLATED, Everywhere(), 0.5), {}, 0, 1.0),
        (Term("EXX", replace(EXTRAPOLATED, goes_on=False), Everywhere(), 0.5), {}, 0, 5.0),
        # Half way from the map of 20 °C to that of 24 °C; a third beyond the last two.
        (Term("EXX", ShareOfMap("x-middle", SCALE, 20.0), Everywhere(), 3.0), {}, 0.0, 1.5),
        (Term("EXX", ShareOfMap("x-middle", SCALE, 24.0), Everywhere(), 3.0), {}, 0.0, 1.5),
        (Term("EXX", ShareOfMap("x-middle", SCALE, 30.0), Everywhere(), 3.0), {}, 0.0, 0.0),
        (Term("EXX", ShareOfMap("x-middle", (15.0, 20.0), 20.0), HALF, 3.0), {}, 375.0, 2.1),
        (Term("EXX", ShareOfMap("x-middle", (15.0, 20.0), 15.0), HALF, 3.0), {}, 375.0, -0.6),
        (Term("EZZ", State("spindle_rpm"), Everywhere(), 0.001), {}, 0.0, 8.0),
        (Term("EZZ", State("spindle_rpm", 2), Everywhere(), 1e-7), {}, 0.0, 6.4),
        # A pitch of 10 mm: a quarter of it is the sine's crest, a half the cosine's trough.
        (Term("EXX", Always(), Wave(10.0, False), 2.0), {}, 2.5, 2.0),
        (Term("EXX", Always(), Wave(10.0, True), 2.0), {}, 5.0, -2.0),
        (Term("EXX", SinceReference(START_S - 1.5 * 86400.0), Everywhere(), 2.0), {}, 0.0, 3.0),
        (Term("EXX", StepAfter(START_S - 1.0), Everywhere(), 5.0), {}, 0.0, 5.0),
        (Term("EXX", StepAfter(START_S), Everywhere(), 5.0), {}, 0.0, 5.0),
        (Term("EXX", StepAfter(START_S + 1.0), Everywhere(), 5.0), {}, 0.0, 0.0),
        (Term("EXX", Always(), Profile((0.0, 100.0, 500.0), (0.0, 1.0, 0.0)), 3.0), {}, 300, 1.5),
        # A sensor that reads 0.5 K too much: EZZ is over-predicted by 2 µm/K · 0.5 K.
        (Term("EZZ", StepAfter(0.0), Sensitivity(is_local=True), -0.5), {}, 500.0, -1.0),
    ],
)
def test_terms_by_hand(term, here, at_mm, expected):
    conditions = moment({"spindle_rpm": 8000.0}, x_middle=22.0, z_column=24.0, spindle=40.0)
    assert value(term, conditions, float(at_mm)) == pytest.approx(expected)


SPINDLE = Signal("temperature", "spindle")


@pytest.mark.parametrize(
    ("driver", "expected", "quantity"),
    [
        (AboveReference("spindle", 36.0, 600.0), 1.0, "spindle 10 min late"),
        # Both late: 37 − 23 K, usually 12 K apart.
        (
            Difference("spindle", "x-middle", 12.0, time_constant_s=600.0),
            2.0,
            "spindle minus x-middle 10 min late",
        ),
        # At x-middle's 22 °C, which counts at once, the maps saw 34 °C and a difference of 12 K.
        (
            BeyondMaps("spindle", "", "x-middle", IN_MAPS, 600.0),
            3.0,
            "spindle 10 min late above what it was in the maps",
        ),
        (
            BeyondMaps("spindle", "x-middle", "x-middle", APART, 600.0),
            2.0,
            "spindle minus x-middle 10 min late above what it was in the maps",
        ),
    ],
)
def test_what_drives_late_is_what_the_sensors_were_late(driver, expected, quantity):
    filters = {
        (Signal("temperature", name), 600.0): LagState(600.0, 0.0, START_S, t, t)
        for name, t in (("spindle", 37.0), ("x-middle", 23.0))
    }
    known = moment(x_middle=22.0, spindle=40.0, lags=LiveLags(filters))
    assert driver.at(known).tolist() == pytest.approx([expected])
    assert driver.quantity.name == quantity
    assert (SPINDLE, 600.0) in driver.signals
    assert driver.why_missing(known) == ""
    unknown = moment(x_middle=22.0, spindle=40.0)
    assert np.isnan(driver.at(unknown)).all()
    assert driver.why_missing(unknown) == "the history of spindle is not known here"


@pytest.mark.parametrize(
    "driver",
    [
        AboveReference("spindle", 36.0),
        Difference("spindle", "x-middle", 12.0),
        BeyondMaps("spindle", "", "x-middle", IN_MAPS),
    ],
)
def test_drivers_that_were_stored_before_any_could_be_late_act_at_once(driver):
    written = as_stored(Term("EXX", driver))
    del written["driver"]["time_constant_s"]
    assert read_back(Term, written).driver == driver
    late = Term("EXX", replace(driver, time_constant_s=600.0))
    assert read_back(Term, as_stored(late)) == late


def test_a_reversal_has_the_sign_of_the_approach():
    hypothesis = next(h for h in kind_of("backlash").candidates(example_view()).hypotheses)
    effect = hypothesis.fitted(Estimate(None, None, np.array([1.5]), np.array([[0.01]])))
    assert effect.parameters == {"reversal_um": 3.0}
    assert effect.standard_errors == {"reversal_um": pytest.approx(0.2)}
    (term,) = effect.terms
    here = moment(x_middle=22.0)
    assert [value(term, here, 100.0, d) for d in (1.0, -1.0, 0.0)] == [1.5, -1.5, 0.0]
    assert explain(effect) == "EXX has a reversal value of 3.0 ± 0.2 µm"


RISES = Rising(250.0, 250.0)


@pytest.mark.parametrize(
    ("effect", "told"),
    [
        # 0.3 µm/day · x/500 is 0.15 in the middle, and 0.15 more from there to the end.
        (
            Effect(
                "drift",
                ("EXX",),
                variant="since the first visit",
                parameters={"drift_um_per_day": 0.15, "drift_rise_um_per_day": 0.15},
                standard_errors={"drift_um_per_day": 0.003, "drift_rise_um_per_day": 0.005},
                terms=(Term("EXX", SinceReference(START_S), RISES, 0.15),),
            ),
            "EXX has been drifting since the first visit, by 0.150 ± 0.003 µm/day at X 250 mm, "
            "rising by 0.060 ± 0.002 µm/day per 100 mm",
        ),
        # 2 + 0.02 p is 7 in the middle of 500 mm.
        (
            Effect(
                "backlash",
                ("EYY",),
                parameters={"reversal_um": 7.07, "reversal_rise_um": -5.0},
                standard_errors={"reversal_um": 0.03, "reversal_rise_um": 0.05},
                terms=(Term("EYY", Always(), RISES, -2.5, is_reversing=True),),
            ),
            "EYY has a reversal value of 7.07 ± 0.03 µm at Y 250 mm, falling by 2.00 ± 0.02 µm "
            "per 100 mm",
        ),
        (
            Effect(
                "step",
                ("EZZ",),
                parameters={"step_rise_um": -5.0, "changed_at_unix_s": START_S},
                terms=(Term("EZZ", StepAfter(START_S), Rising(-15_000.0, 15_000.0), -5.0),),
            ),
            "EZZ changed once, by -3.33 µm per 10000 mm from Z -15000 mm, at about "
            "2026-03-01 00:00 UTC",
        ),
    ],
)
def test_an_explanation_says_where_along_the_axis_its_number_holds(effect, told):
    assert explain(effect) == told


def test_rotations_and_slopes_act_through_their_arms():
    chain = Chain.parse("XYFZ")
    point, tool = np.array([[250.0, 100.0, 200.0]]), np.array([[0.0, 0.0, 100.0]])
    # x carries the workpiece: its rotation about Y acts on x and z and the tool:
    # e = ω × (a + T) = (B (z + T), 0, −B x).
    np.testing.assert_allclose(unit_errors(chain, "EBX", point, tool, {}), [[0.3, 0.0, -0.25]])
    np.testing.assert_allclose(unit_errors(chain, "EYY^x", point, tool, {}), [[0.0, 0.25, 0.0]])
    np.testing.assert_allclose(unit_errors(chain, "SXY", point, tool, {}), [[0.1, 0.0, 0.0]])
    np.testing.assert_allclose(unit_errors(chain, "EZZ", point, tool, {}), [[0.0, 0.0, 1.0]])


def test_amplitude_and_phase_of_a_sine_with_their_errors():
    hypothesis = next(h for h in kind_of("periodic").candidates(example_view()).hypotheses)
    covariance = np.array([[0.010, 0.002], [0.002, 0.020]])
    effect = hypothesis.fitted(Estimate(13.4, 0.01, np.array([3.0, 4.0]), covariance))
    assert effect.parameters["amplitude_um"] == pytest.approx(5.0)
    assert effect.parameters["phase_deg"] == pytest.approx(np.rad2deg(np.arctan2(4.0, 3.0)))
    drawn = np.random.default_rng(1).multivariate_normal([3.0, 4.0], covariance, 200_000)
    assert effect.standard_errors["amplitude_um"] == pytest.approx(
        np.hypot(*drawn.T).std(), rel=0.02
    )
    assert effect.standard_errors["phase_deg"] == pytest.approx(
        np.rad2deg(np.arctan2(drawn[:, 1], drawn[:, 0])).std(), rel=0.02
    )
    assert explain(effect) == (
        "EXX varies as a sine over position, with an amplitude of 5.00 ± 0.14 µm "
        "and a pitch of 13.400 ± 0.010 mm"
    )


@pytest.mark.parametrize(
    ("effect", "told"),
    [
        (
            Effect(
                "thermal-lag",
                ("EZZ",),
                ("z-column",),
                parameters={"time_constant_min": 41.2, "share": 1.0},
                standard_errors={"time_constant_min": 1.9},
            ),
            "EZZ follows z-column 41 ± 2 min late",
        ),
        *(
            (
                Effect(
                    kind,
                    ("EZZ",),
                    ("z-column",) if kind == "thermal-lag" else ("z-column", "spindle"),
                    parameters={"time_constant_min": 10.0, "share": share},
                    standard_errors={"time_constant_min": 1.0, "share": 0.05},
                ),
                told,
            )
            for kind, share, told in (
                ("thermal-lag", 0.93, "EZZ follows z-column 10.0 ± 1.0 min late"),
                (
                    "thermal-lag",
                    0.6,
                    "EZZ follows z-column 10.0 ± 1.0 min late (share 0.60 ± 0.05)",
                ),
                (
                    "thermal-lag",
                    -0.6,
                    "EZZ overshoots while z-column changes, and settles with a time constant of "
                    "10.0 ± 1.0 min (share -0.60 ± 0.05)",
                ),
                (
                    "other-sensor",
                    0.6,
                    "EZZ follows spindle rather than z-column (share 0.60 ± 0.05)",
                ),
                (
                    "other-sensor",
                    -0.6,
                    "EZZ moves the opposite way to what spindle says where it differs from "
                    "z-column (share -0.60 ± 0.05)",
                ),
            )
        ),
        (
            Effect(
                "sensor-fault",
                ("EXX", "EYX", "EYY", "SXY"),
                ("x-middle",),
                parameters={"bias_k": 0.8, "changed_at_unix_s": START_S},
                standard_errors={"bias_k": 0.05},
            ),
            "x-middle has read wrong by 0.80 ± 0.05 K since about 2026-03-01 00:00 UTC (seen in "
            "EXX, EYX, EYY and 1 more)",
        ),
        *(
            (
                Effect(
                    kind,
                    ("EZZ",),
                    sensors,
                    variant=variant,
                    parameters={"time_constant_min": 41.2, "slope_um_per_k": 1.7},
                    standard_errors={"time_constant_min": 1.9, "slope_um_per_k": 0.1},
                ),
                told,
            )
            for kind, sensors, variant, told in (
                (
                    "additional-sensor",
                    ("bed",),
                    "beyond the maps, late",
                    "EZZ also moves with bed, 41 ± 2 min late, by 1.70 ± 0.10 µm/K",
                ),
                (
                    "sensor-gradient",
                    ("bed", "spindle"),
                    "since the maps, late",
                    "EZZ bends with the difference between bed and spindle, 41 ± 2 min late, "
                    "by 1.70 ± 0.10 µm/K (it did not when the maps were measured)",
                ),
            )
        ),
        (
            Effect(
                "state-variable",
                ("EZZ",),
                states=("spindle_rpm",),
                variant="squared, late",
                parameters={"time_constant_min": 25.0, "slope_um_per_spindle_rpm_squared": 2.1e-7},
                standard_errors={
                    "time_constant_min": 3.0,
                    "slope_um_per_spindle_rpm_squared": 1e-8,
                },
            ),
            "EZZ moves with the square of spindle_rpm, 25 ± 3 min late, "
            "by (2.10 ± 0.10)·10⁻⁷ µm/spindle_rpm²",
        ),
    ],
)
def test_explanations(effect, told):
    assert explain(effect) == told


def test_what_the_maps_contain_is_not_lacking():
    """A second sensor that does what it did in the maps adds nothing: the maps have it."""
    where = example_view()
    driver = where.beyond_maps("EZZ", "spindle")
    assert driver.in_maps_c == ((22.0, 30.0), (26.0, 38.0), (32.0, 50.0))
    as_in_maps = moment(z_column=24.0, spindle=34.0)
    assert driver.at(as_in_maps).tolist() == [0.0]
    difference = where.beyond_maps("EZZ", "spindle", "z-column")
    assert difference.at(as_in_maps).tolist() == [0.0]
    assert difference.at(moment(z_column=24.0, spindle=36.0)).tolist() == [2.0]


@pytest.mark.parametrize(
    ("share", "error", "is_doubted"),
    [
        (1.0, 0.05, False),
        (1.1, 0.05, False),
        (1.2, 0.05, True),
        (3.2, 0.3, True),
        (-0.6, 0.1, False),
    ],
)
def test_what_follows_late_by_more_than_the_whole_is_no_lag_for_sure(share, error, is_doubted):
    lag = Effect(
        "thermal-lag",
        ("EZZ",),
        ("z-column",),
        parameters={"time_constant_min": 140.0, "share": share},
        standard_errors={"time_constant_min": 17.0, "share": error},
    )
    doubt = kind_of("thermal-lag").doubt(lag)
    assert bool(doubt) == is_doubted
    if is_doubted:
        assert f"{share:.2g}" in doubt
        assert "z-column" in doubt

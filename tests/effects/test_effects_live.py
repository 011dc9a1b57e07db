"""Effects in live tables: new components, both directions, finer positions, missing conditions."""

import numpy as np
import pytest

from app.effects.adopted.contributions import contributions
from app.effects.adopted.live_effects import corrected_tables
from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import Conditions, Signal
from app.effects.driver import (
    AboveReference,
    Always,
    Behind,
    SinceReference,
    State,
)
from app.effects.effect import Effect
from app.effects.low_pass import LagState
from app.effects.shape import (
    Everywhere,
    Exchange,
    Profile,
    Rising,
    Sensitivity,
    Wave,
)
from app.effects.term import Term
from tests.effects.example_campaign_view import START_S, all_rows, example_view

HALF = Rising(250.0, 250.0)
NO_NUMBER = Profile((0.0, 500.0), (1.0, np.nan))
TEMPERATURES = {"x-middle": 22.0, "y-front": 21.0, "z-column": 24.0, "spindle": 34.0}


def effect(*terms, kind="outdated-map"):
    return Effect(kind, tuple(dict.fromkeys(t.component for t in terms)), terms=terms)


def tables(*effects, moment=None):
    model = example_view().model
    states = model.errors_at(TEMPERATURES)
    moment = moment or Conditions.of_moment(START_S, TEMPERATURES)
    found = corrected_tables(model, effects, moment, states)
    return all_rows(states, found), found.missing


def test_without_effects_tables_are_what_they_were():
    found, missing = tables()
    assert not missing
    assert found["EXX"].errors.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert found["EXX"].effects == ()
    assert list(found) == ["EXX", "EYX", "EYY", "EZZ", "SXY"]


def test_a_shift_and_a_slope_add_up():
    found, _ = tables(
        effect(Term("EXX", Always(), Everywhere(), 3.0)), effect(Term("EXX", Always(), HALF, 1.0))
    )
    assert found["EXX"].errors.tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert found["EXX"].backward_errors is None
    assert found["EXX"].effects == (0, 1)
    assert found["EYX"].effects == ()


def test_a_reversal_gives_both_directions():
    found, _ = tables(effect(Term("EXX", Always(), Everywhere(), 1.5, is_reversing=True)))
    assert found["EXX"].errors.tolist() == [1.5, 2.0, 2.5, 3.0, 3.5]
    assert found["EXX"].backward_errors.tolist() == [-1.5, -1.0, -0.5, 0.0, 0.5]


def test_a_sine_refines_the_positions_and_keeps_the_maps_own():
    found, _ = tables(effect(Term("EXX", Always(), Wave(20.0, False), 2.0)))
    exx = found["EXX"]
    assert np.isin([0.0, 125.0, 250.0, 375.0, 500.0], exx.positions_mm).all()
    assert np.diff(exx.positions_mm).max() <= 20.0 / 16 + 1e-9
    expected = 2.0 * exx.positions_mm / 500.0 + 2.0 * np.sin(2 * np.pi * exx.positions_mm / 20.0)
    np.testing.assert_allclose(exx.errors, expected, atol=1e-9)
    # Between the corners a polygon stays within 2 % of its sine.
    at = np.linspace(0.0, 500.0, 7919)
    polygon = np.interp(at, exx.positions_mm, exx.errors) - 2.0 * at / 500.0
    assert np.abs(polygon - 2.0 * np.sin(2 * np.pi * at / 20.0)).max() < 0.04


@pytest.mark.parametrize(("pitch_mm", "lost"), [(1.0, 0.16), (2.0, 0.04)])
def test_a_table_of_a_short_pitch_stays_near_its_sine(pitch_mm, lost):
    found, missing = tables(effect(Term("EXX", Always(), Wave(pitch_mm, False), 2.0)))
    at = np.linspace(0.0, 500.0, 20011)
    polygon = np.interp(at, found["EXX"].positions_mm, found["EXX"].errors) - 2.0 * at / 500.0
    assert not missing
    assert np.abs(polygon - 2.0 * np.sin(2 * np.pi * at / pitch_mm)).max() < lost


@pytest.mark.parametrize("pitch_mm", [0.99, 0.2, 0.125])
def test_a_pitch_that_is_too_short_for_a_table_is_left_out_and_predicted_exactly(pitch_mm):
    sine = effect(Term("EXX", Always(), Wave(pitch_mm, False), 2.0))
    found, missing = tables(sine)
    assert found["EXX"].errors.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    (one,) = missing
    assert f"its pitch of {pitch_mm} mm" in one.reason
    assert "over 500 mm of travel" in one.reason
    assert "predictions" in one.reason
    where = example_view()
    chosen = where.rows.of_channel("EXX")
    predicted = contributions(where.projection, [sine])
    assert not predicted.missing
    at = where.rows.points_mm[chosen, 0]
    expected = 2.0 * np.sin(2 * np.pi * at / pitch_mm)
    np.testing.assert_allclose(predicted.errors[chosen], expected, atol=1e-9)


def test_squareness_has_no_position():
    found, _ = tables(effect(Term("SXY", SinceReference(START_S - 86400.0), Everywhere(), 2.0)))
    assert found["SXY"].positions_mm.size == 0
    assert found["SXY"].errors.tolist() == [3.0 * 2.0 + 2.0]


def test_components_that_no_map_has_appear():
    found, _ = tables(
        effect(Term("EAX", Always(), Everywhere(), 7.0)),
        effect(Term("EYY^x", AboveReference("x-middle", 20.0), HALF, 4.0)),
    )
    assert found["EAX"].errors.tolist() == [7.0]
    assert found["EAX"].positions_mm.tolist() == [250.0]
    assert found["EAX"].origin is None
    assert found["EYY^x"].positions_mm.tolist() == [0.0, 500.0]
    assert found["EYY^x"].errors.tolist() == [-8.0, 8.0]
    assert list(found) == ["EXX", "EYX", "EAX", "EYY", "EZZ", "SXY", "EYY^x"]


@pytest.mark.parametrize(
    ("term", "reason"),
    [
        (Term("EXX", State("spindle_rpm")), "no state spindle_rpm (there are none)"),
        (
            Term("EXX", Behind("x-middle", 600.0), Sensitivity(is_local=False)),
            "the history of x-middle is not known here",
        ),
        (
            Term("EXX", AboveReference("bed", 20.0)),
            "no temperature bed (there are x-middle, y-front, z-column, spindle)",
        ),
        (
            Term("EXX", Always(), Exchange.of("spindle", {"Run #1": 30.0, "Run #3": 38.0})),
            "map 'Run #6' was made after the analysis, so what spindle read is not known",
        ),
        (
            Term(
                *("EXX", Always()),
                Exchange.of("spindle", {"Run #1": 30.0, "Run #3": 38.0, "Run #6": 38.0}),
            ),
            "maps 'Run #3' and 'Run #6' are only 0 °C apart at spindle, too close for that "
            "sensor to resolve",
        ),
        (Term("EXX", Always(), NO_NUMBER), "what drives it has no usable value here"),
        (Term("EBZ", Always(), Sensitivity(is_local=True)), "the model has no EBZ"),
    ],
)
def test_an_effect_that_lacks_its_condition_is_left_out_with_the_reason(term, reason):
    shift = Term("EXX", Always(), Everywhere(), 3.0)
    found, missing = tables(effect(shift), effect(shift, term))
    assert [(m.effect, m.reason) for m in missing] == [(1, reason)]
    assert found["EXX"].errors.tolist() == [3.0, 3.5, 4.0, 4.5, 5.0]


def test_predictions_leave_out_what_gives_no_number():
    where = example_view()
    alike = Exchange.of("spindle", {"Run #1": 30.0, "Run #3": 38.0, "Run #6": 38.02})
    for shape, reason in ((alike, "too close for that sensor"), (NO_NUMBER, "no usable value")):
        found = contributions(where.projection, [effect(Term("EXX", Always(), shape))])
        assert np.isfinite(found.errors).all()
        assert found.is_lacking[where.rows.of_channel("EXX")].all()
        assert reason in found.missing[0].reason


def test_a_failed_sensor_is_named():
    model = example_view().model
    lag = effect(Term("EXX", Always(), Sensitivity(is_local=True)))
    moment = Conditions.of_moment(START_S, {"y-front": 21.0})
    assert corrected_tables(model, [lag], moment).missing[0].reason == (
        "no temperature x-middle (there are y-front)"
    )


def test_a_lag_goes_live_with_carried_filters():
    signal = Signal("temperature", "x-middle")
    lags = LiveLags({(signal, 600.0): LagState(600.0, START_S - 2999.0, START_S, 21.0, 21.0)})
    lag = effect(Term("EXX", Behind("x-middle", 600.0), Sensitivity(is_local=False)))
    young = Conditions.of_moment(START_S, TEMPERATURES, {}, lags)
    assert tables(lag, moment=young)[1][0].reason == (
        "expected 50 min of readings of x-middle without a gap (five time constants), got 50 min"
    )
    lags = LiveLags({(signal, 600.0): LagState(600.0, START_S - 3000.0, START_S, 21.0, 21.0)})
    found, missing = tables(lag, moment=Conditions.of_moment(START_S, TEMPERATURES, {}, lags))
    assert not missing
    # EXX as at 21 °C instead of 22.
    assert found["EXX"].errors.tolist() == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_predictions_name_what_they_lack():
    where = example_view()
    shift = effect(Term("EXX", Always(), Everywhere(), 3.0))
    feed = effect(Term("EZZ", State("feed"), Everywhere(), 1.0), kind="state-variable")
    found = contributions(where.projection, [shift, feed])
    total, missing = found.errors, found.missing
    assert np.flatnonzero(found.is_lacking).tolist() == where.projection.view("EZZ").rows.tolist()
    assert total[where.rows.of_channel("EXX")] == pytest.approx(3.0)
    assert not total[where.rows.of_channel("EZZ")].any()
    (lacking,) = missing
    assert (lacking.effect, lacking.kind) == (1, "state-variable")
    assert lacking.reason.startswith("no state feed (there are spindle_rpm, payload_kg)")

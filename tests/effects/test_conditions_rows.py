"""Conditions of some rows share what they are picked from."""

import numpy as np

from app.effects.conditions import Conditions, Signal
from app.effects.driver import AboveReference, Always, Behind
from app.effects.shape import Everywhere
from app.effects.term import Term
from tests.effects.example_campaign_view import example_view


def test_some_rows_of_conditions_are_picked_out_when_they_are_asked_for():
    rng = np.random.default_rng(1)
    temperatures, states, rates = ({"a": rng.random(50)} for _ in range(3))
    whole = Conditions(np.arange(50.0), temperatures, states, rates_c_per_h=rates)
    some, fewer = np.array([40, 3, 7, 7]), np.array([2, 0])
    for taken, rows in ((whole.take(some), some), (whole.take(some).take(fewer), some[fewer])):
        assert taken.times_s.tolist() == rows.tolist()
        for kept, given in (
            (taken.temperatures_c, temperatures),
            (taken.states, states),
            (taken.rates_c_per_h, rates),
        ):
            assert dict(kept).keys() == {"a"}
            assert kept["a"].tolist() == given["a"][rows].tolist()
            assert kept.signals is given, "nothing is copied"
        assert np.isnan(taken.temperature("b")).all()


def test_what_is_late_for_the_whole_campaign_is_picked_out_for_its_components():
    view = example_view()
    signal = Signal("temperature", view.varying_sensors[0])
    tau_s = view.time_constants_s(signal)[0]
    own = view.projection.view("EXX").conditions
    assert (signal, tau_s) in own.late
    made = own.lags.lagged(signal, tau_s, own.times_s)
    np.testing.assert_array_equal(own.lagged(signal, tau_s), made)
    np.testing.assert_array_equal(
        own.lagged(signal, 1.1 * tau_s), own.lags.lagged(signal, 1.1 * tau_s, own.times_s)
    )


def test_what_some_components_do_is_taken_apart_by_channel_from_their_rows_alone():
    projection = example_view().projection
    sensor = "x-middle"
    late = Behind(sensor, 3600.0 * 24.0)
    amplitudes = [
        [Term("EXX", Always()), Term("EYX", AboveReference(sensor, 20.0), Everywhere())],
        [Term("EXX", late)],
    ]
    columns = projection.columns(amplitudes)
    assert np.isnan(columns).any(), "the past of the first rows is not known"
    found = projection.parts(amplitudes)
    expected = projection.parts_of(columns)
    assert [part.channel for part in found] == [part.channel for part in expected]
    for part, whole in zip(found, expected, strict=True):
        assert np.isin(part.rows, whole.rows).all()
        spread = np.zeros(columns.shape)
        spread[part.rows] = part.columns
        np.testing.assert_array_equal(spread[whole.rows], whole.columns)

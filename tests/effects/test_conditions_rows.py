"""Conditions of some rows share what they are picked from."""

import numpy as np

from app.effects.conditions import Conditions


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

"""Residuals over one quantity in ranges: how many there are of few values."""

import numpy as np

from app.identification.residuals.summary import by_range

AT = np.arange(14.0)


def test_ranges_of_few_values_hold_some_each():
    assert len(by_range("T", AT, AT).bins) == 10
    bins = by_range("T", AT, AT, fewest=4).bins
    assert [b.count for b in bins] == [5, 4, 5]
    assert sum(b.count * b.mean for b in bins) == AT.sum()
    (whole,) = by_range("T", AT[:3], AT[:3], fewest=4).bins
    assert (whole.count, whole.low, whole.high) == (3, 0.0, 2.0)


def test_values_that_stand_apart_are_ranges_of_their_own():
    speeds = np.repeat([0.0, 3000.0, 6000.0], 5)
    bins = by_range("state rpm", speeds, speeds, fewest=4).bins
    assert [(b.low, b.high) for b in bins] == [(s, s) for s in (0.0, 3000.0, 6000.0)]

"""Bins of temperatures: put together, they are what the readings themselves give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.thermal.temperature_bins import WIDTHS_S, Part, merge_bins, no_bins, width_for


def bins_of(times_s, values):
    """One bin for each reading."""
    columns = [times_s, values, values, values, np.ones(len(times_s)), times_s, times_s]
    return np.column_stack([*columns, np.zeros(len(times_s))])


READINGS = st.lists(
    st.tuples(st.integers(0, 200_000), st.floats(-50.0, 150.0)), min_size=1, max_size=60
).map(lambda pairs: sorted(dict(pairs).items()))


@given(READINGS, st.sampled_from([60, 600, 3600, 86_400]))
def test_a_bin_has_what_its_readings_have(readings, width_s):
    times_s, values = (np.array(column, dtype=float) for column in zip(*readings, strict=True))
    found = merge_bins(bins_of(times_s, values), width_s)
    before = None
    for row in found:
        here = (times_s >= row[Part.START]) & (times_s < row[Part.START] + width_s)
        assert row[Part.COUNT] == here.sum()
        assert row[Part.LOW] == values[here].min()
        assert row[Part.HIGH] == values[here].max()
        assert row[Part.MEAN] == pytest.approx(values[here].mean())
        own = times_s[here] if before is None else np.append(before, times_s[here])
        assert row[Part.GAP] == (np.diff(own).max() if len(own) > 1 else 0.0)
        before = times_s[here][-1]
    assert found[:, Part.COUNT].sum() == len(times_s)


@given(READINGS)
def test_hours_of_minutes_are_hours_of_readings(readings):
    times_s, values = (np.array(column, dtype=float) for column in zip(*readings, strict=True))
    own = bins_of(times_s, values)
    np.testing.assert_allclose(merge_bins(merge_bins(own, 60), 3600), merge_bins(own, 3600))


def test_nothing_gives_nothing():
    assert merge_bins(no_bins(), 60).shape == (0, 8)


@given(st.floats(1.0, 3e8), st.integers(10, 5000))
def test_no_more_bins_than_asked_for(span_s, points):
    width_s = width_for(span_s, points)
    assert span_s / width_s <= points or width_s == WIDTHS_S[-1]
    assert all(3600 % width == 0 or width % 3600 == 0 for width in WIDTHS_S)

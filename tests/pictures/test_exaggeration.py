"""The factor by which errors are drawn larger: round, and such that they are seen."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry.work_volume import WorkVolume
from app.pictures.exaggeration import automatic_exaggeration

LENGTHS = st.floats(1.0, 1e5)


@given(st.floats(1e-3, 1e4), LENGTHS, LENGTHS, LENGTHS)
def test_it_is_round_and_draws_the_largest_error_an_eighth_of_the_typical_side(largest, x, y, z):
    factor = automatic_exaggeration(largest, WorkVolume((0.0, x), (-y, 0.0), (5.0, 5.0 + z)))
    digits = f"{factor:.15e}".split("e")[0].rstrip("0").rstrip(".")
    assert digits in {"1", "2", "5"}
    sides = [x, y, (5.0 + z) - 5.0]
    share = factor * largest / 1000.0 / math.sqrt(min(sides) * max(sides))
    # The nearest of 1, 2, 5, 10 is at most √2.5 away.
    assert 0.12 / math.sqrt(2.51) < share < 0.12 * math.sqrt(2.51)


def test_a_missing_axis_counts_for_nothing():
    flat = WorkVolume((0.0, 400.0), (0.0, 0.0), (0.0, 400.0))
    cube = WorkVolume((0.0, 400.0), (0.0, 400.0), (0.0, 400.0))
    assert automatic_exaggeration(30.0, flat) == automatic_exaggeration(30.0, cube) == 2000.0


def test_errors_as_large_as_the_machine_are_drawn_smaller():
    assert automatic_exaggeration(1e6, WorkVolume((0.0, 100.0), (0.0, 0.0), (0.0, 0.0))) == 0.01


@pytest.mark.parametrize("largest", [0.0, 1e-7])
def test_no_error_is_drawn_as_it_is(largest):
    assert automatic_exaggeration(largest, WorkVolume((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))) == 1.0

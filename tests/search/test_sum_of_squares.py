"""How surprising the size of some values is."""

import numpy as np
import pytest
from scipy import stats

from app.search.sum_of_squares import surprise_of_squares, tail_of_squares

NONE = np.zeros((6, 0))


@pytest.mark.parametrize("freedom", [1.0, 3.0, 20.0])
@pytest.mark.parametrize("probability", [0.1, 1e-2, 1e-4, 1e-8])
def test_of_one_variance_it_is_the_chi_square_tail(freedom, probability):
    total = 2.0 * stats.chi2.isf(probability, freedom)
    found = tail_of_squares(total, np.array([2.0]), np.array([freedom]))
    assert found == pytest.approx(probability, rel=0.12)


def test_of_several_variances_it_is_what_draws_show():
    variances, counts = np.array([9.0, 1.0]), np.array([1.0, 12.0])
    rng = np.random.default_rng(3)
    drawn = 9.0 * rng.chisquare(1, 400_000) + rng.chisquare(12, 400_000)
    for total in (30.0, 50.0, 80.0):
        share = float(np.mean(drawn > total))
        assert tail_of_squares(total, variances, counts) == pytest.approx(share, rel=0.06)


@pytest.mark.parametrize("freedom", [2.0, 10.0, 40.0])
def test_a_repeatability_that_is_only_estimated_makes_it_the_f_test(freedom):
    total = 6.0 * stats.f.isf(1e-3, 6, freedom)
    found = surprise_of_squares(total, 1.0, freedom, NONE, NONE, 6)
    # Never more sure than the exact test, and not much less.
    assert 0.9e-3 < found < 1.5e-3


def test_what_two_values_say_of_their_own_repeatability_makes_nothing_surprising():
    """Two values of one set-up that happen to agree are no measurement of their scatter."""
    two = np.zeros((2, 0))
    assert surprise_of_squares(2.0 * 4.0**2, 1.0, 1.0, two, two, 2) > 0.1
    assert surprise_of_squares(2.0 * 4.0**2, 1.0, 30.0, two, two, 2) < 1e-4


@pytest.mark.parametrize("is_noise", [True, False], ids=["set-ups", "maps"])
def test_what_values_share_is_less_surprising(is_noise):
    shared = np.ones((6, 1)) * 2.0
    spread, others = (shared, NONE) if is_noise else (NONE, shared)
    found = surprise_of_squares(6.0 * 9.0, 1.0, 30.0, spread, others, 6)
    assert found > 0.1
    assert surprise_of_squares(6.0 * 9.0, 1.0, 30.0, NONE, NONE, 6) < 1e-4

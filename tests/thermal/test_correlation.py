"""Correlation, its interval and the comparison of two against printed values."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from app.thermal.correlation import fisher_interval, pearson_r, tell_apart, williams_t


def test_pearsons_r_is_scipys():
    rng = np.random.default_rng(1)
    for n in (2, 3, 6, 40):
        one, other = rng.normal(size=(2, n))
        assert pearson_r(one, other) == pytest.approx(stats.pearsonr(one, other).statistic)


@given(
    st.lists(st.integers(-1000, 1000), min_size=3, max_size=20),
    st.floats(0.001, 1000.0),
    st.floats(-1000.0, 1000.0),
)
def test_units_and_zero_points_do_not_matter_and_a_line_is_one(values, scale, shift):
    assume(len(set(values)) > 1)
    one = np.array(values, dtype=float)
    assert pearson_r(one, scale * one + shift) == pytest.approx(1.0, abs=1e-7)
    assert pearson_r(one, -scale * one + shift) == pytest.approx(-1.0, abs=1e-7)
    assert -1.0 <= pearson_r(one, one) <= 1.0


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_no_size_of_numbers_makes_it_nan(size):
    """The squares of these are no numbers; filterwarnings makes an overflow an error."""
    one = np.array([1.0, 2.0, 4.0])
    assert pearson_r(one * size, np.array([1.0, -2.0, 5.0])) == pytest.approx(
        pearson_r(one, np.array([1.0, -2.0, 5.0]))
    )


@pytest.mark.parametrize(("r", "n"), [(0.5, 28), (-0.97, 6), (0.0, 4), (0.999, 300)])
def test_fishers_interval_is_scipys(r, n):
    """Data made to have exactly this r: a residual orthogonal to x is added to r·x."""
    rng = np.random.default_rng(n)
    x, e = rng.normal(size=(2, n))
    x = (x - x.mean()) / np.linalg.norm(x - x.mean())
    e = e - e.mean() - ((e - e.mean()) @ x) * x
    y = r * x + math.sqrt(1 - r * r) * e / np.linalg.norm(e)
    reference = stats.pearsonr(x, y).confidence_interval(0.95)
    assert fisher_interval(r, n) == pytest.approx(tuple(reference), abs=1e-9)


def test_the_interval_needs_four_and_is_never_nan():
    assert fisher_interval(0.9, 3) is None
    assert fisher_interval(1.0, 2) is None
    assert fisher_interval(1.0, 6) == (1.0, 1.0)
    assert fisher_interval(-1.0, 4) == (-1.0, -1.0)
    low, high = fisher_interval(0.9, 4)
    # tanh(atanh 0.9 ± 1.959964): by hand.
    assert (low, high) == pytest.approx((-0.4527, 0.9979), abs=5e-4)


@pytest.mark.parametrize(
    ("r_ya", "r_yb", "r_ab", "n", "t"),
    [
        # Steiger 1980, p. 249, masculinity and femininity with verbal ability: T2 = -.8913.
        (0.4, 0.5, 0.1, 103, -0.8913),
        # Silver, Hittner and May 2006 (DEPCOR), as the tests of R's cocor cite it.
        (0.3, 0.4, 0.5, 100, -1.0767),
    ],
)
def test_williams_t_has_the_printed_values(r_ya, r_yb, r_ab, n, t):
    assert williams_t(r_ya, r_yb, r_ab, n) == pytest.approx(t, abs=5e-5)
    assert williams_t(r_yb, r_ya, r_ab, n) == pytest.approx(-t, abs=5e-5)


def test_depcors_probability():
    """The same source prints p = .2843 with n − 3 degrees of freedom."""
    t = williams_t(0.3, 0.4, 0.5, 100)
    assert 2 * stats.t.sf(abs(t), 97) == pytest.approx(0.2843, abs=5e-5)


def test_two_sensors_that_read_alike_never_differ():
    """r_ab = 1 to rounding: 0/0 without care, or a huge t from two differing last bits."""
    assert williams_t(0.9, 0.9, 1.0, 6) == 0.0
    assert williams_t(0.9, 0.9 - 1e-15, 1.0, 6) == 0.0
    assert williams_t(0.9, 0.9 - 1e-15, 1.0 - 1e-16, 300) == 0.0
    assert not tell_apart(0.9, 0.9 - 1e-12, 1.0, 300)


def test_perfect_correlations_have_a_t():
    """Where y is a, and b is not, T2 is 2 √((n−1)/(1−r_ab²)) (the formula by hand)."""
    assert williams_t(1.0, 0.8, 0.8, 6) == pytest.approx(2 * math.sqrt(5 / (1 - 0.64)))


def test_three_observations_tell_nothing_apart():
    assert not tell_apart(1.0, 0.0, 0.0, 3)
    assert not tell_apart(1.0, 0.0, 0.0, 2)
    assert tell_apart(1.0, 0.0, 0.0, 300)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "r_ab"), [(5, 0.5), (12, 0.9), (40, 0.0)])
def test_equal_correlations_are_told_apart_once_in_twenty(n, r_ab):
    """Samples of three normal variables with ρ_ya = ρ_yb = 0.6, as the test's level says.

    3000 samples: the standard error of a 5 % rate is 0.4 %. The test is known to be a
    little conservative.
    """
    rng = np.random.default_rng(1959)
    covariance = np.array([[1.0, 0.6, 0.6], [0.6, 1.0, r_ab], [0.6, r_ab, 1.0]])
    samples = rng.multivariate_normal(np.zeros(3), covariance, size=(3000, n))
    rejected = sum(
        tell_apart(c[0, 1], c[0, 2], c[1, 2], n)
        for c in (np.corrcoef(sample.T) for sample in samples)
    )
    assert 0.03 < rejected / 3000 < 0.065

"""How uncertainty is stated and refused, and its way through interpolation over positions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.thermal.error_map import ComponentTable
from app.thermal.resampling import interpolation_matrix, sample_table, sample_variances
from app.thermal.uncertainty import (
    MOST_CORRELATED,
    propagate,
    standard_errors_of,
    stated_covariance,
    variances_of,
    without_zeros,
)

EXX, EBX, SXY = (COMPONENTS[code] for code in ("EXX", "EBX", "SXY"))


def exx(positions_mm, covariance, **more):
    return ComponentTable.make(
        EXX, np.zeros(len(positions_mm)), positions_mm, covariance=covariance, **more
    )


def random_covariance(rng, n):
    """Correlated errors of unlike sizes."""
    root = rng.normal(size=(n, n)) * rng.uniform(0.2, 2.0, (n, 1))
    return root @ root.T / n


# --- stating it --------------------------------------------------------------------------


def test_standard_errors_are_roots_of_variances():
    assert stated_covariance(EXX, 3, [0.0, 0.5, 2.0], None).tolist() == [0.0, 0.25, 4.0]
    assert stated_covariance(SXY, 1, [3.0], None).tolist() == [9.0]


def test_nothing_stated_is_nothing_known():
    assert stated_covariance(EXX, 3, None, None) is None
    table = ComponentTable.make(EXX, [1.0], [0.0])
    assert (table.standard_errors, table.backward_standard_errors) == (None, None)


@given(st.lists(st.floats(1e-150, 1e6) | st.just(0.0), min_size=1, max_size=20))
def test_standard_errors_come_back_to_the_last_bit(stated):
    covariance = stated_covariance(EXX, len(stated), stated, None)
    table = ComponentTable.make(EXX, stated, range(len(stated)), covariance=covariance)
    assert table.standard_errors.tolist() == stated


def test_both_may_be_stated_where_they_agree():
    both = stated_covariance(EXX, 2, [2.0, 3.0], [[4.0, 1.0], [1.0, 9.0]])
    assert both.tolist() == [[4.0, 1.0], [1.0, 9.0]]
    # Four digits: √2 = 1.414.
    assert stated_covariance(EXX, 1, [1.414], [[2.0]]).tolist() == [[2.0]]


@pytest.mark.parametrize(
    ("component", "n", "errors", "covariance", "field", "sentence"),
    [
        (
            EXX, 3, [1.0, 2.0], None, "standard_errors_um",
            "expected 3 standard errors of EXX in µm, one for each position, got 2",
        ),
        (
            EBX, 2, [1.0, -0.5], None, "standard_errors_urad",
            "expected standard errors of EBX from 0 to 1e+06 µrad, got -0.5 (at index 1)",
        ),
        (
            EXX, 2, [math.nan, 1.0], None, "standard_errors_um",
            "got nan (at index 0)",
        ),
        (
            SXY, 1, [2e6], None, "standard_error_um_per_m",
            "expected standard errors of SXY from 0 to 1e+06 µm/m, got 2e+06",
        ),
        (
            EXX, 3, None, [[1.0, 0.0], [0.0, 1.0]], "covariance",
            "expected 3 rows of 3 numbers in (µm)², got 2 rows of 2",
        ),
        (
            EXX, 2, None, [[1.0, 0.0], [0.0]], "covariance",
            "expected 2 rows of 2 numbers in (µm)², got 2 rows of 1 or 2",
        ),
        (
            EXX, 2, None, [[1.0, math.inf], [0.0, 1.0]], "covariance",
            "expected a finite covariance of EXX in (µm)², got inf (at index 0, 1)",
        ),
        (
            EXX, 2, None, [[1.0, 0.0], [0.0, -4.0]], "covariance",
            "expected variances of EXX from 0 to 1e+12 (µm)², got -4 (at index 1)",
        ),
        (
            EBX, 2, None, [[1.0, 0.5], [0.4, 1.0]], "covariance",
            "expected a symmetric covariance of EBX in (µrad)², got 0.5 (at index 0, 1) and "
            "0.4 (at index 1, 0)",
        ),
        (
            EXX, 2, None, [[1.0, 2.0], [2.0, 1.0]], "covariance",
            "expected a positive semidefinite covariance of EXX in (µm)², in which no sum of "
            "errors has a negative variance, got one with the eigenvalue -1",
        ),
        (
            EXX, 2, None, [[0.0, 1.0], [1.0, 0.0]], "covariance",
            "got one with the eigenvalue -1",
        ),
        (
            # Each pair by itself could be; the three together cannot.
            EXX, 3, None, [[1.0, -0.9, -0.9], [-0.9, 1.0, -0.9], [-0.9, -0.9, 1.0]],
            "covariance", "got one with the eigenvalue -0.8",
        ),
        (
            EXX, 2, [1.0, 1.5], [[1.0, 0.0], [0.0, 4.0]], "covariance",
            "got 1.5 µm there and 2 µm here (at index 1)",
        ),
        (
            EXX, MOST_CORRELATED + 1, None, [[]] * (MOST_CORRELATED + 1), "covariance",
            "for at most 1000 positions, got 1001",
        ),
    ],
)  # fmt: skip
def test_what_is_no_uncertainty_is_refused(component, n, errors, covariance, field, sentence):
    for before in ("", "backward_"):
        with pytest.raises(InvalidContent) as refusal:
            stated_covariance(component, n, errors, covariance, before)
        assert sentence in refusal.value.detail
        assert [e.field for e in refusal.value.errors] == [before + field]


@pytest.mark.parametrize("covariance", [np.ones((2, 3)), np.ones((3, 3)), np.ones(3)])
def test_a_table_refuses_a_covariance_of_another_size(covariance):
    with pytest.raises(InvalidContent, match=r"covariance of EXX in \(µm\)² of 2 by 2, got an"):
        exx([0.0, 1.0], covariance)


def test_a_table_of_one_direction_has_no_backward_covariance():
    with pytest.raises(InvalidContent, match="expected backward_errors_um of EXX beside it"):
        exx([0.0, 1.0], None, backward_covariance=[1.0, 1.0])


@pytest.mark.parametrize("digits", [6, 9, 16])
def test_a_covariance_rounded_to_six_digits_is_one(digits):
    """Sums of few independent causes: most eigenvalues are 0, and below it when rounded."""
    rng = np.random.default_rng(11)
    causes = rng.normal(size=(40, 3))
    rounded = [[float(f"{v:.{digits}g}") for v in row] for row in causes @ causes.T]
    assert np.linalg.eigvalsh(rounded)[0] < 0
    assert np.array_equal(stated_covariance(EXX, 40, None, rounded), rounded)


def test_many_positions_need_no_square_of_numbers():
    n = 100_000
    covariance = stated_covariance(EXX, n, np.full(n, 0.5).tolist(), None)
    table = exx(np.arange(n), covariance)
    found = sample_variances(table, np.arange(n - 1) + 0.5)
    np.testing.assert_allclose(found, 0.125)


# --- its two forms -----------------------------------------------------------------------


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=8))
def test_a_diagonal_covariance_is_its_standard_errors(standard_errors):
    n = len(standard_errors)
    alone = stated_covariance(EXX, n, standard_errors, None)
    matrix = stated_covariance(EXX, n, None, np.diag(alone).tolist())
    np.testing.assert_array_equal(variances_of(matrix), alone)
    np.testing.assert_array_equal(without_zeros(matrix), alone)
    np.testing.assert_array_equal(standard_errors_of(matrix), standard_errors_of(alone))
    jacobian = np.arange(3.0 * n).reshape(3, n)
    np.testing.assert_allclose(propagate(jacobian, matrix), propagate(jacobian, alone))
    at = np.linspace(0.0, n, 7)
    tables = [exx(np.arange(n), form) for form in (matrix, alone)]
    np.testing.assert_array_equal(*(sample_variances(table, at) for table in tables))


def test_what_is_off_the_diagonal_is_kept():
    covariance = np.array([[4.0, 0.0], [1e-300, 9.0]])
    assert without_zeros(covariance) is covariance
    assert without_zeros(np.zeros((2, 2))).tolist() == [0.0, 0.0]
    assert without_zeros(np.array([[0.0]])).tolist() == [0.0]


# --- between positions -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("correlation", "expected"),
    [(0.0, math.sqrt(0.5)), (1.0, 1.0), (-1.0, 0.0), (0.5, math.sqrt(0.75))],
)
def test_half_way_by_hand(correlation, expected):
    """√(¼ + ¼ + ½ρ) of the standard error at both ends."""
    table = exx([0.0, 100.0], [[1.0, correlation], [correlation, 1.0]])
    (found,) = np.sqrt(sample_variances(table, np.array([50.0])))
    assert found == pytest.approx(expected, abs=1e-12)


def test_at_its_own_positions_a_table_has_its_own_variances():
    rng = np.random.default_rng(3)
    for n in (1, 2, 7):
        table = exx(np.sort(rng.uniform(0, 500, n)), random_covariance(rng, n))
        found = sample_variances(table, table.positions_mm)
        np.testing.assert_array_equal(found, np.diagonal(table.covariance))


def test_one_position_holds_everywhere_and_one_value_has_no_position():
    at = np.array([0.0, 999.0])
    assert sample_variances(exx([250.0], [[4.0]]), at).tolist() == [4.0, 4.0]
    sxy = ComponentTable.make(SXY, [1.0], covariance=[[9.0]])
    assert sample_variances(sxy, np.empty(0)).tolist() == [9.0]


def test_each_direction_has_its_own_and_a_table_of_one_serves_both():
    at = np.array([0.0, 1.0])
    one = exx([0.0, 1.0], [1.0, 4.0])
    assert sample_variances(one, at, backward=True).tolist() == [1.0, 4.0]
    both = exx([0.0, 1.0], [1.0, 4.0], backward_errors=[0.0, 0.0])
    assert sample_variances(both, at, backward=True) is None
    both = exx([0.0, 1.0], None, backward_errors=[0.0, 0.0], backward_covariance=[9.0, 16.0])
    assert sample_variances(both, at) is None
    assert sample_variances(both, at, backward=True).tolist() == [9.0, 16.0]
    assert both.backward_standard_errors.tolist() == [3.0, 4.0]


@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_it_is_the_diagonal_of_the_whole_matrix_and_arrays_are_loops(n, seed):
    rng = np.random.default_rng(seed)
    table = exx(np.sort(rng.uniform(0, 500, n)), random_covariance(rng, n))
    at = np.sort(rng.uniform(*table.positions_mm[[0, -1]], 9))
    matrix = interpolation_matrix(table, at)
    whole = propagate(matrix, table.covariance)
    found = sample_variances(table, at)
    np.testing.assert_allclose(found, np.diagonal(whole), atol=1e-12)
    loop = [sample_variances(table, np.array([x])).item() for x in at]
    np.testing.assert_array_equal(found, loop)
    errors = rng.normal(size=n)
    drawn = ComponentTable.make(EXX, errors, table.positions_mm)
    np.testing.assert_allclose(matrix @ errors, sample_table(drawn, at), atol=1e-12)


@given(st.floats(1e-3, 1e3), st.integers(0, 2**32 - 1))
def test_errors_twice_as_uncertain_stay_twice_as_uncertain(scale, seed):
    rng = np.random.default_rng(seed)
    covariance = random_covariance(rng, 5)
    at = np.linspace(0.0, 4.0, 11)
    one, scaled = (sample_variances(exx(range(5), k**2 * covariance), at) for k in (1.0, scale))
    np.testing.assert_allclose(np.sqrt(scaled), scale * np.sqrt(one), rtol=1e-6)

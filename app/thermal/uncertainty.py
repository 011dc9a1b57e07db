"""The uncertainty of a component's errors: stated, checked, and carried along (GUM).

A covariance is a matrix (n, n) or, where the n errors are independent of each other, their
n variances alone: a table of many positions then needs no square of numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent
from app.geometry.components import Component

LARGEST: Final = 1e6
"""Standard errors of more than a metre [µm], a radian [µrad] are of a wrong unit."""

MOST_CORRELATED: Final = 1000
"""Positions of one component that may be correlated with each other: 8 MB."""

ASYMMETRY: Final = 1e-9
"""Of the largest variance; sums in another order differ by less."""

ROUNDING: Final = 1e-6
"""Of each number: matrices of six digits are taken though their eigenvalues fall below 0."""

DISAGREEMENT: Final = 1e-3
"""Of a standard error; rounding to four digits leaves less."""


def stated_covariance(
    component: Component,
    positions: int,
    standard_errors: Sequence[float] | None,
    covariance: Sequence[Sequence[float]] | None,
    before: str = "",
) -> FloatArray | None:
    """Take the uncertainty as a user states it: as standard errors, as a covariance, or both.

    Parameters
    ----------
    standard_errors
        n standard deviations [component.unit].
    covariance
        n rows of n numbers [component.unit squared].
    before
        What stands before the names of the fields: `backward_`.

    Returns
    -------
    ndarray, shape (n, n) or (n,) [component.unit squared]
        None where neither is stated.

    Raises
    ------
    InvalidContent
        If there are not n of them, one is negative or not finite, the matrix is not
        symmetric or not positive semidefinite (its rounding to six digits is
        tolerated), or both are stated and disagree.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> stated_covariance(COMPONENTS["EXX"], 2, [0.5, 1.0], None).tolist()
    [0.25, 1.0]
    """
    alone = None
    if standard_errors is not None:
        alone = _variances(component, positions, standard_errors, before)
    if covariance is None:
        return alone
    field = f"{before}covariance"
    if len(covariance) > MOST_CORRELATED:
        raise InvalidContent.of_field(
            field,
            f"expected a covariance of {component.code} for at most {MOST_CORRELATED} positions, "
            f"got {len(covariance)} (standard errors may be more)",
        )
    lengths = {len(row) for row in covariance}
    if len(covariance) != positions or lengths != {positions}:
        raise InvalidContent.of_field(
            field,
            f"expected {positions} rows of {positions} numbers in {_squared(component)}, got "
            f"{len(covariance)} rows of {' or '.join(map(str, sorted(lengths)))}",
        )
    matrix = frozen(covariance)
    check_covariance(component, field, matrix, positions)
    _check_semidefinite(component, field, matrix)
    if alone is not None:
        _check_agreement(component, field, alone, matrix)
    return matrix


def check_covariance(
    component: Component, field: str, covariance: FloatArray, positions: int
) -> None:
    """Refuse what cannot be the covariance of a component's errors.

    Parameters
    ----------
    covariance : ndarray, shape (n, n) or (n,) [component.unit squared]

    Raises
    ------
    InvalidContent
        If it has another shape, is not finite or not symmetric, or a variance is negative.
    """
    unit = _squared(component)
    what = f"covariance of {component.code} in {unit}"
    if covariance.shape not in {(positions, positions), (positions,)}:
        raise InvalidContent.of_field(
            field,
            f"expected a {what} of {positions} by {positions}, got an array of shape "
            f"{covariance.shape}",
        )
    if not np.isfinite(covariance).all():
        at = np.argwhere(~np.isfinite(covariance))[0].tolist()
        place = ", ".join(map(str, at))
        raise InvalidContent.of_field(
            field, f"expected a finite {what}, got {covariance[tuple(at)]:g} (at index {place})"
        )
    variances = variances_of(covariance)
    if variances.min() < 0 or variances.max() > LARGEST**2:
        wrong = int(np.argmax((variances < 0) | (variances > LARGEST**2)))
        raise InvalidContent.of_field(
            field,
            f"expected variances of {component.code} from 0 to {LARGEST**2:g} {unit}, got "
            f"{variances[wrong]:g} (at index {wrong})",
        )
    if covariance.ndim == 2:
        _check_symmetric(field, what, covariance)


def variances_of(covariance: FloatArray) -> FloatArray:
    """Take the variances out of a covariance.

    Parameters
    ----------
    covariance : ndarray, shape (n, n) or (n,) [unit squared]

    Returns
    -------
    ndarray, shape (n,) [unit squared]
    """
    return covariance if covariance.ndim == 1 else np.diagonal(covariance)


def standard_errors_of(covariance: FloatArray) -> FloatArray:
    """Take the standard errors out of a covariance.

    Parameters
    ----------
    covariance : ndarray, shape (n, n) or (n,) [unit squared]

    Returns
    -------
    ndarray, shape (n,) [unit]
        One standard deviation of each.

    Examples
    --------
    >>> standard_errors_of(np.array([[4.0, 1.0], [1.0, 9.0]])).tolist()
    [2.0, 3.0]
    """
    # Without the sign of −0.
    deviations: FloatArray = np.sqrt(np.abs(variances_of(covariance)))
    return deviations


def without_zeros(covariance: FloatArray) -> FloatArray:
    """Write the covariance of independent errors as their variances alone.

    Parameters
    ----------
    covariance : ndarray, shape (n, n) or (n,) [unit squared]

    Returns
    -------
    ndarray, shape (n,), or (n, n) where anything off the diagonal is not zero

    Examples
    --------
    >>> without_zeros(np.diag([4.0, 9.0])).tolist()
    [4.0, 9.0]
    """
    variances = variances_of(covariance)
    if np.count_nonzero(covariance) > np.count_nonzero(variances):
        return covariance
    return variances


def propagate(jacobian: ArrayLike, covariance: FloatArray) -> FloatArray:
    """Carry a covariance through a linear function, J C Jᵀ (GUM, 5.2.2).

    Parameters
    ----------
    jacobian : array-like, shape (m, n)
        What each of m results gains from each of n errors.
    covariance : ndarray, shape (n, n) or (n,) [unit squared]

    Returns
    -------
    ndarray, shape (m, m) [unit squared]
        Symmetric, and without variances that rounding has brought below 0.

    Examples
    --------
    >>> propagate([[0.5, 0.5]], np.array([4.0, 4.0])).tolist()
    [[2.0]]
    """
    j = np.asarray(jacobian, dtype=np.float64)
    gained = j * covariance if covariance.ndim == 1 else j @ covariance
    product = gained @ j.T
    propagated: FloatArray = (product + product.T) / 2
    np.fill_diagonal(propagated, np.maximum(np.diagonal(propagated), 0.0))
    return propagated


def _variances(
    component: Component, positions: int, standard_errors: Sequence[float], before: str
) -> FloatArray:
    """Square the standard errors that a user states."""
    field, unit = f"{before}{component.standard_error_field}", component.unit.symbol
    if len(standard_errors) != positions:
        raise InvalidContent.of_field(
            field,
            f"expected {positions} standard errors of {component.code} in {unit}, one for each "
            f"position, got {len(standard_errors)}",
        )
    deviations = np.asarray(standard_errors, dtype=np.float64)
    wrong = np.flatnonzero(~((deviations >= 0) & (deviations <= LARGEST)))
    if wrong.size:
        i = int(wrong[0])
        raise InvalidContent.of_field(
            field,
            f"expected standard errors of {component.code} from 0 to {LARGEST:g} {unit}, got "
            f"{deviations[i]:g} (at index {i})",
        )
    return frozen(deviations**2)


def _check_agreement(
    component: Component, field: str, variances: FloatArray, covariance: FloatArray
) -> None:
    from_errors, from_covariance = np.sqrt(variances), np.sqrt(variances_of(covariance))
    wrong = np.flatnonzero(
        np.abs(from_errors - from_covariance)
        > DISAGREEMENT * np.maximum(from_errors, from_covariance)
    )
    if wrong.size:
        i, unit = int(wrong[0]), component.unit.symbol
        raise InvalidContent.of_field(
            field,
            f"expected the standard errors' squares on its diagonal (or one of both), got "
            f"{from_errors[i]:g} {unit} there and {from_covariance[i]:g} {unit} here "
            f"(at index {i})",
        )


def _check_symmetric(field: str, what: str, covariance: FloatArray) -> None:
    asymmetry = np.abs(covariance - covariance.T)
    if asymmetry.max() > ASYMMETRY * variances_of(covariance).max():
        i, j = divmod(int(asymmetry.argmax()), len(covariance))
        raise InvalidContent.of_field(
            field,
            f"expected a symmetric {what}, got {covariance[i, j]:g} (at index {i}, {j}) and "
            f"{covariance[j, i]:g} (at index {j}, {i})",
        )


def _check_semidefinite(component: Component, field: str, covariance: FloatArray) -> None:
    """Refuse negative variances of any sum: by Cholesky, a tenth of the eigenvalues' time."""
    n, largest = len(covariance), float(np.abs(covariance).max())
    if largest == 0.0:
        return
    try:
        np.linalg.cholesky(covariance / largest + ROUNDING * n * np.eye(n))
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(covariance)[0])
        raise InvalidContent.of_field(
            field,
            f"expected a positive semidefinite covariance of {component.code} in "
            f"{_squared(component)}, in which no sum of errors has a negative variance, got one "
            f"with the eigenvalue {least:g}",
        ) from None


def _squared(component: Component) -> str:
    return f"({component.unit.symbol})²"

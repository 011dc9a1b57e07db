"""Tables of one component from several maps, brought to the same positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from app.arrays import FloatArray, IntArray, frozen
from app.errors import Conflict
from app.geometry.grid import place_in_cells
from app.thermal.error_map import ComponentTable
from app.thermal.machine import ROUNDING_MM
from app.thermal.uncertainty import variances_of


def common_positions(tables: Sequence[ComponentTable]) -> FloatArray:
    """Unite the positions of one component's tables inside the range that all of them cover.

    Parameters
    ----------
    tables
        One component's tables, at least one. A table with one position does not
        depend on position and limits nothing.

    Returns
    -------
    ndarray, shape (n,) [mm]
        Increasing; empty for a component that has no argument.

    Raises
    ------
    Conflict
        If tables that depend on position have no range in common. One shared point
        is none: the result would pass for a table that does not depend on position.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> exx = COMPONENTS["EXX"]
    >>> common_positions([
    ...     ComponentTable.make(exx, [0.0, 1.0, 2.0], [0.0, 100.0, 200.0]),
    ...     ComponentTable.make(exx, [0.0, 1.0], [50.0, 150.0]),
    ... ]).tolist()
    [50.0, 100.0, 150.0]
    """
    union = united_positions(tables)
    low, high = common_range(tables)
    return union[(union >= low) & (union <= high)]


def united_positions(tables: Sequence[ComponentTable]) -> FloatArray:
    """Unite all positions [mm] of one component's tables, at least one; shape (n,)."""
    return reduce(np.union1d, [table.positions_mm for table in tables])


def at_same_positions(tables: Sequence[ComponentTable]) -> Sequence[ComponentTable]:
    """Write positions of several tables as one where only their rounding sets them apart.

    A map in inches ends at 600.00007 mm where one in mm ends at 600 mm: neither ends earlier.
    Tables that are themselves so fine stay as they are.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> ends = (600.0, 23.62205 * 25.4)
    >>> tables = [ComponentTable.make(COMPONENTS["EXX"], [0.0, 1.0], [0.0, end]) for end in ends]
    >>> [table.positions_mm.tolist() for table in at_same_positions(tables)]
    [[0.0, 600.0], [0.0, 600.0]]
    """
    positions = united_positions(tables)
    if not _is_fine(positions) or any(_is_fine(table.positions_mm) for table in tables):
        return tables
    alike: list[list[float]] = []
    for position in positions.tolist():
        if alike and position - alike[-1][0] <= ROUNDING_MM:
            alike[-1].append(position)
        else:
            alike.append([position])
    firsts = np.array([several[0] for several in alike])
    # Of these the one that was written with the fewest digits.
    written = np.array([min(several, key=lambda mm: len(repr(mm))) for several in alike])
    return [
        replace(
            table,
            positions_mm=frozen(
                written[np.searchsorted(firsts, table.positions_mm, side="right") - 1]
            ),
        )
        for table in tables
    ]


def _is_fine(positions_mm: FloatArray) -> bool:
    return bool((np.diff(positions_mm) <= ROUNDING_MM).any())


def common_range(tables: Sequence[ComponentTable]) -> tuple[float, float]:
    """Find the range [mm] that all of one component's tables cover.

    Parameters
    ----------
    tables
        One component's tables. A table with one position limits nothing.

    Returns
    -------
    low, high : float [mm]
        −∞ and ∞ where none depends on position.
    """
    ranges = [table.positions_mm for table in tables if table.depends_on_position]
    low = max((float(positions[0]) for positions in ranges), default=-math.inf)
    high = min((float(positions[-1]) for positions in ranges), default=math.inf)
    if low >= high:
        raise Conflict(
            f"expected the maps' tables of {tables[0].component.code} to share a range of "
            f"positions, got a highest start of {low:g} mm and a lowest end of {high:g} mm"
        )
    return low, high


def sample_table(
    table: ComponentTable, positions_mm: FloatArray, *, backward: bool = False
) -> FloatArray:
    """Interpolate a table linearly to positions inside its range.

    Parameters
    ----------
    table
        The table; its own positions are reproduced exactly.
    positions_mm : ndarray, shape (n,) [mm]
        Where; not used for a component that has no argument.
    backward
        Whether the errors of the negative approach are meant. A table without
        them gives its only errors.

    Returns
    -------
    ndarray, shape (n,), or (1,) without argument [the component's unit]

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> table = ComponentTable.make(COMPONENTS["EXX"], [0.0, 4.0], [0.0, 100.0])
    >>> sample_table(table, np.array([25.0])).tolist()
    [1.0]
    """
    values = table.errors
    if backward and table.backward_errors is not None:
        values = table.backward_errors
    if not table.component.is_table:
        return values
    if not table.depends_on_position:
        return np.full(positions_mm.size, values[0])
    return np.interp(positions_mm, table.positions_mm, values)


def sample_variances(
    table: ComponentTable, positions_mm: FloatArray, *, backward: bool = False
) -> FloatArray | None:
    """Carry a table's uncertainty through its linear interpolation: the diagonal of A C Aᵀ.

    Returns
    -------
    ndarray, shape (n,), or (1,) without argument [the component's unit squared]
        None where the table's uncertainty is not known. Half way between two positions
        independent errors average out to half their variance, fully correlated ones
        keep it.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> at = [0.0, 100.0]
    >>> for covariance in ([4.0, 4.0], [[4.0, 4.0], [4.0, 4.0]]):
    ...     exx = ComponentTable.make(COMPONENTS["EXX"], [0, 0], at, covariance=covariance)
    ...     print(sample_variances(exx, np.array([0.0, 50.0])).tolist())
    [4.0, 2.0]
    [4.0, 4.0]
    """
    covariance = covariance_of(table, backward=backward)
    if covariance is None:
        return None
    variances = variances_of(covariance)
    if not table.component.is_table:
        return variances
    if not table.depends_on_position:
        return np.full(positions_mm.size, variances[0])
    left, right, share = hat_weights(table.positions_mm, positions_mm)
    sampled: FloatArray = (1 - share) ** 2 * variances[left] + share**2 * variances[right]
    if covariance.ndim == 2:
        sampled += 2 * share * (1 - share) * covariance[left, right]
    # A covariance that was rounded can leave less than nothing.
    return np.maximum(sampled, 0.0)


def covariance_of(table: ComponentTable, *, backward: bool = False) -> FloatArray | None:
    """Choose the covariance that belongs to the errors that `sample_table` samples.

    Returns
    -------
    ndarray, shape (k, k) or (k,) [the component's unit squared], or None
    """
    if backward and table.backward_errors is not None:
        return table.backward_covariance
    return table.covariance


def interpolation_matrix(table: ComponentTable, positions_mm: FloatArray) -> FloatArray:
    """Write `sample_table` as a matrix A on the table's errors.

    Parameters
    ----------
    positions_mm : ndarray, shape (n,) [mm]
        Where; outside the table its end values hold.

    Returns
    -------
    ndarray, shape (n, k)

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> exx = ComponentTable.make(COMPONENTS["EXX"], [0.0, 4.0], [0.0, 100.0])
    >>> interpolation_matrix(exx, np.array([25.0])).tolist()
    [[0.75, 0.25]]
    """
    if not table.depends_on_position:
        return np.ones((positions_mm.size, 1))
    left, right, share = hat_weights(table.positions_mm, positions_mm)
    matrix = np.zeros((positions_mm.size, table.positions_mm.size))
    rows = np.arange(positions_mm.size)
    matrix[rows, left] = 1 - share
    matrix[rows, right] = share
    return matrix


def hat_weights(
    nodes_mm: FloatArray, positions_mm: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Find the nodes beside positions, and the right one's share.

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        Increasing; with one or none there is nothing to interpolate.
    positions_mm : ndarray, shape (n,) [mm]
        Outside the nodes the end values hold.

    Returns
    -------
    left, right, share : ndarray, shape (n,)

    Examples
    --------
    >>> [a.tolist() for a in hat_weights(np.array([0.0, 100.0, 200.0]), np.array([150.0]))]
    [[1], [2], [0.5]]
    """
    if nodes_mm.size < 2:
        none = np.zeros(positions_mm.shape, dtype=np.intp)
        return none, none, np.zeros(positions_mm.shape)
    left, share = place_in_cells(nodes_mm, positions_mm)
    return left, left + 1, share

"""Residuals before and after the found effects: over all lengths, and by component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, rms
from app.identification.analysis.figures import ComponentFigures, Figures, Zero
from app.identification.residuals.residuals import Residuals, channel_unit
from app.search.figures import figure
from app.search.findings import Findings
from app.search.noise import replicate_scatter
from app.search.rows import Rows
from app.search.zeros import UnknownZero, unknown_zeros, without_zeros
from app.units import Unit

NO_REPEATS: Final = (
    "too few observations were repeated at one place within two minutes to measure what noise "
    "alone would leave"
)
"""Why there is no floor."""

SCATTER_OF_DIFFERENCE: Final = float(np.sqrt(2.0))
"""Of two observations, in standard deviations of one."""


def scatter_in_repeatabilities(zeros: Sequence[UnknownZero], count: int) -> FloatArray:
    """Say by how much noise alone scatters residuals that `without_zeros` gives.

    A difference from a first observation has the noise of both, √2; the first itself is 0 by
    definition. From the mean of m, √(1 − 1/m) is left.

    Parameters
    ----------
    count
        Number n of rows.

    Returns
    -------
    ndarray, shape (n,) [standard deviations of one observation]

    Examples
    --------
    >>> scatter_in_repeatabilities([UnknownZero(np.array([0, 1]), False)], 3).round(3).tolist()
    [0.707, 0.707, 1.0]
    """
    scatter = np.ones(count)
    for zero in zeros:
        if zero.is_first:
            scatter[zero.rows] = SCATTER_OF_DIFFERENCE
            scatter[zero.rows[0]] = 0.0
        else:
            scatter[zero.rows] = np.sqrt(1.0 - 1.0 / zero.rows.size)
    return scatter


def zero_of(zeros: Sequence[UnknownZero], chosen: BoolArray) -> Zero:
    """Say what figures of chosen rows are relative to; a mean that was taken off goes before.

    >>> zero_of([UnknownZero(np.array([0]), True)], np.array([False, True]))
    'absolute'
    """
    taken = [zero.is_first for zero in zeros if chosen[zero.rows].any()]
    if not taken:
        return "absolute"
    return "first" if all(taken) else "removed"


def lengths(residuals: Residuals) -> BoolArray:
    """Say which rows are in µm; all where none is, shape (n,)."""
    in_um = np.array([channel_unit(name) is Unit.UM for name in residuals.rows.channels])
    are_lengths: BoolArray = in_um[residuals.rows.channel]
    return are_lengths if are_lengths.any() else np.ones(len(are_lengths), dtype=np.bool_)


def figures_unit(residuals: Residuals) -> str:
    """Give the symbol of the unit of figures over all `lengths`: µm, or that of the angles."""
    units = {channel_unit(name) for name in residuals.rows.channels}
    if Unit.UM in units:
        return Unit.UM.symbol
    return (units.pop() if len(units) == 1 else Unit.URAD).symbol


def used_rows(findings: Findings, count: int) -> BoolArray:
    """Say which rows took part in the search."""
    use = np.ones(count, dtype=np.bool_)
    for group in findings.excluded:
        use[list(group.rows)] = False
    return use


def pooled_figures(
    rows: Rows,
    zeros: Sequence[UnknownZero],
    values: FloatArray,
    predicted: FloatArray,
    chosen: BoolArray,
    seed: int,
) -> Figures:
    """Sum residuals up over chosen rows.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals with the effects as all visits together say.
    predicted : ndarray, shape (n,)
        What a model that did not see a row's visit says of it; NaN: not held out.
    chosen : ndarray, shape (n,)
        Which rows count.
    """
    before = without_zeros(zeros, np.where(chosen, values, np.nan))[chosen]
    predicted_rows = chosen & np.isfinite(predicted)
    size, p95 = rms(before), float(np.quantile(np.abs(before), 0.95))
    if not predicted_rows.any():
        return Figures(size, p95, None, None, zero_of(zeros, chosen))
    residuals_after = without_zeros(
        zeros, np.where(predicted_rows, rows.values - predicted, np.nan)
    )[predicted_rows]
    holdout = figure(residuals_after, rows.visit[predicted_rows], seed)
    # One visit says nothing of how visits differ.
    ends = (holdout.low, holdout.high) if np.unique(rows.visit[predicted_rows]).size > 1 else None
    return Figures(size, p95, holdout.rms, ends, zero_of(zeros, chosen))


def component_figures(
    residuals: Residuals, rows: Rows, effects: FloatArray, findings: Findings, use: BoolArray
) -> list[ComponentFigures]:
    """Sum each channel up, the largest residuals first.

    Parameters
    ----------
    effects : ndarray, shape (n,)
        What the found effects explain.
    use : ndarray, shape (n,)
        Which rows took part.
    """
    zeros = unknown_zeros(rows)
    before, after, predicted_left = (
        without_zeros(zeros, np.where(use, rows.values - part, np.nan))
        for part in (np.zeros(len(use)), effects, findings.adopted)
    )
    figures = []
    for number, noise in findings.noise.items():
        of_channel = use & (rows.channel == number)
        held_out = findings.held_out.get(number)
        name = residuals.rows.channels[number]
        setup = None if held_out is None else held_out.floor.setups
        zero = zero_of(zeros, of_channel)
        shown = of_channel & ~np.isnan(predicted_left) if held_out else of_channel
        shown_after = predicted_left if held_out else after
        floor = _floor(replicate_scatter(rows, number, use), setup, zero)
        figures.append(
            ComponentFigures(
                component=name,
                unit=channel_unit(name).symbol,
                count=int(of_channel.sum()),
                before_rms=rms(before[of_channel]),
                after_rms=rms(after[of_channel]),
                before_p95=float(np.quantile(np.abs(before[of_channel]), 0.95)),
                after_p95=float(np.quantile(np.abs(after[of_channel]), 0.95)),
                holdout_before_rms=rms(before[shown]) if held_out else None,
                holdout_after_rms=rms(shown_after[shown]) if held_out else None,
                before_max=float(np.abs(before[shown]).max()),
                after_max=float(np.abs(shown_after[shown]).max()),
                noise=noise.fitted,
                noise_origin=noise.origin,
                floor=floor,
                floor_unknown=None if floor is not None else NO_REPEATS,
                setup_scatter=setup,
                zero=zero,
            )
        )
    return sorted(figures, key=lambda c: -c.before_rms / max(c.noise, 1e-12))


def _floor(repeats: float | None, setup: float | None, zero: Zero) -> float | None:
    """Say what repeats and set-ups would leave; None where nothing was repeated.

    From the first observation as zero, the noise of that one is in all the others, and what a
    set-up shifts is in none.
    """
    if repeats is None:
        return None
    if zero == "first":
        return SCATTER_OF_DIFFERENCE * repeats
    return float(np.hypot(repeats, setup or 0.0))


def pooled(values: Sequence[float], counts: Sequence[int]) -> float | None:
    """Pool root mean squares, each by its count; None of none.

    >>> pooled([3.0, 4.0], [1, 1])
    3.5355339059327378
    """
    total = sum(counts)
    if not total:
        return None
    return float(np.sqrt(np.dot(np.square(values), counts) / total))

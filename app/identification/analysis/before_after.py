"""Residuals before and after the found effects: over all lengths, and by component."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.identification.analysis.analysis import ComponentFigures, Figures
from app.identification.residuals.residuals import Residuals, channel_unit
from app.search.figures import figure, rms
from app.search.findings import Findings
from app.search.rows import Datum, Rows
from app.units import Unit


def unknown_zeros(residuals: Residuals, rows: Rows) -> list[IntArray]:
    """List the rows that share each unknown zero of an instrument.

    Parameters
    ----------
    residuals, rows
        The rows, with their datum.
    """
    own = [
        np.flatnonzero((rows.visit == visit) & (rows.channel == channel))
        for (visit, channel), datum in rows.datum.items()
        if datum is not Datum.ABSOLUTE
    ]
    return [*own, *residuals.rows.shared_zeros()]


def without_zeros(zeros: Sequence[IntArray], values: FloatArray) -> FloatArray:
    """Take the mean off what shares an instrument's unknown zero.

    Parameters
    ----------
    zeros
        Rows of each zero (`unknown_zeros`).
    values : ndarray, shape (n,)
        Residuals; NaN takes no part.

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> without_zeros([np.array([0, 1])], np.array([3.0, 5.0, 7.0])).tolist()
    [-1.0, 1.0, 7.0]
    """
    found = values.copy()
    for own in zeros:
        known = own[~np.isnan(values[own])]
        if known.size:
            found[known] -= values[known].mean()
    return found


def lengths(residuals: Residuals) -> BoolArray:
    """Say which rows are in µm; all where none is, shape (n,).

    Parameters
    ----------
    residuals
        The rows.
    """
    in_um = np.array([channel_unit(name) is Unit.UM for name in residuals.rows.channels])
    found: BoolArray = in_um[residuals.rows.channel]
    return found if found.any() else np.ones(len(found), dtype=np.bool_)


def figures_unit(residuals: Residuals) -> str:
    """Give the symbol of the unit of figures over all `lengths`: µm, or that of the angles.

    Parameters
    ----------
    residuals
        The rows.
    """
    units = {channel_unit(name) for name in residuals.rows.channels}
    if Unit.UM in units:
        return Unit.UM.symbol
    return (units.pop() if len(units) == 1 else Unit.URAD).symbol


def used_rows(findings: Findings, count: int) -> BoolArray:
    """Say which rows took part in the search.

    Parameters
    ----------
    findings
        What was found.
    count
        How many rows there are.
    """
    use = np.ones(count, dtype=np.bool_)
    for one in findings.excluded:
        use[list(one.rows)] = False
    return use


def pooled_figures(
    rows: Rows,
    zeros: Sequence[IntArray],
    values: FloatArray,
    predicted: FloatArray,
    chosen: BoolArray,
    seed: int,
) -> Figures:
    """Sum residuals up over chosen rows.

    Parameters
    ----------
    rows
        The rows.
    zeros
        Rows of each unknown zero.
    values : ndarray, shape (n,)
        Residuals with the effects as all visits together say.
    predicted : ndarray, shape (n,)
        What a model that did not see a row's visit says of it; NaN: not held out.
    chosen : ndarray, shape (n,)
        Which rows count.
    seed
        Of the interval.

    Returns
    -------
    Figures
    """
    own = without_zeros(zeros, np.where(chosen, values, np.nan))[chosen]
    held = chosen & np.isfinite(predicted)
    size, p95 = rms(own), float(np.quantile(np.abs(own), 0.95))
    if not held.any():
        return Figures(size, p95, None, None)
    left = without_zeros(zeros, np.where(held, rows.values - predicted, np.nan))[held]
    found = figure(left, rows.visit[held], seed)
    return Figures(size, p95, found.rms, (found.low, found.high))


def component_figures(
    residuals: Residuals, rows: Rows, effects: FloatArray, findings: Findings, use: BoolArray
) -> list[ComponentFigures]:
    """Sum each channel up, the largest residuals first.

    Parameters
    ----------
    residuals, rows
        The rows.
    effects : ndarray, shape (n,)
        What the found effects explain.
    findings
        What was found.
    use : ndarray, shape (n,)
        Which rows took part.

    Returns
    -------
    list of ComponentFigures
    """
    zeros = unknown_zeros(residuals, rows)
    before, after, foretold = (
        without_zeros(zeros, np.where(use, rows.values - part, np.nan))
        for part in (np.zeros(len(use)), effects, findings.adopted)
    )
    found = []
    for number, noise in findings.noise.items():
        own = use & (rows.channel == number)
        held = findings.held_out.get(number)
        name = residuals.rows.channels[number]
        found.append(
            ComponentFigures(
                component=name,
                unit=channel_unit(name).symbol,
                count=int(own.sum()),
                before_rms=rms(before[own]),
                after_rms=rms(after[own]),
                before_p95=float(np.quantile(np.abs(before[own]), 0.95)),
                after_p95=float(np.quantile(np.abs(after[own]), 0.95)),
                holdout_before_rms=rms(before[own & ~np.isnan(foretold)]) if held else None,
                holdout_after_rms=rms(foretold[own & ~np.isnan(foretold)]) if held else None,
                noise=noise.fitted,
                noise_origin=noise.origin,
                floor=held.floor if held else None,
            )
        )
    return sorted(found, key=lambda c: -c.before_rms / max(c.noise, 1e-12))


def pooled(values: Sequence[float], counts: Sequence[int]) -> float | None:
    """Pool root mean squares, each by its count; None of none.

    >>> pooled([3.0, 4.0], [1, 1])
    3.5355339059327378
    """
    total = sum(counts)
    if not total:
        return None
    return float(np.sqrt(np.dot(np.square(values), counts) / total))

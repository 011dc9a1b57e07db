"""Arrays for a page: residuals over what drives an effect, and over the visits."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import kind_of
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.plots import EffectCurve, Plots, VisitMeans
from app.identification.residuals.residuals import channel_unit
from app.search.zeros import without_zeros

MOST_DRAWN: Final = 400
"""Of one drawing."""

FINEST: Final = 64
"""Cells along each side of a drawing, where those of fewer are enough."""

DRAWN_DIGITS: Final = 5


def plots(finished: FinishedSearch, effects: Sequence[Effect]) -> Plots:
    """Gather all arrays that a page needs to show the answer without the data.

    Returns
    -------
    Plots
        For each effect residuals over its driver; for each channel the means of the residuals by
        visit, those of either direction apart where an effect reverses.
    """
    total = sum((finished.explained(e) for e in effects), np.zeros(len(finished.rows.values)))
    after = np.where(finished.use, finished.rows.values - total, np.nan)
    return Plots(
        effects=tuple(_over_driver(finished, effect, after) for effect in effects),
        visits=tuple(_over_visits(finished, after, _reversing(effects))),
    )


def _over_driver(finished: FinishedSearch, effect: Effect, after: FloatArray) -> EffectCurve:
    """Residuals without this effect and with it, over what drives it."""
    rows = _rows_of(finished, effect)
    contribution = np.where(finished.use, finished.explained(effect), np.nan)
    # What it explains counts from the same zero as the residuals beside which it is drawn.
    without, residuals_after, explained = (
        without_zeros(finished.zeros, values)
        for values in (after + contribution, after, contribution)
    )
    over, unit, driver = _driver_of(finished, effect, explained)
    rows = rows[np.isfinite(driver[rows])]
    sides = np.array(_directions(finished, effect, rows))
    rows = rows[seen_apart(MOST_DRAWN, driver[rows], without[rows], residuals_after[rows], sides)]
    names = np.array(finished.residuals.rows.channels)[finished.rows.channel[rows]]
    return EffectCurve(
        over=over,
        over_unit=unit,
        unit=channel_unit(str(names[0])).symbol if len(names) else "µm",
        components=tuple(names.tolist()),
        driver=_rounded(driver[rows]),
        before=_rounded(without[rows]),
        after=_rounded(residuals_after[rows]),
        explained=_rounded(explained[rows]),
        direction=_directions(finished, effect, rows),
    )


def _rows_of(finished: FinishedSearch, effect: Effect) -> IntArray:
    """The effect's own components, or points where they were not observed."""
    rows, moved = finished.residuals.rows, finished.explained(effect) != 0
    names = np.array(rows.channels)[rows.channel]
    of_effect = np.isin(names, effect.components)
    chosen = np.flatnonzero(finished.use & (of_effect if of_effect.any() else moved))
    return of_one_unit(finished, effect, chosen)


def seen_apart(most: int, *along: FloatArray) -> IntArray:
    """Choose points that stand for all others: those beside which the others are not seen.

    Every so many of them would be those of one direction only where a run goes there and back. So
    the drawing is parted into cells, as fine as leaves at most so many points, and one of each cell
    is chosen, and the ends of every quantity.

    Parameters
    ----------
    most
        Points that may be drawn.
    along : ndarray, shape (n,)
        What tells points apart: where they stand, their values, their direction.

    Returns
    -------
    ndarray
        Their indices, rising; all where they are not too many.

    Examples
    --------
    >>> there_and_back = np.tile([0.0, 6.0], 50)
    >>> there_and_back[seen_apart(6, np.arange(100.0), there_and_back)].tolist()
    [0.0, 6.0, 0.0, 6.0, 6.0]
    """
    count = len(along[0])
    if count <= most:
        return np.arange(count)
    ends = [index for values in along for index in (values.argmin(), values.argmax())]
    shares = np.column_stack(
        [(v - v.min()) / (np.ptp(v) if np.ptp(v) > 0.0 else 1.0) for v in along]
    )
    chosen = np.unique(ends)
    for fineness in range(1, FINEST + 1):
        cells = np.minimum((shares * fineness).astype(np.intp), fineness - 1)
        finer = np.union1d(ends, np.unique(cells, axis=0, return_index=True)[1])
        if len(finer) > most:
            break
        chosen = finer
    return chosen


def of_one_unit(finished: FinishedSearch, effect: Effect, chosen: IntArray) -> IntArray:
    """Keep the rows of that unit in which the effect explains most for the noise.

    µm, µrad and µm/m stand on no common axis.
    """
    rows = finished.residuals.rows
    channels = rows.channel[chosen]
    units = {n: channel_unit(rows.channels[n]) for n in np.unique(channels).tolist()}
    if len(set(units.values())) < 2:
        return chosen
    explained = finished.explained(effect)[chosen]
    weights = dict.fromkeys(units.values(), 0.0)
    for number, unit in units.items():
        in_noise = explained[channels == number] / finished.findings.noise[number].fitted
        weights[unit] += float(np.sum(in_noise**2))
    best = max(weights, key=weights.__getitem__)
    channels_of_unit = [number for number, unit in units.items() if unit is best]
    return chosen[np.isin(channels, channels_of_unit)]


def _driver_of(
    finished: FinishedSearch, effect: Effect, explained: FloatArray
) -> tuple[str, str, FloatArray]:
    conditions, rows = finished.residuals.projection.conditions, finished.residuals.rows
    over = kind_of(effect.kind).drawn_over
    if over == "time":
        return "time", "s", conditions.times_s
    axis = COMPONENTS[effect.components[0]].axis
    if over == "position" and axis is not None:
        return f"position of {axis.upper()}", "mm", rows.points_mm[:, LINEAR_LETTERS.index(axis)]
    driver = effect.terms[0].driver if effect.terms else Always()
    if (quantity := driver.quantity) is not None:
        return quantity.name, quantity.unit, quantity.zero + driver.at(conditions)
    return "what the effect explains", channel_unit(effect.components[0]).symbol, explained


def _directions(finished: FinishedSearch, effect: Effect, rows: IntArray) -> tuple[float, ...]:
    code = effect.components[0]
    axis = None if code in POINT_CHANNELS else COMPONENTS[code].axis
    if axis is None:
        return (0.0,) * len(rows)
    signs = finished.residuals.rows.directions[rows, LINEAR_LETTERS.index(axis)]
    return tuple(np.sign(signs).astype(float).tolist())


def _reversing(effects: Sequence[Effect]) -> set[str]:
    """List the components whose error reverses with the direction: it cancels in a mean."""
    reversing_effects = (e for e in effects if any(term.is_reversing for term in e.terms))
    return {code for effect in reversing_effects for code in effect.components}


def _over_visits(
    finished: FinishedSearch, after: FloatArray, reversing: Collection[str]
) -> list[VisitMeans]:
    """Means by visit of every channel; of very many visits some."""
    rows = finished.residuals.rows
    # Means of what has a zero that nobody knows keep it; from a first observation they are shown.
    first = [zero for zero in finished.zeros if zero.is_first]
    before, after = (
        without_zeros(first, values)
        for values in (np.where(finished.use, finished.rows.values, np.nan), after)
    )
    zero_row = np.full(len(rows), -1)
    for zero in first:
        used = zero.rows[finished.use[zero.rows]]
        zero_row[used] = used[:1]
    curves = []
    for number, channel in enumerate(rows.channels):
        of_channel = finished.use & (rows.channel == number)
        if not of_channel.any():
            continue
        sides = np.zeros(len(rows))
        if channel in reversing:
            axis = LINEAR_LETTERS.index(str(COMPONENTS[channel].axis))
            sides = np.sign(rows.directions[:, axis])
        keys = np.column_stack([rows.visit, sides])[of_channel]
        together, which = np.unique(keys, axis=0, return_inverse=True)
        which = which.ravel()
        counts = np.bincount(which)
        means = [
            np.bincount(which, weights=values[of_channel]) / counts
            for values in (rows.times_s, before, after)
        ]
        thinned = seen_apart(MOST_DRAWN, *means, together[:, 1])
        curves.append(
            VisitMeans(
                component=channel,
                unit=channel_unit(channel).symbol,
                at_points=channel in POINT_CHANNELS,
                time_s=tuple(np.round(means[0][thinned]).tolist()),
                direction=tuple(together[thinned, 1].tolist()),
                count=tuple(counts[thinned].tolist()),
                before=_rounded(means[1][thinned]),
                after=_rounded(means[2][thinned]),
                expected=_rounded(
                    np.sqrt(
                        mean_variances(
                            finished, number, np.flatnonzero(of_channel), which, zero_row
                        )
                    )[thinned]
                ),
            )
        )
    return curves


def mean_variances(
    finished: FinishedSearch, channel: int, rows: IntArray, which: IntArray, zero_row: IntArray
) -> FloatArray:
    """Give the variance of each mean: repeatability, set-up scatter, and the maps' uncertainty.

    Parameters
    ----------
    rows, which : ndarray, shape (m,)
        The channel's rows, and the mean in which each counts.
    zero_row : ndarray, shape (n,)
        The row from which each counts, -1 where its zero is the model's. Its noise is in the
        mean, the set-up's shift is not, and of the maps what they say of the difference.

    Returns
    -------
    ndarray, shape (k,) [the channel's unit, squared]
    """
    noise, held_out = finished.findings.noise[channel], finished.findings.held_out.get(channel)
    setup = 0.0 if held_out is None else held_out.floor.setups
    counts = np.bincount(which)
    zeroed = np.bincount(which, weights=zero_row[rows] >= 0) / counts
    variances = noise.fitted**2 * (1.0 / counts + zeroed) + setup**2 * (1.0 - zeroed)
    for entries in finished.of_maps:
        if entries.channel != channel:
            continue
        entering = entries.at(rows) - entries.at(zero_row[rows])
        sums = np.zeros((len(counts), entering.shape[1]))
        np.add.at(sums, which, entering)
        variances = variances + np.sum((sums / counts[:, None]) ** 2, axis=1)
    return np.asarray(variances)


def _rounded(values: FloatArray) -> tuple[float, ...]:
    """Round to what a drawing shows: five significant digits of the largest."""
    largest = float(np.max(np.abs(values), initial=0.0))
    digits = DRAWN_DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0 else 0
    return tuple(np.round(values, digits).tolist())

"""Residuals summed up along everything that they may depend on: arrays for a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer
from app.arrays import BoolArray, FloatArray, rms
from app.identification.residuals.residuals import Residuals, channel_unit
from app.units import Unit

BINS: Final = 10
FEWEST_VALUES: Final = 6
"""Of fewer values nothing is shown over a quantity."""

DIRECTIONS: Final = {1.0: "+", 0.0: "not stated", -1.0: "−"}


@dataclass(frozen=True, slots=True)
class Bin(Answer, published_as="BinAnswer"):
    """Residuals that have something in common."""

    label: Annotated[str, Field(examples=["24.1 to 25.3"])]
    """What they have in common"""

    low: float | None
    """Its lower end; null for a name [mm; °C, s …]"""

    high: float | None
    """Its upper end; null for a name [mm; °C, s …]"""

    count: int
    """How many values"""

    mean: Annotated[float, Field(description=f"Mean {IN_ITS_UNIT}")]
    rms: Annotated[float, Field(description=f"Root mean square {IN_ITS_UNIT}")]
    p95: Annotated[float, Field(description=f"95th percentile of the size {IN_ITS_UNIT}")]
    share_above_repeatability: float | None
    """Share that exceeds the repeatability in size, and that of a zero that was measured too; noise
    alone: 0.32"""

    @property
    def middle(self) -> float | None:
        """The middle of its range; None for a name."""
        return None if self.low is None or self.high is None else (self.low + self.high) / 2.0


@dataclass(frozen=True, slots=True)
class Summary(Answer, published_as="SummaryAnswer"):
    """Residuals along one quantity."""

    over: Annotated[str, Field(examples=["temperature z-column [°C]"])]
    """Component, position, time, temperature, rate, state or direction"""

    bins: tuple[Bin, ...]
    """In the order of the quantity"""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Residuals over one quantity, with what was summed up: the quantity at each, and each."""

    summary: Summary
    at: FloatArray
    values: FloatArray


def summarise(
    residuals: Residuals, values: FloatArray, scatter_um: FloatArray | None
) -> list[Summary]:
    """Sum residuals up by component, and those in µm by place, time, temperature and state.

    Parameters
    ----------
    values : ndarray, shape (n,) [the channels' units]
    scatter_um : ndarray, shape (n,)
        Standard deviation of each by repeatability alone [µm], where that is known.

    Returns
    -------
    list of Summary
        Quantities that do not vary are left out.
    """
    rows = residuals.rows
    names = np.array(rows.channels)[rows.channel]
    in_um = [channel_unit(name) is Unit.UM for name in rows.channels]
    components = tuple(
        _bin(name, None, None, values, scatter_um if um else None, names == name)
        for name, um in zip(rows.channels, in_um, strict=True)
        if (names == name).any()
    )
    summaries = [Summary("component", components)]
    lengths = np.array(in_um)[rows.channel]
    curves = curves_along(residuals, values, lengths, scatter_um)
    return [summary for summary in (*summaries, *(c.summary for c in curves)) if summary.bins]


def curves_along(
    residuals: Residuals,
    values: FloatArray,
    chosen: BoolArray,
    scatter: FloatArray | None,
    fewest: int = 1,
) -> list[Curve]:
    """Sum some residuals up by place, time, temperature, state and direction.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The residuals of all rows, those that are chosen in one unit.
    chosen : ndarray, shape (n,)
    scatter : ndarray, shape (n,)
        Standard deviation of each by repeatability alone, in its unit, where that is known.
    fewest
        Values that a range should hold: of few there are fewer ranges.

    Returns
    -------
    list of Curve
        Quantities that do not vary are left out.
    """
    rows, conditions = residuals.rows, residuals.projection.conditions
    along: dict[str, FloatArray] = {
        f"position {axis} [mm]": rows.points_mm[:, i] for i, axis in enumerate("xyz")
    }
    along["time [s]"] = rows.times_s
    along |= {f"temperature {s} [°C]": t for s, t in conditions.temperatures_c.items()}
    along |= {f"rate {s} [°C/h]": t for s, t in conditions.rates_c_per_h.items()}
    along |= {f"state {name}": x for name, x in conditions.states.items()}
    curves = []
    for over, quantity in along.items():
        present = chosen & ~np.isnan(quantity)
        if present.sum() >= FEWEST_VALUES and np.ptp(quantity[present]) > 0:
            chosen_scatter = None if scatter is None else scatter[present]
            summary = by_range(over, values[present], quantity[present], chosen_scatter, fewest)
            curves.append(Curve(summary, quantity[present], values[present]))
    for i, axis in enumerate("xyz"):
        moved = chosen & ~np.isnan(rows.points_mm[:, i])
        signs = rows.directions[moved, i]
        chosen_scatter = None if scatter is None else scatter[moved]
        summary = _by_direction(axis, values[moved], signs, chosen_scatter)
        if summary.bins:
            curves.append(Curve(summary, signs, values[moved]))
    return curves


def by_range(
    over: str,
    values: FloatArray,
    quantity: FloatArray,
    scatter: FloatArray | None = None,
    fewest: int = 1,
) -> Summary:
    """Sum values up in ranges of a quantity that hold about equally many of them.

    Parameters
    ----------
    values, quantity, scatter : ndarray, shape (n,)
        The residuals, the quantity, and each residual's standard deviation by repeatability alone.
    fewest
        Values that a range should hold: of few there are fewer ranges.

    Examples
    --------
    >>> cold_and_warm = np.array([20.0, 20.0, 30.0, 30.0])
    >>> by_range("T", np.array([1.0, -1.0, 2.0, 2.0]), cold_and_warm).bins[1].rms
    2.0
    """
    few = np.unique(quantity)
    most = max(min(BINS, quantity.size // fewest), 1)
    edges = np.unique(np.quantile(quantity, np.linspace(0.0, 1.0, most + 1)))
    if few.size <= most:
        # Values that stand apart, as a spindle's speeds do, are bins of their own.
        edges = np.concatenate([few[:1], (few[1:] + few[:-1]) / 2.0, few[-1:]])
    which = np.clip(np.searchsorted(edges, quantity, side="right") - 1, 0, edges.size - 2)
    bins = []
    for i in np.unique(which):
        here = quantity[which == i]
        low, high = float(here.min()), float(here.max())
        label = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        bins.append(_bin(label, low, high, values, scatter, which == i))
    return Summary(over, tuple(bins))


def _by_direction(
    axis: str,
    values: FloatArray,
    directions: FloatArray,
    scatter: FloatArray | None,
) -> Summary:
    bins = [
        _bin(label, None, None, values, scatter, directions == sign)
        for sign, label in DIRECTIONS.items()
        if (directions == sign).any()
    ]
    return Summary(f"direction {axis}", tuple(bins) if len(bins) > 1 else ())


def _bin(
    label: str,
    low: float | None,
    high: float | None,
    values: FloatArray,
    scatter: FloatArray | None,
    inside: BoolArray,
) -> Bin:
    values_inside = values[inside]
    return Bin(
        label=label,
        low=low,
        high=high,
        count=int(values_inside.size),
        mean=float(values_inside.mean()),
        rms=rms(values_inside),
        p95=float(np.quantile(np.abs(values_inside), 0.95)),
        share_above_repeatability=None
        if scatter is None
        else share_above(values_inside, scatter[inside]),
    )


def share_above(values: FloatArray, scatter: FloatArray) -> float | None:
    """Give the share of residuals beyond one standard deviation of noise alone.

    Parameters
    ----------
    values, scatter : ndarray, shape (n,)
        Residuals, and the standard deviation of each by repeatability alone: 0 where it is zero
        by definition, which takes no part.

    Returns
    -------
    float or None
        None where none of them scatters.

    Examples
    --------
    >>> share_above(np.array([0.0, 1.2, -1.6]), np.array([0.0, 1.4, 1.4]))
    0.5
    """
    moving = scatter > 0.0
    return float(np.mean(np.abs(values[moving]) > scatter[moving])) if moving.any() else None

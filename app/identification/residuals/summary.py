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
FEWEST: Final = 6
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
    """Share that exceeds the repeatability in size"""

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
    residuals: Residuals, values: FloatArray | None = None, repeatability_um: float | None = None
) -> list[Summary]:
    """Sum residuals up by component, and those in µm by place, time, temperature and state.

    Parameters
    ----------
    values : ndarray, shape (n,) [the channels' units]
        Other residuals of the same rows: after effects, for example.
    repeatability_um
        Standard deviation of one observation [µm].

    Returns
    -------
    list of Summary
        Quantities that do not vary are left out.
    """
    rows = residuals.rows
    own = residuals.values if values is None else values
    names = np.array(rows.channels)[rows.channel]
    in_um = [channel_unit(name) is Unit.UM for name in rows.channels]
    components = tuple(
        _bin(name, None, None, own[names == name], repeatability_um if um else None)
        for name, um in zip(rows.channels, in_um, strict=True)
        if (names == name).any()
    )
    found = [Summary("component", components)]
    lengths = np.array(in_um)[rows.channel]
    curves = curves_along(residuals, own, lengths, repeatability_um)
    return [summary for summary in (*found, *(c.summary for c in curves)) if summary.bins]


def curves_along(
    residuals: Residuals,
    values: FloatArray,
    chosen: BoolArray,
    repeatability: float | None,
    fewest: int = 1,
) -> list[Curve]:
    """Sum some residuals up by place, time, temperature, state and direction.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The residuals of all rows, those that are chosen in one unit.
    chosen : ndarray, shape (n,)
        Which rows.
    repeatability
        Standard deviation of one observation, in their unit.
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
    found = []
    for over, quantity in along.items():
        known = chosen & ~np.isnan(quantity)
        if known.sum() >= FEWEST and np.ptp(quantity[known]) > 0:
            summary = by_range(over, values[known], quantity[known], repeatability, fewest)
            found.append(Curve(summary, quantity[known], values[known]))
    for i, axis in enumerate("xyz"):
        moved = chosen & ~np.isnan(rows.points_mm[:, i])
        signs = rows.directions[moved, i]
        summary = _by_direction(axis, values[moved], signs, repeatability)
        if summary.bins:
            found.append(Curve(summary, signs, values[moved]))
    return found


def by_range(
    over: str,
    values: FloatArray,
    quantity: FloatArray,
    repeatability: float | None = None,
    fewest: int = 1,
) -> Summary:
    """Sum values up in ranges of a quantity that hold about equally many of them.

    Parameters
    ----------
    values, quantity : ndarray, shape (n,)
        The residuals and the quantity.
    repeatability
        Standard deviation of one observation, in the values' unit.
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
        bins.append(_bin(label, low, high, values[which == i], repeatability))
    return Summary(over, tuple(bins))


def _by_direction(
    axis: str,
    values: FloatArray,
    directions: FloatArray,
    repeatability: float | None,
) -> Summary:
    bins = [
        _bin(label, None, None, values[directions == sign], repeatability)
        for sign, label in DIRECTIONS.items()
        if (directions == sign).any()
    ]
    return Summary(f"direction {axis}", tuple(bins) if len(bins) > 1 else ())


def _bin(
    label: str, low: float | None, high: float | None, values: FloatArray, limit: float | None
) -> Bin:
    size = np.abs(values)
    return Bin(
        label=label,
        low=low,
        high=high,
        count=int(values.size),
        mean=float(values.mean()),
        rms=rms(values),
        p95=float(np.quantile(size, 0.95)),
        share_above_repeatability=None if limit is None else float(np.mean(size > limit)),
    )

"""A response as a driver: many sensors and states with lags, known only in sum.

Its columns (`app.effects.response_columns`) are collinear, so that their coefficients are not known
one by one. The driver keeps the mean of all of them and a root of the covariance with which another
set-up has them, and corrects what loses least (`app.search.response.least_harm`).
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.driver import Driver
from app.effects.response_columns import (
    MAPS,
    Column,
    Columns,
    Zero,
    columns_at,
    needed_signals,
)
from app.effects.valid import Range
from app.search.response import Predicted, least_harm
from app.search.wander import Wander
from app.units import SECONDS_PER_MIN

BEYOND: Final = 0.5
"""A column is followed beyond its learnt range by this share of that range, and held from there
on."""

LONGER: Final = 2.0
"""A response that was learnt from the start of records says nothing of records this much longer."""

ROUNDING: Final = 1e-9
"""Share of each variance that is added to it before the root of a covariance is taken."""

FORMER: Final = (
    "it was learnt by an earlier version of thermap, in a form that is no longer evaluated: "
    "analyse again and adopt the response anew"
)


class Outside(NamedTuple):
    """A column that lies outside where it was learnt at some of n moments."""

    column: Column
    learnt: Range
    values: FloatArray
    is_beyond: BoolArray


class Expected(NamedTuple):
    """What a response says at n moments, shape (n,) each.

    `mean` is what was learnt, `learnt` and `wander` the standard deviations of that and of what
    no driver explains, `corrected` what is corrected of it.
    """

    mean: FloatArray
    learnt: FloatArray
    wander: FloatArray
    corrected: FloatArray


@dataclass(frozen=True, eq=False)
class Reach:
    """Where a response was learnt.

    Parameters
    ----------
    ranges
        Each column's smallest and largest value.
    longest_min
        The longest record that it was learnt in [min]; infinite where records are not counted
        from their start.
    """

    columns: Sequence[Column]
    ranges: Sequence[Range]
    longest_min: float = np.inf

    @classmethod
    def of(
        cls, columns: Sequence[Column], seen: Sequence[Columns], *, is_from_start: bool
    ) -> Reach:
        """Take all that was seen."""
        values = np.concatenate([seen_columns.values for seen_columns in seen])
        longest_s = max(float(seen_columns.age_s.max()) for seen_columns in seen)
        ranges = list(zip(values.min(axis=0).tolist(), values.max(axis=0).tolist(), strict=True))
        return cls(columns, ranges, longest_s / SECONDS_PER_MIN if is_from_start else np.inf)

    def held(self, columns: Columns) -> FloatArray:
        """Hold columns where they were learnt, shape (n, p); NaN where the record is too long."""
        values = np.clip(columns.values, *self.edges)
        values[columns.age_s > LONGER * SECONDS_PER_MIN * self.longest_min] = np.nan
        return values

    def expected(
        self, columns: Columns, values: FloatArray, learnt: Predicted, noise: Wander
    ) -> Expected:
        """Decide what to correct of what was learnt.

        The error that counts is what another set-up will have: its own response and its wander.
        Where set-ups count from their start, harm is counted beside no correction and beside the
        maps; where they do not, a zero is somebody's choice, and harm is counted beside the maps.

        Parameters
        ----------
        columns, values
            The columns at n moments, and as they are held.
        noise
            What no driver explains.
        """
        is_from_start = bool(np.isfinite(self.longest_min))
        age_min = columns.age_s / SECONDS_PER_MIN
        wander = np.sqrt(np.maximum(noise.variance(age_min, is_zeroed=is_from_start), 0.0))
        by_maps = [values[:, i] for i, c in enumerate(self.columns) if c.form == MAPS]
        maps = by_maps[0] if by_maps and is_from_start else np.zeros(len(values))
        instead = (np.zeros_like(maps), maps) if by_maps and is_from_start else (maps,)
        sd = np.sqrt(learnt.learnt**2 + wander**2)
        corrected = least_harm(maps + learnt.mean, sd, *instead) - maps
        corrected[np.isnan(learnt.mean)] = np.nan
        return Expected(learnt.mean, learnt.learnt, wander, corrected)

    @cached_property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Give the lowest and the highest value to which each column is followed."""
        low, high = np.array(self.ranges).T
        by = BEYOND * (high - low)
        return low - by, high + by


@dataclass(frozen=True)
class Responding(Driver):
    """The corrected part of a response [the component's unit].

    Parameters
    ----------
    columns
        What drives it: form, name and time constant [min] of each.
    references_c, level_c, maps
        As in `Zero`.
    ranges
        Each column's smallest and largest value where it was learnt.
    days_s
        When the set-ups began that it was learnt from [s], rising.
    drift_span_s
        Time in which what set-ups have in common beside the rest falls to 1/e [s].
    coefficients
        Mean coefficients of a set-up far from all of these, then of one on each of their days
        (`written`). Between days they follow the bridge of a first-order Markov process, which is
        what the covariance exp(−|t|/span) makes of it.
    spread
        A square root of the covariance with which the next set-up has them (`written_root`), its
        own part included: collinear columns are known in sum and not apart, so that nothing of it
        can be left out.
    noise
        White noise and wander (`Wander`).
    longest_min
        The longest record that it was learnt in [min].
    """

    name: ClassVar[str] = "set-up-response"
    columns: tuple[Column, ...]
    references_c: tuple[float, ...]
    level_c: float
    ranges: tuple[Range, ...]
    days_s: tuple[float, ...]
    drift_span_s: float
    coefficients: str
    spread: str
    noise: tuple[float, ...]
    longest_min: float
    maps: tuple[Range, ...] = ()

    def __post_init__(self) -> None:
        """Read columns as they are stored."""
        object.__setattr__(self, "columns", tuple(Column(*column) for column in self.columns))

    def __hash__(self) -> int:
        """Tell responses apart by their coefficients."""
        return hash((self.columns, self.coefficients))

    def at(self, conditions: Conditions) -> FloatArray:
        """Give what is corrected, shape (n,)."""
        return self.expected(conditions).corrected

    def expected(self, conditions: Conditions) -> Expected:
        """Say what was learnt, how sure it is, and what of it is corrected."""
        at_rows = columns_at(self.columns, self.zero, conditions)
        began_s = conditions.times_s - (0.0 if self.references_c else at_rows.age_s)
        return self.expected_of(at_rows, began_s)

    def expected_of(self, columns: Columns, began_s: FloatArray) -> Expected:
        """Say the same of columns at n moments, in set-ups that began at times, shape (n,) [s]."""
        values = self._reach.held(columns)
        mean = np.einsum("ij,ij->i", values, self._coefficients_at(began_s))
        # x C xᵀ = |x L|² with C = L Lᵀ, and never below 0, however collinear columns round.
        learnt = np.sqrt(((values @ self._root) ** 2).sum(axis=1))
        return self._reach.expected(columns, values, Predicted(mean, learnt), Wander(*self.noise))

    def farthest(self, conditions: Conditions) -> Outside | None:
        """Find the column that lies farthest beyond where it is held; None where none does."""
        at_rows = columns_at(self.columns, self.zero, conditions)
        low, high = self._reach.edges
        beyond = np.maximum(low - at_rows.values, at_rows.values - high)
        # Of a component that is not asked for there are no moments, and none of them lies outside.
        largest = np.max(np.nan_to_num(beyond, nan=0.0), axis=0, initial=0.0)
        share = largest / np.maximum(high - low, 1e-12)
        at = int(np.argmax(share))
        if share[at] <= 0.0:
            return None
        values = at_rows.values[:, at]
        return Outside(self.columns[at], self.ranges[at], values, beyond[:, at] > 0.0)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """Every signal with every time constant of its filters."""
        taus = needed_signals(self.columns)
        return tuple(dict.fromkeys((column.signal, tau_s) for column, tau_s in taus.items()))

    @property
    def zero(self) -> Zero:
        """What columns are counted from."""
        return Zero(self.references_c, self.level_c, self.maps)

    @property
    def is_held_by_signal(self) -> bool:
        """Its columns have ranges of their own."""
        return False

    @property
    def holds_itself(self) -> bool:
        """Its columns have ranges of their own."""
        return True

    def why_missing(self, conditions: Conditions) -> str:
        """Say which condition is missing where it is NaN."""
        if np.isfinite(self.at(conditions)).all():
            return ""
        gaps = (conditions.why_unread(signal, tau_s or 0.0) for signal, tau_s in self.signals)
        if unread := next(filter(None, gaps), ""):
            return unread
        for signal, tau_s in self.signals:
            here = conditions.from_start(signal, tau_s or 0.0)
            if np.isnan(here.outputs).any():
                return f"no record of {signal.name} up to that time"
            if signal.kind == "temperature" and np.isnan(conditions.temperature(signal.name)).any():
                return conditions.why_missing(signal)
        age_min = columns_at(self.columns, self.zero, conditions).age_s / SECONDS_PER_MIN
        if (age_min > LONGER * self._reach.longest_min).any():
            return (
                f"it was learnt within the first {self.longest_min:.0f} min of a record, and this "
                f"record began {np.nanmax(age_min):.0f} min ago"
            )
        return "the records of its sensors did not start together"

    def _coefficients_at(self, began_s: FloatArray) -> FloatArray:
        """Give the mean coefficients of set-ups that began at times, shape (n, p)."""
        common, *each = self._means
        days, off = np.array(self.days_s), np.array(each) - common
        right = np.searchsorted(days, began_s)
        left = right - 1
        before, after = left >= 0, right < len(days)
        left, right = np.maximum(left, 0), np.minimum(right, len(days) - 1)
        # Best guess from both neighbours, whose covariance with each other is w = exp(−|t|/span)
        # and with the day wanted l and r: the weights a, b solve a + w b = l, w a + b = r. Days
        # further off say nothing more: a Markov process has forgotten all but its neighbours.
        # Before the first and after the last day one neighbour alone counts, by l or r.
        from_left, from_right, whole = (
            np.exp(-np.abs(apart) / self.drift_span_s)
            for apart in (began_s - days[left], days[right] - began_s, days[right] - days[left])
        )
        within = np.maximum(1.0 - whole**2, 1e-300)
        both = before & after
        by_left = np.where(both, (from_left - from_right * whole) / within, from_left * before)
        by_right = np.where(both, (from_right - from_left * whole) / within, from_right * after)
        result: FloatArray = common + by_left[:, None] * off[left] + by_right[:, None] * off[right]
        return result

    @cached_property
    def _reach(self) -> Reach:
        return Reach(self.columns, self.ranges, np.inf if self.references_c else self.longest_min)

    @cached_property
    def _means(self) -> FloatArray:
        shape = (len(self.days_s) + 1, len(self.columns))
        means: FloatArray = read(self.coefficients).reshape(shape)
        return means

    @cached_property
    def _root(self) -> FloatArray:
        return read_root(self.spread, len(self.columns))


@dataclass(frozen=True)
class FormerResponse(Driver):
    """A response as earlier versions stored it: kept as it is, and not evaluated."""

    name: ClassVar[str] = "response"
    columns: Any
    references_c: Any
    level_sensor: Any
    level_c: Any
    ranges: Any
    until_s: Any
    coefficients: Any
    spread: Any
    noise: Any
    is_zeroed: Any
    longest_min: Any
    maps_sensor: Any = ""
    maps: Any = ()
    counted: Any = 1.0
    in_maps: Any = None

    def at(self, conditions: Conditions) -> FloatArray:
        """Give nothing, shape (n,)."""
        return np.full(len(conditions), np.nan)

    def why_missing(self, conditions: Conditions) -> str:
        """Say what to do."""
        return FORMER


def written(values: FloatArray) -> str:
    """Write numbers down: 32 bit in base 64."""
    return base64.b64encode(np.asarray(values).astype("<f4").tobytes()).decode("ascii")


def read(text: str) -> FloatArray:
    """Read what `written` wrote, shape (n,)."""
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(float)


def written_root(covariance: FloatArray) -> str:
    """Write the lower triangle of a covariance's Cholesky root.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Positive definite but for rounding.
    """
    # Coefficients have units of their own, from a micrometre to one per 1/min.
    size = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    slack = ROUNDING * np.eye(len(covariance))
    root = size[:, None] * np.linalg.cholesky(covariance / np.outer(size, size) + slack)
    return written(root[np.tril_indices(len(root))])


def read_root(text: str, p: int) -> FloatArray:
    """Read what `written_root` wrote of p coefficients, shape (p, p).

    Examples
    --------
    >>> read_root(written_root(np.diag([4.0, 9.0])), 2).round(3).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    root = np.zeros((p, p))
    root[np.tril_indices(p)] = read(text)
    return root

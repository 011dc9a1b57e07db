"""A response as a driver: many sensors and states with lags, known only in sum.

Its columns (`app.effects.response_columns`) are collinear, so that their coefficients are not known
one by one. The driver keeps all of them with a root of their covariance, and corrects no more of
the response than is sure.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.driver import Driver
from app.effects.response_columns import (
    LATE,
    Column,
    Columns,
    InMaps,
    Zero,
    columns_at,
    needed_signals,
)
from app.effects.valid import Range
from app.search.response_average import cautious
from app.search.wander import Wander
from app.units import SECONDS_PER_MIN

BEYOND: Final = 0.5
"""A column is followed beyond its learnt range by this share of that range, and held from there on:
what is not known there shows in the standard deviation, and is corrected less."""

LONGER: Final = 2.0
"""A response that was learnt from the start of records says nothing of records this much longer."""

ROUNDING: Final = 1e-9
"""Share of its mean variance that is added to a covariance before its root is taken."""


class Outside(NamedTuple):
    """A column that lies outside where it was learnt at some of n moments."""

    column: Column
    learnt: Range
    values: FloatArray
    is_beyond: BoolArray


class Expected(NamedTuple):
    """What a response says at n moments, shape (n,) each.

    `mean` is what was learnt, `learnt` and `wander` the standard deviations of that and of what
    no driver explains, the jump as a set-up begins included, `corrected` what is corrected of it,
    `is_held` says where a column lies at the edge of where it was learnt.
    """

    mean: FloatArray
    learnt: FloatArray
    wander: FloatArray
    corrected: FloatArray
    is_held: BoolArray


@dataclass(frozen=True)
class Responding(Driver):
    """The corrected part of a response [the component's unit].

    Parameters
    ----------
    columns
        What drives it: form, name and time constant [min] of each.
    references_c, level_sensor, level_c
        As in `Zero`.
    ranges
        Each column's smallest and largest value where it was learnt.
    until_s
        When each stretch of the response ends [s]; the last one goes on.
    coefficients
        Of each stretch, one for each column.
    spread
        A square root of the coefficients' covariance in the last stretch, which serves for all
        (`written_root`): collinear columns are known in sum and not apart, so that nothing of it
        can be left out.
    noise
        White noise, wander, and jump (`Wander`); without the last where an older version stored it.
    is_zeroed
        Whether it was learnt from set-ups that were zeroed at their first observation.
    longest_min
        The longest record that it was learnt in [min].
    maps_sensor, maps
        The sensor that the component's maps follow, and what they say where it was learnt:
        temperatures [°C], rising, and errors. What is not sure then goes half back to these
        maps, half to what held when the record began (`cautious`). None: back to the maps.
    counted
        How often caution counts the variances. These are of all set-ups, odd
        ones among them, and what to correct is decided for the usual one.
    in_maps
        Of columns that are counted from what they were in the maps (`InMaps`); None of others.
        Such a response is a straight line through 0 where the maps are right, and what wanders
        beside it does so with a correction as without it: caution counts what was learnt alone.
    """

    name: ClassVar[str] = "response"
    columns: tuple[Column, ...]
    references_c: tuple[float, ...]
    level_sensor: str
    level_c: float
    ranges: tuple[Range, ...]
    until_s: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]
    spread: str
    noise: tuple[float, ...]
    is_zeroed: bool
    longest_min: float
    maps_sensor: str = ""
    maps: tuple[Range, ...] = ()
    counted: float = 1.0
    in_maps: InMaps | None = None

    def __post_init__(self) -> None:
        """Read columns as they are stored."""
        object.__setattr__(self, "columns", tuple(Column(*column) for column in self.columns))
        if self.in_maps is not None:
            object.__setattr__(self, "in_maps", InMaps(*self.in_maps))

    def __hash__(self) -> int:
        """Tell responses apart by their latest coefficients: there are thousands of numbers."""
        return hash((self.columns, self.coefficients[-1]))

    def at(self, conditions: Conditions) -> FloatArray:
        """Give what is corrected, shape (n,)."""
        return self.expected(conditions).corrected

    def expected(self, conditions: Conditions) -> Expected:
        """Say what was learnt, how sure it is, and what of it is corrected."""
        found = columns_at(self.columns, self.zero, conditions)
        return self.expected_of(found, conditions.times_s, self._maps_since_start(conditions))

    def expected_of(
        self, found: Columns, times_s: FloatArray, maps: FloatArray | None = None
    ) -> Expected:
        """Say the same of columns that are known already.

        Parameters
        ----------
        found
            The columns at n moments.
        times_s : ndarray, shape (n,) [s]
            When.
        maps : ndarray, shape (n,), or None [the component's unit]
            What the maps say has changed since the record began; None: what is not sure goes
            back to them alone.
        """
        values = np.clip(found.values, *self._edges)
        is_held: BoolArray = np.any(found.values != values, axis=1) & np.isfinite(found.age_s)
        if not self.references_c:
            values[found.age_s > LONGER * SECONDS_PER_MIN * self.longest_min] = np.nan
        stretch = np.searchsorted(np.array(self.until_s), times_s, side="right")
        mean = np.einsum("ij,ij->i", values, np.array(self.coefficients)[stretch])
        variance = ((values @ self._root) ** 2).sum(axis=1)
        noise, age_min = Wander(*self.noise), found.age_s / SECONDS_PER_MIN
        # A set-up jumps as it begins with a correction as without it: caution does not count that.
        wander, slow = (
            np.sqrt(np.maximum(one.variance(age_min, is_zeroed=not self.references_c), 0.0))
            for one in (noise, noise._replace(jump=0.0))
        )
        learnt = np.sqrt(variance)
        maps = np.zeros(mean.shape) if maps is None else maps
        by = np.sqrt(self.counted)
        beside = np.zeros(mean.shape) if self.in_maps is not None else by * slow
        return Expected(mean, learnt, wander, cautious(mean, maps, by * learnt, beside), is_held)

    def farthest(self, conditions: Conditions) -> Outside | None:
        """Find the column that lies farthest beyond where it is held; None where none does."""
        found = columns_at(self.columns, self.zero, conditions)
        low, high = self._edges
        beyond = np.maximum(low - found.values, found.values - high)
        # Of a component that is not asked for there are no moments, and none of them lies outside.
        largest = np.max(np.nan_to_num(beyond, nan=0.0), axis=0, initial=0.0)
        share = largest / np.maximum(high - low, 1e-12)
        at = int(np.argmax(share))
        if share[at] <= 0.0:
            return None
        values = found.values[:, at]
        return Outside(self.columns[at], self.ranges[at], values, beyond[:, at] > 0.0)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """Every signal with every time constant of its filters."""
        taus = needed_signals(self.columns)
        return tuple(dict.fromkeys((column.signal, tau_s) for column, tau_s in taus.items()))

    @property
    def zero(self) -> Zero:
        """What temperatures are counted from."""
        return Zero(self.references_c, self.level_sensor, self.level_c, self.in_maps)

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
        if not self.references_c and (age_min > LONGER * self.longest_min).any():
            return (
                f"it was learnt within the first {self.longest_min:.0f} min of a record, and this "
                f"record began {np.nanmax(age_min):.0f} min ago"
            )
        return "the records of its sensors did not start together"

    def _maps_since_start(self, conditions: Conditions) -> FloatArray | None:
        """Say what the maps have changed by since the record began, shape (n,)."""
        if not self.maps:
            return None
        own = Column(LATE, self.maps_sensor, 0.0)
        first_c = conditions.from_start(own.signal, needed_signals(self.columns)[own]).first
        return changed_by(self.maps, conditions.temperature(self.maps_sensor), first_c)

    @cached_property
    def _edges(self) -> tuple[FloatArray, FloatArray]:
        low, high = np.array(self.ranges).T
        by = BEYOND * (high - low)
        return low - by, high + by

    @cached_property
    def _root(self) -> FloatArray:
        return read_root(self.spread, len(self.columns))


def changed_by(maps: Sequence[Range], here_c: FloatArray, first_c: FloatArray) -> FloatArray:
    """Say by how much errors differ between two temperatures, shape (n,).

    Parameters
    ----------
    maps
        Temperatures [°C], rising, and errors; held at their ends.
    here_c, first_c : ndarray, shape (n,) [°C]

    Examples
    --------
    >>> changed_by([(20.0, 0.0), (30.0, 5.0)], np.array([24.0]), np.array([22.0])).tolist()
    [1.0]
    """
    temperatures_c, errors = np.array(maps).T
    now, then = (np.interp(t, temperatures_c, errors) for t in (here_c, first_c))
    found: FloatArray = now - then
    return found


def written_root(covariance: FloatArray) -> str:
    """Write the lower triangle of a covariance's Cholesky root: 32 bit numbers in base 64.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Positive definite but for rounding.
    """
    slack = ROUNDING * np.diag(covariance).mean() * np.eye(len(covariance))
    root = np.linalg.cholesky(covariance + slack)
    packed = root[np.tril_indices(len(root))].astype("<f4")
    return base64.b64encode(packed.tobytes()).decode("ascii")


def read_root(written: str, p: int) -> FloatArray:
    """Read what `written_root` wrote of p coefficients, shape (p, p).

    Examples
    --------
    >>> read_root(written_root(np.diag([4.0, 9.0])), 2).round(3).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    root = np.zeros((p, p))
    root[np.tril_indices(p)] = np.frombuffer(base64.b64decode(written), dtype="<f4")
    return root

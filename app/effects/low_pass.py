"""The first-order low-pass over irregular readings: how a structure follows its temperature late.

    τ dy/dt = u(t) − y

Between readings u is a straight line (a temperature) or keeps its value (a spindle's speed).
Both have an exact solution over any step h, with a = exp(−h/τ) and the slope m of u:

    y(t + h) = u(t + h) − m τ + (y(t) − u(t) + m τ) a

The filter starts at rest in its first reading; after five time constants less than a
hundredth of what was wrong about that is left, and only then is the answer given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.blas import dtbsv

from app.arrays import FloatArray, IntArray

SETTLED: Final = 5.0
"""Time constants of history that are needed."""

BRIDGED: Final = 0.25
"""Share of a time constant over which missing readings hardly matter."""


class Hold(StrEnum):
    """What the input does between two readings."""

    LINEAR = "linear"
    PREVIOUS = "previous"


@dataclass(frozen=True, slots=True)
class LagState:
    """A filter between two readings: what a live update continues.

    Parameters
    ----------
    time_constant_s
        τ [s].
    since_s
        When the unbroken record began [s].
    time_s
        Time of the last reading [s].
    value
        The filter's output at that time, in the input's unit.
    first
        The first reading of the unbroken record; NaN where it is not known.
    moved_s
        When a reading first differed from that [s]; the last reading's time where none did.
    """

    time_constant_s: float
    hold: Hold
    since_s: float
    time_s: float
    input: float
    value: float
    first: float = math.nan
    moved_s: float = math.nan

    @classmethod
    def start(
        cls, time_constant_s: float, time_s: float, value: float, hold: Hold = Hold.LINEAR
    ) -> LagState:
        """Begin at rest with a first reading."""
        return cls(time_constant_s, hold, time_s, time_s, value, value, value, time_s)

    def update(self, time_s: float, value: float, max_gap_s: float = math.inf) -> LagState:
        """Take the next reading; after too long a gap begin anew.

        Parameters
        ----------
        time_s
            When [s]; a reading that is not newer changes nothing.
        max_gap_s
            Longest gap that is bridged [s].

        Examples
        --------
        >>> state = LagState.start(600.0, 0.0, 20.0, Hold.PREVIOUS).update(1.0, 30.0)
        >>> round(state.update(601.0, 30.0).value, 3)          # 20 + 10 (1 − 1/e)
        26.321
        """
        step = time_s - self.time_s
        if step <= 0.0:
            return self
        if step > bridged_s(self.time_constant_s, max_gap_s):
            return self.start(self.time_constant_s, time_s, value, self.hold)
        slope = (value - self.input) / step if self.hold is Hold.LINEAR else 0.0
        output = float(_advance(self.value, self.input, slope, step, self.time_constant_s))
        has_moved = self.input != self.first or self.moved_s < self.time_s
        moved_s = self.moved_s if has_moved else time_s
        return replace(self, time_s=time_s, input=value, value=output, moved_s=moved_s)

    def at(self, time_s: float) -> float:
        """Give the output at a time after the last reading, NaN where it has not settled."""
        if time_s - self.since_s < SETTLED * self.time_constant_s:
            return math.nan
        return self._output(time_s)

    def from_start(self, time_s: float) -> FromStart:
        """Give the output at a time after the last reading, settled or not, with its start."""
        parts = (self._output(time_s), self.first, self.since_s, self.moved_s)
        return FromStart(*(np.array([part]) for part in parts))

    def _output(self, time_s: float) -> float:
        elapsed = time_s - self.time_s
        return float(_advance(self.value, self.input, 0.0, elapsed, self.time_constant_s))


class FromStart(NamedTuple):
    """A low-pass that began in balance with the first reading of an unbroken record.

    Shape (n,) each: its output, that first reading, when the record began [s], and when a reading
    first differed from the first [s], which is the last reading's time where none did.
    """

    outputs: FloatArray
    first: FloatArray
    since_s: FloatArray
    moved_s: FloatArray

    @classmethod
    def unknown(cls, n: int) -> FromStart:
        """Know nothing at n times."""
        return cls(*np.full((4, n), np.nan))


class Filtered(NamedTuple):
    """A low-pass at its readings: shape (n,) each.

    `outputs` are in the inputs' unit; `since_s` says when the unbroken record began.
    """

    times_s: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    since_s: FloatArray

    @property
    def starts(self) -> IntArray:
        """Place of the reading with which each one's unbroken record began, shape (n,)."""
        begins = self.times_s == self.since_s
        found: IntArray = np.maximum.accumulate(np.where(begins, np.arange(begins.size), 0))
        return found

    @property
    def moved_s(self) -> FloatArray:
        """When a reading of its record first differed from the first, shape (n,) [s].

        Where none did as yet, that reading's own time.
        """
        starts, each = self.starts, np.arange(self.inputs.size)
        differ = self.inputs != self.inputs[starts]
        count = np.cumsum(differ) - np.cumsum(differ)[starts]
        begins = (count == 0) | (differ & (count == 1))
        found: FloatArray = self.times_s[np.maximum.accumulate(np.where(begins, each, 0))]
        return found


def bridged_s(time_constant_s: float, max_gap_s: float) -> float:
    """Say which gap between readings is still bridged [s].

    A quarter of the time constant, if that is longer than the allowed gap: what the input
    did meanwhile then hardly shows in the output.

    >>> bridged_s(7200.0, 600.0), bridged_s(600.0, 600.0)
    (1800.0, 600.0)
    """
    return max(max_gap_s, BRIDGED * time_constant_s)


def low_pass(
    times_s: FloatArray,
    inputs: FloatArray,
    time_constant_s: float,
    hold: Hold = Hold.LINEAR,
    max_gap_s: float = math.inf,
) -> Filtered:
    """Filter readings at irregular times.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing, at least one.
    inputs : ndarray, shape (n,)
        The readings.
    time_constant_s
        τ [s].
    max_gap_s
        Longest gap that is bridged; after a longer one the filter begins anew [s].

    Examples
    --------
    >>> filtered = low_pass(np.array([0.0, 600.0]), np.array([0.0, 600.0]), 600.0)
    >>> filtered.outputs.round(3).tolist()                 # a ramp: t − τ (1 − exp(−t/τ))
    [0.0, 220.728]
    """
    steps = np.diff(times_s)
    kept = np.exp(-steps / time_constant_s)
    # The step response is exact: y1 = a y0 + added.
    slopes = np.diff(inputs) / steps if hold is Hold.LINEAR else np.zeros(steps.shape)
    added = _advance(np.zeros(steps.shape), inputs[:-1], slopes, steps, time_constant_s)
    broken = steps > bridged_s(time_constant_s, max_gap_s)
    kept, added = np.where(broken, 0.0, kept), np.where(broken, inputs[1:], added)
    outputs = _recursion(float(inputs[0]), kept, added)
    starts = np.concatenate([[True], broken])
    since = times_s[np.maximum.accumulate(np.where(starts, np.arange(times_s.size), 0))]
    return Filtered(times_s, inputs, outputs, since)


def last_state(
    times_s: FloatArray,
    inputs: FloatArray,
    time_constant_s: float,
    hold: Hold = Hold.LINEAR,
    max_gap_s: float = math.inf,
) -> LagState:
    """Filter a record, and give the filter after its last reading.

    To the last bit it is what `LagState.start` and an `update` for each reading leave, so that
    who read a record at once and who followed it say the same.

    Parameters
    ----------
    times_s, inputs, time_constant_s, hold, max_gap_s
        As for `low_pass`.

    Examples
    --------
    >>> state = last_state(np.array([0.0, 600.0, 700.0]), np.array([0.0, 600.0, 5.0]), 600.0)
    >>> state == LagState.start(600.0, 0.0, 0.0).update(600.0, 600.0).update(700.0, 5.0)
    True
    """
    steps = np.diff(times_s)
    broken = np.flatnonzero(steps > bridged_s(time_constant_s, max_gap_s))
    begin = int(broken[-1]) + 1 if broken.size else 0
    times, values, steps = times_s[begin:], inputs[begin:], steps[begin:]
    lost = -np.expm1(-steps / time_constant_s)
    slopes = np.diff(values) / steps if hold is Hold.LINEAR else np.zeros(steps.shape)
    added = slopes * (steps - time_constant_s * lost)
    output = float(values[0])
    # One after the other, in the order in which `_advance` adds: sums of floats have an order.
    for u, share, more in zip(values[:-1].tolist(), lost.tolist(), added.tolist(), strict=True):
        output = output + (u - output) * share + more
    moved = np.flatnonzero(values != values[0])
    moved_s = times[moved[0]] if moved.size else times[-1]
    since_s, time_s, first, last = (float(x) for x in (times[0], times[-1], values[0], values[-1]))
    return LagState(time_constant_s, hold, since_s, time_s, last, output, first, float(moved_s))


def low_pass_at(
    filtered: Filtered,
    wanted_s: FloatArray,
    time_constant_s: float,
    hold: Hold = Hold.LINEAR,
    max_gap_s: float = math.inf,
) -> FloatArray:
    """Give a low-pass between its readings, by the same exact solution.

    Parameters
    ----------
    wanted_s : ndarray, shape (m,) [s]
        When.
    time_constant_s, hold, max_gap_s
        As for `low_pass`; the last reading before a gap serves for `max_gap_s`.

    Returns
    -------
    ndarray, shape (m,)
        NaN before five time constants of unbroken record, and where no reading is near.
    """
    found, before = _between(filtered, wanted_s, time_constant_s, hold, max_gap_s)
    settled = wanted_s - filtered.since_s[before] >= SETTLED * time_constant_s
    return np.where(settled, found, np.nan)


def low_pass_from_start(
    filtered: Filtered,
    wanted_s: FloatArray,
    time_constant_s: float,
    hold: Hold = Hold.LINEAR,
    max_gap_s: float = math.inf,
) -> FromStart:
    """Give a low-pass between its readings, settled or not, with the start of its record.

    Parameters
    ----------
    filtered, wanted_s, time_constant_s, hold, max_gap_s
        As for `low_pass_at`.

    Examples
    --------
    >>> filtered = low_pass(np.array([0.0, 60.0, 120.0]), np.array([20.0, 20.0, 21.0]), 600.0)
    >>> found = low_pass_from_start(filtered, np.array([120.0]), 600.0)
    >>> found.first.tolist(), found.moved_s.tolist()
    ([20.0], [120.0])
    """
    outputs, before = _between(filtered, wanted_s, time_constant_s, hold, max_gap_s)
    first = filtered.inputs[filtered.starts[before]]
    known = (first, filtered.since_s[before], filtered.moved_s[before])
    is_known = np.isfinite(outputs)
    return FromStart(outputs, *(np.where(is_known, part, np.nan) for part in known))


def _between(
    filtered: Filtered,
    wanted_s: FloatArray,
    time_constant_s: float,
    hold: Hold,
    max_gap_s: float,
) -> tuple[FloatArray, IntArray]:
    """Give outputs between readings, NaN where none is near, and the readings before."""
    times, inputs, outputs, _ = filtered
    at = np.searchsorted(times, wanted_s, side="right") - 1
    before = np.maximum(at, 0)
    after = np.minimum(before + 1, times.size - 1)
    span = times[after] - times[before]
    between = (span > 0) & (span <= bridged_s(time_constant_s, max_gap_s))
    rise = np.where(between, inputs[after] - inputs[before], 0.0)
    slope = rise / np.where(between, span, 1.0) if hold is Hold.LINEAR else np.zeros(rise.shape)
    elapsed = wanted_s - times[before]
    found = _advance(outputs[before], inputs[before], slope, elapsed, time_constant_s)
    near = (at >= 0) & (between | (elapsed <= max_gap_s))
    return np.where(near, found, np.nan), before


def _recursion(first: float, kept: FloatArray, added: FloatArray) -> FloatArray:
    """Solve y_{i+1} = kept_i y_i + added_i as a system of two diagonals."""
    diagonals = np.ones((2, kept.size + 1), order="F")
    diagonals[1, :-1] = -kept
    right = np.concatenate([[first], added])
    found: FloatArray = dtbsv(1, diagonals, right, lower=1, diag=1, overwrite_x=1)
    return found


def _advance(
    y: FloatArray | float,
    u: FloatArray | float,
    slope: FloatArray | float,
    step_s: FloatArray | float,
    time_constant_s: float,
) -> FloatArray:
    """Solve the equation over one step from output y, input u and the input's slope."""
    lost = -np.expm1(-np.asarray(step_s) / time_constant_s)
    found: FloatArray = y + (u - y) * lost + slope * (step_s - time_constant_s * lost)
    return found

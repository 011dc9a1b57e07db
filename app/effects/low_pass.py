"""The first-order low-pass over irregular readings: how a structure follows its temperature late.

    τ dy/dt = u(t) − y

Between readings u is a straight line, of a temperature or of a state: a spindle's speed changes at
once, at any moment between two readings, in the mean halfway. If the first of them held until the
second, all that follows late would follow half an interval later than it does. The solution is
exact over any step h, with a = exp(−h/τ) and the slope m of u:

    y(t + h) = u(t + h) − m τ + (y(t) − u(t) + m τ) a

The filter starts at rest in its first reading. Where nothing says that the machine was at rest,
the answer is given after five time constants, when less than a hundredth of what was wrong about
that is left.

A gap in the readings is crossed on a straight line, and what the input really did there is not
known. Over a gap of length g the output takes the share 1 − exp(−g/τ) from it, and forgets it like
all else: the share `unread` follows the same equation as the output, and no answer is given until
it is small. So a short gap costs a slow filter nothing and a quick one little time, none begins
anew on a warm machine, and all filters of one effect go back to the same beginning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.blas import dtbsv

from app.arrays import BoolArray, FloatArray, IntArray
from app.units import SECONDS_PER_H

SETTLED: Final = 5.0
"""Time constants of history that are needed."""

UNREAD: Final = 0.05
"""Share of an output that may rest on gaps: a straight line misses only a part of what the input
did there, and what is learnt of a machine is seldom known to a twentieth."""

RESTED_S: Final = 6.0 * SECONDS_PER_H
"""A machine of which nothing at all was read for so long is taken to have rested meanwhile [s]."""

TOGETHER_S: Final = SECONDS_PER_H
"""What is first read so long after that has been at rest until then, too [s]."""


@dataclass(frozen=True, slots=True)
class LagState:
    """A filter between two readings: what a live update continues.

    Parameters
    ----------
    time_constant_s
        τ [s].
    since_s
        When the record began [s].
    time_s
        Time of the last reading [s].
    value
        The filter's output at that time, in the input's unit.
    first
        The first reading of the record; NaN where the machine may not have rested before it.
    moved_s
        When a reading first differed from the first [s]; the last reading's time where none did.
    unread
        Share of the output that rests on gaps between readings.
    """

    time_constant_s: float
    since_s: float
    time_s: float
    input: float
    value: float
    first: float = math.nan
    moved_s: float = math.nan
    unread: float = 0.0

    @classmethod
    def start(
        cls,
        time_constant_s: float,
        time_s: float,
        value: float,
        *,
        at_rest: bool = True,
    ) -> LagState:
        """Begin in balance with a first reading.

        Parameters
        ----------
        at_rest
            Whether the machine was at rest until then; else the output rests on a guess.
        """
        first, unread = (value, 0.0) if at_rest else (math.nan, 1.0)
        return cls(time_constant_s, time_s, time_s, value, value, first, time_s, unread)

    def update(self, time_s: float, value: float, max_gap_s: float = math.inf) -> LagState:
        """Take the next reading.

        Parameters
        ----------
        time_s
            When [s]; a reading that is not newer changes nothing.
        max_gap_s
            What the input did over a longer step is not known [s].

        Examples
        --------
        >>> state = LagState.start(600.0, 0.0, 0.0).update(600.0, 600.0)
        >>> round(state.value, 3)                              # a ramp: t − τ (1 − exp(−t/τ))
        220.728
        """
        step = time_s - self.time_s
        if step <= 0.0:
            return self
        slope = (value - self.input) / step
        output = float(_advance(self.value, self.input, slope, step, self.time_constant_s))
        has_moved = self.input != self.first or self.moved_s < self.time_s
        moved_s = self.moved_s if has_moved else time_s
        unread, is_gap = self.unread, 1.0 if step > max_gap_s else 0.0
        if unread != is_gap:  # hardly ever: most records are without gaps
            unread = float(_advance(unread, is_gap, 0.0, step, self.time_constant_s))
        return replace(
            self, time_s=time_s, input=value, value=output, moved_s=moved_s, unread=unread
        )

    def unread_at(self, time_s: float) -> float:
        """Say which share of the output rests on gaps at a time after the last reading."""
        return self._advanced(self.unread, 0.0, time_s) if self.unread else 0.0

    def at(self, time_s: float) -> float:
        """Give the output at a time after the last reading, NaN where it has not settled."""
        if time_s - self.since_s < SETTLED * self.time_constant_s:
            return math.nan
        return self._output(time_s)

    def from_start(self, time_s: float) -> FromStart:
        """Give the output at a time after the last reading, settled or not, with its start."""
        output = self._output(time_s)
        if math.isnan(output):
            return FromStart.unknown(1)
        parts = (output, self.first, self.since_s, self.moved_s)
        return FromStart(*(np.array([part]) for part in parts))

    def _output(self, time_s: float) -> float:
        if self.unread_at(time_s) > UNREAD:
            return math.nan
        return self._advanced(self.value, self.input, time_s)

    def _advanced(self, y: float, u: float, time_s: float) -> float:
        return float(_advance(y, u, 0.0, time_s - self.time_s, self.time_constant_s))


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

    `outputs` are in the inputs' unit; `since_s` says when the record began, `is_rested` whether
    the machine was at rest until then, `unread` which share of the output rests on gaps: what the
    input did over a step longer than `max_gap_s` is not known [s].
    """

    times_s: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    since_s: FloatArray
    is_rested: BoolArray
    unread: FloatArray
    time_constant_s: float
    max_gap_s: float

    @property
    def starts(self) -> IntArray:
        """Place of the reading with which each one's record began, shape (n,)."""
        begins = self.times_s == self.since_s
        latest_start: IntArray = np.maximum.accumulate(np.where(begins, np.arange(begins.size), 0))
        return latest_start

    @property
    def first(self) -> FloatArray:
        """The first reading of each one's record, NaN where that did not begin at rest."""
        return np.where(self.is_rested, self.inputs[self.starts], np.nan)

    @property
    def moved_s(self) -> FloatArray:
        """When a reading of its record first differed from the first, shape (n,) [s].

        Where none did as yet, that reading's own time.
        """
        starts, each = self.starts, np.arange(self.inputs.size)
        differ = self.inputs != self.inputs[starts]
        # As long as no reading of its record has differed each one stands for itself, and so does
        # the first that differs. Behind that none does: the latest that does is the one that is
        # looked for.
        count = np.cumsum(differ) - np.cumsum(differ)[starts]
        begins = (count == 0) | (differ & (count == 1))
        moved = self.times_s[np.maximum.accumulate(np.where(begins, each, 0))]
        return np.where(self.is_rested, moved, self.since_s)

    def at(self, wanted_s: FloatArray) -> FloatArray:
        """Give the low-pass between its readings, by the same exact solution.

        Parameters
        ----------
        wanted_s : ndarray, shape (m,) [s]
            When; the last reading before a gap serves for `max_gap_s`.

        Returns
        -------
        ndarray, shape (m,)
            NaN before five time constants of record, where no reading is near, and where too much
            of the output rests on gaps.
        """
        values, before = self._between(wanted_s)
        settled = wanted_s - self.since_s[before] >= SETTLED * self.time_constant_s
        return np.where(settled, values, np.nan)

    def from_start(self, wanted_s: FloatArray) -> FromStart:
        """Give the low-pass between its readings, settled or not, with the start of its record.

        Examples
        --------
        >>> filtered = low_pass(np.array([0.0, 60.0, 120.0]), np.array([20.0, 20.0, 21.0]), 600.0)
        >>> found = filtered.from_start(np.array([120.0]))
        >>> found.first.tolist(), found.moved_s.tolist()
        ([20.0], [120.0])
        """
        outputs, before = self._between(wanted_s)
        parts = (self.first[before], self.since_s[before], self.moved_s[before])
        is_known = np.isfinite(outputs)
        return FromStart(outputs, *(np.where(is_known, part, np.nan) for part in parts))

    def unread_at(self, wanted_s: FloatArray) -> FloatArray:
        """Say which share rests on gaps at times, shape (m,); NaN before the record."""
        at = np.searchsorted(self.times_s, wanted_s, side="right") - 1
        before = np.maximum(at, 0)
        elapsed = wanted_s - self.times_s[before]
        unread = _advance(self.unread[before], 0.0, 0.0, elapsed, self.time_constant_s)
        return np.where(at >= 0, unread, np.nan)

    def _between(self, wanted_s: FloatArray) -> tuple[FloatArray, IntArray]:
        """Give outputs between readings, NaN where none is near, and the readings before."""
        times, inputs, outputs = self.times_s, self.inputs, self.outputs
        at = np.searchsorted(times, wanted_s, side="right") - 1
        before = np.maximum(at, 0)
        after = np.minimum(before + 1, times.size - 1)
        span = times[after] - times[before]
        goes_on = self.since_s[after] == self.since_s[before]
        between = (span > 0) & (span <= self.max_gap_s) & goes_on
        rise = np.where(between, inputs[after] - inputs[before], 0.0)
        slope = rise / np.where(between, span, 1.0)
        elapsed = wanted_s - times[before]
        advanced = _advance(outputs[before], inputs[before], slope, elapsed, self.time_constant_s)
        is_read = self.unread_at(wanted_s) <= UNREAD
        is_known = (at >= 0) & (between | (elapsed <= self.max_gap_s)) & is_read
        return np.where(is_known, advanced, np.nan), before


def beginnings(times_s: FloatArray, rested_s: float = RESTED_S) -> FloatArray:
    """Find when a machine began to be read after it had rested.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        When anything of it was read, in order of time.
    rested_s
        Without readings for longer than this it rested [s].

    Returns
    -------
    ndarray, shape (m,) [s]

    Examples
    --------
    >>> beginnings(np.array([0.0, 600.0, 40000.0, 40600.0])).tolist()
    [0.0, 40000.0]
    """
    is_first = np.append(True, np.diff(times_s) > rested_s)[: times_s.size]
    begins_s: FloatArray = times_s[is_first]
    return begins_s


def low_pass(
    times_s: FloatArray,
    inputs: FloatArray,
    time_constant_s: float,
    max_gap_s: float = math.inf,
    begins_s: FloatArray | None = None,
) -> Filtered:
    """Filter readings at irregular times.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing, at least one.
    inputs : ndarray, shape (n,)
    time_constant_s
        τ [s].
    max_gap_s
        What the input did over a longer step is not known [s].
    begins_s : ndarray, shape (m,) [s]
        When the machine began to be read after a rest (`beginnings`), which is where its filters
        begin anew; without it at the first reading.

    Examples
    --------
    >>> filtered = low_pass(np.array([0.0, 600.0]), np.array([0.0, 600.0]), 600.0)
    >>> filtered.outputs.round(3).tolist()                 # a ramp: t − τ (1 − exp(−t/τ))
    [0.0, 220.728]
    """
    starts, rested = _starts(times_s, begins_s)
    steps = np.diff(times_s)
    share = np.exp(-steps / time_constant_s)
    # The step response is exact: y1 = a y0 + added.
    slopes = np.diff(inputs) / steps
    added = _advance(np.zeros(steps.shape), inputs[:-1], slopes, steps, time_constant_s)
    again = starts[1:]
    # Where the filter begins anew nothing of what was before is left, and the reading itself is
    # added: one recursion serves all records.
    share = np.where(again, 0.0, share)
    outputs = _recursion(float(inputs[0]), share, np.where(again, inputs[1:], added))
    guessed = np.where(rested, 0.0, 1.0)
    crossed = np.where(steps > max_gap_s, -np.expm1(-steps / time_constant_s), 0.0)
    unread = _recursion(float(guessed[0]), share, np.where(again, guessed[1:], crossed))
    begun = np.maximum.accumulate(np.where(starts, np.arange(times_s.size), 0))
    return Filtered(
        *(times_s, inputs, outputs, times_s[begun], rested[begun], unread),
        *(time_constant_s, max_gap_s),
    )


def last_state(
    times_s: FloatArray,
    inputs: FloatArray,
    time_constant_s: float,
    max_gap_s: float = math.inf,
    begins_s: FloatArray | None = None,
) -> LagState:
    """Filter a record, and give the filter after its last reading.

    To the last bit it is what `LagState.start` and an `update` for each reading leave, so that
    who read a record at once and who followed it say the same.

    Parameters
    ----------
    times_s, inputs, time_constant_s, max_gap_s, begins_s
        As for `low_pass`.

    Examples
    --------
    >>> state = last_state(np.array([0.0, 600.0, 700.0]), np.array([0.0, 600.0, 5.0]), 600.0)
    >>> state == LagState.start(600.0, 0.0, 0.0).update(600.0, 600.0).update(700.0, 5.0)
    True
    """
    starts, rested = _starts(times_s, begins_s)
    begin = int(np.flatnonzero(starts)[-1])
    times, values = times_s[begin:], inputs[begin:]
    steps = np.diff(times)
    lost = -np.expm1(-steps / time_constant_s)
    slopes = np.diff(values) / steps
    added = slopes * (steps - time_constant_s * lost)
    gaps = (steps > max_gap_s) * 1.0
    begun = LagState.start(
        time_constant_s, float(times[0]), float(values[0]), at_rest=bool(rested[begin])
    )
    output, unread = begun.value, begun.unread
    # One after the other, in the order in which `_advance` adds: sums of floats have an order.
    for u, gap, share, more in zip(
        values[:-1].tolist(), gaps.tolist(), lost.tolist(), added.tolist(), strict=True
    ):
        output = output + (u - output) * share + more
        unread = unread + (gap - unread) * share
    moved = np.flatnonzero(values != begun.first)
    moved_s = times[moved[0]] if moved.size else times[-1]
    return replace(
        begun,
        time_s=float(times[-1]),
        input=float(values[-1]),
        value=output,
        moved_s=float(moved_s),
        unread=unread,
    )


def _starts(times_s: FloatArray, begins_s: FloatArray | None) -> tuple[BoolArray, BoolArray]:
    """Say at which readings a filter begins anew, and at which of them the machine was at rest."""
    if begins_s is None:
        begins_s = times_s[:1]
    run = np.searchsorted(begins_s, times_s, side="right") - 1
    starts = np.append(True, np.diff(run) > 0)
    return starts, times_s - begins_s[np.maximum(run, 0)] <= TOGETHER_S


def _recursion(first: float, decays: FloatArray, added: FloatArray) -> FloatArray:
    """Solve y_{i+1} = kept_i y_i + added_i as a system of two diagonals."""
    # The steps are unequal, and so are the factors: no cumulative sum does it, and no filter with
    # constant coefficients. Written as y_{i+1} − kept_i y_i = added_i, row by row, it is a
    # triangular system of two diagonals, which BLAS solves from the top in one call.
    diagonals = np.ones((2, decays.size + 1), order="F")
    diagonals[1, :-1] = -decays
    right = np.concatenate([[first], added])
    filtered: FloatArray = dtbsv(1, diagonals, right, lower=1, diag=1, overwrite_x=1)
    return filtered


def _advance(
    y: FloatArray | float,
    u: FloatArray | float,
    slope: FloatArray | float,
    step_s: FloatArray | float,
    time_constant_s: float,
) -> FloatArray:
    """Solve the equation over one step from output y, input u and the input's slope."""
    # `expm1`: of a step of a second and a time constant of hours, 1 − exp(−h/τ) would lose digits.
    lost = -np.expm1(-np.asarray(step_s) / time_constant_s)
    output: FloatArray = y + (u - y) * lost + slope * (step_s - time_constant_s * lost)
    return output

"""The past as filters that are carried along with the readings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from app.arrays import FloatArray
from app.effects.conditions import Lags, Signal
from app.effects.low_pass import (
    RESTED_S,
    SETTLED,
    TOGETHER_S,
    FromStart,
    LagState,
)
from app.units import SECONDS_PER_MIN


@dataclass(frozen=True, eq=False)
class LiveLags(Lags):
    """The past as filters that are carried along with the readings.

    Parameters
    ----------
    filters
        Signal and time constant [s] to the filter, None before its first reading.
    max_gaps_s
        Kind and name of a signal to the longest gap over which its readings are known [s];
        any gap where it is left out.
    rested_s
        Without any reading for longer than this the machine rested [s].
    begun_s, read_s
        When it began to be read after the last rest, and when it was last read [s].
    """

    filters: Mapping[tuple[Signal, float], LagState | None]
    max_gaps_s: Mapping[tuple[str, str], float] = field(default_factory=dict)
    rested_s: float = RESTED_S
    begun_s: float = -math.inf
    read_s: float = -math.inf

    def lagged(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Give the filters' outputs, NaN where there is none or it has not settled."""
        state = self.filters.get((signal, time_constant_s))
        if state is None:
            return np.full(times_s.shape, np.nan)
        max_gap_s = self._max_gap_s(signal)
        return np.array([_output(state, time_s, max_gap_s) for time_s in times_s.tolist()])

    def from_start(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FromStart:
        """Give the filters' outputs, settled or not, with the start of their record."""
        state = self.filters.get((signal, time_constant_s))
        if state is None:
            return FromStart.unknown(len(times_s))
        max_gap_s = self._max_gap_s(signal)
        of_signals = [
            state.from_start(time_s) if time_s - state.time_s <= max_gap_s else FromStart.unknown(1)
            for time_s in times_s.tolist()
        ]
        return FromStart(*(np.concatenate(parts) for parts in zip(*of_signals, strict=True)))

    def unread(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Say which share of a filter's output rests on gaps."""
        state = self.filters.get((signal, time_constant_s))
        if state is None:
            return np.full(times_s.shape, np.nan)
        return np.array([state.unread_at(time_s) for time_s in times_s.tolist()])

    def why_missing(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> str:
        """Say how long the filter has been running."""
        have = self.record_before_s(signal, float(times_s.min()))
        return (
            f"expected {SETTLED * time_constant_s / SECONDS_PER_MIN:.0f} min of readings of "
            f"{signal.name} without a gap (five time constants), got "
            f"{have / SECONDS_PER_MIN:.0f} min"
        )

    def record_before_s(self, signal: Signal, time_s: float) -> float:
        """Say for how long the signal's oldest filter has been running [s]."""
        running = [time_s - f.since_s for (s, _), f in self.filters.items() if f and s == signal]
        return max(running, default=0.0)

    def update(
        self, time_s: float, temperatures_c: Mapping[str, float], states: Mapping[str, float]
    ) -> LiveLags:
        """Carry every filter on with one reading."""
        # After a rest all filters begin anew; a sensor whose first reading comes soon after the
        # machine's has been at rest until then, as in records (`low_pass`).
        begins = time_s - self.read_s > self.rested_s
        begun_s = time_s if begins else self.begun_s
        at_rest = time_s - begun_s <= TOGETHER_S
        read = {"temperature": temperatures_c, "state": states}
        carried = dict.fromkeys(self.filters) if begins else dict(self.filters)
        for (signal, tau_s), state in carried.items():
            value = read[signal.kind].get(signal.name)
            if value is not None:
                value = signal.of(value)
                carried[signal, tau_s] = (
                    LagState.start(tau_s, time_s, value, at_rest=at_rest)
                    if state is None
                    else state.update(time_s, value, self._max_gap_s(signal))
                )
        return replace(self, filters=carried, begun_s=begun_s, read_s=max(time_s, self.read_s))

    def _max_gap_s(self, signal: Signal) -> float:
        return self.max_gaps_s.get((signal.kind, signal.name), math.inf)


def _output(state: LagState, time_s: float, max_gap_s: float) -> float:
    return state.at(time_s) if time_s - state.time_s <= max_gap_s else math.nan

"""What a followed number is made of: a constant, and set-ups that may resemble the one before.

    y_t = c + s_t + e_t        s_t = ρ s_{t−1} + √(1 − ρ²) σ ε_t

c is what the maps' uncertainty allows, s_t the set-up's shift, e_t the observations' scatter.
Neither the scatter σ of set-ups nor their correlation ρ is known beforehand: a Kalman filter runs
for each pair that is held possible, and how well each pair has foretold says how far it is
believed. Set-ups taken as independent where the same person and the same laser make them alike
were the commonest false alarm: at a correlation of 0.85 differences of successive visits show
a seventh of the scatter's variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.search.priors import (
    CHANGED_BETWEEN,
    CHANGED_BY,
    WATCH_CORRELATION_WEIGHTS,
    WATCH_CORRELATIONS,
    WATCH_SETUP_WEIGHTS,
    WATCH_SETUPS,
)

PAIRS: Final = len(WATCH_SETUPS) * len(WATCH_CORRELATIONS)

_SCATTER: Final = np.repeat(WATCH_SETUPS, len(WATCH_CORRELATIONS))
_CORRELATION: Final = np.tile(WATCH_CORRELATIONS, len(WATCH_SETUPS))
_BELIEVED_AT_FIRST: Final = np.log(np.outer(WATCH_SETUP_WEIGHTS, WATCH_CORRELATION_WEIGHTS).ravel())


@dataclass(frozen=True, slots=True)
class Track:
    """State of the filters, one for each pair of scatter and correlation.

    Parameters
    ----------
    constants, setups
        Expected constant and set-up [the component's unit].
    of_constants, of_both, of_setups
        Their variances and their covariance [the component's unit, squared].
    """

    constants: tuple[float, ...]
    setups: tuple[float, ...]
    of_constants: tuple[float, ...]
    of_both: tuple[float, ...]
    of_setups: tuple[float, ...]

    @classmethod
    def begin(cls, mean: float, variance: float) -> Track:
        """Begin with a constant of which that much is known, before the first set-up."""
        nothing = (0.0,) * PAIRS
        return cls((mean,) * PAIRS, nothing, (variance,) * PAIRS, nothing, nothing)

    def foretell(self, repeatability: float, is_first: bool) -> SetUpState:
        """Go on to the next visit's set-up."""
        # ρ² σ² + (1 − ρ²) σ² = σ²: set-ups scatter as much at every visit, however often one is
        # resembled.
        rho = np.zeros(PAIRS) if is_first else _CORRELATION
        fresh = (_SCATTER * repeatability) ** 2
        return SetUpState(
            np.array([self.constants, rho * self.setups]),
            np.array(self.of_constants),
            rho * self.of_both,
            rho**2 * self.of_setups + (1.0 - rho**2) * fresh,
        )


@dataclass(frozen=True, slots=True, eq=False)
class SetUpState:
    """The same as arrays, before a visit's number is taken: shapes (2, pairs) and (pairs,)."""

    means: FloatArray
    of_constant: FloatArray
    of_both: FloatArray
    of_setup: FloatArray

    @property
    def variance(self) -> FloatArray:
        """Variance of the sum of constant and set-up."""
        return self.of_constant + 2.0 * self.of_both + self.of_setup

    def away(self, value: float) -> FloatArray:
        """Say how far a number is from what was foretold."""
        return np.asarray(value - self.means.sum(axis=0))

    def with_change(self, variance: float) -> SetUpState:
        """Let the constant have changed."""
        return SetUpState(self.means, self.of_constant + variance, self.of_both, self.of_setup)

    def after(self, value: float, scatter: float) -> SetUpState:
        """Take a number with that variance of its own."""
        # Kalman's gain: y = c + s + e, so `both` is the covariance of (c, s) with y.
        both = np.array([self.of_constant + self.of_both, self.of_both + self.of_setup])
        gain = both / (self.variance + scatter)
        return SetUpState(
            self.means + gain * self.away(value),
            self.of_constant - gain[0] * both[0],
            self.of_both - gain[0] * both[1],
            self.of_setup - gain[1] * both[1],
        )

    def mixed(self, other: SetUpState, share: FloatArray) -> SetUpState:
        """Merge with another state, which has that share, into one of the same two moments."""
        apart = other.means - self.means
        # Moments of a mixture: the mean of the variances, and the variance of the two means. Kept
        # as two they would double with every visit.
        spread = share * (1.0 - share)
        return SetUpState(
            self.means + share * apart,
            (1 - share) * self.of_constant + share * other.of_constant + spread * apart[0] ** 2,
            (1 - share) * self.of_both + share * other.of_both + spread * apart[0] * apart[1],
            (1 - share) * self.of_setup + share * other.of_setup + spread * apart[1] ** 2,
        )

    def track(self) -> Track:
        """Write it down."""
        parts = (*self.means, self.of_constant, self.of_both, self.of_setup)
        return Track(*(tuple(part.tolist()) for part in parts))


def believed(likelihoods: FloatArray) -> FloatArray:
    """Say how much each pair is believed, shape (pairs,); together one."""
    # Divided by the largest first: exp of a log likelihood of many visits is 0.
    logs = _BELIEVED_AT_FIRST + likelihoods
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def scatter_of_setups(likelihoods: FloatArray) -> float:
    """Give the scatter of set-ups that is believed, as a root mean square [repeatabilities]."""
    return float(np.sqrt(believed(likelihoods) @ _SCATTER**2))


def learn(
    state: SetUpState, value: float, scatter: float, repeatability: float
) -> tuple[SetUpState, FloatArray]:
    """Take a number where the constant may have changed since the visit before.

    Returns
    -------
    state : SetUpState
    log_likelihood : ndarray, shape (pairs,)
    """
    changed = state.with_change((CHANGED_BY * repeatability) ** 2)
    away = state.away(value)
    same, other = (
        np.log(share) - 0.5 * (away**2 / variance + np.log(variance))
        for share, variance in (
            (1.0 - CHANGED_BETWEEN, state.variance + scatter),
            (CHANGED_BETWEEN, changed.variance + scatter),
        )
    )
    both = np.logaddexp(same, other)
    share = np.exp(other - both)
    return state.after(value, scatter).mixed(changed.after(value, scatter), share), both

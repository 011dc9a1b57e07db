"""How large an effect must be to pass the threshold nine times in ten.

Were the variances of observations and set-ups known, the root of the likelihood ratio would be
normal about the root of what the rows say of the effect. They are estimated from the same rows,
and an effect that differs from visit to visit passes for scatter between them: of few visits the
ratio is then far smaller. That is worked out on draws of noise: each draw's squares are known at
every set of visit variances, and an effect adds to them what each set leaves of it. The threshold
is taken for what it is without the effect.

A. Wald, Trans. Am. Math. Soc. 54 (1943) 426: the noncentrality of a likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import chdtri, ndtr

from app.arrays import FloatArray, IntArray
from app.search.base_grams import BaseGrams
from app.search.draws import DrawnMoments, Draws
from app.search.joint_fit import inverse
from app.search.state import State
from app.search.threshold import Threshold

NINE_IN_TEN: Final = 0.9
"""How often an effect of the stated size is found."""

DRAWN: Final = 20
"""Draws of noise behind a size, of all sets of visit variances in turn: of each the place where it
passes is worked out."""

LARGEST: Final = 1e8
"""Noncentrality from which nothing is called visible."""

STEPS: Final = 6
"""Of the secant method: within one per cent of where bisection ends."""

FARTHEST: Final = 2.5
STEEPNESS: Final = (0.08, 1.5)
"""So far a step goes at most, and such slopes are believed, both of logarithms."""

HALVINGS: Final = 26


@dataclass(frozen=True, eq=False)
class DrawnNoise:
    """Noise of one channel as it may be, at every set of visit variances.

    Parameters
    ----------
    squares : ndarray, shape (L, m)
        What each set leaves of each draw's squares, effects aside.
    level : ndarray, shape (m,)
        From which set each draw comes.
    variance : ndarray, shape (m,)
        The variance of one of its observations, over the square of the scale.
    """

    state: State
    squares: FloatArray
    level: IntArray
    variance: FloatArray

    @classmethod
    def of(cls, state: State, draws: Draws) -> DrawnNoise:
        """Draw the noise of a channel about what its null model says."""
        response = draws.response(state)
        level = response.level
        # As often from each set as all draws are.
        places = (np.arange(DRAWN) + 0.5) * len(level) / DRAWN
        which = np.argsort(level, kind="stable")[places.astype(np.intp)]
        squares = _squares(state, response)[:, which]
        variance = state.scatter(state.rss)[level[which]]
        return cls(state, squares, level[which], variance)

    @cached_property
    def likelihood(self) -> FloatArray:
        """The log likelihood of each draw, shape (m,)."""
        return self.state.largest(self.squares)

    def risen(self, added: FloatArray) -> FloatArray:
        """Give the likelihood ratio of effects that add so much to the squares.

        Parameters
        ----------
        added : ndarray, shape (L, g, m)

        Returns
        -------
        ndarray, shape (g, m)
        """
        return 2.0 * (self.likelihood - self.state.largest(self.squares[:, None] + added))


def _squares(state: State, response: DrawnMoments) -> FloatArray:
    """Give what each set of visit variances leaves of draws, shape (L, m)."""
    shadow = state.levels.shadow(response.with_nuisance, response.reduced)
    return np.asarray(response.square - np.sum(shadow**2, axis=1))


def as_assumed(states: Mapping[int, State], draws: Draws) -> dict[int, State]:
    """Give states whose squares are those to be expected of the noise that is assumed.

    Nothing need have been measured: their values are not to be looked at.
    """
    assumed = {}
    for c, state in states.items():
        assumed_state = State(state.fixed, state.cells)
        level = np.full(draws.count, state.fixed.channel.assumed, dtype=np.intp)
        assumed_state.rss = _squares(state, draws.response_at(state, level)).mean(axis=1)
        assumed[c] = assumed_state
    return assumed


def noncentralities(
    base: BaseGrams,
    noise: Mapping[int, DrawnNoise],
    limit: Threshold,
    cost: FloatArray,
    parts: Sequence[tuple[int, Sequence[int]]],
) -> FloatArray:
    """Give the noncentrality with which entries are found nine times in ten.

    Parameters
    ----------
    base
        Information at each set of visit variances, on the cells of the noise's states.
    cost : ndarray, shape (entries,)
        What each entry must pay for its parameters besides (`penalties`).
    parts
        Numbers of batches of one size that act in the same channels, each with places in it: g
        in all.

    Returns
    -------
    ndarray, shape (g,)
        At the variances that the null model has, as `informations` gives the rows' information.
    """
    batches = base.library.batches
    first = batches[parts[0][0]]
    entries = np.array([batches[number].entries[i] for number, places in parts for i in places])
    grams = {
        c: np.concatenate([base.of(number, c).gram[:, list(at)] for number, at in parts], axis=1)
        for c in first.channels
    }
    # An effect must pass the threshold and pay for its parameters: whichever asks for more.
    limited = chdtri(first.size, np.power(10.0, -limit.surprise[entries]))
    by = limit.bartlett[entries]
    return _Visible.of(grams, noise).needed(
        np.maximum(limited / by, cost[entries] / np.minimum(by, 1.0))
    )


@dataclass(frozen=True, eq=False)
class _Visible:
    """Some entries, and what each set of visit variances leaves of them.

    Parameters
    ----------
    shares
        Channel to the squares that an effect of noncentrality 1 adds at each set, shape (L, g).
    """

    shares: Mapping[int, FloatArray]
    noise: Mapping[int, DrawnNoise]

    @classmethod
    def of(cls, grams: Mapping[int, FloatArray], noise: Mapping[int, DrawnNoise]) -> _Visible:
        """Take grams of shape (L, g, k, k), on average over the directions of their amplitudes."""
        total: FloatArray = np.zeros(next(iter(grams.values()))[0].shape)
        for c, gram in grams.items():
            state = noise[c].state
            best = int(np.argmax(state.null))
            total = total + gram[best] / float(state.scatter(state.rss[best]))
        # Amplitudes a of any direction with a'(Σ G/σ²)a = 1 have, on average, aa' = (Σ G/σ²)⁻¹/k;
        # at set l they add a'G_l a = tr((Σ G/σ²)⁻¹ G_l)/k to the squares.
        back = inverse(total)
        size = total.shape[-1]
        shares = {c: np.einsum("gij,lgji->lg", back, gram) / size for c, gram in grams.items()}
        return cls({c: np.maximum(share, 0.0) for c, share in shares.items()}, noise)

    def needed(self, wanted: FloatArray) -> FloatArray:
        """Give the noncentralities at which ratios exceed so much nine times in ten, shape (g,)."""
        return self._nine_in_ten(self._passing(wanted))

    def ratio(self, size: FloatArray) -> FloatArray:
        """Give the likelihood ratios of effects of some noncentralities, shape (g, m)."""
        ratios = np.zeros(size.shape)
        for c, share in self.shares.items():
            ratios += self.noise[c].risen(share[:, :, None] * size)
        return ratios

    def _passing(self, wanted: FloatArray) -> FloatArray:
        """Find the noncentrality at which each draw passes, shape (g, m): the secant method.

        The ratio grows about as a power of the noncentrality: logarithms make that a line.
        """
        draws = len(self.noise[next(iter(self.shares))].level)
        at = np.log(np.repeat(wanted[:, None], draws, axis=1))
        off = self._off(at, wanted)
        slope = np.ones(at.shape)
        for _ in range(STEPS):
            step = np.clip(-off / slope, -FARTHEST, FARTHEST)
            after = np.clip(at + step, 0.0, np.log(LARGEST))
            off_after = self._off(after, wanted)
            moved = after - at
            has_moved = np.abs(moved) > 1e-9
            slope = np.where(has_moved, (off_after - off) / np.where(has_moved, moved, 1.0), slope)
            slope = np.clip(slope, *STEEPNESS)
            at, off = after, off_after
        return np.asarray(np.exp(at))

    def _off(self, log_size: FloatArray, wanted: FloatArray) -> FloatArray:
        """Say how far the ratios are above what is asked, as a logarithm, shape (g, m)."""
        ratio = np.maximum(self.ratio(np.exp(log_size)), np.finfo(float).tiny)
        return np.asarray(np.log(ratio) - np.log(wanted)[:, None])

    def _nine_in_ten(self, passes: FloatArray) -> FloatArray:
        """Find the size that passes in nine of ten draws, its own error included, shape (g,)."""
        precision = np.zeros(passes.shape)
        for c, share in self.shares.items():
            noise = self.noise[c]
            precision += share[noise.level].T / noise.variance
        sharp, at = np.sqrt(np.maximum(precision, 0.0)), np.sqrt(passes)
        low, high = np.zeros(len(passes)), np.full(len(passes), np.sqrt(LARGEST))
        for _ in range(HALVINGS):
            middle = (low + high) / 2.0
            is_enough = ndtr((middle[:, None] - at) * sharp).mean(axis=1) >= NINE_IN_TEN
            low, high = np.where(is_enough, low, middle), np.where(is_enough, middle, high)
        return np.asarray(high**2)

"""All chosen terms at once, in all channels: amplitudes, their covariance, the likelihood.

W. Oberhofer, J. Kmenta, Econometrica 42 (1974) 579: generalised least squares and variances in
turn lead to a maximum of the likelihood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray
from app.search.channel import shared_errors, unit_prior_columns
from app.search.model import Model
from app.search.problem import Term, places
from app.search.rows import Nuisance
from app.search.state import LEAST_SQUARES, State

ROUNDS: Final = 25
REST: Final = 1e-7
"""The log likelihood rests when it rises by less."""

RANK: Final = 1e-9
"""Directions with less information than this, relative, are not fitted."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Terms fitted together.

    Parameters
    ----------
    log_likelihood
        Over all channels, visit variances and repeatabilities profiled.
    amplitudes : ndarray, shape (k,)
        For columns of unit length, all terms one after the other.
    covariance : ndarray, shape (k, k)
    level
        Channel to the set of visit variances that fits best.
    scatter
        Channel to the variance of one observation, over the square of its scale.
    """

    log_likelihood: float
    amplitudes: FloatArray
    covariance: FloatArray
    level: Mapping[int, int]
    scatter: Mapping[int, float]


@dataclass(frozen=True, eq=False)
class Share:
    """What one channel says about the amplitudes, for each set of visit variances."""

    state: State
    index: IntArray
    gram: FloatArray
    slope: FloatArray

    def alone(self) -> tuple[int, float]:
        """Profile with this channel's own amplitudes."""
        gains = np.einsum("li,lij,lj->l", self.slope, inverse(self.gram), self.slope)
        rss = self.state.rss - gains
        level = int(self.state.profile(rss)[1])
        return level, float(self.state.scatter(rss[level]))


def fit_terms(states: Mapping[int, State], terms: Sequence[Term]) -> Fit:
    """Fit terms together by maximum likelihood.

    Parameters
    ----------
    states
        Channel to its state, without given terms.
    terms
        The terms; none: the null model.

    Notes
    -----
    Amplitudes by generalised least squares at the current visit variances and
    repeatabilities, then those at the current amplitudes, until the likelihood rests.
    Started from each channel's own best and from the null model: with one channel for
    each term the first start is the answer already.
    """
    shares = {
        c: share_of(s, terms) for c, s in states.items() if any(c in t.columns for t in terms)
    }
    null = {c: _null(s) for c, s in states.items()}
    width = sum(t.size for t in terms)
    alone = {c: s.alone() for c, s in shares.items()}
    # The likelihood may have several maxima: an effect can pass for scatter between visits.
    starts = [alone]
    if any(len(t.columns) > 1 for t in terms):
        starts.append({c: null[c][1:] for c in shares})
    together = _Shares.of(shares, width)
    fits = [together.rest(s) for s in starts]
    best = max(fits, key=lambda f: f.log_likelihood)
    rest = {c: n for c, n in null.items() if c not in shares}
    return Fit(
        best.log_likelihood + sum(n[0] for n in rest.values()),
        best.amplitudes,
        best.covariance,
        {c: best.level[c] if c in shares else null[c][1] for c in states},
        {c: best.scatter[c] if c in shares else null[c][2] for c in states},
    )


def unexpected(term: Term, fit: Fit, place: int) -> float:
    """Give what it costs that a term's amplitude is not what it is expected to be.

    Parameters
    ----------
    fit, place
        A fit of it, and where its amplitudes begin there.

    Returns
    -------
    float
        On the scale of twice the log likelihood (`Expected.cost`); 0 where nothing is expected,
        or nothing excites it.
    """
    expected, norm = term.candidate.expected, float(term.norms[0])
    if expected is None or norm <= 0.0:
        return 0.0
    variance = float(fit.covariance[place, place]) / norm**2
    return expected.cost(float(fit.amplitudes[place]) / norm, variance)


def left_out(
    states: Mapping[int, State], terms: Sequence[Term], fit: Fit, errors: Sequence[Nuisance]
) -> FloatArray:
    """Say what errors that no likelihood counts add to the amplitudes' covariance.

    Parameters
    ----------
    errors
        Columns of errors with a standard deviation of one each, shared by channels.

    Returns
    -------
    ndarray, shape (k, k)
        G E E'G with the amplitudes' covariance G; E is what generalised least squares takes of
        each error: X'V⁻¹Z, summed over the channels.
    """
    width = len(fit.amplitudes)
    count = max(
        (0 if error.shared is None else error.shared.shape[0] for error in errors), default=0
    )
    taken = np.zeros((width, count))
    for c, state in states.items():
        mine, index = _acting(terms, c)
        of_channel = [error for error in errors if error.channel == c]
        if not mine or not of_channel:
            continue
        channel = state.fixed.channel
        x = np.hstack([t.columns[c] for t in mine])
        z = unit_prior_columns(of_channel, c, channel.rows, channel.scale)
        cross = Model(state, fit.level[c]).product(x, z) / fit.scatter[c]
        taken[index] += np.asarray(cross @ shared_errors(of_channel, c, count).T)
    moved = fit.covariance @ taken
    return np.asarray(moved @ moved.T)


def _null(state: State) -> tuple[float, int, float]:
    level = int(state.null.argmax())
    return float(state.null[level]), level, float(state.scatter(state.rss[level]))


def share_of(state: State, terms: Sequence[Term]) -> Share:
    """Gather what one channel says about the amplitudes of terms.

    Parameters
    ----------
    terms
        All terms, also those that do not act on it.
    """
    fixed, number = state.fixed, state.fixed.channel.number
    mine, index = _acting(terms, number)
    levels = len(state.rss)
    if not mine:
        return Share(state, index, np.zeros((levels, 0, 0)), np.zeros((levels, 0)))
    columns = np.hstack([t.columns[number] for t in mine])
    parts = [t.moments(fixed) for t in mine]
    used = columns if state.blocks.all() else columns[state.blocks[fixed.channel.block]]
    square = used.T @ used
    nuisance = np.hstack([m.nuisance[state.cells].sum(axis=0).T for m in parts])
    values = np.concatenate([m.values[state.cells].sum(axis=0) for m in parts])
    reduced = np.concatenate([m.reduced[state.blocks] for m in parts], axis=2)
    shadow = state.levels.shadow(nuisance, reduced).transpose(0, 2, 1)
    gram = square - shadow @ shadow.transpose(0, 2, 1)
    slope = values - (shadow @ state.shadow)[..., 0]
    return Share(state, index, gram, slope)


def _acting(terms: Sequence[Term], channel: int) -> tuple[list[Term], IntArray]:
    """Give the terms that act on a channel, and which of all amplitudes are theirs."""
    parts = [
        (term, np.arange(part.start, part.stop))
        for term, part in zip(terms, places(terms), strict=True)
        if channel in term.columns
    ]
    nothing = np.zeros(0, dtype=np.intp)
    return [term for term, _ in parts], np.concatenate([nothing, *(at for _, at in parts)])


def inverse(gram: FloatArray) -> FloatArray:
    """Invert information matrices on what they inform about.

    Parameters
    ----------
    gram : ndarray, shape (..., k, k)

    Returns
    -------
    ndarray, shape (..., k, k)

    Examples
    --------
    >>> inverse(np.array([[4.0, 0.0], [0.0, 0.0]])).tolist()
    [[0.25, 0.0], [0.0, 0.0]]
    """
    if not gram.size:
        return gram
    values, vectors = np.linalg.eigh(gram)
    # Directions without information get variance 0, not infinity: their amplitudes stay at 0.
    keep = values > RANK * np.maximum(values.max(axis=-1, keepdims=True), 1e-30)
    scale = np.where(keep, 1.0 / np.where(keep, values, 1.0), 0.0)
    inverses: FloatArray = (vectors * scale[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return inverses


@dataclass(frozen=True, eq=False)
class _Shares:
    """Shares of c channels side by side, over all k amplitudes.

    What all of them say in each round is then one product: of small channels most of the work
    would else be calls. Where a channel has fewer levels than others, the rest are never best.

    Parameters
    ----------
    gram, slope : ndarray, shape (c, L, k, k) and (c, L, k)
        As `Share` has them; 0 for amplitudes of which a channel shows nothing.
    rss, handicap : ndarray, shape (c, L)
        Squares without any term, and levels' handicaps (`State.handicap`).
    weight, freedom, constant : ndarray, shape (c, 1)
        As `State` has them; the constant is the largest of its levels'.
    """

    channels: Sequence[int]
    gram: FloatArray
    slope: FloatArray
    rss: FloatArray
    handicap: FloatArray
    weight: FloatArray
    freedom: FloatArray
    constant: FloatArray

    @classmethod
    def of(cls, shares: Mapping[int, Share], width: int) -> _Shares:
        """Set shares side by side."""
        states = [share.state for share in shares.values()]
        count, levels = len(shares), max((len(s.rss) for s in states), default=1)
        gram, slope = np.zeros((count, levels, width, width)), np.zeros((count, levels, width))
        rss, handicap = np.zeros((count, levels)), np.full((count, levels), np.inf)
        for i, share in enumerate(shares.values()):
            own, at = slice(len(share.state.rss)), share.index
            # Picked out by arrays on either side of the levels, amplitudes come before these.
            gram[i, own, at[:, None], at] = share.gram.transpose(1, 2, 0)
            slope[i, own, at] = share.slope.T
            rss[i, own], handicap[i, own] = share.state.rss, share.state.handicap
        of_channels = [[s.fixed.channel.weight, s.freedom, s.levels.constant.max()] for s in states]
        weight, freedom, constant = np.array(of_channels).reshape(-1, 3, 1).transpose(1, 0, 2)
        return cls(list(shares), gram, slope, rss, handicap, weight, freedom, constant)

    def rest(self, start: Mapping[int, tuple[int, float]]) -> Fit:
        """Alternate between amplitudes and each channel's variances until the likelihood rests.

        Parameters
        ----------
        start
            Channel to level and scatter.
        """
        each = np.arange(len(self.channels))
        level = np.array([start[c][0] for c in self.channels], dtype=np.intp)
        scatter = np.array([start[c][1] for c in self.channels])
        before = -np.inf
        for _ in range(ROUNDS):
            information = np.sum(self.gram[each, level] / scatter[:, None, None], axis=0)
            covariance = inverse(information)
            amplitudes = covariance @ np.sum(self.slope[each, level] / scatter[:, None], axis=0)
            # Of amplitudes that all channels share: none of them has its own best ones.
            squares = self.rss - 2.0 * self.slope @ amplitudes
            squares += (self.gram @ amplitudes) @ amplitudes
            every = np.maximum(squares + self.weight, LEAST_SQUARES) / self.freedom
            scaled = every * self.handicap
            level = scaled.argmin(axis=1)
            scatter, best = every[each, level], scaled[each, level]
            total = float(np.sum(self.constant[:, 0] - 0.5 * self.freedom[:, 0] * np.log(best)))
            if total - before < REST:
                break
            before = total
        return Fit(
            total,
            amplitudes,
            covariance,
            dict(zip(self.channels, level.tolist(), strict=True)),
            dict(zip(self.channels, scatter.tolist(), strict=True)),
        )

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
from app.search.problem import Term
from app.search.rows import Nuisance
from app.search.state import State

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
        Their covariance.
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

    def best(self, amplitudes: FloatArray) -> tuple[float, int, float]:
        """Profile visit variances and repeatability at given amplitudes."""
        a = amplitudes[self.index]
        rss = self.state.rss - 2.0 * self.slope @ a + (self.gram @ a) @ a
        found, level = self.state.profile(rss)
        return float(found), int(level), float(self.state.scatter(rss[level]))

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
    fits = [_rest(shares, width, s) for s in starts]
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
    count = max((0 if one.shared is None else one.shared.shape[0] for one in errors), default=0)
    taken = np.zeros((width, count))
    offsets = np.cumsum([0, *(t.size for t in terms)])
    for c, state in states.items():
        mine = [(o, t) for o, t in zip(offsets, terms, strict=False) if c in t.columns]
        own = [one for one in errors if one.channel == c]
        if not mine or not own:
            continue
        channel, use = state.fixed.channel, state.blocks[state.fixed.channel.block]
        n = 1 + max(int(channel.rows.max()), *(int(one.rows.max(initial=0)) for one in own))
        x = np.hstack([t.columns[c] for _, t in mine])
        z = unit_prior_columns(own, c, channel.rows, n, channel.scale)
        level, nuisance = state.level(fit.level[c]), channel.nuisance[use]
        of_x, of_z = (
            level.shadow(nuisance.T @ a[use], channel.reduce(a)[state.blocks])[0] for a in (x, z)
        )
        cross = (x[use].T @ z[use] - of_x.T @ of_z) / fit.scatter[c]
        index = np.concatenate([np.arange(o, o + t.size) for o, t in mine])
        taken[index] += cross @ shared_errors(own, c, count).T
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
    offsets = np.cumsum([0, *(t.size for t in terms)])
    mine = [(o, t) for o, t in zip(offsets, terms, strict=False) if number in t.columns]
    levels = len(state.rss)
    if not mine:
        return Share(state, np.zeros(0, np.intp), np.zeros((levels, 0, 0)), np.zeros((levels, 0)))
    index = np.concatenate([np.arange(o, o + t.size) for o, t in mine])
    columns = np.hstack([t.columns[number] for _, t in mine])
    parts = [t.moments(fixed) for _, t in mine]
    own = columns if state.blocks.all() else columns[state.blocks[fixed.channel.block]]
    square = own.T @ own
    nuisance = np.hstack([m.nuisance[state.cells].sum(axis=0).T for m in parts])
    values = np.concatenate([m.values[state.cells].sum(axis=0) for m in parts])
    reduced = np.concatenate([m.reduced[state.blocks] for m in parts], axis=2)
    gram = np.empty((levels, len(values), len(values)))
    slope = np.empty((levels, len(values)))
    for some, of_values in zip(state.levels, state.shadows, strict=True):
        shadow = some.shadow(nuisance, reduced).transpose(0, 2, 1)
        gram[some.which] = square - shadow @ shadow.transpose(0, 2, 1)
        slope[some.which] = values - (shadow @ of_values)[..., 0]
    return Share(state, index, gram, slope)


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
    found: FloatArray = (vectors * scale[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return found


def _rest(shares: Mapping[int, Share], width: int, start: Mapping[int, tuple[int, float]]) -> Fit:
    """Alternate until the likelihood rests."""
    setting, before = dict(start), -np.inf
    for _ in range(ROUNDS):
        information, slope = np.zeros((width, width)), np.zeros(width)
        for c, share in shares.items():
            level, scatter = setting[c]
            information[np.ix_(share.index, share.index)] += share.gram[level] / scatter
            slope[share.index] += share.slope[level] / scatter
        covariance = inverse(information) if width else information
        amplitudes = covariance @ slope
        found = {c: s.best(amplitudes) for c, s in shares.items()}
        total = sum(f[0] for f in found.values())
        setting = {c: f[1:] for c, f in found.items()}
        if total - before < REST:
            break
        before = total
    return Fit(
        total,
        amplitudes,
        covariance,
        {c: s[0] for c, s in setting.items()},
        {c: s[1] for c, s in setting.items()},
    )

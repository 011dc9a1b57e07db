"""How much each entry would raise the likelihood: for measured values and for draws of noise.

Visit variances and repeatabilities are profiled anew for every entry and every draw. Held at
the null model's best they would contain the effect itself, and hide it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.base_grams import BaseGrams
from app.search.draws import DrawnMoments, Draws
from app.search.library import Batch, Library
from app.search.moments import blocks
from app.search.small_inverse import inverse_roots, solutions
from app.search.state import State

ROUNDS: Final = 3
"""Alternations between a fingerprint's amplitudes and the channels' variances."""

ROUNDS_OF_NOISE: Final = 1
"""Noise hardly moves the variances: more rounds change a threshold by less than 0.1 %."""


PORTION: Final = 60_000
"""Numbers that are worked on at once: they stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Scan:
    """What a scan found.

    Parameters
    ----------
    ratio : ndarray, shape (entries,)
        Twice the rise of the log likelihood (LR).
    noise : ndarray, shape (entries, B)
        The same for draws of the null model.
    rank : ndarray, shape (entries,)
        Amplitudes that can be told from visits, maps and given terms; 0: not testable.
    """

    ratio: FloatArray
    noise: FloatArray
    rank: FloatArray

    def only(self, allowed: BoolArray) -> Scan:
        """Take some entries for not testable: all but those, shape (entries,)."""
        return Scan(self.ratio * allowed, self.noise * allowed[:, None], self.rank * allowed)


@dataclass(frozen=True, eq=False)
class Target:
    """One channel's values, or draws of them, ready to be multiplied with any entry.

    What is left of X'V⁻¹y beside visits, maps and given terms is
    X'y − (Z'X)'`on_visits` − (J'X)'`on_nuisance`: the weights say how much of y the visits
    and the nuisance have taken up. Of draws y is their repeatability alone: how much of them
    are the visits' shifts and the maps' errors is in the weights too.

    Parameters
    ----------
    levels : ndarray of int, shape (l,)
        Which sets of visit variances are tried.
    squares : ndarray, shape (l, m)
        Squares that are left of each of the m values.
    on_visits : ndarray, shape (b (1 + q), l m)
        Weights of the visits' sums.
    on_nuisance : ndarray, shape (p + given, l m)
        Weights of the products with nuisance and given terms.
    of_given : tuple of ndarrays, shapes (l, given, b (1 + q)) and (l, given, p + given)
        Weights of both in the part of columns that given terms take up.
    draws
        What the draws are made of; None for measured values.
    """

    state: State
    levels: IntArray
    squares: FloatArray
    on_visits: FloatArray
    on_nuisance: FloatArray
    of_given: tuple[FloatArray, FloatArray]
    draws: DrawnMoments | None

    @cached_property
    def null(self) -> tuple[FloatArray, IntArray]:
        """Log likelihood without any entry, and which of the levels has it; each shape (m,)."""
        return self.profile(self.squares)

    def profile(self, squares: FloatArray) -> tuple[FloatArray, IntArray]:
        """Profile visit variances and repeatability; squares of shape (l, ..., m)."""
        return self.state.profile(squares, self.levels)

    def largest(self, squares: FloatArray) -> FloatArray:
        """Profile them likewise, without asking which level it is."""
        return self.state.largest(squares, self.levels)


def scan(
    library: Library,
    states: Mapping[int, State],
    base: BaseGrams,
    draws: Draws | None = None,
    generic: bool = False,
    before: tuple[Mapping[int, State], Scan] | None = None,
) -> Scan:
    """Scan all entries, either those with a physical meaning or the generic ones.

    Parameters
    ----------
    base
        Base grams of the same cells, kept from scan to scan.
    draws
        Draws of noise (only with all cells); None: the measured values alone.
    before
        States and findings of an earlier scan: entries whose channels have the same states
        are not computed again. Without draws only.
    """
    count = draws.count if draws else 0
    ratio, rank = np.zeros(len(library.entries)), np.zeros(len(library.entries))
    noise = np.zeros((len(library.entries), count))
    # Made when a batch first asks for a channel: many scans need but few.
    values = cache(lambda channel: _target(states[channel]))
    drawn = cache(lambda channel: _drawn_target(states[channel], draws)) if draws else None
    for number, batch in enumerate(library.batches):
        if before is not None and all(states.get(c) is before[0].get(c) for c in batch.channels):
            ratio[batch.entries] = before[1].ratio[batch.entries]
            rank[batch.entries] = before[1].rank[batch.entries]
        elif batch.generic == generic and all(c in states for c in batch.channels):
            products = [_products(library, base, number, values(c)) for c in batch.channels]
            best_ratios, ranks = _ratios(products)
            ratio[batch.entries], rank[batch.entries] = best_ratios[:, 0], ranks
            if drawn is not None:
                products = [_products(library, base, number, drawn(c)) for c in batch.channels]
                noise[batch.entries] = _ratios(products, ROUNDS_OF_NOISE)[0]
    return Scan(np.maximum(ratio, 0.0), np.maximum(noise, 0.0), rank)


def _target(state: State) -> Target:
    return _weighed(state, np.arange(len(state.rss)), state.shadow, state.rss[:, None], None)


def _drawn_target(state: State, draws: Draws) -> Target:
    """Draws come from believable visit variances, and are judged by those alone."""
    response, which = draws.response(state), np.flatnonzero(state.believable)
    shadow = state.levels.take(which).shadow(response.with_nuisance, response.reduced)
    squares = response.square - np.sum(shadow**2, axis=1)
    return _weighed(state, which, shadow, squares, response)


def _weighed(
    state: State,
    which: IntArray,
    shadow: FloatArray,
    squares: FloatArray,
    draws: DrawnMoments | None,
) -> Target:
    """Put the weights of some levels side by side."""
    levels = state.levels.take(which)
    visits, nuisance = levels.weights(shadow)
    count = 0 if state.given is None else state.given.columns.shape[1]
    if draws is not None:
        # Products with the shifts and map errors that draws contain have the same two factors.
        visits -= (draws.shift * draws.size).reshape(visits.shape[1:])
        nuisance[:, : len(draws.maps)] -= draws.maps * draws.size
    on_visits, on_nuisance = np.hstack(list(visits)), np.hstack(list(nuisance))
    of_given = levels.rows_of_last(count)
    return Target(state, which, squares, on_visits, on_nuisance, of_given, draws)


@dataclass(frozen=True, eq=False)
class _Products:
    """A batch in one channel: what is left of its information and its slopes at each level."""

    gram: FloatArray
    slope: FloatArray
    floor: FloatArray
    target: Target


def _products(library: Library, base: BaseGrams, number: int, target: Target) -> _Products:
    """Give gram (l, g, k, k), slope (l, g, k, m) and floor (l, g) of one batch."""
    state, batch = target.state, library.batches[number]
    k, base_gram = batch.size, base.of(number, state.fixed.channel.number)
    reduced = base_gram.reduced.reshape(-1, base_gram.reduced.shape[2])
    with_nuisance = base_gram.with_nuisance
    gram, floor = base_gram.gram, base_gram.floor
    if len(target.levels) < len(gram):
        gram, floor = gram[target.levels], floor[target.levels]
    with_given, with_values = _given_products(library, batch, target)
    if with_given is not None:
        with_nuisance = np.hstack([with_nuisance, with_given])
        gram = gram - _taken(target, reduced, with_nuisance, k)
    # X'V⁻¹y = X'y − (Z'X)'w − (J'X)'v (`Target`), all levels and draws side by side: two large
    # products, after which what differs between levels is only how their columns are read.
    taken = reduced.T @ target.on_visits
    taken += with_nuisance @ target.on_nuisance
    count = len(target.levels)
    slope = taken.reshape(len(taken), count, -1)
    np.subtract(with_values[:, None, :], slope, out=slope)
    shaped = slope.transpose(1, 0, 2).reshape(count, -1, k, slope.shape[2])
    return _Products(gram, shaped, floor, target)


def _given_products(
    library: Library, batch: Batch, target: Target
) -> tuple[FloatArray | None, FloatArray]:
    """Give products with given terms (g k, given), None without, and with the values (g k, m)."""
    state, use = target.state, target.state.cells
    sheet = batch.sheets[state.fixed.channel.number]
    values = sheet.within(sheet.moments.values, use)[:, None]
    with_given = None
    if state.given is not None:
        channel = state.fixed.channel
        right = np.column_stack([state.given.columns, state.given.offset])
        right = right * use[channel.cells][channel.block][:, None]
        products = library.columns(batch, channel.number).T @ right
        with_given, values = products[:, :-1], values - products[:, -1:]
    if target.draws is None:
        return with_given, values
    return with_given, sheet.noise * target.draws.size


def _taken(target: Target, reduced: FloatArray, with_nuisance: FloatArray, k: int) -> FloatArray:
    """Give what given terms take of the information, shape (l, g, k, k)."""
    visits, nuisance = target.of_given
    return blocks(visits @ reduced + nuisance @ with_nuisance.T, k)


def _ratios(products: list[_Products], rounds: int = ROUNDS) -> tuple[FloatArray, FloatArray]:
    return _alone(products[0]) if len(products) == 1 else _together(products, rounds)


def _alone(products: _Products) -> tuple[FloatArray, FloatArray]:
    """Profile the visit variances of entries that act on one channel, exactly."""
    target, (levels, g, k, m) = products.target, products.slope.shape
    root, ranks = inverse_roots(products.gram.reshape(-1, k, k), products.floor.ravel())
    back = root.transpose(0, 2, 1).reshape(levels, g, k, k)
    best = np.empty((g, m))
    # The best amplitudes G⁻¹s leave y'V⁻¹y − s'G⁻¹s of the squares: with G⁻¹ = W W' that is |W's|².
    for part in _portions(g, levels * k * m):
        taken = back[:, part] @ products.slope[:, part]
        squares = target.squares[:, None] - np.einsum("lgkm,lgkm->lgm", taken, taken)
        # Each hypothesis has its own best visit variances: both maxima are over all levels.
        best[part] = target.largest(squares)
    return 2.0 * (best - target.null[0]), ranks.reshape(levels, g).max(axis=0)


def _together(products: list[_Products], rounds: int) -> tuple[FloatArray, FloatArray]:
    """Fit one set of amplitudes to several channels, alternating with their variances."""
    # Shared amplitudes couple the channels: no closed form over all combinations of their
    # levels, so amplitudes and variances alternate. The ratio can only be too small by that.
    nulls = [p.target.null for p in products]
    g = products[0].gram.shape[1]
    level = [at[None, :] for _, at in nulls]
    scatter = [
        p.target.state.scatter(np.take_along_axis(p.target.squares, at[:1], 0)) * np.ones((g, 1))
        for p, at in zip(products, level, strict=True)
    ]
    for _ in range(rounds - 1):
        amplitudes, _ = _amplitudes(products, level, scatter)
        chosen = [_best(p, amplitudes) for p in products]
        level, scatter = [f[0] for f in chosen], [f[1] for f in chosen]
    amplitudes, rank = _amplitudes(products, level, scatter)
    total = np.zeros(amplitudes[:, 0].shape)
    for p in products:
        for part, squares in _squares(p, amplitudes):
            total[part] += p.target.largest(squares)
    return 2.0 * (total - np.sum([n for n, _ in nulls], axis=0)), rank


def _amplitudes(
    products: list[_Products], level: list[IntArray], scatter: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Solve for every entry and draw; shape (g, k, m).

    The levels are of all entries, shape (1, m), or of each, shape (g, m).
    """
    _, g, k, m = products[0].slope.shape
    information, slope, floor = np.zeros((g, m, k, k)), np.zeros((g, m, k)), np.zeros((g, m))
    entry, draw = np.arange(g)[:, None], np.arange(m)
    for p, at, size in zip(products, level, scatter, strict=True):
        # Each entry and draw takes what its channel has at its own level.
        information += p.gram[at, entry] / size[..., None, None]
        slope += p.slope[at, entry, :, draw] / size[..., None]
        floor += p.floor[at, entry] / size
    solved, ranks = solutions(
        information.reshape(g * m, k, k), floor.ravel(), slope.reshape(g * m, k)
    )
    by_entry = solved.reshape(g, m, k).transpose(0, 2, 1)
    return np.ascontiguousarray(by_entry), ranks.reshape(g, m)[:, 0]


def _best(p: _Products, amplitudes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Give one channel's level at given amplitudes, and its scatter there; each of shape (g, m)."""
    g, _, m = amplitudes.shape
    level, least = np.empty((g, m), dtype=np.intp), np.empty((g, m))
    for part, squares in _squares(p, amplitudes):
        level[part] = p.target.profile(squares)[1]
        least[part] = np.take_along_axis(squares, level[part][None], 0)[0]
    return level, p.target.state.scatter(least)


def _squares(p: _Products, amplitudes: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    """Give the squares that are left in one channel, shape (l, g, m), a part of the g at a time."""
    levels, g, k, m = p.slope.shape
    for part in _portions(g, levels * k * m):
        # Of any amplitudes, not each level's best: y'V⁻¹y − 2 a's + a'G a = y'V⁻¹y + a'(G a − 2 s).
        a = amplitudes[part]
        pull = p.gram[:, part] @ a
        pull -= 2.0 * p.slope[:, part]
        squares = np.einsum("lgim,gim->lgm", pull, a)
        squares += p.target.squares[:, None]
        yield part, squares


def _portions(count: int, size: int) -> Iterator[slice]:
    """Part things of which each has so many numbers, so that what is made of a part is small."""
    step = max(1, PORTION // size)
    return (slice(first, first + step) for first in range(0, count, step))

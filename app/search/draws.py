"""Noise as the null model would make it: the same draws throughout a search.

B. Efron, R. Tibshirani, An Introduction to the Bootstrap (1993): draws from a fitted model.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.arrays import FloatArray, IntArray
from app.search.alike import Alike
from app.search.channel import Channel
from app.search.moments import Fixed, Moments, moments_of
from app.search.state import State

SEED_MODULUS: Final = 2**32
"""Seeds are not negative; numbers of channels may be."""


@dataclass(frozen=True, eq=False)
class DrawnMoments:
    """Draws of the values in one channel, whose likelihood is asked for.

    Parameters
    ----------
    with_nuisance : ndarray, shape (p, m)
        Nuisance and given columns times the values.
    reduced : ndarray, shape (b, 1 + q, m)
        Shapes times the values, each visit.
    square : ndarray, shape (m,)
        Sums of squares.
    shift : ndarray, shape (b, 1 + q, m)
        The visits' drawn shifts and tilts.
    maps : ndarray, shape (p, m)
        The drawn errors of the maps, in their standard deviations.
    size : ndarray, shape (m,)
        The drawn repeatability, in scales.
    level : ndarray of int, shape (m,)
        From which set of visit variances each draw comes.
    """

    with_nuisance: FloatArray
    reduced: FloatArray
    square: FloatArray
    shift: FloatArray
    maps: FloatArray
    size: FloatArray
    level: IntArray


@dataclass(eq=False)
class Draws:
    """Unit draws of everything that scatters, from one seed."""

    seed: int
    count: int
    alike: Alike | None = None
    """How set-ups resemble each other; None: each is made anew."""
    _moments: dict[int, tuple[Moments, FloatArray]] = field(default_factory=dict)
    _noise: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    _responses: dict[State, DrawnMoments] = field(default_factory=dict, init=False)

    def with_alike(self, alike: Alike) -> Draws:
        """Draw the same with set-ups that resemble each other."""
        return replace(self, alike=alike)

    def noise(self, fixed: Fixed) -> NDArray[np.float32]:
        """Draw the repeatability of each row of a channel, once; in short numbers.

        Returns
        -------
        ndarray, shape (n, B)
        """
        number = fixed.channel.number
        if number not in self._noise:
            random = np.random.default_rng([self.seed, 0, number % SEED_MODULUS])
            shape = (len(fixed.channel.rows), self.count)
            self._noise[number] = random.standard_normal(shape, dtype=np.float32)
        return self._noise[number]

    def products(self, fixed: Fixed, columns: FloatArray) -> NDArray[np.float32]:
        """Multiply columns with the drawn noise, in short numbers.

        Parameters
        ----------
        columns : ndarray, shape (n, m)

        Returns
        -------
        ndarray, shape (m, B)
        """
        # Laid out in one way: sums of short numbers differ by the order in which they are added.
        short = columns.astype(np.float32, order="C")
        products: NDArray[np.float32] = short.T @ self.noise(fixed)
        return products

    def response(self, state: State) -> DrawnMoments:
        """Give the draws of a channel; several scans ask for those of the same state."""
        if state not in self._responses:
            self._responses[state] = self._response(state)
        return self._responses[state]

    def response_at(self, state: State, level: IntArray) -> DrawnMoments:
        """Give draws of a channel from stated sets of visit variances, of its own scale.

        Parameters
        ----------
        level : ndarray of int, shape (B,)
            Numbers of the sets.
        """
        return self._made(state, level, np.ones(self.count), np.random.default_rng([self.seed, 4]))

    def _response(self, state: State) -> DrawnMoments:
        number = state.fixed.channel.number % SEED_MODULUS
        random = np.random.default_rng([self.seed, 1, number])
        level = self._levels(state, random)
        return self._made(state, level, np.sqrt(state.scatter(state.rss))[level], random)

    def _levels(self, state: State, random: np.random.Generator) -> IntArray:
        """Draw visit variances from their profile likelihood.

        With few visits they are known poorly, and a threshold from the best fit alone would be
        too low whenever that fit happens to be small. Where other channels say how a channel may
        wander, the second half of the draws wanders as they do: an effect that the null model
        has swallowed as wander would else hide itself.
        """
        channel = state.fixed.channel
        level = _drawn_levels(np.exp(state.null - state.null.max()), random.random(self.count))
        if channel.expected is not None:
            second = slice(self.count // 2, None)
            level[second] = _drawn_levels(channel.expected, random.random(self.count)[second])
        return level

    def _made(
        self, state: State, level: IntArray, size: FloatArray, random: np.random.Generator
    ) -> DrawnMoments:
        """Scale the unit draws to sets of visit variances and repeatabilities."""
        channel = state.fixed.channel
        shape = (len(channel.starts), channel.shapes.shape[1], self.count)
        shift = random.standard_normal(shape)
        if self.alike is not None and not channel.blocks.are_records:
            variances = [channel.blocks.of_setup(tried)[0] for tried in channel.tried]
            uniform = np.random.default_rng([self.seed, 3]).random(self.count)
            shift = self.alike.drawn(
                shift, channel.blocks.setups, np.array(variances)[level], random, uniform
            )
        for i in np.unique(level):
            of_level = level == i
            shift[..., of_level] = channel.blocks.draw(channel.tried[i], shift[..., of_level])
        maps = self._maps(channel, random.standard_normal((channel.nuisance.shape[1], self.count)))
        return self._combined(state, shift, maps, size, level)

    def _maps(self, channel: Channel, single: FloatArray) -> FloatArray:
        """Draw the maps' errors: where channels share a map, one and the same for all."""
        if not channel.shared.nnz:
            return single
        random = np.random.default_rng([self.seed, 2])
        of_entries = random.standard_normal((channel.shared.shape[0], self.count))
        drawn = np.asarray(channel.shared.T @ of_entries)
        is_shared = np.bincount(channel.shared.indices, minlength=channel.shared.shape[1]) > 0
        return np.where(is_shared[:, None], drawn, single)

    def _combined(
        self, state: State, shift: FloatArray, maps: FloatArray, size: FloatArray, level: IntArray
    ) -> DrawnMoments:
        fixed, channel = state.fixed, state.fixed.channel
        noise, square = self._noise_moments(fixed)
        gram, crossed = fixed.nuisance.nuisance.sum(axis=0), fixed.nuisance.reduced
        visits = channel.gram @ shift
        taken_up = np.einsum("bqp,bqm->pm", crossed, shift)
        with_nuisance = noise.nuisance.sum(axis=0).T + taken_up + gram @ maps
        reduced = noise.reduced + visits + crossed @ maps
        # y'y of y = e + Zb + Jm, put together from products of the three parts: the rows of Zb
        # and Jm, as many for every draw, are never formed.
        squares = (
            square
            + np.sum(shift * (2.0 * noise.reduced + visits), axis=(0, 1))
            + np.sum(
                maps * (2.0 * noise.nuisance.sum(axis=0).T + gram @ maps + 2.0 * taken_up), axis=0
            )
        )
        if state.given is not None:
            columns = state.given.columns
            moments = moments_of(channel, columns, fixed.cells)
            lower = columns.T @ self.noise(fixed) + moments.nuisance.sum(axis=0) @ maps
            lower += np.einsum("bqg,bqm->gm", moments.reduced, shift)
            with_nuisance = np.vstack([with_nuisance, lower])
        return DrawnMoments(
            with_nuisance * size, reduced * size, squares * size**2, shift, maps, size, level
        )

    def _noise_moments(self, fixed: Fixed) -> tuple[Moments, FloatArray]:
        number = fixed.channel.number
        if number not in self._moments:
            noise = self.noise(fixed).astype(np.float64)
            moments = moments_of(fixed.channel, noise, fixed.cells)
            self._moments[number] = (moments, np.sum(noise**2, axis=0))
        return self._moments[number]


def _drawn_levels(weights: FloatArray, uniform: FloatArray) -> IntArray:
    drawn = np.searchsorted(np.cumsum(weights) / weights.sum(), uniform)
    return np.asarray(drawn.clip(max=len(weights) - 1), dtype=np.intp)

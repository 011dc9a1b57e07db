"""One channel on some of the visits: what is left of any columns after maps and visits.

The model is linear and mixed: visits shift and tilt, map entries err, each with a normal
prior, and both are integrated out. The repeatability is profiled, under a scaled inverse
χ² prior that counts for `weight` observations around the channel's scale.

D. Harville, J. Am. Stat. Assoc. 72 (1977) 320: likelihood of variance components.
M. Lovell, J. Am. Stat. Assoc. 58 (1963) 993: regression on what other columns leave.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg.lapack import dtrtri

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.moments import Fixed, blocks, moments_of
from app.search.scatter import Whitening

LEAST_SQUARES: Final = 1e-12
"""Squares that count as left where nothing is."""

BELIEVABLE: Final = 12.0
"""Log likelihood below the best from which a set of variances is not believed,"""

LIKELY: Final = 0.01
"""unless other channels show it, and by such a share of what they show most."""

JITTER = 1e-10
"""Keeps two equal given columns from breaking the factorisation."""


@dataclass(frozen=True, eq=False)
class Given:
    """Terms that are in the model already, as columns beside the nuisance.

    Parameters
    ----------
    columns : ndarray, shape (n, g)
        Their columns in one channel.
    precision : ndarray, shape (g,)
        0: entirely free; else 1/variance of what is still open about their amplitudes.
    offset : ndarray, shape (n,)
        What they explain already.
    """

    columns: FloatArray
    precision: FloatArray
    offset: FloatArray


@dataclass(frozen=True, eq=False)
class Levels:
    """A channel under l sets of visit variances.

    For any two sets of columns A and B, what is left of A'V⁻¹B once nuisance and given
    terms are fitted is A'B − shadow(A)'shadow(B).

    Parameters
    ----------
    turned : ndarray, shape (l, b (1 + q), p)
        Nuisance and given columns, whitened over the blocks.
    root, inverse_root : ndarray, shape (l, p, p)
        Factor of what the rows and the prior say of nuisance and given columns.
    constant : ndarray, shape (l,)
        What the squares have no part in of the log likelihood.
    """

    whitening: Whitening
    turned: FloatArray
    root: FloatArray
    inverse_root: FloatArray
    constant: FloatArray
    shapes: int

    def take(self, wanted: IntArray) -> Levels:
        """Keep some of them, by their numbers, increasing."""
        if len(wanted) == len(self.root):
            return self
        return Levels(
            self.whitening.take(wanted),
            self.turned[wanted],
            self.root[wanted],
            self.inverse_root[wanted],
            self.constant[wanted],
            self.shapes,
        )

    def shadow(self, with_nuisance: FloatArray, reduced: FloatArray) -> FloatArray:
        """Give the part of columns that visits and nuisance can take up.

        Parameters
        ----------
        with_nuisance : ndarray, shape (p, m)
            Nuisance and given columns times the columns.
        reduced : ndarray, shape (b, 1 + q, m)
            Shapes times the columns, each visit.

        Returns
        -------
        ndarray, shape (l, b (1 + q) + p, m)
        """
        first = self.turned.shape[1]
        shadows = np.empty((len(self.root), first + len(with_nuisance), with_nuisance.shape[1]))
        turned = shadows[:, :first]
        self.whitening.turn(reduced, turned)
        residual = with_nuisance - self.turned.transpose(0, 2, 1) @ turned
        np.matmul(self.inverse_root, residual, out=shadows[:, first:])
        return shadows

    def taken(
        self, with_nuisance: FloatArray, reduced: FloatArray, k: int
    ) -> tuple[FloatArray, FloatArray]:
        """Give what visits, and what nuisance and given terms take up of entries' information.

        Parameters
        ----------
        with_nuisance, reduced
            Of the entries' columns, as for `shadow`.
        k
            How many columns each entry has.

        Returns
        -------
        visits, nuisance : ndarray, shape (l, g, k, k)
            Products of the shadow's two parts with themselves, entry by entry.
        """
        # With T = F Z'J and R R' = J'J + prior − T'T, by blockwise elimination of set-ups, then
        # nuisance: shadow(X) = [F Z'X; R⁻¹(J'X − T'F Z'X)]. Its second part is linear in J'X and
        # Z'X, so all levels are one product with what stands before these.
        levels, p, _ = self.inverse_root.shape
        columns = with_nuisance.shape[1]
        by_visits = self.whitening.turn(reduced)
        lower = self._to_nuisance @ np.vstack([with_nuisance, reduced.reshape(-1, columns)])
        return blocks(by_visits, k), blocks(lower.reshape(levels, p, columns), k)

    @cached_property
    def _to_nuisance(self) -> FloatArray:
        """What makes the shadow's second part of both products, shape (l p, p + b (1 + q)).

        One product with all levels at once takes a third less time than one for each.
        """
        back = self._turned_back(self.turned).transpose(0, 2, 1)
        both = np.concatenate([self.inverse_root, -(self.inverse_root @ back)], axis=2)
        return both.reshape(-1, both.shape[2])

    def weights(self, shadow: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Say how a shadow enters products with other columns' shadows.

        shadow(X)'shadow(y) = (Z'X)'`visits` + (J'X)'`nuisance`: the costly part, X's own
        shadow, need not be formed.

        Parameters
        ----------
        shadow : ndarray, shape (l, b (1 + q) + p, m)

        Returns
        -------
        visits : ndarray, shape (l, b (1 + q), m)
        nuisance : ndarray, shape (l, p, m)
        """
        first = self.turned.shape[1]
        nuisance = self.inverse_root.transpose(0, 2, 1) @ shadow[:, first:]
        return self._turned_back(shadow[:, :first] - self.turned @ nuisance), nuisance

    def rows_of_last(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Give the last rows of the shadow as weights of sums over visits and of products.

        Returns
        -------
        visits : ndarray, shape (l, count, b (1 + q))
        nuisance : ndarray, shape (l, count, p)
        """
        nuisance = self.inverse_root[:, self.inverse_root.shape[1] - count :]
        turned = self.turned @ nuisance.transpose(0, 2, 1)
        return -self._turned_back(turned).transpose(0, 2, 1), nuisance

    def _turned_back(self, turned: FloatArray) -> FloatArray:
        """Apply the transposed factors."""
        return self.whitening.turn_back(turned, self.shapes)


@dataclass(eq=False)
class State:
    """One channel on some cells of visits, with the terms that are given.

    Parameters
    ----------
    cells : ndarray, shape (cells,)
        Which cells take part.
    """

    fixed: Fixed
    cells: BoolArray
    given: Given | None = None
    blocks: BoolArray = field(init=False)
    count: int = field(init=False)
    levels: Levels = field(init=False)
    rss: FloatArray = field(init=False)
    shadow: FloatArray = field(init=False)
    """Of the values."""

    def __post_init__(self) -> None:
        channel = self.fixed.channel
        self.blocks = self.cells[channel.cells]
        sizes = np.diff(np.append(channel.starts, len(channel.rows)))
        self.count = int(sizes[self.blocks].sum())
        with_nuisance, reduced, square = self._products_of_values()
        self.levels = self._levels(*self._products_of_nuisance())
        self.shadow = self.levels.shadow(with_nuisance, reduced)
        # A difference: where nearly all is explained its digits are gone, and it may be below 0.
        # `scatter` has a floor for that.
        self.rss = square - np.sum(self.shadow**2, axis=(1, 2))

    @property
    def freedom(self) -> float:
        """Rows, and what the repeatability counts for by itself."""
        return self.count + self.fixed.channel.weight

    @cached_property
    def null(self) -> FloatArray:
        """Log likelihood at each set of visit variances, shape (L,)."""
        return self.log_likelihoods(self.rss)

    @cached_property
    def believable(self) -> BoolArray:
        """Which sets of visit variances are likely, by this channel or by others, shape (L,)."""
        by_itself: BoolArray = self.null > self.null.max() - BELIEVABLE
        expected = self.fixed.channel.expected
        return by_itself if expected is None else by_itself | (expected > expected.max() * LIKELY)

    def log_likelihoods(self, rss: FloatArray) -> FloatArray:
        """Profile the repeatability out of the likelihood, at each set of visit variances.

        Parameters
        ----------
        rss : ndarray, shape (L, ...)
            Squares that are left.

        Returns
        -------
        ndarray, shape (L, ...)
        """
        constants = self.levels.constant.reshape(-1, *(1,) * (rss.ndim - 1))
        profile: FloatArray = -0.5 * self.freedom * np.log(self.scatter(rss)) + constants
        return profile

    def profile(
        self, rss: FloatArray, levels: IntArray | None = None
    ) -> tuple[FloatArray, IntArray]:
        """Profile the visit variances out too.

        Parameters
        ----------
        rss : ndarray, shape (l, ...)
            Squares that are left at each set of visit variances that is tried.
        levels : ndarray of int, shape (l,), optional
            Which these are; all L without it.

        Returns
        -------
        log_likelihood : ndarray, shape (...)
            The largest.
        best : ndarray of int, shape (...)
            Which of the l has it, the first of equals.
        """
        scaled, constant = self._scaled(rss, levels)
        smallest = scaled.min(axis=0)
        log_likelihood: FloatArray = -0.5 * self.freedom * np.log(smallest) + constant
        return log_likelihood, _first_at(scaled, smallest)

    def largest(self, rss: FloatArray, levels: IntArray | None = None) -> FloatArray:
        """Give the largest log likelihood alone: `profile` without which level has it."""
        scaled, constant = self._scaled(rss, levels)
        highest: FloatArray = -0.5 * self.freedom * np.log(scaled.min(axis=0)) + constant
        return highest

    def _scaled(self, rss: FloatArray, levels: IntArray | None) -> tuple[FloatArray, float]:
        """Scale scatter so that the log likelihood is −f/2 ln of it at all levels, and a constant.

        −f/2 ln s + c is largest where s exp(−2 c/f) is smallest: one logarithm for all levels.
        """
        handicap = self.handicap if levels is None else self.handicap[levels]
        scaled = self.scatter(rss)
        scaled *= handicap.reshape(-1, *(1,) * (rss.ndim - 1))
        return scaled, float(self.levels.constant.max())

    @cached_property
    def handicap(self) -> FloatArray:
        """What each level's constant is behind the largest, as a factor of scatter, shape (L,)."""
        # Of a level that is far behind it is infinite: such a one is never the smallest.
        with np.errstate(over="ignore"):
            ratios: FloatArray = np.exp(
                2.0 * (self.levels.constant.max() - self.levels.constant) / self.freedom
            )
        return ratios

    def level(self, number: int) -> Levels:
        """Give one of the sets of visit variances alone."""
        return self.levels.take(np.array([number]))

    def scatter(self, rss: FloatArray) -> FloatArray:
        """Estimate the variance of one observation, over the square of the scale.

        Parameters
        ----------
        rss : ndarray, shape (...)
            Squares that are left.

        Returns
        -------
        ndarray, shape (...)
        """
        # The prior counts as so many further observations that have left 1 each, which is the
        # scale.
        variance: FloatArray = np.asarray(rss + self.fixed.channel.weight)
        np.maximum(variance, LEAST_SQUARES, out=variance)
        variance /= self.freedom
        return variance

    def _products_of_nuisance(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        fixed, use = self.fixed, self.cells
        nuisance = fixed.nuisance.nuisance[use].sum(axis=0)
        reduced = fixed.nuisance.reduced[self.blocks]
        precision = np.ones(len(nuisance))
        if self.given is None:
            return nuisance, reduced, precision
        columns = self.given.columns
        extra = moments_of(fixed.channel, columns, fixed.cells)
        corner = extra.nuisance[use].sum(axis=0)
        square = fixed.channel.by_cell(columns, columns, fixed.cells)[use].sum(axis=0)
        square = square + np.diag(np.diag(square) * JITTER + 1e-12)
        return (
            np.block([[nuisance, corner.T], [corner, square]]),
            np.concatenate([reduced, extra.reduced[self.blocks]], axis=2),
            np.append(precision, self.given.precision),
        )

    def _products_of_values(self) -> tuple[FloatArray, FloatArray, float]:
        fixed, use = self.fixed, self.cells
        channel = fixed.channel
        if self.given is None:
            with_nuisance = fixed.values.nuisance[use].sum(axis=0).T
            return with_nuisance, fixed.values.reduced[self.blocks], float(fixed.square[use].sum())
        residuals = (channel.values - self.given.offset)[:, None]
        both = np.column_stack([channel.nuisance, self.given.columns, residuals])
        products = channel.by_cell(both, residuals, fixed.cells)[use].sum(axis=0)
        return products[:-1], channel.reduce(residuals)[self.blocks], float(products[-1, 0])

    def _levels(self, nuisance: FloatArray, reduced: FloatArray, precision: FloatArray) -> Levels:
        channel = self.fixed.channel
        whitening = channel.whitening(np.arange(len(channel.tried)), self.blocks)
        turned = whitening.turn(reduced)
        # What the rows say of maps and given terms beside set-ups, and the prior: J'V⁻¹J + P. Its
        # Cholesky factor R serves for all: |R⁻¹ J'V⁻¹y|² is what they explain of y, the diagonal is
        # the determinant, and nothing is lost where two columns are almost alike, as it would be
        # with the inverse.
        remaining = nuisance - turned.transpose(0, 2, 1) @ turned + np.diag(precision)
        root = np.asarray(np.linalg.cholesky(remaining), dtype=np.float64)
        p = channel.nuisance.shape[1]
        # The factor of the nuisance alone, which comes first: given terms are fitted, not
        # integrated out. A restricted likelihood would take their determinant too, and could
        # not be compared between models that have different terms.
        diagonals = np.diagonal(root, axis1=1, axis2=2)[:, :p]
        half_log_det = 0.5 * whitening.log_determinant + np.log(diagonals).sum(axis=1)
        # The triangle alone is inverted: it is applied to thousands of columns, by products.
        inverse_root: FloatArray = np.zeros_like(root)
        for lower, inverse in zip(root, inverse_root, strict=True):
            if lower.size:
                inverse[:], _ = dtrtri(lower, lower=1)
        constant = np.asarray(channel.prior - half_log_det)
        shapes = channel.shapes.shape[1]
        return Levels(whitening, turned, root, inverse_root, constant, shapes)


def _first_at(values: FloatArray, smallest: FloatArray) -> IntArray:
    """Say where along the first axis the smallest stands, the first of equals."""
    if values.ndim == 1:
        return np.asarray(values.argmin(axis=0))
    # Of long rows numpy's argmin along the first axis takes ten times as long.
    place = np.zeros(smallest.shape, dtype=np.intp)
    for number in reversed(range(len(values))):
        np.copyto(place, number, where=values[number] == smallest)
    return place

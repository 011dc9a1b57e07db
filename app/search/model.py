"""One channel's rows at one set of variances: what else is to be known of them than a likelihood.

    y = J m + X b + Z u + e,    m ~ N(0, 1), u ~ N(0, K), e ~ N(0, 1), b free or N(0, 1/precision)

with maps J, given terms X and set-ups Z (`scatter`), in repeatabilities. In what follows V is the
covariance of y without b, and where terms are given A'V⁻¹B is what is left once they are fitted.

G. Robinson, Stat. Sci. 6 (1991) 15: best linear unbiased prediction.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from app.arrays import BoolArray, FloatArray
from app.search.channel import Channel
from app.search.state import Levels, State


@dataclass(frozen=True, eq=False)
class Model:
    """A channel on the rows that take part in a state, at one of its sets of variances.

    Parameters
    ----------
    number
        Which set of variances.
    """

    state: State
    number: int

    @cached_property
    def _level(self) -> Levels:
        return self.state.level(self.number)

    @property
    def _channel(self) -> Channel:
        return self.state.fixed.channel

    @cached_property
    def _fitted(self) -> FloatArray:
        """Columns of maps and of given terms, shape (n, p)."""
        maps, fitted_before = self._channel.nuisance, self.state.given
        return maps if fitted_before is None else np.hstack([maps, fitted_before.columns])

    def product(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Give A'V⁻¹B of columns A, shape (n, m), and B, shape (n, k); shape (m, k)."""
        use = self.state.blocks[self._channel.block]
        of_left, of_right = self._shadow(left), self._shadow(right)
        return np.asarray(left[use].T @ right[use] - of_left.T @ of_right)

    def entries(self, values: FloatArray) -> FloatArray:
        """Predict the maps' entries and the given amplitudes from values; shape (p,)."""
        size = self._fitted.shape[1]
        if not size:
            return np.zeros(0)
        # This is R⁻¹ J'V⁻¹y with R R' = J'V⁻¹J + P already, so that R' remains to be solved for.
        lower = self._shadow(values[:, None])[-size:, 0]
        return np.asarray(solve_triangular(self._level.root[0], lower, lower=True, trans=1))

    def setups(self, values: FloatArray) -> FloatArray:
        """Predict each block's shift and tilts from values beside maps and terms; shape (b, s)."""
        whitening, shapes = self._level.whitening, self._level.shapes
        # F'F = (K⁻¹ + Z'Z)⁻¹, and times Z'y that is the best linear prediction of shifts and tilts.
        turned = whitening.turn(self._channel.reduce(values[:, None])[self.state.blocks])
        return np.asarray(whitening.turn_back(turned, shapes)[0].reshape(-1, shapes))

    @property
    def open_still(self) -> FloatArray:
        """Variance of each row by what is not known of maps and given terms, shape (n,)."""
        if not self._fitted.shape[1]:
            return np.zeros(len(self._fitted))
        # The diagonal of A (R R')⁻¹ A', as the squares of R⁻¹A' summed: no product of all rows with
        # all.
        solved = solve_triangular(self._level.root[0], self._fitted.T, lower=True)
        return np.asarray(np.sum(solved**2, axis=0))

    def product_of_held_out(self, columns: FloatArray, held_out: BoolArray) -> FloatArray:
        """Give A'Ω⁻¹A over rows that take no part, whose covariance is Ω once these are known.

        Parameters
        ----------
        columns : ndarray, shape (n, m)
        held_out : ndarray, shape (cells,)
            In which cells those rows are.

        Returns
        -------
        ndarray, shape (m, m)
        """
        channel, m = self._channel, columns.shape[1]
        blocks = held_out[channel.cells]
        every = np.hstack([columns, self._fitted])
        turned = channel.whitening(np.array([self.number]), blocks).turn(
            channel.reduce(every)[blocks]
        )[0]
        held_blocks = every[blocks[channel.block]]
        inner = held_blocks.T @ held_blocks - turned.T @ turned
        if inner.shape[0] == m:
            return np.asarray(inner)
        # Woodbury: rows that teach and rows that are held out know of maps and terms together.
        root = self._level.root[0]
        taken = cho_solve(cho_factor(root @ root.T + inner[m:, m:]), inner[m:, :m])
        return np.asarray(inner[:m, :m] - inner[m:, :m].T @ taken)

    def _shadow(self, columns: FloatArray) -> FloatArray:
        state, channel = self.state, self._channel
        with_fitted = channel.by_cell(self._fitted, columns, state.fixed.cells)[state.cells]
        reduced = channel.reduce(columns)[state.blocks]
        shadow: FloatArray = self._level.shadow(with_fitted.sum(axis=0), reduced)[0]
        return shadow

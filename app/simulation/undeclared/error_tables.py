"""Tables of errors over position and temperature, linear between their nodes.

One table is one component: a row for each temperature of the sensor that it follows, a column
for each position. A machine's true errors and the error maps are such tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.simulation.undeclared.components import FloatArray, IntArray


@dataclass(frozen=True)
class ErrorTable:
    """One component's errors at M temperatures and P positions.

    Parameters
    ----------
    temperatures_c : ndarray, shape (M,) [°C]
        Increasing.
    positions_mm : ndarray, shape (P,) [mm]
        Increasing; one position where the error does not depend on it.
    errors : ndarray, shape (M, P)
        In the component's unit.
    """

    temperatures_c: FloatArray
    positions_mm: FloatArray
    errors: FloatArray

    def at(
        self, position_mm: FloatArray, temperature_c: FloatArray, *, clamp: bool = False
    ) -> FloatArray:
        """Interpolate at n positions and temperatures.

        Parameters
        ----------
        position_mm : ndarray, shape (n,) [mm]
            Outside the table its end values hold.
        temperature_c : ndarray, shape (n,) [°C]
            Of the sensor that the table follows.
        clamp
            Whether the first or last row holds outside the table's temperatures; else its
            outer lines go on.

        Returns
        -------
        ndarray, shape (n,)
        """
        entries, weights = self.weights(position_mm, temperature_c, clamp=clamp)
        values: FloatArray = (self.errors.ravel()[entries] * weights).sum(axis=1)
        return values

    def weights(
        self, position_mm: FloatArray, temperature_c: FloatArray, *, clamp: bool
    ) -> tuple[IntArray, FloatArray]:
        """Say which entries make up an interpolated value, and by how much.

        Returns
        -------
        entries : ndarray of int, shape (n, 4)
            Places in the table read row by row.
        weights : ndarray, shape (n, 4)
        """
        lower, upper, share = _between(self.temperatures_c, temperature_c)
        if clamp:
            share = np.clip(share, 0.0, 1.0)
        columns = self.positions_mm.size
        inside = np.clip(position_mm, self.positions_mm[0], self.positions_mm[-1])
        left, right, along = _between(self.positions_mm, inside)
        entries = np.stack(
            [row * columns + column for row in (lower, upper) for column in (left, right)], axis=1
        )
        weights = np.stack(
            [w * v for w in (1.0 - share, share) for v in (1.0 - along, along)], axis=1
        )
        return entries, weights

    def with_temperatures(self, temperatures_c: FloatArray) -> ErrorTable:
        """Let the table follow another sensor, by that sensor's temperatures of the same rows."""
        return replace(self, temperatures_c=temperatures_c)

    def with_errors(self, errors: FloatArray) -> ErrorTable:
        """Exchange the values."""
        return replace(self, errors=errors)


def _between(nodes: FloatArray, values: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Find the nodes around values and the upper one's share, beyond the ends below 0, above 1."""
    if nodes.size == 1:
        zeros = np.zeros(np.shape(values), dtype=np.int64)
        return zeros, zeros, np.zeros(np.shape(values))
    lower = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, nodes.size - 2)
    share = (values - nodes[lower]) / (nodes[lower + 1] - nodes[lower])
    return lower, lower + 1, share

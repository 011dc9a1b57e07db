"""One error component as a function of position: what a controller's table holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import FloatArray, frozen
from app.geometry.components import Component

FORWARD: Final = "+"
BACKWARD: Final = "-"


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Errors of one component over positions; linear between, the end values beyond.

    Parameters
    ----------
    positions_mm : ndarray, shape (k,) [mm]
        Strictly increasing; empty for a single value such as squareness.
    errors : ndarray, shape (k,), or (1,) for a single value [the component's unit]
        Actual minus nominal.
    backward_errors : ndarray, same shape, or None
        When approached in the negative direction; None where it makes no difference.
    endless
        Whether the curve is one straight line that goes on beyond its ends.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None = None
    endless: bool = False

    @property
    def code(self) -> str:
        """The component's ISO 230-1 code."""
        return self.component.code

    @property
    def sides(self) -> list[tuple[str, FloatArray]]:
        """Direction of approach and errors: one side, or two that differ."""
        if self.backward_errors is None:
            return [(FORWARD, self.errors)]
        return [(FORWARD, self.errors), (BACKWARD, self.backward_errors)]

    def at(self, positions_mm: FloatArray, direction: str = FORWARD) -> FloatArray:
        """Give the errors at positions.

        Parameters
        ----------
        positions_mm : ndarray, shape (n,) [mm]
        direction
            `+` or `-`.

        Returns
        -------
        ndarray, shape (n,) [the component's unit]
        """
        values = self.errors
        if direction == BACKWARD and self.backward_errors is not None:
            values = self.backward_errors
        nodes = self.positions_mm
        if nodes.size < 2:
            return np.full(positions_mm.shape, values[0])
        if self.endless:
            slope = (values[-1] - values[0]) / (nodes[-1] - nodes[0])
            line: FloatArray = values[0] + slope * (positions_mm - nodes[0])
            return line
        return np.interp(positions_mm, nodes, values)

    def sampled(self, positions_mm: FloatArray) -> Curve:
        """Take the errors at other positions, shape (n,) [mm]: what lies between is lost."""
        backward = None if self.backward_errors is None else self.at(positions_mm, BACKWARD)
        return Curve(self.component, frozen(positions_mm), self.at(positions_mm), backward)

    def rounded(self, unit: float) -> Curve:
        """Round the errors to whole multiples of a unit [the component's unit]."""
        backward = self.backward_errors
        return replace(
            self,
            errors=np.round(self.errors / unit) * unit,
            backward_errors=None if backward is None else np.round(backward / unit) * unit,
        )

    def shifted(self, by: float) -> Curve:
        """Add a constant [the component's unit] in both directions."""
        backward = self.backward_errors
        return replace(
            self,
            errors=self.errors + by,
            backward_errors=None if backward is None else backward + by,
        )

    def mean(self) -> Curve:
        """Take the mean of both directions."""
        if self.backward_errors is None:
            return self
        return replace(
            self, errors=(self.errors + self.backward_errors) / 2.0, backward_errors=None
        )

    def half_reversal(self) -> Curve:
        """Give what each direction has beside the mean of both: forward this, backward minus it."""
        backward = self.errors if self.backward_errors is None else self.backward_errors
        return Curve(self.component, self.positions_mm, frozen((self.errors - backward) / 2.0))

    @property
    def largest_reversal(self) -> float:
        """The largest difference between the two directions [the component's unit]."""
        if self.backward_errors is None:
            return 0.0
        return float(np.abs(self.backward_errors - self.errors).max())


@dataclass(frozen=True, slots=True)
class Difference:
    """How far one curve is from another: largest and root mean square, and where."""

    largest: float
    rms: float
    position_mm: float | None
    direction: str


def difference(loaded: Curve, wanted: Curve) -> Difference:
    """Compare two curves over the positions of the second, at the nodes of both.

    Returns
    -------
    Difference
        Held minus wanted, in the component's unit. Both are linear between nodes, so that
        no position between them is further off.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> exx = COMPONENTS["EXX"]
    >>> at = np.array([0.0, 50.0, 100.0])
    >>> wanted = Curve(exx, at, np.array([0.0, 3.0, 4.0]))
    >>> found = difference(wanted.sampled(at[::2]), wanted)
    >>> found.largest, round(found.rms, 6), found.position_mm
    (-1.0, 0.57735, 50.0)
    """
    nodes = wanted.positions_mm
    where = np.zeros(1)
    if nodes.size:
        both = np.union1d(nodes, loaded.positions_mm)
        where = both[(both >= nodes[0]) & (both <= nodes[-1])]
    directions = [FORWARD]
    if loaded.backward_errors is not None or wanted.backward_errors is not None:
        directions.append(BACKWARD)
    off = np.stack([loaded.at(where, d) - wanted.at(where, d) for d in directions])
    side, place = np.unravel_index(np.abs(off).argmax(), off.shape)
    return Difference(
        float(off[side, place]),
        _rms(where, off),
        float(where[place]) if nodes.size else None,
        directions[side],
    )


def _rms(where_mm: FloatArray, off: FloatArray) -> float:
    """Give the root mean square along the axis of lines between nodes, exactly."""
    if where_mm.size < 2:
        return float(np.sqrt((off**2).mean()))
    # The mean square of a straight line from a to b is (a² + a b + b²)/3.
    a, b = off[:, :-1], off[:, 1:]
    squares = (a**2 + a * b + b**2) / 3.0 * np.diff(where_mm)
    return float(np.sqrt(max(squares.sum() / (off.shape[0] * (where_mm[-1] - where_mm[0])), 0.0)))

"""What may be lacking: one candidate, its columns, and the one parameter that is not linear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent


class Part(NamedTuple):
    """What a candidate does to some rows of one channel.

    Parameters
    ----------
    channel
        The channel.
    rows : ndarray, shape (m,)
        Which rows; zero elsewhere.
    columns : ndarray, shape (m, k)
        The channel's change for each unit of each of the candidate's k amplitudes.
    """

    channel: int
    rows: IntArray
    columns: FloatArray


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect that the residuals may hold.

    Parameters
    ----------
    key
        Names it among all candidates.
    family
        What it competes within: the prior is spread evenly inside a family.
    columns
        Gives its parts for a value of the nonlinear parameter. Several channels make a
        fingerprint: the same amplitudes act on all of them.
    grid
        Values of the nonlinear parameter that are scanned, increasing; empty: none.
    bounds
        Where the parameter may be refined to; without bounds it stays on the grid.
    log_scale
        Whether the refinement steps in the parameter's logarithm.
    trending
        Whether it must also hold forward in time: a drift, a step.
    within_visit
        Whether a single visit excites it, so that few visits suffice.
    only_once
        Whether one place has it once at most: a second one imitates something unknown.
    generic
        Whether it is a smooth shape without a physical meaning: it is never found, but
        says that something is left.
    """

    key: str
    family: str
    columns: Callable[[float | None], Sequence[Part]]
    grid: tuple[float, ...] = ()
    bounds: tuple[float, float] | None = None
    log_scale: bool = True
    trending: bool = False
    within_visit: bool = False
    only_once: bool = False
    generic: bool = False

    def __post_init__(self) -> None:
        if any(b <= a for a, b in zip(self.grid, self.grid[1:], strict=False)):
            raise InvalidContent.of_field(f"{self.key}.grid", "expected increasing values")
        if self.bounds and self.log_scale and self.bounds[0] <= 0:
            raise InvalidContent.of_field(
                f"{self.key}.bounds", "expected values above 0 on a logarithmic scale"
            )

    @property
    def thetas(self) -> tuple[float | None, ...]:
        """The values that are scanned; a lone None without a nonlinear parameter."""
        return self.grid or (None,)

    @property
    def nonlinear(self) -> int:
        """How many nonlinear parameters it has."""
        return int(bool(self.grid))

    def around(self, theta: float) -> tuple[float, float]:
        """Give the stretch between the grid's neighbours of a value, within the bounds.

        >>> Candidate("k", "f", lambda _: [], (1.0, 2.0, 4.0), (0.5, 8.0)).around(2.0)
        (1.0, 4.0)
        >>> Candidate("k", "f", lambda _: [], (1.0, 2.0, 4.0), (0.5, 8.0)).around(4.0)
        (2.0, 8.0)
        """
        low, high = self.bounds or (theta, theta)
        below = [g for g in self.grid if g < theta and not np.isclose(g, theta)]
        above = [g for g in self.grid if g > theta and not np.isclose(g, theta)]
        return max([low, *below[-1:]]), min([high, *above[:1]])

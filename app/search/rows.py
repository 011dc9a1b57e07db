"""What a search starts from: residuals by visit and channel, their noise, the maps' own freedom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np

from app.arrays import FloatArray, IntArray, SparseArray
from app.errors import InvalidContent
from app.search.scatter import blocks_in_time, setups_alone


class Datum(StrEnum):
    """What zero means for one channel in one visit.

    `FIRST`: the first observation was set to zero, so that its own error is in all the
    others. With that row kept among the rows (its value is exactly zero) this is the same
    likelihood as `FREE`, an unknown constant: zeroing only chooses the contrasts. Both
    therefore get a constant of unlimited variance.
    """

    ABSOLUTE = "absolute"
    FIRST = "first"
    FREE = "free"


@dataclass(frozen=True, slots=True)
class DeclaredNoise:
    """What is known about a channel's scatter before the search, in the channel's unit.

    Parameters
    ----------
    repeatability
        Standard deviation of one observation within a visit; without it, it is taken
        from replicates or from the residuals.
    rounding
        Standard deviation of the steps in which the instrument reads: an observation scatters by no
        less, whatever it seems to. A repeatability that is stated contains it.
    origin
        Where the repeatability comes from.
    """

    repeatability: float | None = None
    rounding: float = 0.0
    origin: str = "declared"


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals, one row for each observation of one channel.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Measured minus predicted, each in its channel's unit.
    visit : ndarray, shape (n,)
        Numbers of the visits, growing with time: what has one set-up.
    channel : ndarray, shape (n,)
        Numbers of the components or volumetric directions.
    tilt : ndarray, shape (n, q)
        Columns along which a visit may tilt: scaled positions.
    replicate : ndarray, shape (n,)
        Rows of one visit and channel with the same number repeat each other; −1: none.
    minutes : ndarray, shape (n,)
        When each row was measured.
    datum
        (visit, channel) to what its zero means; absolute where not named.
    alike
        Channel to a name that it shares with channels of the same instrument and unit, whose
        scatter is about the same: a scatter of few replicates leans on theirs.
    """

    values: FloatArray
    visit: IntArray
    channel: IntArray
    tilt: FloatArray
    replicate: IntArray
    minutes: FloatArray
    noise: Mapping[int, DeclaredNoise] = field(default_factory=dict)
    datum: Mapping[tuple[int, int], Datum] = field(default_factory=dict)
    alike: Mapping[int, str] = field(default_factory=dict)

    @cached_property
    def block(self) -> IntArray:
        """Number of each row's block: rows of one visit at about one time; shape (n,).

        Blocks are held out, and share what wanders. A short visit alone has several, while it
        is one moment to whatever follows temperatures (`ObservationRows.block`).
        """
        return blocks_in_time(self.visit, self.minutes, setups_alone(self.visit, self.channel))

    def __post_init__(self) -> None:
        n = len(self.values)
        for name in ("values", "visit", "channel", "replicate", "minutes"):
            if getattr(self, name).shape != (n,):
                raise InvalidContent.of_field(
                    name, f"expected {n} values, got shape {getattr(self, name).shape}"
                )
        if self.tilt.ndim != 2 or len(self.tilt) != n:
            raise InvalidContent.of_field(
                "tilt", f"expected {n} rows of columns, got shape {self.tilt.shape}"
            )
        if n == 0 or not (np.isfinite(self.values).all() and np.isfinite(self.tilt).all()):
            raise InvalidContent.of_field("values", "expected at least one row, all finite")
        for channel, noise in self.noise.items():
            if noise.repeatability is not None and not 0 < noise.repeatability < np.inf:
                raise InvalidContent.of_field(
                    f"noise.{channel}.repeatability",
                    f"expected a standard deviation above 0, got {noise.repeatability:g}",
                )


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Columns that a channel's tables may follow within their own uncertainty.

    Parameters
    ----------
    rows : ndarray, shape (m,)
        Which rows they act on; zero elsewhere.
    columns : ndarray, shape (m, p)
        The channel's change for one standard deviation of each table entry.
    shared : sparse array, shape (e, p), or None
        Each column's amplitude as a combination of e unit errors that several channels share:
        one and the same map is wrong in all of them. None: each channel has its own.
    """

    channel: int
    rows: IntArray
    columns: FloatArray
    shared: SparseArray | None = None

    def at(self, rows: IntArray) -> FloatArray:
        """Give the columns at some rows, any of which may be −1 for none; shape (m, p)."""
        last = max(int(self.rows.max(initial=-1)), int(rows.max(initial=-1)))
        place = np.full(last + 2, -1, dtype=np.intp)  # and one more, for −1
        place[self.rows] = np.arange(len(self.rows))
        return np.vstack([self.columns, np.zeros((1, self.columns.shape[1]))])[place[rows]]

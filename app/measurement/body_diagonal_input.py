"""Take the runs along body diagonals, and refuse what cannot be right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.body_diagonal import DIAGONALS
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_array,
    expect_displacements,
    expect_plausible,
    suspiciously_small,
)
from app.measurement.stated_runs import over_positions
from app.units import MM_PER_M

LONGER: Final = 1.001
"""A measured diagonal may be longer than the volume's by rounding of its positions."""


@dataclass(frozen=True, slots=True, eq=False)
class DiagonalRuns:
    """The runs along one diagonal.

    Parameters
    ----------
    name
        `ppp` …
    positions_mm : ndarray, shape (k,) [mm]
        Along the diagonal, increasing.
    forward_um, backward_um : ndarray, shapes (j, k) and (i, k) [µm]
        Displacement less its nominal of each run; i is 0 where there are none.
    """

    name: str
    positions_mm: FloatArray
    forward_um: FloatArray
    backward_um: FloatArray

    @property
    def displacements_um(self) -> FloatArray:
        """Means of each direction, from the first forward one: shape (1 or 2, k) [µm]."""
        means = [d.mean(axis=0) for d in (self.forward_um, self.backward_um) if len(d)]
        displacements: FloatArray = np.array(means) - means[0][0]
        return displacements

    @property
    def reversal_um(self) -> float | None:
        """Largest reversal value of either sign, forward less backward mean [µm]."""
        if not len(self.backward_um):
            return None
        forward, backward = self.displacements_um
        difference = forward - backward
        return float(difference[np.abs(difference).argmax()])

    @property
    def stretch_spread_per_m(self) -> float:
        """Standard error of the stretch for readings of standard deviation 1 [1/m].

        Each run ends and begins with one reading; the means of both directions are
        averaged.
        """
        counts = [len(d) for d in (self.forward_um, self.backward_um) if len(d)]
        variance = sum(2 / count for count in counts) / len(counts) ** 2
        return float(np.sqrt(variance) / (np.ptp(self.positions_mm) / MM_PER_M))

    @property
    def suspicions(self) -> list[str]:
        """What looks wrong though it may be right, in sentences."""
        readings = np.concatenate([self.forward_um.ravel(), self.backward_um.ravel()])
        return suspiciously_small(f"diagonals.{self.name}", readings, zeros=True)

    def stretch_um_per_m(self, diagonal_mm: float) -> float:
        """Compute by how much the diagonal is too long, of its measured length.

        Parameters
        ----------
        diagonal_mm
            Length of the volume's diagonal [mm].

        Returns
        -------
        float
            Last less first displacement, both directions averaged, over the distance [µm/m].

        Raises
        ------
        InvalidContent
            If the positions are further apart than that.
        """
        span_mm = float(np.ptp(self.positions_mm))
        if span_mm > diagonal_mm * LONGER:
            raise InvalidContent.of_field(
                f"diagonals.{self.name}.positions_mm",
                f"expected positions along a diagonal of {diagonal_mm:g} mm, came {span_mm:g} mm "
                "from the first to the last",
            )
        ends = self.displacements_um[:, -1] - self.displacements_um[:, 0]
        return float(ends.mean() / (span_mm / MM_PER_M))


def take_runs(diagonals: Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, DiagonalRuns]:
    """Take all four diagonals.

    Parameters
    ----------
    diagonals
        As for `body_diagonal`.

    Returns
    -------
    dict of diagonal to DiagonalRuns
        In the order ppp, npp, pnp, ppn.

    Raises
    ------
    InvalidContent
        If a diagonal or one of its arrays is missing, unknown, or cannot be right.
    """
    unknown = [name for name in diagonals if name not in DIAGONALS]
    missing = [name for name in DIAGONALS if name not in diagonals]
    if unknown or missing:
        raise InvalidContent.of_field(
            "diagonals", f"expected {list_names(DIAGONALS)}, came {list_names(diagonals)}"
        )
    return {name: _runs_of(name, diagonals[name]) for name in DIAGONALS}


def _runs_of(name: str, stated: Mapping[str, ArrayLike]) -> DiagonalRuns:
    field = f"diagonals.{name}"
    known = ("positions_mm", "forward_um", "backward_um")
    if not set(known[:2]) <= set(stated) or not set(stated) <= set(known):
        raise InvalidContent.of_field(
            field, f"expected positions_mm, forward_um and maybe backward_um, came {list(stated)}"
        )
    positions = _positions(f"{field}.positions_mm", stated["positions_mm"])
    forward = _readings(f"{field}.forward_um", stated["forward_um"])
    forward = over_positions(f"{field}.forward_um", forward, positions.size, "µm")
    backward = np.empty((0, positions.size))
    if stated.get("backward_um") is not None:
        came = _readings(f"{field}.backward_um", stated["backward_um"])
        if came.size:
            backward = over_positions(f"{field}.backward_um", came, positions.size, "µm")
    return DiagonalRuns(name, positions, forward, backward)


def _positions(field: str, stated_mm: ArrayLike) -> FloatArray:
    positions = as_array(field, stated_mm, "numbers in mm")
    if positions.ndim != 1 or positions.size < 2 or (np.diff(positions) <= 0).any():
        raise InvalidContent.of_field(
            field, f"expected at least two increasing positions in mm, came {positions.tolist()}"
        )
    hint = "are they in µm?"
    expect_plausible(field, positions, "mm", FARTHEST_MM, hint, what="positions", place=_place)
    return positions


def _readings(field: str, stated_um: ArrayLike) -> FloatArray:
    readings = as_array(field, stated_um, "numbers in µm", rows="runs")
    expect_displacements(field, readings, _place)
    return readings


def _place(at: list[int]) -> str:
    return f"(at index {', '.join(map(str, at))})"

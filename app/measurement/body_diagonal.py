"""Body diagonals: how well a machine keeps distances across its volume (ISO 230-6).

C. Wang (2008), 8.3.2.1 and 8.130–8.133; ISO 230-6. A laser points along a body diagonal
and all axes move together. Four numbers at the four ends answer four questions: how long
the diagonals are on the whole, and the three squareness errors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.body_diagonal import DIAGONALS, DiagonalAccuracy, diagonal_accuracy, diagonal_ends
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Kind
from app.geometry.volumetric_error import volumetric_error
from app.geometry.work_volume import WorkVolume
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_array,
    as_standard_deviation,
    expect_displacements,
    expect_plausible,
    suspiciously_small,
)
from app.measurement.stated_runs import over_positions
from app.rounding import Micro
from app.thermal.error_map import ComponentTable, positions_for_errors
from app.units import MM_PER_M

PLANES: Final = ((0, 1), (1, 2), (2, 0))
"""Of SXY, SYZ, SZX."""

ROUNDING_UM: Final = 1e-6
"""Runs that differ by no more do not differ."""

UNSEEN: Final = (
    "Four ends answer four questions: the diagonals' mean scale, which is that of x, y and z "
    "weighted with the squares of their sides, and three squareness errors, each the sum of two "
    "straightness slopes. Scales of single axes, and straightness beside its end-point slopes, "
    "do not show."
)


LONGER: Final = 1.001
"""A measured diagonal may be longer than the volume's by rounding of its positions."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyDiagonal(Evaluated):
    """Ed, ESd, and the squareness that the diagonals' ends show."""

    ed_um: Annotated[Micro, Field(alias="Ed_um")]
    """Largest range on a diagonal, of the means in both directions [µm]"""
    esd_um: Annotated[Micro, Field(alias="ESd_um")]
    """Range over all diagonals together [µm]"""
    diagonals_um: Mapping[str, Micro]
    """Range on each diagonal [µm]"""
    reversal_um: Mapping[str, Micro]
    """Largest reversal value on each diagonal, forward less backward mean [µm]; empty where nothing
    was measured backwards"""
    # Of one run's reading: of repeated runs, or as stated; None where unknown [µm].
    repeatability_um: Annotated[float | None, Field(exclude=True)]


def body_diagonal(
    diagonals: Mapping[str, Mapping[str, ArrayLike]],
    *,
    volume: WorkVolume | None = None,
    chain: Chain | None = None,
    repeatability_um: float | None = None,
) -> BodyDiagonal:
    """Evaluate the four body diagonals, and derive squareness from their ends.

    Parameters
    ----------
    diagonals
        `ppp`, `npp`, `pnp` and `ppn`, each with `positions_mm` (k,) along the diagonal,
        increasing [mm], and `forward_um` and optionally `backward_um`: displacement along
        the diagonal less its nominal at those positions, one run (k,) or runs (j, k) [µm].
    volume
        The box whose diagonals they are: its sides give the squareness its lever.
        Without it there is none.
    chain
        Order of the axes: says which rotations the squareness contains.
    repeatability_um
        Standard deviation of one reading [µm], where runs are not repeated.

    Raises
    ------
    InvalidContent
        If a diagonal is missing or unknown, readings cannot be right, a diagonal is
        longer than the volume's, or the volume lacks an axis.

    Notes
    -----
    Displacements count from the first forward reading's mean. Squareness is solved for
    together with the mean scale K: displacement of an end = K R ± SXY XY/R ± SYZ YZ/R ± SZX
    ZX/R with the signs of [V 12], so that each is a difference of two pairs of diagonals.
    [V 13] adds two diagonals and so takes K R²/(XY) for squareness: it holds only where
    K = 0.

    Examples
    --------
    >>> ends = {"ppp": 4.0, "npp": 2.0, "pnp": 2.0, "ppn": 4.0}
    >>> read = {d: {"positions_mm": [0, 1300], "forward_um": [0, e]} for d, e in ends.items()}
    >>> box = WorkVolume((0.0, 300.0), (0.0, 400.0), (0.0, 1200.0))
    >>> found = body_diagonal(read, volume=box)
    >>> found.ed_um, found.esd_um
    (4.0, 4.0)
    >>> {t.component.code: t.errors.round(3).tolist() for t in found.result.tables[:1]}
    {'SXY': [10.833]}
    """
    runs = take_runs(diagonals)
    repeatability = as_standard_deviation(
        "repeatability_um", repeatability_um, "µm", largest=math.inf, zero=False
    )
    noise, freedom = _repeatability(runs)
    noise = repeatability if noise is None else noise
    accuracy = diagonal_accuracy({name: run.displacements_um for name, run in runs.items()})
    reversal = {name: run.reversal_um for name, run in runs.items() if run.reversal_um is not None}
    figures = _figures(accuracy, reversal, noise, freedom)
    notes = list(_notes(runs, noise))
    tables: list[ComponentTable] = []
    if volume is None:
        notes.append("No squareness: it needs the volume's sides.")
    else:
        tables, scale = _squareness(runs, volume, noise)
        figures["diagonal_scale_um_per_m"] = scale
        notes += [UNSEEN, *_rotations(chain)]
    return BodyDiagonal(
        result=MeasurementResult(tuple(tables), figures, tuple(notes)),
        ed_um=accuracy.ed_um,
        esd_um=accuracy.esd_um,
        diagonals_um=accuracy.ranges_um,
        reversal_um=reversal,
        repeatability_um=noise,
    )


def _figures(
    accuracy: DiagonalAccuracy, reversal: Mapping[str, float], noise: float | None, freedom: int
) -> dict[str, float]:
    figures = {"ed_um": accuracy.ed_um, "esd_um": accuracy.esd_um}
    figures |= {f"range_{name}_um": value for name, value in accuracy.ranges_um.items()}
    if reversal:
        figures["bd_um"] = max(map(abs, reversal.values()))
    if noise is not None:
        figures["repeatability_um"] = noise
    if freedom:
        figures["degrees_of_freedom"] = float(freedom)
    return figures


def _repeatability(runs: Mapping[str, DiagonalRuns]) -> tuple[float | None, int]:
    """Pool the spread of repeated runs, each freed of its own zero: µm, degrees of freedom."""
    squares, freedom = 0.0, 0
    for run in runs.values():
        for direction in (run.forward_um, run.backward_um):
            rest = direction - direction.mean(axis=1, keepdims=True)
            rest = rest - rest.mean(axis=0, keepdims=True) if len(rest) else rest
            squares += float((rest**2).sum())
            # Two means are out, of each run and of each position: (runs − 1)(positions − 1).
            freedom += max(len(rest) - 1, 0) * (rest.shape[1] - 1)
    # Runs of a coarse scale that do not differ at all do not show their noise.
    if not freedom or squares <= freedom * ROUNDING_UM**2:
        return None, 0
    return float(np.sqrt(squares / freedom)), freedom


def _squareness(
    runs: Mapping[str, DiagonalRuns], volume: WorkVolume, noise: float | None
) -> tuple[list[ComponentTable], float]:
    """Solve the ends' displacements for mean scale and squareness [µm/m]."""
    shares = _shares(volume)
    stretched = np.array([runs[name].stretch_um_per_m(volume.diagonal_mm) for name in DIAGONALS])
    # Orthogonal columns of ±: the inverse is exact.
    solution = np.linalg.inv(shares)
    variance = None
    if noise is not None:
        # No two diagonals share a reading: their variances add.
        spread = np.array([runs[name].stretch_spread_per_m for name in DIAGONALS])
        variance = noise**2 * (solution**2 @ spread**2)
    values = solution @ stretched
    tables = []
    for row, (u, v) in enumerate(PLANES, start=1):
        code = f"S{LINEAR_LETTERS[u]}{LINEAR_LETTERS[v]}".upper()
        covariance = None if variance is None else [[variance[row]]]
        tables.append(ComponentTable.make(COMPONENTS[code], values[row], covariance=covariance))
    return tables, float(values[0])


def _shares(volume: WorkVolume) -> FloatArray:
    """What a scale and each squareness of 1 µm/m add to a diagonal's stretch: (4, 4)."""
    rows = []
    for name in DIAGONALS:
        start, end = diagonal_ends(volume, name)
        ray = (end - start) / volume.diagonal_mm
        if not ray.all():
            raise InvalidContent.of_field(
                "volume", f"expected three sides above 0 mm, got {np.abs(end - start).tolist()}"
            )
        rows.append([1.0, *(ray[u] * ray[v] for u, v in PLANES)])
    return np.array(rows)


def _rotations(chain: Chain | None) -> list[str]:
    """Say which rotations look like squareness on the diagonals of this chain (8.108–8.111)."""
    if chain is None:
        return []
    box = WorkVolume(*((0.0, MM_PER_M),) * 3)
    ends = [diagonal_ends(box, name) for name in DIAGONALS]
    sums = [COMPONENTS[f"S{LINEAR_LETTERS[u]}{LINEAR_LETTERS[v]}".upper()].code for u, v in PLANES]
    angular = (c for c in COMPONENTS.values() if c.kind is Kind.ANGULAR and c.axis in chain.axes)
    for component in angular:
        unit = {component.code: np.ones(1)}
        stretched = []
        for start, end in ends:
            errors_um, _ = volumetric_error(chain, unit, np.stack([start, end]))
            stretched.append((errors_um[1] - errors_um[0]) @ (end - start) / box.diagonal_mm)
        solution = np.linalg.solve(_shares(box), np.array(stretched) * MM_PER_M / box.diagonal_mm)
        # A rotation with one arm displaces as a squareness of ± its own size; along two arms its
        # parts cancel on a diagonal. So all are 0 or ±1, but for rounding.
        for row, sign in enumerate(solution[1:].round().tolist()):
            if sign:
                sums[row] += f" {'+' if sign > 0 else '−'} {component.code}"
    return [
        f"On the diagonals of {chain.text}, the means of rotations at both ends of their axis "
        f"count as squareness: what is given is {', '.join(sums)}."
    ]


def _notes(runs: Mapping[str, DiagonalRuns], noise: float | None) -> list[str]:
    notes = [note for name in DIAGONALS for note in runs[name].suspicions]
    one_way = [name for name in DIAGONALS if not len(runs[name].backward_um)]
    if one_way:
        notes.append(
            f"Measured in one direction only ({', '.join(one_way)}): Ed of ISO 230-6 is of both, "
            "and reversal does not show."
        )
    if noise is None:
        notes.append(
            "No uncertainty: runs were not repeated or do not differ, and no repeatability_um was "
            "stated."
        )
    return notes


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
                f"expected positions along a diagonal of {diagonal_mm:g} mm, got {span_mm:g} mm "
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
            "diagonals", f"expected {list_names(DIAGONALS)}, got {list_names(diagonals)}"
        )
    return {name: _runs_of(name, diagonals[name]) for name in DIAGONALS}


def _runs_of(name: str, measured: Mapping[str, ArrayLike]) -> DiagonalRuns:
    field = f"diagonals.{name}"
    fields = ("positions_mm", "forward_um", "backward_um")
    if not set(fields[:2]) <= set(measured) or not set(measured) <= set(fields):
        raise InvalidContent.of_field(
            field, f"expected positions_mm, forward_um and maybe backward_um, got {list(measured)}"
        )
    positions = _positions(f"{field}.positions_mm", measured["positions_mm"])
    forward = _readings(f"{field}.forward_um", measured["forward_um"])
    forward = over_positions(f"{field}.forward_um", forward, positions.size, "µm")
    backward = np.empty((0, positions.size))
    if measured.get("backward_um") is not None:
        got = _readings(f"{field}.backward_um", measured["backward_um"])
        if got.size:
            backward = over_positions(f"{field}.backward_um", got, positions.size, "µm")
    for run in (*forward, *backward):
        if problem := positions_for_errors(positions, run):
            raise InvalidContent.of_field(field, problem)
    return DiagonalRuns(name, positions, forward, backward)


def _positions(field: str, stated_mm: ArrayLike) -> FloatArray:
    positions = as_array(field, stated_mm, "numbers in mm")
    if positions.ndim != 1 or positions.size < 2 or (np.diff(positions) <= 0).any():
        raise InvalidContent.of_field(
            field, f"expected at least two increasing positions in mm, got {positions.tolist()}"
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

"""What is stated of a sequential step diagonal: its steps, its readings, its options.

Refused is what cannot be right; said, but kept, is what only looks wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, counted, list_names
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Kind
from app.measurement.reference_line import expect_line
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_array,
    as_standard_deviation,
    expect_displacements,
    expect_plausible,
    suspiciously_small,
)
from app.measurement.step_diagonal_readings import expect_target

ALIKE: Final = 0.01
"""Readings that follow the nominal movement so closely are that movement."""
BEYOND_TRAVEL_MM: Final = 1e-6
"""Rounding of positions at the end of the travel."""

ORDER: Final = "(after x, after y, after z)"
"""Of the readings in a row."""

FEWEST: Final = 3
"""Diagonals that three unknowns need."""


@dataclass(frozen=True, eq=False)
class StepWalk:
    """The steps of all measured diagonals (C. Wang 2000, III E and III I).

    Parameters
    ----------
    origin_mm, step_mm : ndarray, shape (3,) [mm]
        Lowest corner of the volume, and the positive steps X, Y, Z.
    diagonals
        Names of the m measured diagonals, `ppp` …
    """

    origin_mm: FloatArray
    step_mm: FloatArray
    steps: int
    diagonals: tuple[str, ...]

    @cached_property
    def ways(self) -> FloatArray:
        """+1 where an axis runs up and −1 where it runs down: shape (m, 3)."""
        return np.array([[1.0 if way == "p" else -1.0 for way in d] for d in self.diagonals])

    @cached_property
    def rays(self) -> FloatArray:
        """Unit vector r of each diagonal: shape (m, 3)."""
        rays: FloatArray = self.ways * self.step_mm / np.linalg.norm(self.step_mm)
        return rays

    @property
    def centre_mm(self) -> FloatArray:
        """Middle of the volume, where all diagonals cross: shape (3,) [mm]."""
        centre: FloatArray = self.origin_mm + self.step_mm * self.steps / 2
        return centre

    def nodes_mm(self, axis: str) -> FloatArray:
        """Give the n + 1 positions at which an axis stands.

        Returns
        -------
        ndarray, shape (n + 1,) [mm]
            Increasing.
        """
        i = LINEAR_LETTERS.index(axis)
        nodes: FloatArray = self.origin_mm[i] + self.step_mm[i] * np.arange(self.steps + 1)
        return nodes

    def positions_mm(self) -> FloatArray:
        """Give where the machine stands at the start and at each reading.

        Returns
        -------
        ndarray, shape (m, 3n + 1, 3) [mm]
        """
        # At reading j axis x (0) has made (j + 2) // 3 steps, y (1) (j + 1) // 3, z (2) j // 3.
        steps_done = (np.arange(3 * self.steps + 1)[:, None] + [2, 1, 0]) // 3
        nodes = np.where(self.ways[:, None] > 0, steps_done, self.steps - steps_done)
        return self.origin_mm + nodes * self.step_mm

    def by_interval(self, readings_um: FloatArray) -> FloatArray:
        """Sort what each single step added by the axis and the interval that it crossed.

        Parameters
        ----------
        readings_um : ndarray, shape (m, n, 3) [µm]
            Cumulative readings after x, y and z of each step.

        Returns
        -------
        ndarray, shape (m, 3, n) [µm]
            For diagonal, axis and interval, r · (E(upper end) − E(lower end)): a traverse
            downwards has its sign reversed, as in [V 6].
        """
        flat = readings_um.reshape(len(self.diagonals), -1)
        added = np.diff(flat, axis=1, prepend=0.0).reshape(readings_um.shape)
        return self.turned(added.transpose(0, 2, 1))

    def turned(self, along: FloatArray) -> FloatArray:
        """Exchange the order of steps for that of intervals, or back: the same for both.

        Parameters
        ----------
        along : ndarray, shape (m, 3, n)
            Quantities that change their sign with the way, for diagonal, axis and step.

        Returns
        -------
        ndarray, shape (m, 3, n)
        """
        up = self.ways[:, :, None] > 0
        return np.where(up, along, -along[:, :, ::-1])

    def reading_weights(self, weights: FloatArray) -> FloatArray:
        """Turn weights on the intervals' increments into weights on the readings.

        Parameters
        ----------
        weights : ndarray, shape (m, 3, n)
            Of what `by_interval` gives.

        Returns
        -------
        ndarray, shape (m, 3n + 1)
            Of the m diagonals' readings, the zero at the start first.
        """
        steps = self.turned(weights).transpose(0, 2, 1).reshape(len(self.diagonals), -1)
        # A reading ends the increment before it (+) and begins the one after it (−).
        ends = np.pad(steps, ((0, 0), (1, 1)))
        differences: FloatArray = ends[:, :-1] - ends[:, 1:]
        return differences


def take_walk(
    origin_mm: ArrayLike,
    step_mm: ArrayLike,
    diagonals: Mapping[str, ArrayLike],
    travel_mm: Mapping[str, tuple[float, float]] | None,
) -> tuple[StepWalk, FloatArray]:
    """Take the steps and the readings.

    Parameters
    ----------
    origin_mm, step_mm : array-like, shape (3,) [mm]
        Lowest corner, and positive steps.
    diagonals : mapping of diagonal to array-like, shape (n, 3) [µm]
        Readings after x, y and z of each step; three or four diagonals.
    travel_mm
        Axis to the ends of its travel [mm]; not checked where left out.

    Returns
    -------
    walk : StepWalk
        With the diagonals in the order ppp, npp, pnp, ppn.
    readings_um : ndarray, shape (m, n, 3) [µm]

    Raises
    ------
    InvalidContent
        If there are fewer than three diagonals or an unknown one, if readings are
        missing, of unequal number, not finite or of impossible size, if a step is not
        positive, or if the steps leave the travel.
    """
    origin = _three("origin_mm", origin_mm)
    step = _three("step_mm", step_mm)
    if not (step > 0).all():
        raise InvalidContent.of_field(
            "step_mm",
            f"expected steps above 0 in mm (a diagonal's letters say which axis runs "
            f"backwards), got {step.tolist()}",
        )
    names = _names(diagonals)
    rows = [_rows(f"diagonals.{name}", diagonals[name]) for name in names]
    counts = {name: len(row) for name, row in zip(names, rows, strict=True)}
    if len(set(counts.values())) > 1:
        lengths = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InvalidContent.of_field(
            "diagonals", f"expected the same number of steps on every diagonal, got {lengths}"
        )
    walk = StepWalk(origin, step, len(rows[0]), names)
    _check_travel(walk, travel_mm or {})
    readings = np.stack(rows)
    _check_unit(walk, readings)
    return walk, readings


def suspicions(walk: StepWalk, readings_um: FloatArray) -> list[str]:
    """Say what looks wrong though it may be right.

    Parameters
    ----------
    readings_um : ndarray, shape (m, n, 3) [µm]
    """
    named = zip(walk.diagonals, readings_um, strict=True)
    return suspiciously_small("diagonals", readings_um, zeros=True) + [
        f"{diagonal} and {other} have the same readings throughout."
        for (diagonal, first), (other, second) in combinations(named, 2)
        if readings_um.any() and np.array_equal(first, second)
    ]


def _three(field: str, stated_mm: ArrayLike) -> FloatArray:
    numbers = as_array(field, stated_mm, "x, y and z in mm")
    if numbers.shape != (3,):
        raise InvalidContent.of_field(
            field, f"expected finite x, y and z in mm, got {numbers.tolist()}"
        )
    expect_plausible(field, numbers, "mm", FARTHEST_MM, "are they in µm?", what="x, y and z")
    return numbers


def _names(diagonals: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    unknown = [name for name in diagonals if name not in DIAGONALS]
    if unknown:
        raise InvalidContent.of_field(
            "diagonals", f"expected {list_names(DIAGONALS)}, got {list_names(map(repr, unknown))}"
        )
    names = tuple(name for name in DIAGONALS if name in diagonals)
    if len(names) < FEWEST:
        raise InvalidContent.of_field(
            "diagonals",
            f"expected at least {FEWEST} of {list_names(DIAGONALS)} (each axis moves in three "
            f"unknown ways), got {list_names(names)}",
        )
    return names


def _rows(field: str, stated_um: ArrayLike) -> FloatArray:
    rows = as_array(field, stated_um, f"rows of 3 readings in µm {ORDER}")
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
        raise InvalidContent.of_field(
            field,
            f"expected at least one row of 3 readings in µm {ORDER}, got an array of shape "
            f"{rows.shape}",
        )
    expect_displacements(field, rows, _place)
    return rows


def _place(at: list[int]) -> str:
    step, axis = at
    return f"(row {step}, after {LINEAR_LETTERS[axis]})"


def _check_unit(walk: StepWalk, readings_um: FloatArray) -> None:
    """Refuse the movement itself in mm: an error of 1000 µm/m everywhere is none."""
    travelled = walk.positions_mm() - walk.positions_mm()[:, :1]
    nominal_mm = np.einsum("djv,dv->dj", travelled, walk.rays)[:, 1:].reshape(readings_um.shape)
    if np.abs(readings_um - nominal_mm).max() < ALIKE * np.abs(nominal_mm).min():
        raise InvalidContent.of_field(
            "diagonals",
            "expected displacements less their nominal in µm, got the nominal displacements "
            f"themselves in mm (up to {nominal_mm.max():g})",
        )


def _check_travel(walk: StepWalk, travel_mm: Mapping[str, tuple[float, float]]) -> None:
    for axis, (lowest, highest) in travel_mm.items():
        if axis not in LINEAR_LETTERS:
            raise InvalidContent.of_field("travel_mm", f"expected axes x, y, z, got {axis!r}")
        first, last = walk.nodes_mm(axis)[[0, -1]]
        if first < lowest - BEYOND_TRAVEL_MM or last > highest + BEYOND_TRAVEL_MM:
            raise InvalidContent.of_field(
                "step_mm",
                f"expected {axis} within its travel of {lowest:g} to {highest:g} mm, got "
                f"{counted(walk.steps, 'step')} from {first:g} to {last:g} mm",
            )


def expect_options(chain: Chain, line: str, target: str) -> None:
    """Refuse a machine without three axes, and lines and targets that nobody knows."""
    if len(chain.axes) < 3:
        raise InvalidContent.of_field(
            "configuration", f"expected a machine with axes x, y and z, got {chain.text}"
        )
    expect_line("line", line)
    expect_target(target)


def expect_uncertainties(repeatability_um: float | None, mirror_angle_urad: float | None) -> None:
    """Refuse stated uncertainties that cannot be right.

    Parameters
    ----------
    repeatability_um
        Standard deviation of one reading [µm]; above 0.
    mirror_angle_urad
        Standard uncertainty of each of a mirror's two tilts [µrad]; 0 says that the mirror
        is no source of uncertainty.

    Raises
    ------
    InvalidContent
        If one is negative or not finite, or no reading varies.
    """
    as_standard_deviation("repeatability_um", repeatability_um, "µm", largest=math.inf, zero=False)
    as_standard_deviation("mirror_angle_urad", mirror_angle_urad, "µrad", largest=math.inf)


def expect_angular(codes: Iterable[str]) -> None:
    """Refuse known errors that are not angular errors of an axis."""
    for code in codes:
        component = COMPONENTS.get(code)
        if component is None or component.axis is None or not component.is_rotation:
            angular = [c.code for c in COMPONENTS.values() if c.kind is Kind.ANGULAR]
            raise InvalidContent.of_field(
                "angular", f"expected angular errors ({list_names(angular)}), got {code!r}"
            )

"""Take the arguments of a sequential step diagonal, and refuse what cannot be right."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, counted, list_names
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.components import LINEAR_LETTERS
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_array,
    expect_displacements,
    expect_plausible,
    suspiciously_small,
)
from app.measurement.step_diagonal_walk import StepWalk

ALIKE: Final = 0.01
"""Readings that follow the nominal movement so closely are that movement."""

BEYOND_TRAVEL_MM: Final = 1e-6
"""Rounding of positions at the end of the travel."""

ORDER: Final = "(after x, after y, after z)"
"""Of the readings in a row."""

FEWEST: Final = 3
"""Diagonals that three unknowns need."""


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
            f"backwards), came {step.tolist()}",
        )
    names = _names(diagonals)
    rows = [_rows(f"diagonals.{name}", diagonals[name]) for name in names]
    counts = {name: len(found) for name, found in zip(names, rows, strict=True)}
    if len(set(counts.values())) > 1:
        said = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InvalidContent.of_field(
            "diagonals", f"expected the same number of steps on every diagonal, came {said}"
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
    walk
        The steps.
    readings_um : ndarray, shape (m, n, 3) [µm]
        The readings.

    Returns
    -------
    list of str
        In sentences.
    """
    named = zip(walk.diagonals, readings_um, strict=True)
    return suspiciously_small("diagonals", readings_um, zeros=True) + [
        f"{one} and {other} have the same readings throughout."
        for (one, first), (other, second) in combinations(named, 2)
        if readings_um.any() and np.array_equal(first, second)
    ]


def _three(field: str, stated_mm: ArrayLike) -> FloatArray:
    numbers = as_array(field, stated_mm, "x, y and z in mm")
    if numbers.shape != (3,):
        raise InvalidContent.of_field(
            field, f"expected finite x, y and z in mm, came {numbers.tolist()}"
        )
    expect_plausible(field, numbers, "mm", FARTHEST_MM, "are they in µm?", what="x, y and z")
    return numbers


def _names(diagonals: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    unknown = [name for name in diagonals if name not in DIAGONALS]
    if unknown:
        raise InvalidContent.of_field(
            "diagonals", f"expected {list_names(DIAGONALS)}, came {list_names(map(repr, unknown))}"
        )
    names = tuple(name for name in DIAGONALS if name in diagonals)
    if len(names) < FEWEST:
        raise InvalidContent.of_field(
            "diagonals",
            f"expected at least {FEWEST} of {list_names(DIAGONALS)} (each axis moves in three "
            f"unknown ways), came {list_names(names)}",
        )
    return names


def _rows(field: str, stated_um: ArrayLike) -> FloatArray:
    rows = as_array(field, stated_um, f"rows of 3 readings in µm {ORDER}")
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
        raise InvalidContent.of_field(
            field,
            f"expected at least one row of 3 readings in µm {ORDER}, came an array of shape "
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
            "expected displacements less their nominal in µm, came the nominal displacements "
            f"themselves in mm (up to {nominal_mm.max():g})",
        )


def _check_travel(walk: StepWalk, travel_mm: Mapping[str, tuple[float, float]]) -> None:
    for axis, (lowest, highest) in travel_mm.items():
        if axis not in LINEAR_LETTERS:
            raise InvalidContent.of_field("travel_mm", f"expected axes x, y, z, came {axis!r}")
        first, last = walk.nodes_mm(axis)[[0, -1]]
        if first < lowest - BEYOND_TRAVEL_MM or last > highest + BEYOND_TRAVEL_MM:
            raise InvalidContent.of_field(
                "step_mm",
                f"expected {axis} within its travel of {lowest:g} to {highest:g} mm, came "
                f"{counted(walk.steps, 'step')} from {first:g} to {last:g} mm",
            )

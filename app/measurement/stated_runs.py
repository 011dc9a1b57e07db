"""Take what is stated of a measurement along an axis: axis, line, positions and runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent, counted
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, Kind, parse_component
from app.geometry.measuring_line import MeasuringLine
from app.measurement.stated_numbers import FARTHEST_MM, as_numbers
from app.thermal.error_map import LARGEST_ERROR_UM, positions_for_errors


def expect_linear_axis(axis: str) -> None:
    """Refuse what is no linear axis.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    """
    if axis not in tuple(LINEAR_LETTERS):
        raise InvalidContent.of_field("axis", f"expected axis x, y or z, got {axis!r}")


def as_straightness(name: str) -> Component:
    """Take a straightness component by its name.

    Parameters
    ----------
    name
        In any notation that `parse_component` reads.

    Raises
    ------
    InvalidContent
        If it is another kind of component.

    Examples
    --------
    >>> as_straightness("D_x(y)").code
    'EXY'
    """
    component, _ = parse_component(name)
    if component.kind is not Kind.STRAIGHTNESS:
        of_kind = [c.code for c in COMPONENTS.values() if c.kind is Kind.STRAIGHTNESS]
        raise InvalidContent.of_field(
            "component",
            f"expected a straightness component ({', '.join(of_kind)}), got {component.code}, "
            f"{component.kind.value}",
        )
    return component


def stated_line(
    axis: str,
    point_mm: ArrayLike,
    tool_offset_mm: ArrayLike,
    point_field: str = "measuring_line_mm",
) -> MeasuringLine:
    """Take an axis' measuring line.

    Parameters
    ----------
    point_mm, tool_offset_mm : array-like, shape (3,) [mm]
        As for `MeasuringLine`.

    Raises
    ------
    InvalidContent
        If the point or the tool offset has not three finite coordinates; the field to
        blame is the one that states it.

    Examples
    --------
    >>> stated_line("x", [0, 250, 100], [0, 0, 160]).tool_offset_mm
    (0.0, 0.0, 160.0)
    """
    for field, point in ((point_field, point_mm), ("tool_offset_mm", tool_offset_mm)):
        try:
            MeasuringLine.make(axis, point)
        except InvalidContent as error:
            raise InvalidContent.of_field(field, error.errors[0].message) from None
    return MeasuringLine.make(axis, point_mm, tool_offset_mm)


def as_positions(field: str, stated_mm: ArrayLike) -> FloatArray:
    """Take positions along an axis.

    Parameters
    ----------
    stated_mm : array-like, shape (m,) [mm]
        Strictly increasing, at least one.

    Returns
    -------
    ndarray, shape (m,) [mm]

    Raises
    ------
    InvalidContent
        If they are none, not increasing, not finite or beyond 100 m.
    """
    positions = as_numbers(field, stated_mm, "mm", FARTHEST_MM, "perhaps in µm")
    if positions.ndim != 1 or positions.size == 0:
        raise InvalidContent.of_field(
            field, f"expected a list of positions in mm, got an array of shape {positions.shape}"
        )
    wrong = np.flatnonzero(np.diff(positions) <= 0)
    if wrong.size:
        i = int(wrong[0])
        raise InvalidContent.of_field(
            field,
            f"expected strictly increasing positions in mm, got {positions[i]:g} then "
            f"{positions[i + 1]:g} mm (index {i + 1}); give the readings in the same order",
        )
    return frozen(positions)


def as_runs(field: str, readings: ArrayLike, positions_mm: FloatArray, unit: str) -> FloatArray:
    """Take the readings of one run, or of several.

    Parameters
    ----------
    readings : array-like, shape (m,) or (n, m) [unit]
        One reading for each position in each run.
    positions_mm : ndarray, shape (m,) [mm]
    unit
        `µm` or `µrad`.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    InvalidContent
        If their number is another, they are not finite or above 10 mm or 10 mrad, or they are
        measured positions.
    """
    of_length = "perhaps in nm, or positions instead of deviations"
    hint = of_length if unit == "µm" else "perhaps in another unit"
    numbers = as_numbers(field, readings, unit, LARGEST_ERROR_UM, hint)
    runs = over_positions(field, numbers, positions_mm.size, unit)
    for run in runs if unit == "µm" else ():
        if problem := positions_for_errors(positions_mm, run):
            raise InvalidContent.of_field(field, problem)
    return runs


def over_positions(field: str, readings: FloatArray, positions: int, unit: str) -> FloatArray:
    """Take readings as runs over positions.

    Parameters
    ----------
    readings : ndarray, shape (m,) or (n, m) [unit]
        One run, or several.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    InvalidContent
        If there is no run, or one of another number of readings.
    """
    runs = readings[None] if readings.ndim == 1 else readings
    if runs.ndim != 2 or runs.shape[0] == 0 or runs.shape[1] != positions:
        readings_each = counted(positions, "reading")
        raise InvalidContent.of_field(
            field,
            f"expected {readings_each} in {unit}, one for each position, or runs of "
            f"{readings_each} in {unit}, got an array of shape {readings.shape}",
        )
    return runs

"""An error map: all error components measured in one thermal state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent
from app.geometry.components import Component, Kind
from app.geometry.measuring_line import MeasuringLines
from app.thermal.uncertainty import check_covariance, standard_errors_of
from app.units import UM_PER_MM, Unit

LARGEST_ERROR_UM: Final = 10 * UM_PER_MM
"""No machine tool is wrong by more than 10 mm [µm], 10 mrad [µrad] or 10 mm/m [µm/m].

Larger numbers are in another unit, or the nominal position is still in them.
"""

SHORTEST_WAY_MM: Final = 1.0
"""Over which an axis cannot stand still: backlash is shorter."""

SHORTEST_IN_MM: Final = 50.0
SAME_NUMBER: Final = 0.05
"""Readings that are the positions' numbers within it, over a longer way than that, are in mm: an
error of 1 mm/m scatters by more."""

VALUE_LIMIT: Final = 1e6
"""What a table can hold: a metre [µm], which is where a rotary axis may be instead of at zero."""


def largest_error(component: Component | None) -> float:
    """Give the largest number that is taken as an error [component.unit; µm at a point].

    What places a rotary axis may be its place in the machine's coordinates, which is no error.

    >>> from app.geometry.components import COMPONENTS
    >>> largest_error(COMPONENTS["EXX"]), largest_error(COMPONENTS["XOC"])
    (10000.0, 1000000.0)
    """
    is_place = component is not None and component.kind is Kind.ROTARY_LOCATION
    return VALUE_LIMIT if is_place else LARGEST_ERROR_UM


def impossible_error(component: Component | None, errors: ArrayLike) -> str:
    """Say that an error is larger than any machine's; empty if none is.

    Parameters
    ----------
    component
        Whose errors they are; None for components of an error at a point.
    errors : array-like [component.unit; µm at a point]
        Errors as they are stated, wherever they come from.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> impossible_error(COMPONENTS["EBX"], [0.0, 12.5])
    ''
    >>> impossible_error(COMPONENTS["EBX"], [0.0, -12500.0])[:55]
    'expected errors within ±10000 µrad, got -12500 µrad: is'
    """
    values, largest = np.atleast_1d(np.asarray(errors, dtype=float)), largest_error(component)
    worst = float(values[np.abs(values).argmax()])
    if abs(worst) <= largest:
        return ""
    unit = (Unit.UM if component is None else component.unit).symbol
    return (
        f"expected errors within ±{largest:g} {unit}, got {worst:g} {unit}: is it in another unit, "
        "or is the nominal position still in it?"
    )


def positions_for_errors(positions_mm: ArrayLike, errors_um: ArrayLike) -> str:
    """Say that values are where an axis was, and not by how much it was wrong; empty if not.

    They follow the positions with a slope of 1, or −1 where an encoder counts the other way, or are
    the positions' own numbers, in mm. No axis is wrong by half of its way; a slope of 1 mm/m is.

    Parameters
    ----------
    positions_mm : array-like, shape (m,) [mm]
    errors_um : array-like, shape (m,) [µm]

    Examples
    --------
    >>> positions_for_errors([-4.88, 0.24, 5.36], [-4880.09, 239.93, 5359.9])[:59]
    'expected deviations in µm, actual less nominal, got a slope'
    >>> positions_for_errors([0.0, 500.0, 1000.0], [0.3, 499.8, 1000.4])
    ''
    """
    positions, errors = (np.asarray(values, dtype=float) for values in (positions_mm, errors_um))
    span = float(np.ptp(positions)) if positions.size else 0.0
    if span < SHORTEST_WAY_MM:
        return ""
    along, across = positions - positions.mean(), errors - errors.mean()
    slope = float(along @ across) / float(along @ along) / UM_PER_MM
    residual = across - slope * UM_PER_MM * along
    follows = abs(slope) > 0.5 and float(residual @ residual) < 0.01 * float(across @ across)
    is_in_mm = (
        span >= SHORTEST_IN_MM
        and positions.size > 2
        and min(np.abs(errors - positions).max(), np.abs(errors + positions).max()) < SAME_NUMBER
    )
    if not follows and not is_in_mm:
        return ""
    got = "the positions' own numbers" if is_in_mm else f"a slope of {slope:.3g} mm/mm over them"
    return (
        f"expected deviations in µm, actual less nominal, got {got}: these look like measured "
        f"positions{' in mm' if is_in_mm else ''}"
    )


@dataclass(frozen=True, eq=False)
class ComponentTable:
    """One component of one map: its errors over positions, or its single value.

    Parameters
    ----------
    component
        Which error it is; its unit is the unit of the values.
    positions_mm : ndarray, shape (n,) [mm]
        Strictly increasing; empty for a component that has no argument. One
        position means that the error does not depend on position.
    errors : ndarray, shape (n,), or (1,) without argument
        Actual minus nominal [component.unit]; approached in the positive direction, where
        that matters.
    backward_errors : ndarray, same shape, optional
        The errors when the position is approached in the negative direction.
    covariance, backward_covariance : ndarray, shape (n, n) or (n,), optional
        Covariance of the errors' own uncertainty (GUM), as the measurement left it
        [component.unit squared]; the variances alone where the errors are independent
        of each other, None where nobody stated it.

    Raises
    ------
    InvalidContent
        If something is not finite, not increasing, empty, or of unequal length.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None = None
    covariance: FloatArray | None = None
    backward_covariance: FloatArray | None = None

    @classmethod
    def make(
        cls,
        component: Component,
        errors: ArrayLike,
        positions_mm: ArrayLike = (),
        backward_errors: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        backward_covariance: ArrayLike | None = None,
    ) -> ComponentTable:
        """Make a table from anything array-like, checked.

        >>> from app.geometry.components import COMPONENTS
        >>> ComponentTable.make(COMPONENTS["EXX"], [0.0, 1.2], [0.0, 50.0]).errors.tolist()
        [0.0, 1.2]
        """
        return cls(
            component,
            frozen(positions_mm),
            frozen(errors),
            *(
                None if values is None else frozen(values)
                for values in (backward_errors, covariance, backward_covariance)
            ),
        )

    def __post_init__(self) -> None:
        self._check_positions()
        self._check_values(self.component.input_field, self.errors)
        if self.backward_errors is not None:
            if not self.component.is_table:
                raise InvalidContent.of_field(
                    self.backward_field,
                    f"{self.component.code} is one value and has no direction of approach",
                )
            self._check_values(self.backward_field, self.backward_errors)
        if self.backward_covariance is not None and self.backward_errors is None:
            raise InvalidContent.of_field(
                "backward_covariance",
                f"expected {self.backward_field} of {self.component.code} beside it, got none",
            )
        for name in ("covariance", "backward_covariance"):
            covariance = getattr(self, name)
            if covariance is not None:
                check_covariance(self.component, name, covariance, self.errors.size)

    @property
    def standard_errors(self) -> FloatArray | None:
        """Standard error of each value [component.unit], where it is known."""
        return None if self.covariance is None else standard_errors_of(self.covariance)

    @property
    def backward_standard_errors(self) -> FloatArray | None:
        """The same of the backward errors."""
        of = self.backward_covariance
        return None if of is None else standard_errors_of(of)

    @property
    def backward_field(self) -> str:
        """Name of the field in which a map states the backward errors."""
        return f"backward_{self.component.input_field}"

    @property
    def depends_on_position(self) -> bool:
        """Whether there is more than one position."""
        return self.positions_mm.size > 1

    def _check_positions(self) -> None:
        positions = self.positions_mm
        if not self.component.is_table:
            if positions.size:
                raise InvalidContent.of_field(
                    "positions_mm", f"{self.component.code} has no positions: it is one value"
                )
            return
        if positions.ndim != 1 or positions.size == 0:
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected at least one position of {self.component.code} in mm, got none",
            )
        if not np.isfinite(positions).all():
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected finite positions of {self.component.code} in mm, got "
                f"{_first_not_finite(positions)}",
            )
        wrong = np.flatnonzero(np.diff(positions) <= 0)
        if wrong.size:
            i = int(wrong[0])
            what = "twice" if positions[i] == positions[i + 1] else "out of order"
            raise InvalidContent.of_field(
                "positions_mm",
                f"expected strictly increasing positions of {self.component.code} in mm, got "
                f"{positions[i]:g} then {positions[i + 1]:g} ({what}, at index {i + 1})",
            )

    def _check_values(self, name: str, values: FloatArray) -> None:
        table = self.component.is_table
        expected = self.positions_mm.size if table else 1
        count = f"{expected} values" if table else "one value"
        each = ", one for each position" if table else ""
        unit = self.component.unit.symbol
        if values.ndim != 1 or values.size != expected:
            raise InvalidContent.of_field(
                name,
                f"expected {count} of {self.component.code} in {unit}{each}, got {values.size}",
            )
        if not np.isfinite(values).all():
            raise InvalidContent.of_field(
                name,
                f"expected finite values of {self.component.code} in {unit}, got "
                f"{_first_not_finite(values)}",
            )
        if np.abs(values).max() > VALUE_LIMIT:
            raise InvalidContent.of_field(
                name,
                f"expected errors within ±{VALUE_LIMIT:g} {unit}, got "
                f"{values[np.abs(values).argmax()]:g}",
            )


def _first_not_finite(values: FloatArray) -> str:
    """Say which value is not finite, and where."""
    i = int(np.flatnonzero(~np.isfinite(values))[0])
    return f"{values[i]:g} (at index {i})"


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """All components measured in one thermal state, with every sensor's temperature.

    Parameters
    ----------
    temperatures_c
        Sensor name to temperature at that time [°C].
    measuring_lines
        Axis to the line along which its translations were measured; absent where they
        are free of the rotations' effect.
    repeatability_um
        Stated repeatability of the measurement, one standard deviation [µm].
    """

    label: str
    measured_at: datetime
    temperatures_c: Mapping[str, float]
    tables: Mapping[str, ComponentTable]
    measuring_lines: MeasuringLines = field(default_factory=dict)
    repeatability_um: float | None = None
    instrument: str | None = None

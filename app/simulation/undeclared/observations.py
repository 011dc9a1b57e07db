"""Where and when errors are observed, and how the errors of components become values.

An observation is one component at a position of its axis, or a point of the work volume with a
tool. Its values are one number or three; all arrays of values run over the observations in
order of time and at points over x, y and z.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.simulation.undeclared.base_machine import CHAIN, BaseMachine
from app.simulation.undeclared.components import (
    AXES,
    CODES,
    COMPONENTS,
    BoolArray,
    FloatArray,
    IntArray,
)
from app.simulation.undeclared.history import History
from app.simulation.undeclared.kinematics import volumetric_error

POINT = -1
"""In place of a component's number: the observation is a point."""


@dataclass(frozen=True)
class Observations:
    """n observations.

    Parameters
    ----------
    time_min : ndarray, shape (n,) [min]
        Since the first reading.
    visit : ndarray of int, shape (n,)
        Number of the visit.
    component : ndarray of int, shape (n,)
        Place in `CODES`, or `POINT`.
    point_mm : ndarray, shape (n, 3) [mm]
        A component's line lies at 0 of the other axes.
    direction : ndarray, shape (n, 3)
        Direction of approach of each axis, +1 or −1; 0 for axes that do not move.
    tool_mm : ndarray, shape (n, 3) [mm]
        Tool offset; 0 on a component's line.
    """

    time_min: FloatArray
    visit: IntArray
    component: IntArray
    point_mm: FloatArray
    direction: FloatArray
    tool_mm: FloatArray

    def __len__(self) -> int:
        return self.time_min.size

    def __getitem__(self, chosen: BoolArray | IntArray) -> Observations:
        return Observations(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @property
    def is_point(self) -> BoolArray:
        """Which are points: shape (n,)."""
        are_points: BoolArray = self.component == POINT
        return are_points

    def of(self, code: str) -> BoolArray:
        """Which are observations of a component: shape (n,)."""
        are_of: BoolArray = self.component == CODES.index(code)
        return are_of

    def without(self, codes: Collection[str]) -> Observations:
        """Leave components' lines out: what no map has cannot be compared with one."""
        left_out = [CODES.index(code) for code in codes]
        return self[~np.isin(self.component, left_out)]

    @property
    def of_value(self) -> IntArray:
        """The observation that each value belongs to: shape (m,)."""
        return np.repeat(np.arange(len(self)), np.where(self.is_point, 3, 1))

    def shaped(self, values: ArrayLike) -> list[float | list[float]]:
        """Give values, shape (m,), the observations' shape: a number each, three for a point."""
        plain = np.asarray(values).tolist()
        nested: list[float | list[float]] = []
        place = 0
        for is_point in self.is_point.tolist():
            nested.append(plain[place : place + 3] if is_point else plain[place])
            place += 3 if is_point else 1
        return nested

    @property
    def coordinate(self) -> IntArray:
        """0, 1, 2 for a point's x, y, z; −1 for a component's value: shape (m,)."""
        coordinate = np.full(self.of_value.size, -1)
        coordinate[self.is_point[self.of_value]] = np.tile(np.arange(3), int(self.is_point.sum()))
        return coordinate

    @property
    def group(self) -> np.ndarray:
        """What each value is of: a component's code, or x, y, z of points: shape (m,)."""
        names = np.array([*CODES, *AXES])
        of_component = self.component[self.of_value]
        return names[np.where(of_component == POINT, len(CODES) + self.coordinate, of_component)]

    @property
    def value_visit(self) -> IntArray:
        """Visit of each value: shape (m,)."""
        return self.visit[self.of_value]


@dataclass(frozen=True)
class Circumstances:
    """What an error may depend on: the observations, and the machine's history."""

    observations: Observations
    history: History

    @property
    def time_min(self) -> FloatArray:
        """When [min]."""
        return self.observations.time_min

    @property
    def point_mm(self) -> FloatArray:
        """Where, shape (n, 3) [mm]."""
        return self.observations.point_mm

    def temperature(self, sensor: str) -> FloatArray:
        """True temperature where a sensor sits [°C]."""
        return self.history.temperature(sensor, self.time_min)

    def state(self, name: str) -> FloatArray:
        """State of the machine as it is logged."""
        return self.history.hold(self.history.state[name], self.time_min)

    def at(self, series: FloatArray) -> FloatArray:
        """Interpolate a series of the history's minutes."""
        return self.history.at(series, self.time_min)


ErrorFunction: TypeAlias = Callable[[Circumstances], FloatArray]
"""An error of one component under n circumstances: shape (n,) [the component's unit]."""


def evaluate(
    errors: Mapping[str, ErrorFunction], observations: Observations, history: History
) -> FloatArray:
    """Work out what the components' errors are in the observed values.

    Parameters
    ----------
    errors : mapping of component to function
        The components that have an error; the others have none.

    Returns
    -------
    ndarray, shape (m,)
        Values in each component's unit, at points µm.
    """
    values = np.zeros((len(observations), 3))
    points = observations[observations.is_point]
    at_points = {}
    for code, error in errors.items():
        here = observations.of(code)
        values[here, 0] = error(Circumstances(observations[here], history))
        at_points[code] = error(Circumstances(points, history))
    values[observations.is_point] = volumetric_error(
        CHAIN, at_points, points.point_mm, points.tool_mm
    )
    return values[observations.of_value, np.maximum(observations.coordinate, 0)]


def true_errors(machine: BaseMachine) -> dict[str, ErrorFunction]:
    """Each component's error at the true temperature of its sensor."""

    def of(code: str) -> ErrorFunction:
        component, table = COMPONENTS[code], machine.table(code)

        def error(circumstances: Circumstances) -> FloatArray:
            position = circumstances.point_mm[:, component.axis or 0]
            return table.at(position, circumstances.temperature(component.sensor))

        return error

    return {code: of(code) for code in machine.measured_codes}

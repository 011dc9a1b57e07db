"""The machine's true errors without any effect that the model lacks.

Each of the 21 errors is a geometric part and a thermal part. The thermal part is linear in the
assigned sensor's temperature between the maps' temperatures, with a different slope on either
side of a map, and everything is linear between the maps' positions: so error maps without
measurement error say exactly what this machine does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from app.simulation.undeclared.components import (
    AXES,
    COMPONENTS,
    MM_PER_M,
    Component,
    FloatArray,
)
from app.simulation.undeclared.error_tables import ErrorTable

CHAIN: Final = "XYFZ"
TRAVELS_MM: Final = (800.0, 500.0, 500.0)
"""Travels of X, Y and Z, from 0."""

POSITIONS: Final = 11
"""Positions of each table, from end to end of the travel."""


@dataclass(frozen=True)
class BaseMachine:
    """A machine of an XYFZ chain.

    Parameters
    ----------
    map_temperatures_c : mapping of sensor to ndarray, shape (M,) [°C]
        Each sensor's temperatures in the maps' thermal states, increasing.
    geometric : mapping of component to ndarray, shape (P,)
        Errors in the middle thermal state.
    thermal : mapping of component to ndarray, shape (M, P)
        What each thermal state adds, for a sensitivity of 1.
    sensitivities : mapping of component to float
        Factor on the thermal part, 1 where left out.
    unmeasured
        Components that the maps do not have: here they are zero.
    """

    map_temperatures_c: Mapping[str, FloatArray]
    geometric: Mapping[str, FloatArray]
    thermal: Mapping[str, FloatArray]
    sensitivities: Mapping[str, float] = field(default_factory=dict)
    unmeasured: frozenset[str] = frozenset()

    def table(self, code: str) -> ErrorTable:
        """Return a component's true errors."""
        errors = self.geometric[code] + self.sensitivities.get(code, 1.0) * self.thermal[code]
        if code in self.unmeasured:
            errors = np.zeros(errors.shape)
        temperatures = self.map_temperatures_c[COMPONENTS[code].sensor]
        return ErrorTable(temperatures, positions_of(code), errors)

    @property
    def measured_codes(self) -> tuple[str, ...]:
        """The components that the maps have."""
        return tuple(code for code in self.geometric if code not in self.unmeasured)

    def with_sensitivities(self, factors: Mapping[str, float]) -> BaseMachine:
        """Make some components' thermal parts larger or smaller."""
        sensitivities = self.sensitivities
        changed = {code: sensitivities.get(code, 1.0) * factor for code, factor in factors.items()}
        return replace(self, sensitivities={**sensitivities, **changed})

    def without(self, codes: frozenset[str]) -> BaseMachine:
        """Leave components out of the machine and its maps."""
        return replace(self, unmeasured=self.unmeasured | codes)


def positions_of(code: str) -> FloatArray:
    """Positions of a component's table [mm]; one for a squareness."""
    axis = COMPONENTS[code].axis
    return np.zeros(1) if axis is None else np.linspace(0.0, TRAVELS_MM[axis], POSITIONS)


def normalised(code: str, position_mm: FloatArray) -> FloatArray:
    """Count positions from −1 at one end of the component's travel to 1 at the other."""
    axis = COMPONENTS[code].axis
    if axis is None:
        return np.zeros(np.shape(position_mm))
    u: FloatArray = 2.0 * position_mm / TRAVELS_MM[axis] - 1.0
    return u


def make_machine(
    rng: np.random.Generator, map_temperatures_c: Mapping[str, FloatArray]
) -> BaseMachine:
    """Draw a machine.

    Parameters
    ----------
    map_temperatures_c : mapping of sensor to ndarray, shape (M,) [°C]
    """
    geometric, thermal = {}, {}
    for code, component in COMPONENTS.items():
        geometric[code] = _geometric(rng, component)
        slope = _per_kelvin(rng, component)
        rise = _bent_rise(rng, map_temperatures_c[component.sensor])
        thermal[code] = np.outer(rise, slope)
    return BaseMachine(map_temperatures_c, geometric, thermal)


def _bent_rise(rng: np.random.Generator, temperatures_c: FloatArray) -> FloatArray:
    """Temperatures above the middle map, each interval stretched by its own factor [K]."""
    steps = np.diff(temperatures_c) * (1.0 + 0.15 * rng.standard_normal(temperatures_c.size - 1))
    rise = np.concatenate([[0.0], np.cumsum(steps)])
    above: FloatArray = rise - rise[temperatures_c.size // 2]
    return above


def _geometric(rng: np.random.Generator, component: Component) -> FloatArray:
    """Draw a smooth profile [the component's unit]: some µm, µrad, or ten µm/m."""
    if component.axis is None:
        return 10.0 * rng.standard_normal(1)
    u = normalised(component.code, positions_of(component.code))
    is_displacement = component.row == component.axis
    linear, curved, wave = (4.0, 2.0, 1.5) if is_displacement else (1.5, 1.5, 0.7)
    phase = rng.uniform(0.0, 2 * np.pi)
    a, b, c = rng.standard_normal(3)
    smooth: FloatArray = linear * a * u + curved * b * (u**2 - 1 / 3)
    return smooth + wave * float(c) * np.sin(np.pi * u + phase)


def _per_kelvin(rng: np.random.Generator, component: Component) -> FloatArray:
    """Draw what a kelvin adds [the component's unit/K], never next to nothing."""
    if component.axis is None:
        return np.atleast_1d(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 2.0))
    positions = positions_of(component.code)
    u = normalised(component.code, positions)
    if component.row == component.axis:
        # A screw of steel, fixed somewhere near one end: 11.5 µm/(m·K), partly on scales.
        expansion = rng.uniform(5.0, 11.0)
        fixed = rng.uniform(0.0, 0.3) * TRAVELS_MM[component.axis]
        growth: FloatArray = expansion * (positions - fixed) / MM_PER_M
        return growth + float(rng.uniform(-0.4, 0.4))
    a, b, c = rng.standard_normal(3)
    sign = rng.choice([-1.0, 1.0])
    level, linear, curved = (0.35, 0.35, 0.25) if component.is_rotation else (0.3, 0.4, 0.3)
    smooth: FloatArray = linear * b * u + curved * c * (u**2 - 1 / 3)
    return smooth + float(sign * (0.25 + level * abs(a)))


def machine_body(identifier: str, name: str, sensors: list[dict[str, object]]) -> dict[str, object]:
    """Describe the machine as the service takes it.

    Parameters
    ----------
    identifier, name
        For URLs, and for people.
    """
    return {
        "id": identifier,
        "name": name,
        "configuration": CHAIN,
        "axes": {
            axis: {"min_mm": 0.0, "max_mm": travel}
            for axis, travel in zip(AXES, TRAVELS_MM, strict=True)
        },
        "sensors": sensors,
        "out_of_range": "clamp",
        "extrapolation_margin_c": 5.0,
    }

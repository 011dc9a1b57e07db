"""How an effect looks along an axis: what its driver is multiplied by at each position.

Shapes of position alone have no unit. `Sensitivity` and `Exchange` are made of the model's
own maps and carry the component's unit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar, Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.effects.conditions import Conditions
from app.effects.map_tables import MapReading, elsewhere, scale_by, slope
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, Member
from app.thermal.map_weights import read_maps
from app.thermal.resampling import hat_weights

# At a crest a polygon of n corners a pitch lies up to 1 − cos(π/n) below its sine.
POINTS_A_PITCH: Final = 16
"""A polygon of so many corners a pitch is within 2 % of its sine."""

FEWEST_A_PITCH: Final = 8
"""With so many it is within 8 %; with fewer it is another curve."""

MOST_POINTS: Final = 4001
"""A table is not made finer than so many positions."""


class Places(NamedTuple):
    """Where one axis stands, and from which side it came: shape (n,) each.

    `positions_mm` are NaN and `directions` 0 where there is no such axis.
    """

    positions_mm: FloatArray
    directions: FloatArray


@dataclass(frozen=True)
class Shape(ABC):
    """A dependence on position, and for fingerprints on temperature."""

    name: ClassVar[str]
    changes_along: ClassVar[bool] = False
    """Whether it was learnt along the axis: not where it is the same everywhere, or the maps'."""

    @abstractmethod
    def along(
        self,
        model: CompiledModel,
        component: str,
        places: Places,
        conditions: Conditions,
        driver: FloatArray,
    ) -> FloatArray:
        """Give the error for the driver's value.

        Parameters
        ----------
        driver : ndarray, shape (n,)

        Returns
        -------
        ndarray, shape (n,)
            Driver times shape.
        """

    def nodes_mm(self, low_mm: float, high_mm: float) -> FloatArray:
        """Give the positions that a table needs to show this shape [mm]; none as it is."""
        return np.empty(0)

    def why_no_table(self, low_mm: float, high_mm: float) -> str:
        """Say why no table can show this shape, empty where one can."""
        return ""

    def why_missing(self, model: CompiledModel, component: str) -> str:
        """Say what this shape lacks in a model, empty where nothing."""
        return ""


class OfPosition(Shape):
    """Of the position alone: nothing of the model enters."""

    @abstractmethod
    def factors(self, positions_mm: FloatArray) -> FloatArray:
        """Give what the driver is multiplied by at positions, which are NaN without an axis."""

    def along(
        self,
        model: CompiledModel,
        component: str,
        places: Places,
        conditions: Conditions,
        driver: FloatArray,
    ) -> FloatArray:
        """Give the driver times the factor."""
        values: FloatArray = driver * self.factors(places.positions_mm)
        return values


@dataclass(frozen=True)
class Everywhere(OfPosition):
    """The same at all positions."""

    name: ClassVar[str] = "everywhere"

    def factors(self, positions_mm: FloatArray) -> FloatArray:
        """Give 1, also where there is no axis."""
        return np.ones(positions_mm.shape)


@dataclass(frozen=True)
class Rising(OfPosition):
    """A straight line: −1 at one end of the travel, 0 in its middle, +1 at the other end."""

    name: ClassVar[str] = "rising"
    changes_along: ClassVar[bool] = True
    middle_mm: float
    half_mm: float

    def factors(self, positions_mm: FloatArray) -> FloatArray:
        """Give (position − middle) / half."""
        return (positions_mm - self.middle_mm) / self.half_mm

    def nodes_mm(self, low_mm: float, high_mm: float) -> FloatArray:
        """Need both ends."""
        return np.array([low_mm, high_mm])


@dataclass(frozen=True)
class Wave(OfPosition):
    """A sine or a cosine over position, counted from position 0."""

    name: ClassVar[str] = "wave"
    changes_along: ClassVar[bool] = True
    pitch_mm: float
    is_cosine: bool

    def factors(self, positions_mm: FloatArray) -> FloatArray:
        """Give the sine or cosine of 2π position / pitch."""
        wave = np.cos if self.is_cosine else np.sin
        harmonic: FloatArray = wave(2.0 * np.pi * (positions_mm / self.pitch_mm))
        return harmonic

    def nodes_mm(self, low_mm: float, high_mm: float) -> FloatArray:
        """Need sixteen positions in each pitch, or as many as a table may have."""
        count = self._corners(high_mm - low_mm, POINTS_A_PITCH)
        return np.linspace(low_mm, high_mm, min(max(count, 2), MOST_POINTS))

    def why_no_table(self, low_mm: float, high_mm: float) -> str:
        """Say that the pitch is too short for the travel."""
        count = self._corners(high_mm - low_mm, FEWEST_A_PITCH)
        if count <= MOST_POINTS:
            return ""
        return (
            f"its pitch of {self.pitch_mm:.4g} mm needs {count} positions over "
            f"{high_mm - low_mm:g} mm of travel, more than the {MOST_POINTS} that a table may "
            "have: ask for predictions at points instead, which contain it exactly"
        )

    def _corners(self, span_mm: float, a_pitch: int) -> int:
        return int(np.ceil(span_mm / self.pitch_mm * a_pitch)) + 1


@dataclass(frozen=True)
class Profile(OfPosition):
    """A polygon over positions, its end values beyond them."""

    name: ClassVar[str] = "profile"
    changes_along: ClassVar[bool] = True
    positions_mm: tuple[float, ...]
    heights: tuple[float, ...]

    def factors(self, positions_mm: FloatArray) -> FloatArray:
        """Give the polygon."""
        left, right, share = hat_weights(np.array(self.positions_mm), positions_mm)
        heights = np.array(self.heights)
        interpolated: FloatArray = (1.0 - share) * heights[left] + share * heights[right]
        return interpolated

    def nodes_mm(self, low_mm: float, high_mm: float) -> FloatArray:
        """Need the polygon's corners."""
        return np.array(self.positions_mm)


class OfMaps(Shape):
    """Made of the component's own maps: it changes how much of each of them enters."""

    @abstractmethod
    def reading(
        self, model: CompiledModel, component: str, conditions: Conditions, driver: FloatArray
    ) -> MapReading | None:
        """Say how much of each map is added for the driver's value.

        Returns
        -------
        MapReading, or None
            None where the model does not have what it is made of (`why_missing`).
        """

    def along(
        self,
        model: CompiledModel,
        component: str,
        places: Places,
        conditions: Conditions,
        driver: FloatArray,
    ) -> FloatArray:
        """Read the maps that enter: outside what all of them cover, the end values hold."""
        located = model.find(component)
        reading = self.reading(model, component, conditions, driver)
        if located is None or reading is None:
            return np.full(driver.shape, np.nan)
        return read_maps(*located, reading.weights, *places)


@dataclass(frozen=True)
class Sensitivity(OfMaps):
    """The model's own change of a component with its sensor's temperature.

    Parameters
    ----------
    is_local
        True: the derivative at the present temperature, times the driver. False: E at the
        temperature that lies by the driver [K] from it, minus E at the present one, which is
        right also where a map lies between the two.
    in_maps_k
        Of a moved temperature: label, and by how much that map's own temperature is moved too [K];
        0 for maps left out. What follows its sensor late was so far behind it when the map was
        measured.
    """

    name: ClassVar[str] = "sensitivity"
    is_local: bool
    in_maps_k: tuple[tuple[str, float], ...] = ()

    def reading(
        self, model: CompiledModel, component: str, conditions: Conditions, driver: FloatArray
    ) -> MapReading | None:
        """Give dE/dT times the driver, or E(T + driver) − E(T)."""
        located = model.find(component)
        if located is None:
            return None
        group, member = located
        now_c = conditions.temperature(group.sensor)
        if self.is_local:
            return slope(model, group, now_c, driver)
        on: Group | None = group
        if self.why_missing(model, component):
            return None
        if self.in_maps_k:
            on = _on_scale(group, member, group.sensor, self._in_maps_c(group))
        if on is None:
            return None
        return elsewhere(model, group, on, now_c, now_c + driver)

    def why_missing(self, model: CompiledModel, component: str) -> str:
        """Say that the model lacks the component, or which two maps cannot be neighbours."""
        located = model.find(component)
        if located is None:
            return f"the model has no {component}"
        if not self.in_maps_k:
            return ""
        group, member = located
        return _why_no_neighbours(model, group, member, group.sensor, self._in_maps_c(group))

    def readable(self, model: CompiledModel, component: str) -> Sensitivity:
        """Leave the maps at their own temperatures where these, moved, could not be told apart."""
        return replace(self, in_maps_k=()) if self.why_missing(model, component) else self

    def _in_maps_c(self, group: Group) -> dict[str, float]:
        """Give the temperature at which each map is read where the present one is moved [°C]."""
        scale, by_k = group.scales[0], dict(self.in_maps_k)
        noted = (
            (group.labels[r], t) for r, t in zip(scale.rows, scale.temperatures_c, strict=True)
        )
        return {label: t + by_k.get(label, 0.0) for label, t in noted}


@dataclass(frozen=True)
class Exchange(OfMaps):
    """The same maps read by another sensor, minus what they say by the assigned one.

    Parameters
    ----------
    map_temperatures_c
        Label and the other sensor's temperature of each map [°C].
    """

    name: ClassVar[str] = "exchange"
    sensor: str
    map_temperatures_c: tuple[tuple[str, float], ...]

    @classmethod
    def of(cls, sensor: str, map_temperatures_c: Mapping[str, float]) -> Exchange:
        """Make one from a mapping of labels."""
        return cls(sensor, tuple(map_temperatures_c.items()))

    def by_other(self, model: CompiledModel, component: str) -> Group | None:
        """Put a component by itself on the other sensor's scale; None where that cannot be.

        On a scale of its own the sensor is followed, and stands in for none.
        """
        located = model.find(component)
        if located is None or self.why_missing(model, component):
            return None
        return _on_scale(*located, self.sensor, dict(self.map_temperatures_c))

    def reading(
        self, model: CompiledModel, component: str, conditions: Conditions, driver: FloatArray
    ) -> MapReading | None:
        """Give the driver times E by the other sensor minus E by the assigned one."""
        located, by_other = model.find(component), self.by_other(model, component)
        if located is None or by_other is None:
            return None
        group, _ = located
        own_c, others_c = (conditions.temperature(s) for s in (group.sensor, self.sensor))
        reading = elsewhere(model, group, by_other, own_c, others_c, is_followed=True)
        return reading.times(driver)

    def why_missing(self, model: CompiledModel, component: str) -> str:
        """Say which map does not state the other sensor, or which two cannot be neighbours."""
        located = model.find(component)
        if located is None:
            return f"the model has no {component}"
        group, member = located
        in_maps_c = dict(self.map_temperatures_c)
        lacking = [label for label in group.labels if label not in in_maps_c]
        if lacking:
            return (
                f"map {lacking[0]!r} was made after the analysis, so what {self.sensor} read "
                "is not known"
            )
        return _why_no_neighbours(model, group, member, self.sensor, in_maps_c)


def _on_scale(
    group: Group, member: Member, sensor: str, in_maps_c: Mapping[str, float]
) -> Group | None:
    """Put a component by itself on a scale; None where that cannot be."""
    scale = scale_by(group, sensor, in_maps_c)
    return None if scale is None else group.on_scale(scale, member)


def _why_no_neighbours(
    model: CompiledModel,
    group: Group,
    member: Member,
    sensor: str,
    in_maps_c: Mapping[str, float],
) -> str:
    """Say which two maps cannot be neighbours on a scale, empty where all can.

    Those that the sensor cannot tell apart, and those that have no positions in common.
    """
    resolves = model.machine.sensor(sensor).resolves
    in_order = sorted(range(len(group.labels)), key=lambda row: in_maps_c[group.labels[row]])
    for rows in pairwise(in_order):
        lower, upper = (group.labels[row] for row in rows)
        gap_c = in_maps_c[upper] - in_maps_c[lower]
        if not resolves(gap_c):
            return (
                f"maps {lower!r} and {upper!r} are only {gap_c:.2g} °C apart at "
                f"{sensor}, too close for that sensor to resolve"
            )
        low, high = member.common_range(rows)
        if low >= high:
            return (
                f"maps {lower!r} and {upper!r}, neighbours in the temperature of "
                f"{sensor}, share no range of positions of {member.component.code}"
            )
    return ""


SHAPES: Final[dict[str, type[Shape]]] = {
    kind.name: kind for kind in (Everywhere, Rising, Wave, Profile, Sensitivity, Exchange)
}
"""Every shape by the name under which it is stored."""

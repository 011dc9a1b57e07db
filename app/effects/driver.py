"""What drives an effect: a number at each moment, made of temperatures, states and time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.effects.conditions import Conditions, Signal
from app.units import SECONDS_PER_DAY, SECONDS_PER_MIN, unit_of_field


class Quantity(NamedTuple):
    """A driver in words: what it is, its unit, and what is to be added to it before it is told."""

    name: str
    unit: str
    zero: float = 0.0


@dataclass(frozen=True)
class Driver(ABC):
    """Something that changes with the conditions; equal drivers are the same."""

    name: ClassVar[str]
    grows_with_time: ClassVar[bool] = False

    @abstractmethod
    def at(self, conditions: Conditions) -> FloatArray:
        """Give the driver at n moments, shape (n,); NaN where a condition is missing."""

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """What it is made of, and with which time constant [s]."""
        return ()

    @property
    def is_held_by_signal(self) -> bool:
        """Whether it is held by holding what it is made of; otherwise its own range holds it.

        A difference of two signals is learnt as a difference: one of them held alone would
        change it although it may be one that was seen.
        """
        return len(self.signals) < 2

    @property
    def holds_itself(self) -> bool:
        """Whether it stays by itself within what it was learnt in."""
        return False

    @property
    def is_signal(self) -> bool:
        """Whether it is made of one signal as it is now, whose range says where it was learnt."""
        return [tau_s for _, tau_s in self.signals] == [None]

    @property
    def quantity(self) -> Quantity | None:
        """What it is, in words; None where that says nothing by itself."""
        return None

    def with_maps(self, learnt: tuple[float, float]) -> tuple[float, float]:
        """Widen the range of its values in which it was learnt by what the maps know of it."""
        return learnt

    def until_maps(self, learnt_c: tuple[float, float]) -> tuple[float, float]:
        """Widen the range of its sensor's temperature likewise [°C]."""
        return learnt_c

    def why_missing(self, conditions: Conditions) -> str:
        """Say which condition is missing where the driver is NaN."""
        for signal, tau_s in self.signals:
            present = conditions.temperature if signal.kind == "temperature" else conditions.state
            values = present(signal.name) if tau_s is None else conditions.lagged(signal, tau_s)
            if np.isnan(values).any():
                return conditions.why_missing(signal, tau_s)
        return ""


def _read(conditions: Conditions, sensor: str, time_constant_s: float | None) -> FloatArray:
    """Give a sensor's temperature, or its low-pass, shape (n,) [°C]."""
    if time_constant_s is None:
        return conditions.temperature(sensor)
    return conditions.lagged(Signal("temperature", sensor), time_constant_s)


def _along(t: FloatArray, scale: tuple[float, ...], values: Sequence[float]) -> FloatArray:
    """Interpolate between temperatures; beyond the outermost go on along the last two."""
    nodes, heights = np.array(scale), np.array(values)
    if nodes.size < 2:
        return np.where(np.isnan(t), np.nan, heights[0])
    lower = np.clip(np.searchsorted(nodes, t, side="right") - 1, 0, nodes.size - 2)
    slope = np.diff(heights) / np.diff(nodes)
    interpolated: FloatArray = heights[lower] + slope[lower] * (t - nodes[lower])
    return interpolated


def _with_zero(learnt: tuple[float, float]) -> tuple[float, float]:
    return min(learnt[0], 0.0), max(learnt[1], 0.0)


def _late(time_constant_s: float | None) -> str:
    """Say how late something follows; empty where it follows at once."""
    return "" if time_constant_s is None else f" {time_constant_s / SECONDS_PER_MIN:.3g} min late"


@dataclass(frozen=True)
class Always(Driver):
    """One, always."""

    name: ClassVar[str] = "always"

    def at(self, conditions: Conditions) -> FloatArray:
        """Give 1."""
        return np.ones(len(conditions))


@dataclass(frozen=True)
class AboveReference(Driver):
    """A sensor's temperature above a fixed one [K], at once or through a low-pass."""

    name: ClassVar[str] = "above-reference"
    sensor: str
    reference_c: float
    time_constant_s: float | None = None

    def at(self, conditions: Conditions) -> FloatArray:
        """Give T − reference [K], or T_lag − reference."""
        return _read(conditions, self.sensor, self.time_constant_s) - self.reference_c

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """The sensor, or its past."""
        return ((Signal("temperature", self.sensor), self.time_constant_s),)

    @property
    def quantity(self) -> Quantity:
        """The sensor, or its low-pass."""
        return Quantity(f"{self.sensor}{_late(self.time_constant_s)}", "°C", self.reference_c)


@dataclass(frozen=True)
class Behind(Driver):
    """How far a low-pass of a sensor lies from the sensor itself [K]."""

    name: ClassVar[str] = "behind"
    sensor: str
    time_constant_s: float

    def at(self, conditions: Conditions) -> FloatArray:
        """Give T_lag − T [K]: negative while the sensor warms up."""
        lagged = conditions.lagged(Signal("temperature", self.sensor), self.time_constant_s)
        return lagged - conditions.temperature(self.sensor)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """The sensor now, and its past."""
        signal = Signal("temperature", self.sensor)
        return ((signal, None), (signal, self.time_constant_s))

    def with_maps(self, learnt: tuple[float, float]) -> tuple[float, float]:
        """Reach as far to the other side of 0, where in balance the maps are right.

        What it is multiplied by is made of the maps, and a low-pass is linear: a body that was seen
        to be late while it warmed up cools down as late.
        """
        farthest = max(map(abs, learnt))
        return -farthest, farthest

    @property
    def quantity(self) -> Quantity:
        """The lag."""
        return Quantity(f"{self.sensor}{_late(self.time_constant_s)} minus {self.sensor}", "K")


@dataclass(frozen=True)
class Difference(Driver):
    """The difference of two sensors, above what it was on average, times a height [K].

    At once, or through a low-pass: that of the difference, as both have one time constant.
    """

    name: ClassVar[str] = "difference"
    sensor: str
    minus: str
    reference_k: float
    height: float = 1.0
    time_constant_s: float | None = None

    def at(self, conditions: Conditions) -> FloatArray:
        """Give T_a − T_b − reference, times the height [K]."""
        warm, cold = (_read(conditions, s, self.time_constant_s) for s in (self.sensor, self.minus))
        return self.height * (warm - cold - self.reference_k)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """Both sensors, or their past."""
        return (
            (Signal("temperature", self.sensor), self.time_constant_s),
            (Signal("temperature", self.minus), self.time_constant_s),
        )

    @property
    def quantity(self) -> Quantity:
        """The difference itself."""
        named = f"{self.sensor} minus {self.minus}{_late(self.time_constant_s)}"
        if self.height != 1.0:
            return Quantity(
                f"{self.height:.3g} times ({named})", "K", self.height * self.reference_k
            )
        return Quantity(named, "K", self.reference_k)


@dataclass(frozen=True)
class BeyondMaps(Driver):
    """How far a temperature, or a difference of two, is from what it was in the maps [K].

    What a second sensor did while the maps were measured is inside them: at any temperature of
    the component's own sensor the model interpolates it along. Only the rest is lacking.

    Parameters
    ----------
    sensor, minus
        The sensor, and the one that is subtracted, or an empty name.
    in_maps_c
        In each map, in the order of the own sensor's temperature: that temperature, and what
        the sensor or the difference was [°C; °C or K].
    time_constant_s
        Of what follows the sensor or the difference late; None: at once. `in_maps_c` then has
        what was followed when the maps were measured: what they state, where it had settled.
    goes_on
        Whether the machine extrapolates its maps: what they have of the second sensor then goes on
        beyond them too; else it stays as it was in the outermost.
    """

    name: ClassVar[str] = "beyond-maps"
    sensor: str
    minus: str
    own: str
    in_maps_c: tuple[tuple[float, float], ...]
    time_constant_s: float | None = None
    goes_on: bool = False

    def at(self, conditions: Conditions) -> FloatArray:
        """Give T, or T_lag, less T in the maps at the own sensor's temperature [K]."""
        value = _read(conditions, self.sensor, self.time_constant_s)
        if self.minus:
            value = value - _read(conditions, self.minus, self.time_constant_s)
        beyond: FloatArray = value - self._in_maps(conditions.temperature(self.own))
        return beyond

    def _in_maps(self, own_c: FloatArray) -> FloatArray:
        scale, there = zip(*self.in_maps_c, strict=True)
        return _along(own_c if self.goes_on else np.clip(own_c, scale[0], scale[-1]), scale, there)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """All sensors; of what is late their past, and the own sensor as it is."""
        late = ((name, self.time_constant_s) for name in (self.sensor, self.minus) if name)
        return tuple((Signal("temperature", name), tau) for name, tau in (*late, (self.own, None)))

    def with_maps(self, learnt: tuple[float, float]) -> tuple[float, float]:
        """Include 0: there the maps are right."""
        return _with_zero(learnt)

    @property
    def quantity(self) -> Quantity:
        """How far from the maps."""
        what = f"{self.sensor} minus {self.minus}" if self.minus else self.sensor
        late = _late(self.time_constant_s)
        return Quantity(f"{what}{late} above what it was in the maps", "K")

    def moved(self, learnt: tuple[float, float], other: BeyondMaps) -> tuple[float, float]:
        """Say where another one lies wherever this one lay in a range: what the maps moved by.

        Both are straight between their nodes, so their difference is largest at one of them.
        """
        at = np.unique([t for driver in (self, other) for t, _ in driver.in_maps_c])
        by = self._in_maps(at) - other._in_maps(at)
        return learnt[0] + float(by.min()), learnt[1] + float(by.max())


@dataclass(frozen=True)
class Curvature(Driver):
    """What a parabola in temperature does between fixed temperatures, zero at each of them [K²].

    With the temperatures of all maps it is how far a parabola is from its chords, each between two
    neighbouring maps: what linear interpolation lacks though every map is right. Beyond the
    outermost it is how far the parabola is from the line of the last two, on which an extrapolated
    table goes on. With the first and the last alone it is one parabola over the whole range.
    """

    name: ClassVar[str] = "curvature"
    sensor: str
    temperatures_c: tuple[float, ...]

    def at(self, conditions: Conditions) -> FloatArray:
        """Give (T − T_n)(T − T_m) of the neighbours T_n, T_m, beyond the ends of the last two [K²].

        Where the machine does not extrapolate it is not learnt there, and held at the edge.
        """
        scale, t = np.array(self.temperatures_c), conditions.temperature(self.sensor)
        lower = np.clip(np.searchsorted(scale, t, side="right") - 1, 0, scale.size - 2)
        product: FloatArray = (t - scale[lower]) * (t - scale[lower + 1])
        return product

    def with_maps(self, learnt: tuple[float, float]) -> tuple[float, float]:
        """Include 0, which it is at every map."""
        return _with_zero(learnt)

    def until_maps(self, learnt_c: tuple[float, float]) -> tuple[float, float]:
        """Reach to the next map on either side: it is 0 there, as every map is right.

        Held at the edge of the observations, it would add to a map what is nowhere larger than
        half way to it.
        """
        low, high = learnt_c
        below = [t for t in self.temperatures_c if t <= low]
        above = [t for t in self.temperatures_c if t >= high]
        return max(below, default=low), min(above, default=high)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """The sensor."""
        return ((Signal("temperature", self.sensor), None),)

    @property
    def quantity(self) -> Quantity:
        """The parabola."""
        return Quantity(f"curvature over {self.sensor}", "K²")


@dataclass(frozen=True)
class ShareOfMap(Driver):
    """How much one map counts in a table: 1 at its temperature, 0 at its neighbours.

    Beyond the outermost maps it goes on along the line of the last two, as extrapolated tables do;
    where the machine's policy holds these, what was learnt holds it too.

    Parameters
    ----------
    temperatures_c
        Of the component's maps, increasing, of its own sensor [°C].
    map_c
        Which of them is meant.
    """

    name: ClassVar[str] = "share-of-map"
    sensor: str
    temperatures_c: tuple[float, ...]
    map_c: float

    def at(self, conditions: Conditions) -> FloatArray:
        """Give the map's weight in the interpolation (eq. 8.105)."""
        heights = [float(t == self.map_c) for t in self.temperatures_c]
        return _along(conditions.temperature(self.sensor), self.temperatures_c, heights)

    def with_maps(self, learnt: tuple[float, float]) -> tuple[float, float]:
        """Include 0, which it is at every other map."""
        return _with_zero(learnt)

    def until_maps(self, learnt_c: tuple[float, float]) -> tuple[float, float]:
        """Reach to the last map on the sides where it falls to zero: the others are right."""
        low, high = learnt_c
        return (
            min(low, self.temperatures_c[0]) if low <= self.map_c else low,
            max(high, self.temperatures_c[-1]) if high >= self.map_c else high,
        )

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """The sensor."""
        return ((Signal("temperature", self.sensor), None),)


@dataclass(frozen=True)
class State(Driver):
    """A power of a state of the machine, at once or through a low-pass."""

    name: ClassVar[str] = "state"
    state: str
    power: int = 1
    time_constant_s: float | None = None

    def at(self, conditions: Conditions) -> FloatArray:
        """Give x^power, or its low-pass."""
        if self.time_constant_s is None:
            present: FloatArray = conditions.state(self.state) ** self.power
            return present
        return conditions.lagged(self._signal, self.time_constant_s)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """The state, and its past if that matters."""
        return ((self._signal, self.time_constant_s),)

    @property
    def quantity(self) -> Quantity:
        """The state, or its low-pass."""
        square = "the square of " if self.power == 2 else ""
        unit = unit_of_field(self.state) or ""
        unit = f"({unit})²" if unit and self.power == 2 else unit
        return Quantity(f"{square}{self.state}{_late(self.time_constant_s)}", unit)

    @property
    def _signal(self) -> Signal:
        return Signal("state", self.state, self.power)


@dataclass(frozen=True)
class SinceReference(Driver):
    """Time since a fixed moment [days], times a height."""

    name: ClassVar[str] = "since-reference"
    grows_with_time: ClassVar[bool] = True
    reference_time_s: float
    height: float = 1.0

    def at(self, conditions: Conditions) -> FloatArray:
        """Give the time since then [days], negative before, times the height."""
        return (conditions.times_s - self.reference_time_s) * (self.height / SECONDS_PER_DAY)


@dataclass(frozen=True)
class StepAfter(Driver):
    """Zero before a moment, its height from then on."""

    name: ClassVar[str] = "step-after"
    time_s: float
    height: float = 1.0

    def at(self, conditions: Conditions) -> FloatArray:
        """Give 0 or the height."""
        return np.where(conditions.times_s >= self.time_s, self.height, 0.0)


DRIVERS: Final[dict[str, type[Driver]]] = {
    kind.name: kind
    for kind in (
        *(Always, AboveReference, Behind, Difference, BeyondMaps, Curvature),
        *(ShareOfMap, State, SinceReference, StepAfter),
    )
}
"""Every driver by the name under which it is stored."""

"""The machine and the campaign as a kind of effect sees them: what is there to be tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.driver import Always, BeyondMaps
from app.effects.low_pass import SETTLED
from app.effects.map_tables import maps_of_label, positions_of, temperatures_of_maps
from app.effects.observations import ObservationRows
from app.effects.projection import Projection
from app.effects.shape import Everywhere, Rising, Sensitivity, Shape
from app.effects.term import Term
from app.geometry.components import COMPONENTS, ORDER, Component, Kind
from app.search.noise import deviations
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine, OutOfRange, Travel
from app.units import SECONDS_PER_MIN

KNOWN_SHARE: Final = 0.95
"""A driver must be known in so much of a campaign; the rest counts as not moved."""

TIME_CONSTANTS_MIN: Final = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)
"""Twice as long each time: half way between two of them 98 % of a lag are still seen."""

LATE_BYTES: Final = 200_000_000
"""Low-passes of all rows are kept up to this size; beyond it each component makes its own."""

OWN_ZEROS: Final = (
    "each visit has its own zero, which hides any change from one visit to the next: measure "
    "from one common zero"
)
"""Why something that lasts cannot be tested."""

CONSTANT_WITHIN: Final = 1e-9
"""A shape is constant where it changes by less than such a share of itself."""

LEAST_SCATTER: Final = 0.05
"""Share of its size by which a driver must scatter about its mean to be told from a constant."""

MOST_RESOLUTIONS: Final = 3.0
"""A temperature varies where its range is above so many of the sensor's resolutions."""


@dataclass(frozen=True, eq=False)
class CampaignView:
    """A machine, its model, and the observations that are to be explained."""

    model: CompiledModel
    maps: Sequence[ErrorMap]
    rows: ObservationRows
    conditions: Conditions
    _late: dict[tuple[Signal, float], FloatArray] = field(default_factory=dict, init=False)
    _of_maps: dict[tuple[tuple[str, str, float], tuple[float, ...]], float] = field(
        default_factory=dict, init=False
    )

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.model.machine

    @cached_property
    def projection(self) -> Projection:
        """How components show in the rows; what is late for all rows is picked out for some."""
        return Projection(self.model, self.rows, replace(self.conditions, late=self._late))

    @cached_property
    def in_model(self) -> tuple[str, ...]:
        """The components that the model has."""
        codes = [code for group in self.model.groups for code in group.codes]
        return tuple(sorted(codes, key=ORDER.__getitem__))

    @cached_property
    def components(self) -> tuple[str, ...]:
        """The model's components that show in some row, squareness included."""
        return tuple(code for code in self.in_model if self.shows(code))

    @cached_property
    def tables(self) -> tuple[str, ...]:
        """Those of them that have an argument, nonrigid slopes aside."""
        return tuple(
            code
            for code in self.components
            if COMPONENTS[code].is_table and COMPONENTS[code].kind is not Kind.SLOPE
        )

    @cached_property
    def components_by_sensor(self) -> dict[str, tuple[str, ...]]:
        """Sensor to the components that are assigned to it and show."""
        return {
            sensor: tuple(c for c in self.components if self.sensor_of(c) == sensor)
            for sensor in dict.fromkeys(self.sensor_of(c) for c in self.components)
        }

    @cached_property
    def varying_sensors(self) -> tuple[str, ...]:
        """The sensors whose temperature is known and changed clearly in the campaign."""
        return tuple(
            name
            for name, values in self.conditions.temperatures_c.items()
            if _has_values(values) and np.nanmax(values) - np.nanmin(values) > self._clearly(name)
        )

    @cached_property
    def varying_states(self) -> tuple[str, ...]:
        """The states that are known and changed in the campaign."""
        return tuple(
            name
            for name, values in sorted(self.conditions.states.items())
            if _has_values(values) and np.nanmax(values) > np.nanmin(values)
        )

    def changes_where(self, code: str, signal: FloatArray) -> bool:
        """Whether what drives a component at once is another in some of its rows than in others.

        What is hardly ever another there is a constant of the component's own, and as well a map
        that no longer holds, however much it changes where other components were observed.

        Parameters
        ----------
        signal : ndarray, shape (n,)
            For each row of the campaign, NaN where it is not known.
        """
        part = signal[self.projection.view(code).rows]
        part = part[~np.isnan(part)]
        return bool(part.size) and bool(np.var(part) > LEAST_SCATTER**2 * np.mean(part**2))

    @cached_property
    def _has_own_zero(self) -> BoolArray:
        return self.rows.has_own_zero

    @cached_property
    def moments_s(self) -> FloatArray:
        """Times at which each visit, or each block of a long one, begins, increasing [s]."""
        block = self.rows.block
        return np.sort([self.rows.times_s[block == b].min() for b in np.unique(block)])

    def shows(self, code: str) -> bool:
        """Whether a component shows in any row."""
        return bool(self.projection.view(code).rows.size)

    def sensor_of(self, code: str) -> str:
        """Name the sensor that a component of the model is assigned to."""
        located = self.model.find(code)
        return located[0].sensor if located else str(COMPONENTS[code].default_sensor)

    def map_temperatures(self, sensor: str) -> dict[str, float]:
        """Say what a sensor read in each map [°C]."""
        return temperatures_of_maps(self.model, self.maps, sensor)

    def reference_c(self, sensor: str) -> float:
        """Choose a sensor's reference: its mean over the maps, or over the campaign [°C]."""
        in_maps_c = list(self.map_temperatures(sensor).values())
        return float(np.mean(in_maps_c or np.nanmean(self.conditions.temperature(sensor))))

    def beyond_maps(self, code: str, sensor: str, minus: str = "") -> BeyondMaps | None:
        """Make the driver of a second sensor; None where a map does not state its temperature."""
        return beyond_maps(self.model, self.maps, code, sensor, minus)

    def late_beyond_maps(self, code: str, driver: BeyondMaps, time_constant_s: float) -> BeyondMaps:
        """Make the driver late, less what was followed late when the maps were measured."""
        located = self.model.find(code)
        if located is None:
            return replace(driver, time_constant_s=time_constant_s)
        labels = [located[0].labels[row] for row in located[0].scales[0].rows]
        of_both = [
            dict(self.behind_in_maps(code, name, time_constant_s))
            for name in (driver.sensor, driver.minus)
            if name
        ]
        points = tuple(
            (
                measured_c,
                there + of_both[0].get(label, 0.0) - sum(b.get(label, 0.0) for b in of_both[1:]),
            )
            for label, (measured_c, there) in zip(labels, driver.in_maps_c, strict=True)
        )
        return replace(driver, in_maps_c=points, time_constant_s=time_constant_s)

    def behind_in_maps(self, code: str, sensor: str, tau_s: float) -> tuple[tuple[str, float], ...]:
        """Say how far behind a sensor what follows it late was in each map of a component [K].

        As far as the record knows: a map from before it counts as measured when all had settled,
        and is left out. What a map states stays the sensor's temperature there, whether it is that
        of one time or the mean of an hour.
        """
        signal = Signal("temperature", sensor)

        def behind(times_s: tuple[float, ...]) -> FloatArray:
            lags = self.conditions.lags
            for time_s in times_s:
                if lags.record_before_s(signal, time_s) >= SETTLED * tau_s:
                    at_s = np.array([time_s])
                    return lags.lagged(signal, tau_s, at_s) - lags.at(signal, at_s)
            return np.full(1, np.nan)

        return self._in_maps(code, ("behind", sensor, tau_s), behind)

    def ahead_in_maps(self, code: str, sensor: str, by_s: float) -> tuple[tuple[str, float], ...]:
        """Say by how much warmer a sensor was some time after each map of a component [K].

        As far as the record knows; other maps are left out.
        """

        def ahead(times_s: tuple[float, ...]) -> FloatArray:
            at = Conditions(np.array(times_s[:1]), {}, lags=self.conditions.lags)
            return at.temperature_later(sensor, by_s) - at.temperature_later(sensor, 0.0)

        return self._in_maps(code, ("ahead", sensor, by_s), ahead)

    def _in_maps(
        self,
        code: str,
        what: tuple[str, str, float],
        at_times: Callable[[tuple[float, ...]], FloatArray],
    ) -> tuple[tuple[str, float], ...]:
        """Ask the record about the time of each map; components of one map share the answer."""
        located = self.model.find(code)
        known: list[tuple[str, float]] = []
        for label in located[0].labels if located else ():
            key = (what, self._measured_s(code, label))
            if key not in self._of_maps:
                self._of_maps[key] = float(at_times(key[1])[0]) if key[1] else np.nan
            if np.isfinite(self._of_maps[key]):
                known.append((label, self._of_maps[key]))
        return tuple(known)

    def _measured_s(self, code: str, label: str) -> tuple[float, ...]:
        """Say when a component's maps of a thermal state were measured [s]."""
        concerned = (m for m in maps_of_label(self.maps, label) if code in m.tables)
        return tuple(m.measured_at.timestamp() for m in concerned)

    def time_constants_s(self, signal: Signal) -> tuple[float, ...]:
        """List the time constants for which a signal's past is known in the campaign [s]."""
        tried = (minutes * SECONDS_PER_MIN for minutes in TIME_CONSTANTS_MIN)
        return tuple(tau_s for tau_s in tried if _has_values(self._lagged(signal, tau_s)))

    def _lagged(self, signal: Signal, time_constant_s: float) -> FloatArray:
        """Give a signal's low-pass, kept for all components that will ask for it, shape (n,)."""
        late = self._late.get((signal, time_constant_s))
        if late is None:
            late = self.conditions.lagged(signal, time_constant_s)
            if late.nbytes * (len(self._late) + 1) <= LATE_BYTES:
                self._late[signal, time_constant_s] = late
        return late

    def why_no_lag(self, signal: Signal) -> str:
        """Say why not even the shortest time constant can be tested."""
        return self.conditions.why_missing(signal, TIME_CONSTANTS_MIN[0] * SECONDS_PER_MIN)

    def travel(self, code: str) -> Travel | None:
        """Find the travel of a component's axis: the machine's, or what tables and rows cover."""
        return travel_of(self.model, COMPONENTS[code], self.projection.view(code).places[0])

    def rising(self, code: str) -> Rising | None:
        """Make the straight line over a component's travel; None without an argument."""
        travel = self.travel(code)
        if travel is None or not travel.max_mm > travel.min_mm:
            return None
        middle = (travel.min_mm + travel.max_mm) / 2.0
        return Rising(middle, (travel.max_mm - travel.min_mm) / 2.0)

    def shapes(self, code: str) -> list[Shape]:
        """List the smooth shapes of a component: everywhere the same, and rising."""
        positions = self.projection.view(code).places.positions_mm
        rising = self.rising(code) if positions.size and np.ptp(positions) > 0 else None
        return [Everywhere()] if rising is None else [Everywhere(), rising]

    def comparable_shapes(self, code: str, shapes: Sequence[Shape]) -> list[Shape]:
        """Keep the shapes in which visits can be compared.

        A zero of its own takes from each visit what is the same in all of its rows; a visit
        of hours shows by itself what changes within it.

        Parameters
        ----------
        shapes
            How it may have changed from some visit to the next.
        """
        rows = self.projection.view(code).rows
        has_zero = self._has_own_zero[rows]
        visits, blocks = self.rows.visit[rows], self.rows.block[rows]
        is_long = len(np.unique(blocks)) > len(np.unique(visits))
        if is_long or len(np.unique(visits[~has_zero])) > 1:
            return list(shapes)
        columns = self.projection.columns([[Term(code, Always(), shape)] for shape in shapes])
        zeros = np.column_stack([visits, self.rows.channel[rows]])
        _, zero = np.unique(zeros, axis=0, return_inverse=True)
        return [
            shape
            for shape, column in zip(shapes, np.nan_to_num(columns[rows]).T, strict=True)
            if np.abs(deviations(column, zero.ravel())).max()
            > CONSTANT_WITHIN * np.abs(column).max()
        ]

    def has_comparable_slope(self, codes: Sequence[str]) -> bool:
        """Whether a sensor's bias would show in any of its components from visit to visit."""
        slope = Sensitivity(is_local=True)
        return any(self.comparable_shapes(code, [slope]) for code in codes)

    def positions_mm(self, code: str) -> FloatArray:
        """Give the positions of a component's table [mm]; none without one."""
        located = self.model.find(code)
        return positions_of(located[1] if located else None)

    def _clearly(self, sensor: str) -> float:
        declared = self.machine.sensors.get(sensor)
        return MOST_RESOLUTIONS * declared.resolution_c if declared else 0.0


def beyond_maps(
    model: CompiledModel, maps: Sequence[ErrorMap], code: str, sensor: str, minus: str = ""
) -> BeyondMaps | None:
    """Make the driver of a second sensor.

    Parameters
    ----------
    sensor, minus
        The sensor, and the one that is subtracted, or an empty name.

    Returns
    -------
    BeyondMaps, or None
        None where the model lacks the component or a map does not state a temperature.
    """
    located = model.find(code)
    if located is None:
        return None
    group, scale = located[0], located[0].scales[0]
    in_maps_c, less = (temperatures_of_maps(model, maps, name) for name in (sensor, minus))
    labels = [group.labels[row] for row in scale.rows]
    if not all(label in in_maps_c and (not minus or label in less) for label in labels):
        return None
    there = [in_maps_c[label] - (less[label] if minus else 0.0) for label in labels]
    points = tuple(zip(scale.temperatures_c, there, strict=True))
    goes_on = model.machine.out_of_range is OutOfRange.EXTRAPOLATE
    return BeyondMaps(sensor, minus, scale.sensor, points, goes_on=goes_on)


def travel_of(
    model: CompiledModel, component: Component, positions_mm: FloatArray | None = None
) -> Travel | None:
    """Find the travel of a component's axis.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Where the axis was observed.

    Returns
    -------
    Travel, or None
        The machine's; else what its tables cover, else what was observed; None without an
        argument or where nothing is known.
    """
    if component.axis is None:
        return None
    if component.axis in model.machine.axes:
        return model.machine.axes[component.axis]
    members = [m for group in model.groups for m in group.members]
    positions = [m.positions_mm for m in members if m.component.axis == component.axis]
    every = np.concatenate([np.empty(0), *positions])
    if every.size < 2 and positions_mm is not None:
        every = positions_mm
    return Travel(float(every.min()), float(every.max())) if every.size else None


def _has_values(values: FloatArray) -> bool:
    return bool(np.mean(~np.isnan(values)) >= KNOWN_SHARE)

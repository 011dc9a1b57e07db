"""The thermal model made ready to be asked: packed maps, one matrix per scale of temperature.

Components that follow the same sensor over the same maps move together, so their
tables stand side by side in the rows of one matrix, a row for each map in the
order of that sensor's temperature. The table at a temperature is then one line
between two rows, however many components and positions there are; only what these two
maps cover counts, however short others are.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, frozen
from app.errors import (
    FieldError,
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    list_names,
)
from app.geometry.components import Component
from app.geometry.measuring_line import MeasuringLines
from app.thermal.bracket import Bracket, Status, find_bracket
from app.thermal.machine import Machine, OutOfRange


@dataclass(frozen=True, slots=True)
class Scale:
    """One sensor's temperatures of the maps, increasing, and the matrix row of each."""

    sensor: str
    temperatures_c: tuple[float, ...]
    rows: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One component's place in a row of numbers.

    `forward` and `backward` are the columns of its tables at `positions_mm`; `backward` is
    None where no map of it is bidirectional. `ranges_mm` has for each of the group's maps
    the first and the last position that it covers, shape (M, 2): −∞ and ∞ where the map's
    errors do not depend on position.
    """

    component: Component
    positions_mm: FloatArray
    forward: slice
    backward: slice | None
    ranges_mm: FloatArray

    @property
    def reach_mm(self) -> tuple[float, float] | None:
        """The range that any of the maps covers [mm]; None without dependence on position."""
        if not np.isfinite(self.ranges_mm).any():
            return None
        return float(self.positions_mm[0]), float(self.positions_mm[-1])


@dataclass(frozen=True, slots=True, eq=False)
class MapsInUse:
    """What a group has between two of its maps, or at one of them.

    Parameters
    ----------
    members
        The components, at the positions of the maps in use inside their common range.
    lower, upper : ndarray, shape (w,) [the members' units]
        The maps' errors there; of one map alone the same twice.
    lower_variances, upper_variances : ndarray, shape (w,), or None
        As `Group.variances`.
    covariances : ndarray, shape (w,), or None
        Of the two maps' errors; None where they are independent of each other.
    shortened
        In sentences, which components other maps of the model cover further.
    """

    members: tuple[Member, ...]
    lower: FloatArray
    upper: FloatArray
    lower_variances: FloatArray | None
    upper_variances: FloatArray | None
    covariances: FloatArray | None
    shortened: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The components that lie between the same two maps at any time.

    `scales` begins with the assigned sensor's; its stand-ins' follow. `nodes` has
    a row for each of `labels` [the members' units], at the union of all maps' positions:
    beyond a map's own range its end values, which nothing reads. `own`, of the same shape,
    says which positions a map brings itself. `variances` are those of `nodes`,
    of the same shape [units squared]: NaN where the maps do not state them, None
    where they are nowhere stated. `covariances` are those between two maps' rows, the smaller
    number first, where one map's reversal is another's. `limits` remembers how far the line
    through two maps may be extrapolated.
    """

    scales: tuple[Scale, ...]
    labels: tuple[str, ...]
    members: tuple[Member, ...]
    nodes: FloatArray
    own: BoolArray
    variances: FloatArray | None = None
    covariances: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)
    limits: dict[tuple[str, int], tuple[float, float]] = field(default_factory=dict, repr=False)
    _in_use: dict[tuple[int, int], MapsInUse] = field(default_factory=dict, repr=False)

    @property
    def sensor(self) -> str:
        """The assigned sensor."""
        return self.scales[0].sensor

    @property
    def codes(self) -> list[str]:
        """The members' component codes."""
        return [member.component.code for member in self.members]

    def usable_scale(self, temperatures_c: Mapping[str, float]) -> Scale | None:
        """Choose the assigned sensor's scale, or else the first stand-in's that is usable."""
        for scale in self.scales:
            if scale.sensor in temperatures_c:
                return scale
        return None

    def maps_in_use(self, lower: int, upper: int) -> MapsInUse:
        """Give what two maps have in common, or with the same row twice what one map has.

        It is made when it is first asked for, and remembered.
        """
        found = self._in_use.get((lower, upper))
        if found is None:
            found = self._in_use.setdefault((lower, upper), self._bring_together(lower, upper))
        return found

    def _bring_together(self, lower: int, upper: int) -> MapsInUse:
        kept = self.own[lower] | self.own[upper]
        for member in self.members:
            low, high = common_range_of_rows(member.ranges_mm, lower, upper)
            if np.isfinite(low):
                inside = (member.positions_mm >= low) & (member.positions_mm <= high)
                for columns in filter(None, (member.forward, member.backward)):
                    kept[columns] &= inside
        # Where the maps have the same positions, which is the rule, nothing is copied.
        all_kept = bool(kept.all())
        members = self.members if all_kept else _narrowed(self.members, kept)

        def narrowed(row: FloatArray) -> FloatArray:
            return row if all_kept else frozen(row[kept])

        variances = self.variances
        covariances = None
        if lower != upper:
            covariances = self.covariances.get((min(lower, upper), max(lower, upper)))

        return MapsInUse(
            members,
            narrowed(self.nodes[lower]),
            narrowed(self.nodes[upper]),
            None if variances is None else narrowed(variances[lower]),
            None if variances is None else narrowed(variances[upper]),
            None if covariances is None else narrowed(covariances),
            tuple(self._shortened(lower, upper)),
        )

    def _shortened(self, lower: int, upper: int) -> list[str]:
        """Say which components end earlier than other maps of theirs, and because of which."""
        codes: dict[str, list[str]] = defaultdict(list)
        for member in self.members:
            reach = member.reach_mm
            if reach is None:
                continue
            low, high = common_range_of_rows(member.ranges_mm, lower, upper)
            if low <= reach[0] and high >= reach[1]:
                continue
            short = [
                f"map {self.labels[row]!r} covers {from_to_mm(*member.ranges_mm[row])}"
                for row in dict.fromkeys((lower, upper))
                if member.ranges_mm[row, 0] > reach[0] or member.ranges_mm[row, 1] < reach[1]
            ]
            codes[
                f"given from {low:g} to {high:g} mm only at this temperature, because "
                f"{' and '.join(short)}; the maps together reach from {from_to_mm(*reach)}"
            ].append(member.component.code)
        return [f"{list_names(of)}: {words}" for words, of in codes.items()]


def common_range_of_rows(
    ranges_mm: FloatArray, lower: int | IntArray, upper: int | IntArray
) -> tuple[FloatArray, FloatArray]:
    """Find the range of positions that two maps have in common.

    Parameters
    ----------
    ranges_mm : ndarray, shape (M, 2) [mm]
        As `Member.ranges_mm`.
    lower, upper : int or ndarray, shape (n,)
        Rows of the maps; the same for one map alone.

    Returns
    -------
    low, high : float or ndarray, shape (n,) [mm]
    """
    low = np.maximum(ranges_mm[lower, 0], ranges_mm[upper, 0])
    high = np.minimum(ranges_mm[lower, 1], ranges_mm[upper, 1])
    return low, high


def _narrowed(members: Sequence[Member], kept: BoolArray) -> tuple[Member, ...]:
    """Lay the members out anew on the columns that are kept."""
    found = []
    # Each column's new place: how many are kept before it.
    place = np.concatenate([[0], np.cumsum(kept)])
    for member in members:
        forward, backward = (
            None if columns is None else slice(int(place[columns.start]), int(place[columns.stop]))
            for columns in (member.forward, member.backward)
        )
        assert forward is not None
        positions = member.positions_mm
        if positions.size:
            positions = positions[kept[member.forward]]
        found.append(Member(member.component, positions, forward, backward, member.ranges_mm))
    return tuple(found)


def from_to_mm(low: float, high: float) -> str:
    """Write a range of positions for a sentence.

    >>> from_to_mm(0.0, 512.5)
    '0 to 512.5 mm'
    """
    return f"{low:g} to {high:g} mm"


class GroupState(NamedTuple):
    """A group's errors at one temperature, and how they came about.

    `values` has one
    number for each column of `maps`, the maps in use, and so has `variances`, the part of
    their uncertainty that the measurement of the maps left, and beyond the maps the
    resolution of their temperatures: NaN where one of the maps that enter states none, None
    where the group has none at all.
    """

    group: Group
    maps: MapsInUse
    sensor: str
    temperature_c: float
    lower_map: str
    upper_map: str
    weight: float
    status: Status
    values: FloatArray
    variances: FloatArray | None

    @property
    def is_stand_in(self) -> bool:
        """Whether another sensor than the assigned one was used."""
        return self.sensor != self.group.sensor

    @property
    def span_c(self) -> float:
        """How far apart the two maps are on the scale of `sensor` [K]."""
        scale = next(scale for scale in self.group.scales if scale.sensor == self.sensor)
        lower, upper = (
            scale.rows.index(self.group.labels.index(label))
            for label in (self.lower_map, self.upper_map)
        )
        return scale.temperatures_c[upper] - scale.temperatures_c[lower]

    @property
    def limited_beyond_c(self) -> float | None:
        """How far beyond the maps an extrapolation was stopped [K]; None where none was."""
        if self.status is not Status.CLAMPED or 0.0 <= self.weight <= 1.0:
            return None
        return max(self.weight - 1.0, -self.weight) * self.span_c

    @property
    def members(self) -> tuple[Member, ...]:
        """The components, at the positions that hold at this temperature."""
        return self.maps.members

    @property
    def stand_in_for(self) -> str | None:
        """The assigned sensor where another one was used, else None."""
        return self.group.sensor if self.is_stand_in else None

    def standard_errors(self, columns: slice) -> FloatArray | None:
        """Give the standard errors of one member's values, None where they are not known.

        Parameters
        ----------
        columns
            The member's `forward` or `backward`.

        Returns
        -------
        ndarray, shape (n,) [the member's unit], or None
        """
        # A map states all of a component's standard errors or none.
        if self.variances is None or np.isnan(self.variances[columns.start]):
            return None
        found: FloatArray = np.sqrt(self.variances[columns])
        return found


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A machine's maps and assignment, ready for live temperatures.

    Parameters
    ----------
    machine
        Whose model it is; its policies apply.
    groups
        The components that can be interpolated.
    omitted
        Code to the reason why a component that some map has cannot be.
    notes
        What a user should know about how the maps were brought together.
    measuring_lines
        Axis to the line along which its translations count as measured.
    """

    machine: Machine
    groups: tuple[Group, ...]
    omitted: Mapping[str, str]
    notes: tuple[str, ...]
    measuring_lines: MeasuringLines

    @cached_property
    def numbers(self) -> int:
        """How many errors the table of all components has."""
        return sum(group.nodes.shape[1] for group in self.groups)

    def errors_at(
        self, temperatures_c: Mapping[str, float], stale_c: Mapping[str, float] | None = None
    ) -> list[GroupState]:
        """Interpolate every component to the given temperatures (8.105–8.107).

        Parameters
        ----------
        temperatures_c
            Usable temperatures by sensor [°C]; a sensor that failed is left out,
            and its stand-in serves.
        stale_c
            Old temperatures by sensor [°C], taken only where neither the sensor nor a
            stand-in has a usable one.

        Raises
        ------
        NotEnoughMaps
            If no component has two maps.
        SensorUnavailable
            If a sensor and its stand-ins are all missing.
        OutsideMaps
            If the machine's policy does not allow a temperature.
        """
        if not self.groups:
            raise NotEnoughMaps(self.why_nothing())
        stale_c = stale_c or {}
        found = []
        missing = []
        for group in self.groups:
            scale = group.usable_scale(temperatures_c)
            source = temperatures_c if scale is not None else stale_c
            scale = scale or group.usable_scale(stale_c)
            if scale is None:
                missing.append(group)
            else:
                found.append(self.group_at(group, scale, source[scale.sensor]))
        if missing:
            errors = [
                FieldError(f"temperatures_c.{group.sensor}", self._expected_sensor(group))
                for group in missing
            ]
            raise SensorUnavailable("; ".join(e.message for e in errors), errors)
        return found

    def group_at(self, group: Group, scale: Scale, temperature_c: float) -> GroupState:
        """Interpolate one group on one of its sensors' scales; OutsideMaps as `bracket`."""
        bracket = self.bracket(group, scale, temperature_c)
        lower = scale.rows[bracket.lower]
        upper = scale.rows[bracket.lower + 1]
        w = bracket.weight
        # A map that has no weight does not shorten the table either.
        maps = group.maps_in_use(lower if w != 1.0 else upper, upper if w != 0.0 else lower)
        uncertain = maps.lower_variances is not None
        return GroupState(
            group,
            maps,
            scale.sensor,
            temperature_c,
            group.labels[lower],
            group.labels[upper],
            w,
            bracket.status,
            # (1 − w) E_n + w E_m rather than E_n + w (E_m − E_n): exact at both maps.
            (1.0 - w) * maps.lower + w * maps.upper,
            self._variances(maps, scale, bracket) if uncertain else None,
        )

    def bracket(self, group: Group, scale: Scale, temperature_c: float) -> Bracket:
        """Find a group's two maps at a temperature [°C] of one of its sensors.

        Raises
        ------
        OutsideMaps
            If the machine's policy does not allow the temperature.
        """
        machine = self.machine
        try:
            found = find_bracket(
                scale.temperatures_c,
                temperature_c,
                machine.out_of_range,
                machine.extrapolation_margin_c,
            )
        except OutsideMaps as error:
            message = f"{scale.sensor} ({list_names(group.codes)}): {error.detail}"
            blamed = FieldError(f"temperatures_c.{scale.sensor}", message)
            raise OutsideMaps(message, [blamed]) from None
        if found.status is Status.EXTRAPOLATED:
            low, high = self.weight_limits(group, scale, found.lower)
            if not low <= found.weight <= high:
                return Bracket(found.lower, min(max(found.weight, low), high), Status.CLAMPED)
        # A stand-in is said unless something graver is to be said.
        if scale is not group.scales[0] and found.status in (Status.INTERPOLATED, Status.AT_MAP):
            return found._replace(status=Status.STAND_IN)
        return found

    def weight_limits(self, group: Group, scale: Scale, lower: int) -> tuple[float, float]:
        """Find between which weights two neighbouring maps may be extrapolated.

        Parameters
        ----------
        group, scale
            The group and one of its sensors' scales.
        lower
            Place of the lower map on that scale.

        Returns
        -------
        low, high
            At most 0 and at least 1. Between them the variance of an extrapolated value
            is at most the machine's `extrapolation_error_ratio`
            squared times the larger of the two maps' own: on the average over a component's
            positions, for each component of the group. Where a map states no uncertainty
            both count as equally certain, and the ratio limits (1 − w)² + w².
        """
        key = (scale.sensor, lower)
        found = group.limits.get(key)
        if found is None:
            resolution_c = self.machine.sensor(scale.sensor).resolution_c
            rows, span_c = scale.rows[lower : lower + 2], _span_c(scale.temperatures_c, lower)
            found = group.limits[key] = self._limits(group, rows, span_c, resolution_c)
        return found

    def extrapolation_reach_c(
        self, group: Group, temperatures_c: Sequence[float], rows: Sequence[int]
    ) -> tuple[float, float]:
        """Find how far below and above the maps a group is extrapolated on any scale.

        Parameters
        ----------
        group
            The group.
        temperatures_c, rows
            As `Scale`; of the maps' temperatures the uncertainty does not count unless it is
            one of the group's own scales.

        Returns
        -------
        below, above : float [K]
            0 where the machine's policy is not to extrapolate.
        """
        if self.machine.out_of_range is not OutOfRange.EXTRAPOLATE:
            return 0.0, 0.0
        own = next((s for s in group.scales if s.temperatures_c == tuple(temperatures_c)), None)
        last = len(rows) - 2
        limits = [
            self._limits(group, rows[lower : lower + 2], _span_c(temperatures_c, lower), 0.0)
            if own is None
            else self.weight_limits(group, own, lower)
            for lower in (0, last)
        ]
        margin = self.machine.extrapolation_margin_c
        below = -limits[0][0] * _span_c(temperatures_c, 0)
        above = (limits[1][1] - 1.0) * _span_c(temperatures_c, last)
        return min(below, margin), min(above, margin)

    def _limits(
        self, group: Group, rows: Sequence[int], span_c: float, resolution_c: float
    ) -> tuple[float, float]:
        maps = group.maps_in_use(*rows)
        slopes = _slope_variances(maps, span_c, resolution_c)
        ratio = self.machine.extrapolation_error_ratio
        limits = [_weight_limits(maps, member, slopes, ratio) for member in maps.members]
        return max(low for low, _ in limits), min(high for _, high in limits)

    def _variances(self, maps: MapsInUse, scale: Scale, bracket: Bracket) -> FloatArray | None:
        """Variances of (1 − w) E_n + w E_m (GUM, 5.1.2); at a map the other does not enter."""
        v_n, v_m, w = maps.lower_variances, maps.upper_variances, bracket.weight
        if v_n is None or v_m is None:
            return None
        if w in (0.0, 1.0):
            return v_m
        found: FloatArray = (1.0 - w) ** 2 * v_n + w**2 * v_m
        if maps.covariances is not None:
            found += 2.0 * w * (1.0 - w) * maps.covariances
        if not 0.0 < w < 1.0:
            resolution_c = self.machine.sensor(scale.sensor).resolution_c
            span_c = _span_c(scale.temperatures_c, bracket.lower)
            found += 2.0 * w * (w - 1.0) * _slope_variances(maps, span_c, resolution_c)
        return found

    def find(self, code: str) -> tuple[Group, Member] | None:
        """Find a component's group and its place there, or None."""
        for group in self.groups:
            for member in group.members:
                if member.component.code == code:
                    return group, member
        return None

    def why_nothing(self) -> str:
        """Say why no component can be interpolated."""
        reasons = list_names([f"{code}: {why}" for code, why in self.omitted.items()], 3)
        return (
            f"machine {self.machine.id!r} needs at least two error maps at different "
            f"temperatures before anything can be interpolated ({reasons})"
        )

    def _expected_sensor(self, group: Group) -> str:
        stand_ins = [s.name for s in self.machine.with_stand_ins(group.sensor)[1:]]
        usable = {scale.sensor for scale in group.scales}
        spare = "".join(
            f" nor of its stand-in {name}"
            if name in usable
            else f" ({name} cannot stand in: maps lack it, or it cannot tell them apart)"
            for name in stand_ins
        )
        return (
            f"expected a temperature of {group.sensor} in °C, needed by "
            f"{list_names(group.codes)}, came none that is usable{spare}"
        )


def _span_c(temperatures_c: Sequence[float], lower: int) -> float:
    return temperatures_c[lower + 1] - temperatures_c[lower]


def _slope_variances(maps: MapsInUse, span_c: float, resolution_c: float) -> FloatArray:
    """What the resolution of the maps' temperatures makes uncertain, for each column: q.

    A reading of resolution r has the standard uncertainty r/√12 (GUM, F.2.2.1); it acts
    with the slope of the error over temperature.
    """
    found: FloatArray = ((maps.upper - maps.lower) / span_c) ** 2 * (resolution_c**2 / 12.0)
    return found


def _weight_limits(
    maps: MapsInUse, member: Member, slopes: FloatArray, ratio: float
) -> tuple[float, float]:
    """Solve v(w) = ratio² max(v_n, v_m) for one component, means over its columns.

    v(w) = (1 − w)² v_n + 2 w (1 − w) c + w² v_m + 2 w (w − 1) q is that of
    `CompiledModel._variances`: q, of the maps' temperatures, acts with (1 − w)² + w², of
    which the 1 that it has at a map itself is left out, as interpolated values leave it out.
    """
    columns = slice(member.forward.start, (member.backward or member.forward).stop)
    v_n, v_m, c, q = 1.0, 1.0, 0.0, 0.0
    if maps.lower_variances is not None and maps.upper_variances is not None:
        stated = [float(v[columns].mean()) for v in (maps.lower_variances, maps.upper_variances)]
        # Without a statement, or with one of no uncertainty at all, there is no measure.
        if np.isfinite(stated).all() and max(stated) > 0.0:
            (v_n, v_m), q = stated, float(slopes[columns].mean())
            c = 0.0 if maps.covariances is None else float(maps.covariances[columns].mean())
    square = v_n + v_m - 2.0 * c + 2.0 * q
    half = v_n - c + q
    beyond = ratio**2 * max(v_n, v_m) - v_n
    if square <= 0.0:
        return -math.inf, math.inf
    root = math.sqrt(half**2 + square * beyond)
    return min((half - root) / square, 0.0), max((half + root) / square, 1.0)

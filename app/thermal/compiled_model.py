"""The thermal model made ready to be asked: packed maps, one matrix per scale of temperature.

Components that follow the same sensor over the same maps move together, so their
tables stand side by side in the rows of one matrix, a row for each map in the
order of that sensor's temperature. The table at a temperature is then one line
between two rows, however many components and positions there are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import (
    Conflict,
    FieldError,
    InvalidContent,
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    list_names,
)
from app.geometry.components import COMPONENTS, ORDER, Component
from app.thermal.bracket import Bracket, Status, find_bracket
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, SameTemperature, Sensor
from app.thermal.resampling import common_positions, sample_table


@dataclass(frozen=True, slots=True)
class Scale:
    """One sensor's temperatures of the maps, increasing, and the matrix row of each."""

    sensor: str
    temperatures_c: tuple[float, ...]
    rows: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One component's place in its group's matrix.

    `forward` and `backward` are the columns of its tables; `backward` is None
    where no map of it is bidirectional.
    """

    component: Component
    positions_mm: FloatArray
    forward: slice
    backward: slice | None


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The components that lie between the same two maps at any time.

    `scales` begins with the assigned sensor's; its stand-ins' follow. `nodes` has
    a row for each of `labels` [the members' units].
    """

    scales: tuple[Scale, ...]
    labels: tuple[str, ...]
    members: tuple[Member, ...]
    nodes: FloatArray

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
        return next((scale for scale in self.scales if scale.sensor in temperatures_c), None)


@dataclass(frozen=True, slots=True, eq=False)
class GroupState:
    """A group's errors at one temperature, and how they came about.

    `values` has one number for each column of the group's matrix.
    """

    group: Group
    sensor: str
    temperature_c: float
    lower_map: str
    upper_map: str
    weight: float
    status: Status
    values: FloatArray

    @property
    def is_stand_in(self) -> bool:
        """Whether another sensor than the assigned one was used."""
        return self.sensor != self.group.sensor


@dataclass(frozen=True, slots=True, eq=False)
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
    """

    machine: Machine
    groups: tuple[Group, ...]
    omitted: Mapping[str, str]
    notes: tuple[str, ...]

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
        return GroupState(
            group=group,
            sensor=scale.sensor,
            temperature_c=temperature_c,
            lower_map=group.labels[lower],
            upper_map=group.labels[upper],
            weight=w,
            status=bracket.status,
            # (1 − w) E_n + w E_m rather than E_n + w (E_m − E_n): exact at both maps.
            values=(1.0 - w) * group.nodes[lower] + w * group.nodes[upper],
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
            field = FieldError(f"temperatures_c.{scale.sensor}", message)
            raise OutsideMaps(message, [field]) from None
        # A stand-in is said unless something graver is to be said.
        if scale is not group.scales[0] and found.status in (Status.INTERPOLATED, Status.AT_MAP):
            return found._replace(status=Status.STAND_IN)
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
        spare = f" nor of its stand-in {list_names(stand_ins)}" if stand_ins else ""
        return (
            f"expected a temperature of {group.sensor} in °C, needed by "
            f"{list_names(group.codes)}, came none that is usable{spare}"
        )


def compile_model(
    machine: Machine, maps: Iterable[ErrorMap], assignment: Mapping[str, str]
) -> CompiledModel:
    """Bring the maps of one model version into the form that is asked.

    Parameters
    ----------
    machine
        The machine; its sensors, policies and defaults.
    maps
        The error maps, in any order: the result does not depend on it.
    assignment
        Component code to sensor, where the user has said so.

    Returns
    -------
    CompiledModel

    Raises
    ------
    InvalidContent
        If a map lacks the temperature of a sensor that one of its components follows.
    Conflict
        If two maps lie closer in temperature than the sensor resolves (unless the
        machine asks for their mean), or their positions have no common range.
    """
    by_code: dict[str, list[ErrorMap]] = defaultdict(list)
    for error_map in maps:
        for code in error_map.tables:
            by_code[code].append(error_map)
    together: dict[tuple[tuple[Scale, ...], tuple[str, ...]], list[_Part]] = defaultdict(list)
    omitted: dict[str, str] = {}
    notes: list[str] = []
    for code in sorted(by_code, key=ORDER.__getitem__):
        sensor = assignment.get(code) or machine.default_sensor(code)
        if sensor is None:
            omitted[code] = "no sensor is assigned to it"
            continue
        states = _thermal_states(machine, code, machine.sensor(sensor), by_code[code])
        if len(states) < 2:
            omitted[code] = f"only {states[0].label} has it, at least two maps are needed"
            continue
        scales = _scales(machine, sensor, states)
        labels = tuple(state.label for state in states)
        together[(scales, labels)].append(_bring_together(code, states, notes))
    return CompiledModel(
        machine=machine,
        groups=tuple(_group(*key, parts) for key, parts in together.items()),
        omitted=omitted,
        notes=tuple(notes),
    )


@dataclass(frozen=True, slots=True)
class _State:
    """One thermal state of one component: a map, or the mean of maps at one temperature."""

    label: str
    temperatures_c: Mapping[str, float]
    tables: tuple[ComponentTable, ...]


@dataclass(frozen=True, slots=True)
class _Part:
    """One component over its states: rows of the matrix to be."""

    component: Component
    positions_mm: FloatArray
    forward: FloatArray
    backward: FloatArray | None


def _thermal_states(
    machine: Machine, code: str, sensor: Sensor, maps: Sequence[ErrorMap]
) -> list[_State]:
    """Order a component's maps by their sensor's temperature; merge or refuse equal ones."""
    for error_map in maps:
        if sensor.name not in error_map.temperatures_c:
            raise InvalidContent.of_field(
                "temperatures_c",
                f"expected a temperature of {sensor.name} in °C in map {error_map.label!r}, "
                f"because {code} follows it, came {list_names(error_map.temperatures_c)}",
            )
    ordered = sorted(maps, key=lambda m: (m.temperatures_c[sensor.name], m.label))
    clusters: list[list[ErrorMap]] = [[ordered[0]]]
    for error_map in ordered[1:]:
        gap_c = error_map.temperatures_c[sensor.name] - clusters[-1][-1].temperatures_c[sensor.name]
        if sensor.resolves(gap_c):
            clusters.append([error_map])
        elif machine.same_temperature is SameTemperature.MEAN:
            clusters[-1].append(error_map)
        else:
            raise Conflict(
                f"maps {clusters[-1][-1].label!r} and {error_map.label!r} are {gap_c:.3g} °C "
                f"apart at {sensor.name}, which {code} follows; expected at least its "
                f"resolution of {sensor.resolution_c:g} °C (or the machine's "
                "same_temperature set to 'mean')"
            )
    return [_state(code, cluster) for cluster in clusters]


def _state(code: str, cluster: Sequence[ErrorMap]) -> _State:
    shared = set.intersection(*(set(m.temperatures_c) for m in cluster))
    return _State(
        label=" + ".join(m.label for m in cluster),
        temperatures_c={
            name: float(np.mean([m.temperatures_c[name] for m in cluster]))
            for name in sorted(shared)
        }
        if len(cluster) > 1
        else cluster[0].temperatures_c,
        tables=tuple(m.tables[code] for m in cluster),
    )


def _bring_together(code: str, states: Sequence[_State], notes: list[str]) -> _Part:
    """Put a component's tables on the union of their positions inside the common range."""
    tables = [table for state in states for table in state.tables]
    positions = common_positions(tables)
    bidirectional = [table.backward_errors is not None for table in tables]
    if any(bidirectional) and not all(bidirectional):
        notes.append(
            f"{code} is bidirectional in some maps only: the others' table serves both directions"
        )
    return _Part(
        component=COMPONENTS[code],
        positions_mm=positions,
        forward=_rows(states, positions, backward=False),
        backward=_rows(states, positions, backward=True) if any(bidirectional) else None,
    )


def _rows(states: Sequence[_State], positions: FloatArray, *, backward: bool) -> FloatArray:
    """Sample each state's table, or the mean of its tables, at the positions: (M, n)."""
    return np.array(
        [
            np.mean(
                [sample_table(table, positions, backward=backward) for table in state.tables],
                axis=0,
            )
            for state in states
        ]
    )


def _scales(machine: Machine, sensor: str, states: Sequence[_State]) -> tuple[Scale, ...]:
    """Make the assigned sensor's scale and those of its usable stand-ins.

    A stand-in is usable where every map states its temperature and its maps are
    further apart than it resolves; otherwise it cannot serve.
    """
    found = []
    for candidate in machine.with_stand_ins(sensor):
        temperatures = [state.temperatures_c.get(candidate.name) for state in states]
        known = [t for t in temperatures if t is not None]
        if len(known) < len(states):
            continue
        rows = np.argsort(known, kind="stable")
        ordered = tuple(float(known[row]) for row in rows)
        gaps = np.diff(ordered)
        if candidate.name == sensor or candidate.resolves(float(gaps.min())):
            found.append(Scale(candidate.name, ordered, tuple(int(row) for row in rows)))
    return tuple(found)


def _group(scales: tuple[Scale, ...], labels: tuple[str, ...], parts: Sequence[_Part]) -> Group:
    """Set the tables of one group side by side."""
    columns: list[FloatArray] = []
    members: list[Member] = []
    width = 0
    for part in parts:
        n = part.forward.shape[1]
        forward = slice(width, width + n)
        backward = None if part.backward is None else slice(width + n, width + 2 * n)
        columns += [part.forward] if part.backward is None else [part.forward, part.backward]
        width += n if part.backward is None else 2 * n
        members.append(Member(part.component, part.positions_mm, forward, backward))
    nodes = np.hstack(columns)
    nodes.flags.writeable = False
    return Group(scales, labels, tuple(members), nodes)

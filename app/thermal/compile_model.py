"""From error maps to the compiled model: thermal states ordered, tables on common positions.

One walk for each component: which sensor it follows, its maps in the order of that
sensor's temperature, their tables on the same positions. Components with the same
scale of temperature then stand side by side in one matrix.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS, ORDER, Component
from app.thermal.compiled_model import CompiledModel, Group, Member, Scale
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, SameTemperature, Sensor
from app.thermal.one_measuring_line import on_one_line
from app.thermal.resampling import common_positions, sample_table, sample_variances


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
    brought, lines, notes = on_one_line(machine.chain, maps)
    by_code: dict[str, list[ErrorMap]] = defaultdict(list)
    for error_map in brought:
        for code in error_map.tables:
            by_code[code].append(error_map)
    together: dict[tuple[tuple[Scale, ...], tuple[str, ...]], list[_Part]] = defaultdict(list)
    omitted: dict[str, str] = {}
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
        measuring_lines=lines,
    )


@dataclass(frozen=True, slots=True)
class _State:
    """One thermal state of one component: a map, or the mean of maps at one temperature."""

    label: str
    temperatures_c: Mapping[str, float]
    tables: tuple[ComponentTable, ...]


@dataclass(frozen=True, slots=True)
class _Rows:
    """One direction of one component: a row for each state.

    `variances` are those of `values`, NaN where a map of the state states none.
    """

    values: FloatArray
    variances: FloatArray


@dataclass(frozen=True, slots=True)
class _Part:
    """One component over its states: columns of the matrix to be."""

    component: Component
    positions_mm: FloatArray
    forward: _Rows
    backward: _Rows | None


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
        first = clusters[-1][0]
        gap_c = error_map.temperatures_c[sensor.name] - first.temperatures_c[sensor.name]
        if sensor.resolves(gap_c):
            clusters.append([error_map])
        elif machine.same_temperature is SameTemperature.MEAN:
            clusters[-1].append(error_map)
        else:
            raise Conflict(
                f"maps {first.label!r} and {error_map.label!r} are {gap_c:.3g} °C "
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
    longest = [t.positions_mm for t in tables if t.depends_on_position]
    if any(p[0] < positions[0] or p[-1] > positions[-1] for p in longest):
        notes.append(
            f"{code} is given from {positions[0]:g} to {positions[-1]:g} mm, where all its maps "
            "have it"
        )
    return _Part(
        component=COMPONENTS[code],
        positions_mm=positions,
        forward=_rows(states, positions, backward=False),
        backward=_rows(states, positions, backward=True) if any(bidirectional) else None,
    )


def _rows(states: Sequence[_State], positions: FloatArray, *, backward: bool) -> _Rows:
    """Sample each state's table, or the mean of its tables, at the positions: (M, n)."""
    values = [
        np.mean(
            [sample_table(table, positions, backward=backward) for table in state.tables], axis=0
        )
        for state in states
    ]
    variances = [
        _mean_variances(
            [sample_variances(table, positions, backward=backward) for table in state.tables],
            value.size,
        )
        for state, value in zip(states, values, strict=True)
    ]
    return _Rows(np.array(values), np.array(variances))


def _mean_variances(of_tables: Sequence[FloatArray | None], n: int) -> FloatArray:
    """Variances of the mean of independent measurements; NaN where one is not known."""
    known = [variances for variances in of_tables if variances is not None]
    if len(known) < len(of_tables):
        return np.full(n, np.nan)
    mean: FloatArray = np.sum(known, axis=0) / len(known) ** 2
    return mean


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
    columns: list[_Rows] = []
    members: list[Member] = []
    width = 0
    for part in parts:
        n = part.forward.values.shape[1]
        forward = slice(width, width + n)
        backward = None if part.backward is None else slice(width + n, width + 2 * n)
        columns += [part.forward] if part.backward is None else [part.forward, part.backward]
        width += n if part.backward is None else 2 * n
        members.append(Member(part.component, part.positions_mm, forward, backward))
    nodes = np.hstack([rows.values for rows in columns])
    variances = np.hstack([rows.variances for rows in columns])
    for matrix in (nodes, variances):
        matrix.flags.writeable = False
    known = not np.isnan(variances).all()
    return Group(scales, labels, tuple(members), nodes, variances if known else None)

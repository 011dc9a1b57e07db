"""From error maps to the compiled model: thermal states ordered, tables side by side.

One walk for each component: which sensor it follows, its maps in the order of that
sensor's temperature, their tables on the union of their positions. Components with the same
scale of temperature then stand side by side in one matrix.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import Final, TypeAlias

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS, ORDER, Component
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.group import Group, Member, Scale, common_range_of_rows, from_to_mm, member_of
from app.thermal.machine import Machine, SameTemperature, Sensor
from app.thermal.one_measuring_line import on_one_line
from app.thermal.resampling import (
    at_same_positions,
    common_range,
    sample_table,
    sample_variances,
    united_positions,
)

NO_SENSOR: Final = "no sensor is assigned to it"
"""Why a component is not in the model although maps have it."""


def compile_model(
    machine: Machine, maps: Iterable[ErrorMap], assignment: Mapping[str, str]
) -> CompiledModel:
    """Bring the maps of one model version into the form that is asked.

    Parameters
    ----------
    maps
        The error maps, in any order: the result does not depend on it.
    assignment
        Component code to sensor, where the user has said so.

    Raises
    ------
    InvalidContent
        If a map lacks the temperature of a sensor that one of its components follows.
    Conflict
        If two maps lie closer in temperature than the sensor resolves (unless the
        machine asks for their mean), or two that follow each other in temperature have
        no range of positions in common.
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
            omitted[code] = NO_SENSOR
            continue
        states = _thermal_states(machine, code, machine.sensor(sensor), by_code[code])
        if len(states) < 2:
            omitted[code] = f"measured in {states[0].label} only, at least two maps are needed"
            continue
        scales = _scales(machine, sensor, states)
        labels = tuple(state.label for state in states)
        part = _bring_together(code, scales, states, notes)
        _check_common_ranges(code, scales, states, part)
        together[(scales, labels)].append(part)
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


_Source: TypeAlias = tuple[int, int, bool]
"""A measured table: its state, its place there, and whether the backward errors are meant."""

_Sources: TypeAlias = dict[_Source, float]
"""What errors are made of: measured tables, each with its coefficient."""


@dataclass(frozen=True, slots=True)
class _Rows:
    """One direction of one component: a row for each state.

    `variances` are those of `values`, NaN where a map of the state states none; `covariances`
    those between two rows that rest on the same measurement.
    """

    values: FloatArray
    variances: FloatArray
    covariances: Mapping[tuple[int, int], FloatArray]


@dataclass(frozen=True, slots=True)
class _Part:
    """One component over its states: columns of the matrix to be.

    `measured`, of the shape of the rows, says which positions are a state's own.
    """

    component: Component
    positions_mm: FloatArray
    ranges_mm: FloatArray
    measured: BoolArray
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
                f"because {code} follows it, got {list_names(error_map.temperatures_c)}",
            )
    ordered = sorted(maps, key=lambda m: (m.temperatures_c[sensor.name], m.label))
    clusters: list[list[ErrorMap]] = [[ordered[0]]]
    for error_map in ordered[1:]:
        first = clusters[-1][0]
        # From the first of them, not from the one before: small gaps would else chain maps that the
        # sensor tells apart.
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
    tables = iter(at_same_positions([m.tables[code] for cluster in clusters for m in cluster]))
    return [_state(cluster, tuple(islice(tables, len(cluster)))) for cluster in clusters]


def _state(cluster: Sequence[ErrorMap], tables: tuple[ComponentTable, ...]) -> _State:
    shared = set.intersection(*(set(m.temperatures_c) for m in cluster))
    return _State(
        label=" + ".join(m.label for m in cluster),
        temperatures_c={
            name: float(np.mean([m.temperatures_c[name] for m in cluster]))
            for name in sorted(shared)
        }
        if len(cluster) > 1
        else cluster[0].temperatures_c,
        tables=tables,
    )


def _bring_together(
    code: str, scales: Sequence[Scale], states: Sequence[_State], notes: list[str]
) -> _Part:
    """Put a component's tables on the union of their positions, and say how far each reaches."""
    tables = [table for state in states for table in state.tables]
    positions = united_positions(tables)
    backward = _backward_sources(code, scales[0].temperatures_c, states, notes)
    neighbours = sorted(
        {(min(pair), max(pair)) for scale in scales for pair in pairwise(scale.rows)}
    )
    ranges = np.array([common_range(state.tables) for state in states])
    return _Part(
        component=COMPONENTS[code],
        positions_mm=positions,
        ranges_mm=ranges,
        measured=np.array(
            [
                _measured_here(state, positions, backward[i] if backward else {}, states)
                for i, state in enumerate(states)
            ]
        ),
        forward=_combined(
            states, [_means(i, state) for i, state in enumerate(states)], positions, neighbours
        ),
        backward=None if backward is None else _combined(states, backward, positions, neighbours),
    )


def _means(i: int, state: _State) -> _Sources:
    return {(i, k, False): 1.0 / len(state.tables) for k in range(len(state.tables))}


def _backward_sources(
    code: str, scale_c: Sequence[float], states: Sequence[_State], notes: list[str]
) -> list[_Sources] | None:
    """Say what each state's backward errors are made of; None where no map is bidirectional.

    A map's errors are those approached in the positive direction; where it states no backward
    errors its reversal R = backward − forward is not known. The reversal then is that of the
    states that have it, held beyond them and between two of them linear in the assigned
    sensor's temperature T:

        E⁻_i(x) = E⁺_i(x) + R(x, T_i)

    So between a bidirectional and a unidirectional map the reversal stays what it is at the
    former: E⁻ = (1 − w) E⁻_n + w (E⁺_m + R_n) = [(1 − w) E⁺_n + w E⁺_m] + R_n. Beyond the positions
    of the map that has it, the reversal at its ends holds.
    """
    reversals: dict[int, _Sources] = {}
    for i, state in enumerate(states):
        both = [k for k, table in enumerate(state.tables) if table.backward_errors is not None]
        if both:
            reversals[i] = {
                (i, k, backward): sign / len(both)
                for k in both
                for backward, sign in ((True, 1.0), (False, -1.0))
            }
    if not reversals:
        return None
    with_reversal = sorted(reversals)
    by_state = []
    for i, state in enumerate(states):
        sources = _means(i, state)
        for j, share in _states_around(i, with_reversal, scale_c):
            for source, coefficient in reversals[j].items():
                sources[source] = sources.get(source, 0.0) + share * coefficient
        by_state.append({source: c for source, c in sources.items() if c != 0.0})
    lacking = [f"'{state.label}'" for i, state in enumerate(states) if i not in reversals]
    if lacking:
        having = [f"'{states[i].label}'" for i in with_reversal]
        notes.append(
            f"{code} has no backward errors in {list_names(lacking)}: the reversal of "
            f"{list_names(having)} holds there{_beyond_reversals(states, reversals)}"
        )
    return by_state


def _beyond_reversals(states: Sequence[_State], with_reversal: Collection[int]) -> str:
    """Say where the reversal was measured, if maps that lack it reach further."""
    ranges = np.array([common_range(state.tables) for state in states])
    lacking = [i for i in range(len(states)) if i not in with_reversal]
    low, high = ranges[list(with_reversal), 0].max(), ranges[list(with_reversal), 1].min()
    if ranges[lacking, 0].min() >= low and ranges[lacking, 1].max() <= high:
        return ""
    return f", measured from {from_to_mm(low, high)} only: beyond that what it is at its ends holds"


def _states_around(
    i: int, measured: Sequence[int], scale_c: Sequence[float]
) -> list[tuple[int, float]]:
    """Find the known states around a state on the scale, each with its share."""
    below = [j for j in measured if j <= i]
    above = [j for j in measured if j >= i]
    if not below or not above or below[-1] == above[0]:
        return [(below[-1] if below else above[0], 1.0)]
    low, high = below[-1], above[0]
    share = (scale_c[i] - scale_c[low]) / (scale_c[high] - scale_c[low])
    return [(low, 1.0 - share), (high, share)]


def _measured_here(
    state: _State, positions_mm: FloatArray, sources: _Sources, states: Sequence[_State]
) -> BoolArray:
    """Say at which positions a state's lines bend; one without dependence takes all."""
    low, high = common_range(state.tables)
    if not np.isfinite(low):
        return np.ones(max(positions_mm.size, 1), dtype=np.bool_)
    tables = [*state.tables, *(states[i].tables[k] for i, k, _ in sources)]
    measured: BoolArray = np.isin(positions_mm, united_positions(tables))
    return measured & (positions_mm >= low) & (positions_mm <= high)


def _check_common_ranges(
    code: str, scales: Sequence[Scale], states: Sequence[_State], part: _Part
) -> None:
    """Refuse maps that can be in use together and have no range of positions in common."""
    for scale in scales:
        for lower, upper in pairwise(scale.rows):
            low, high = common_range_of_rows(part.ranges_mm, (lower, upper))
            if low >= high:
                first, other = (
                    f"{states[row].label!r} ({from_to_mm(*part.ranges_mm[row])})"
                    for row in (lower, upper)
                )
                raise Conflict(
                    f"expected maps that follow each other in the temperature of {scale.sensor} "
                    f"to share a range of positions of {code}, got {first} and {other}: between "
                    "their temperatures there would be no table"
                )


def _combined(
    states: Sequence[_State],
    of_states: Sequence[_Sources],
    positions: FloatArray,
    neighbours: Sequence[tuple[int, int]],
) -> _Rows:
    """Add up what each state's errors are made of, sampled at the positions: (M, n).

    Outside its range a table's end values hold; nothing reads them there, but for reversals.
    """
    values, variances = [], []
    sampled: dict[_Source, FloatArray] = {}
    for sources in of_states:
        n = max(positions.size, 1)
        value, variance = np.zeros(n), np.zeros(n)
        for source, coefficient in sources.items():
            i, k, backward = source
            table = states[i].tables[k]
            value = value + coefficient * sample_table(table, positions, backward=backward)
            if source not in sampled:
                of_source = sample_variances(table, positions, backward=backward)
                sampled[source] = np.full(n, np.nan) if of_source is None else of_source
            # Maps, and the two directions of one, are measured independently.
            variance = variance + coefficient**2 * sampled[source]
        values.append(value)
        variances.append(variance)
    covariances = {}
    for first, other in neighbours:
        # Two sums over tables that are independent: their covariance is what they have in common.
        shared = of_states[first].keys() & of_states[other].keys()
        if shared:
            covariances[first, other] = np.sum(
                [of_states[first][s] * of_states[other][s] * sampled[s] for s in sorted(shared)],
                axis=0,
            )
    return _Rows(np.array(values), np.array(variances), covariances)


def _scales(machine: Machine, sensor: str, states: Sequence[_State]) -> tuple[Scale, ...]:
    """Make the assigned sensor's scale and those of its usable stand-ins.

    A stand-in is usable where every map states its temperature and its maps are
    further apart than it resolves; otherwise it cannot serve.
    """
    scales = []
    for candidate in machine.with_stand_ins(sensor):
        temperatures = [state.temperatures_c.get(candidate.name) for state in states]
        measured = [t for t in temperatures if t is not None]
        if len(measured) < len(states):
            continue
        # In the order of a stand-in the maps may follow each other differently.
        rows = np.argsort(measured, kind="stable")
        ordered = tuple(float(measured[row]) for row in rows)
        gaps = np.diff(ordered)
        if candidate.name == sensor or candidate.resolves(float(gaps.min())):
            scales.append(Scale(candidate.name, ordered, tuple(int(row) for row in rows)))
    return tuple(scales)


def _group(scales: tuple[Scale, ...], labels: tuple[str, ...], parts: Sequence[_Part]) -> Group:
    """Set the tables of one group side by side."""
    columns: list[_Rows] = []
    measured: list[BoolArray] = []
    members: list[Member] = []
    width = 0
    for part in parts:
        n = part.forward.values.shape[1]
        forward = slice(width, width + n)
        backward = None if part.backward is None else slice(width + n, width + 2 * n)
        directions = [part.forward] if part.backward is None else [part.forward, part.backward]
        columns += directions
        measured += [part.measured] * len(directions)
        width += n * len(directions)
        members.append(
            member_of(part.component, part.positions_mm, forward, backward, part.ranges_mm)
        )
    nodes = np.hstack([rows.values for rows in columns])
    variances = np.hstack([rows.variances for rows in columns])
    for matrix in (nodes, variances):
        matrix.flags.writeable = False
    has_variances = not np.isnan(variances).all()
    pairs = sorted({pair for rows in columns for pair in rows.covariances}) if has_variances else []
    return Group(
        scales,
        labels,
        tuple(members),
        nodes,
        np.hstack(measured),
        variances if has_variances else None,
        {
            pair: np.hstack(
                [rows.covariances.get(pair, np.zeros(rows.values.shape[1])) for rows in columns]
            )
            for pair in pairs
        },
    )

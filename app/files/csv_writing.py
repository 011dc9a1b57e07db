"""Maps and checks as the CSV files that are read of them, and templates to be filled in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from app.csv_text import csv_line, no_formula
from app.effects.observations import Observation, Verification
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ORDER, Component
from app.identification.plan.visit import NextVisit, PlannedPlace
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine

TEMPLATE_POSITIONS: Final = 5
"""Positions along an axis in a template; 0 to 100 mm where its travel is not stated."""

_USUAL_TRAVEL_MM: Final = (0.0, 100.0)
_SIGNS: Final = {1: "+", -1: "-", 0: ""}
_KINDS: Final = ("", "standard_", "backward_", "backward_standard_")


def csv_of_map(machine_id: str, error_map: ErrorMap) -> str:
    """Write an error map; what a table has no column for is named in a comment line.

    Reading it gives the same map, but for measuring lines and the covariances between positions.
    """
    tables = sorted(error_map.tables.values(), key=lambda one: ORDER[one.component.code])
    units = list(dict.fromkeys(table.component.unit for table in tables))
    kinds = [kind for kind in _KINDS if any(_values(table, kind) is not None for table in tables)]
    columns = [(kind, unit) for unit in units for kind in kinds]
    lines = [
        _comment("label", error_map.label),
        _comment("machine", machine_id),
        _comment("measured_at", _utc(error_map.measured_at)),
        *(_comment(f"temperature {s}", repr(t)) for s, t in error_map.temperatures_c.items()),
    ]
    if error_map.repeatability_um is not None:
        lines.append(_comment("repeatability_um", repr(error_map.repeatability_um)))
    if error_map.instrument:
        lines.append(_comment("instrument", error_map.instrument))
    lines += [
        f"# {words} are not in this file; the JSON has them\n" for words in _unsaid(error_map)
    ]
    lines.append(
        csv_line(["component", "position_mm", *(f"{kind}error_{unit}" for kind, unit in columns)])
    )
    for table in tables:
        values = {kind: _values(table, kind) for kind in kinds}
        for i, position in enumerate(table.positions_mm.tolist() or [""]):
            cells: list[Any] = []
            for kind, unit in columns:
                of_kind = values[kind]
                is_here = of_kind is not None and unit is table.component.unit
                cells.append(of_kind[i] if is_here and of_kind is not None else "")
            lines.append(csv_line([table.component.code, position, *cells]))
    return "".join(lines)


def csv_of_check(machine_id: str, check: Verification, notes: Iterable[str] = ()) -> str:
    """Write a check, of components and at points; reading it gives the same observations.

    `notes` are sentences without a colon, which are read by people alone.
    """
    lines = [
        _comment("label", check.label),
        _comment("machine", machine_id),
        _comment("datum", str(check.datum)),
    ]
    if check.repeatability_um is not None:
        lines.append(_comment("repeatability_um", repr(check.repeatability_um)))
    if check.instrument:
        lines.append(_comment("instrument", check.instrument))
    if check.operator:
        lines.append(_comment("operator", check.operator))
    lines += [f"# {no_formula(note)}\n" for note in notes]
    rows = [_cells(observation) for observation in check.observations]
    columns = sorted({name for row in rows for name in row}, key=_column_order)
    lines.append(csv_line(columns))
    lines += [csv_line([row.get(name, "") for name in columns]) for row in rows]
    return "".join(lines)


def map_template(machine: Machine, codes: Iterable[str]) -> str:
    """Write an empty error map of a machine: its sensors, components and positions."""
    lines = [
        "# label:\n",
        _comment("machine", machine.id),
        "# measured_at:\n",
        *(f"# temperature {sensor}:\n" for sensor in machine.sensors),
        "# One file for each thermal state. Error: actual minus nominal; angles in µrad,\n",
        "# squareness in µm/m and without a position. Lines that were not measured are left out.\n",
        csv_line(["component", "position_mm", "error_um"]),
    ]
    for component in _components(codes):
        lines += [csv_line([component.code, at, ""]) for at in _positions(machine, component)]
    return "".join(lines)


def check_template(machine: Machine, codes: Iterable[str]) -> str:
    """Write an empty check of a machine: its components, positions and both approaches."""
    lines = [
        "# label:\n",
        _comment("machine", machine.id),
        "# repeatability_um:\n",
        "# instrument:\n",
        "# operator:\n",
        "# Times with their zone, such as 2026-03-01T06:00:00Z; error: actual minus nominal.\n",
        csv_line(["time", "component", "position_mm", "direction", "measured_um"]),
    ]
    for component in _components(codes):
        places = _positions(machine, component)
        ways = [("+", at) for at in places] + [("-", at) for at in reversed(places)]
        ways = ways if component.is_table else [("", "")]
        lines += [csv_line(["", component.code, at, way, ""]) for way, at in ways]
    return "".join(lines)


def csv_of_visit(machine_id: str, visit: NextVisit) -> str:
    """Write a proposed visit, as planning and `thermap program visit` read it."""
    planned = visit.planned
    head = [f"label: {planned.label}", f"machine: {machine_id}", f"datum: {planned.datum}"]
    if planned.repeatability_um is not None:
        head.append(f"repeatability_um: {planned.repeatability_um!r}")
    # A sentence without a colon is read by people alone.
    head.append(visit.sentence.replace(":", ";"))
    rows = [_planned_cells(o) for o in planned.observations]
    used = sorted({name for row in rows for name in row}, key=_column_order)
    lines = [f"# {no_formula(line)}\n" for line in head]
    lines.append(csv_line(used))
    lines += [csv_line(row.get(column, "") for column in used) for row in rows]
    return "".join(lines)


def _planned_cells(place: PlannedPlace) -> Mapping[str, Any]:
    directions = place.direction or {}
    if place.component is not None or place.point_mm is None:
        cells: dict[str, Any] = {"time": place.time, "component": place.component}
        if place.position_mm is not None:
            cells["position_mm"] = place.position_mm
        for sign in directions.values():  # that of its own axis, or one of all
            cells["direction"] = sign
        return cells
    return {
        "time": place.time,
        **_of_axes("point_{}_mm", place.point_mm),
        **_of_axes("tool_{}_mm", place.tool_offset_mm),
        **{f"direction_{axis}": sign for axis, sign in directions.items()},
    }


def _of_axes(name: str, values: Sequence[float]) -> dict[str, float]:
    return {name.format(a): v for a, v in zip(LINEAR_LETTERS, values, strict=True)}


def _components(codes: Iterable[str]) -> list[Component]:
    return [COMPONENTS[code] for code in sorted(codes, key=ORDER.__getitem__)]


def _positions(machine: Machine, component: Component) -> Sequence[Any]:
    if not component.is_table:
        return [""]
    travel = machine.axes.get(component.axis or "")
    ends = _USUAL_TRAVEL_MM if travel is None else (travel.min_mm, travel.max_mm)
    return [float(f"{at:.6g}") for at in np.linspace(*ends, TEMPLATE_POSITIONS)]


def _values(table: ComponentTable, kind: str) -> Sequence[float] | None:
    """Give a table's values of one kind; standard errors are the roots of the variances."""
    errors = table.backward_errors if kind.startswith("backward_") else table.errors
    if not kind.endswith("standard_"):
        return None if errors is None else errors.tolist()
    covariance = table.backward_covariance if kind.startswith("backward_") else table.covariance
    if covariance is None:
        return None
    variances = np.diag(covariance) if covariance.ndim == 2 else covariance
    roots: list[float] = np.sqrt(variances).tolist()
    return roots


def _unsaid(error_map: ErrorMap) -> Iterator[str]:
    if error_map.measuring_lines:
        yield "measuring lines"
    matrices = [
        covariance
        for table in error_map.tables.values()
        for covariance in (table.covariance, table.backward_covariance)
        if covariance is not None and covariance.ndim == 2
    ]
    if any(np.any(matrix - np.diag(np.diag(matrix))) for matrix in matrices):
        yield "covariances between positions"


def _cells(observation: Observation) -> dict[str, Any]:
    """Write an observation as the cells of its line, by the names of the columns."""
    cells: dict[str, Any] = {"time": _utc(datetime.fromtimestamp(observation.time_s, UTC))}
    if observation.component is not None:
        component = COMPONENTS[observation.component]
        cells["component"] = observation.component
        if observation.position_mm is not None:
            cells["position_mm"] = observation.position_mm
            axis = LINEAR_LETTERS.index(component.axis or "x")
            cells["direction"] = _SIGNS[observation.directions[axis]]
        cells[f"measured_{component.unit}"] = observation.measured[0]
    else:
        for i, letter in enumerate(LINEAR_LETTERS):
            cells[f"point_{letter}_mm"] = (observation.point_mm or (0.0, 0.0, 0.0))[i]
            cells[f"measured_{letter}_um"] = observation.measured[i]
            cells[f"tool_{letter}_mm"] = observation.tool_offset_mm[i]
            cells[f"direction_{letter}"] = _SIGNS[observation.directions[i]]
    if observation.setup is not None:
        cells["setup"] = observation.setup
    return cells | {f"state {name}": value for name, value in observation.state.items()}


_COLUMNS: Final = (
    *("time", "component", "position_mm", "direction"),
    *(f"point_{axis}_mm" for axis in LINEAR_LETTERS),
    *(f"tool_{axis}_mm" for axis in LINEAR_LETTERS),
    *(f"direction_{axis}" for axis in LINEAR_LETTERS),
    *("measured_um", "measured_urad", "measured_um_per_m"),
    *(f"measured_{axis}_um" for axis in LINEAR_LETTERS),
    "setup",
)


def _column_order(name: str) -> tuple[int, str]:
    return (_COLUMNS.index(name) if name in _COLUMNS else len(_COLUMNS), name)


def _comment(key: str, text: str) -> str:
    return f"# {key}: {no_formula(text)}\n"


def _utc(time: datetime) -> str:
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")

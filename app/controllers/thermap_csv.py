"""Our own CSV: every component, both columns named, with unit and status."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.controllers.error_table import ErrorTable
from app.controllers.format import (
    ControllerFile,
    Format,
    Options,
    Parsed,
    Reading,
    Rendered,
    Status,
)
from app.controllers.heads import head
from app.controllers.lines import Line, lines_of, plain
from app.geometry.components import COMPONENTS, Component

TITLE: Final = "thermap CSV"
COLUMNS: Final = "component,axis,position_mm,direction,error,compensation,unit,status"
_DECIMALS: Final = 6
_LARGEST: Final = 1e5


def _render(table: ErrorTable, options: Options) -> Rendered:
    signs = "error = actual minus nominal, compensation = minus the error"
    lines = [f"# {x}" for x in head(table.origin, THERMAP_CSV, options, signs)]
    lines.append(COLUMNS)
    curves = []
    for curve in table.curves.values():
        loaded = curve.rounded(10.0**-_DECIMALS)
        positions = np.round(curve.positions_mm, _DECIMALS)
        curves.append(Curve(curve.component, positions, loaded.errors, loaded.backward_errors))
        lines += _rows(curves[-1], table.statuses.get(curve.code, ""))
    return Rendered([ControllerFile("thermap.csv", "\n".join(lines) + "\n")], curves)


def _rows(curve: Curve, status: str) -> list[str]:
    component = curve.component
    rows = []
    for direction, errors in curve.sides:
        for i, error in enumerate(errors):
            at = plain(float(curve.positions_mm[i]), _DECIMALS) if component.is_table else ""
            way = direction if curve.backward_errors is not None else ""
            values = (plain(float(v), _DECIMALS) for v in (error, -error))
            rows.append(
                ",".join(
                    [
                        component.code,
                        component.axis or "",
                        at,
                        way,
                        *values,
                        component.unit.value,
                        status,
                    ]
                )
            )
    return rows


def _parse(files: Sequence[ControllerFile], options: Options) -> Parsed:
    rows: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for file in files:
        lines = iter(lines_of(file.name, file.content, "#"))
        header = next(lines, None)
        if header is None or header.text != COLUMNS:
            raise (header or Line(file.name, 1, "")).refuse(COLUMNS)
        for line in lines:
            code, direction, position, error = _row(line)
            before = rows.setdefault((code, direction), [])
            if before and position <= before[-1][0]:
                raise line.refuse(f"increasing positions of {code}")
            before.append((position, error))
    reading = Reading("rows of components")
    reading.curves.update((code, _curve(code, rows)) for code, _ in rows)
    return reading.parsed(files)


def _row(line: Line) -> tuple[str, str, float, float]:
    cells = line.text.split(",")
    if len(cells) != COLUMNS.count(",") + 1:
        raise line.refuse(f"the columns {COLUMNS}")
    code, axis, position, direction, error, compensation, unit, _ = cells
    component: Component | None = COMPONENTS.get(code)
    if component is None or (component.axis or "") != axis or component.unit.value != unit:
        raise line.refuse("a component with its own axis and unit")
    if direction not in ("", FORWARD, BACKWARD) or bool(position) != component.is_table:
        raise line.refuse(
            "a direction +, - or none, and a position where the component has an axis"
        )
    value = line.number_of(error, "an error")
    if abs(value) > _LARGEST or abs(line.number_of(compensation, "a compensation") + value) > 1e-9:
        raise line.refuse("a compensation that is minus the error")
    return code, direction, line.position_mm(position) if position else 0.0, value


def _curve(code: str, rows: dict[tuple[str, str], list[tuple[float, float]]]) -> Curve:
    component = COMPONENTS[code]
    names = sorted(direction for c, direction in rows if c == code)
    first = np.array(rows[code, "" if "" in names else FORWARD] if names != [BACKWARD] else [])
    both = names == [FORWARD, BACKWARD]
    if names != [""] and not both:
        raise Line("rows", 1, code).refuse(f"rows of {code} for both directions, or for neither")
    at = frozen(first[:, 0]) if component.is_table else frozen([])[:0]
    if not both:
        return Curve(component, at, frozen(first[:, 1]))
    second = np.array(rows[code, BACKWARD])
    if not np.array_equal(second[:, 0], first[:, 0]):
        raise Line("rows", 1, code).refuse(f"the same positions of {code} in both directions")
    return Curve(component, at, frozen(first[:, 1]), frozen(second[:, 1]))


THERMAP_CSV: Final = Format(
    name="csv",
    title=TITLE,
    sign="error",
    units="as each row says",
    spacing="any",
    limits="none; every component",
    status=Status.OURS,
    holds=tuple(COMPONENTS),
    folds=False,
    both_directions=tuple(COMPONENTS),
    options=Options,
    render=_render,
    parse=_parse,
)

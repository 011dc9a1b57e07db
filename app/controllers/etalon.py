"""Etalon's exchange format, "Vendor" variant, as Beckhoff's and ISG's controls read it.

Blocks `[EXY]` with `Gridpoints = {` rows of position and value `}`, and `[C0Y]` with one VALUE;
comments begin with `//`. Errors as measured, in mm and rad. The rows are written as they are:
nothing is resampled.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import frozen
from app.controllers.curve import Curve
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
from app.controllers.iso_names import (
    BY_ISO_NAME,
    DECIMALS,
    POSITION_DECIMALS,
    WRITTEN,
    file_factor,
    iso_name,
    why_not_held,
)
from app.controllers.lines import LARGEST_ERROR_MM, Line, lines_of, plain, unsigned
from app.geometry.components import Component

TITLE: Final = "Etalon exchange format"
_BLOCK: Final = re.compile(r"\[\s*(\w+)\s*\]")
_VALUE: Final = re.compile(r"VALUE\s*=\s*(\S+)", re.IGNORECASE)
_GRID: Final = re.compile(r"Gridpoints\s*=\s*\{", re.IGNORECASE)
_LARGEST_RAD: Final = 0.1


def _render(table: ErrorTable, options: Options) -> Rendered:
    lines = [f"// {x}" for x in head(table.origin, ETALON, options)]
    loaded = []
    for curve in table.curves.values():
        factor = file_factor(curve.component)
        errors = np.round(curve.errors * factor, DECIMALS)
        at = np.round(curve.positions_mm, POSITION_DECIMALS)
        loaded.append(Curve(curve.component, frozen(at) if at.size else at, errors / factor))
        lines.append(f"[{iso_name(curve.component)}]")
        if curve.component.is_table:
            lines.append("Gridpoints = {")
            lines += [
                f"  {plain(float(p), POSITION_DECIMALS)} {unsigned(float(e), DECIMALS)}"
                for p, e in zip(at, errors, strict=True)
            ]
            lines.append("}")
        else:
            lines.append(f"VALUE = {unsigned(float(errors[0]), DECIMALS)}")
    return Rendered([ControllerFile("thermap.etalon", "\n".join(lines) + "\n")], loaded)


def _parse(files: Sequence[ControllerFile], options: Options) -> Parsed:
    reading = Reading("blocks such as [EXX]")
    for file in files:
        for curve in _blocks(file, reading):
            reading.add(curve, file.name)
    return reading.parsed(files)


def _blocks(file: ControllerFile, reading: Reading) -> list[Curve]:
    curves: list[Curve] = []
    component: Component | None = None
    unread: str | None = None
    rows: list[tuple[float, float]] | None = None
    line = Line(file.name, 1, "")
    for line in lines_of(file.name, file.content, "//"):
        if rows is not None and component is not None:
            if line.text == "}":
                curves.append(_table(component, rows, line))
                component, rows = None, None
            else:
                rows.append(_row(line, component, rows))
        elif (block := _BLOCK.fullmatch(line.text)) and component is None:
            unread = why_not_held(block[1].upper())
            if block[1].upper() in BY_ISO_NAME or unread is None:
                component, unread = _named(line, block[1]), None
            else:
                reading.leave_aside(f"[{block[1]}] of {file.name}", unread)
        elif unread is not None:
            continue
        elif component is not None and component.is_table and _GRID.fullmatch(line.text):
            rows = []
        elif component is not None and not component.is_table:
            curves.append(_single(line, component))
            component = None
        else:
            raise line.refuse("a block such as [EXX] with Gridpoints = {, rows and }")
    if component is not None:
        raise line.refuse(f"the end of the block of {component.code}: the file may be cut off")
    return curves


def _named(line: Line, name: str) -> Component:
    component = BY_ISO_NAME.get(name.upper())
    if component is None:
        raise line.refuse("an ISO 230-1 error such as EXX, EBX, C0Y or X0C")
    return component


def _row(
    line: Line, component: Component, before: Sequence[tuple[float, float]]
) -> tuple[float, float]:
    words = line.text.split()
    if len(words) != 2:
        raise line.refuse("a position and a value")
    position = line.position_mm(words[0])
    if before and position <= before[-1][0]:
        raise line.refuse("increasing positions")
    return position, value_of(line, words[1], component)


def value_of(line: Line, text: str, component: Component) -> float:
    """Read a component's value and give it in our unit and sign; larger than any is refused."""
    value = line.number_of(text, f"a value of {component.code}")
    # µrad to rad is 1e-6, µm to mm 1e-3.
    turns = abs(file_factor(component)) < 1e-5
    limit, unit = (_LARGEST_RAD, "rad") if turns else (LARGEST_ERROR_MM, "mm")
    if abs(value) > limit:
        raise line.refuse(f"a value of {component.code} within ±{limit:g} {unit}")
    return value / file_factor(component)


def _single(line: Line, component: Component) -> Curve:
    match = _VALUE.fullmatch(line.text)
    if match is None:
        raise line.refuse(f"VALUE = of {component.code}")
    return Curve(component, frozen([])[:0], frozen([value_of(line, match[1], component)]))


def _table(component: Component, rows: Sequence[tuple[float, float]], line: Line) -> Curve:
    if not rows:
        raise line.refuse(f"rows of {component.code}")
    at, errors = np.array(rows).T
    return Curve(component, frozen(at), frozen(errors))


ETALON: Final = Format(
    name="etalon",
    title=TITLE,
    sign="error",
    units="mm and rad",
    spacing="any, increasing",
    limits="one direction; no nonrigid slopes",
    status=Status.SOURCE,
    holds=WRITTEN,
    folds=False,
    both_directions=(),
    options=Options,
    render=_render,
    parse=_parse,
)

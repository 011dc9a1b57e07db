"""ISG's CSV: blocks of columns, one block an axis, as ISG's and Beckhoff's controls read it.

The header names the argument and the errors, `X EXX EYX EZX EAX EBX ECX`; rows are separated by
blanks, a block ends with `#`, comments begin with `//`. Squareness and rotary-axis locations stand
in a block without argument, one row. Errors as measured, in mm and rad; the list file of the
control has `negate` for the other sign. On the union of an axis' positions nothing is lost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray, frozen
from app.controllers.curve import Curve
from app.controllers.error_table import ErrorTable
from app.controllers.etalon import value_of
from app.controllers.format import (
    ControllerFile,
    Format,
    Options,
    Parsed,
    Reading,
    Rendered,
    Status,
    axes_of,
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
from app.controllers.lines import Line, lines_of, plain, unsigned
from app.geometry.components import Component

TITLE: Final = "ISG CSV"


def _render(table: ErrorTable, options: Options) -> Rendered:
    lines = [f"// {x}" for x in head(table.origin, ISG, options)]
    rendered_curves: list[Curve] = []
    blocks = []
    single = [c for c in table.curves.values() if not c.component.is_table]
    if single:
        blocks.append(_block("", frozen([0.0]), single, rendered_curves))
    for axis in axes_of(table):
        curves = [c for c in table.curves.values() if c.component.axis == axis]
        at = np.unique(
            np.concatenate([np.round(c.positions_mm, POSITION_DECIMALS) for c in curves])
        )
        blocks.append(_block(axis.upper(), at, curves, rendered_curves))
    for i, block in enumerate(blocks):
        lines += (["#"] if i else []) + block
    return Rendered([ControllerFile("thermap.csv", "\n".join(lines) + "\n")], rendered_curves)


def _block(
    argument: str, at: FloatArray, curves: Sequence[Curve], rendered_curves: list[Curve]
) -> list[str]:
    columns = []
    for curve in curves:
        factor = file_factor(curve.component)
        errors = np.round(curve.at(at) * factor, DECIMALS)
        columns.append(errors)
        positions = frozen(at) if curve.component.is_table else frozen([])[:0]
        rendered_curves.append(Curve(curve.component, positions, errors / factor))
    names = [iso_name(curve.component) for curve in curves]
    lines = [" ".join([argument, *names]).strip()]
    for i, position in enumerate(at):
        values = [unsigned(float(column[i]), DECIMALS) for column in columns]
        place = [plain(float(position), POSITION_DECIMALS)] if argument else []
        lines.append(" ".join([*place, *values]))
    return lines


def _parse(files: Sequence[ControllerFile], options: Options) -> Parsed:
    reading = Reading("blocks such as X EXX EYX with rows")
    for file in files:
        for header, rows in _blocks(file):
            for curve in _curves(header, rows, reading):
                reading.add(curve, file.name)
    return reading.parsed(files)


def _blocks(file: ControllerFile) -> Iterator[tuple[Line, list[Line]]]:
    block: list[Line] = []
    for line in lines_of(file.name, file.content, "//"):
        if line.text.startswith("#"):
            if block:
                yield block[0], block[1:]
            block = []
        else:
            block.append(line)
    if block:
        yield block[0], block[1:]


def _curves(header: Line, rows: Sequence[Line], reading: Reading) -> list[Curve]:
    names = header.text.upper().split()
    argument = names[0] if names[0] in ARGUMENTS else ""
    errors = names[1 if argument else 0 :]
    components = [_named(header, name, reading) for name in errors]
    if not errors or len(set(errors)) < len(errors) or not rows:
        raise header.refuse("an argument such as X, errors of ISO 230-1 each once, and rows")
    if any((c.axis or "").upper() != argument for c in components if c is not None):
        raise header.refuse("errors of the argument's axis alone, such as X EXX EYX")
    if not argument and len(rows) != 1:
        raise rows[1].refuse("one row of errors that depend on no position")
    table = [_row(line, argument, components) for line in rows]
    at = np.array([row[0] for row in table])
    for line, gap in zip(rows[1:], np.diff(at), strict=True):
        if not gap > 0 and argument:
            raise line.refuse("increasing positions")
    values = np.array([row[1:] for row in table])
    positions = frozen(at) if argument else frozen([])[:0]
    return [
        Curve(c, positions, frozen(values[:, i])) for i, c in enumerate(components) if c is not None
    ]


ARGUMENTS: Final = tuple("XYZABCUVW")
"""What errors may lie along; along rotary and parallel axes they are left aside."""


def _named(header: Line, name: str, reading: Reading) -> Component | None:
    """Give the component of a column; None where it is an error that is left aside."""
    component = BY_ISO_NAME.get(name)
    if component is None:
        why_not = why_not_held(name)
        if why_not is None:
            raise header.refuse("an ISO 230-1 error such as EXX, EBX, C0Y or X0C, or one argument")
        reading.leave_aside(f"{name} of {header.file}", why_not)
    return component


def _row(line: Line, argument: str, components: Sequence[Component | None]) -> list[float]:
    words = line.text.split()
    position = [line.position_mm(words[0])] if argument else [0.0]
    values = words[1:] if argument else words
    if len(values) != len(components):
        raise line.refuse(f"{len(components)} values")
    return position + [
        line.number_of(v, "a value") if c is None else value_of(line, v, c)
        for v, c in zip(values, components, strict=True)
    ]


ISG: Final = Format(
    name="isg-csv",
    title=TITLE,
    sign="error",
    units="mm and rad",
    spacing="any, increasing; the errors of an axis share their positions",
    limits="one direction; no nonrigid slopes",
    status=Status.SOURCE,
    holds=WRITTEN,
    folds=False,
    both_directions=(),
    options=Options,
    render=_render,
    parse=_parse,
)

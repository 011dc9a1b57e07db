"""Heidenhain non-linear axis error compensation: `.COM` tables, and the `.CMA` that assigns them.

The form is that of C. Wang, 8.4.3, Table 8.5.
A `.COM` stands in the `.CMA` under the axis that moves; its columns are the axes that it
compensates. Positions count from the machine's datum, at distances of a power of two of 0.1 µm.

Newer controls (TNC 620, TNC 640, MANUALplus 620) have another form, which is read and not written:
positions in the column AXISPOS, the columns named by their axes, and a line of the `.CMA` that is
marked with * in ACTIVE. Cells may be empty, so that the columns are where their names stand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from app.arrays import FloatArray
from app.controllers.curve import Curve
from app.controllers.error_table import TRANSLATIONS, ErrorTable
from app.controllers.format import (
    Axis,
    ControllerFile,
    Count,
    Format,
    Joint,
    Label,
    Parsed,
    Reading,
    Rendered,
    SignedOptions,
    Status,
    axes_of,
    curve_code,
    curve_read,
    factor_of,
    of_axis,
)
from app.controllers.grids import FINEST_MM, down_to_finest, even_grid
from app.controllers.lines import Line, fixed, lines_of
from app.errors import InvalidContent, list_names
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

TITLE: Final = "Heidenhain non-linear axis error compensation (.COM, .CMA)"
MOST_ROWS: Final = 256
FINEST_POWER: Final = 6
COARSEST_POWER: Final = 23
_DECIMALS: Final = 5
_COM: Final = re.compile(
    r"BEGIN\s+(\S+)\.COM\s+DATUM:\s*([+-]?[\d.]+)\s+DIST:\s*(\d{1,3})", re.IGNORECASE | re.ASCII
)
_CMA: Final = re.compile(r"BEGIN\s+(\S+)\.CMA\s+ACT:\s*(\d{1,4})", re.IGNORECASE | re.ASCII)
_NEWER: Final = re.compile(r"BEGIN\s+(\S+)\.(COM|CMA)(?:\s+MM)?", re.IGNORECASE | re.ASCII)
_INCHES: Final = re.compile(r"BEGIN\s+\S+\.(?:COM|CMA)\s+INCH", re.IGNORECASE | re.ASCII)
_COLUMN: Final = re.compile(r"(\d)\s*=\s*f\s*\(\s*\)", re.IGNORECASE | re.ASCII)
_NUMBER: Final = re.compile(r"\d{1,2}", re.ASCII)


class HeidenhainOptions(SignedOptions):
    """Options of Heidenhain's tables."""

    numbering: ClassVar[str] = "columns"
    layout: ClassVar[frozenset[str]] = frozenset(("name", "power"))

    name: Label = Field("thermap", description="What the files' names begin with")
    columns: dict[Axis, Annotated[Count, Field(ge=1, le=9)]] = Field(
        default_factory=lambda: {"x": 1, "y": 2, "z": 3}, description="Column of each axis"
    )
    power: Annotated[Count, Field(ge=FINEST_POWER, le=COARSEST_POWER)] | None = Field(
        None,
        description="DIST: points are 2^power × 0.1 µm apart (13: 0.8192 mm, 16: 6.5536 mm); the "
        "finest that needs at most 256 rows where not stated",
    )


def _render(table: ErrorTable, options: HeidenhainOptions) -> Rendered:
    files, rendered_curves = [], []
    assigned: dict[int, str] = {}
    for axis in axes_of(table):
        curves = [c for c in table.curves.values() if c.component.axis == axis]
        power, at = _grid(curves, options)
        loaded = [c.sampled(at).rounded(10.0**-_DECIMALS * UM_PER_MM) for c in curves]
        name = f"{options.name}{axis.upper()}"
        content = _com(name, power, at, loaded, options)
        files.append(ControllerFile(f"{name}.COM", content, axis=axis))
        assigned[_column(options, axis)] = name
        rendered_curves += loaded
    files.append(_cma(options, [assigned]))
    points = sum(loaded.positions_mm.size for loaded in rendered_curves)
    limits = (
        f"the control limits the sum of all compensation points and the number of .COM files as "
        f"well (module 9095, errors 4 and 5): these are {points} points in {len(assigned)} files"
    )
    return Rendered(files, rendered_curves, [limits])


def _cma(options: HeidenhainOptions, lines: Sequence[Mapping[int, str]]) -> ControllerFile:
    """Write which `.COM` each axis' column has in each line; the first one is active."""
    columns = range(1, max(column for line in lines for column in line) + 1)
    text = [f"BEGIN {options.name}.CMA ACT: 0", "NR " + " ".join(map(str, columns))]
    for number, line in enumerate(lines):
        text.append(" ".join([str(number), *(line.get(column, "-") for column in columns)]))
    content = "\n".join([*text, "[END]"]) + "\n"
    return ControllerFile(f"{options.name}.CMA", content, "settings")


def _joint(bands: Sequence[Sequence[ControllerFile]], options: HeidenhainOptions) -> Joint:
    """Write one `.CMA` with a line for each band, so that the control has only to change ACT."""
    lines = [
        {
            _column(options, file.axis): file.name.removesuffix(".COM")
            for file in files
            if file.axis is not None and file.role == "table"
        }
        for files in bands
    ]
    joint = _cma(options, lines)
    return Joint(
        [joint],
        [
            f"{joint.name} has a line for each band, with the tables of all of them beside it: "
            f"{len(lines)} lines from 0, and ACT: 0 makes the first band active"
        ],
    )


def _column(options: HeidenhainOptions, axis: str) -> int:
    return of_axis(options.columns, axis, "columns")


def _grid(curves: Sequence[Curve], options: HeidenhainOptions) -> tuple[int, FloatArray]:
    """Choose the power of two, and lay the grid from the begin of the axis' curves."""
    low = down_to_finest(min(float(c.positions_mm[0]) for c in curves))
    high = max(float(c.positions_mm[-1]) for c in curves)
    # Less a hair: where a power fits exactly, rounding of the logarithm would choose the next one,
    # twice as coarse.
    finest = math.ceil(math.log2((high - low) / (MOST_ROWS - 1) / FINEST_MM) - 1e-9)
    power = options.power if options.power is not None else max(finest, FINEST_POWER)
    if power < finest or power > COARSEST_POWER:
        raise InvalidContent.of_field(
            "options.power",
            f"expected a power from {finest} to {COARSEST_POWER} for at most {MOST_ROWS} rows over "
            f"{high - low:g} mm, got {power}",
        )
    return power, even_grid(low, high, 2.0**power * FINEST_MM, low)


def _com(
    name: str, power: int, at: FloatArray, curves: Sequence[Curve], options: HeidenhainOptions
) -> str:
    factor = factor_of(options.sign)
    ordered = sorted(curves, key=lambda c: _column(options, c.component.direction))
    columns = [f"{_column(options, c.component.direction)} = f ( )" for c in ordered]
    lines = [
        f"BEGIN {name}.COM DATUM: {_position(float(at[0]))} DIST: {power}",
        "NR " + " ".join(columns),
    ]
    for i, position in enumerate(at):
        values = [_value(factor * float(c.errors[i]) / UM_PER_MM) for c in ordered]
        lines.append(" ".join([str(i), _position(float(position)), *values]))
    return "\n".join([*lines, "[END]"]) + "\n"


def _position(value: float) -> str:
    """Write +0.8192, +4.096 and +0.0."""
    whole, _, digits = fixed(value, 4).partition(".")
    return f"{whole}.{digits.rstrip('0') or '0'}"


def _value(value: float) -> str:
    """Write -0.00027 and +0."""
    return fixed(value, _DECIMALS).rstrip("0").rstrip(".") if value else "+0"


def _parse(files: Sequence[ControllerFile], options: HeidenhainOptions) -> Parsed:
    reading = Reading("a .COM table")
    assigned: dict[str, str] = {}
    others: set[str] = set()
    tables: list[tuple[str, list[Line]]] = []
    for file in files:
        lines = list(lines_of(file.name, file.content))
        if not lines or lines[-1].text.upper() != "[END]":
            raise InvalidContent.of_field(
                f"files.{file.name}", "expected [END] as the last line, the file may be cut off"
            )
        if _INCHES.match(lines[0].text):
            raise lines[0].refuse("a table in MM")
        newer = _NEWER.fullmatch(lines[0].text)
        if _CMA.fullmatch(lines[0].text) or (newer and newer[2].upper() == "CMA"):
            read = _newer_assignment if newer else _assignment
            active, inactive = read(_as_written(file, lines) if newer else lines, options)
            assigned |= active
            others |= inactive
        elif newer or _COM.fullmatch(lines[0].text):
            tables.append((file.name, _as_written(file, lines) if newer else lines))
        else:
            raise lines[0].refuse("BEGIN name.COM DATUM: +0.0 DIST: 13, or BEGIN name.CMA ACT: 0")
    for file_name, lines in tables:
        heading = _COM.fullmatch(lines[0].text) or _NEWER.fullmatch(lines[0].text)
        assert heading is not None
        name = heading[1].upper()
        if name in others - assigned.keys():
            reading.leave_aside(file_name, "the active line of the .CMA does not name it")
            continue
        axis = assigned.get(name) or name[-1:].lower()
        if assigned and name not in assigned:
            raise lines[0].refuse("a table that the .CMA assigns")
        if axis not in [*LINEAR_LETTERS]:
            if name not in assigned:
                raise lines[0].refuse(
                    "a table that the .CMA assigns, or a name that ends in X to Z"
                )
            reading.leave_aside(file_name, f"it is of axis {axis.upper()}, not of X, Y or Z")
            continue
        if _COM.fullmatch(lines[0].text):
            curves = _curves(lines, axis, options)
        else:
            curves = _newer_curves(lines, axis, options, reading)
        for curve in curves:
            reading.add(curve, file_name)
    return reading.parsed(files)


def _as_written(file: ControllerFile, lines: Sequence[Line]) -> list[Line]:
    """Give lines with the blanks at their begin, without which columns would be elsewhere."""
    raw = file.content.replace("\r\n", "\n").split("\n")
    return [line._replace(text=raw[line.number - 1].rstrip()) for line in lines]


def _cells(header: Line, line: Line) -> dict[str, str]:
    """Take a row apart: each word belongs to the column whose name begins where it does.

    Raises
    ------
    InvalidContent
        If a word stands under no column's name, or there are tabulators, which have no width.
    """
    if "\t" in header.text + line.text:
        raise line.refuse("columns of blanks, without tabulators")
    begins = {m.start(): m[0].upper() for m in re.finditer(r"\S+", header.text)}
    cells = {}
    for word in re.finditer(r"\S+", line.text):
        name = begins.get(word.start())
        if name is None:
            raise line.refuse(f"each value where the name of its column begins ({header.text})")
        cells[name] = word[0]
    return cells


def _newer_assignment(
    lines: Sequence[Line], options: HeidenhainOptions
) -> tuple[dict[str, str], set[str]]:
    """Read the marked line of a newer .CMA: which axis each .COM belongs to; and all names."""
    header = lines[1]
    if header.text.upper().split()[:2] != ["NR", "ACTIVE"] or len(lines) < 4:
        raise header.refuse("NR ACTIVE X Y Z, and a line")
    active: dict[str, str] | None = None
    names: set[str] = set()
    for line in lines[2:-1]:
        cells = _cells(header, line)
        tables = {
            cell.upper().removesuffix(".COM"): name.lower()
            for name, cell in cells.items()
            if name not in ("NR", "ACTIVE") and cell != "-"
        }
        names |= tables.keys()
        if "ACTIVE" in cells:
            if cells["ACTIVE"] != "*" or active is not None:
                raise line.refuse("one active line, marked with *")
            active = tables
    if active is None:
        raise header.refuse("a line that is marked with * in ACTIVE: without one nothing acts")
    return active, names


def _newer_curves(
    lines: Sequence[Line], axis: str, options: HeidenhainOptions, reading: Reading
) -> list[Curve]:
    header = lines[1]
    columns = header.text.upper().split()
    if columns[:2] != ["NR", "AXISPOS"] or len(set(columns)) < len(columns):
        raise header.refuse("NR AXISPOS BACKLASH X Y Z, each column once")
    at: list[float] = []
    values: dict[str, list[float]] = {}
    for number, line in enumerate(lines[2:-1]):
        cells = _cells(header, line)
        if cells.pop("NR", "") != str(number) or "AXISPOS" not in cells:
            raise line.refuse(f"row {number} with a position")
        position = line.position_mm(cells.pop("AXISPOS"))
        if at and position <= at[-1]:
            raise line.refuse("increasing positions")
        at.append(position)
        if "BACKLASH" in cells:
            raise line.refuse(
                "no value in BACKLASH: the values of the negative direction are not read"
            )
        if values and cells.keys() != values.keys():
            raise line.refuse(f"values of {list_names(values)}, as in the row before")
        for name, cell in cells.items():
            values.setdefault(name, []).append(line.error_mm(cell))
    if len(at) < 2:
        raise header.refuse(f"2 rows or more, not {len(at)}")
    curves = []
    for name, column in values.items():
        if name.lower() not in [*LINEAR_LETTERS]:
            reading.leave_aside(f"column {name} of {header.file}", "it is not of X, Y or Z")
            continue
        errors = factor_of(options.sign) * np.array(column) * UM_PER_MM
        curves.append(curve_read(curve_code(name.lower(), axis), at, errors))
    return curves


def _assignment(
    lines: Sequence[Line], options: HeidenhainOptions
) -> tuple[dict[str, str], set[str]]:
    """Read which axis each .COM of the active line belongs to, and what other lines name."""
    heading = _CMA.fullmatch(lines[0].text)
    assert heading is not None
    active = int(heading[2])
    columns = lines[1].text.upper().split() if len(lines) > 2 else []
    if columns[:1] != ["NR"] or not all(map(_NUMBER.fullmatch, columns[1:])):
        raise lines[1].refuse("NR 1 2 3")
    axes = {number: axis for axis, number in options.columns.items()}
    lines_by_number: dict[int, dict[str, str]] = {}
    for line in lines[2:-1]:
        words = line.text.split()
        number = line.whole(words[0], "the line")
        if len(words) != len(columns) or number in lines_by_number:
            raise line.refuse(f"{len(columns) - 1} names of .COM files, each line once")
        pairs = zip(columns[1:], words[1:], strict=True)
        lines_by_number[number] = {
            w.upper().removesuffix(".COM"): axes.get(int(c), "") for c, w in pairs if w != "-"
        }
    if active not in lines_by_number:
        raise lines[0].refuse("the number of a line of this table as ACT")
    return lines_by_number[active], {name for line in lines_by_number.values() for name in line}


def _curves(lines: Sequence[Line], axis: str, options: HeidenhainOptions) -> list[Curve]:
    heading = _COM.fullmatch(lines[0].text)
    assert heading is not None
    datum, power = lines[0].position_mm(heading[2]), int(heading[3])
    if not FINEST_POWER <= power <= COARSEST_POWER:
        raise lines[0].refuse(f"DIST from {FINEST_POWER} to {COARSEST_POWER}")
    outputs = _outputs(lines[1], options)
    rows = lines[2:-1]
    if not 2 <= len(rows) <= MOST_ROWS:
        raise lines[1].refuse(f"2 to {MOST_ROWS} rows, not {len(rows)}")
    at = np.round(datum + np.arange(len(rows)) * 2.0**power * FINEST_MM, 4)
    values = [_row(line, i, float(at[i]), len(outputs)) for i, line in enumerate(rows)]
    factor = factor_of(options.sign) * UM_PER_MM
    columns = np.array(values).T * factor
    return [
        curve_read(curve_code(output, axis), at, errors)
        for output, errors in zip(outputs, columns, strict=True)
    ]


def _outputs(line: Line, options: HeidenhainOptions) -> list[str]:
    text = line.text
    numbers = [int(n) for n in _COLUMN.findall(text)]
    rest = _COLUMN.sub("", text).split()
    axes: dict[int, str] = {number: axis for axis, number in options.columns.items()}
    if rest not in (["NR"], ["nr"]) or not numbers or len(set(numbers)) < len(numbers):
        raise line.refuse("NR 1 = f ( ) with each axis once")
    if any(n not in axes for n in numbers):
        raise line.refuse(f"the columns {sorted(axes)} (options.columns)")
    return [axes[n] for n in numbers]


def _row(line: Line, number: int, position_mm: float, columns: int) -> list[float]:
    words = line.text.split()
    if len(words) != columns + 2 or line.whole(words[0], "the row") != number:
        raise line.refuse(f"row {number} with a position and {columns} values")
    if abs(line.position_mm(words[1]) - position_mm) > FINEST_MM:
        raise line.refuse(
            f"the position {position_mm:g} mm that DATUM and DIST give (positions count from the "
            "machine's datum)"
        )
    return [line.error_mm(word) for word in words[2:]]


def _named_by_band(options: HeidenhainOptions, band: int, _tables: int) -> HeidenhainOptions:
    """Name a band's tables so that all of them lie in the control side by side."""
    return options.model_copy(update={"name": f"{options.name[:24]}{band + 1}_"})


HEIDENHAIN: Final = Format(
    name="heidenhain",
    title=TITLE,
    sign=None,
    units="mm",
    spacing="a power of two times 0.1 µm (2^6 to 2^23)",
    limits=f"{MOST_ROWS} rows a table; one direction",
    status=Status.SEED,
    holds=TRANSLATIONS,
    folds=True,
    both_directions=(),
    options=HeidenhainOptions,
    render=_render,
    parse=_parse,
    for_band=_named_by_band,
    joint=_joint,
)

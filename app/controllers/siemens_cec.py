"""Siemens 840D sag and cross compensation, `$AN_CEC` (C. Wang, 8.4.1, Table 8.3).

Equidistant tables that move an output axis with an input axis; the value outside is that of
the end. Two tables serve the two directions. Every point is written: a gap would keep what
stood there before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from pydantic import Field

from app.arrays import frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.controllers.error_table import TRANSLATIONS, ErrorTable
from app.controllers.format import (
    AxisNames,
    ControllerFile,
    Count,
    Decimals,
    EvenSpacing,
    Format,
    HomeOptions,
    Parsed,
    Reading,
    Rendered,
    SignedOptions,
    Status,
    curve_code,
    curve_read,
    factor_of,
    of_axis,
    steps_at_home,
)
from app.controllers.heads import head
from app.controllers.lines import fixed
from app.controllers.siemens import (
    EvenTable,
    Program,
    evenly,
    placing,
    program,
    switched_off,
    written,
)
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS
from app.units import UM_PER_MM

FILE: Final = "_N_NC_CEC_INI"
TITLE: Final = "Siemens 840D sag compensation (CEC)"
_DIRECTIONS: Final = {None: 0, FORWARD: 1, BACKWARD: -1}
_PLACED: Final = ("AN_CEC_STEP", "AN_CEC_MIN", "AN_CEC_MAX")
_SETTINGS: Final = frozenset(
    (
        *_PLACED,
        *("AN_CEC_INPUT_AXIS", "AN_CEC_OUTPUT_AXIS", "AN_CEC_DIRECTION"),
        *("AN_CEC_MULT_BY_TABLE", "AN_CEC_IS_MODULO"),
    )
)


_SWITCHES: Final = ("SN_CEC_TABLE_ENABLE", "MA_CEC_ENABLE")


class CecOptions(SignedOptions, HomeOptions):
    """Options of CEC tables."""

    numbering: ClassVar[str] = "axes"
    layout: ClassVar[frozenset[str]] = frozenset(
        ("first_table", "most_tables", "most_points", "spacing_mm", "decimals", "home_mm")
    )

    axes: AxisNames = Field(default_factory=lambda: {"x": "AX1", "y": "AX2", "z": "AX3"})
    first_table: Annotated[Count, Field(ge=0, le=999)] = Field(
        0, description="Number of the first table"
    )
    most_tables: Annotated[Count, Field(ge=1, le=1000)] = Field(
        62, description="How many tables the controller has (828D: 8)"
    )
    most_points: Annotated[Count, Field(ge=2, le=5000)] = Field(
        200, description="Points that a table may have: machine data 18342 (828D: 200)"
    )
    spacing_mm: EvenSpacing = None
    decimals: Decimals = 4


def _render(table: ErrorTable, options: CecOptions) -> Rendered:
    factor, number = factor_of(options.sign), options.first_table
    lines, curves = [], []
    for curve in table.curves.values():
        loaded = evenly(curve, options)
        curves.append(loaded)
        for direction, errors in loaded.sides:
            way = None if loaded.backward_errors is None else direction
            values = [fixed(factor * e / UM_PER_MM, options.decimals) for e in errors]
            lines += _table(number, loaded, values, _DIRECTIONS[way], options)
            number += 1
    if number - options.first_table > options.most_tables:
        raise InvalidContent.of_field(
            "options.most_tables",
            f"expected at most {options.most_tables} tables, got components and directions that "
            f"need {number - options.first_table}; name fewer in options.components",
        )
    return Rendered(
        [written(FILE, head(table.origin, SIEMENS_CEC, options), lines)],
        curves,
        [
            "load CEC tables with MD 32710 CEC_ENABLE off, then switch it on with SD 41300 "
            "CEC_TABLE_ENABLE of each table",
            *steps_at_home(curves, options, "as soon as the tables act"),
        ],
    )


def _table(
    number: int, curve: Curve, values: Sequence[str], direction: int, options: CecOptions
) -> list[str]:
    # All of them, also those at their defaults: what the file leaves out keeps its old value in the
    # control.
    settings = {
        "INPUT_AXIS": f"({_name_of(str(curve.component.axis), options)})",
        "OUTPUT_AXIS": f"({_name_of(curve.component.direction, options)})",
        **placing(curve),
        "DIRECTION": str(direction),
        "MULT_BY_TABLE": "0",
        "IS_MODULO": "0",
    }
    rows = [f"$AN_CEC[{number},{place}]={value}" for place, value in enumerate(values)]
    return rows + [f"$AN_CEC_{name}[{number}]={value}" for name, value in settings.items()]


def _name_of(axis: str, options: CecOptions) -> str:
    return of_axis(options.axes, axis, "axes")


def _parse(files: Sequence[ControllerFile], options: CecOptions) -> Parsed:
    factor = factor_of(options.sign) * UM_PER_MM
    reading = Reading("CEC tables ($AN_CEC[t,N]=…)")
    sides: dict[tuple[str, int], tuple[list[float], list[float]]] = {}
    for file in files:
        read = program(file, "AN_CEC", _SWITCHES, reading)
        tables = _tables_of(read)
        outputs = {number: _output_of(table, file, number) for number, table in tables.items()}
        # Once for all tables: `switch` takes it out, and what is left over is said to switch
        # nothing.
        axis_switches = {name: read.switch("MA_CEC_ENABLE", name) for name in outputs.values()}
        for number, table in tables.items():
            field = _field(file, number)
            why_not = (
                switched_off(read.switch("SN_CEC_TABLE_ENABLE", str(number)))
                or switched_off(axis_switches[outputs[number]])
                or _not_ours(table, options, field)
            )
            if why_not is not None:
                reading.leave_aside(f"table {number} of {file.name}", why_not)
                continue
            code = _code_of(table, options, field)
            direction = _direction_of(table, field)
            if (
                any(c == code and 0 in (d, direction) for c, d in sides)
                or (code, direction) in sides
            ):
                raise InvalidContent.of_field(
                    field, f"expected one table of {code} for each direction, got two that add up"
                )
            at = table.grid(_PLACED, field)
            sides[code, direction] = (at, [value * factor for value in table.ordered()])
        read.leave_rest_aside(reading)
    reading.curves.update((code, _joined(code, sides)) for code, _ in sides)
    return reading.parsed(files)


def _tables_of(read: Program) -> dict[int, EvenTable]:
    tables: dict[int, EvenTable] = {}
    for assignment in read.assignments:
        table = tables.setdefault(assignment.number(0), EvenTable.empty())
        if assignment.name == "AN_CEC":
            table.set_value(
                assignment, assignment.number(1), assignment.line.error_mm(assignment.value)
            )
        elif assignment.name in _SETTINGS:
            table.set_setting(assignment)
        else:
            raise assignment.line.refuse("a known setting of a CEC table")
    return tables


_AXES: Final = ("AN_CEC_OUTPUT_AXIS", "AN_CEC_INPUT_AXIS")


def _field(file: ControllerFile, number: int) -> str:
    return f"files.{file.name}.table {number}"


def _output_of(table: EvenTable, file: ControllerFile, number: int) -> str:
    return table.setting(_AXES[0], _field(file, number)).value.upper()


def _not_ours(table: EvenTable, options: CecOptions, field: str) -> str | None:
    """Say which axis of a table is none of those that the options name; None if both are."""
    names = {name.upper() for name in options.axes.values()}
    others = [v for name in _AXES if (v := table.setting(name, field).value.upper()) not in names]
    if not others:
        return None
    return f"{others[0]} is none of the axes {list_names(sorted(names))} (options.axes)"


def _code_of(table: EvenTable, options: CecOptions, field: str) -> str:
    axes = {name.upper(): axis for axis, name in options.axes.items()}
    output, moving = (axes[table.setting(name, field).value.upper()] for name in _AXES)
    for name in ("AN_CEC_MULT_BY_TABLE", "AN_CEC_IS_MODULO"):
        flag = table.setting(name, field)  # one that is missing keeps what it was
        if flag.value != "0":
            raise flag.line.refuse("0: a table that multiplies or repeats is no error of an axis")
    return curve_code(output, moving)


def _direction_of(table: EvenTable, field: str) -> int:
    setting = table.setting("AN_CEC_DIRECTION", field)
    if setting.value not in ("0", "1", "+1", "-1"):
        raise setting.line.refuse("0 (both), 1 or -1")
    return int(setting.value)


def _joined(code: str, sides: dict[tuple[str, int], tuple[list[float], list[float]]]) -> Curve:
    """Join the tables of both directions; a missing one is 0: the controller adds nothing."""
    if (code, 0) in sides:
        return curve_read(code, *sides[code, 0])
    by_direction = {
        direction: curve_read(code, at, values)
        for (c, direction), (at, values) in sides.items()
        if c == code
    }
    at = sorted({float(p) for curve in by_direction.values() for p in curve.positions_mm})
    both = [
        by_direction[d].at(frozen(at)) if d in by_direction else frozen([0.0] * len(at))
        for d in (1, -1)
    ]
    return Curve(COMPONENTS[code], frozen(at), both[0], both[1])


def _numbered_by_band(options: CecOptions, _band: int, tables: int) -> CecOptions:
    """Number a band's tables after those before it: SD 41300 switches them from the PLC."""
    room = options.most_tables - tables
    if room < 1:
        raise InvalidContent.of_field(
            "options.most_tables",
            f"expected at most {options.most_tables} tables over all bands, got more; state a "
            "larger step, or fewer components",
        )
    return options.model_copy(
        update={"first_table": options.first_table + tables, "most_tables": room}
    )


SIEMENS_CEC: Final = Format(
    name="siemens-cec",
    title=TITLE,
    sign=None,
    units="mm",
    spacing="equidistant, a whole number of steps; the end values beyond",
    limits="points a table by machine data 18342 (828D: 8 tables of 200 points)",
    status=Status.MANUAL,
    holds=TRANSLATIONS,
    folds=True,
    both_directions=TRANSLATIONS,
    options=CecOptions,
    render=_render,
    parse=_parse,
    for_band=_numbered_by_band,
)

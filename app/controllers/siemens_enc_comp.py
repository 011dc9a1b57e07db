"""Siemens spindle and encoder error compensation, `$AA_ENC_COMP`.

A positive value moves the axis in the negative direction (808D manual): it is the error. One curve
an axis, the same in both directions, 0 at the reference point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final

from pydantic import Field

from app.controllers.curve import Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    AxisNames,
    ControllerFile,
    Count,
    Decimals,
    EvenSpacing,
    Format,
    Parsed,
    Reading,
    ReferenceOptions,
    Rendered,
    Status,
    axes_of,
    curve_code,
    curve_read,
    of_axis,
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
from app.errors import list_names
from app.units import UM_PER_MM

FILE: Final = "_N_AX_EEC_INI"
TITLE: Final = "Siemens encoder compensation (ENC_COMP)"
_PLACED: Final = ("AA_ENC_COMP_STEP", "AA_ENC_COMP_MIN", "AA_ENC_COMP_MAX")
_SETTINGS: Final = frozenset((*_PLACED, "AA_ENC_COMP_IS_MODULO"))


class EncCompOptions(ReferenceOptions):
    """Options of encoder compensation."""

    layout: ClassVar[frozenset[str]] = frozenset(("most_points", "spacing_mm", "decimals"))

    axes: AxisNames = Field(default_factory=lambda: {"x": "X1", "y": "Y1", "z": "Z1"})
    encoder: Annotated[Count, Field(ge=0, le=1)] = Field(0, description="Number of the encoder")
    most_points: Annotated[Count, Field(ge=2, le=5000)] = Field(
        200, description="Points of an axis: machine data 38000 (808D: 200)"
    )
    spacing_mm: EvenSpacing = None
    decimals: Decimals = 4


def _render(table: ErrorTable, options: EncCompOptions) -> Rendered:
    lines, curves = [], []
    for axis in axes_of(table):
        name = of_axis(options.axes, axis, "axes")
        curve, reference = table.curves[curve_code(axis, axis)], options.reference_mm.get(axis, 0.0)
        loaded = evenly(curve, options, reference)
        curves.append(loaded)
        lines += _lines(loaded, name, options)
    return Rendered(
        [written(FILE, head(table.origin, SIEMENS_ENC_COMP, options), lines)],
        curves,
        ["the controller does not check the size of ENC_COMP values: look at the check table"],
    )


def _lines(curve: Curve, name: str, options: EncCompOptions) -> list[str]:
    e = options.encoder
    rows = [
        f"$AA_ENC_COMP[{e},{place},{name}]={fixed(float(error) / UM_PER_MM, options.decimals)}"
        for place, error in enumerate(curve.errors)
    ]
    settings = {**placing(curve), "IS_MODULO": "0"}
    return rows + [f"$AA_ENC_COMP_{key}[{e},{name}]={value}" for key, value in settings.items()]


def _parse(files: Sequence[ControllerFile], options: EncCompOptions) -> Parsed:
    reading = Reading("ENC_COMP tables ($AA_ENC_COMP[e,N,X1]=…)")
    axes = {name.upper(): axis for axis, name in options.axes.items()}
    for file in files:
        read = program(file, "AA_ENC_COMP", ("MA_ENC_COMP_ENABLE",), reading)
        for (encoder, name), table in _tables_of(read).items():
            field = f"files.{file.name}.{name}"
            why_not = switched_off(read.switch("MA_ENC_COMP_ENABLE", str(encoder), name))
            if name not in axes:
                why_not = f"it is none of the axes {list_names(sorted(axes))} (options.axes)"
            elif encoder != options.encoder:
                why_not = f"it is not of encoder {options.encoder} (options.encoder)"
            if why_not is not None:
                reading.leave_aside(f"{name}, encoder {encoder}, of {file.name}", why_not)
                continue
            table.setting("AA_ENC_COMP_IS_MODULO", field)  # one that is missing keeps what it was
            at = table.grid(_PLACED, field)
            values = [value * UM_PER_MM for value in table.ordered()]
            code = curve_code(axes[name], axes[name])
            reading.add(curve_read(code, at, values), file.name)
        read.leave_rest_aside(reading)
    return reading.parsed(files)


def _tables_of(read: Program) -> dict[tuple[int, str], EvenTable]:
    tables: dict[tuple[int, str], EvenTable] = {}
    for assignment in read.assignments:
        wanted = 3 if assignment.name == "AA_ENC_COMP" else 2
        if len(assignment.indices) != wanted:
            raise assignment.line.refuse("indices such as [0,0,X1], or [0,X1] for a setting")
        table = tables.setdefault((assignment.number(0), assignment.indices[-1]), EvenTable.empty())
        if assignment.name == "AA_ENC_COMP":
            table.set_value(
                assignment, assignment.number(1), assignment.line.error_mm(assignment.value)
            )
        elif assignment.name in _SETTINGS:
            table.set_setting(assignment)
            if assignment.name.endswith("MODULO") and assignment.value != "0":
                raise assignment.line.refuse("0: a table that repeats is no error of a linear axis")
        else:
            raise assignment.line.refuse("a known setting of encoder compensation")
    return tables


SIEMENS_ENC_COMP: Final = Format(
    name="siemens-enc-comp",
    title=TITLE,
    sign="error",
    units="mm",
    spacing="equidistant through the reference point; the end values beyond",
    limits="points an axis by machine data 38000 (808D: 200); 0 at the reference point; one "
    "direction; displacement along the own axis only",
    status=Status.MANUAL,
    holds=LINEAR,
    folds=False,
    both_directions=(),
    options=EncCompOptions,
    render=_render,
    parse=_parse,
)

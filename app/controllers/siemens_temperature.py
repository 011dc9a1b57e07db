"""Siemens temperature compensation: a line K = K0 + tanβ·(P − P0) for each axis.

Setting data 43900 K0 [mm], 43910 tanβ and 43920 P0 [mm]. The line is fitted to the displacement
by least squares along the axis; what it leaves is the deviation that the export states.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from pydantic import Field

from app.arrays import frozen
from app.controllers.curve import Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    Axis,
    AxisNames,
    ControllerFile,
    Format,
    Length,
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
from app.controllers.heads import head
from app.controllers.lines import LARGEST_ERROR_MM, fixed
from app.controllers.siemens import END, Assignment, off_by, program
from app.errors import InvalidContent, list_names
from app.units import UM_PER_MM

TITLE: Final = "Siemens temperature compensation (setting data)"
NAMES: Final = {
    "SA_TEMP_COMP_ABS_VALUE": "SD 43900",
    "SA_TEMP_COMP_SLOPE": "SD 43910",
    "SA_TEMP_COMP_REF_POSITION": "SD 43920",
}
_STEEPEST: Final = 0.01
_SHOWN_MM: Final = 1000.0


class TemperatureOptions(SignedOptions):
    """Options of temperature compensation."""

    axes: AxisNames = Field(default_factory=lambda: {"x": "X1", "y": "Y1", "z": "Z1"})
    reference_position_mm: dict[Axis, Length] = Field(
        default_factory=dict, description="P0 of each axis [mm]; 0 where not stated"
    )


def _render(table: ErrorTable, options: TemperatureOptions) -> Rendered:
    factor = factor_of(options.sign)
    lines = [f"; {x}" for x in head(table.origin, SIEMENS_TEMPERATURE, options)]
    curves = []
    for axis in axes_of(table):
        name = of_axis(options.axes, axis, "axes")
        curve = table.curves[curve_code(axis, axis)]
        # As it is written: K0 is the line's value at just that position.
        p0 = round(options.reference_position_mm.get(axis, 0.0), 4)
        k0, slope = _fit(curve, p0)
        if abs(slope) / UM_PER_MM > _STEEPEST or abs(k0) / UM_PER_MM > LARGEST_ERROR_MM:
            raise InvalidContent.of_field(
                curve.code,
                f"expected a line within ±{_STEEPEST:g} and ±{LARGEST_ERROR_MM:g} mm at "
                f"{p0:g} mm, got {slope / UM_PER_MM:g} and {k0 / UM_PER_MM:g} mm",
            )
        k0, slope = round(k0 / UM_PER_MM, 6), round(slope / UM_PER_MM, 9)
        lines += [
            f"$SA_TEMP_COMP_ABS_VALUE[{name}]={fixed(factor * k0, 6)}",
            f"$SA_TEMP_COMP_SLOPE[{name}]={fixed(factor * slope, 9)}",
            f"$SA_TEMP_COMP_REF_POSITION[{name}]={fixed(p0, 4)}",
        ]
        at = frozen(curve.positions_mm[[0, -1]])
        curves.append(
            Curve(curve.component, at, (k0 + slope * (at - p0)) * UM_PER_MM, endless=True)
        )
    lines.append(END)
    return Rendered([ControllerFile("TEMP_COMP.SPF", "\n".join(lines) + "\n", "settings")], curves)


def _fit(curve: Curve, p0_mm: float) -> tuple[float, float]:
    """Fit value at P0 [µm] and slope [µm/mm], each piece of the curve by its length.

    Three points of each piece, weighted 1:4:1 (Simpson), integrate the squares exactly.
    """
    nodes, errors = curve.positions_mm, curve.errors
    middle = (nodes[1:] + nodes[:-1]) / 2.0
    at = np.concatenate([nodes[:-1], middle, nodes[1:]])
    values = np.concatenate([errors[:-1], (errors[1:] + errors[:-1]) / 2.0, errors[1:]])
    lengths = np.diff(nodes)
    weights = np.sqrt(np.concatenate([lengths, 4.0 * lengths, lengths]))
    centre, half = (nodes[0] + nodes[-1]) / 2.0, (nodes[-1] - nodes[0]) / 2.0
    # About the middle, in half lengths: with positions far from 0 the two columns would be nearly
    # parallel.
    columns = np.stack([np.ones(at.size), (at - centre) / half], axis=1)
    (mean, rise), *_ = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)
    slope = float(rise / half)
    return float(mean + slope * (p0_mm - centre)), slope


def _parse(files: Sequence[ControllerFile], options: TemperatureOptions) -> Parsed:
    factor = factor_of(options.sign)
    axes = {name.upper(): axis for axis, name in options.axes.items()}
    reading = Reading("temperature compensation ($SA_TEMP_COMP_SLOPE[X1]=…)")
    for file in files:
        assignments: dict[tuple[str, str], Assignment] = {}
        read = program(file, "SA_TEMP_COMP", (_TYPE,), reading)
        for assignment in read.assignments:
            if assignment.name not in NAMES or len(assignment.indices) != 1:
                raise assignment.line.refuse(f"{', '.join(NAMES)} of an axis")
            if (assignment.name, assignment.indices[0]) in assignments:
                raise assignment.line.refuse("each setting once")
            assignments[assignment.name, assignment.indices[0]] = assignment
        for name in dict.fromkeys(name for _, name in assignments):
            switch = read.switch(_TYPE, name)
            active = _BOTH if switch is None else _parts(switch)
            why_not = off_by(switch) if switch is not None and not active else None
            if name not in axes:
                why_not = f"it is none of the axes {list_names(sorted(axes))} (options.axes)"
            if why_not is not None:
                reading.leave_aside(f"{name} of {file.name}", why_not)
                continue
            reading.add(_line(assignments, name, axes[name], factor, file.name, active), file.name)
        read.leave_rest_aside(reading)
    return reading.parsed(files)


_TYPE: Final = "MA_TEMP_COMP_TYPE"
_CONSTANT: Final = 1
_SLOPE: Final = 2
_BOTH: Final = _CONSTANT | _SLOPE
_TYPES: Final = re.compile(r"H?0*[0-7]", re.ASCII)


def _parts(switch: Assignment) -> int:
    """Read machine data 32750: bit 0 switches K0 on, bit 1 the slope."""
    if not _TYPES.fullmatch(switch.value):
        raise switch.line.refuse(f"${_TYPE} from 0 to 7")
    return int(switch.value[-1]) & _BOTH


def _line(
    assignments: dict[tuple[str, str], Assignment],
    name: str,
    axis: str,
    factor: float,
    file: str,
    active: int,
) -> Curve:
    missing = [setting for setting in NAMES if (setting, name) not in assignments]
    if missing:
        raise InvalidContent.of_field(
            f"files.{file}", f"expected ${missing[0]}[{name}] ({NAMES[missing[0]]}), got none"
        )
    k0, slope, p0 = (assignments[setting, name] for setting in NAMES)
    value_mm, at_mm = k0.line.error_mm(k0.value), p0.line.position_mm(p0.value)
    steep = slope.line.number_of(slope.value, "a slope")
    if not math.fabs(steep) <= _STEEPEST:
        raise slope.line.refuse(f"a slope within ±{_STEEPEST:g}")
    value_mm = value_mm if active & _CONSTANT else 0.0
    steep = steep if active & _SLOPE else 0.0
    at = frozen([at_mm, at_mm + _SHOWN_MM])
    errors = factor * (value_mm + steep * (at - at_mm)) * UM_PER_MM
    return curve_read(curve_code(axis, axis), at, errors, endless=True)


SIEMENS_TEMPERATURE: Final = Format(
    name="siemens-temperature",
    title=TITLE,
    sign=None,
    units="mm, slope in mm/mm",
    spacing="none: one straight line an axis",
    limits="a line; one direction; displacement along the own axis only",
    status=Status.MANUAL,
    holds=LINEAR,
    folds=False,
    both_directions=(),
    options=TemperatureOptions,
    render=_render,
    parse=_parse,
)

"""Siemens temperature compensation: a line K = K0 + tanβ·(P − P0) for each axis.

Setting data 43900 K0 [mm], 43910 tanβ and 43920 P0 [mm]. The line is fitted to the displacement
by least squares along the axis; what it leaves is the deviation that the export states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from pydantic import Field

from app.arrays import frozen
from app.controllers.curve import Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    SIGN_WORDS,
    Axis,
    ControllerFile,
    Format,
    Label,
    Length,
    Parsed,
    Rendered,
    SignedOptions,
    Status,
    add_curve,
    axes_of,
    component_named,
    curve_code,
    factor_of,
    of_axis,
    parsed,
)
from app.controllers.lines import LARGEST_ERROR_MM, fixed, head
from app.controllers.siemens import END, Assignment, assignments
from app.errors import InvalidContent
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

    axes: dict[Axis, Label] = Field(
        default_factory=lambda: {"x": "X1", "y": "Y1", "z": "Z1"},
        description="The machine's name of each axis",
    )
    reference_position_mm: dict[Axis, Length] = Field(
        default_factory=dict, description="P0 of each axis [mm]; 0 where not stated"
    )


def _render(table: ErrorTable, options: TemperatureOptions) -> Rendered:
    factor = factor_of(options.sign)
    lines = [
        f"; {x}" for x in head(table.origin, TITLE, Status.MANUAL.value, SIGN_WORDS[options.sign])
    ]
    held = []
    for axis in axes_of(table):
        name = of_axis(options.axes, axis, "axes")
        curve = table.curves[curve_code(axis, axis)]
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
        held.append(Curve(curve.component, at, (k0 + slope * (at - p0)) * UM_PER_MM, endless=True))
    lines.append(END)
    return Rendered([ControllerFile("TEMP_COMP.SPF", "\n".join(lines) + "\n", "settings")], held)


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
    columns = np.stack([np.ones(at.size), (at - centre) / half], axis=1)
    (mean, rise), *_ = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)
    slope = float(rise / half)
    return float(mean + slope * (p0_mm - centre)), slope


def _parse(files: Sequence[ControllerFile], options: TemperatureOptions) -> Parsed:
    factor = factor_of(options.sign)
    axes = {name.upper(): axis for axis, name in options.axes.items()}
    curves: dict[str, Curve] = {}
    for file in files:
        given: dict[tuple[str, str], Assignment] = {}
        for one in assignments(file, "SA_TEMP_COMP"):
            if one.name not in NAMES or len(one.indices) != 1 or one.indices[0] not in axes:
                raise one.line.refuse(f"{', '.join(NAMES)} of one of the axes {sorted(axes)}")
            if (one.name, one.indices[0]) in given:
                raise one.line.refuse("each setting once")
            given[one.name, one.indices[0]] = one
        for name in dict.fromkeys(name for _, name in given):
            curve = _line(given, name, axes[name], factor, file.name)
            add_curve(curves, curve, file.name)
    return parsed(curves, files, "temperature compensation ($SA_TEMP_COMP_SLOPE[X1]=…)")


def _line(
    given: dict[tuple[str, str], Assignment], name: str, axis: str, factor: float, file: str
) -> Curve:
    missing = [setting for setting in NAMES if (setting, name) not in given]
    if missing:
        raise InvalidContent.of_field(
            f"files.{file}", f"expected ${missing[0]}[{name}] ({NAMES[missing[0]]}), got none"
        )
    k0, slope, p0 = (given[setting, name] for setting in NAMES)
    value_mm, at_mm = k0.line.error_mm(k0.value), p0.line.position_mm(p0.value)
    steep = slope.line.number_of(slope.value, "a slope")
    if not math.fabs(steep) <= _STEEPEST:
        raise slope.line.refuse(f"a slope within ±{_STEEPEST:g}")
    at = frozen([at_mm, at_mm + _SHOWN_MM])
    errors = factor * (value_mm + steep * (at - at_mm)) * UM_PER_MM
    return Curve(component_named(curve_code(axis, axis)), at, errors, endless=True)


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
    both_directions=False,
    options=TemperatureOptions,
    render=_render,
    parse=_parse,
    # A billionth of the slope over a metre, and a millionth of a millimetre.
    resolution=lambda options: 4e-3,
)

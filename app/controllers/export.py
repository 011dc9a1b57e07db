"""From a machine's errors to a controller's files, with everything a person must know of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from app.answer import Answer, Code, UnitSymbol
from app.controllers.curve import FORWARD, Curve, difference
from app.controllers.error_table import TRANSLATIONS, ErrorTable
from app.controllers.format import (
    CHECK_FILE,
    SIGN_WORDS,
    ControllerFile,
    Format,
    NotHeld,
    Options,
    ReferenceOptions,
)
from app.controllers.heads import head
from app.controllers.lines import LARGEST_ERROR_MM, fixed, plain
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, Kind
from app.rounding import Micro
from app.units import UM_PER_MM

NOTHING: Final = 0.0005
"""Less is no error that anybody asks for [µm or µrad]: a rounded zero."""


@dataclass(frozen=True, slots=True)
class Resampled(Answer, published_as="ResamplingAnswer"):
    """What spacing and rounding add to a component."""

    component: Code
    """ISO 230-1 code"""
    largest_deviation: Annotated[Micro, Field(examples=[0.2])]
    """Largest difference of the controller's curve from the table anywhere, in `unit`"""
    position_mm: float | None
    """Where [mm]; null for a single value"""
    unit: UnitSymbol
    """Its unit"""


@dataclass(frozen=True, slots=True)
class Check(Answer, published_as="CheckAnswer"):
    """One move that shows whether the sign is right."""

    component: Code
    """ISO 230-1 code"""
    axis: Annotated[str, Field(examples=["x"])]
    """Axis that is moved"""
    position_mm: Annotated[float, Field(examples=[200.0])]
    """Where to [mm]"""
    direction: Annotated[str, Field(examples=["+"])]
    """Coming in which direction, `+` or `-`"""
    moved_axis: Annotated[str, Field(examples=["x"])]
    """Axis that then stands elsewhere than before"""
    expected_movement_um: Annotated[Micro, Field(examples=[-10.0])]
    """By how much, + in that axis' direction [µm]"""


@dataclass(frozen=True, slots=True)
class Export:
    """A controller's files, and what is to be said of them."""

    files: Sequence[ControllerFile]
    not_held: Sequence[NotHeld]
    resampling: Sequence[Resampled]
    check: Sequence[Check]
    warnings: Sequence[str]
    loaded: Sequence[Curve]


@dataclass(frozen=True, slots=True)
class Wanted:
    """The curves that a controller should hold, and what it cannot."""

    table: ErrorTable
    not_held: Sequence[NotHeld]


def wanted_of(controller: Format, table: ErrorTable, options: Options) -> Wanted:
    """Choose what a controller can hold of a machine's errors.

    Returns
    -------
    Wanted
        The table with squareness folded into straightness where the format has none, with 0
        at the reference point where it is 0 there; and the rest, each with its size.

    Raises
    ------
    InvalidContent
        If a component is asked for that the table or the format does not have, or if nothing
        is left.
    """
    source, why_not = holdable(controller, table)
    requested = _requested(source, why_not, options)
    curves = {code: curve for code, curve in source.curves.items() if code in requested}
    if not curves:
        raise InvalidContent.of_field(
            "controller",
            f"expected errors that {controller.title} can hold ({list_names(controller.holds)}), "
            f"got {_reasons(why_not)}",
        )
    rest = [
        _left_out(table, code, why_not.get(code, "not asked for"))
        for code in table.curves
        if code not in curves
        and code in table.sizes_um
        and not _is_folded(code, curves, controller)
    ]
    halves = [
        _half_left(controller, table, curve)
        for code, curve in curves.items()
        if code not in controller.both_directions and curve.largest_reversal > NOTHING
    ]
    loaded = {
        code: curve if code in controller.both_directions else curve.mean()
        for code, curve in curves.items()
    }
    shifted, constants = _zero_at_reference(loaded, options, controller)
    return Wanted(replace(source, curves=shifted), [*rest, *halves, *constants])


def holdable(controller: Format, table: ErrorTable) -> tuple[ErrorTable, dict[str, str]]:
    """Take the errors that a controller can hold of a machine's, and say why not the others.

    Returns
    -------
    ErrorTable
        With squareness folded into straightness where the format has none.
    dict
        Code to the reason, of everything else.
    """
    source = table.folded() if controller.folds else table
    why_not = {}
    for code in {**source.curves, **table.curves}:
        if absent := _absent_axes(COMPONENTS[code], table.origin.axes):
            why_not[code] = f"the machine has no axis {list_names(absent)} that could move so"
        elif code not in controller.holds:
            why_not[code] = f"{controller.title} has no table for it"
    curves = {code: curve for code, curve in source.curves.items() if code not in why_not}
    return replace(source, curves=curves), why_not


def _absent_axes(component: Component, axes: Sequence[str]) -> list[str]:
    """List the linear axes that a component moves or depends on, and the machine lacks."""
    linear = {
        letter
        for letter in (component.axis, component.direction, component.times)
        if letter is not None
    }
    return [axis.upper() for axis in LINEAR_LETTERS if axis in linear - set(axes)]


def _reasons(why_not: Mapping[str, str]) -> str:
    return "; ".join(f"{code}: {why}" for code, why in why_not.items()) or "none"


def _half_left(controller: Format, table: ErrorTable, curve: Curve) -> NotHeld:
    half = table.reversals_um.get(curve.code, curve.largest_reversal / 2.0)
    why = f"{controller.title} has one table for both directions: it has their mean, and "
    return NotHeld(curve.code, half, why + "half of the reversal is left")


def _left_out(table: ErrorTable, code: str, why: str) -> NotHeld:
    component = table.curves[code].component
    if component.kind is Kind.ROTARY_LOCATION and component.is_rotation:
        return NotHeld(
            code, float(np.abs(table.curves[code].errors).max()), why, component.unit.symbol
        )
    return NotHeld(code, table.sizes_um[code], why)


def _requested(source: ErrorTable, why_not: Mapping[str, str], options: Options) -> list[str]:
    if options.components is None:
        return list(source.curves)
    for i, code in enumerate(options.components):
        if code not in source.curves:
            raise InvalidContent.of_field(
                f"options.components.{i}",
                f"expected some of {list_names(source.curves)}, got {code!r}: "
                f"{why_not.get(code, 'there is no map of it')}",
            )
    return list(options.components)


def _is_folded(code: str, curves: Mapping[str, Curve], controller: Format) -> bool:
    component = COMPONENTS[code]
    if not controller.folds or component.kind is not Kind.SQUARENESS:
        return False
    return f"E{component.direction}{component.times}".upper() in curves


def _zero_at_reference(
    curves: Mapping[str, Curve], options: Options, controller: Format
) -> tuple[dict[str, Curve], list[NotHeld]]:
    if not isinstance(options, ReferenceOptions):
        return dict(curves), []
    moved, constants = {}, []
    for code, curve in curves.items():
        at = options.reference_mm.get(str(curve.component.axis), 0.0)
        here = float(curve.at(np.array([at]), FORWARD)[0])
        moved[code] = curve.shifted(-here)
        if abs(here) > NOTHING:
            constants.append(
                NotHeld(
                    code,
                    abs(here),
                    f"{controller.title} is 0 at the reference point ({at:g} mm): the constant "
                    "is a shift of the axis' zero",
                )
            )
    return moved, constants


def export(controller: Format, table: ErrorTable, options: Options) -> Export:
    """Write a controller's files.

    Returns
    -------
    Export
        Files, what the controller cannot hold, what its spacing and rounding add, and the
        moves that show whether the sign is right.

    Raises
    ------
    InvalidContent
        As `wanted_of`; or if values are larger than the format takes.
    """
    wanted = wanted_of(controller, table, options)
    rendered = controller.render(wanted.table, options)
    for loaded in rendered.loaded:
        _expect_readable(loaded)
    resampled = [_resampled(loaded, wanted.table.curves[loaded.code]) for loaded in rendered.loaded]
    checks = [check for loaded in rendered.loaded for check in _checks(loaded, table)]
    warnings = [*table.warnings, *rendered.warnings]
    if controller.sign is None:
        meaning = SIGN_WORDS[controller.sign_of(options)]
        warnings.insert(
            len(table.warnings),
            f"the sign is not verified for {controller.title}: the values are stated as {meaning}. "
            "Make one move of the check table before parts are made",
        )
    warnings += _counted_with_absent_axes(rendered.loaded, table, options)
    files = [*rendered.files, _check_file(controller, table, options, checks, wanted.not_held)]
    return Export(
        files=files,
        not_held=sorted(wanted.not_held, key=lambda omitted: -omitted.largest),
        resampling=resampled,
        check=checks,
        warnings=warnings,
        loaded=rendered.loaded,
    )


def _resampled(loaded: Curve, wanted: Curve) -> Resampled:
    off = difference(loaded, wanted)
    return Resampled(loaded.code, abs(off.largest), off.position_mm, loaded.component.unit.symbol)


def _counted_with_absent_axes(
    loaded: Sequence[Curve], table: ErrorTable, options: Options
) -> list[str]:
    """Warn where an axis has the number of a three-axis machine, and this one has fewer.

    A lathe's Z is LinuxCNC's joint 1 as a rule, and AX2 at Siemens: a file for joint 2 would be
    passed over without a word, one for AX3 would be the spindle's.
    """
    if not options.numbering or options.numbering in options.model_fields_set:
        return []
    numbers: Mapping[str, int | str] = getattr(options, options.numbering)
    machine_axes = [axis for axis in numbers if axis in table.origin.axes]
    absent = [axis for axis in numbers if axis not in machine_axes]
    used = {str(curve.component.axis) for curve in loaded}
    shifted = [axis for axis in machine_axes if axis in used and any(gap < axis for gap in absent)]
    if not shifted:
        return []
    written = list_names([f"{axis.upper()} is written as {numbers[axis]}" for axis in shifted])
    first = dict(zip(machine_axes, numbers.values(), strict=False))
    return [
        f"the machine has no {list_names([axis.upper() for axis in absent])}, but {written}, as on "
        "a machine with X, Y and Z. Where the controller counts only the axes that there are, "
        f"state {options.numbering}={json.dumps(first)}: under a wrong number an axis is not "
        "compensated, or another one is"
    ]


def _expect_readable(curve: Curve) -> None:
    """Refuse values that a reader of the file would take for something else than an error."""
    largest = max(float(np.abs(errors).max()) for _, errors in curve.sides)
    if curve.code in TRANSLATIONS and largest > LARGEST_ERROR_MM * UM_PER_MM:
        raise InvalidContent.of_field(
            curve.code,
            f"expected errors within ±{LARGEST_ERROR_MM:g} mm in the file, got {largest:g} µm",
        )


def _checks(curve: Curve, table: ErrorTable) -> list[Check]:
    """Choose the position of the largest movement that the axis can go to, for each direction."""
    component = curve.component
    if component.axis is None or component.is_rotation or component.kind is Kind.SLOPE:
        return []
    low, high = table.ranges_mm.get(component.axis, (curve.positions_mm[0], curve.positions_mm[-1]))
    nodes = curve.positions_mm
    at = np.union1d(nodes[(nodes >= low) & (nodes <= high)], [low, high])
    checks = []
    for direction, _ in curve.sides:
        errors = curve.at(at, direction)
        place = int(np.abs(errors).argmax())
        moved = 0.0 - float(errors[place])
        checks.append(
            Check(
                component.code,
                component.axis,
                float(at[place]),
                direction,
                component.direction,
                moved,
            )
        )
    return checks


def _check_file(
    controller: Format,
    table: ErrorTable,
    options: Options,
    checks: Sequence[Check],
    not_held: Sequence[NotHeld],
) -> ControllerFile:
    """Write the check table as a text that lies beside the controller's files."""
    lines = [
        *head(table.origin, controller, options),
        "",
        "After loading, each axis stands further than before by (in um, + in the axis' direction):",
        "component  axis  position_mm  direction  moved_axis  expected_movement_um",
    ]
    lines += [
        f"{c.component}  {c.axis}  {plain(c.position_mm, 4)}  {c.direction}  {c.moved_axis}  "
        f"{fixed(c.expected_movement_um, 2)}"
        for c in checks
    ]
    if not_held:
        lines += ["", "Not in these files (largest displacement at these temperatures):"]
        lines += [
            f"{n.component}  {n.largest:.2f} {_plain_text(n.unit)}  {_plain_text(n.why)}"
            for n in not_held
        ]
    return ControllerFile(CHECK_FILE, "\n".join(lines) + "\n", "check")


def _plain_text(text: str) -> str:
    return text.replace("µ", "u").encode("ascii", "replace").decode()

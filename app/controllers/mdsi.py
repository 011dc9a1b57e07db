"""MDSI OpenCNC tune file: leadscrew error compensation of each axis (C. Wang, 8.4.4, Table 8.6).

Whole machine counts, both directions, equidistant from the most negative position.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from app.arrays import frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    ControllerFile,
    Count,
    EvenSpacing,
    Format,
    Parsed,
    Reading,
    Rendered,
    SignedOptions,
    Status,
    axes_of,
    curve_code,
    curve_read,
    factor_of,
)
from app.controllers.grids import even_grid, even_positions
from app.controllers.heads import head
from app.controllers.lines import LARGEST_ERROR_MM, Line, lines_of
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

TITLE: Final = "MDSI OpenCNC tune file"
MOST_COUNTS: Final = 2**31 - 1
_ALMOST: Final = 1e-6
_SETTING: Final = re.compile(
    r"axLSComp(Count|Spacing|PosMin)\s*\[\s*(\d)\s*\]\s+([+-]?\d+)", re.IGNORECASE | re.ASCII
)
_VALUE: Final = re.compile(
    r"axLSCompDir(Neg|Pos)\s*\[\s*(\d+)\s*\]\s*\[\s*(\d)\s*\]\s+([+-]?\d+)",
    re.IGNORECASE | re.ASCII,
)
_CONTENTS: Final = ("count", "spacing", "posmin")


class MdsiOptions(SignedOptions):
    """Options of the tune file."""

    counts_per_mm: Annotated[float, Field(strict=True, gt=0, le=1e7, allow_inf_nan=False)] = Field(
        description="Machine counts a millimetre, of positions and values"
    )
    most_points: Annotated[Count, Field(ge=2, le=10_000)] = Field(
        1000, description="Points that an axis may have"
    )
    spacing_mm: EvenSpacing = None


def _render(table: ErrorTable, options: MdsiOptions) -> Rendered:
    per_mm, per_um = options.counts_per_mm, options.counts_per_mm / UM_PER_MM
    factor = factor_of(options.sign)
    lines = [f"# {x}" for x in head(table.origin, MDSI, options)]
    curves = []
    for axis in axes_of(table):
        curve = table.curves[curve_code(axis, axis)]
        number = LINEAR_LETTERS.index(axis)
        start, spacing, count = _counts(curve, options)
        at = frozen((start + spacing * np.arange(count)) / per_mm)
        counts = {d: np.rint(factor * curve.at(at, d) * per_um) for d in (BACKWARD, FORWARD)}
        lines += [
            f"# Compensation tune file for {axis.upper()}",
            "#",
            f"axLSCompCount[{number}] {count}",
            f"axLSCompSpacing[{number}] {spacing}",
            f"axLSCompPosMin[{number}] {start}",
        ]
        for direction, name in ((BACKWARD, "Neg"), (FORWARD, "Pos")):
            lines.append("#")
            lines += [
                f"axLSCompDir{name}[{i}][{number}] {int(v)}"
                for i, v in enumerate(counts[direction])
            ]
        lines.append("#")
        backward = factor * counts[BACKWARD] / per_um
        curves.append(
            Curve(
                curve.component,
                at,
                factor * counts[FORWARD] / per_um,
                None if curve.backward_errors is None else backward,
            )
        )
    return Rendered([ControllerFile("thermap.tun", "\n".join(lines) + "\n")], curves)


def _counts(curve: Curve, options: MdsiOptions) -> tuple[int, int, int]:
    """Give start, spacing and number of the points, in whole counts."""
    per_mm = options.counts_per_mm
    grid = even_positions(
        curve.positions_mm, options.most_points, options.spacing_mm, "options.spacing_mm"
    )
    # The file has whole counts: the spacing goes up and the start down, so that the grid still
    # covers the curve with as few points.
    spacing = max(int(np.ceil((grid[1] - grid[0]) * per_mm - _ALMOST)), 1)
    start = int(np.floor(float(curve.positions_mm[0]) * per_mm + _ALMOST))
    high = float(curve.positions_mm[-1]) * per_mm
    points = even_grid(float(start), high, float(spacing), float(start)).size
    if points > options.most_points:
        raise InvalidContent.of_field(
            "options.counts_per_mm",
            f"expected counts fine enough for {options.most_points} points, got {per_mm:g} a mm",
        )
    last = start + spacing * (points - 1)
    if max(abs(start), abs(last)) > MOST_COUNTS:
        raise InvalidContent.of_field(
            "options.counts_per_mm",
            f"expected positions within ±{MOST_COUNTS} counts, got {max(abs(start), abs(last)):g}",
        )
    return start, spacing, points


def _parse(files: Sequence[ControllerFile], options: MdsiOptions) -> Parsed:
    settings: dict[tuple[str, int], tuple[Line, int]] = {}
    values: dict[tuple[str, int], dict[int, int]] = {}
    for file in files:
        for line in lines_of(file.name, file.content, "#"):
            _take(line, settings, values)
    axes = sorted({number for _, number in settings} | {number for _, number in values})
    reading = Reading("axLSCompCount and the other entries of a tune file")
    for number in axes:
        if number >= len(LINEAR_LETTERS):
            reading.leave_aside(f"axis {number}", "only axes 0, 1 and 2 are X, Y and Z")
            continue
        curve = _curve(number, settings, values, options)
        reading.curves[curve.code] = curve
    return reading.parsed(files)


def _take(
    line: Line,
    settings: dict[tuple[str, int], tuple[Line, int]],
    values: dict[tuple[str, int], dict[int, int]],
) -> None:
    setting, value = _SETTING.fullmatch(line.text), _VALUE.fullmatch(line.text)
    if setting:
        key = (setting[1].lower(), int(setting[2]))
        if key in settings:
            raise line.refuse("each entry once")
        settings[key] = (line, line.whole(setting[3], "counts"))
    elif value:
        column = values.setdefault((value[1].lower(), int(value[3])), {})
        place = line.whole(value[2], "a point")
        if place in column:
            raise line.refuse("each point once")
        column[place] = line.whole(value[4], "counts")
    else:
        raise line.refuse("axLSCompCount[0] 11, axLSCompDirPos[0][0] 28 or the like")


def _curve(
    number: int,
    settings: dict[tuple[str, int], tuple[Line, int]],
    values: dict[tuple[str, int], dict[int, int]],
    options: MdsiOptions,
) -> Curve:
    field = f"files.axis {number}"
    if any((name, number) not in settings for name in _CONTENTS):
        raise InvalidContent.of_field(field, "expected its count, spacing and lowest position")
    count, spacing, start = (settings[name, number][1] for name in _CONTENTS)
    line = settings["count", number][0]
    if not (2 <= count <= 100_000 and spacing > 0):
        raise line.refuse("at least 2 points and a spacing above 0")
    if max(abs(start), abs(start + spacing * (count - 1))) > MOST_COUNTS:
        raise line.refuse(f"positions within ±{MOST_COUNTS} counts")
    sides = []
    for name in ("pos", "neg"):
        column = values.get((name, number), {})
        if set(column) != set(range(count)):
            raise line.refuse(f"points 0 to {count - 1} of axLSCompDir{name.title()}, each once")
        sides.append(np.array([column[i] for i in range(count)], dtype=np.float64))
    factor = factor_of(options.sign) * UM_PER_MM / options.counts_per_mm
    if max(np.abs(side).max() for side in sides) * abs(factor) > LARGEST_ERROR_MM * UM_PER_MM:
        raise line.refuse(f"errors within ±{LARGEST_ERROR_MM:g} mm (options.counts_per_mm)")
    at = frozen((start + spacing * np.arange(count)) / options.counts_per_mm)
    # Refuses positions that no axis reaches: a mistaken counts_per_mm shows here.
    line.position_mm(f"{max(abs(at[0]), abs(at[-1])):.6f}")
    axis = LINEAR_LETTERS[number]
    return curve_read(curve_code(axis, axis), at, sides[0] * factor, sides[1] * factor)


MDSI: Final = Format(
    name="mdsi",
    title=TITLE,
    sign=None,
    units="machine counts",
    spacing="equidistant from the most negative position, a whole number of counts",
    limits="whole counts; displacement along the own axis only",
    status=Status.SEED,
    holds=LINEAR,
    folds=False,
    both_directions=LINEAR,
    options=MdsiOptions,
    render=_render,
    parse=_parse,
)

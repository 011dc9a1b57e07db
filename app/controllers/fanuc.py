"""Fanuc 30i/31i pitch and straightness compensation (C. Wang, 8.4.2, Table 8.4).

Whole increments in units of compensation: the one of a point is added when the section that ends
there, seen from the negative end, is passed. Their sum from the reference point is the curve, so
that the reference is 0; what rounding leaves of one increment goes into the next.

Parameters: 3620 point number of the reference, 3621 and 3622 of the ends, 3623 magnification, 3624
interval; 5711–5716 moving and 5721–5726 compensated axes of straightness, 13381–13386 their first
points, 13391–13396 their magnification; 10000 + number: the increments.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field

from app.arrays import FloatArray, IntArray, frozen
from app.controllers.curve import Curve
from app.controllers.error_table import TRANSLATIONS, ErrorTable
from app.controllers.format import (
    Axis,
    ControllerFile,
    Count,
    Format,
    Parsed,
    ReferenceOptions,
    Rendered,
    SignedOptions,
    Spacing,
    Status,
    add_curve,
    component_named,
    curve_code,
    factor_of,
    of_axis,
)
from app.controllers.grids import choose_spacing, even_grid
from app.controllers.lines import FARTHEST_MM, LARGEST_ERROR_MM, Line, lines_of
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

TITLE: Final = "Fanuc 30i/31i pitch and straightness compensation"
CROSSES: Final = ("EYX", "EXY", "EZY", "EXZ", "EYZ", "EZX")
"""Straightness tables in the order of Table 8.4: X→Y, Y→X, Y→Z, Z→X, Z→Y, X→Z."""

ALL_POINTS: Final = 1024
_ALMOST: Final = 1e-6
_BLOCK: Final = 100
_MOST_MAGNIFIED: Final = 100
_VALUES: Final = 10000
_WORD: Final = re.compile(r"([NQAP])([+-]?\d+)", re.IGNORECASE | re.ASCII)
_SINGLE: Final = {
    *range(5711, 5717),
    *range(5721, 5727),
    *range(13381, 13387),
    *range(13391, 13397),
}


class FanucOptions(SignedOptions, ReferenceOptions):
    """Options of Fanuc's tables."""

    numbering: ClassVar[str] = "numbers"

    numbers: dict[Axis, Annotated[Count, Field(ge=1, le=32)]] = Field(
        default_factory=lambda: {"x": 1, "y": 2, "z": 3}, description="Number of each axis"
    )
    detection_unit_um: Annotated[float, Field(strict=True, gt=0, le=100)] = Field(
        1.0, description="Detection unit [µm]; times the magnification it is the unit of values"
    )
    magnification: Annotated[Count, Field(ge=1, le=_MOST_MAGNIFIED)] | None = Field(
        None, description="Parameter 3623; the smallest that lets increments fit where not stated"
    )
    largest_increment: Annotated[Count, Field(ge=1, le=127)] = Field(
        7, description="Largest increment that the control takes, 7 or 127"
    )
    most_points: Annotated[Count, Field(ge=3, le=ALL_POINTS)] = Field(
        128, description="Points that a table may have"
    )
    interval_unit_um: Annotated[float, Field(strict=True, gt=0, le=1000)] = Field(
        1.0, description="Unit of the interval in parameter 3624 [µm]"
    )
    spacing_mm: Spacing | None = Field(
        None, description="Interval of all tables [mm]; the maps' own where not stated"
    )


def _reference(options: FanucOptions, axis: str) -> float:
    return options.reference_mm.get(axis, 0.0)


def _number(options: FanucOptions, axis: str) -> int:
    return of_axis(options.numbers, axis, "numbers")


@dataclass(frozen=True, slots=True)
class _Columns:
    """The grids of all axes, and every table's first point."""

    spacing_mm: float
    grids_mm: Mapping[str, FloatArray]
    first: Mapping[str, int]


def _render(table: ErrorTable, options: FanucOptions) -> Rendered:
    columns = _columns(table, options)
    factor = factor_of(options.sign)
    codes = list(columns.first)
    curves = {code: _sampled(table, code, columns) for code in codes}
    magnification, counts = _magnified(curves, columns, options)
    unit_um = magnification * options.detection_unit_um
    lines = ["%", *_parameters(columns, magnification, options)]
    held = []
    for code in codes:
        axis = code[2].lower()
        increments = np.diff(counts[code], prepend=counts[code][0]) * int(factor)
        first = _VALUES + columns.first[code]
        lines += [f"N{first + i}P{value}" for i, value in enumerate(increments.tolist())]
        if code in table.curves:
            at = columns.grids_mm[axis]
            summed = counts[code] - counts[code][_place(at, _reference(options, axis))]
            held.append(Curve(component_named(code), at, summed * unit_um))
    lines.append("%")
    return Rendered(
        [ControllerFile("FANUC.DAT", "\n".join(lines) + "\n")],
        held,
        [
            f"one unit of compensation is {unit_um:g} µm ({magnification} × detection unit); "
            "switch the control off and on and return to the reference point after loading"
        ],
    )


def _columns(table: ErrorTable, options: FanucOptions) -> _Columns:
    """Choose one interval for all tables, and every table's place among the points."""
    axes = [a for a in LINEAR_LETTERS if any(code[2].lower() == a for code in table.curves)]
    pitch = [curve_code(axis, axis) for axis in axes]
    codes = [*pitch, *(code for code in CROSSES if code in table.curves)]
    most = min(options.most_points, ALL_POINTS // len(codes))
    reach = {axis: _reach(table, options, axis) for axis in axes}
    for kept in range(min(3, most - 1)):
        spacing = choose_spacing(
            [*reach.values()], most - kept, options.spacing_mm, "options.spacing_mm"
        )
        # The interval is a whole number of its own unit, and wider where that does not come out.
        unit_mm = options.interval_unit_um / UM_PER_MM
        spacing = round(math.ceil(spacing / unit_mm - _ALMOST) * unit_mm, 6)
        grids = {
            axis: even_grid(float(p[0]), float(p[-1]), spacing, _reference(options, axis))
            for axis, p in reach.items()
        }
        longest = max(grid.size for grid in grids.values())
        if longest <= most:
            break
    else:
        raise InvalidContent.of_field(
            "options.spacing_mm",
            f"expected at most {most} points a table, got an interval of {spacing:g} mm, which "
            f"needs {longest}",
        )
    block = _BLOCK if longest <= _BLOCK else longest
    return _Columns(spacing, grids, {code: i * block for i, code in enumerate(codes)})


def _reach(table: ErrorTable, options: FanucOptions, axis: str) -> FloatArray:
    """Unite the positions of an axis' curves with its reference point."""
    own = [c.positions_mm for code, c in table.curves.items() if code[2].lower() == axis]
    return np.unique(np.concatenate([*own, [_reference(options, axis)]]))


def _sampled(table: ErrorTable, code: str, columns: _Columns) -> FloatArray:
    """Give a curve on its axis' grid [µm]; a pitch table that is needed alone is 0."""
    at = columns.grids_mm[code[2].lower()]
    curve = table.curves.get(code)
    return np.zeros(at.size) if curve is None else curve.at(at)


def _magnified(
    curves: Mapping[str, FloatArray], columns: _Columns, options: FanucOptions
) -> tuple[int, dict[str, IntArray]]:
    """Round the curves to whole units, with the smallest magnification that lets them fit."""
    stated = options.magnification
    tried = [stated] if stated is not None else range(1, _MOST_MAGNIFIED + 1)
    largest = 0
    for magnification in tried:
        unit_um = magnification * options.detection_unit_um
        counts = {c: np.rint(errors / unit_um).astype(np.intp) for c, errors in curves.items()}
        largest = max(int(np.abs(np.diff(one)).max()) for one in counts.values())
        if largest <= options.largest_increment:
            return magnification, counts
    raise InvalidContent.of_field(
        "options.magnification",
        f"expected increments of at most {options.largest_increment} units of "
        f"{tried[-1] * options.detection_unit_um:g} µm an interval of {columns.spacing_mm:g} mm, "
        f"got {largest}; state a shorter spacing_mm, a larger magnification, or a larger "
        "largest_increment if the control takes it",
    )


def _parameters(columns: _Columns, magnification: int, options: FanucOptions) -> list[str]:
    """Write what places the points."""
    by_axis: dict[int, str] = dict.fromkeys((3620, 3621, 3622, 3623, 3624), "")
    for axis, grid in columns.grids_mm.items():
        first = columns.first[curve_code(axis, axis)]
        numbers = {
            3620: first + _place(grid, _reference(options, axis)),
            3621: first,
            3622: first + grid.size - 1,
            3623: magnification,
            3624: round(columns.spacing_mm * UM_PER_MM / options.interval_unit_um),
        }
        for parameter, value in numbers.items():
            by_axis[parameter] += f"A{_number(options, axis)}P{value}"
    lines = [f"N{parameter}Q1{words}" for parameter, words in by_axis.items()]
    crosses = [code for code in CROSSES if code in columns.first]
    columns_of = {
        5711: [_number(options, code[2].lower()) for code in crosses],
        5721: [_number(options, code[1].lower()) for code in crosses],
        13381: [columns.first[code] for code in crosses],
        13391: [magnification for _ in crosses],
    }
    for base, values in columns_of.items():
        lines += [f"N{base + i}Q1P{value}" for i, value in enumerate(values)]
    return lines


def _place(grid_mm: FloatArray, position_mm: float) -> int:
    return int(np.abs(grid_mm - position_mm).argmin())


def _parse(files: Sequence[ControllerFile], options: FanucOptions) -> Parsed:
    curves: dict[str, Curve] = {}
    for file in files:
        read = _Read.of(file)
        for axis in LINEAR_LETTERS:
            number = options.numbers.get(axis)
            if number is not None and (3624, number) in read.by_axis:
                for curve in read.curves(axis, number, options):
                    add_curve(curves, curve, file.name)
    if not curves:
        raise InvalidContent.of_field(
            "files", "expected Fanuc parameters N3620 to N3624 of an axis, got none"
        )
    return Parsed(curves)


@dataclass(frozen=True, slots=True)
class _Read:
    """What one file states: parameters by axis, single ones, and the increments."""

    file: str
    by_axis: Mapping[tuple[int, int], int]
    single: Mapping[int, int]
    increments: Mapping[int, int]

    @classmethod
    def of(cls, file: ControllerFile) -> _Read:
        by_axis: dict[tuple[int, int], int] = {}
        single: dict[int, int] = {}
        increments: dict[int, int] = {}
        marks = 0
        for line in lines_of(file.name, file.content):
            if line.text == "%":
                marks += 1
                continue
            if marks != 1:
                raise line.refuse("everything between two lines %")
            number, words = _words(line)
            if number >= _VALUES and number not in _SINGLE:
                _set(increments, number - _VALUES, _one(line, words), line)
            elif number in _SINGLE:
                _set(single, number, _one(line, words), line)
            else:
                for axis, value in _pairs(line, words):
                    _set(by_axis, (number, axis), value, line)
        if marks != 2:
            raise InvalidContent.of_field(
                f"files.{file.name}", "expected a line % at begin and end, the file may be cut off"
            )
        return cls(file.name, by_axis, single, increments)

    def curves(self, axis: str, number: int, options: FanucOptions) -> list[Curve]:
        """Sum an axis' increments, and those of the straightness tables that it moves."""
        missing = [p for p in range(3620, 3625) if (p, number) not in self.by_axis]
        if missing:
            raise self.refuse(f"N{missing[0]} of axis {number}", "none")
        reference, first, last, magnification, interval = (
            self.by_axis[p, number] for p in range(3620, 3625)
        )
        if not (0 <= first <= reference <= last < ALL_POINTS * 2 and first < last and interval > 0):
            raise self.refuse(
                f"points in the order first, reference, last of axis {number} and an interval",
                f"{first}, {reference}, {last} and {interval}",
            )
        spacing = interval * options.interval_unit_um / UM_PER_MM
        at = np.round(
            _reference(options, axis) + (np.arange(first - 1, last + 1) - reference) * spacing, 6
        )
        if np.abs(at).max() > FARTHEST_MM:
            raise self.refuse(f"positions within ±{FARTHEST_MM:g} mm", f"{np.abs(at).max():g} mm")
        found = [
            self._summed(
                curve_code(axis, axis), at, (first, last), reference, magnification, options
            )
        ]
        by_number = {n: a for a, n in options.numbers.items()}
        for i in range(6):
            if self.single.get(5711 + i) != number:
                continue
            output = by_number.get(self.single.get(5721 + i, -1))
            begin = self.single.get(13381 + i)
            if output is None or begin is None or 13391 + i not in self.single or output == axis:
                raise self.refuse(
                    f"N{5721 + i}, N{13381 + i} and N{13391 + i} of a straightness table", "not all"
                )
            found.append(
                self._summed(
                    curve_code(str(output), axis),
                    at,
                    (begin, begin + last - first),
                    begin + reference - first,
                    self.single[13391 + i],
                    options,
                )
            )
        return found

    def _summed(
        self,
        code: str,
        at: FloatArray,
        points: tuple[int, int],
        reference: int,
        magnification: int,
        options: FanucOptions,
    ) -> Curve:
        wanted = range(points[0], points[1] + 1)
        missing = [n for n in wanted if n not in self.increments]
        if missing:
            raise self.refuse(f"a value N{_VALUES + missing[0]} of {code}", "none")
        if not 0 < magnification <= _MOST_MAGNIFIED:
            raise self.refuse("a magnification from 1 to 100", str(magnification))
        sums = np.cumsum([0, *(self.increments[n] for n in wanted)])
        unit_um = factor_of(options.sign) * magnification * options.detection_unit_um
        errors = (sums - sums[reference - points[0] + 1]) * unit_um
        if np.abs(errors).max() > LARGEST_ERROR_MM * UM_PER_MM:
            raise self.refuse(
                f"errors within ±{LARGEST_ERROR_MM:g} mm", f"a sum of {np.abs(errors).max():g} µm"
            )
        return Curve(component_named(code), frozen(at), frozen(errors))

    def refuse(self, expected: str, came: str) -> InvalidContent:
        """Make the refusal of the whole file."""
        return InvalidContent.of_field(f"files.{self.file}", f"expected {expected}, got {came}")


def _words(line: Line) -> tuple[int, list[tuple[str, int]]]:
    """Take a line apart into its number and its other words."""
    text = line.text.replace(" ", "")
    words = [(letter.upper(), line.whole(value, letter)) for letter, value in _WORD.findall(text)]
    if "".join(m[0] for m in _WORD.finditer(text)) != text or not words or words[0][0] != "N":
        raise line.refuse("words such as N3620Q1A1P67 or N10000P1")
    if not 0 <= words[0][1] < 100_000:
        raise line.refuse("a parameter's number")
    return words[0][1], words[1:]


def _one(line: Line, words: Sequence[tuple[str, int]]) -> int:
    values = [value for letter, value in words if letter == "P"]
    if len(values) != 1 or any(letter not in "QP" for letter, _ in words):
        raise line.refuse("one value P")
    return values[0]


def _pairs(line: Line, words: Sequence[tuple[str, int]]) -> list[tuple[int, int]]:
    pairs = [word for word in words if word[0] != "Q"]
    letters = "".join(letter for letter, _ in pairs)
    if not pairs or letters != "AP" * (len(pairs) // 2):
        raise line.refuse("axes and values in turn, such as A1P67A2P100")
    return [(pairs[i][1], pairs[i + 1][1]) for i in range(0, len(pairs), 2)]


def _set(into: dict[Any, int], key: Any, value: int, line: Line) -> None:
    if key in into:
        raise line.refuse("each parameter once")
    into[key] = value


FANUC: Final = Format(
    name="fanuc",
    title=TITLE,
    sign=None,
    units="whole units of compensation (magnification × detection unit), interval in 0.001 mm",
    spacing="equidistant through the reference point, one interval for all tables",
    limits="128 points a table, 1024 in all; increments of at most 7 (or 127) units; 0 at the "
    "reference point; one direction",
    status=Status.SEED,
    holds=TRANSLATIONS,
    folds=True,
    both_directions=False,
    options=FanucOptions,
    render=_render,
    parse=_parse,
    # With the largest magnification; a smaller one is finer.
    resolution=lambda options: (
        (options.magnification or _MOST_MAGNIFIED) * options.detection_unit_um
    ),
)

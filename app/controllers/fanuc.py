"""Fanuc 30i/31i pitch and straightness compensation (C. Wang, 8.4.2, Table 8.4).

Whole increments in units of compensation: the one of a point is added when the section that ends
there, seen from the negative end, is passed. Their sum from the reference point is the curve, so
that the reference is 0; what rounding leaves of one increment goes into the next.

Parameters: 3620 point number of the reference, 3621 and 3622 of the ends, 3623 magnification, 3624
interval; 5711–5716 moving and 5721–5726 compensated axes of straightness, 13381–13386 their first
points, 13391–13396 their magnification; 10000 + number: the increments. Bidirectional pitch error
compensation (3605 bit 0) has increments of its own for the negative direction, from the point 3626
on, and 3627 is its value at the reference point where the axis comes from the side opposite to
reference position return (A-77810E); it is read and not written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import Field

from app.arrays import FloatArray, IntArray
from app.controllers.curve import Curve
from app.controllers.error_table import TRANSLATIONS, ErrorTable
from app.controllers.format import (
    Axis,
    ControllerFile,
    Count,
    Format,
    Parsed,
    Reading,
    ReferenceOptions,
    Rendered,
    SignedOptions,
    Spacing,
    Status,
    curve_code,
    curve_read,
    factor_of,
    of_axis,
)
from app.controllers.grids import choose_spacing, even_grid
from app.controllers.lines import FARTHEST_MM, LARGEST_ERROR_MM, Line, lines_of, plain
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
_COMMENT: Final = re.compile(r"\([^()]*\)")
_NUMBERED: Final = re.compile(r"N(\d{1,9})(?!\d)", re.IGNORECASE | re.ASCII)
_WORD: Final = re.compile(r"([NQAP])([+-]?\d+(?:\.\d*)?)", re.IGNORECASE | re.ASCII)
_RETURN: Final = 1006
_BIDIRECTIONAL: Final = 3605
_PLACING: Final = range(3620, 3625)
_INTERVAL: Final = 3624
_BACKWARD_FIRST: Final = 3626
_BACKWARD_REFERENCE: Final = 3627
_BY_AXIS: Final = {
    *(_RETURN, _BIDIRECTIONAL, *_PLACING, _BACKWARD_FIRST, _BACKWARD_REFERENCE),
}
_SINGLE: Final = {
    *range(5711, 5717),
    *range(5721, 5727),
    *range(13381, 13387),
    *range(13391, 13397),
}
_LAST_POINT: Final = 2 * ALL_POINTS


class FanucOptions(SignedOptions, ReferenceOptions):
    """Options of Fanuc's tables."""

    numbering: ClassVar[str] = "numbers"
    layout: ClassVar[frozenset[str]] = frozenset(
        ("magnification", "largest_increment", "most_points", "spacing_mm")
    )

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
    interval_unit_um: Annotated[float, Field(strict=True, gt=0, le=1000)] | None = Field(
        None,
        description="Unit of parameter 3624 [µm] where the control has it as a whole number "
        "(Series 16i, 18i, 21i: 1); where not stated it is written in mm with a decimal point, as "
        "Series 30i, 31i, 32i and 0i-D have it",
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
    rendered_curves = []
    for code in codes:
        axis = code[2].lower()
        # The increment of a point is that of the section that ends there, from the negative end
        # (B-63980EN, parameter 3620 ff.): the first section is outside the table and has none.
        increments = np.diff(counts[code], prepend=counts[code][0]) * int(factor)
        first = _VALUES + columns.first[code]
        lines += [f"N{first + i}P{value}" for i, value in enumerate(increments.tolist())]
        if code in table.curves:
            at = columns.grids_mm[axis]
            summed = counts[code] - counts[code][_place(at, _reference(options, axis))]
            rendered_curves.append(curve_read(code, at, summed * unit_um))
    lines.append("%")
    return Rendered(
        [ControllerFile("FANUC.DAT", "\n".join(lines) + "\n")],
        rendered_curves,
        [
            f"one unit of compensation is {unit_um:g} µm ({magnification} × detection unit); "
            "switch the control off and on and return to the reference point after loading",
            f"the interval (parameter 3624) is written as P{_interval(columns, options)}: "
            + (
                "in mm, as Series 30i, 31i, 32i and 0i-D have it; state interval_unit_um=1 for a "
                "control on which it is a whole number of 0.001 mm"
                if options.interval_unit_um is None
                else f"a whole number of {options.interval_unit_um:g} µm"
            ),
        ],
    )


def _columns(table: ErrorTable, options: FanucOptions) -> _Columns:
    """Choose one interval for all tables, and every table's place among the points."""
    axes = [a for a in LINEAR_LETTERS if any(code[2].lower() == a for code in table.curves)]
    pitch = [curve_code(axis, axis) for axis in axes]
    codes = [*pitch, *(code for code in CROSSES if code in table.curves)]
    most = min(options.most_points, ALL_POINTS // len(codes))
    reach = {axis: _reach(table, options, axis) for axis in axes}
    # A grid through the reference point may begin before the table and end behind it: up to two
    # points more than its length needs.
    for spared in range(min(3, most - 1)):
        spacing = choose_spacing(
            [*reach.values()], most - spared, options.spacing_mm, "options.spacing_mm"
        )
        # The interval is a whole number of its own unit, and wider where that does not come out.
        unit_mm = _interval_unit_um(options) / UM_PER_MM
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
    along = [c.positions_mm for code, c in table.curves.items() if code[2].lower() == axis]
    return np.unique(np.concatenate([*along, [_reference(options, axis)]]))


def _sampled(table: ErrorTable, code: str, columns: _Columns) -> FloatArray:
    """Give a curve on its axis' grid [µm]; a pitch table that is needed alone is 0."""
    at = columns.grids_mm[code[2].lower()]
    curve = table.curves.get(code)
    return np.zeros(at.size) if curve is None else curve.at(at)


def _magnified(
    curves: Mapping[str, FloatArray], columns: _Columns, options: FanucOptions
) -> tuple[int, dict[str, IntArray]]:
    """Round the curves to whole units, with the smallest magnification that lets them fit."""
    declared = options.magnification
    tried = [declared] if declared is not None else range(1, _MOST_MAGNIFIED + 1)
    largest = 0
    for magnification in tried:
        unit_um = magnification * options.detection_unit_um
        # The curve is rounded, not its increments: rounding does not add up along the axis.
        counts = {c: np.rint(errors / unit_um).astype(np.intp) for c, errors in curves.items()}
        largest = max(int(np.abs(np.diff(units)).max()) for units in counts.values())
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
        numbers: dict[int, int | str] = {
            3620: first + _place(grid, _reference(options, axis)),
            3621: first,
            3622: first + grid.size - 1,
            3623: magnification,
            _INTERVAL: _interval(columns, options),
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


def _interval_unit_um(options: FanucOptions) -> float:
    return options.interval_unit_um or 1.0


def _interval(columns: _Columns, options: FanucOptions) -> str:
    if options.interval_unit_um is not None:
        return str(round(columns.spacing_mm * UM_PER_MM / options.interval_unit_um))
    text = plain(columns.spacing_mm, 6)
    return text if "." in text else f"{text}.0"


def _place(grid_mm: FloatArray, position_mm: float) -> int:
    return int(np.abs(grid_mm - position_mm).argmin())


def _parse(files: Sequence[ControllerFile], options: FanucOptions) -> Parsed:
    reading = Reading("Fanuc parameters N3620 to N3624 of an axis")
    for file in files:
        read = _Read.of(file)
        axes = {number: axis for axis, number in options.numbers.items()}
        for number in sorted({n for parameter, n in read.by_axis if parameter in _PLACING}):
            name = f"axis {number} of {file.name}"
            why_not = read.off(number)
            if number not in axes:
                why_not = f"it is none of the axes {options.numbers} (options.numbers)"
            if why_not is not None:
                reading.leave_aside(name, why_not)
                continue
            for curve in read.curves(axes[number], number, options, reading):
                reading.add(curve, file.name)
    return reading.parsed(files)


@dataclass(frozen=True, slots=True)
class _Table:
    """Where the points of one table lie, and what they count."""

    code: str
    at_mm: FloatArray
    points: range
    reference: int
    magnification: int


@dataclass(frozen=True, slots=True)
class _Read:
    """What one file states: parameters by axis, single ones, and the lines of the increments.

    A whole parameter file has many others, which are none of ours: they are passed over.
    """

    file: str
    by_axis: Mapping[tuple[int, int], tuple[Line, str]]
    single: Mapping[int, int]
    increments: Mapping[int, Sequence[Line]]

    @classmethod
    def of(cls, file: ControllerFile) -> _Read:
        by_axis: dict[tuple[int, int], tuple[Line, str]] = {}
        single: dict[int, int] = {}
        increments: dict[int, list[Line]] = {}
        marks = 0
        for raw in lines_of(file.name, file.content):
            line = raw._replace(text=_COMMENT.sub("", raw.text).rstrip("; ").replace(" ", ""))
            if line.text == "%":
                marks += 1
                continue
            if not line.text:
                continue
            if marks != 1:
                raise raw.refuse("everything between two lines %")
            match = _NUMBERED.match(line.text)
            if match is None:
                raise raw.refuse("words such as N3620Q1A1P67 or N10000P1")
            number = int(match[1])
            if number in _SINGLE:
                _set(single, number, _number_of(line), line)
            elif number in _BY_AXIS:
                for axis, value in _pairs(line):
                    _set(by_axis, (number, axis), (line, value), line)
            elif _VALUES <= number < _VALUES + _LAST_POINT:
                increments.setdefault(number - _VALUES, []).append(line)
        if marks != 2:
            raise InvalidContent.of_field(
                f"files.{file.name}", "expected a line % at begin and end, the file may be cut off"
            )
        return cls(file.name, by_axis, single, increments)

    def off(self, number: int) -> str | None:
        """Say which parameter lets an axis' table do nothing; None where it acts."""
        for parameter in (3623, _INTERVAL):
            line, text = self.by_axis.get((parameter, number), (None, "1"))
            if line is not None and line.number_of(text, f"parameter {parameter}") == 0.0:
                return f"switched off by parameter {parameter}, which is 0"
        return None

    def curves(
        self, axis: str, number: int, options: FanucOptions, reading: Reading
    ) -> Iterator[Curve]:
        """Sum an axis' increments, and those of the straightness tables that it moves."""
        missing = [p for p in _PLACING if (p, number) not in self.by_axis]
        if missing:
            raise self.refuse(f"N{missing[0]} of axis {number}", "none")
        reference, first, last, magnification = (
            self._whole(parameter, number) for parameter in _PLACING[:-1]
        )
        spacing = self._spacing_mm(number, options, reading)
        if not (0 <= first <= reference <= last < _LAST_POINT and first < last and spacing > 0):
            raise self.refuse(
                f"points in the order first, reference, last of axis {number} and an interval",
                f"{first}, {reference}, {last} and {spacing:g} mm",
            )
        at = np.round(
            _reference(options, axis) + (np.arange(first - 1, last + 1) - reference) * spacing, 6
        )
        if np.abs(at).max() > FARTHEST_MM:
            raise self.refuse(f"positions within ±{FARTHEST_MM:g} mm", f"{np.abs(at).max():g} mm")
        table = _Table(
            curve_code(axis, axis), at, range(first, last + 1), reference - first, magnification
        )
        forward = self._summed(table, options)
        yield self._with_backward(forward, table, number, options, reading)
        for i in range(6):
            if self.single.get(5711 + i) == number:
                crossing = self._crossing(i, axis, table, options, reading)
                if crossing is not None:
                    yield crossing

    def _crossing(
        self, i: int, axis: str, pitch: _Table, options: FanucOptions, reading: Reading
    ) -> Curve | None:
        """Sum a straightness table that an axis moves."""
        output = self.single.get(5721 + i)
        begin = self.single.get(13381 + i)
        if output is None or begin is None or 13391 + i not in self.single:
            raise self.refuse(
                f"N{5721 + i}, N{13381 + i} and N{13391 + i} of a straightness table", "not all"
            )
        compensated = {n: a for a, n in options.numbers.items()}.get(output)
        if compensated is None or self.single[13391 + i] == 0:
            reading.leave_aside(
                f"straightness table {i + 1} of {self.file}",
                f"switched off by parameter {13391 + i}, which is 0"
                if compensated
                else f"axis {output} is none of {options.numbers} (options.numbers)",
            )
            return None
        if compensated == axis:
            raise self.refuse(f"another axis than {output} in N{5721 + i}", "the one that moves")
        points = range(begin, begin + len(pitch.points))
        code = curve_code(compensated, axis)
        table = _Table(code, pitch.at_mm, points, pitch.reference, self.single[13391 + i])
        return self._summed(table, options)

    def _with_backward(
        self, forward: Curve, table: _Table, number: int, options: FanucOptions, reading: Reading
    ) -> Curve:
        """Add the table of the negative direction, where the control uses one."""
        if (_BACKWARD_FIRST, number) not in self.by_axis:
            if self._bit(_BIDIRECTIONAL, 0, number):
                raise self.refuse(
                    f"N{_BACKWARD_FIRST} of axis {number}, whose parameter 3605 says that the "
                    "negative direction has a table of its own",
                    "none",
                )
            return forward
        active = self._bit(_BIDIRECTIONAL, 0, number)
        begin = self._whole(_BACKWARD_FIRST, number)
        if active is None and begin:
            raise self.refuse(
                f"N{_BIDIRECTIONAL} of axis {number}, which says whether the table of the "
                f"negative direction (N{_BACKWARD_FIRST}) acts",
                "none",
            )
        if not active:
            if begin:
                reading.leave_aside(
                    f"the negative direction of axis {number} of {self.file}",
                    "switched off by bit 0 of parameter 3605",
                )
            return forward
        points = range(begin, begin + len(table.points))
        backward = self._summed(replace(table, points=points), options)
        at_reference = 0
        if (_BACKWARD_REFERENCE, number) in self.by_axis:
            at_reference = self._whole(_BACKWARD_REFERENCE, number)
        # Parameter 3627 is in detection units, which are not magnified, and is of the direction
        # opposite to reference position return (bit 5 of parameter 1006).
        shift = factor_of(options.sign) * at_reference * options.detection_unit_um
        returns_backward = self._bit(_RETURN, 5, number)
        if returns_backward is None:
            reading.warnings.append(
                f"{self.file}: parameter 1006 of axis {number} is not in the file: its reference "
                "position return is taken to be in the positive direction, so that parameter 3627 "
                "is of the negative one"
            )
        if returns_backward:
            forward = forward.shifted(shift)
        else:
            backward = backward.shifted(shift)
        curve = replace(forward, backward_errors=backward.errors)
        self._expect_within(curve)
        return curve

    def _bit(self, parameter: int, bit: int, number: int) -> bool | None:
        """Read a bit of an axis' parameter, None where the file does not state it."""
        if (parameter, number) not in self.by_axis:
            return None
        line, text = self.by_axis[parameter, number]
        if not re.fullmatch(r"[01]{1,8}", text):
            raise line.refuse(f"eight bits of parameter {parameter}")
        return text.zfill(8)[-1 - bit] == "1"

    def _whole(self, parameter: int, number: int) -> int:
        line, text = self.by_axis[parameter, number]
        return line.whole(text, f"parameter {parameter}")

    def _spacing_mm(self, number: int, options: FanucOptions, reading: Reading) -> float:
        """Read the interval: in mm where it has a decimal point, else a whole number of units."""
        line, text = self.by_axis[_INTERVAL, number]
        if "." in text:
            return line.number_of(text, "an interval in mm")
        unit_um = _interval_unit_um(options)
        if options.interval_unit_um is None:
            reading.warnings.append(
                f"{self.file}: parameter 3624 has no decimal point and is read in units of "
                f"{unit_um:g} µm (options.interval_unit_um is not stated)"
            )
        return line.whole(text, "an interval") * unit_um / UM_PER_MM

    def _summed(self, table: _Table, options: FanucOptions) -> Curve:
        missing = [n for n in table.points if n not in self.increments]
        if missing:
            raise self.refuse(f"a value N{_VALUES + missing[0]} of {table.code}", "none")
        if not 0 < table.magnification <= _MOST_MAGNIFIED:
            raise self.refuse("a magnification from 1 to 100", str(table.magnification))
        counts = []
        for point in table.points:
            line, *others = self.increments[point]
            if others:
                raise others[0].refuse("each parameter once")
            counts.append(_number_of(line))
        # A section ends at its point: the first one begins an interval before the first point.
        sums = np.cumsum([0, *counts])
        unit_um = factor_of(options.sign) * table.magnification * options.detection_unit_um
        errors = (sums - sums[table.reference + 1]) * unit_um
        curve = curve_read(table.code, table.at_mm, errors)
        self._expect_within(curve)
        return curve

    def _expect_within(self, curve: Curve) -> None:
        largest = max(float(np.abs(errors).max()) for _, errors in curve.sides)
        if largest > LARGEST_ERROR_MM * UM_PER_MM:
            raise self.refuse(f"errors within ±{LARGEST_ERROR_MM:g} mm", f"a sum of {largest:g} µm")

    def refuse(self, expected: str, came: str) -> InvalidContent:
        """Make the refusal of the whole file."""
        return InvalidContent.of_field(f"files.{self.file}", f"expected {expected}, got {came}")


def _words(line: Line) -> list[tuple[str, str]]:
    """Take a line apart into its words behind its number."""
    words = [(letter.upper(), value) for letter, value in _WORD.findall(line.text)]
    if "".join(m[0] for m in _WORD.finditer(line.text)) != line.text or words[0][0] != "N":
        raise line.refuse("words such as N3620Q1A1P67 or N10000P1")
    return words[1:]


def _number_of(line: Line) -> int:
    words = _words(line)
    values = [value for letter, value in words if letter == "P"]
    if len(values) != 1 or any(letter not in "QP" for letter, _ in words):
        raise line.refuse("one value P")
    return line.whole(values[0], "P")


def _pairs(line: Line) -> list[tuple[int, str]]:
    pairs = [word for word in _words(line) if word[0] != "Q"]
    letters = "".join(letter for letter, _ in pairs)
    if not pairs or letters != "AP" * (len(pairs) // 2):
        raise line.refuse("axes and values in turn, such as A1P67A2P100")
    return [(line.whole(pairs[i][1], "an axis"), pairs[i + 1][1]) for i in range(0, len(pairs), 2)]


def _set(into: dict[Any, Any], key: Any, value: Any, line: Line) -> None:
    if key in into:
        raise line.refuse("each parameter once")
    into[key] = value


FANUC: Final = Format(
    name="fanuc",
    title=TITLE,
    sign=None,
    units="whole units of compensation (magnification × detection unit), interval in mm",
    spacing="equidistant through the reference point, one interval for all tables",
    limits="128 points a table, 1024 in all; increments of at most 7 (or 127) units; 0 at the "
    "reference point; one direction",
    status=Status.SEED,
    holds=TRANSLATIONS,
    folds=True,
    both_directions=(),
    options=FanucOptions,
    render=_render,
    parse=_parse,
)

"""Fagor 8055: leadscrew and cross compensation tables (C. Wang, 8.4.5).

The values are the amounts of error of the axis; positions count from machine zero. Where all
errors of the negative direction are 0, the controller takes the positive ones for both.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from app.controllers.curve import Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    ControllerFile,
    Format,
    Parsed,
    Reading,
    ReferenceOptions,
    Rendered,
    Status,
    curve_code,
    curve_read,
)
from app.controllers.grids import even_positions
from app.controllers.heads import head
from app.controllers.lines import Line, fixed, lines_of
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

TITLE: Final = "Fagor 8055 leadscrew and cross compensation"
MOST_POINTS: Final = 1000
FARTHEST_MM: Final = 99999.9999
CROSSES: Final = ("EXY", "EXZ", "EYZ")
"""The three cross tables of the chapter: D_x(Y), D_x(Z), D_y(Z)."""

_CROSS_NAMES: Final = (
    ("P31 NPCROSS", "P32 MOVAXIS", "P33 COMPAXIS"),
    ("P54 NPCROSS2", "P55 MOVAXIS2", "P56 COMPAXIS2"),
    ("P57 NPCROSS3", "P58 MOVAXIS3", "P59 COMPAXIS3"),
)
_DECIMALS: Final = 4
_SETTING: Final = re.compile(r"P(\d+)\s+([A-Z]+\d?)\s*=\s*(\w+)", re.IGNORECASE | re.ASCII)
_POINT: Final = re.compile(
    r"P(\d{1,4})\s+([XYZ])\s*([+-]?[\d.]+)((?:\s+E[XYZ]\s*[+-]?[\d.]+){1,2})", re.IGNORECASE
)
_ERROR: Final = re.compile(r"E([XYZ])\s*([+-]?[\d.]+)", re.IGNORECASE | re.ASCII)


def _render(table: ErrorTable, options: ReferenceOptions) -> Rendered:
    lines = [f"; {x}" for x in head(table.origin, FAGOR, options)]
    lines.append("P8 INCHES = 0")
    curves = []
    for code in [*LINEAR, *CROSSES]:
        if code not in table.curves:
            continue
        loaded = _fitted(table.curves[code]).rounded(10.0**-_DECIMALS * UM_PER_MM)
        curves.append(loaded)
        lines += _cross(loaded) if code in CROSSES else _leadscrew(loaded)
    return Rendered([ControllerFile("thermap.FGR", "\n".join(lines) + "\n")], curves)


def _fitted(curve: Curve) -> Curve:
    """Keep the curve's own nodes where they fit, else an even grid."""
    # Rounded before they are compared: in the file two that are too near would be one position.
    at = np.round(curve.positions_mm, _DECIMALS)
    if at.size > MOST_POINTS:
        at = even_positions(curve.positions_mm, MOST_POINTS, None, curve.code)
    if np.abs(at).max() > FARTHEST_MM:
        raise InvalidContent.of_field(
            curve.code,
            f"expected positions within ±{FARTHEST_MM} mm, got {np.abs(at).max():g} mm",
        )
    if (np.diff(at) <= 0).any():
        raise InvalidContent.of_field(
            curve.code, "expected positions at least 0.0001 mm apart, got closer ones"
        )
    return curve.sampled(at)


def _leadscrew(curve: Curve) -> list[str]:
    axis = str(curve.component.axis).upper()
    backward = curve.backward_errors
    if backward is not None and not backward.any() and curve.errors.any():
        raise InvalidContent.of_field(
            curve.code,
            "expected errors of the negative direction that are not all 0: the controller would "
            "take those of the positive direction for both",
        )
    lines = [f"; {axis}", "P15 LSCRWCOM = ON", f"P16 NPOINTS = {curve.positions_mm.size}"]
    for i, position in enumerate(curve.positions_mm):
        minus = 0.0 if backward is None else float(backward[i])
        errors = " ".join(_error(axis, e) for e in (float(curve.errors[i]), minus))
        lines.append(f"P{i + 1:03d} {axis} {fixed(float(position), _DECIMALS)} {errors}")
    return lines


def _cross(curve: Curve) -> list[str]:
    moving, output = str(curve.component.axis), curve.component.direction
    names = _CROSS_NAMES[CROSSES.index(curve.code)]
    numbers = (
        curve.positions_mm.size,
        LINEAR_LETTERS.index(moving) + 1,
        LINEAR_LETTERS.index(output) + 1,
    )
    lines = [f"; error of {output.upper()} along {moving.upper()}"]
    lines += [f"{name} = {number}" for name, number in zip(names, numbers, strict=True)]
    lines += [
        f"P{i + 1:03d} {moving.upper()} {fixed(float(position), _DECIMALS)} "
        f"{_error(output.upper(), float(curve.errors[i]))}"
        for i, position in enumerate(curve.positions_mm)
    ]
    return lines


def _error(axis: str, error_um: float) -> str:
    return f"E{axis} {fixed(error_um / UM_PER_MM, _DECIMALS)}"


@dataclass
class _Section:
    """One table while it is read: what it states of itself, and its points."""

    line: Line
    settings: dict[str, str] = field(default_factory=dict)
    points: list[tuple[Line, float, list[tuple[str, float]]]] = field(default_factory=list)
    axis: str = ""


def _parse(files: Sequence[ControllerFile], options: ReferenceOptions) -> Parsed:
    reading = Reading("leadscrew or cross compensation tables")
    for file in files:
        for section in _sections(file):
            if section.settings.get("LSCRWCOM") == "OFF":
                reading.leave_aside(
                    f"{section.axis.upper() or 'a table'} of {file.name}",
                    "switched off by LSCRWCOM = OFF, so that it does nothing",
                )
                continue
            reading.add(_curve_of(section), file.name)
    return reading.parsed(files)


def _sections(file: ControllerFile) -> Iterator[_Section]:
    """Go through the tables: each begins with what it states of itself."""
    section: _Section | None = None
    for line in lines_of(file.name, file.content, ";"):
        setting, point = _SETTING.fullmatch(line.text), _POINT.fullmatch(line.text)
        if setting:
            name, value = setting[2].upper(), setting[3].upper()
            if name == "INCHES":
                if value != "0":
                    raise line.refuse("INCHES = 0: positions and errors in mm")
                continue
            if section is None or section.points:
                if section is not None:
                    yield section
                section = _Section(line)
            if name in section.settings:
                raise line.refuse("each setting once")
            section.settings[name] = value
        elif point and section is not None:
            _take(section, line, point)
        else:
            raise line.refuse("P16 NPOINTS = 11, then P001 X -400.0000 EX +0.0012 EX +0.0000")
    if section is not None:
        yield section


def _take(section: _Section, line: Line, point: re.Match[str]) -> None:
    axis = point[2].lower()
    if int(point[1]) != len(section.points) + 1 or section.axis not in ("", axis):
        raise line.refuse(f"point {len(section.points) + 1} of one axis")
    section.axis = axis
    errors = [(a.lower(), line.error_mm(e)) for a, e in _ERROR.findall(point[4])]
    section.points.append((line, line.position_mm(point[3]), errors))


def _curve_of(section: _Section) -> Curve:
    """Make the curve of one table, which has to be as it says."""
    settings, line = section.settings, section.line
    cross = next((i for i, n in enumerate(_CROSS_NAMES) if n[0].split()[1] in settings), None)
    count_name = "NPOINTS" if cross is None else _CROSS_NAMES[cross][0].split()[1]
    if settings.get(count_name) != str(len(section.points)) or len(section.points) < 2:
        raise line.refuse(
            f"as many points as {count_name} says, at least 2; got {len(section.points)}"
        )
    if cross is None and settings.get("LSCRWCOM") != "ON":
        raise line.refuse("LSCRWCOM = ON: the controller ignores the table otherwise")
    output, wanted = section.axis, 2
    if cross is not None:
        names = [name.split()[1] for name in _CROSS_NAMES[cross]]
        axes = [settings.get(name, "") for name in names[1:]]
        if any(a not in ("1", "2", "3") for a in axes) or axes[0] == axes[1]:
            raise line.refuse("a moving and a compensated axis of 1 to 3")
        moving, output = (LINEAR_LETTERS[int(a) - 1] for a in axes)
        wanted = 1
        if moving != section.axis:
            raise line.refuse(f"points of {moving.upper()}, which moves")
    rows: list[tuple[float, ...]] = []
    for at, position, errors in section.points:
        if len(errors) != wanted or any(axis != output for axis, _ in errors):
            raise at.refuse(f"{wanted} error(s) of {output.upper()}")
        if rows and position <= rows[-1][0]:
            raise at.refuse("increasing positions")
        rows.append((position, *(e for _, e in errors)))
    if len(rows) > MOST_POINTS:
        raise line.refuse(f"at most {MOST_POINTS} points")
    columns = np.array(rows).T
    errors_um = columns[1:] * UM_PER_MM
    # As the control does: a column of zeros is no table of the negative direction.
    backward = errors_um[1] if wanted == 2 and errors_um[1].any() else None
    return curve_read(curve_code(output, section.axis), columns[0], errors_um[0], backward)


FAGOR: Final = Format(
    name="fagor",
    title=TITLE,
    sign="error",
    units="mm",
    spacing="any, increasing",
    limits=f"{MOST_POINTS} points an axis; ±{FARTHEST_MM} mm; 0 at machine zero; straightness: "
    "D_x(y), D_x(z) and D_y(z) in one direction",
    status=Status.MANUAL,
    holds=(*LINEAR, *CROSSES),
    folds=True,
    both_directions=LINEAR,
    options=ReferenceOptions,
    render=_render,
    parse=_parse,
)

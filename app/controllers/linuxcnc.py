"""LinuxCNC's COMP_FILE: one file a joint, three numbers a line; verified on the controller.

Type 0 states nominal and the actual positions moving + and moving −; type 1 nominal and the
trims, where motor = command + trim, so that a trim is the compensation. The controller ends
reading without a word at the first line that is not three numbers: neither head nor comment
is allowed, and the parser refuses what the controller would drop.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from app.arrays import frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    Axis,
    ControllerFile,
    Format,
    Length,
    Options,
    Parsed,
    Rendered,
    Status,
    add_curve,
    axes_of,
    component_named,
    curve_code,
    of_axis,
    parsed,
)
from app.controllers.grids import even_positions
from app.controllers.lines import Line, head, lines_of, plain
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

MOST_ROWS: Final = 256
"""The controller drops the rows after these, and starts all the same."""

SETTINGS: Final = "thermap.ini"
MM_PER_INCH: Final = 25.4
_DECIMALS: Final = {"mm": 6, "inch": 8}
_MM_PER: Final = {"mm": 1.0, "inch": MM_PER_INCH}
_MOST_TRIM_MM: Final = 10.0
_SECTION: Final = re.compile(r"\[JOINT_(\d)\]", re.IGNORECASE | re.ASCII)
_SETTING: Final = re.compile(r"(COMP_FILE|COMP_FILE_TYPE)\s*=\s*(\S+)", re.IGNORECASE)


class LinuxCncOptions(Options):
    """Options of LinuxCNC."""

    numbering: ClassVar[str] = "joints"

    type: Literal[0, 1] = Field(
        1,
        description="COMP_FILE_TYPE: 1 nominal and trims, 0 nominal and actual positions. Reading "
        "back, what the settings say takes precedence over it",
    )
    joints: dict[Axis, Annotated[int, Field(strict=True, ge=0, le=15)]] = Field(
        default_factory=lambda: {"x": 0, "y": 1, "z": 2}, description="Joint of each axis"
    )
    linear_units: Literal["mm", "inch"] = Field("mm", description="LINEAR_UNITS of the machine")
    home_mm: dict[Axis, Length] = Field(
        default_factory=dict,
        description="Where each axis stands after homing [mm]; 0 where not stated. A compensation "
        "that is not 0 there is warned of: the motor steps at the first move",
    )


def _render(table: ErrorTable, options: LinuxCncOptions) -> Rendered:
    files, held, warnings = [], [], []
    settings = [
        f"# {line}"
        for line in head(table.origin, TITLE, Status.CONTROLLER.value, _WORDS[options.type])
    ]
    for axis in axes_of(table):
        curve = _fitted(table.curves[curve_code(axis, axis)])
        joint = of_axis(options.joints, axis, "joints")
        content, loaded = _rows(curve, options)
        files.append(ControllerFile(f"{axis}.comp", content, axis=axis))
        held.append(loaded)
        settings += [
            "",
            f"[JOINT_{joint}]",
            f"COMP_FILE = {axis}.comp",
            f"COMP_FILE_TYPE = {options.type}",
        ]
        warnings += _steps(loaded, axis, options.home_mm.get(axis, 0.0))
    warnings.append(
        "LinuxCNC ignores BACKLASH of a joint that has a COMP_FILE, and reads the file at its "
        "start only"
    )
    files.append(ControllerFile(SETTINGS, "\n".join(settings) + "\n", role="settings"))
    return Rendered(files, held, warnings)


_WORDS: Final = {
    0: "nominal, actual position moving +, actual position moving -",
    1: "nominal, trim moving +, trim moving -; motor = command + trim, trim = -error",
}


def _fitted(curve: Curve) -> Curve:
    """Keep the curve's own nodes where the controller takes so many, else an even grid."""
    if curve.positions_mm.size <= MOST_ROWS:
        return curve
    return curve.sampled(even_positions(curve.positions_mm, MOST_ROWS, None, curve.code))


def _rows(curve: Curve, options: LinuxCncOptions) -> tuple[str, Curve]:
    """Write the rows, and give the curve that they hold."""
    decimals, mm = _DECIMALS[options.linear_units], _MM_PER[options.linear_units]
    nominal = np.round(curve.positions_mm / mm, decimals)
    written = []
    for direction in (FORWARD, BACKWARD):
        error = np.round(curve.at(curve.positions_mm, direction) / UM_PER_MM / mm, decimals)
        written.append(nominal + error if options.type == 0 else 0.0 - error)
    if (np.diff(nominal) <= 0).any():
        raise InvalidContent.of_field(
            curve.code,
            f"expected positions at least {10.0**-decimals:g} {options.linear_units} apart, which "
            "LinuxCNC drops otherwise; got closer ones",
        )
    rows = [
        " ".join(plain(float(v), decimals) for v in row)
        for row in zip(nominal, *written, strict=True)
    ]
    errors = [(w - nominal if options.type == 0 else 0.0 - w) * mm * UM_PER_MM for w in written]
    backward = errors[1] if curve.backward_errors is not None else None
    return "\n".join(rows) + "\n", Curve(curve.component, frozen(nominal * mm), errors[0], backward)


def _steps(curve: Curve, axis: str, home_mm: float) -> list[str]:
    """Warn of a compensation at home: after homing it is 0 until the first move."""
    at_home = [float(curve.at(np.array([home_mm]), d)[0]) for d, _ in curve.sides]
    largest = max(at_home, key=abs)
    if abs(largest) < 0.05:
        return []
    return [
        f"the motor of {axis} steps by {-largest:.1f} µm at the first move after homing: the "
        f"compensation at home ({home_mm:g} mm) is not 0"
    ]


def _parse(files: Sequence[ControllerFile], options: LinuxCncOptions) -> Parsed:
    curves: dict[str, Curve] = {}
    warnings = []
    settings = [file for file in files if file.name.lower().endswith((".ini", ".inc"))]
    stated = [entry for file in settings for entry in _settings_of(file)]
    for file in files:
        if file in settings:
            continue
        joint, kind = next(((j, t) for j, n, t in stated if n == file.name), (None, None))
        if kind is None:
            kind = options.type
            warnings.append(
                f"{file.name}: COMP_FILE_TYPE is not among the files; read as type {kind}"
            )
        axis = _axis_of(file, joint, options)
        add_curve(curves, _read(file, axis, kind, options), file.name)
    return parsed(curves, files, "a COMP_FILE", warnings)


def _settings_of(file: ControllerFile) -> list[tuple[int, str, int | None]]:
    """Read joint, file name and type of each [JOINT_N] that has a COMP_FILE."""
    found: dict[int, dict[str, str]] = {}
    joint: int | None = None
    for line in lines_of(file.name, file.content, "#"):
        section = _SECTION.fullmatch(line.text)
        if line.text.startswith("["):
            joint = int(section[1]) if section else None
        elif joint is not None and (setting := _SETTING.fullmatch(line.text)):
            key = setting[1].upper()
            if key in found.setdefault(joint, {}):
                raise line.refuse(f"one {key} of a joint")
            if key == "COMP_FILE_TYPE" and setting[2] not in ("0", "1"):
                raise line.refuse("COMP_FILE_TYPE 0 or 1")
            found[joint][key] = setting[2]
    return [
        # The controller's own default is type 0.
        (number, keys["COMP_FILE"].rpartition("/")[2], int(keys.get("COMP_FILE_TYPE", "0")))
        for number, keys in found.items()
        if "COMP_FILE" in keys
    ]


def _axis_of(file: ControllerFile, joint: int | None, options: LinuxCncOptions) -> str:
    axes: Mapping[int, str] = {number: axis for axis, number in options.joints.items()}
    if joint is not None and joint in axes:
        return axes[joint]
    named = file.axis or file.name.partition(".")[0].lower()
    if joint is None and named in LINEAR_LETTERS and named:
        return named
    raise InvalidContent.of_field(
        f"files.{file.name}",
        "expected the name of an axis, such as x.comp, or settings with [JOINT_N] and the joints "
        f"{dict(options.joints)}, got neither",
    )


def _read(file: ControllerFile, axis: str, kind: int, options: LinuxCncOptions) -> Curve:
    mm = _MM_PER[options.linear_units]
    rows: list[tuple[float, float, float]] = []
    blank = 0
    for number, raw in enumerate(file.content.replace("\r\n", "\n").split("\n"), start=1):
        line = Line(file.name, number, raw.strip())
        if not line.text:
            blank = blank or number
            continue
        if blank:
            raise InvalidContent.of_field(
                f"files.{file.name}",
                f"line {blank}: expected three numbers, got a blank line: LinuxCNC ends reading "
                "here, and the rows after it are lost",
            )
        rows.append(_row(line, rows, kind, mm))
    if not rows:
        raise InvalidContent.of_field(f"files.{file.name}", "expected rows, got none")
    at, forward, backward = np.array(rows).T
    both = None if np.array_equal(forward, backward) else frozen(backward * UM_PER_MM)
    component = component_named(curve_code(axis, axis))
    return Curve(component, frozen(at), frozen(forward * UM_PER_MM), both)


def _row(
    line: Line, before: Sequence[tuple[float, float, float]], kind: int, mm: float
) -> tuple[float, float, float]:
    """Read one row as nominal and the errors in both directions [mm]."""
    words = line.text.split()
    if len(words) != 3:
        raise line.refuse("three numbers (LinuxCNC ends reading here without a word)")
    nominal, plus, minus = (line.number_of(word, "a position or trim") * mm for word in words)
    if len(before) >= MOST_ROWS:
        raise line.refuse(f"at most {MOST_ROWS} rows (LinuxCNC drops the rest)")
    if before and nominal <= before[-1][0]:
        raise line.refuse("increasing nominal positions (LinuxCNC drops this row)")
    line.position_mm(words[0])
    errors = (plus - nominal, minus - nominal) if kind == 0 else (0.0 - plus, 0.0 - minus)
    if max(map(abs, errors)) > _MOST_TRIM_MM:
        other = "trims of type 1" if kind == 0 else "positions of type 0"
        raise line.refuse(
            f"errors within ±{_MOST_TRIM_MM:g} mm as type {kind} (are these {other}?)"
        )
    return (nominal, *errors)


TITLE: Final = "LinuxCNC COMP_FILE"

LINUXCNC: Final = Format(
    name="linuxcnc",
    title=TITLE,
    sign="compensation",
    units="machine units (mm or inch)",
    spacing="any, strictly increasing; linear between, the end values beyond",
    limits=f"{MOST_ROWS} rows a joint; displacement along the own axis only",
    status=Status.CONTROLLER,
    holds=LINEAR,
    folds=False,
    both_directions=True,
    options=LinuxCncOptions,
    render=_render,
    parse=_parse,
    resolution=lambda options: (
        10.0 ** -_DECIMALS[options.linear_units] * _MM_PER[options.linear_units] * UM_PER_MM
    ),
)

"""LinuxCNC's COMP_FILE: one file a joint, three numbers a line; verified on the controller.

Type 0 states nominal and the actual positions moving + and moving −; type 1 nominal and the
trims, where motor = command + trim, so that a trim is the compensation. The controller ends
reading without a word at the first line that does not begin with three numbers: no line of a
head or a comment is allowed, and the parser refuses what the controller would drop.

An INI among the files says which joint has which file, what its axis is, its type and its unit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, PlainValidator, WithJsonSchema

from app.arrays import FloatArray, frozen
from app.controllers.curve import BACKWARD, FORWARD, Curve, difference
from app.controllers.error_table import LINEAR, ErrorTable
from app.controllers.format import (
    Axis,
    ControllerFile,
    Format,
    HomeOptions,
    Parsed,
    Reading,
    Rendered,
    Status,
    axes_of,
    curve_code,
    curve_read,
    of_axis,
    steps_at_home,
)
from app.controllers.grids import even_positions
from app.controllers.heads import head
from app.controllers.lines import LARGEST_ERROR_MM, Line, lines_of, plain
from app.errors import InvalidContent, list_names
from app.geometry.components import LINEAR_LETTERS
from app.units import UM_PER_MM

MOST_ROWS: Final = 256
"""The controller drops the rows after these, and starts all the same."""

SETTINGS: Final = "thermap.ini"
MM_PER_INCH: Final = 25.4
_DECIMALS: Final = {"mm": 6, "inch": 8}
_MM_PER: Final = {"mm": 1.0, "inch": MM_PER_INCH}
LAST_JOINT: Final = 15
COORDINATES: Final = "XYZABCUVW"
"""Axes of the joints from 0 where `trivkins` states none."""

_JOINT: Final = re.compile(r"\[(?:JOINT|AXIS)_(\d{1,2})\]", re.IGNORECASE | re.ASCII)
_SETTING: Final = re.compile(r"(\w+)\s*=\s*(.*)", re.ASCII)
_READ: Final = ("KINEMATICS", "COORDINATES", "LINEAR_UNITS", "COMP_FILE", "COMP_FILE_TYPE")
"""Settings that are read; others, such as HALFILE, may stand in a section more than once."""

_UNITS: Final = {"mm": "mm", "metric": "mm", "inch": "inch", "in": "inch", "imperial": "inch"}
_NUMBER: Final = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_ROW: Final = re.compile(
    rf"({_NUMBER})\s+({_NUMBER})\s+({_NUMBER})(?![\w.,])\s*(.*)", re.ASCII | re.DOTALL
)


def _joints_from(value: object) -> int | tuple[int, ...]:
    """Take the joint of an axis, or several: 1, [1, 2], or "1, 2" as it is typed."""
    if isinstance(value, str):
        words = [word.strip() for word in value.split(",")]
        numbers: list[object] = [int(w) if w.isdecimal() and len(w) < 3 else w for w in words]
    else:
        numbers = list(value) if isinstance(value, list | tuple) else [value]
    valid = [n for n in numbers if type(n) is int and 0 <= n <= LAST_JOINT]
    if not valid or len(valid) < len(numbers) or len(set(valid)) < len(valid):
        raise ValueError(
            f"a joint from 0 to {LAST_JOINT}, or several that move the axis together, such as "
            "[1, 2]"
        )
    return valid[0] if len(valid) == 1 else tuple(valid)


AxisJoints = Annotated[
    Any,
    PlainValidator(_joints_from),
    WithJsonSchema({"type": "integer", "minimum": 0, "maximum": LAST_JOINT}),
]


class LinuxCncOptions(HomeOptions):
    """Options of LinuxCNC."""

    numbering: ClassVar[str] = "joints"
    layout: ClassVar[frozenset[str]] = frozenset(("home_mm",))

    type: Literal[0, 1] = Field(
        1,
        description="COMP_FILE_TYPE: 1 nominal and trims, 0 nominal and actual positions. Of files "
        "that are read, an INI among them says it",
    )
    joints: dict[Axis, AxisJoints] = Field(
        default_factory=lambda: {"x": 0, "y": 1, "z": 2},
        description="Joint of each axis; of a gantry, several that move it together, such as 1, 2",
    )
    linear_units: Literal["mm", "inch"] = Field(
        "mm",
        description="LINEAR_UNITS of the machine. Of files that are read, an INI among them says "
        "it",
    )


def _several(joints: int | tuple[int, ...]) -> tuple[int, ...]:
    return (joints,) if isinstance(joints, int) else joints


def _expect_each_joint_once(options: LinuxCncOptions) -> None:
    numbers = list(chain.from_iterable(map(_several, options.joints.values())))
    if len(set(numbers)) < len(numbers):
        raise InvalidContent.of_field(
            "options.joints", f"expected each joint once, got {options.joints}"
        )


def _render(table: ErrorTable, options: LinuxCncOptions) -> Rendered:
    _expect_each_joint_once(options)
    files, curves, warnings = [], [], []
    settings = [f"# {x}" for x in head(table.origin, LINUXCNC, options, _WORDS[options.type])]
    for axis in axes_of(table):
        curve = _fitted(table.curves[curve_code(axis, axis)])
        content, loaded = _rows(curve, options)
        files.append(ControllerFile(f"{axis}.comp", content, axis=axis))
        curves.append(loaded)
        for joint in _several(of_axis(options.joints, axis, "joints")):
            settings += [
                "",
                f"[JOINT_{joint}]",
                f"COMP_FILE = {axis}.comp",
                f"COMP_FILE_TYPE = {options.type}",
            ]
    warnings += steps_at_home(curves, options, "at the first move after homing")
    warnings.append(
        "LinuxCNC ignores BACKLASH of a joint that has a COMP_FILE, and reads the file at its "
        "start only"
    )
    files.append(ControllerFile(SETTINGS, "\n".join(settings) + "\n", role="settings"))
    return Rendered(files, curves, warnings)


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
    # Of the rounded numbers: what is said of the curve has to be true of the file.
    errors = [(w - nominal if options.type == 0 else 0.0 - w) * mm * UM_PER_MM for w in written]
    backward = errors[1] if curve.backward_errors is not None else None
    return "\n".join(rows) + "\n", Curve(curve.component, frozen(nominal * mm), errors[0], backward)


def _parse(files: Sequence[ControllerFile], options: LinuxCncOptions) -> Parsed:
    _expect_each_joint_once(options)
    reading = Reading("a COMP_FILE")
    settings = [file for file in files if file.name.lower().endswith((".ini", ".inc"))]
    ini = _Ini.of(settings)
    units = ini.units(options)
    of_each_axis: dict[str, list[_JointTable]] = {}
    assumed = []
    for file in files:
        if file in settings:
            continue
        joints = ini.joints_of(file)
        if joints is None:
            reading.leave_aside(
                file.name, f"no joint of {ini.name} has it as its COMP_FILE: it is not loaded"
            )
            continue
        axis = _axis_of(file, joints, ini, options, reading)
        if axis is None:
            continue
        kind = ini.kind_of(joints, options)
        if not joints and "type" not in options.model_fields_set:
            assumed.append(f"COMP_FILE_TYPE of {file.name} is read as {kind}")
        curve = _read(file, axis, kind, units, reading)
        of_each_axis.setdefault(axis, []).append(_JointTable(file.name, joints, curve))
    for axis, tables in of_each_axis.items():
        _expect_alike(axis, tables, ini)
        reading.add(tables[0].curve, tables[0].file)
        bare = ini.without_table(axis, {joint for table in tables for joint in table.joints})
        if bare:
            reading.warnings.append(
                f"joint {list_names(map(str, bare))} moves {axis.upper()} too "
                f"({ini.coordinates_text}), and its COMP_FILE is not among the files"
            )
    for joint, name in ini.unread(files):
        reading.leave_aside(f"{name} of joint {joint}", "the file is not among those given")
    if ini.says("TRAJ", "LINEAR_UNITS") is None and "linear_units" not in options.model_fields_set:
        assumed.append(f"LINEAR_UNITS as {units}")
    if assumed:
        reading.warnings.append(f"not stated in the files or options: {', '.join(assumed)}")
    return reading.parsed(files)


@dataclass(frozen=True, slots=True)
class _JointTable:
    """The table of one file, and the joints that load it."""

    file: str
    joints: Sequence[int]
    curve: Curve


@dataclass(frozen=True, slots=True)
class _Ini:
    """What a machine's INI says of its joints, their axes and its units.

    `[AXIS_n]` with a number is what versions up to 2.7 call `[JOINT_n]`.
    """

    name: str = "the INI"
    settings: Mapping[tuple[str, str], tuple[Line, str]] = field(default_factory=dict)
    joints: Sequence[int] = ()
    is_older: bool = False

    @classmethod
    def of(cls, files: Sequence[ControllerFile]) -> _Ini:
        """Read the sections of all settings files as one."""
        settings: dict[tuple[str, str], tuple[Line, str]] = {}
        joints: list[int] = []
        is_older = False
        for file in files:
            section = ""
            for line in lines_of(file.name, file.content, "#"):
                if line.text.startswith(";"):
                    continue
                if line.text.startswith("["):
                    section = line.text.strip("[] \t").upper()
                    if joint := _JOINT.fullmatch(line.text):
                        section = f"JOINT_{int(joint[1])}"
                        joints.append(int(joint[1]))
                        is_older = is_older or line.text.upper().startswith("[AXIS_")
                elif (match := _SETTING.fullmatch(line.text)) and match[1].upper() in _READ:
                    key = (section, match[1].upper())
                    if settings.setdefault(key, (line, match[2].strip()))[1] != match[2].strip():
                        raise line.refuse(f"one {key[1]} of [{section}]")
        name = list_names(file.name for file in files)
        return cls(name, settings, list(dict.fromkeys(joints)), is_older)

    def says(self, section: str, key: str) -> str | None:
        """Give a setting's value, None where it is not stated."""
        setting = self.settings.get((section, key))
        return None if setting is None else setting[1]

    def units(self, options: LinuxCncOptions) -> str:
        """Give the unit of all files: what the INI says, else the option."""
        setting = self.settings.get(("TRAJ", "LINEAR_UNITS"))
        if setting is None:
            return options.linear_units
        line, word = setting
        units = _UNITS.get(word.lower())
        if units is None:
            raise line.refuse(f"LINEAR_UNITS of {list_names(_UNITS)}")
        _expect_same(options, "linear_units", units, f"LINEAR_UNITS of {line.file}")
        return units

    @property
    def coordinates(self) -> str | None:
        """The axis of each joint from 0, None where the INI does not say it."""
        kinematics = (self.says("KINS", "KINEMATICS") or "").split()
        if kinematics:
            if kinematics[0].lower() != "trivkins":
                return None
            coordinates = [w for w in kinematics[1:] if w.lower().startswith("coordinates=")]
            return _letters(coordinates[0].partition("=")[2]) if coordinates else COORDINATES
        if self.is_older:
            return COORDINATES
        traj = self.says("TRAJ", "COORDINATES")
        return None if traj is None else _letters(traj)

    @property
    def coordinates_text(self) -> str:
        """Them, for a sentence."""
        return f"coordinates={self.coordinates} of {self.name}"

    def joints_of(self, file: ControllerFile) -> list[int] | None:
        """List the joints that load a file; none where the INI has no joints, None if no joint."""
        if not self.joints:
            return []
        name = _base(file.name)
        joints = [
            joint
            for joint in self.joints
            if _base(self.says(f"JOINT_{joint}", "COMP_FILE") or "") == name
        ]
        return joints or None

    def kind_of(self, joints: Sequence[int], options: LinuxCncOptions) -> int:
        """Give the COMP_FILE_TYPE of a file that these joints load."""
        if not joints:
            return options.type
        kinds = set()
        for joint in joints:
            # The controller's own default is type 0.
            kind = self.says(f"JOINT_{joint}", "COMP_FILE_TYPE") or "0"
            if kind not in ("0", "1"):
                line, _ = self.settings[f"JOINT_{joint}", "COMP_FILE_TYPE"]
                raise line.refuse("COMP_FILE_TYPE 0 or 1")
            kinds.add(int(kind))
            _expect_same(
                options, "type", int(kind), f"COMP_FILE_TYPE of joint {joint} in {self.name}"
            )
        if len(kinds) > 1:
            raise InvalidContent.of_field(
                f"files.{self.name}",
                f"expected one COMP_FILE_TYPE of the joints {list_names(map(str, joints))}, which "
                "load the same file, got both",
            )
        return kinds.pop()

    def without_table(self, axis: str, joints: Iterable[int]) -> list[int]:
        """List the other joints that move an axis, of those that the INI speaks of."""
        coordinates = self.coordinates or ""
        moving = [n for n, letter in enumerate(coordinates) if letter.lower() == axis]
        return [n for n in moving if n not in joints] if self.joints else []

    def unread(self, files: Sequence[ControllerFile]) -> list[tuple[int, str]]:
        """List the joints whose COMP_FILE is not among the files."""
        names = {_base(file.name) for file in files}
        named = [(joint, self.says(f"JOINT_{joint}", "COMP_FILE")) for joint in self.joints]
        return [(joint, name) for joint, name in named if name and _base(name) not in names]


def _base(path: str) -> str:
    return path.rpartition("/")[2]


def _letters(text: str) -> str:
    return re.sub(r"[^A-Z]", "", text.upper())


def _expect_same(options: LinuxCncOptions, name: str, written: object, where: str) -> None:
    """Refuse an option that contradicts what the INI states."""
    option = getattr(options, name)
    if name in options.model_fields_set and option != written:
        raise InvalidContent.of_field(
            f"options.{name}", f"expected {written!r}, as {where} says, got {option!r}"
        )


def _axis_of(
    file: ControllerFile,
    joints: Sequence[int],
    ini: _Ini,
    options: LinuxCncOptions,
    reading: Reading,
) -> str | None:
    """Find the axis of a file: by the joints that load it, else by its name."""
    if not joints:
        named = file.axis or _base(file.name).partition(".")[0].lower()
        if named in [*LINEAR_LETTERS]:
            return named
        raise InvalidContent.of_field(
            f"files.{file.name}",
            "expected the name of an axis, such as x.comp, or the machine's INI, whose [JOINT_N] "
            "name their files; got neither",
        )
    axes = {_axis_of_joint(joint, ini, options) for joint in joints}
    if len(axes) > 1:
        raise InvalidContent.of_field(
            f"files.{file.name}",
            f"expected one axis of the joints {list_names(map(str, joints))} that load it, got "
            f"{list_names(sorted(axes)).upper()}",
        )
    (axis,) = axes
    if axis in [*LINEAR_LETTERS]:
        return axis
    reading.leave_aside(file.name, f"it is of axis {axis.upper()}, and only X, Y and Z are read")
    return None


def _axis_of_joint(joint: int, ini: _Ini, options: LinuxCncOptions) -> str:
    coordinates = ini.coordinates
    if coordinates is None:
        by_option = {n: axis for axis, of in options.joints.items() for n in _several(of)}
        kinematics = ini.says("KINS", "KINEMATICS")
        if joint in by_option and (kinematics is None or "joints" in options.model_fields_set):
            return by_option[joint]
        raise InvalidContent.of_field(
            f"files.{ini.name}",
            f"expected KINEMATICS = trivkins coordinates=…, which says the axis of joint {joint}, "
            f"or options.joints; got {kinematics or 'neither'}",
        )
    if "joints" in options.model_fields_set:
        for axis, number in options.joints.items():
            moving = {n for n, letter in enumerate(coordinates) if letter.lower() == axis}
            if moving and set(_several(number)) != moving:
                raise InvalidContent.of_field(
                    f"options.joints.{axis}",
                    f"expected {sorted(moving)}, as {ini.coordinates_text} says, got {number}",
                )
    if joint >= len(coordinates):
        raise InvalidContent.of_field(
            f"files.{ini.name}",
            f"expected joints 0 to {len(coordinates) - 1} for coordinates={coordinates}, got "
            f"joint {joint} with a COMP_FILE",
        )
    return coordinates[joint].lower()


def _expect_alike(axis: str, tables: Sequence[_JointTable], ini: _Ini) -> None:
    """Refuse different tables of the joints of one axis: they are no error of it alone."""
    first = tables[0]
    for other in tables[1:]:
        off = difference(other.curve, first.curve)
        if off.largest == 0.0:
            continue
        at = np.array([off.position_mm])
        values = ", ".join(
            f"joint {list_names(map(str, table.joints)) or '?'} ({table.file}) "
            f"{float(table.curve.at(at, off.direction)[0]):g} µm"
            for table in (first, other)
        )
        raise InvalidContent.of_field(
            f"files.{other.file}",
            f"expected the same table of all joints of {axis.upper()} "
            f"({ini.coordinates_text}), got {first.curve.code} of {values} at "
            f"{off.position_mm:g} mm",
        )


def _read(file: ControllerFile, axis: str, kind: int, units: str, reading: Reading) -> Curve:
    rows: list[tuple[float, float, float]] = []
    behind = []
    for line in lines_of(file.name, file.content):
        if line.number != len(rows) + 1:
            raise InvalidContent.of_field(
                f"files.{file.name}",
                f"line {len(rows) + 1}: expected three numbers, got a blank line: LinuxCNC ends "
                "reading here, and the rows after it are lost",
            )
        row, rest = _row(line, rows, _MM_PER[units])
        rows.append(row)
        behind += [rest] if rest else []
    if not rows:
        raise InvalidContent.of_field(f"files.{file.name}", "expected rows, got none")
    if behind:
        reading.warnings.append(
            f"{file.name}: what stands behind the third number of a line is not read, as in the "
            f"control ({list_names([repr(text[:30]) for text in behind], limit=3)})"
        )
    table = np.array(rows)
    nominal, values = table[:, :1], table[:, 1:]
    _expect_kind(file, kind, nominal, values)
    errors = values - nominal if kind == 0 else 0.0 - values
    largest = float(np.abs(errors).max())
    if largest > LARGEST_ERROR_MM:
        raise InvalidContent.of_field(
            f"files.{file.name}",
            f"expected errors within ±{LARGEST_ERROR_MM:g} mm as type {kind} in {units}, got "
            f"{largest:g} mm",
        )
    return curve_read(curve_code(axis, axis), nominal[:, 0], *(errors.T * UM_PER_MM))


def _expect_kind(file: ControllerFile, kind: int, nominal: FloatArray, values: FloatArray) -> None:
    """Refuse trims that are positions, and positions that are trims: what the values are near."""
    as_trims, as_positions = np.abs(values).sum(), np.abs(values - nominal).sum()
    if kind == 1 and as_positions < as_trims:
        expected, came = "trims (COMP_FILE_TYPE 1)", "are these positions of type 0?"
    elif kind == 0 and as_trims < as_positions:
        expected, came = "actual positions (COMP_FILE_TYPE 0)", "are these trims of type 1?"
    else:
        return
    nearer = "the nominal positions" if kind == 1 else "0"
    raise InvalidContent.of_field(
        f"files.{file.name}", f"expected {expected}, got values nearer to {nearer}: {came}"
    )


def _row(
    line: Line, before: Sequence[tuple[float, float, float]], mm: float
) -> tuple[tuple[float, float, float], str]:
    """Read one row [mm] as the controller does, and give the text behind its numbers."""
    match = _ROW.fullmatch(line.text)
    if match is None:
        raise line.refuse(
            "three numbers with blanks between them (LinuxCNC ends reading here without a word, "
            "or reads less than what stands there)"
        )
    nominal, plus, minus = (
        line.number_of(match[i], "a position or trim") * mm for i in range(1, 4)
    )
    if len(before) >= MOST_ROWS:
        raise line.refuse(f"at most {MOST_ROWS} rows (LinuxCNC drops the rest)")
    if before and nominal <= before[-1][0]:
        raise line.refuse("increasing nominal positions (LinuxCNC drops this row)")
    line.position_mm(match[1])
    return (nominal, plus, minus), match[4]


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
    both_directions=LINEAR,
    options=LinuxCncOptions,
    render=_render,
    parse=_parse,
)

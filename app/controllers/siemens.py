"""What Siemens' part programs of tables have in common: assignments, tolerant but not guessing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from app.controllers.curve import Curve
from app.controllers.format import ControllerFile, Reading
from app.controllers.grids import even_positions
from app.controllers.lines import Line, fixed, lines_of
from app.errors import InvalidContent
from app.units import UM_PER_MM

END: Final = "M17"

_NUMBERED: Final = re.compile(r"^N\d+\s*(?=\S)", re.IGNORECASE | re.ASCII)
_CHECKSUM: Final = re.compile(r"\s'[0-9A-F]{4}$", re.IGNORECASE)
_PROGRAM: Final = re.compile(r"%_N_\w+", re.IGNORECASE)
_END: Final = re.compile(r"M(?:0?2|17|23|30)|RET", re.IGNORECASE)
_NO_VALUE: Final = re.compile(
    r"CHANDATA\s*\(\s*\d+\s*\)|\$PATH=.*|M0?[01]|NEWCONF|STOPRE|"
    r"MSG\s*\(.*\)|G0?4\s*[FS][\d.]+|PROC\s+\w+(?:\s+\w+)*",
    re.IGNORECASE,
)
"""What neither sets a value nor decides whether another line does."""

_VARIABLE: Final = re.compile(r"\$(\w+)\s*(?:\[([^\]]*)\])?\s*=?\s*(.*)", re.ASCII)
_VALUE: Final = re.compile(r"(\(\s*\w+\s*\)|'?[^\s()']+'?)", re.ASCII)
_INDEX: Final = re.compile(r"\s*(\w+)\s*(?:[,.]\s*(\w+)\s*)?(?:[,.]\s*(\w+)\s*)?")
_OFF: Final = ("0", "FALSE")


def written(file: str, head: Sequence[str], rows: Sequence[str]) -> ControllerFile:
    """Write a file of assignments."""
    lines = [f"%{file}", "CHANDATA(1)", *(f"; {line}" for line in head), *rows, END]
    return ControllerFile(f"{file[1:]}.INI", "\n".join(lines) + "\n")


def evenly(curve: Curve, options: Any, through_mm: float | None = None) -> Curve:
    """Sample a curve as `most_points` and `spacing_mm` of the options have it, and round it."""
    most, spacing_mm = options.most_points, options.spacing_mm
    field = "options.spacing_mm"
    at = even_positions(curve.positions_mm, most, spacing_mm, field, through_mm)
    return curve.sampled(at).rounded(10.0**-options.decimals * UM_PER_MM)


def placing(curve: Curve) -> dict[str, str]:
    """Give the settings that place an even curve's points."""
    at = curve.positions_mm
    return {
        "STEP": fixed(float(at[-1] - at[0]) / (at.size - 1), 4),
        "MIN": fixed(float(at[0]), 4),
        "MAX": fixed(float(at[-1]), 4),
    }


@dataclass(frozen=True, slots=True)
class Assignment:
    """One `$NAME[i,j]=value`: the name in upper case, its indices, the value as text."""

    line: Line
    name: str
    indices: tuple[str, ...]
    value: str

    def number(self, place: int) -> int:
        """Read one index as a whole number from 0."""
        if place >= len(self.indices) or not self.indices[place].isdigit():
            raise self.line.refuse(f"a whole number as index {place + 1}")
        return self.line.whole(self.indices[place], f"index {place + 1}")


@dataclass(frozen=True, slots=True)
class Program:
    """What a file assigns: the tables, and what switches them, as it is at the end."""

    assignments: Sequence[Assignment]
    switches: dict[tuple[str, tuple[str, ...]], Assignment]

    def switch(self, name: str, *indices: str) -> Assignment | None:
        """Take what switches a table; None where the file does not say it."""
        return self.switches.pop((name, indices), None)

    def leave_rest_aside(self, reading: Reading) -> None:
        """Note the switches that nobody took."""
        for (name, indices), switch in self.switches.items():
            reading.leave_aside(
                f"${name}[{','.join(indices)}]={switch.value}", "it switches nothing that is read"
            )


def switched_off(switch: Assignment | None) -> str | None:
    """Say what switches a table off; None where it is on."""
    return off_by(switch) if switch is not None and switch.value.upper() in _OFF else None


def off_by(switch: Assignment) -> str:
    """Say that a table does nothing, because of a switch."""
    return (
        f"switched off by ${switch.name}[{','.join(switch.indices)}]={switch.value}, so that it "
        "does nothing"
    )


def program(
    file: ControllerFile, prefix: str, switches: Sequence[str], reading: Reading
) -> Program:
    """Read a file's assignments; those of other variables are left aside.

    A missing `=`, a dot between indices, lower case, numbers before lines and the control's
    checksums behind them are tolerated: real files have them.

    Parameters
    ----------
    switches
        Names of the machine and setting data that switch the tables on and off.
    reading
        Where it is noted what is left aside.

    Raises
    ------
    InvalidContent
        If a line may set a value in a way that cannot be read, or if anything follows the end.
    """
    assigned: list[Assignment] = []
    switched: dict[tuple[str, tuple[str, ...]], Assignment] = {}
    others: list[str] = []
    ended = True
    begun = False
    for raw in lines_of(file.name, file.content, ";"):
        line = raw._replace(text=_CHECKSUM.sub("", _NUMBERED.sub("", raw.text)).rstrip())
        if _PROGRAM.fullmatch(line.text):
            if begun and not ended:
                raise raw.refuse(f"{END} before the next program: the file may be cut off")
            ended = False
        elif _END.fullmatch(line.text):
            begun, ended = True, True
        elif begun and ended:
            raise raw.refuse("nothing after the end of the program")
        elif _NO_VALUE.fullmatch(line.text):
            begun, ended = True, False
        else:
            begun, ended = True, False
            name = (match := _VARIABLE.fullmatch(line.text)) and match[1].upper()
            if name is None:
                raise raw.refuse(
                    f"assignments such as ${prefix}[0,0]=+0.0001; what a jump, a condition or a "
                    "calculation would do in the control cannot be read"
                )
            if not name.startswith(prefix) and name not in switches:
                others.append(name)
                continue
            assignment = _assignment(raw, line.text)
            # The last one counts, as in the control, which runs the file from top to bottom.
            if name in switches:
                switched[name, assignment.indices] = assignment
            else:
                assigned.append(assignment)
    if not (begun and ended):
        raise InvalidContent.of_field(
            f"files.{file.name}", f"expected {END} at the end, got none: the file may be cut off"
        )
    for name in others:
        reading.leave_aside(f"${name}", f"other data in {file.name}")
    return Program(assigned, switched)


def _assignment(line: Line, text: str) -> Assignment:
    match = _VARIABLE.fullmatch(text)
    assert match is not None
    index = _INDEX.fullmatch(match[2] or "")
    if index is None:
        raise line.refuse("indices such as [0,0]")
    if not _VALUE.fullmatch(match[3]):
        raise line.refuse("one value, as a number or a name")
    indices = tuple(part.upper() for part in index.groups() if part is not None)
    return Assignment(line, match[1].upper(), indices, match[3].strip("'() \t"))


@dataclass
class EvenTable:
    """Values over an equidistant grid, while they are being read."""

    values: dict[int, float]
    settings: dict[str, Assignment]

    @classmethod
    def empty(cls) -> EvenTable:
        """Begin with nothing."""
        return cls({}, {})

    def set_value(self, assignment: Assignment, place: int, value: float) -> None:
        """Set one value; a second one for the same place is refused."""
        if place in self.values:
            raise assignment.line.refuse("each point once")
        self.values[place] = value

    def set_setting(self, assignment: Assignment) -> None:
        """Keep one setting; a second one of the same name is refused."""
        if assignment.name in self.settings:
            raise assignment.line.refuse("each setting once")
        self.settings[assignment.name] = assignment

    def setting(self, name: str, field: str) -> Assignment:
        """Give a setting, or refuse the table that lacks it."""
        assignment = self.settings.get(name)
        if assignment is None:
            raise InvalidContent.of_field(
                field,
                f"expected ${name}, got a table without it: the controller would keep "
                "what stood there before",
            )
        return assignment

    def grid(self, names: Sequence[str], field: str) -> list[float]:
        """Give the positions [mm] from step, minimum and maximum, in this order of `names`.

        Raises
        ------
        InvalidContent
            If the count does not come out whole, or a point has no value: a gap keeps in the
            controller what stood there before.
        """
        assignments = [self.setting(name, field) for name in names]
        step, low, high = (
            assignment.line.position_mm(assignment.value) for assignment in assignments
        )
        if not step > 0 or high <= low:
            raise assignments[0].line.refuse(f"a step above 0 and a maximum above {low:g} mm")
        sections = round((high - low) / step)
        if abs((high - low) / step - sections) > 1e-4 or sections < 1 or sections > 100_000:
            raise assignments[0].line.refuse(
                f"a step that divides {low:g} to {high:g} mm into whole sections"
            )
        missing = sorted(set(range(sections + 1)) - set(self.values))
        beyond = sorted(set(self.values) - set(range(sections + 1)))
        if missing or beyond:
            wrong = f"no point {missing[0]}" if missing else f"a point {beyond[0]}"
            raise InvalidContent.of_field(
                field,
                f"expected points 0 to {sections} for {low:g} to {high:g} mm by {step:g}, got "
                f"{wrong}: the controller would keep an old value, or not load it",
            )
        return [round(low + step * i, 6) for i in range(sections + 1)]

    def ordered(self) -> list[float]:
        """Give the values in order."""
        return [self.values[place] for place in sorted(self.values)]

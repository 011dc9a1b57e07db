"""What Siemens' part programs of tables have in common: assignments, tolerant but not guessing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from app.controllers.format import ControllerFile
from app.controllers.lines import Line, lines_of
from app.errors import InvalidContent

END: Final = "M17"

_HEADING: Final = re.compile(r"%_N_\w+|CHANDATA\s*\(\s*\d+\s*\)|;?\s*\$PATH=.*", re.IGNORECASE)
_END: Final = re.compile(r"M(?:0?2|17|23|30)", re.IGNORECASE)
_ASSIGNMENT: Final = re.compile(
    r"(?:N\d+\s+)?\$(\w+)\s*\[([^\]]*)\]\s*(?:=\s*)?(\(\s*\w+\s*\)|'?[^\s()']+'?)", re.IGNORECASE
)
_INDEX: Final = re.compile(r"\s*(\w+)\s*(?:[,.]\s*(\w+)\s*)?(?:[,.]\s*(\w+)\s*)?")


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


def assignments(file: ControllerFile, prefix: str) -> Iterator[Assignment]:
    """Go through a file's assignments.

    A missing `=`, a dot between indices and lower case are tolerated: real files have them.

    Parameters
    ----------
    file
        The file.
    prefix
        What the names begin with; others are of another format.

    Raises
    ------
    InvalidContent
        If a line is neither heading, end nor assignment, or if anything follows the end.
    """
    ended = False
    for line in lines_of(file.name, file.content, ";"):
        if _HEADING.fullmatch(line.text):
            continue
        if ended:
            raise line.refuse("nothing after the end of the program")
        if _END.fullmatch(line.text):
            ended = True
            continue
        found = _ASSIGNMENT.fullmatch(line.text)
        if found is None or not found[1].upper().startswith(prefix):
            raise line.refuse(f"an assignment such as ${prefix}[0,0]=+0.0001")
        index = _INDEX.fullmatch(found[2])
        if index is None:
            raise line.refuse("indices such as [0,0]")
        indices = tuple(part.upper() for part in index.groups() if part is not None)
        yield Assignment(line, found[1].upper(), indices, found[3].strip("'() \t"))
    if not ended:
        raise InvalidContent.of_field(
            f"files.{file.name}", f"expected {END} at the end, got none: the file may be cut off"
        )


@dataclass
class EvenTable:
    """Values over an equidistant grid, while they are being read."""

    values: dict[int, float]
    settings: dict[str, Assignment]

    @classmethod
    def empty(cls) -> EvenTable:
        """Begin with nothing."""
        return cls({}, {})

    def set_value(self, given: Assignment, place: int, value: float) -> None:
        """Set one value; a second one for the same place is refused."""
        if place in self.values:
            raise given.line.refuse("each point once")
        self.values[place] = value

    def set_setting(self, given: Assignment) -> None:
        """Keep one setting; a second one of the same name is refused."""
        if given.name in self.settings:
            raise given.line.refuse("each setting once")
        self.settings[given.name] = given

    def setting(self, name: str, field: str) -> Assignment:
        """Give a setting, or refuse the table that lacks it."""
        found = self.settings.get(name)
        if found is None:
            raise InvalidContent.of_field(
                field,
                f"expected ${name}, got a table without it: the controller would keep "
                "what stood there before",
            )
        return found

    def grid(self, names: Sequence[str], field: str) -> list[float]:
        """Give the positions [mm] from step, minimum and maximum, in this order of `names`.

        Raises
        ------
        InvalidContent
            If the count does not come out whole, or a point has no value: a gap keeps in the
            controller what stood there before.
        """
        given = [self.setting(name, field) for name in names]
        step, low, high = (one.line.position_mm(one.value) for one in given)
        if not step > 0 or high <= low:
            raise given[0].line.refuse(f"a step above 0 and a maximum above {low:g} mm")
        sections = round((high - low) / step)
        if abs((high - low) / step - sections) > 1e-4 or sections < 1 or sections > 100_000:
            raise given[0].line.refuse(
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

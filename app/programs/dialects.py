"""The words of the controllers: a measuring program as the text that one of them runs.

Siemens, Fanuc and LinuxCNC read ISO 6983 with words of their own; Heidenhain is written in its
conversational language, which every TNC speaks. All positions are the machine's own. Siemens
(SUPA), LinuxCNC (G53) and Heidenhain (M91) say so in every block, whatever offset is active.
Fanuc's G53 is rapid only, so there G54 has to be zero, and the program stops before the first
move until somebody has looked.
"""

from __future__ import annotations

import textwrap
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from app.errors import UnknownThing, list_names
from app.programs.path import DECIMALS
from app.programs.program import Block, Dwell, MeasuringProgram, Move, Remark, Spindle, Stop
from app.units import MS_PER_S

_WIDEST: Final = 64
"""Characters in a comment: small screens show no more."""

_NOT_RUN: Final = (
    "words as manuals and public programs have them, not run on such a control yet: try it "
    "without the instrument first, at low override"
)

_ASCII: Final = {"µ": "u", "–": "-", "−": "-", "·": " ", "°": " deg", "…": "...", "×": "x"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect(ABC):
    """How one make of controllers writes a program.

    Parameters
    ----------
    status
        How surely the words are right.
    where
        What positions count from, for the head.
    """

    name: str
    title: str
    suffix: str
    status: str
    where: str

    @abstractmethod
    def write(self, program: MeasuringProgram) -> str:
        """Write the whole program."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Iso6983(Dialect):
    """Words of a controller that reads ISO 6983.

    Parameters
    ----------
    begin, end
        Lines around the program; with `{name}` and `{number}` of it.
    comment
        A comment, with `{text}`.
    modes
        Metric, absolute, mm/min, no offsets, exact stop.
    machine_word
        Stands in each move, so that positions are the machine's; empty where there is none.
    dwell_word
        Before the time; in milliseconds where `dwells_in_ms`.
    offset_check
        What somebody has to look at before the first move; empty where nothing.
    capitals
        Whether comments have capital letters only.
    """

    begin: tuple[str, ...]
    end: tuple[str, ...]
    comment: str
    modes: tuple[str, ...]
    machine_word: str
    dwell_word: str
    dwells_in_ms: bool = False
    offset_check: str = ""
    capitals: bool = False

    def write(self, program: MeasuringProgram) -> str:
        """Write the whole program.

        Examples
        --------
        >>> LINUXCNC._lines(Move({"x": 1.5}, 800.0)), FANUC._lines(Dwell(4.0))
        (['G53 G1 X1.500 F800.0'], ['G4 P4000'])
        """
        head = _head(program, self)
        lines = [line.format(name=program.name, number=program.number) for line in self.begin]
        lines += [self._comment(line) for text in head for line in _wrapped(text)]
        lines += self.modes
        if self.offset_check:
            lines += self._lines(Stop(self.offset_check))
        for block in program.blocks:
            lines += self._lines(block)
        return "".join(f"{line}\n" for line in [*lines, *self.end])

    def _comment(self, text: str) -> str:
        plain = text.replace("(", "[").replace(")", "]")
        return self.comment.format(text=plain.upper() if self.capitals else plain)

    def _lines(self, block: Block) -> list[str]:
        match block:
            case Move(to_mm, feed):
                words = [self.machine_word, "G0" if feed is None else "G1", *_coordinates(to_mm)]
                words += [] if feed is None else [f"F{float(feed)}"]
                return [" ".join(word for word in words if word)]
            case Dwell(seconds):
                time = f"{round(seconds * MS_PER_S)}" if self.dwells_in_ms else f"{seconds:.3f}"
                return [f"{self.dwell_word}{time}"]
            case Spindle(speed_rpm):
                return [f"S{speed_rpm:.0f} M3"] if speed_rpm else ["M5"]
            case Stop(why):
                return [*(self._comment(line) for line in _wrapped(why)), "M0"]
            case Remark(text):
                return [self._comment(line) for line in _wrapped(text)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversational(Dialect):
    """Heidenhain's conversational language: numbered blocks, signs on all coordinates."""

    longest_dwell_s: float

    def write(self, program: MeasuringProgram) -> str:
        """Write the whole program.

        Examples
        --------
        >>> HEIDENHAIN._lines(Move({"x": 1.5}, 800.0)), HEIDENHAIN._lines(Spindle(3000.0))
        (['L X+1.500 R0 F800 M91'], ['TOOL CALL S3000', 'M3'])
        """
        lines = [f"BEGIN PGM {program.name} MM"]
        lines += [f"; {line}" for text in _head(program, self) for line in _wrapped(text)]
        lines.append("M5")
        for block in program.blocks:
            lines += self._lines(block)
        lines += ["M30", f"END PGM {program.name} MM"]
        return "".join(f"{number} {line}\n" for number, line in enumerate(lines))

    def _lines(self, block: Block) -> list[str]:
        match block:
            case Move(to_mm, feed):
                speed = "FMAX" if feed is None else f"F{feed:.3f}".rstrip("0").rstrip(".")
                return [" ".join(["L", *_coordinates(to_mm, "+"), "R0", speed, "M91"])]
            case Dwell(seconds):
                return [line for part in self._parts(seconds) for line in _dwell_cycle(part)]
            case Spindle(speed_rpm):
                return [f"TOOL CALL S{speed_rpm:.0f}", "M3"] if speed_rpm else ["M5"]
            case Stop(why):
                return [*(f"; {line}" for line in _wrapped(why)), "STOP"]
            case Remark(text):
                return [f"; {line}" for line in _wrapped(text)]

    def _parts(self, seconds: float) -> Iterator[float]:
        """Part a dwell that is longer than the cycle takes."""
        while seconds > self.longest_dwell_s:
            yield self.longest_dwell_s
            seconds -= self.longest_dwell_s
        yield seconds


def _dwell_cycle(seconds: float) -> tuple[str, str]:
    return ("CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {seconds:.3f}")


def _coordinates(to_mm: Mapping[str, float], sign: str = "") -> Iterator[str]:
    for axis, mm in sorted(to_mm.items()):
        yield f"{axis.upper()}{mm:{sign}.{DECIMALS}f}"


def _head(program: MeasuringProgram, dialect: Dialect) -> list[str]:
    return [
        f"thermap: {program.title}, machine {program.machine}",
        f"{dialect.title}: {dialect.status}",
        dialect.where,
        "tilted planes, mirroring, scaling and transformations have to be off; see that nothing "
        "in the spindle can touch anything on this way",
        *program.head,
    ]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(ascii_text(text), _WIDEST) or [""]


def ascii_text(text: str) -> str:
    """Write a sentence in the letters that every controller has.

    Examples
    --------
    >>> ascii_text("Größe 5 µm − größer")
    'Grosse 5 um - grosser'
    """
    spelled_out = "".join(_ASCII.get(letter, letter) for letter in text.replace("ß", "ss"))
    plain = unicodedata.normalize("NFKD", spelled_out)
    letters = "".join(letter for letter in plain if not unicodedata.combining(letter))
    return "".join(letter if " " <= letter <= "~" else "?" for letter in letters)


LINUXCNC: Final = Iso6983(
    name="linuxcnc",
    title="LinuxCNC",
    suffix=".ngc",
    status="read by its interpreter and run by the controller, in simulation",
    where="positions are the machine's (G53 in each move); no tool length (G49)",
    begin=("%",),
    end=("G64", "M2", "%"),
    comment="; {text}",
    modes=("G17 G21 G40 G49 G80 G90 G94", "G61.1", "M5"),
    machine_word="G53",
    dwell_word="G4 P",
)
SIEMENS: Final = Iso6983(
    name="siemens",
    title="Siemens SINUMERIK",
    suffix=".MPF",
    status=_NOT_RUN,
    where="positions are the machine's (SUPA in each move); no tool offset (D0)",
    begin=(),
    end=("M30",),
    comment="; {text}",
    modes=("G17 G40 G60 G90 G94 G710", "D0", "M5"),
    machine_word="SUPA",
    dwell_word="G4 F",
)
FANUC: Final = Iso6983(
    name="fanuc",
    title="Fanuc",
    suffix=".NC",
    status=_NOT_RUN,
    where="positions are of G54, which has to be the machine's zero: G54, external offset and "
    "G52/G92 shifts all 0; no tool length (G49)",
    begin=("%", "O{number} ({name})"),
    end=("G64", "M30", "%"),
    comment="({text})",
    modes=("G17 G21 G40 G49 G80 G90 G94", "G61", "G54", "M5"),
    machine_word="",
    dwell_word="G4 P",
    dwells_in_ms=True,
    offset_check="look: G54, external offset and shifts 0 in all axes? only then start",
    capitals=True,
)
HEIDENHAIN: Final = Conversational(
    name="heidenhain",
    title="Heidenhain TNC, conversational",
    suffix=".H",
    status=_NOT_RUN,
    where="positions are the machine's (M91 in each move); tool length is not counted there",
    longest_dwell_s=3600.0,  # of cycle 9
)

DIALECTS: Final[Mapping[str, Dialect]] = {
    dialect.name: dialect for dialect in (SIEMENS, HEIDENHAIN, FANUC, LINUXCNC)
}


def dialect_named(name: str) -> Dialect:
    """Find a dialect by its name.

    Raises
    ------
    UnknownThing
        That lists what exists.
    """
    if name not in DIALECTS:
        raise UnknownThing(f"expected a controller among {list_names(DIALECTS)}, got {name!r}")
    return DIALECTS[name]

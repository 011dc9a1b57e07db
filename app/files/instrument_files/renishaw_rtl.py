"""Renishaw's linear measurements, `.rtl`: a body of `positioning`.

Known from public programs that write such files, and not from Renishaw. Lines in sections:

    HEADER::          File type, Owner (Linear; others are other measurements)
    TARGET DATA::     Filetype: ISO, Target-count, Targets [mm], Flags (0 0 2 0: both directions,
                      0 1 2 0: one)
    USER-TEXT::       Machine, Serial No, Date, By, Axis, Location, TITLE: free text
    RUNS::            Run-count; one direction is one run
    DEVIATIONS::      after `Run Target Data:` a line for each value: run, target, measured less
                      target [µm]
    ENVIRONMENT::     not read: its temperatures are not those of the machine's sensors
    EOF::
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from app.errors import counted, list_names
from app.files.code_pages import UNREADABLE
from app.files.delimited_text import LONGEST_LINE, Problems, split_lines
from app.files.read_body import ReadBody
from app.geometry.components import LINEAR_LETTERS

BEGINS: Final = re.compile(r"\s*HEADER\s*::", re.I)

_SECTION: Final = re.compile(r"([A-Z][A-Z \t-]*)::", re.I)
_NUMBER: Final = re.compile(
    r"[+-]?(?:\d{1,9}(?:[.,]\d{0,12})?|[.,]\d{1,12})(?:[eE][+-]?\d{1,2})?", re.ASCII
)
_COUNT: Final = re.compile(r"\d{1,6}", re.ASCII)
_AXIS: Final = re.compile(r"(?<![A-Z0-9])([XYZ])\d?(?![A-Z0-9])", re.I)

_NEEDED: Final = ("HEADER", "TARGET DATA", "RUNS", "DEVIATIONS", "EOF")
_READ: Final = (*_NEEDED, "USER-TEXT")

_BOTH_WAYS: Final = ("0", "0", "2", "0")
_ONE_WAY: Final = ("0", "1", "2", "0")

_LONGEST_CUT: Final = 60


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    text: str


@dataclass(slots=True)
class _File:
    """A file's sections, and the marks that its numbers were written with."""

    problems: Problems
    sections: dict[str, list[_Line]]
    begins: dict[str, int]
    marks: dict[str, int] = field(default_factory=dict)

    def refuse(self, expected: str, got: str, line: int | None = None) -> None:
        """Note what is wrong; nothing came where `got` is empty."""
        self.problems.add(
            f"expected {expected}, got {repr(self.cut(got)) if got else 'none'}", line
        )

    @staticmethod
    def cut(text: str) -> str:
        """Shorten what is repeated of a file."""
        return text if len(text) <= _LONGEST_CUT else text[: _LONGEST_CUT - 1] + "…"

    def stop_if_wrong(self) -> None:
        """Raise UnreadableFile with everything that was noted."""
        self.problems.raise_if_any()

    def entry(self, section: str, name: str) -> _Line | None:
        """Find `name: value` in a section, spelled in any way; the value with its line."""
        entry = None
        for line in self.sections.get(section, []):
            key, colon, value = line.text.partition(":")
            if colon and _plain(key) == _plain(name):
                if entry is not None and entry.text != value.strip():
                    self.refuse(f"{name}: once in {section}::", line.text, line.number)
                entry = _Line(line.number, value.strip())
        return entry

    def count(self, section: str, name: str) -> int:
        """Read a number of things; 0 and a note where there is none."""
        entry = self.entry(section, name)
        line = self.begins.get(section)
        if entry is None:
            self.problems.add(f"expected {name} in {section}::, got none", line)
            return 0
        if not _COUNT.fullmatch(entry.text) or int(entry.text) == 0:
            self.refuse(f"{name} as a number from 1", entry.text, entry.number)
            return 0
        return int(entry.text)

    def number(self, text: str, line: int, what: str) -> float:
        """Read a decimal number with a point or a comma; nan and a note where it is none."""
        if not _NUMBER.fullmatch(text):
            self.refuse(what, text, line)
            return math.nan
        for mark in ".,":
            if mark in text:
                self.marks.setdefault(mark, line)
        return float(text.replace(",", ".")) + 0.0  # −0 is none


def read_renishaw_rtl(text: str, file: Path, axis: str | None = None) -> ReadBody:
    """Read a linear measurement.

    Parameters
    ----------
    axis
        Which one it was, where the file's free text is not to be asked.

    Returns
    -------
    ReadBody
        The body of `positioning`; the title is the label. The machine is free text and the
        time has no zone, so neither is in it: remarks say what the file states.

    Raises
    ------
    UnreadableFile
        With the line of everything that is wrong, what was expected and what came.
    """
    rtl_file = _sections_of(text, file)
    _check_kind(rtl_file)
    rtl_file.stop_if_wrong()
    targets = _targets(rtl_file)
    both_ways = _goes_both_ways(rtl_file)
    runs = _runs(rtl_file, len(targets), both_ways)
    letter = _axis(rtl_file, axis)
    _check_marks(rtl_file)
    rtl_file.stop_if_wrong()
    remarks = list(_remarks(rtl_file, targets, runs))
    ways = _ways(rtl_file, targets, runs, both_ways, remarks)
    rtl_file.stop_if_wrong()
    title = rtl_file.entry("USER-TEXT", "TITLE")
    body: dict[str, Any] = {}
    if title and UNREADABLE in title.text:
        remarks.append(
            "its title is in a code page that cannot be told, and not read: state a label"
        )
    elif title and title.text:
        body = {"label": title.text}
    body |= {"instrument": "Renishaw laser, .rtl", "axis": letter}
    return ReadBody({**body, "targets_mm": sorted(targets), **ways}, None, remarks)


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "", name).lower()


def _sections_of(text: str, file: Path) -> _File:
    """Part a file at its section heads."""
    rtl_file = _File(Problems(file), {}, {})
    name = ""
    for number, written in enumerate(split_lines(text), start=1):
        if len(written) > LONGEST_LINE:
            rtl_file.refuse(f"at most {LONGEST_LINE} characters", written, number)
            break
        line = written.strip()
        head = _SECTION.fullmatch(line)
        if head:
            name = " ".join(head[1].upper().split())
            if name in rtl_file.sections:
                rtl_file.problems.add(f"expected {name}:: once, came again", number)
            rtl_file.begins.setdefault(name, number)
            rtl_file.sections.setdefault(name, [])
        elif line and name in ("", "EOF"):
            where = "after EOF::" if name else "before HEADER::, with which Renishaw's .rtl begins"
            rtl_file.refuse(f"nothing {where}", line, number)
            break
        elif line:
            rtl_file.sections[name].append(_Line(number, line))
    return rtl_file


def _check_kind(rtl_file: _File) -> None:
    """Say of a file of another kind what it is."""
    if rtl_file.problems.number:
        return
    missing = [name for name in _NEEDED if name not in rtl_file.sections]
    if missing:
        cut = " (is the file cut off?)" if "EOF" in missing else ""
        rtl_file.problems.add(
            f"expected the sections {list_names(f'{n}::' for n in _NEEDED)}, got no "
            f"{list_names(f'{n}::' for n in missing)}{cut}"
        )
        return
    for section, name, wanted, others in (
        ("HEADER", "File type", "rtl", "another kind of file"),
        ("HEADER", "Owner", "Linear", "another kind of measurement"),
        ("TARGET DATA", "Filetype", "ISO", "another order of targets"),
    ):
        entry = rtl_file.entry(section, name)
        if entry is None:
            rtl_file.problems.add(
                f"expected {name}: {wanted} in {section}::, got none", rtl_file.begins[section]
            )
        elif entry.text.lower() != wanted.lower():
            rtl_file.refuse(
                f"{name}: {wanted} (of {others} nothing is read)", entry.text, entry.number
            )


def _targets(rtl_file: _File) -> list[float]:
    """Read the target positions [mm], as they are ordered."""
    wanted = rtl_file.count("TARGET DATA", "Target-count")
    lines = rtl_file.sections["TARGET DATA"]
    at = next((i for i, line in enumerate(lines) if _plain(line.text).startswith("targets:")), None)
    if at is None:
        rtl_file.problems.add("expected Targets: in TARGET DATA::, got none")
        return []
    first = _Line(lines[at].number, lines[at].text.partition(":")[2])
    rest = itertools.takewhile(lambda line: ":" not in line.text, lines[at + 1 :])
    targets = [
        rtl_file.number(word, line.number, "a target position in mm")
        for line in (first, *rest)
        for word in line.text.split()
    ]
    if len(targets) != wanted:
        rtl_file.problems.add(
            f"expected {counted(wanted, 'target')} as Target-count says, got {len(targets)}",
            first.number,
        )
    gaps = {after > before for before, after in itertools.pairwise(targets)}
    if len(targets) < 2 or len(gaps) > 1 or len(set(targets)) < len(targets):
        rtl_file.refuse(
            "at least two targets that only increase, or only decrease",
            list_names(f"{mm:g}" for mm in targets),
            first.number,
        )
    return targets


def _goes_both_ways(rtl_file: _File) -> bool:
    flags = rtl_file.entry("TARGET DATA", "Flags")
    words = tuple(flags.text.split()) if flags else ()
    if words not in (_BOTH_WAYS, _ONE_WAY):
        rtl_file.refuse(
            f"Flags: {' '.join(_BOTH_WAYS)} (both directions) or {' '.join(_ONE_WAY)} (one)",
            " ".join(words),
            flags.number if flags else rtl_file.begins["TARGET DATA"],
        )
    return words == _BOTH_WAYS


def _runs(rtl_file: _File, targets: int, both_ways: bool) -> list[list[float]]:
    """Read the runs' deviations [µm] in the order of the targets."""
    wanted = rtl_file.count("RUNS", "Run-count")
    if both_ways and wanted % 2:
        rtl_file.problems.add(
            f"expected an even Run-count in a file of both directions, got {wanted}",
            rtl_file.begins["RUNS"],
        )
    if not wanted or not targets:  # said already; without them every line would be refused too
        return []
    values = dict(_values(rtl_file, wanted, targets))
    places = itertools.product(range(1, wanted + 1), range(1, targets + 1))
    missing = next((place for place in places if place not in values), None)
    if missing:
        run, target = missing
        rtl_file.problems.add(
            f"expected a value for each of {counted(wanted, 'run')} and "
            f"{counted(targets, 'target')}, got {len(values)}: none of run {run}, target {target}",
            rtl_file.begins["DEVIATIONS"],
        )
        return []
    return [
        [values[run, target] for target in range(1, targets + 1)] for run in range(1, wanted + 1)
    ]


def _values(rtl_file: _File, runs: int, targets: int) -> Iterator[tuple[tuple[int, int], float]]:
    """Read the lines of run, target and deviation."""
    lines = rtl_file.sections["DEVIATIONS"]
    if not lines or _plain(lines[0].text) != "runtargetdata:":
        rtl_file.refuse(
            "Run Target Data: at the beginning of DEVIATIONS::",
            lines[0].text if lines else "",
            lines[0].number if lines else rtl_file.begins["DEVIATIONS"],
        )
        return
    met: set[tuple[int, int]] = set()
    for line in lines[1:]:
        words = line.text.split()
        if len(words) != 3 or not all(_COUNT.fullmatch(word) for word in words[:2]):
            rtl_file.refuse("run, target and deviation in µm", line.text, line.number)
            continue
        place = int(words[0]), int(words[1])
        if not (1 <= place[0] <= runs and 1 <= place[1] <= targets) or place in met:
            again = ", each once" if place in met else ""
            rtl_file.refuse(
                f"a run from 1 to {runs} and a target from 1 to {targets}{again}",
                line.text,
                line.number,
            )
            continue
        met.add(place)
        yield place, rtl_file.number(words[2], line.number, "a deviation in µm")


def _axis(rtl_file: _File, axis: str | None) -> str:
    """Read the axis off free text that names exactly one."""
    if axis is not None:
        if axis.lower() in tuple(LINEAR_LETTERS):
            return axis.lower()
        rtl_file.problems.lack("axis", f"expected axis x, y or z, got {axis!r}")
        return ""
    entry = rtl_file.entry("USER-TEXT", "Axis")
    named = [str(letter).lower() for letter in _AXIS.findall(entry.text)] if entry else []
    if len(set(named)) == 1:
        return named[0]
    got = repr(rtl_file.cut(entry.text)) if entry and entry.text else "none"
    rtl_file.problems.lack(
        "axis",
        f"expected Axis: x, y or z, got {got}",
        ": state it with --axis",
        entry.number if entry else None,
    )
    return ""


def _check_marks(rtl_file: _File) -> None:
    """Refuse points and commas in one file: one of them would part thousands."""
    if len(rtl_file.marks) > 1:
        rtl_file.problems.add(
            "expected decimal points or decimal commas, got both: a comma in line "
            f"{rtl_file.marks[',']} and a point in line {rtl_file.marks['.']}"
        )


def _ways(
    rtl_file: _File,
    targets: Sequence[float],
    runs: Sequence[Sequence[float]],
    both_ways: bool,
    remarks: list[str],
) -> Mapping[str, Any]:
    """Sort the runs by direction: odd ones go with the order of the targets, even ones back."""
    falls = targets[0] > targets[-1]
    rising = [run[::-1] if falls else run for run in runs]
    odd, even = rising[::2], rising[1::2]
    if falls:
        remarks.append("the targets decrease: odd runs are those in the negative direction")
    if both_ways:
        forward, backward = (even, odd) if falls else (odd, even)
        return {"forward_um": list(forward), "backward_um": list(backward)}
    if falls:
        rtl_file.problems.add(
            "expected targets that increase in a file of one direction (positioning needs runs in "
            f"the positive one), got {targets[0]:g} to {targets[-1]:g} mm"
        )
    filled = [run for run in even if not any(run)]
    if filled:
        remarks.append(
            f"one direction: {counted(len(filled), 'even run')} of nothing but zeros left out, "
            "as no measurement"
        )
    return {"forward_um": [run for i, run in enumerate(rising) if not i % 2 or any(run)]}


def _remarks(
    rtl_file: _File, targets: Sequence[float], runs: Sequence[Sequence[float]]
) -> Iterator[str]:
    """Say how surely it is read, what the file says beside it, and what is not read."""
    yield (
        "read as public programs write .rtl, not from Renishaw's own description: compare the "
        f"first value, {runs[0][0]:g} µm at {targets[0]:g} mm, with the instrument's own screen"
    )
    facts = [
        f"{name} {entry.text!r}"
        for name in ("Machine", "Serial No", "Date", "Axis")
        if (entry := rtl_file.entry("USER-TEXT", name)) and entry.text
    ]
    if facts:
        yield f"the file says {', '.join(facts)}; its time has no zone and is not read"
    others = [f"{name}::" for name in rtl_file.sections if name not in _READ]
    if others:
        yield f"not read: {list_names(others)}"

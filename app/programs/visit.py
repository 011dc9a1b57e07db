"""The visit of a planned verification: its observations in order of time, approached as stated.

Planning takes the same observations (`app.identification.plan`): what it could see is measured by
the program that is written here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from app.csv_text import csv_line, no_formula
from app.effects.observations import Observation, Verification
from app.errors import InvalidContent, counted, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.programs.path import Manner, Path, Place, expect_whole, middle_of, own_place
from app.programs.program import MeasuringProgram, Readings
from app.thermal.machine import Machine
from app.units import SECONDS_PER_MIN, Unit, date_text, iso_time

MOST_OBSERVATIONS: Final = 20_000

LONG_PAUSE_S: Final = 7200.0
"""In a longer pause people go home [s]: the program asks before it goes on."""

_ANGLES: Final = (Unit.URAD, Unit.UM_PER_M)
"""Filled into the column of angles: a µm/m is a µrad."""


@dataclass(frozen=True, slots=True)
class Halt:
    """One place where the machine stands still, and all that is read there at once.

    Parameters
    ----------
    ways
        Axis to the direction of its approach, +1 or −1; an axis whose direction nobody
        stated is not in it.
    line
        The axis along which an instrument measures; empty at a point.
    """

    place_mm: Place
    ways: Mapping[str, int]
    line: str
    time_s: float
    setup: str | None
    tool_mm: tuple[float, float, float]
    observations: list[Observation] = field(default_factory=list)

    def takes(self, other: Halt) -> bool:
        """Whether another observation can be read at the same halt."""
        read = {observation.component for observation in self.observations}
        return (
            self.place_mm == other.place_mm
            and self.ways == other.ways
            and self.same_set_up(other)
            and not read & {observation.component for observation in other.observations}
        )

    def same_set_up(self, other: Halt) -> bool:
        """Whether the instrument stays as it is."""
        return (self.line, self.setup, self.tool_mm) == (other.line, other.setup, other.tool_mm)

    @property
    def names(self) -> list[str]:
        """What is read: components' codes, or the point's error."""
        return [observation.component or "error at the point" for observation in self.observations]


def visit_program(
    machine: Machine,
    manner: Manner,
    planned: Verification,
    *,
    line_mm: Place | None = None,
) -> MeasuringProgram:
    """Write the program of planned observations.

    Parameters
    ----------
    planned
        Its values are not looked at.
    line_mm
        Axis to where the measuring lines of components lie; the middle of the travel where
        not stated [mm].

    Returns
    -------
    MeasuringProgram
        Its readings are the same verification, to be filled in.

    Raises
    ------
    InvalidContent
        If nothing has a position, or one lies outside the travel.
    """
    if len(planned.observations) > MOST_OBSERVATIONS:
        raise InvalidContent.of_field(
            "observations",
            f"expected at most {MOST_OBSERVATIONS}, got {len(planned.observations)}",
        )
    ordered = sorted(planned.observations, key=lambda observation: observation.time_s)
    halts = list(_halts(machine, ordered, line_mm or {}))
    if not halts:
        raise InvalidContent.of_field(
            "observations", "expected observations with a position, got none"
        )
    path = Path(machine, manner)
    late_s = _walk(path, halts)
    elsewhere = sorted({str(o.component) for o in ordered if _is_elsewhere(o)})
    notes = []
    if elsewhere:
        notes.append(
            f"{list_names(elsewhere)}: no position, so the program does not go there; measure "
            "it otherwise, or delete its lines"
        )
    if late_s > SECONDS_PER_MIN:
        notes.append(
            f"the program falls {late_s / SECONDS_PER_MIN:.0f} min behind the planned times, rapid "
            "moves and stops not counted: write the clock's times into the file"
        )
    return MeasuringProgram(
        name="VISIT",
        number=7031,
        title=f"visit {planned.label}",
        machine=machine.id,
        head=(
            f"{counted(len(ordered), 'observation')} at {counted(len(halts), 'halt')}, from "
            f"{date_text(ordered[0].time_s)} to {date_text(ordered[-1].time_s)}",
            f"zero of the instrument: {planned.datum}",
            *manner.sentences(),
            "a stated direction is approached from the overrun on its other side",
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
            *notes,
        ),
        blocks=tuple(path.blocks),
        readings=Readings(
            _readings_file(machine, planned, ordered),
            f"thermap analyse {machine.id} --verification FILE",
        ),
        seconds=path.seconds,
        notes=tuple(notes),
    )


def _is_elsewhere(observation: Observation) -> bool:
    return observation.point_mm is None and not _axis_of(observation)


def _axis_of(observation: Observation) -> str:
    """Name the axis that moves to an observation of a component; empty where none does."""
    axis = COMPONENTS[observation.component].axis if observation.component else None
    moves = axis is not None and axis in LINEAR_LETTERS and observation.position_mm is not None
    return str(axis) if moves else ""


def _halts(machine: Machine, ordered: Sequence[Observation], line: Place) -> Iterator[Halt]:
    """Gather what is read at one place at once."""
    last: Halt | None = None
    for number, observation in enumerate(ordered):
        if _is_elsewhere(observation):
            continue
        halt = _halt(machine, number, observation, line)
        if last is not None and last.takes(halt):
            last.observations.append(observation)
            continue
        if last is not None:
            yield last
        last = halt
    if last is not None:
        yield last


def _halt(machine: Machine, number: int, observation: Observation, line: Place) -> Halt:
    where = f"observations.{number}"
    if observation.point_mm is not None:
        place = own_place(machine, observation.point_mm)
        axis = ""
    else:
        axis = _axis_of(observation)
        others = {a: mm for a, mm in line.items() if a != axis}
        place = middle_of(machine, others, but=axis) | {axis: float(observation.position_mm or 0.0)}
    place = {a: expect_whole(f"{where}.{a}", mm) for a, mm in place.items()}
    ways = {
        a: way
        for a, way in zip(LINEAR_LETTERS, observation.directions, strict=True)
        if way and (a == axis or (not axis and a in place))
    }
    return Halt(
        place,
        ways,
        axis,
        observation.time_s,
        observation.setup,
        observation.tool_offset_mm,
        [observation],
    )


def _walk(path: Path, halts: Sequence[Halt]) -> float:
    """Go from halt to halt; say by how many seconds the program falls behind its plan."""
    last: Halt | None = None
    begun_s = late_s = 0.0
    for halt in halts:
        pauses = last is not None and halt.time_s - last.time_s > LONG_PAUSE_S
        if last is None or pauses or not last.same_set_up(halt):
            _arrive(path, halt, None)
            path.stop(_why(halt))
            begun_s, last = halt.time_s - path.seconds, halt
        due_s = begun_s + path.seconds
        if halt.time_s - due_s >= 1.0:
            path.dwell(math.floor(halt.time_s - due_s))
        late_s = max(late_s, due_s - halt.time_s)
        _arrive(path, halt, last)
        path.remark(f"{date_text(halt.time_s)} {', '.join(halt.names)}")
        path.read()
        last = halt
    path.retract()
    return late_s


def _why(halt: Halt) -> str:
    along = f" along {halt.line.upper()}" if halt.line else ""
    tool = "" if not any(halt.tool_mm) else f", tool offset {list_names(map(str, halt.tool_mm))} mm"
    setup = f", set-up {halt.setup}" if halt.setup else ""
    return (
        f"planned for {date_text(halt.time_s)}: set up the instrument{along}{setup}{tool}, "
        f"for {list_names(dict.fromkeys(halt.names))}"
    )


def _arrive(path: Path, halt: Halt, last: Halt | None) -> None:
    """Come to a halt in its directions; along a line, or at the same point, without crossing."""
    overrun = path.manner.overrun_mm
    before = {a: mm - halt.ways.get(a, 0) * overrun for a, mm in halt.place_mm.items()}
    is_near = last is not None and (
        last.place_mm == halt.place_mm or bool(halt.line and last.line == halt.line)
    )
    if not is_near:
        path.arrive(before)
    elif not _comes_right(path, halt):
        path.go(before)
    path.go(halt.place_mm)


def _comes_right(path: Path, halt: Halt) -> bool:
    """Whether the straight way there is already an approach as stated."""
    return all(
        way * (halt.place_mm[axis] - path.at_mm[axis]) >= path.manner.overrun_mm
        for axis, way in halt.ways.items()
    )


def _readings_file(machine: Machine, planned: Verification, ordered: Sequence[Observation]) -> str:
    states = sorted({name for observation in ordered for name in observation.state})
    has_points = any(observation.point_mm is not None for observation in ordered)
    has_components = any(observation.component for observation in ordered)
    columns = ["time"]
    if has_components:
        columns += ["component", "position_mm", "direction", "measured_um", "measured_urad"]
    if has_points:
        for stem in ("point_{}_mm", "tool_{}_mm", "direction_{}", "measured_{}_um"):
            columns += [stem.format(axis) for axis in LINEAR_LETTERS]
    if any(observation.setup for observation in ordered):
        columns.append("setup")
    columns += [f"state {name}" for name in states]
    lines = [
        "# Fill in what was measured, actual less nominal, and the times when it was, in UTC",
        f"# label: {planned.label}",
        f"# machine: {machine.id}",
        f"# datum: {planned.datum}",
    ]
    if planned.repeatability_um is not None:
        lines.append(f"# repeatability_um: {planned.repeatability_um!r}")
    if has_components and any(_is_angle(observation) for observation in ordered):
        lines.append("# Lengths go into measured_um, angles and squareness into measured_urad")
    lines = [f"{no_formula(line)}\n" for line in lines]
    lines.append(csv_line(columns))
    for observation in ordered:
        cells = _cells(observation)
        lines.append(csv_line(cells.get(name, "") for name in columns))
    return "".join(lines)


def _is_angle(observation: Observation) -> bool:
    return observation.component is not None and COMPONENTS[observation.component].unit in _ANGLES


def _cells(observation: Observation) -> dict[str, str]:
    """Write what is known of an observation before it is measured."""
    signs = {1: "+", -1: "-", 0: ""}
    cells = {"time": iso_time(observation.time_s), "setup": observation.setup or ""}
    cells |= {f"state {name}": repr(value) for name, value in observation.state.items()}
    if observation.point_mm is not None:
        for i, axis in enumerate(LINEAR_LETTERS):
            cells[f"point_{axis}_mm"] = repr(observation.point_mm[i])
            cells[f"tool_{axis}_mm"] = repr(observation.tool_offset_mm[i])
            cells[f"direction_{axis}"] = signs[observation.directions[i]]
        return cells
    cells["component"] = str(observation.component)
    cells["position_mm"] = "" if observation.position_mm is None else repr(observation.position_mm)
    axis = _axis_of(observation)
    if axis:
        cells["direction"] = signs[observation.directions[LINEAR_LETTERS.index(axis)]]
    return cells

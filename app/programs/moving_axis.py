"""Warming up by a moving axis, after ISO 230-3: back and forth at a feed, stopped to be measured.

Ball screw, nut and drive of the axis grow warm. Where the axis stands is read at target positions
in both directions: cold, again and again between stretches of motion, and while it cools down.

References
----------
ISO 230-3:2020, *Test code for machine tools — Determination of thermal effects*: the test of the
distortion that a moving linear axis causes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from app.errors import InvalidContent, counted
from app.geometry.components import LINEAR_LETTERS
from app.programs.path import (
    FASTEST_MM_PER_MIN,
    Manner,
    Path,
    Place,
    expect_whole,
    middle_of,
    place_words,
    travel_of,
    whole_step,
)
from app.programs.pauses import (
    LONGEST_MIN,
    TIME_COLUMNS,
    expect_few_returns,
    pauses_s,
    time_cells,
)
from app.programs.positioning import expect_targets
from app.programs.program import MeasuringProgram, Readings
from app.thermal.machine import Machine
from app.units import SECONDS_PER_MIN

MOST_STROKES: Final = 50_000
"""Each is a block: a program of some megabytes, which is as much as controllers hold."""


@dataclass(frozen=True, slots=True)
class MotionStep:
    """The axis moves back and forth at a feed for a time; at 0 it stands and cools down."""

    feed_mm_per_min: float
    minutes: float


@dataclass(frozen=True, slots=True)
class AxisReading:
    """One reading: when after the start, at which target, in which direction, at which step."""

    seconds: float
    target_mm: float
    way: str
    feed_mm_per_min: float


def moving_axis_program(
    machine: Machine,
    manner: Manner,
    axis: str,
    steps: Sequence[MotionStep],
    *,
    between_mm: tuple[float | None, float | None] = (None, None),
    targets_mm: Sequence[float] | None = None,
    every_min: float = 5.0,
    line_mm: Place | None = None,
    start_s: float | None = None,
) -> MeasuringProgram:
    """Write stretches of motion along an axis, with its targets read between them.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    steps
        In order; a last one at 0 is the cooling.
    between_mm
        Lowest and highest position of the motion [mm]; the travel less the overrun where None.
    targets_mm
        Where the axis is read [mm], strictly increasing; the ends of the motion and its middle
        where not stated.
    every_min
        Time between readings [min]; each step is read that often, and at its end.
    line_mm
        Positions of the other axes; the middle of their travel where not stated [mm].
    start_s
        When the program is to start, for the times in the readings' file: seconds since
        1970-01-01 UTC.

    Returns
    -------
    MeasuringProgram
        Its readings are a verification of the axis' displacement, zeroed at the first.

    Raises
    ------
    InvalidContent
        If a position lies outside the travel, targets are too close for the instrument, or a
        number cannot be right.
    """
    low, high = _stretch(machine, manner, axis, between_mm)
    targets = _targets(low, high, targets_mm, manner)
    _check(steps, every_min, high - low)
    line = middle_of(machine, line_mm or {}, but=axis)
    walk = _Walk(Path(machine, manner), axis, targets, low, high)
    walk.begin(line)
    for step in steps:
        walk.step(step, every_min)
    path = walk.path
    path.retract()
    name = axis.upper()
    course = ", ".join(f"{s.feed_mm_per_min:g} mm/min for {s.minutes:g} min" for s in steps)
    return MeasuringProgram(
        name=f"MOVE{name}",
        number=7022 + LINEAR_LETTERS.index(axis),
        title=f"warming up by moving {name}, by ISO 230-3",
        machine=machine.id,
        head=(
            f"motion between {name} {low:g} and {high:g} mm: {course}",
            f"{counted(walk.strokes, 'stroke')}, each a block; "
            f"{counted(len(targets), 'target')} read in both directions, every {every_min:g} min "
            "and at the end of each step",
            f"line: {place_words(line)}",
            *manner.sentences(),
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
            "times in the readings file are planned ones without rapid moves, acceleration and "
            "stops: write the clock's",
        ),
        blocks=tuple(path.blocks),
        readings=_verification_file(machine, axis, walk.readings, start_s),
        seconds=path.seconds,
    )


def _stretch(
    machine: Machine, manner: Manner, axis: str, between_mm: tuple[float | None, float | None]
) -> tuple[float, float]:
    travel = travel_of(machine, axis)
    stated_low, stated_high = between_mm
    low = (
        # The lower end has to be rounded up, inwards, and `whole_step` rounds down.
        -whole_step(-travel.min_mm - manner.overrun_mm)
        if stated_low is None
        else expect_whole("from", stated_low)
    )
    high = (
        whole_step(travel.max_mm - manner.overrun_mm)
        if stated_high is None
        else expect_whole("to", stated_high)
    )
    if not low < high:
        raise InvalidContent.of_field(
            "from", f"expected a motion from a lower to a higher position, got {low:g} to {high:g}"
        )
    return low, high


def _targets(
    low: float, high: float, stated_mm: Sequence[float] | None, manner: Manner
) -> list[float]:
    if stated_mm is None:
        return expect_targets([low, whole_step((low + high) / 2), high], manner)
    targets = expect_targets(stated_mm, manner)
    if targets[0] < low or targets[-1] > high:
        raise InvalidContent.of_field(
            "targets",
            f"expected targets where the axis moves, {low:g} to {high:g} mm, got {targets[0]:g} to "
            f"{targets[-1]:g} mm",
        )
    return targets


def _check(steps: Sequence[MotionStep], every_min: float, length_mm: float) -> None:
    if not any(step.feed_mm_per_min > 0 for step in steps):
        raise InvalidContent.of_field("steps", "expected at least one step of motion, got none")
    for step in steps:
        is_feed = 0.0 <= step.feed_mm_per_min <= FASTEST_MM_PER_MIN
        if not (is_feed and 0.0 < step.minutes <= LONGEST_MIN):
            raise InvalidContent.of_field(
                "steps",
                f"expected a feed of 0 to {FASTEST_MM_PER_MIN:g} mm/min for above 0 to "
                f"{LONGEST_MIN:g} min, got {step.feed_mm_per_min:g} mm/min for "
                f"{step.minutes:g} min",
            )
    expect_few_returns([step.minutes for step in steps], every_min)
    strokes = sum(step.feed_mm_per_min * step.minutes for step in steps) / length_mm
    if strokes > MOST_STROKES:
        raise InvalidContent.of_field(
            "steps",
            f"expected at most {MOST_STROKES:,} strokes of {length_mm:g} mm, each of which is a "
            f"block of the program, got {strokes:,.0f}: move less far, or not so long",
        )


class _Walk:
    """The axis between its motion and its targets."""

    def __init__(
        self, path: Path, axis: str, targets: Sequence[float], low: float, high: float
    ) -> None:
        self.path, self.axis, self.targets = path, axis, targets
        self.low, self.high = low, high
        self.readings: list[AxisReading] = []
        self.strokes = 0

    def begin(self, line: Place) -> None:
        """Stand at the first target for the operator, then read all targets cold."""
        name = self.axis.upper()
        below = self.targets[0] - self.path.manner.overrun_mm
        self.path.spindle(0.0)
        self.path.arrive({**line, self.axis: below})
        self.path.go({self.axis: self.targets[0]})
        self.path.stop(
            f"align the instrument along {name}; it stands at {name} {self.targets[0]:g}: zero it. "
            f"{name} is going to move back and forth by itself"
        )
        self._read_all(0.0)

    def step(self, step: MotionStep, every_min: float) -> None:
        """Move or stand, and stop to read, until the step is over."""
        moves = step.feed_mm_per_min > 0
        phase = f"{step.feed_mm_per_min:g} mm/min" if moves else "cooling"
        self.path.remark(f"{phase}, {step.minutes:g} min")
        for pause_s in pauses_s(step.minutes, every_min):
            if moves:
                self._stroke(step.feed_mm_per_min, pause_s)
            else:
                self.path.dwell(pause_s)
            self._read_all(step.feed_mm_per_min)

    def _stroke(self, feed_mm_per_min: float, seconds: float) -> None:
        """Go back and forth for about a time: in whole strokes there and back."""
        length_mm = self.high - self.low
        pairs = round(seconds / SECONDS_PER_MIN * feed_mm_per_min / (2 * length_mm))
        for end in (self.high, self.low) * max(1, pairs):
            self.path.go({self.axis: end}, feed_mm_per_min)
            self.strokes += 1

    def _read_all(self, feed_mm_per_min: float) -> None:
        """Read each target on the way up, then on the way down."""
        overrun = self.path.manner.overrun_mm
        up, down = self.targets, self.targets[::-1]
        for way, targets, before in (("+", up, up[0] - overrun), ("-", down, down[0] + overrun)):
            self.path.go({self.axis: before})
            for target in targets:
                self.path.go({self.axis: target})
                self.path.read()
                self.readings.append(AxisReading(self.path.seconds, target, way, feed_mm_per_min))


def _verification_file(
    machine: Machine, axis: str, readings: Sequence[AxisReading], start_s: float | None
) -> Readings:
    code = f"E{axis}{axis}".upper()
    lines = [
        "# Fill in the times and what was measured of every line, actual less nominal",
        "# The state feed_mm_per_min is the feed of the step, also where it stands to be read",
        "# label: moving axis",
        f"# machine: {machine.id}",
        "# datum: first",
        f"{TIME_COLUMNS},component,position_mm,direction,measured_um,state feed_mm_per_min",
    ]
    for reading in readings:
        cells = f"{code},{reading.target_mm!r},{reading.way},,{reading.feed_mm_per_min:g}"
        lines.append(f"{time_cells(reading.seconds, start_s)},{cells}")
    command = f"thermap analyse {machine.id} --verification FILE"
    return Readings("".join(f"{line}\n" for line in lines), command)

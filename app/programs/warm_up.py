"""Warming up and cooling down by ISO 230-3: spindle steps, and returns to the measuring positions.

The displacement of the spindle's nose is read cold, again and again between stretches in which the
spindle turns, and while the machine cools down: by a nest of sensors, or at several places.

References
----------
ISO 230-3:2020, *Test code for machine tools — Determination of thermal effects*: the test of the
distortion that the rotating spindle causes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from app.errors import InvalidContent, counted
from app.geometry.components import LINEAR_LETTERS
from app.programs.path import FASTEST_RPM, Manner, Path, expect_whole, own_place
from app.programs.pauses import (
    LONGEST_MIN,
    TIME_COLUMNS,
    expect_few_returns,
    pauses_s,
    planned_time,
    time_cells,
)
from app.programs.program import MeasuringProgram, Readings
from app.thermal.machine import Machine

FARTHEST_SENSOR_MM: Final = 10_000.0


@dataclass(frozen=True, slots=True)
class SpindleStep:
    """The spindle turns at a speed for a time; at 0 the machine cools down."""

    speed_rpm: float
    minutes: float


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading that the program makes: when after its start, where, at which spindle step."""

    seconds: float
    place_mm: tuple[float, float, float]
    speed_rpm: float


def warm_up_program(
    machine: Machine,
    manner: Manner,
    steps: Sequence[SpindleStep],
    places_mm: Sequence[Sequence[float]],
    *,
    every_min: float = 5.0,
    spin_down_s: float = 15.0,
    in_place: bool = False,
    sensor_distance_mm: float | None = None,
    start_s: float | None = None,
) -> MeasuringProgram:
    """Write spindle steps with returns to the measuring positions between them.

    Parameters
    ----------
    steps
        In order; a last one at 0 is the cooling.
    places_mm
        Measuring positions x, y, z [mm].
    every_min
        Pause between readings [min]; each step is read that often, and at its end.
    spin_down_s
        What the spindle needs to stand, before it goes down to a measuring position [s].
    in_place
        Whether the machine stays at its one measuring position and is read while the spindle
        turns: for sensors without contact. Otherwise the spindle turns retracted above it.
    sensor_distance_mm
        How much further along z a second pair of sensors reads x and y, for the tilts; None
        where there is none [mm].
    start_s
        When the program is to start, for the times in the readings' file: seconds since
        1970-01-01 UTC.

    Returns
    -------
    MeasuringProgram
        Its readings are those of `thermap import --method thermal-drift`; at several places
        a verification at points, zeroed at the first.

    Raises
    ------
    InvalidContent
        If a position lies outside the travel, or a number cannot be right.
    """
    _check(steps, places_mm, every_min, spin_down_s, in_place)
    _check_sensors(places_mm, sensor_distance_mm)
    places = [
        tuple(expect_whole(f"place.{a}", mm) for a, mm in zip(LINEAR_LETTERS, place, strict=True))
        for place in places_mm
    ]
    walk = _Walk(Path(machine, manner), places, spin_down_s, in_place)
    walk.begin()
    for step in steps:
        walk.step(step, every_min)
    walk.spindle(0.0)
    walk.path.retract()
    path = walk.path
    course = ", ".join(f"{s.speed_rpm:g} 1/min for {s.minutes:g} min" for s in steps)
    turning = "at the measuring position, while it is read" if in_place else "retracted, above"
    return MeasuringProgram(
        name="WARMUP",
        number=7021,
        title="warming up and cooling down by ISO 230-3",
        machine=machine.id,
        head=(
            f"spindle steps: {course}; {counted(len(walk.readings), 'reading')}, "
            f"{every_min:g} min apart and at the end of each step",
            f"{counted(len(places), 'measuring position')}; the spindle turns {turning}",
            *([] if in_place else [f"spindle stopped {spin_down_s:g} s before it goes down"]),
            *manner.sentences(),
            path.order_of_axes(),
            f"travel used: {path.travel_used()}",
            "times in the readings file are planned ones without rapid moves and stops: write "
            "the clock's",
        ),
        blocks=tuple(path.blocks),
        readings=(
            _drift_file(machine, walk, start_s, sensor_distance_mm)
            if len(places) == 1
            else _verification_file(machine, walk.readings, start_s)
        ),
        seconds=path.seconds,
    )


def _check(
    steps: Sequence[SpindleStep],
    places_mm: Sequence[Sequence[float]],
    every_min: float,
    spin_down_s: float,
    in_place: bool,
) -> None:
    if not steps or not places_mm:
        raise InvalidContent.of_field(
            "steps", "expected at least one spindle step and one measuring position, got none"
        )
    for place in places_mm:
        if len(place) != len(LINEAR_LETTERS):
            raise InvalidContent.of_field(
                "places", f"expected x, y and z in mm of each place, got {list(place)}"
            )
    if in_place and len(places_mm) > 1:
        raise InvalidContent.of_field(
            "places", f"expected one place where the machine stays there, got {len(places_mm)}"
        )
    for step in steps:
        is_speed = 0.0 <= step.speed_rpm <= FASTEST_RPM and step.speed_rpm % 1.0 == 0.0
        if not (is_speed and 0.0 < step.minutes <= LONGEST_MIN):
            raise InvalidContent.of_field(
                "steps",
                f"expected a whole speed of 0 to {FASTEST_RPM:g} 1/min for above 0 to "
                f"{LONGEST_MIN:g} min, got {step.speed_rpm:g} 1/min for {step.minutes:g} min",
            )
    expect_few_returns([step.minutes for step in steps], every_min)
    if not 0.0 < spin_down_s <= LONGEST_MIN:
        raise InvalidContent.of_field(
            "spin_down", f"expected a spin-down above 0 s, got {spin_down_s:g} s"
        )


def _check_sensors(places_mm: Sequence[Sequence[float]], sensor_distance_mm: float | None) -> None:
    if sensor_distance_mm is None:
        return
    if not 0.0 < sensor_distance_mm <= FARTHEST_SENSOR_MM or len(places_mm) > 1:
        raise InvalidContent.of_field(
            "sensor_distance",
            f"expected above 0 and at most {FARTHEST_SENSOR_MM:g} mm, at one measuring position, "
            f"got {sensor_distance_mm:g} mm at {counted(len(places_mm), 'position')}",
        )


class _Walk:
    """The machine between its measuring positions and the place where the spindle turns."""

    def __init__(
        self,
        path: Path,
        places: Sequence[tuple[float, ...]],
        spin_down_s: float,
        in_place: bool,
    ) -> None:
        self.path = path
        self.places = places
        self.spin_down_s = spin_down_s
        self.in_place = in_place
        self.readings: list[Reading] = []
        self.running_s: tuple[float, float] | None = None

    def spindle(self, speed_rpm: float) -> None:
        """Turn the spindle, or stop it with 0; note from its first start to its last stop [s]."""
        now_s = self.path.seconds
        if self.running_s is None:
            self.running_s = (now_s, now_s) if speed_rpm else None
        # Only a command that meets it turning moves the end: cooling down does not belong to
        # running.
        elif self.path.speed_rpm:
            self.running_s = (self.running_s[0], now_s)
        self.path.spindle(speed_rpm)

    def begin(self) -> None:
        """Stand at the first position for the operator, then read everything cold."""
        self.path.spindle(0.0)
        self.path.arrive(self._at(self.places[0]))
        turns = "; the spindle is going to turn here" if self.in_place else ""
        self.path.stop(f"set up the sensors at the measuring position, and zero them here{turns}")
        self._read_all(0.0)

    def step(self, step: SpindleStep, every_min: float) -> None:
        """Turn, and come back to read, until the step is over."""
        turns = step.speed_rpm > 0
        phase = f"{step.speed_rpm:g} 1/min" if turns else "cooling"
        self.path.remark(f"{phase}, {step.minutes:g} min")
        for pause_s in pauses_s(step.minutes, every_min):
            if not self.in_place:
                self.path.retract()
            if turns or self.in_place:
                self.spindle(step.speed_rpm)
            self.path.dwell(pause_s)
            if turns and not self.in_place:
                self.spindle(0.0)
                self.path.dwell(self.spin_down_s)
            self._read_all(step.speed_rpm)

    def _at(self, place: Sequence[float]) -> dict[str, float]:
        return own_place(self.path.machine, place)

    def _read_all(self, speed_rpm: float) -> None:
        for place in self.places:
            self.path.arrive(self._at(place))
            self.path.read()
            x, y, z = place
            self.readings.append(Reading(self.path.seconds, (x, y, z), speed_rpm))


_SPEEDS: Final = "# The state spindle_rpm is the speed of the step, also where it stands to be read"


def _drift_file(
    machine: Machine, walk: _Walk, start_s: float | None, sensor_distance_mm: float | None
) -> Readings:
    readings = walk.readings
    sensors = ["x_um", "y_um", "z_um"]
    sensors += [] if sensor_distance_mm is None else ["x2_um", "y2_um"]
    lines = [
        "# Fill in the times, displacements and temperatures of every line",
        _SPEEDS,
        "# label: ",
        f"# machine: {machine.id}",
        f"# test: {'spindle' if walk.running_s else 'environment'}",
        f"# point_mm: {', '.join(repr(mm) for mm in readings[0].place_mm)}",
    ]
    if walk.running_s:
        # The first reading with a speed is late by a pause: the growth until then counts too.
        since_s, until_s = walk.running_s
        lines.append(f"# running_from: {planned_time(since_s, start_s)}")
        lines.append(f"# running_to: {planned_time(until_s, start_s)}")
    if sensor_distance_mm is not None:
        lines.append(f"# sensor_distance_mm: {sensor_distance_mm!r}")
    columns = [TIME_COLUMNS, *sensors, *(f"temperature {name}" for name in machine.sensors)]
    lines.append(",".join([*columns, "state spindle_rpm"]))
    empty = "," * (len(columns) - 1)
    lines += [
        f"{time_cells(reading.seconds, start_s)}{empty},{reading.speed_rpm:g}"
        for reading in readings
    ]
    command = f"thermap import --method thermal-drift FILE --machine {machine.id}"
    return Readings("".join(f"{line}\n" for line in lines), command)


def _verification_file(
    machine: Machine, readings: Sequence[Reading], start_s: float | None
) -> Readings:
    lines = [
        "# Fill in the times and the displacements of every line",
        _SPEEDS,
        "# label: warm-up",
        f"# machine: {machine.id}",
        "# datum: first",
        f"{TIME_COLUMNS},point_x_mm,point_y_mm,point_z_mm,"
        "measured_x_um,measured_y_um,measured_z_um,state spindle_rpm",
    ]
    for reading in readings:
        place = ",".join(repr(mm) for mm in reading.place_mm)
        lines.append(f"{time_cells(reading.seconds, start_s)},{place},,,,{reading.speed_rpm:g}")
    command = f"thermap analyse {machine.id} --verification FILE"
    return Readings("".join(f"{line}\n" for line in lines), command)

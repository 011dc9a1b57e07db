"""The way of a machine through a measurement: inside its travel, retracted where it crosses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from app.errors import InvalidContent, list_names
from app.geometry.components import LINEAR_LETTERS
from app.programs.program import Block, Dwell, Move, Remark, Spindle, Stop
from app.thermal.machine import Machine, Travel
from app.units import SECONDS_PER_MIN

DECIMALS: Final = 3
"""Of positions in mm: every controller's least input increment takes them as they are."""

FASTEST_MM_PER_MIN: Final = 99_999.0
"""Heidenhain takes five digits before the point."""

LONGEST_DWELL_S: Final = 86_400.0
FARTHEST_OVERRUN_MM: Final = 1000.0
FASTEST_RPM: Final = 99_999.0

Place = Mapping[str, float]
"""Axis to position [mm]."""


@dataclass(frozen=True, slots=True)
class Manner:
    """How the machine is moved, and what the instrument needs.

    Parameters
    ----------
    feed_mm_per_min
        Of all moves but those that cross, which are rapid.
    dwell_s
        At each position that is read [s].
    reading_s
        Time at rest that the instrument needs to settle and to average [s].
    overrun_mm
        How far behind a position its approach begins, and turns [mm].
    window_mm
        Tolerance of an instrument that triggers itself near a target [mm].
    retract_mm
        Axis to the position at which it is out of the way [mm]; in this order. None: z at
        its highest position.

    Raises
    ------
    InvalidContent
        If a number cannot be right, or the dwell is too short for the instrument.
    """

    feed_mm_per_min: float = 1000.0
    dwell_s: float = 4.0
    reading_s: float = 2.0
    overrun_mm: float = 5.0
    window_mm: float = 0.5
    retract_mm: Place | None = None

    def __post_init__(self) -> None:
        _expect("feed", self.feed_mm_per_min, "mm/min", FASTEST_MM_PER_MIN)
        _expect("dwell", self.dwell_s, "s", LONGEST_DWELL_S)
        _expect("reading time", self.reading_s, "s", LONGEST_DWELL_S)
        _expect("overrun", self.overrun_mm, "mm", FARTHEST_OVERRUN_MM)
        _expect("window", self.window_mm, "mm", FARTHEST_OVERRUN_MM)
        if self.dwell_s <= self.reading_s:
            raise InvalidContent.of_field(
                "dwell",
                f"expected a dwell longer than the {self.reading_s:g} s that the instrument needs "
                f"at rest, got {self.dwell_s:g} s",
            )
        # Behind the overrun the instrument has to see that the target was left.
        if self.overrun_mm <= 2 * self.window_mm:
            raise InvalidContent.of_field(
                "overrun",
                f"expected more than twice the trigger window of {self.window_mm:g} mm, "
                f"got {self.overrun_mm:g} mm",
            )

    def sentences(self) -> tuple[str, ...]:
        """Say it in the head of a program."""
        return (
            f"feed {self.feed_mm_per_min:g} mm/min, dwell {self.dwell_s:g} s at each reading, "
            f"overrun {self.overrun_mm:g} mm",
            f"the instrument has {self.dwell_s:g} s at rest and needs {self.reading_s:g} s; "
            f"if it triggers itself, with a window of {self.window_mm:g} mm",
        )

    def expect_apart(self, distance_mm: float, what: str) -> None:
        """Refuse positions so close that an instrument could take one for the other.

        Parameters
        ----------
        distance_mm
            The smallest from one reading to the next [mm].

        Raises
        ------
        InvalidContent
            If it is not more than twice the trigger window.
        """
        if distance_mm <= 2 * self.window_mm:
            raise InvalidContent.of_field(
                "window",
                f"expected {what} more than twice the trigger window of {self.window_mm:g} mm "
                f"apart, got {distance_mm:g} mm",
            )


def _expect(field_name: str, value: float, unit: str, largest: float) -> None:
    if not (math.isfinite(value) and 0.0 < value <= largest):
        raise InvalidContent.of_field(
            field_name, f"expected above 0 and at most {largest:g} {unit}, got {value:g}"
        )


def travel_of(machine: Machine, axis: str) -> Travel:
    """Give an axis' stated travel.

    Raises
    ------
    InvalidContent
        If the machine has no such axis, or nobody stated its travel.
    """
    if axis not in machine.chain.axes:
        raise InvalidContent.of_field(
            "axis",
            f"expected an axis of {machine.chain.text} ({list_names(sorted(machine.chain.axes))}), "
            f"got {axis!r}",
        )
    if axis not in machine.axes:
        raise InvalidContent.of_field(
            f"axes.{axis}",
            f"expected the travel of {axis} in mm, as nothing is moved outside it; machine "
            f"{machine.id!r} states none",
        )
    return machine.axes[axis]


def expect_three_axes(machine: Machine) -> None:
    """Refuse a machine that lacks x, y or z, or the travel of one of them."""
    if len(machine.chain.axes) < len(LINEAR_LETTERS):
        raise InvalidContent.of_field(
            "configuration", f"expected a machine with axes x, y and z, got {machine.chain.text}"
        )
    own_place(machine, (0.0, 0.0, 0.0))


def own_place(machine: Machine, point_mm: Sequence[float]) -> dict[str, float]:
    """Say where the axes that a machine has stand at a point.

    Parameters
    ----------
    point_mm
        x, y and z [mm]; of an axis that there is not nothing is moved.

    Returns
    -------
    dict
        Axis to position [mm].

    Raises
    ------
    InvalidContent
        If nobody stated the travel of an axis.
    """
    place = dict(zip(LINEAR_LETTERS, point_mm, strict=True))
    on_axes = {axis: float(mm) for axis, mm in place.items() if axis in machine.chain.axes}
    for axis in on_axes:
        travel_of(machine, axis)
    return on_axes


def whole_step(length_mm: float) -> float:
    """Round a length down to what controllers take as it is.

    Examples
    --------
    >>> whole_step(185.7142857), whole_step(0.3)
    (185.714, 0.3)
    """
    increments = length_mm * 10**DECIMALS
    nearest = round(increments)
    # 1.001 × 1000 is 1000.9999999999999: rounded down it would lose a whole increment.
    whole = nearest if math.isclose(increments, nearest, rel_tol=1e-12) else math.floor(increments)
    return whole / 10**DECIMALS


def expect_whole(field_name: str, value_mm: float) -> float:
    """Refuse a position that would be rounded: its reading would be wrong by the rest.

    Returns
    -------
    float
        The position [mm].

    Raises
    ------
    InvalidContent
        If it has more decimals than controllers take.
    """
    rounded = round(value_mm, DECIMALS)
    if not math.isfinite(value_mm) or abs(rounded - value_mm) > 1e-7:
        raise InvalidContent.of_field(
            field_name,
            f"expected a whole number of {10**-DECIMALS:g} mm, as controllers take positions, "
            f"got {value_mm!r} mm",
        )
    return rounded + 0.0


@dataclass
class Path:
    """Writes down where a machine goes, checks that it may, and adds up how long it takes.

    Parameters
    ----------
    machine
        Its travel is not left.
    at_mm
        Axis to where it stands now [mm]; an axis that was not moved yet is not in it.
    """

    machine: Machine
    manner: Manner
    blocks: list[Block] = field(default_factory=list)
    at_mm: dict[str, float] = field(default_factory=dict)
    used_mm: dict[str, tuple[float, float]] = field(default_factory=dict)
    seconds: float = 0.0
    speed_rpm: float | None = None

    @property
    def retract_mm(self) -> Place:
        """Axis to the position at which it is out of the way, in order [mm]."""
        if self.manner.retract_mm is not None:
            return self.manner.retract_mm
        travel = self.machine.axes.get("z")
        return {} if travel is None else {"z": whole_step(travel.max_mm)}

    def order_of_axes(self) -> str:
        """Say how the path crosses the work volume."""
        if not self.retract_mm:
            return "no axis is retracted: see that the way is free"
        places = ", then ".join(f"{axis.upper()} to {mm:g}" for axis, mm in self.retract_mm.items())
        back = ", ".join(axis.upper() for axis in reversed(list(self.retract_mm)))
        return f"crossing: {places}, rapid; then the other axes, rapid; then {back} at feed"

    def travel_used(self) -> str:
        """Say where each axis went."""
        return "; ".join(
            f"{axis.upper()} {low:.{DECIMALS}f}"
            + (f" to {high:.{DECIMALS}f}" if high > low else "")
            for axis, (low, high) in sorted(self.used_mm.items())
        )

    def retract(self) -> None:
        """Move out of the way: one axis after the other."""
        for axis, mm in self.retract_mm.items():
            self._move({axis: mm}, None)

    def arrive(self, place_mm: Place) -> None:
        """Go to a place across the work volume: retract, cross, come down.

        Raises
        ------
        InvalidContent
            If it lies outside the travel.
        """
        # Without it a machine that stays in place would be retracted between its readings.
        if all(self.at_mm.get(axis) == round(mm, DECIMALS) for axis, mm in place_mm.items()):
            return
        self.retract()
        self._move({a: mm for a, mm in place_mm.items() if a not in self.retract_mm}, None)
        for axis in reversed(list(self.retract_mm)):
            if axis in place_mm:
                self.go({axis: place_mm[axis]})

    def go(self, place_mm: Place, feed_mm_per_min: float | None = None) -> None:
        """Go straight to a place at a feed.

        Parameters
        ----------
        feed_mm_per_min
            Another feed than that of the manner.

        Raises
        ------
        InvalidContent
            If it lies outside the travel.
        """
        self._move(place_mm, feed_mm_per_min or self.manner.feed_mm_per_min)

    def read(self) -> None:
        """Stand still for the instrument."""
        self.dwell(self.manner.dwell_s)

    def dwell(self, seconds: float) -> None:
        """Stand still."""
        self.blocks.append(Dwell(seconds))
        self.seconds += seconds

    def stop(self, why: str) -> None:
        """Let the operator do something, and go on when he says so."""
        self.blocks.append(Stop(why))

    def remark(self, text: str) -> None:
        """Write a comment."""
        self.blocks.append(Remark(text))

    def spindle(self, speed_rpm: float) -> None:
        """Turn the spindle, or stop it with 0.

        Raises
        ------
        InvalidContent
            If the speed cannot be right.
        """
        if not 0.0 <= speed_rpm <= FASTEST_RPM:
            raise InvalidContent.of_field(
                "spindle", f"expected 0 to {FASTEST_RPM:g} 1/min, got {speed_rpm:g}"
            )
        if speed_rpm != self.speed_rpm:
            self.blocks.append(Spindle(speed_rpm))
            self.speed_rpm = speed_rpm

    def _move(self, place_mm: Place, feed_mm_per_min: float | None) -> None:
        wanted = {axis: round(mm, DECIMALS) + 0.0 for axis, mm in place_mm.items()}
        to = {axis: mm for axis, mm in wanted.items() if self.at_mm.get(axis) != mm}
        if not to:
            return
        for axis, mm in to.items():
            self._expect_inside(axis, mm)
            low, high = self.used_mm.get(axis, (mm, mm))
            self.used_mm[axis] = (min(low, mm), max(high, mm))
        # Only the machine knows how long a rapid move takes, and nobody where an axis stood at
        # first: neither is counted.
        if feed_mm_per_min is not None and set(to) <= set(self.at_mm):
            length = math.dist([self.at_mm[a] for a in to], list(to.values()))
            self.seconds += length / feed_mm_per_min * SECONDS_PER_MIN
        self.blocks.append(Move(to, feed_mm_per_min))
        self.at_mm |= to

    def _expect_inside(self, axis: str, mm: float) -> None:
        travel = travel_of(self.machine, axis)
        if not travel.min_mm <= mm <= travel.max_mm:
            limit = travel.min_mm if mm < travel.min_mm else travel.max_mm
            raise InvalidContent.of_field(
                axis,
                f"expected positions within the travel of {travel.min_mm:g} to "
                f"{travel.max_mm:g} mm, got {axis.upper()} {mm:g} mm, "
                f"{abs(mm - limit):.{DECIMALS}f} mm beyond {limit:g} mm (approaches begin "
                f"{self.manner.overrun_mm:g} mm behind)",
            )


def middle_of(machine: Machine, place_mm: Place, but: str | None = None) -> dict[str, float]:
    """Say where the axes stand that a measurement does not move.

    Parameters
    ----------
    place_mm
        Axis to position, where it is stated [mm].
    but
        The axis that moves.

    Returns
    -------
    dict
        Axis to position [mm]: the middle of its travel where none is stated. An axis without
        a stated travel stays where it is.

    Raises
    ------
    InvalidContent
        If a position is stated of an axis that moves, or that there is not.
    """
    for axis in place_mm:
        travel_of(machine, axis)
        if axis == but:
            raise InvalidContent.of_field(
                "line", f"expected positions of the other axes, got one of {axis}, which moves"
            )
    middle = {
        axis: whole_step((travel.min_mm + travel.max_mm) / 2)
        for axis, travel in machine.axes.items()
        if axis != but
    }
    return middle | {axis: expect_whole(f"line.{axis}", mm) for axis, mm in place_mm.items()}


def place_words(place_mm: Place) -> str:
    """Write where axes stand for a person.

    >>> place_words({"y": 250.0, "x": 0.5}), place_words({})
    ('X 0.5 mm, Y 250 mm', 'as it stands')
    """
    return ", ".join(f"{a.upper()} {mm:g} mm" for a, mm in sorted(place_mm.items())) or (
        "as it stands"
    )

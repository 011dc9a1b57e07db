"""A visit that a person can make: in which state of the machine, how to get there, which points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal, TypeAlias

from app.answer import Answer

StateName: TypeAlias = Literal["cold", "part-warm", "warm", "while-warming", "while-cooling"]


@dataclass(frozen=True, slots=True)
class MachineState(Answer, published_as="MachineStateAnswer"):
    """A thermal state, as it is reached and recognised in the shop."""

    name: StateName
    """`cold`, `part-warm` or `warm`: the temperatures hardly change; `while-warming`,
    `while-cooling`: measured again and again while they do"""

    conditions: str
    """Temperatures and states by which it is recognised, rounded to what can be set"""

    target_c: Mapping[str, float]
    """The temperatures in it, of the sensors that matter, in whole or half kelvins [°C]"""

    reached: str
    """How to reach it"""

    wait: str
    """How long to wait before the first reading"""

    wait_min: float | None
    """The same [min]; null where it is not known"""

    rounds: int
    """How often the points are measured"""

    every_min: float | None
    """From the beginning of a round to the next [min]; null for one round"""


@dataclass(frozen=True, slots=True)
class PlannedPlace(Answer, published_as="PlannedPlaceAnswer"):
    """One observation to be made, in the form that planning takes."""

    time: str
    """Time, at a recorded moment with the wanted conditions, UTC"""

    component: str | None
    """Component code; null at a point"""

    position_mm: float | None
    """Position on its axis [mm]"""

    point_mm: tuple[float, float, float] | None
    """Nominal point x, y, z [mm]; null of a component"""

    tool_offset_mm: tuple[float, float, float]
    """Tool offset X, Y, Z [mm]"""

    direction: Mapping[str, Literal["+", "-"]] | None
    """Direction of approach of each axis"""


@dataclass(frozen=True, slots=True)
class PlannedVisit(Answer, published_as="PlannedVisitAnswer"):
    """A visit to be made, as one of the `planned` visits of a plan."""

    label: str
    """Its name in the plan"""

    datum: str
    """`absolute`, `first` or `free`, as in the visits before"""

    repeatability_um: float | None
    """Standard deviation of one length, where it is known [µm]"""

    observations: tuple[PlannedPlace, ...]
    """In the order of measurement"""


@dataclass(frozen=True, slots=True)
class NextVisit(Answer, published_as="NextVisitAnswer"):
    """A visit to make next."""

    sentence: str
    """All of it: state, how to reach it, how long to wait, which points, and what it decides"""

    state: MachineState
    """The state of the machine"""

    points: str
    """Which points, in words"""

    decides: str
    """What it decides"""

    like_time: datetime
    """When the machine was last recorded in such conditions, UTC"""

    temperatures_c: Mapping[str, float]
    """The sensors' temperatures at that time [°C]"""

    states: Mapping[str, float]
    """The machine's state at that time"""

    planned: PlannedVisit
    """What to send to planning"""

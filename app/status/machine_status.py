"""The shape of a machine's status: one verdict with its reasons, largest first."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Annotated, TypeAlias

from pydantic import Field

from app.answer import Answer, UnitSymbol
from app.geometry.components import Component
from app.thermal.sensor_health import Health


class Verdict(StrEnum):
    """What an operator may do with the machine."""

    TRUSTED = "trusted"
    LIMITED = "limited"
    NOT_TRUSTED = "not-trusted"


class State(StrEnum):
    """What a machine's table rests on, the worst first."""

    NO_MODEL = "no-model"
    NO_READING = "no-reading"
    SENSOR_FAULT = "sensor-fault"
    OUTSIDE_MAPS = "outside-maps"
    STALE = "stale"
    EXTRAPOLATED = "extrapolated"
    CLAMPED = "clamped"
    HELD = "held"
    EFFECT_MISSING = "effect-missing"
    INCOMPLETE = "incomplete"
    LATE = "late"
    DRIFTING = "drifting"
    CHECK_OFF = "check-off"
    EFFECT_NOT_ADOPTED = "effect-not-adopted"
    STAND_IN = "stand-in"
    FRESH = "fresh"

    @property
    def gravity(self) -> int:
        """Its place among all, 0 for the worst."""
        return list(State).index(self)

    @property
    def verdict(self) -> Verdict:
        """What it amounts to."""
        if self.gravity <= State.OUTSIDE_MAPS.gravity:
            return Verdict.NOT_TRUSTED
        return Verdict.TRUSTED if self.gravity >= State.STAND_IN.gravity else Verdict.LIMITED


Position: TypeAlias = Annotated[float | None, Field(examples=[400.0])]


@dataclass(frozen=True, slots=True)
class Largest(Answer, published_as="LargestValue"):
    """The largest of a component's values, with its sign and its place."""

    component: str
    """Code of the component"""
    value: float
    """Value with its sign, in `unit`"""
    unit: UnitSymbol
    """Unit of the value"""
    axis: str | None
    """Axis of the position, null for a component without positions"""
    position_mm: Position
    """Where it is [mm], null for a component without positions"""
    is_backward: bool = False
    """Whether it is that of the backward approach, where both directions have maps"""

    @classmethod
    def of(
        cls,
        component: Component,
        value: float,
        position_mm: float | None,
        *,
        is_backward: bool = False,
    ) -> Largest:
        """Describe a value of a component, to 0.1 nm or 0.1 nrad."""
        at = position_mm if component.is_table else None
        unit = component.unit.symbol
        return cls(component.code, round(value, 4) + 0.0, unit, component.axis, at, is_backward)

    @property
    def place(self) -> str:
        """Where it is, in words that follow its value: `at Z 400`; empty without a position."""
        if self.axis is None or self.position_mm is None:
            return ""
        place = f"{self.axis.upper()} {self.position_mm:g}"
        if self.is_backward:
            return f" at {place} backward"
        return f" at {place}"


@dataclass(frozen=True, slots=True)
class BeyondMaps(Answer):
    """Components that lie outside their maps."""

    sensor: str
    """Sensor whose temperature lies outside"""
    outside_k: float
    """By how much [K]: positive above the hottest map, negative below the coldest"""
    components: tuple[str, ...]
    """Codes of the components that follow it"""
    held_at: str | None
    """Label of the map at which they are held, null where they are extrapolated"""
    lacks: Largest | None
    """The largest that going on in a straight line through the two nearest maps would add to the
    compensation; null where they are extrapolated"""


@dataclass(frozen=True, slots=True)
class SensorNow(Answer):
    """A sensor now."""

    sensor: str
    """Sensor"""
    temperature_c: float | None
    """Its latest temperature [°C], null without any"""
    age_s: float | None
    """How old that is [s]"""
    interval_s: float | None
    """How far apart its readings usually are [s]; null where they do not come by the clock, or too
    few have come"""
    is_late: bool
    """Whether the next one should have come: after five usual intervals, not before 15 s, twice the
    longest of the latest intervals, or five of those at which its sender sends"""
    no_value_since: datetime | None
    """Since when its sender says that it has no value (null, UNAVAILABLE, a status that is not
    good); null where it does not, and from the next value on"""
    rate_k_per_h: float | None
    """How fast it changes now [K/h], over the last half hour or, where its course bends, the last
    minutes; null where that is not known"""
    health: Health
    """`ok`, `missing`, `stale`, `out-of-range`, `stuck`, `jump`, or `faulty`: an adopted effect
    says that it is"""
    detail: str
    """What is the matter, empty where nothing"""
    outside_maps_k: float | None
    """By how much it is outside the maps of the components that follow it [K]: 0 inside, negative
    below the coldest; null where none follows it"""
    maps_c: tuple[float, float] | None
    """Temperatures of the coldest and the hottest map between which all of these components are
    known [°C]"""
    assigned_to: tuple[str, ...]
    """Codes of the components that are assigned to it"""


@dataclass(frozen=True, slots=True)
class LastCheck(Answer):
    """By how much verifications of the active model were off, and what was expected.

    Of each component its latest visit counts; this is the one that was furthest from what was
    expected. What is null is not known: nothing tells the scatter of these measurements, or an
    earlier version of the service judged them.
    """

    time: datetime
    """When it was measured: its last observation"""
    text: str
    """The same in words"""
    component: str | None = None
    """Code of the component, or `points x`"""
    count: int | None = None
    """How many values of it"""
    off: float | None = None
    """Their root mean square, measured minus predicted; of one value its size, in `unit`"""
    scatter: float | None = None
    """Standard deviation of one observation, the maps' uncertainty included, in `unit`"""
    setup_scatter: float | None = None
    """Standard deviation that set-ups add, as earlier visits show it, in `unit`; 0 while there are
    too few"""
    at_most: float | None = None
    """What `off` was expected not to exceed, in `unit`: twice the scatter of a value, and more
    where few values of many components are looked at"""
    unit: UnitSymbol | None = None
    """Unit of these"""
    as_expected: bool | None = None
    """Whether it was off by no more than that"""

    @classmethod
    def unjudged(cls, time: datetime) -> LastCheck:
        """Describe one of which nobody knows what was to be expected."""
        return cls(time, "what was to be expected of it is not known")

    @classmethod
    def of(
        cls,
        time: datetime,
        component: str,
        count: int,
        sizes: tuple[float, float, float, float],
        unit: str,
    ) -> LastCheck:
        """Describe one that was judged.

        Parameters
        ----------
        sizes
            `off`, `scatter`, `setup_scatter` and `at_most` [`unit`].
        """
        off, scatter, setup_scatter, at_most = (round(size, 4) for size in sizes)
        found = (
            f"{_sized(off, unit)} off in {component}"
            if count == 1
            else f"{_sized(off, unit)} off in {component} (root mean square of {count} values)"
        )
        scatters = f"one observation scatters by ±{_sized(scatter, unit)}"
        if setup_scatter:
            scatters = (
                f"one observation scatters by ±{_sized(scatter, unit)} and set-ups by "
                f"±{_sized(setup_scatter, unit)}"
            )
        text = f"{found}; {scatters}, so at most {_sized(at_most, unit)} is expected"
        is_as_expected = off <= at_most
        return cls(
            time, text, component, count, off, scatter, setup_scatter, at_most, unit, is_as_expected
        )


def _sized(size: float, unit: str) -> str:
    return f"{size:.{1 if size >= 1.0 else 2}f} {unit}"


def in_micro(size: float) -> str:
    """Write a size in µm, µrad or µm/m as it is read: 11.3, 1.3, 0.67."""
    return f"{size:.1f}" if size >= 1.0 else f"{size:.2f}"


@dataclass(frozen=True, slots=True)
class NotAdopted(Answer):
    """Effects that the latest analysis of the active model confirmed, and that nobody adopted."""

    analysis: int
    """Number of the analysis"""
    effects: tuple[str, ...]
    """Each in one sentence"""
    needs_analysis: bool = False
    """Whether the active version has other effects of the analysis: then a new one is needed to
    adopt these"""


@dataclass(frozen=True, slots=True)
class RunningAnalysis(Answer):
    """An analysis that waits or runs."""

    id: int
    """Number of the analysis"""
    progress: float
    """Share that is done, 0 to 1"""


@dataclass(frozen=True, slots=True)
class MachineStatus(Answer):
    """Whether a machine can be trusted now, and why not."""

    machine: str
    """The machine's id"""
    name: str
    """The machine's name"""
    configuration: str
    """Order of its axes"""
    verdict: Verdict
    """`trusted`: the table is what the maps and effects say, on fresh temperatures. `limited`:
    there is a table, and the sentences say where it is not. `not-trusted`: there is none, or it
    stands still"""
    state: State
    """The worst of what is the matter, `fresh` where nothing is. It goes 30 s after its cause"""
    about: tuple[str, ...]
    """Sensors, components or effects that the state is about; empty where it is about all"""
    since: datetime | None
    """Since when it is in this state: by the readings in memory, and where those do not reach back
    so far, by the alarms of the event log, for which what it found before and after the service
    was away is one; null where that is not known"""
    sentences: tuple[str, ...]
    """What is the matter, the worst first; then what can be trusted all the same"""
    computed_at: datetime
    """When this was judged, UTC"""
    reading_time: datetime | None
    """Time of the latest reading that is in use"""
    reading_age_s: float | None
    """How old it is [s]"""
    model_version: int | None
    """Version of the active model"""
    components: int
    """How many components the table has; 0 without a table"""
    complete: bool
    """`complete` of `GET …/compensation`; false where there is no table"""
    largest: Largest | None
    """The largest compensation of the table: of a displacement where there is one"""
    change_per_h: Largest | None
    """The largest change of the compensation in an hour, of a displacement where there is one, if
    the sensors went on at their present rates; of components without adopted effects, as those
    may have a memory. Null where that is not known"""
    beyond: tuple[BeyondMaps, ...]
    """Components outside their maps, the furthest first"""
    watch: str
    """Whether verifications prove a lasting change: `within` the limits of the sequential test (no
    change is proved, which says nothing of the last check), `beyond` them, or `not-judged`"""
    last_check: LastCheck | None
    """By how much the latest verification of the active model was off; null before the first"""
    not_adopted: NotAdopted | None
    """What the latest analysis of the active model confirmed and is not in the table, be it that
    other effects of it were adopted; null where there is none"""
    analysis: RunningAnalysis | None
    """The analysis that waits or runs"""
    sensors: tuple[SensorNow, ...]
    """Every sensor now, those that components are assigned to first"""

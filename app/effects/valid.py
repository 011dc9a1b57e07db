"""The ranges in which an effect was learnt: outside them it is held at their edge.

An effect is a curve through what a campaign has seen. Beyond that nobody has measured it, so it
stays what it was at the edge, as an error map does beyond the maps' temperatures.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Annotated, Any, Final, TypeAlias, cast

import numpy as np
from pydantic import BeforeValidator, Field, PlainSerializer, PlainValidator, ValidationError
from pydantic_core import InitErrorDetails

from app.answer import Answer
from app.answer import Range as AnsweredRange
from app.arrays import FloatArray
from app.effects.conditions import Conditions
from app.effects.driver import Driver
from app.effects.shape import Places

Range: TypeAlias = tuple[float, float]
"""Smallest and largest value that were seen."""

DRIVER_MARGIN: Final = 0.02
"""A state, or what a driver makes of temperatures and the past, counts as outside from this share
of its learnt span on: what a straight line adds so near is a fiftieth of what it was learnt from,
less than any campaign tells. A temperature counts as outside from its sensor's resolution on."""

POSITION_MARGIN: Final = 0.05
"""A position counts as outside from this share of the learnt span on: who measures a travel stops
short of its ends, and random positions never reach them."""


def _iso(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")


def _seconds(stored: str) -> float:
    return datetime.fromisoformat(stored).timestamp()


def complete(*names: str) -> Any:
    """Refuse what is stored without fields that every version wrote, whatever their defaults."""

    def check(stored: Any) -> Any:
        missing = [name for name in names if isinstance(stored, Mapping) and name not in stored]
        if missing:
            lines: list[InitErrorDetails] = [
                {"type": "missing", "loc": (name,), "input": None} for name in missing
            ]
            raise ValidationError.from_exception_data("missing", lines)
        return stored

    return BeforeValidator(check)


Time: TypeAlias = Annotated[float, PlainValidator(_seconds), PlainSerializer(_iso, str)]
"""Seconds since 1970, which are stored as a time of ISO 8601."""


@dataclass(frozen=True)
class Valid:
    """What an effect was learnt in.

    Parameters
    ----------
    from_s, to_s
        Times of the first and the last observation that it was estimated from [s].
    temperatures_c
        Sensors that it is made of, to their temperatures then [°C].
    state
        States that drive it at once, to their values then.
    positions_mm
        Components to the positions of their axis then [mm].
    use_until_s
        Where it grows with time: until when what it may have grown by since `to_s` is below one
        standard deviation of an observation [s]; None where it does not grow. Where it goes on,
        what it may then be wrong by.
    continued_until_s
        Where it grows with time and goes on as it was found: until when [s]; None: it is held at
        its value of `to_s`.
    """

    from_s: Annotated[Time, Field(alias="from")]
    to_s: Annotated[Time, Field(alias="to")]
    temperatures_c: Mapping[str, Range] = field(default_factory=dict)
    state: Mapping[str, Range] = field(default_factory=dict)
    positions_mm: Mapping[str, Range] = field(default_factory=dict)
    use_until_s: Annotated[Time | None, Field(alias="use_until")] = None
    continued_until_s: Annotated[Time | None, Field(alias="continued_until")] = None

    @property
    def grows_until_s(self) -> float:
        """Until when an effect that grows with time grows [s]: from then on it is held."""
        return self.to_s if self.continued_until_s is None else self.continued_until_s

    def held(self, conditions: Conditions) -> Conditions:
        """Move temperatures and states that lie outside to the edge."""
        return replace(
            conditions,
            temperatures_c=_clipped(conditions.temperatures_c, self.temperatures_c),
            states=_clipped(conditions.states, self.state),
        )

    def for_driver(self, driver: Driver, conditions: Conditions, limited: Conditions) -> Conditions:
        """Choose what a driver is to be evaluated at."""
        if driver.grows_with_time:
            times_s = np.clip(conditions.times_s, self.from_s, self.grows_until_s)
            return replace(conditions, times_s=times_s)
        return limited if driver.is_held_by_signal else conditions

    def held_places(self, code: str, places: Places) -> Places:
        """Move positions that lie outside to the edge, the margin included."""
        edges = self.edges_mm(code)
        if edges is None:
            return places
        return places._replace(positions_mm=np.clip(places.positions_mm, *edges))

    def edges_mm(self, code: str) -> Range | None:
        """Give the positions between which a component's effect is evaluated [mm]."""
        learnt = self.positions_mm.get(code)
        return None if learnt is None else widened(learnt, POSITION_MARGIN)

    def shown(self, made_of: Mapping[str, Range]) -> LearntIn:
        """Show it in answers, with the ranges of what the effect is made of beside the signals."""
        return LearntIn(
            from_=datetime.fromtimestamp(self.from_s, UTC),
            to=datetime.fromtimestamp(self.to_s, UTC),
            temperatures_c=self.temperatures_c,
            state=self.state,
            positions_mm=self.positions_mm,
            made_of=made_of,
            use_until=None
            if self.use_until_s is None
            else datetime.fromtimestamp(self.use_until_s, UTC),
        )


StoredValid: TypeAlias = Annotated[
    Valid, complete("from", "to", "temperatures_c", "state", "positions_mm", "use_until")
]
"""Those of older versions have no `continued_until`."""


@dataclass(frozen=True, slots=True)
class LearntIn(Answer, published_as="ValidAnswer"):
    """The ranges in which an effect was learnt; beyond them it is held at the edge."""

    from_: Annotated[datetime, Field(alias="from")]
    """Time of the first observation that it rests on, UTC"""

    to: datetime
    """Time of the last one, UTC"""

    temperatures_c: Annotated[
        Mapping[str, AnsweredRange], Field(examples=[{"z-column": [21.4, 29.8]}])
    ]
    """Temperatures of the sensors that it uses [°C]"""

    state: Annotated[Mapping[str, AnsweredRange], Field(examples=[{"spindle_rpm": [0.0, 12000.0]}])]
    """Values of the states that drive it at once"""

    positions_mm: Annotated[Mapping[str, AnsweredRange], Field(examples=[{"EZZ": [2.5, 497.5]}])]
    """Positions on the axis of each of its components [mm]"""

    made_of: Annotated[
        Mapping[str, AnsweredRange],
        Field(examples=[{"z-column 41 min late minus z-column [K]": [-1.9, 2.3]}]),
    ]
    """Quantities that it forms from several signals or from the past, such as how far a sensor
    lags; each name ends in the unit"""

    use_until: datetime | None
    """Until when an effect that grows with time may be used, UTC. After that, its growth since
    `to`, or its error where it is continued beyond that, may exceed the scatter of one observation.
    Null for other effects"""


def widened(learnt: Range, share: float, least: float = 0.0) -> Range:
    """Widen a range by a share of its span, by no less than `least`.

    >>> widened((100.0, 300.0), 0.05)
    (90.0, 310.0)
    """
    low, high = learnt
    by = max(share * (high - low), least)
    return low - by, high + by


def range_of(values: FloatArray) -> Range | None:
    """Find the smallest and the largest number; None where there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None


def _clipped(
    values: Mapping[str, FloatArray], ranges: Mapping[str, Range]
) -> Mapping[str, FloatArray]:
    clipped = {name: np.clip(values[name], *ranges[name]) for name in ranges if name in values}
    # A chain asks what is not clipped for nothing: a record may name thousands of states.
    return ChainMap(clipped, cast("dict[str, FloatArray]", values))

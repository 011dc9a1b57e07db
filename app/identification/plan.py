"""The answer of a planning: what a plan of measurements could see, and which visit to add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.identification.analysis import plain
from app.identification.effects.kind import NotTested
from app.identification.residuals import LeftOut


@dataclass(frozen=True, slots=True)
class PlannedRival:
    """What imitates an effect best, the share of it that it reproduces, and what separates them."""

    kind: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    overlap: float
    separating_measurement: str | None


@dataclass(frozen=True, slots=True)
class PlannedEffect:
    """The smallest effect that the plan would find nine times in ten.

    Parameters
    ----------
    kind, variant, components, sensors, states
        Which effect.
    unit
        Symbol of the unit of both figures.
    smallest_rms
        Its root mean square over the rows in which it shows.
    distinguishable_rms
        The same to be told from its closest rival; None: nothing in this plan tells them apart.
    rival
        The closest rival of another kind.
    """

    kind: str
    variant: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    unit: str
    smallest_rms: float
    distinguishable_rms: float | None
    rival: PlannedRival | None


@dataclass(frozen=True, slots=True)
class Helped:
    """What an added visit does for one effect: its smallest size before and after."""

    kind: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    states: tuple[str, ...]
    unit: str
    before_rms: float
    after_rms: float


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A visit to add: in words, when the machine was like that (UTC), and what it helps."""

    sentence: str
    like_time: str
    temperatures_c: Mapping[str, float]
    states: Mapping[str, float]
    helped: tuple[Helped, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """What a plan of measurements can do.

    Parameters
    ----------
    summary
        Two plain sentences.
    visits, values
        How many are planned.
    notes
        What was assumed.
    effects
        What could be seen, the hardest to tell apart first.
    not_testable
        What could not, and why.
    excluded
        Planned values that could not be compared with the model.
    suggestions
        Visits to add, the most useful first.
    """

    summary: str
    visits: int
    values: int
    notes: tuple[str, ...]
    effects: tuple[PlannedEffect, ...]
    not_testable: tuple[NotTested, ...]
    excluded: tuple[LeftOut, ...]
    suggestions: tuple[Suggestion, ...]

    def to_json(self) -> dict[str, Any]:
        """Write it down: JSON's own types, every number finite."""
        found: dict[str, Any] = plain(self)
        return found

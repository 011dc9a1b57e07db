"""What every method of measuring gives: components with their uncertainty, and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field

from app.answer import AS_IT_IS, Answer
from app.geometry.measuring_line import MeasuringLines
from app.thermal.error_map import ComponentTable


@dataclass(frozen=True, slots=True, eq=False)
class MeasurementResult:
    """The components that a measurement yields, for an error map or for a person.

    Parameters
    ----------
    tables
        The components; each with the covariance of its own uncertainty where the
        measurement can tell it.
    figures
        Figures of quality and of the method's own standard by name; the unit is in
        the name: `closure_rms_um`.
    notes
        In sentences: what the method cannot see, what was left out, what looks wrong.
    measuring_lines
        Axis to the line along which its translations were measured.
    """

    tables: tuple[ComponentTable, ...]
    figures: Mapping[str, float]
    notes: tuple[str, ...] = ()
    measuring_lines: MeasuringLines = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Evaluated(Answer):
    """What a method makes of its readings: the result, and what else it is answered with."""

    result: Annotated[MeasurementResult, AS_IT_IS, Field(exclude=True)]
    # Said after the result's own and those on its map.
    further_notes: Annotated[Sequence[str], Field(exclude=True)] = ()

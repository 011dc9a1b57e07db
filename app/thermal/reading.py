"""A reading: live sensor temperatures and the machine's state at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated

from pydantic import Field

from app.answer import Answer, TemperaturesC


@dataclass(frozen=True, slots=True)
class Reading(Answer, published_as="ReadingSchema", whole=False):
    """Live temperatures and the machine's state at one time."""

    time: Annotated[datetime, Field(examples=["2026-03-01T06:00:00Z"])]
    """When, UTC"""
    temperatures_c: TemperaturesC
    """Temperatures by sensor [°C]"""
    state: Annotated[Mapping[str, float], Field(examples=[{"spindle_rpm": 8000}])] = field(
        default_factory=dict
    )
    """Any numbers that the shop knows of the machine's state"""
    early_s: Annotated[float, Field(exclude=True)] = field(default=0.0, compare=False)
    """How long before its time it arrived [s], zero where clocks differ by no more than they may:
    what is stated of a time that has not come was not measured then"""

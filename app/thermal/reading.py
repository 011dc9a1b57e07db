"""A reading: live sensor temperatures and the machine's state at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime


@dataclass(frozen=True, slots=True)
class Reading:
    """Temperatures [°C] by sensor and the machine's state (any numbers) at one time, UTC.

    `early_s` is how long before its time it arrived [s], zero where clocks differ by no more
    than they may: what is stated of a time that has not come was not measured then. Two readings
    with the same content are equal however they arrived.
    """

    time: datetime
    temperatures_c: Mapping[str, float]
    state: Mapping[str, float]
    early_s: float = field(default=0.0, compare=False)

"""A reading: live sensor temperatures and the machine's state at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class Reading:
    """Temperatures [°C] by sensor and the machine's state (any numbers) at one time, UTC."""

    time: datetime
    temperatures_c: Mapping[str, float]
    state: Mapping[str, float]

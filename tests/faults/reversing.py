"""A machine that reverses, of which its maps know nothing: what is posted of it.

Small enough that its analysis takes a second or two, and plain enough that it is known what that
must find: one reversal of EXX, of a size that is drawn.
"""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta
from typing import Any

POSITIONS = [0.0, 125.0, 250.0, 375.0, 500.0]
COLD_C, WARM_C = 20.0, 26.0
BEGAN = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
EFFECTS = ["backlash"]
"""What an analysis of it is to look for."""


class ReversingMachine:
    """Two maps that are straight lines through zero, and a verification that goes both ways.

    Parameters
    ----------
    chance
        Where the rises, the reversal value and the verification's noise are drawn from.
    """

    def __init__(self, machine_id: str, chance: random.Random) -> None:
        self._chance = chance
        self._rises = {t: chance.uniform(-0.02, 0.02) for t in (COLD_C, WARM_C)}
        self.reversal_um = chance.choice((-1, 1)) * chance.uniform(5.0, 12.0)
        self.body: dict[str, Any] = {
            "id": machine_id,
            "name": "Reverses",
            "configuration": "XYFZ",
            "axes": {"x": {"min_mm": 0, "max_mm": 500}},
            "sensors": [{"name": "bed", "stuck_after_s": None}],
        }

    @property
    def room(self) -> str:
        return f"/v1/machines/{self.body['id']}"

    def error_um(self, t_c: float, position_mm: float) -> float:
        """Interpolate between the two maps, without the reversal [µm]."""
        share = (t_c - COLD_C) / (WARM_C - COLD_C)
        return ((1.0 - share) * self._rises[COLD_C] + share * self._rises[WARM_C]) * position_mm

    def maps(self) -> list[dict[str, Any]]:
        return [
            {
                "label": f"{t_c} °C",
                "measured_at": BEGAN.isoformat(),
                "temperatures_c": {"bed": t_c},
                "components": [
                    {
                        "component": "EXX",
                        "positions_mm": POSITIONS,
                        "errors_um": [self.error_um(t_c, x) for x in POSITIONS],
                    }
                ],
            }
            for t_c in (COLD_C, WARM_C)
        ]

    def readings(self) -> list[dict[str, Any]]:
        """Forty minutes in which the bed warms."""
        return [
            {"time": _at(minute), "temperatures_c": {"bed": _bed_c(minute)}} for minute in range(41)
        ]

    def verification(self) -> dict[str, Any]:
        observations = []
        for i in range(36):
            minute = 2 + i
            position = POSITIONS[(i // 2) % len(POSITIONS)]
            up = i % 2 == 0
            half = self.reversal_um / 2.0 if up else -self.reversal_um / 2.0
            measured = self.error_um(_bed_c(minute), position) + half
            observations.append(
                {
                    "time": _at(minute),
                    "component": "EXX",
                    "position_mm": position,
                    "direction": "+" if up else "-",
                    "measured_um": round(measured + self._chance.gauss(0.0, 0.3), 3),
                }
            )
        return {"label": "both ways", "repeatability_um": 0.3, "observations": observations}


def found_reversal(result: dict[str, Any]) -> float | None:
    """Give the plain reversal that an analysis found [µm]; None where it found none."""
    for effect in result["effects"]:
        if set(effect["parameters"]) == {"reversal_um"}:
            value: float = effect["parameters"]["reversal_um"]
            return value
    return None


def _at(minute: float) -> str:
    return (BEGAN + timedelta(minutes=minute)).isoformat()


def _bed_c(minute: float) -> float:
    return 21.0 + 0.1 * minute

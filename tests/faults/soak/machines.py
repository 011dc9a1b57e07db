"""Machines of the fleet, made at random: sensors, policies, maps and temperatures."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta
from typing import Any

SENSORS = ("x-middle", "y-front", "z-column", "spindle")
COMPONENTS = (
    *("EXX", "EYX", "EZX", "EAX", "EBX", "ECX"),
    *("EXY", "EYY", "EZY", "EAY", "EBY", "ECY"),
    *("EXZ", "EYZ", "EZZ", "EAZ", "EBZ", "ECZ"),
    *("SXY", "SYZ", "SZX"),
)
POLICIES = ("clamp", "clamp", "clamp", "extrapolate", "reject")
PLACES = 8
"""So many maps fit on one machine: each has temperatures that no other has."""
COLDEST_C, STEP_C = 17.0, 2.5
MAX_AGE_S = 12.0
STUCK_AFTER_S = 8.0
RATES_C_PER_MIN = (1e6, 1e6, 1200.0, 300.0)
"""A sensor may do anything, or of what is drawn here it does some, or most, too fast."""

MEASURED = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)


class MadeMachine:
    """A machine's description, and the maps that may be measured on it.

    Parameters
    ----------
    chance
        Where everything that is drawn comes from.
    """

    def __init__(self, machine_id: str, chance: random.Random) -> None:
        self._chance = chance
        policy = chance.choice(POLICIES)
        self.body: dict[str, Any] = {
            "id": machine_id,
            "name": f"Soaked {machine_id}",
            "configuration": chance.choice(("XYFZ", "XFYZ", "FXYZ", "XYZF")),
            "axes": {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"},
            "sensors": [self._sensor(name) for name in SENSORS],
            "out_of_range": policy,
            "extrapolation_margin_c": 4.0,
            "extrapolation_error_ratio": 3.0,
        }
        # How far a line is trusted beyond maps that state an uncertainty is not evaluated again.
        self._states_errors = policy != "extrapolate" and chance.random() < 0.5
        self._codes = sorted(chance.sample(COMPONENTS, chance.randint(5, len(COMPONENTS))))
        self._backward = {code for code in self._codes if chance.random() < 0.2}
        # Each sensor has the maps in an order of its own.
        self._places_c = {
            name: [
                COLDEST_C + STEP_C * place + chance.uniform(-0.8, 0.8)
                for place in chance.sample(range(PLACES), PLACES)
            ]
            for name in SENSORS
        }

    def _sensor(self, name: str) -> dict[str, Any]:
        stand_in = {"x-middle": "y-front", "z-column": self._chance.choice(("spindle", None))}
        return {
            "name": name,
            "stand_in": stand_in.get(name),
            "min_c": 0.0,
            "max_c": 60.0,
            "max_age_s": MAX_AGE_S,
            "resolution_c": 0.1,
            "stuck_after_s": self._chance.choice((None, STUCK_AFTER_S)),
            "max_rate_c_per_min": self._chance.choice(RATES_C_PER_MIN),
        }

    def error_map(self, place: int, label: str) -> dict[str, Any]:
        """Measure a map at the temperatures of a place."""
        chance = self._chance
        codes = [c for c in self._codes if chance.random() < 0.95] or self._codes
        return {
            "label": label,
            "measured_at": (MEASURED + timedelta(hours=place)).isoformat(),
            "temperatures_c": {n: round(self._places_c[n][place], 3) for n in SENSORS},
            "components": [self._component(code) for code in codes],
        }

    def _component(self, code: str) -> dict[str, Any]:
        chance = self._chance
        if code.startswith("S"):
            return {"component": code, "value_um_per_m": round(chance.uniform(-30, 30), 3)}
        unit = "urad" if code[1] in "ABC" else "um"
        low = chance.choice((0.0, 0.0, 0.0, 20.0))
        high = chance.choice((500.0, 500.0, 500.0, 470.0))
        inside = sorted(round(chance.uniform(low + 1, high - 1), 1) for _ in range(9))
        positions = sorted({low, *inside, high})
        part: dict[str, Any] = {"component": code, "positions_mm": positions}
        names = ["errors", *(["backward_errors"] if code in self._backward else [])]
        for name in names:
            part[f"{name}_{unit}"] = [round(chance.uniform(-20, 20), 3) for _ in positions]
        if self._states_errors and code not in self._backward:
            part[f"standard_errors_{unit}"] = [round(chance.uniform(0.1, 2), 3) for _ in positions]
        return part

    def assignment(self) -> dict[str, str]:
        """Let a component follow any sensor."""
        return {self._chance.choice(self._codes): self._chance.choice(SENSORS)}

    def temperatures(self) -> dict[str, float]:
        """Draw temperatures of all sensors: mostly between maps, at one, or beyond them."""
        return {name: self._temperature(name) for name in SENSORS}

    def _temperature(self, name: str) -> float:
        kind = self._chance.random()
        if kind < 0.08:
            return round(self._chance.choice(self._places_c[name]), 3)
        if kind < 0.14:
            return round(self._chance.uniform(1.0, 59.0), 2)
        last_c = COLDEST_C + STEP_C * (PLACES - 1)
        return round(self._chance.uniform(COLDEST_C - 1.0, last_c + 1.0), 2)

"""A machine that reverses, of which its maps know nothing: found, adopted, taken back, deleted."""

from __future__ import annotations

import random
import threading
import time
from datetime import UTC, datetime, timedelta
from typing import Any

from tests.faults.soak.asking import Asker, Ended, Shop

POSITIONS = [0.0, 125.0, 250.0, 375.0, 500.0]
COLD_C, WARM_C = 20.0, 26.0
BEGAN = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
PATIENCE_S = 300.0
DIGITS_UM = 2e-4
"""Answers have four decimals, and the adopted value has nine digits."""


class Adopter(threading.Thread):
    """Goes round: machine, maps, readings, verification, analysis, adoption, and back.

    The table with the effect must be the maps' line, half of the reported reversal value above it
    from below and half of it below from above; without the effect the maps' line again.
    """

    def __init__(self, shop: Shop, seed: int, every_s: float) -> None:
        super().__init__(name="adopter", daemon=True)
        self._shop, self._every_s = shop, every_s
        self._chance = random.Random(seed)
        self._asker = Asker(shop)
        self.rounds = 0

    def run(self) -> None:
        try:
            while not self._shop.ended.is_set():
                if not self._shop.working.is_set():
                    self._asker.close()
                    self._shop.working.wait()
                    self._asker = Asker(self._shop)
                self._round(f"reversing-{self.rounds}")
                self.rounds += 1
                self._shop.ended.wait(self._every_s)
        except Ended:
            pass
        except Exception as error:
            self._shop.tally.find(f"{self.name} died of {type(error).__name__}: {error}")
        finally:
            self._asker.close()

    def _ask(self, method: str, path: str, body: Any, *expected: int) -> Any:
        answered = self._asker.ask(method, path, body)
        if answered.status not in (expected or (200, 201)) and not (
            answered.is_repeated and answered.status in (404, 409)
        ):
            raise RuntimeError(f"{method} {path}: {answered.status} {answered.content}")
        return answered.content

    def _round(self, machine_id: str) -> None:
        room = f"/v1/machines/{machine_id}"
        rises = {t: self._chance.uniform(-0.02, 0.02) for t in (COLD_C, WARM_C)}
        reversal_um = self._chance.choice((-1, 1)) * self._chance.uniform(5.0, 12.0)
        sensors = [{"name": "bed", "stuck_after_s": None}]
        self._ask(
            "POST",
            "/v1/machines",
            {
                "id": machine_id,
                "name": "Reverses",
                "configuration": "XYFZ",
                "axes": {"x": {"min_mm": 0, "max_mm": 500}},
                "sensors": sensors,
            },
        )
        for t_c, rise in rises.items():
            part = {
                "component": "EXX",
                "positions_mm": POSITIONS,
                "errors_um": [rise * x for x in POSITIONS],
            }
            one = {
                "label": f"{t_c} °C",
                "measured_at": BEGAN.isoformat(),
                "temperatures_c": {"bed": t_c},
                "components": [part],
            }
            self._ask("POST", f"{room}/error-maps", one)
        self._ask(
            "POST",
            f"{room}/readings",
            [
                {
                    "time": (BEGAN + timedelta(minutes=i)).isoformat(),
                    "temperatures_c": {"bed": 21.0 + 0.1 * i},
                }
                for i in range(41)
            ],
        )
        check = self._verification(rises, reversal_um)
        number = self._ask("POST", f"{room}/verifications", check)["id"]
        asked = {"verifications": [number], "effects": ["backlash"]}
        analysis = self._ask("POST", f"{room}/analyses", asked, 202)["id"]
        result = self._wait(f"{room}/analyses/{analysis}")
        if result is not None:
            self._adopt(room, analysis, result, rises)
        self._ask("DELETE", room, None, 204)

    def _verification(self, rises: dict[float, float], reversal_um: float) -> dict[str, Any]:
        observations = []
        for i in range(36):
            minute = 2 + i
            position = POSITIONS[(i // 2) % len(POSITIONS)]
            up = i % 2 == 0
            half = reversal_um / 2.0 if up else -reversal_um / 2.0
            measured = _line(rises, 21.0 + 0.1 * minute, position) + half
            observations.append(
                {
                    "time": (BEGAN + timedelta(minutes=minute)).isoformat(),
                    "component": "EXX",
                    "position_mm": position,
                    "direction": "+" if up else "-",
                    "measured_um": round(measured + self._chance.gauss(0.0, 0.3), 3),
                }
            )
        return {"label": "both ways", "repeatability_um": 0.3, "observations": observations}

    def _wait(self, path: str) -> Any:
        """Wait for an analysis; its result, or None where it takes too long."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            came = self._ask("GET", path, None)
            if came["status"] == "done":
                return came["result"]
            if came["status"] in ("failed", "cancelled"):
                self._shop.tally.find(f"{path}: {came['status']} {came.get('detail', '')}")
                return None
            if self._shop.ended.wait(0.5):
                raise Ended
        self._shop.tally.fault("analysis not awaited")
        return None

    def _adopt(self, room: str, analysis: int, result: Any, rises: dict[float, float]) -> None:
        found = [e for e in result["effects"] if set(e["parameters"]) == {"reversal_um"}]
        if not found:
            self._shop.tally.fault("no plain reversal found, nothing adopted")
            return
        before = self._ask("GET", room, None)["active_model"]
        self._ask("POST", f"{room}/analyses/{analysis}/adopt", {"effects": [0]})
        after = self._ask("GET", room, None)["active_model"]
        self._shop.tally.fault("adopted")
        reversal_um = found[0]["parameters"]["reversal_um"]
        self._check(room, rises, after, reversal_um)
        for version, value in ((before, 0.0), (after, reversal_um), (before, 0.0)):
            self._ask("POST", f"{room}/models/{version}/activate", None)
            self._check(room, rises, version, value)
        self._shop.tally.fault("gone back from what was adopted", 2)

    def _check(self, room: str, rises: dict[float, float], version: int, value: float) -> None:
        t_c = round(self._chance.uniform(21.5, 24.5), 2)
        came = self._ask("POST", f"{room}/compensation", {"temperatures_c": {"bed": t_c}})
        (line,) = came["components"]
        expected = [_line(rises, t_c, x) for x in POSITIONS]
        found = []
        if came["model_version"] != version:
            found.append(f"version {came['model_version']}, expected {version}")
        rows = {"errors_um": [e + value / 2.0 for e in expected]}
        if value:
            rows["backward_errors_um"] = [e - value / 2.0 for e in expected]
        for name, numbers in rows.items():
            if any(abs(a - b) > DIGITS_UM for a, b in zip(line[name], numbers, strict=True)):
                found.append(f"{name} {line[name]}, expected {numbers}")
        self._shop.tally.check("with and without what was adopted", f"{room} at {t_c} °C", found)


def _line(rises: dict[float, float], t_c: float, position_mm: float) -> float:
    """Interpolate between the two maps, each a straight line through zero [µm]."""
    share = (t_c - COLD_C) / (WARM_C - COLD_C)
    return ((1.0 - share) * rises[COLD_C] + share * rises[WARM_C]) * position_mm

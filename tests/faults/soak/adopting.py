"""A machine that reverses, of which its maps know nothing: found, adopted, taken back, deleted."""

from __future__ import annotations

import random
import threading
import time
from typing import Any

from tests.faults.reversing import EFFECTS, POSITIONS, ReversingMachine, found_reversal
from tests.faults.soak.asking import Asker, Ended, Shop

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
        machine = ReversingMachine(machine_id, self._chance)
        room = machine.room
        self._ask("POST", "/v1/machines", machine.body)
        for one in machine.maps():
            self._ask("POST", f"{room}/error-maps", one)
        self._ask("POST", f"{room}/readings", machine.readings())
        number = self._ask("POST", f"{room}/verifications", machine.verification())["id"]
        asked = {"verifications": [number], "effects": EFFECTS}
        analysis = self._ask("POST", f"{room}/analyses", asked, 202)["id"]
        result = self._wait(f"{room}/analyses/{analysis}")
        if result is not None:
            self._adopt(machine, analysis, result)
        self._ask("DELETE", room, None, 204)

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

    def _adopt(self, machine: ReversingMachine, analysis: int, result: Any) -> None:
        room, reversal_um = machine.room, found_reversal(result)
        if reversal_um is None:
            self._shop.tally.fault("no plain reversal found, nothing adopted")
            return
        before = self._ask("GET", room, None)["active_model"]
        self._ask("POST", f"{room}/analyses/{analysis}/adopt", {"effects": [0]})
        after = self._ask("GET", room, None)["active_model"]
        self._shop.tally.fault("adopted")
        self._check(machine, after, reversal_um)
        for version, value in ((before, 0.0), (after, reversal_um), (before, 0.0)):
            self._ask("POST", f"{room}/models/{version}/activate", None)
            self._check(machine, version, value)
        self._shop.tally.fault("gone back from what was adopted", 2)

    def _check(self, machine: ReversingMachine, version: int, value: float) -> None:
        room, t_c = machine.room, round(self._chance.uniform(21.5, 24.5), 2)
        came = self._ask("POST", f"{room}/compensation", {"temperatures_c": {"bed": t_c}})
        (line,) = came["components"]
        expected = [machine.error_um(t_c, x) for x in POSITIONS]
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

"""Who works with one machine, alone: so it is known what every answer must be."""

from __future__ import annotations

import queue
import random
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any

from tests.faults.soak.asking import Answered, Asker, Ended, Shop
from tests.faults.soak.evaluation import (
    CLOCKS_DIFFER_S,
    NoTable,
    Sensors,
    differences,
    sensors_at,
    stated,
    table,
)
from tests.faults.soak.machines import (
    MAX_AGE_S,
    PLACES,
    SENSORS,
    STUCK_AFTER_S,
    MadeMachine,
)

CHANGE_EVERY_S = 15.0
"""A machine's model changes no more often: versions stay for good."""

KEPT_READINGS_S = 400.0
KEPT_VALUES = 20_000
"""Sensors' values that were sent last: a stream may tell of them long after their readings were let
go of or withdrawn, where the service was away."""

KEPT_VERSIONS = 60
KEPT_VERIFICATIONS = 4
MARGIN_S = 0.03
"""An answer rests on a clock between when it was asked for and when it came, and a little more."""

FIRST_MAPS = 3
STREAMED_LATE_S = 60.0


class Owner(threading.Thread):
    """Posts readings and maps of one machine, asks for its tables, and checks them.

    `told` is where a follower of the machine's stream puts what came.
    """

    def __init__(self, shop: Shop, machine_id: str, seed: int, pause_s: float) -> None:
        super().__init__(name=f"owner of {machine_id}", daemon=True)
        self._shop, self._pause_s = shop, pause_s
        self._chance = random.Random(seed)
        self._machine = MadeMachine(machine_id, self._chance)
        self.room = f"/v1/machines/{machine_id}"
        self.told: queue.Queue[tuple[float, dict[str, Any]]] = queue.Queue(maxsize=2000)
        self.is_ready = threading.Event()
        self._maps: dict[str, dict[str, Any]] = {}
        self._versions: dict[int, tuple[frozenset[str], dict[str, str]]] = {}
        self._active: int | None = None
        self._readings: dict[float, Mapping[str, float]] = {}
        self._sent: dict[tuple[str, float], None] = {}
        self._early: dict[float, bool | None] = {}
        self._lost_until: dict[str, float] = {}
        self._stands_until: dict[str, float] = {}
        self._stands_at: dict[str, float] = {}
        self._verifications: list[int] = []
        self._waiting: list[tuple[float, dict[str, Any]]] = []
        self._changed_s = 0.0
        self._serial = 0
        self._asker = Asker(shop)

    def run(self) -> None:
        try:
            self._begin()
            self.is_ready.set()
            while not self._shop.ended.is_set():
                if not self._shop.working.is_set():
                    self._asker.close()
                    self._shop.working.wait()
                    self._asker = Asker(self._shop)
                self._step()
                self._shop.ended.wait(self._chance.uniform(0, 2 * self._pause_s))
        except Ended:
            pass
        except Exception as error:  # an owner that dies would check nothing any more
            self._shop.tally.find(f"{self.name} died of {type(error).__name__}: {error}")
        finally:
            self._asker.close()

    def _begin(self) -> None:
        self._ask("POST", "/v1/machines", self._machine.body, {201, 200, 409}, absolute=True)
        for place in range(FIRST_MAPS):
            self._store_map(place)

    def _step(self) -> None:
        chosen = self._chance.random()
        if time.time() - self._changed_s > CHANGE_EVERY_S and chosen < 0.3:
            self._changed_s = time.time()
            self._chance.choices(
                (self._change_maps, self._assign, self._go_back), weights=(5, 2, 2)
            )[0]()
        elif chosen < 0.5:
            self._post_readings()
        elif chosen < 0.53:
            self._verify()
        elif chosen < 0.54:
            self._withdraw_ahead()
        elif chosen < 0.8:
            self._check_stated()
        self._check_live()
        self._check_told()

    def _ask(
        self,
        method: str,
        path: str,
        body: Any,
        expected: set[int],
        *,
        absolute: bool = False,
        **query: Any,
    ) -> Answered:
        answered = self._asker.ask(method, path if absolute else self.room + path, body, **query)
        if answered.status not in expected:
            self._shop.tally.find(
                f"{method} {self.room}{path}: expected {sorted(expected)}, got "
                f"{answered.status} {str(answered.content)[:300]}"
            )
        return answered

    # The model

    def _store_map(self, place: int) -> None:
        self._serial += 1
        body = self._machine.error_map(place, f"{place}/{self._serial}")
        self._maps[body["label"]] = body
        self._ask("POST", "/error-maps", body, {201, 200}, accept_losses=True)
        labels, assignment = self._of_active()
        self._look(labels | {body["label"]}, assignment)

    def _change_maps(self) -> None:
        labels, assignment = self._of_active()
        taken = {int(label.split("/")[0]) for label in labels}
        free = sorted(set(range(PLACES)) - taken)
        if free and (len(taken) <= FIRST_MAPS or self._chance.random() < 0.6):
            # Maps of other versions are stored too, at the same temperatures perhaps.
            self._store_map(self._chance.choice(free))
            return
        label = self._chance.choice(sorted(labels))
        stored = self._ask("GET", "/error-maps", None, {200}).content
        number = next((one["id"] for one in stored if one["label"] == label), None)
        if number is not None:
            self._ask("DELETE", f"/error-maps/{number}", None, {204, 404})
            self._look(labels - {label}, assignment)

    def _assign(self) -> None:
        labels, assignment = self._of_active()
        wanted = self._machine.assignment()
        self._ask("PUT", "/sensor-assignment", wanted, {200}, accept_losses=True)
        self._look(labels, assignment | wanted)

    def _go_back(self) -> None:
        """Activate another version, ask for tables of it, and come back."""
        newest, others = self._active, sorted(self._versions)
        version = self._chance.choice(others)
        self._shop.tally.fault("gone back to an older version")
        for number in (version, newest):
            self._ask("POST", f"/models/{number}/activate", None, {200})
            self._active = number
            self._check_stated()
            self._check_live()

    def _of_active(self) -> tuple[frozenset[str], dict[str, str]]:
        return (frozenset(), {}) if self._active is None else self._versions[self._active]

    def _look(self, labels: frozenset[str], assignment: dict[str, str]) -> None:
        """See which version is active now, and hold what it is made of against what was done."""
        active = self._ask("GET", "", None, {200}).content["active_model"]
        last = max(self._versions, default=0)
        for number in range(last + 1, active + 1):
            came = self._ask("GET", f"/models/{number}", None, {200}).content
            held = frozenset(one["label"] for one in came["maps"])
            self._versions[number] = (held, {**assignment})
            if number == active and held != labels:
                self._shop.tally.find(
                    f"version {number} of {self.room} has {sorted(held)}, expected {sorted(labels)}"
                )
        self._versions[active] = (labels, assignment)
        self._active = active
        for number in sorted(self._versions)[:-KEPT_VERSIONS]:
            del self._versions[number]
        used = {label for held, _ in self._versions.values() for label in held}
        self._maps = {label: body for label, body in self._maps.items() if label in used}

    # Readings

    def _post_readings(self) -> None:
        now_s = time.time()
        kind = self._chance.random()
        if kind < 0.04:
            self._shop.tally.fault("clock ahead: a reading of the future")
            times = [now_s + self._chance.uniform(40.0, 240.0)]
        elif kind < 0.08:
            self._shop.tally.fault("clock behind: a reading of the past")
            times = [now_s - self._chance.uniform(1.0, 300.0)]
        elif kind < 0.2:
            times = [now_s - 0.1 * i for i in range(self._chance.randint(2, 20))]
        else:
            times = [now_s]
        if self._chance.random() < 0.02:
            self._shop.tally.fault("sensor lost for a while")
            for_s = self._chance.uniform(0.5, 3.0) * MAX_AGE_S
            self._lost_until[self._chance.choice(SENSORS)] = now_s + for_s
        if self._chance.random() < 0.03:
            self._shop.tally.fault("sensor stands still for a while")
            name, for_s = self._chance.choice(SENSORS), self._chance.uniform(0.5, 4.0)
            self._stands_until[name] = now_s + for_s * STUCK_AFTER_S
            self._stands_at[name] = self._machine.temperatures()[name]
        sent: dict[float, tuple[str, dict[str, float]]] = {}
        for time_s in times:
            moment = datetime.fromtimestamp(time_s, UTC)
            sent[moment.timestamp()] = (moment.isoformat(), self._temperatures(now_s))
        if any(time_s in self._readings for time_s in sent):
            return
        body = [{"time": when, "temperatures_c": came} for when, came in sent.values()]
        for pair in (pair for _, came in sent.values() for pair in came.items()):
            self._sent.pop(pair, None)  # what was sent again is let go of last
            self._sent[pair] = None
        while len(self._sent) > KEPT_VALUES:
            del self._sent[next(iter(self._sent))]
        answered = self._ask("POST", "/readings", body, {201})
        for time_s, (_, came) in sent.items():
            self._readings[time_s] = came
            if time_s > answered.began_s + CLOCKS_DIFFER_S:
                # Asked more than once it may have been stored long before it was answered.
                surely = time_s > answered.received_s + CLOCKS_DIFFER_S
                self._early[time_s] = True if surely else None
        self._forget()

    def _temperatures(self, now_s: float) -> dict[str, float]:
        came = self._machine.temperatures()
        for name, until_s in self._stands_until.items():
            if now_s < until_s:
                came[name] = self._stands_at[name]
        there = [n for n in SENSORS if self._lost_until.get(n, 0.0) < now_s] or ["spindle"]
        if self._chance.random() < 0.03:
            self._shop.tally.fault("sensor out of its range")
            came[self._chance.choice(there)] = self._chance.choice((-40.0, 99.0, 150.0))
        return {name: came[name] for name in there}

    def _withdraw_ahead(self) -> None:
        """Withdraw all that lies ahead by far more than this takes."""
        since_s = time.time() + 20.0
        ahead = [t for t in self._readings if t > since_s]
        if not ahead:
            return
        bounds = {
            "from": datetime.fromtimestamp(min(ahead), UTC).isoformat(),
            "to": datetime.fromtimestamp(max(ahead), UTC).isoformat(),
        }
        self._shop.tally.fault("readings withdrawn", len(ahead))
        self._ask("DELETE", "/readings", None, {200}, **bounds)
        for time_s in ahead:
            del self._readings[time_s]
            self._early.pop(time_s, None)

    def _forget(self) -> None:
        """Let go of what no table can rest on: all but the newest of each sensor, after a while."""
        before_s = time.time() - KEPT_READINGS_S
        newest = {
            name: max((t for t, came in self._readings.items() if name in came), default=0.0)
            for name in SENSORS
        }
        for time_s in [t for t in self._readings if t < before_s]:
            if time_s not in newest.values():
                del self._readings[time_s]
                self._early.pop(time_s, None)

    def _verify(self) -> None:
        self._serial += 1
        now = datetime.now(UTC)
        body = {
            "label": f"check {self._serial}",
            "repeatability_um": 1.0,
            "observations": [
                {
                    "time": (now - timedelta(seconds=i)).isoformat(),
                    "component": "EXX",
                    "position_mm": 25.0 * i,
                    "measured_um": round(self._chance.gauss(0.0, 3.0), 3),
                }
                for i in range(20)
            ],
        }
        stored = self._ask("POST", "/verifications", body, {201, 200}).content
        self._verifications.append(stored["id"])
        if len(self._verifications) > KEPT_VERIFICATIONS:
            number = self._verifications.pop(0)
            self._ask("DELETE", f"/verifications/{number}", None, {204, 404})

    # Checks

    def _expected(self, sensors: Sensors, version: int) -> Any:
        labels, assignment = self._versions[version]
        maps = [self._maps[label] for label in labels]
        return table(self._machine.body, maps, assignment, sensors)

    def _is_complete(self, lines: Any, sensors: Sensors, version: int) -> bool:
        labels, _ = self._versions[version]
        codes = {p["component"] for label in labels for p in self._maps[label]["components"]}
        return codes == lines.keys() and all(
            line.is_whole and line.sensor in sensors.usable for line in lines.values()
        )

    def _check_stated(self) -> None:
        temperatures_c = self._machine.temperatures()
        for name in SENSORS:
            if self._chance.random() < 0.03:
                del temperatures_c[name]
        if not temperatures_c:
            return
        body = {"temperatures_c": temperatures_c}
        answered = self._asker.ask("POST", f"{self.room}/compensation", body)
        sensors = stated(self._machine.body, temperatures_c)
        found = self._judged(answered, lambda: sensors)
        kind = "a table" if answered.status == 200 else "a refusal"
        self._shop.tally.check(
            f"stated temperatures: {kind}", f"{self.room} at {temperatures_c}", found
        )

    def _check_live(self) -> None:
        answered = self._asker.ask("GET", f"{self.room}/compensation")
        found: list[str] = []
        for now_s in self._moments(answered):
            found = self._judged_live(answered, now_s)
            if not found:
                break
        kind = "a table" if answered.status == 200 else "a refusal"
        self._shop.tally.check(f"latest reading: {kind}", self.room, found)
        if answered.status == 200:
            for one in answered.content["sensors"]:
                if one["health"] != "ok":
                    self._shop.tally.fault(f"sensor found {one['health']}")

    def _moments(self, answered: Answered) -> list[float]:
        """Give a time of each stretch between asking and answering in which nothing grows old."""
        low, high = answered.sent_s - MARGIN_S, answered.received_s + MARGIN_S
        breaks = {t - CLOCKS_DIFFER_S for t in self._readings}
        breaks |= {t + MAX_AGE_S for t in self._readings}
        edges = [low, *sorted(t for t in breaks if low < t < high), high]
        return [(a + b) / 2.0 for a, b in pairwise(edges)]

    def _judged_live(self, answered: Answered, now_s: float) -> list[str]:
        sensors = sensors_at(self._machine.body, self._readings.items(), now_s)
        found = self._judged(answered, lambda: sensors, is_early=self._is_early(now_s))
        if found or answered.status != 200:
            return found
        came_s = datetime.fromisoformat(answered.content["reading_time"]).timestamp()
        if came_s != sensors.latest:
            found.append(f"reading of {came_s}, expected {sensors.latest}")
        if answered.content["stale"] != bool(sensors.stale):
            found.append(f"stale {answered.content['stale']}, expected {sorted(sensors.stale)}")
        health = {one["sensor"]: one["health"] for one in answered.content["sensors"]}
        if health != sensors.health:
            found.append(f"sensors {health}, expected {sensors.health}")
        return found

    def _is_early(self, now_s: float) -> bool | None:
        """Whether a sensor's newest value arrived before its time; None where nobody can know."""
        newest: dict[str, float] = {}
        for time_s, came in self._readings.items():
            if time_s <= now_s + CLOCKS_DIFFER_S:
                for name in came:
                    newest[name] = max(newest.get(name, 0.0), time_s)
        early = [self._early.get(time_s, False) for time_s in newest.values()]
        return True if any(early) else (None if None in early else False)

    def _judged(
        self,
        answered: Answered,
        sensors: Callable[[], Sensors],
        *,
        is_early: bool | None = False,
    ) -> list[str]:
        version = self._active
        assert version is not None
        at = sensors()
        try:
            expected = self._expected(at, version)
        except NoTable as why:
            refused = answered.status in (409, 422)
            return [] if refused else [f"{answered.status}, expected a refusal: {why}"]
        if answered.status != 200:
            return [f"{answered.status} {str(answered.content)[:300]}, expected a table"]
        found = differences(answered.content, expected, version)
        complete = self._is_complete(expected, at, version) and not is_early
        if not found and is_early is not None and answered.content["complete"] != complete:
            warnings = answered.content["warnings"]
            found.append(f"complete {not complete}, expected {complete}; it says {warnings}")
        return found

    def _check_told(self) -> None:
        """Check what the machine's stream told, as far as its version is known by now."""
        while not self.told.empty():
            self._waiting.append(self.told.get())
        waiting, self._waiting = self._waiting, []
        for came_s, answer in waiting:
            version = answer["model_version"]
            if version not in self._versions:
                if time.time() - came_s < STREAMED_LATE_S:
                    self._waiting.append((came_s, answer))
                elif version > min(self._versions):
                    self._shop.tally.find(f"{self.room} was told of version {version}")
                continue
            self._shop.tally.check("stream", self.room, self._judged_told(answer, version))

    def _judged_told(self, answer: dict[str, Any], version: int) -> list[str]:
        states = {s["sensor"]: s for s in answer["sensors"]}
        by_health = {
            health: {n: s["temperature_c"] for n, s in states.items() if s["health"] == health}
            for health in ("ok", "stale")
        }
        for name, value in [pair for known in by_health.values() for pair in known.items()]:
            if (name, value) not in self._sent:
                return [f"{name} at {value} °C, which was never sent"]
        sensors = Sensors(by_health["ok"], by_health["stale"], None)
        try:
            expected = self._expected(sensors, version)
        except NoTable as why:
            return [f"a table, expected none: {why}"]
        return differences(answer, expected, version)

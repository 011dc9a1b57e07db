"""Clients that store without pause, and hold what was answered against what is there."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import count

import httpx

MACHINE = {
    "id": "mcfv5050",
    "name": "MCFV5050LN",
    "configuration": "XYFZ",
    "axes": {axis: {"min_mm": 0, "max_mm": 500} for axis in "xyz"},
    "sensors": [{"name": "x-middle"}, {"name": "y-front"}, {"name": "z-column"}],
}
ROOM = f"/v1/machines/{MACHINE['id']}"
START = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
COMPONENTS = ("EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ")
BATCH = 40
RISE_C = 0.11
"""From map to map: more than the resolution of a temperature."""
MAPS_A_ROUND = 90
ROUNDS = 5
"""As many on one database: with more the maps would be of no temperature on this earth."""
LONG = list(range(400))
PATIENCE_S = 120.0


class Lost(AssertionError):
    """What was answered is not there, or something is there by half."""


def client_of(url: str) -> httpx.Client:
    return httpx.Client(base_url=url, timeout=PATIENCE_S, trust_env=False)


def temperatures(t_c: float) -> dict[str, float]:
    return {"x-middle": t_c, "y-front": t_c - 1.0, "z-column": t_c + 2.0}


def big_map(label: str, t_c: float) -> dict[str, object]:
    """A map whose rows take a while to be written."""
    return {
        "label": label,
        "measured_at": (START - timedelta(days=1)).isoformat(),
        "temperatures_c": temperatures(t_c),
        "components": [
            {"component": code, "positions_mm": LONG, "errors_um": [t_c] * len(LONG)}
            for code in COMPONENTS
        ],
    }


class Writers:
    """Three clients: one stores maps, two store batches of readings.

    Parameters
    ----------
    url
        Of the service.
    round_number
        Of this run on its database: labels and times are those of no other.
    maps
        Whether maps are stored too.
    """

    def __init__(self, url: str, round_number: int, *, maps: bool = True) -> None:
        self._url = url
        self._round = round_number
        self.answered_maps: list[dict[str, object]] = []
        self.answered_batches: list[dict[str, float]] = []
        self.refused = 0
        self.no_room = 0
        self._maps_sent = 0
        self.unexpected: list[str] = []
        self._stop = threading.Event()
        self._numbers = count()
        self._threads = [
            threading.Thread(target=self._run, args=(step,))
            for step in (
                *((self._store_map,) if maps else ()),
                self._store_batch,
                self._store_batch,
            )
        ]

    def run_until(self, maps: int, batches: int) -> None:
        """Write until so many have been answered, and return in the middle of it."""
        for thread in self._threads:
            thread.start()
        self.wait_for(maps, batches)

    def wait_for(self, maps: int, batches: int) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while len(self.answered_maps) < maps or len(self.answered_batches) < batches:
            if time.monotonic() > deadline or self.unexpected:
                self.join()
                raise Lost(f"the service does not answer as it should: {self.unexpected}")
            time.sleep(0.001)

    def join(self) -> None:
        """Let them end, and see that nothing but 201, 503 and 507 was answered."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        if self.unexpected:
            raise Lost(f"expected 201, 503 or 507, got {self.unexpected[:3]}")

    def _run(self, step: Callable[[httpx.Client, int], None]) -> None:
        with client_of(self._url) as client:
            while not self._stop.is_set():
                try:
                    step(client, next(self._numbers))
                except httpx.TransportError:
                    return

    def _is_stored(self, answer: httpx.Response) -> bool:
        if answer.status_code in (503, 507):
            self.refused += 1
            self.no_room += answer.status_code == 507
            self._stop.wait(0.05)
        elif answer.status_code != 201:
            self.unexpected.append(f"{answer.status_code} {answer.text[:300]}")
            self._stop.set()
        return answer.status_code == 201

    def _store_map(self, client: httpx.Client, number: int) -> None:
        if self._maps_sent == MAPS_A_ROUND:
            self._stop.wait(0.01)
            return
        t_c = 20.0 + RISE_C * (MAPS_A_ROUND * self._round + self._maps_sent)
        self._maps_sent += 1
        content = big_map(f"{self._round}/{number}", t_c)
        if self._is_stored(client.post(f"{ROOM}/error-maps", json=content)):
            self.answered_maps.append(content)

    def _store_batch(self, client: httpx.Client, number: int) -> None:
        first = START - timedelta(hours=number + 1, milliseconds=self._round)
        times = [first + timedelta(seconds=s) for s in range(BATCH)]
        batch = {time.isoformat(): 20.0 + number % 7 for time in times}
        body = [{"time": t, "temperatures_c": temperatures(t_c)} for t, t_c in batch.items()]
        if self._is_stored(client.post(f"{ROOM}/readings", json=body)):
            self.answered_batches.append(batch)


def make_machine(url: str) -> None:
    """Store the machine that the writers write of."""
    with client_of(url) as client:
        client.post("/v1/machines", json=MACHINE).raise_for_status()


def expect_all(url: str, done: list[Writers]) -> None:
    """Hold everything that was answered against what the service has.

    Raises
    ------
    Lost
        If anything is missing, differs, or is there by half.
    """
    with client_of(url) as client:
        _expect_maps(client, [content for one in done for content in one.answered_maps])
        _expect_readings(client, [batch for one in done for batch in one.answered_batches])


def _expect_maps(client: httpx.Client, answered: list[dict[str, object]]) -> None:
    stored = {m["label"]: m for m in client.get(f"{ROOM}/error-maps").json()}
    for content in answered:
        kept = stored.get(str(content["label"]), {}).get("components", [])
        components: object = content["components"]
        assert isinstance(components, list)
        if [(c["component"], c["errors_um"]) for c in kept] != [
            (c["component"], c["errors_um"]) for c in components
        ]:
            raise Lost(f"map {content['label']} was answered with 201, and is not there")
    if any(len(m["components"]) != len(COMPONENTS) for m in stored.values()):
        raise Lost("half a map is stored")
    versions = client.get(f"{ROOM}/models").json()
    if [len(v["maps"]) for v in versions] != list(range(1, len(stored) + 1)):
        raise Lost("the versions are not one for each map")
    if versions and not versions[-1]["active"]:
        raise Lost("the newest version is not the active one")


def _expect_readings(client: httpx.Client, answered: list[dict[str, float]]) -> None:
    stored: dict[datetime, float] = {}
    until = None
    while True:
        asked = {"limit": 100_000} | ({"from": until} if until else {})
        came = client.get(f"{ROOM}/readings", params=asked).json()
        new = {datetime.fromisoformat(r["time"]): r["temperatures_c"]["x-middle"] for r in came}
        if not new.keys() - stored.keys():
            break
        stored |= new
        until = came[-1]["time"]
    for batch in answered:
        for time_stated, t_c in batch.items():
            if stored.get(datetime.fromisoformat(time_stated)) != t_c:
                raise Lost(f"the reading of {time_stated} was answered with 201, and is not there")
    if len(stored) % BATCH:
        raise Lost("half a batch is stored")

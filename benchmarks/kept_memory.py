"""One kind of request many times, and what the service's process holds after each fifth of them.

Tells apart what is let go of, what fills up to its bound, and what grows for ever. Ten machines on
SQLite, the service in this process; resident memory and objects after a full collection.

    python -m benchmarks.kept_memory tables|readings|versions|refused|machines [--requests 2000]
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import random
import tempfile
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx

from app.api.table_json import LAYOUTS
from app.live.registry import LiveModel
from app.main import create_app
from app.settings import Settings
from tests.faults.soak.machines import MadeMachine

MACHINES = 10
MAPS = 7
LOOKS = 5


class Work:
    """Requests of each kind: the method's name is the kind."""

    def __init__(self, client: httpx.AsyncClient, chance: random.Random) -> None:
        self._client, self._chance = client, chance
        self._machines = [MadeMachine(f"m{i}", chance) for i in range(MACHINES)]

    async def furnish(self) -> None:
        for machine in self._machines:
            await self._store(machine, MAPS)

    async def tables(self, i: int) -> None:
        machine = self._machines[i % MACHINES]
        stated = {"temperatures_c": machine.temperatures()}
        await self._ask("POST", f"{_room(machine)}/compensation", stated, 200, 409, 422)

    async def readings(self, i: int) -> None:
        machine = self._machines[i % MACHINES]
        now = datetime.now(UTC).isoformat()
        body = [{"time": now, "temperatures_c": machine.temperatures()}]
        await self._ask("POST", f"{_room(machine)}/readings", body, 201)
        await self._ask("GET", f"{_room(machine)}/compensation", None, 200, 409, 422)

    async def versions(self, i: int) -> None:
        number = 2 + i // MACHINES % (MAPS - 1)
        room = _room(self._machines[i % MACHINES])
        await self._ask("POST", f"{room}/models/{number}/activate", None, 200)
        await self.tables(i)

    async def refused(self, i: int) -> None:
        body = [{"time": "soon", "temperatures_c": {"spindle": "warm"}}] * 50
        await self._ask("POST", f"{_room(self._machines[i % MACHINES])}/readings", body, 422)

    async def machines(self, i: int) -> None:
        machine = MadeMachine(f"passing-{i}", self._chance)
        await self._store(machine, 2)
        stated = {"temperatures_c": machine.temperatures()}
        await self._ask("POST", f"{_room(machine)}/compensation", stated, 200, 409, 422)
        await self._ask("DELETE", _room(machine), None, 204)

    async def _store(self, machine: MadeMachine, maps: int) -> None:
        await self._ask("POST", "/v1/machines", machine.body, 201)
        for place in range(maps):
            path = f"{_room(machine)}/error-maps?accept_losses=true"
            await self._ask("POST", path, machine.error_map(place, f"{place}"), 201)

    async def _ask(self, method: str, path: str, body: Any, *expected: int) -> None:
        answer = await self._client.request(method, path, json=body)
        if answer.status_code not in expected:
            raise RuntimeError(f"{method} {path}: {answer.status_code} {answer.text[:300]}")


def _room(machine: MadeMachine) -> str:
    return f"/v1/machines/{machine.body['id']}"


def _line(i: int) -> str:
    gc.collect()
    held = gc.get_objects()
    models = sum(isinstance(one, LiveModel) for one in held)
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20
    return f"{i:>8,} {resident:>10.1f} {len(held):>10,} {models:>8} {LAYOUTS.bytes / 2**20:>9.1f}"


async def _trial(kind: str, requests: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(database_url=f"sqlite:///{folder}/kept.db", analyses=False)
        app = create_app(settings)
        transport = httpx.ASGITransport(app=app)
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://localhost") as client,
        ):
            work = Work(client, random.Random(3))
            await work.furnish()
            step: Callable[[int], Awaitable[None]] = getattr(work, kind)
            print(" requests   MiB here    objects   models   layouts [MiB]")
            for i in range(requests + 1):
                if i % max(1, requests // LOOKS) == 0:
                    print(_line(i), flush=True)
                await step(i)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = ("tables", "readings", "versions", "refused", "machines")
    parser.add_argument("kind", choices=kinds)
    parser.add_argument("--requests", type=int, default=2000)
    stated = parser.parse_args()
    asyncio.run(_trial(stated.kind, stated.requests))


if __name__ == "__main__":
    main()

"""Many machines over OPC UA: time of a round, memory, and how late the event loop is for others.

Machines are copies of the example machine. Rounds are timed in this process: where nothing has
changed, where every machine has a new reading, and where every tenth has. Beside the rounds a task
wakes every 5 ms, as requests for tables would, and notes how late it was.

    python -m benchmarks.opcua_tables [--machines 100]
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from asyncua import Server

from app.connections.opcua_nodes import Nodes
from app.connections.opcua_server import NAMESPACE, TableServer
from app.main import create_app
from app.services.load_machine import load_machine
from app.services.readings import store_readings
from app.settings import Settings
from app.thermal.reading import Reading
from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.many_machines import multiply

WOKEN_EVERY_S = 0.005
ROUNDS = 10


def resident_mib() -> float:
    """Resident memory of this process [MiB]."""
    return int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0]) / 1024


async def note_lateness(late_s: list[float]) -> None:
    """Wake and note how late that was."""
    while True:
        due = time.perf_counter() + WOKEN_EVERY_S
        await asyncio.sleep(WOKEN_EVERY_S)
        late_s.append(time.perf_counter() - due)


async def measure(folder: Path, n: int) -> None:
    url = database_url(folder)
    prepare_database(url)
    multiply(url, n)
    service = create_app(Settings(database_url=url))
    context = service.state.context
    ids = ["mcfv5050", *(f"m{i:05d}" for i in range(1, n))]
    for machine_id in ids:
        load_machine(context, machine_id)

    def read(some: Sequence[str], warmer_k: float) -> None:
        temperatures_c = {name: t + warmer_k for name, t in TEMPERATURES_C.items()}
        for machine_id in some:
            store_readings(context, machine_id, [Reading(datetime.now(UTC), temperatures_c, {})])

    read(ids, 0.0)
    before_mib = resident_mib()
    tables = TableServer(lambda: context, "opc.tcp://127.0.0.1:0/thermap")
    server = Server()
    await server.init()
    nodes = Nodes(server, await server.register_namespace(NAMESPACE))
    await nodes.begin("Machines")
    late_while_made: list[float] = []
    waking = asyncio.create_task(note_lateness(late_while_made))
    started = time.perf_counter()
    await tables._look(server, nodes)
    print(
        f"{n} machines: nodes made in {time.perf_counter() - started:.2f} s, "
        f"{resident_mib() - before_mib:.0f} MiB; a task wakes {_lateness(late_while_made)}"
    )
    waking.cancel()
    for what, some in (("nothing", []), ("every tenth", ids[::10]), ("every one", ids)):
        seconds: list[float] = []
        late_s: list[float] = []
        during: list[float] = []
        waking = asyncio.create_task(note_lateness(late_s))
        for number in range(ROUNDS):
            read(some, 0.1 * (number + 1))
            await asyncio.sleep(2 * WOKEN_EVERY_S)
            begun = len(late_s)  # what came before was late for the storing
            started = time.perf_counter()
            await tables._look(server, nodes)
            seconds.append(time.perf_counter() - started)
            during += late_s[begun:]
        waking.cancel()
        print(
            f"  {what} changed: round {statistics.median(seconds):.3f} s (longest "
            f"{max(seconds):.3f}); a task wakes {_lateness(during)}"
        )


def _lateness(late_s: Sequence[float]) -> str:
    late = sorted(late_s)
    return (
        f"{1e3 * statistics.median(late):.1f} ms late, 99 % within "
        f"{1e3 * late[int(0.99 * len(late))]:.1f} ms, longest {1e3 * late[-1]:.0f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=100)
    n = parser.parse_args().machines
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(measure(Path(folder), n))


if __name__ == "__main__":
    main()

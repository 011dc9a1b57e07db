"""Streams that nothing happens on, and how soon a change is in a follower's hand.

Followers of one machine on one worker: what each costs the service in memory and in processor time
while nothing changes; then readings come, each with another table, and all followers are told.

    python -m benchmarks.idle_streams [--streams 2000]
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import httpx

from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.http_table import SERVERS, server
from benchmarks.many_machines import resident_mib

ROOM = "/v1/machines/mcfv5050"
IDLE_S = 20.0
CHANGES = 15


class Follower:
    """One open stream, and when it was told of each table's reading."""

    def __init__(self) -> None:
        self.told: dict[bytes, float] = {}
        self.is_open = False

    async def run(self, port: int, opened: asyncio.Semaphore) -> None:
        async with opened:
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
            path = f"{ROOM}/compensation/stream"
            writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            await reader.readuntil(b"event: table")
            self.is_open = True
        while line := await reader.readline():
            _, found, rest = line.partition(b'"reading_time":"')
            if found:
                self.told.setdefault(rest.partition(b'"')[0], time.perf_counter())


def processor_s(port: int) -> float:
    """Processor time of the process that listens on a port [s]."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            command = (folder / "cmdline").read_bytes().split(b"\0")
            if str(port).encode() in command and b"--port" in command:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                return (int(fields[11]) + int(fields[12])) / 100.0
    raise RuntimeError(f"nothing listens on {port}")


async def store(client: httpx.AsyncClient, by_k: float) -> None:
    """Store a reading of now."""
    now = datetime.now(UTC).isoformat().replace("+00:00", "Z")
    warm = {sensor: t_c + by_k for sensor, t_c in TEMPERATURES_C.items()}
    reading = {"time": now, "temperatures_c": warm}
    (await client.post(f"{ROOM}/readings", json=reading)).raise_for_status()


async def measure(port: int, n: int) -> None:
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
        await store(client, 0.0)
        before = resident_mib(port)
        followers, opened = [Follower() for _ in range(n)], asyncio.Semaphore(50)
        tasks = [asyncio.create_task(one.run(port, opened)) for one in followers]
        while not all(one.is_open for one in followers):
            await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)
        print(f"{n} streams: {resident_mib(port) - before:.0f} MiB more than {before:.0f} MiB")
        used = processor_s(port)
        await asyncio.sleep(IDLE_S)
        print(f"idle: {100.0 * (processor_s(port) - used) / IDLE_S:.1f} % of a core")
        first, last = [], []
        for change in range(CHANGES):
            begun = time.perf_counter()
            await store(client, 0.2 * (change + 1))
            await asyncio.sleep(3.0)
            came = sorted(max(one.told.values()) for one in followers if one.told)
            came = [at for at in came if at > begun]
            if len(came) != n:
                print(f"change {change}: {len(came)} of {n} were told")
            first.append(came[0] - begun)
            last.append(came[-1] - begun)
        for who, after_s in (("first", first), ("last", last)):
            print(
                f"from the reading's post until the {who} follower is told: "
                f"{statistics.median(after_s):.3f} s in the median, longest {max(after_s):.3f} s"
            )
        for task in tasks:
            task.cancel()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--streams", type=int, default=2000)
    n = parser.parse_args().streams
    with tempfile.TemporaryDirectory() as folder:
        url = database_url(Path(folder))
        prepare_database(url)
        with server(SERVERS["thermap"], {"THERMAP_DATABASE_URL": url}) as port:
            asyncio.run(measure(port, n))


if __name__ == "__main__":
    main()

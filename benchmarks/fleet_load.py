"""Ten thousand machines, each asked for its table once a second, on one worker.

Requests are due at their times whether the service keeps up or not, and the time to an answer
counts from when it was due. First each machine is asked once, so that all are in memory; then
without a pause, then at half of what was answered then, and at last once a second for each
machine. Temperatures never repeat. Memory is read ten times.

    python -m benchmarks.fleet_load [--machines 10000] [--seconds 600]
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
import time
from collections import deque
from pathlib import Path

import httpx
import numpy as np

from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.http_table import SERVERS, server
from benchmarks.many_machines import multiply, resident_mib

CONNECTIONS = 32
TICK_S = 0.005
ROUNDS = 3
"""How often each machine is asked without a pause."""
TIMES_READ = 10


def body(number: int) -> bytes:
    """State temperatures that differ from those of every other number."""
    stated = ", ".join(
        f'"{sensor}": {value + 1e-7 * (number % 10**7):.7f}'
        for sensor, value in TEMPERATURES_C.items()
    )
    return f'{{"temperatures_c": {{{stated}}}}}'.encode()


def request(number: int, machines: int) -> bytes:
    """Write a request for the table of one machine after the other."""
    content = body(number)
    machine = f"m{1 + number % (machines - 1):05d}"
    return (
        f"POST /v1/machines/{machine}/compensation HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n\r\n"
    ).encode() + content


class Paced:
    """Sends requests at a rate; keeps how long after its time each was answered [s]."""

    def __init__(self, machines: int, rate: float) -> None:
        self.machines, self.rate = machines, rate
        self.due: deque[tuple[int, float]] = deque()
        self.came = asyncio.Semaphore(0)
        self.waits_s: list[float] = []

    async def connection(self, port: int) -> None:
        """Answer for what is due, one after the other."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while True:
            await self.came.acquire()
            number, due_at = self.due.popleft()
            writer.write(request(number, self.machines))
            head = await reader.readuntil(b"\r\n\r\n")
            if not head.startswith(b"HTTP/1.1 200"):
                raise RuntimeError(head.decode(errors="replace"))
            await reader.readexactly(int(head.lower().split(b"content-length:")[1].split(b"\r")[0]))
            self.waits_s.append(time.perf_counter() - due_at)

    async def run_flat_out(self, port: int, count: int) -> float:
        """Have so many answered without a pause; return how many a second."""
        began = time.perf_counter()
        for number in range(count):
            self.due.append((number, began))
            self.came.release()
        tasks = [asyncio.create_task(self.connection(port)) for _ in range(CONNECTIONS)]
        while len(self.waits_s) < count:
            for task in tasks:
                if task.done():
                    task.result()
            await asyncio.sleep(TICK_S)
        elapsed = time.perf_counter() - began
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return count / elapsed

    async def run(self, port: int, seconds: float) -> list[float]:
        """Send for so long; return the memory of the service on the way [MiB]."""
        tasks = [asyncio.create_task(self.connection(port)) for _ in range(CONNECTIONS)]
        began, sent, memory = time.perf_counter(), 0, [resident_mib(port)]
        while (elapsed := time.perf_counter() - began) < seconds:
            for task in tasks:
                if task.done():
                    task.result()
            while sent < elapsed * self.rate:
                self.due.append((sent, began + sent / self.rate))
                self.came.release()
                sent += 1
            if elapsed > seconds * len(memory) / TIMES_READ:
                memory.append(resident_mib(port))
            await asyncio.sleep(TICK_S)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return [*memory, resident_mib(port)]

    def told(self, seconds: float) -> str:
        """Say what came of it in a line of the table."""
        median, p99 = np.quantile(self.waits_s, [0.5, 0.99])
        return (
            f"| {self.rate:,.0f} | {len(self.waits_s) / seconds:,.0f} "
            f"| {1e3 * median:,.1f} ms | {1e3 * p99:,.1f} ms |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=600.0, help="of each of the two loads")
    stated = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        url = database_url(Path(folder))
        prepare_database(url)
        multiply(url, stated.machines)
        with server(SERVERS["thermap"], {"THERMAP_DATABASE_URL": url}) as port:
            while httpx.get(f"http://127.0.0.1:{port}/readyz").status_code != httpx.codes.OK:
                time.sleep(0.5)
            each_once, most = [
                asyncio.run(
                    Paced(stated.machines, 0.0).run_flat_out(port, rounds * stated.machines)
                )
                for rounds in (1, ROUNDS)
            ]
            print(f"each machine for the first time {each_once:,.0f} requests/s")
            print(f"without a pause {most:,.0f} requests/s; load {os.getloadavg()[0]:.0f}")
            print("| asked a second | answered a second | median | 99 % |")
            print("| --- | --- | --- | --- |")
            memory = []
            for rate in (most / 2.0, float(stated.machines)):
                paced = Paced(stated.machines, rate)
                memory.append(asyncio.run(paced.run(port, stated.seconds)))
                print(paced.told(stated.seconds), flush=True)
            for read in memory:
                print("memory [MiB]: " + ", ".join(f"{mib:.0f}" for mib in read))


if __name__ == "__main__":
    main()

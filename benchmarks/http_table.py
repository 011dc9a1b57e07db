"""POST …/compensation on one uvicorn worker, against a bare application and a straightforward one.

All three are measured in one run on one machine, in turn, several rounds; the
figures are the medians of the rounds and the ratios are taken within each round.

    python -m benchmarks.http_table
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import numpy as np

from benchmarks.example import TEMPERATURES_C, database_url, prepare_database

PATH = "/v1/machines/mcfv5050/compensation"
SERVERS = {
    "thermap": ["--factory", "benchmarks.example:make_thermap"],
    "bare ASGI": ["benchmarks.bare_app:app"],
    "straightforward": ["benchmarks.straightforward_app:app"],
}
LOADS = {
    "thermap, never the same": ("thermap", "fresh", 20_000),
    "bare ASGI": ("bare ASGI", "same", 20_000),
    "straightforward": ("straightforward", "same", 1_000),
}
"""Name to server, kind of bodies, and number of requests a round."""


def free_port() -> int:
    """Find a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@contextmanager
def server(arguments: list[str], environment: dict[str, str]) -> Iterator[int]:
    """Run uvicorn with one worker on a free port."""
    port = free_port()
    command = [sys.executable, "-m", "uvicorn", *arguments, "--port", str(port)]
    command += ["--no-access-log", "--log-level", "warning"]
    process = subprocess.Popen(command, env=os.environ | environment)
    try:
        for _ in range(200):
            try:
                httpx.get(f"http://127.0.0.1:{port}/healthz")
                break
            except httpx.TransportError:
                time.sleep(0.05)
        yield port
    finally:
        process.terminate()
        process.wait()


def write_bodies(folder: Path) -> dict[str, Path]:
    """Write the requests' bodies, one a line: one body, and such as never repeat."""
    rng = np.random.default_rng(8105)
    files = {}
    for kind, n in {"same": 1, "fresh": 20_000}.items():
        drawn = [{s: rng.uniform(20.5, 25.5) for s in TEMPERATURES_C} for _ in range(n)]
        lines = [json.dumps({"temperatures_c": one}) for one in drawn]
        files[kind] = folder / f"{kind}.jsonl"
        files[kind].write_text("\n".join(lines))
    return files


def measure(port: int, bodies: Path, requests: int, connections: int) -> tuple[float, ...]:
    """Let a process of its own make the load."""
    command = [sys.executable, "-m", "benchmarks.load", "--port", str(port), "--path", PATH]
    command += ["--bodies", str(bodies), "--requests", str(requests)]
    command += ["--connections", str(connections)]
    return tuple(float(x) for x in subprocess.check_output(command, text=True).split())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--connections", type=int, default=16)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, ExitStack() as running:
        folder = Path(name)
        url = database_url(folder)
        prepare_database(url)
        bodies = write_bodies(folder)
        answer = folder / "answer.json"
        environment = {"THERMAP_DATABASE_URL": url, "BENCHMARK_BODY": str(answer)}
        ports = {}
        for kind, arguments in SERVERS.items():
            ports[kind] = running.enter_context(server(arguments, environment))
            if kind == "thermap":
                answer.write_bytes(ask_once(ports[kind], bodies["same"].read_bytes()))
        report(rounds(ports, bodies, asked.rounds, asked.connections))


def ask_once(port: int, body: bytes) -> bytes:
    """Get the answer whose bytes the bare application returns."""
    url = f"http://127.0.0.1:{port}{PATH}"
    answer = httpx.post(url, content=body, headers={"content-type": "application/json"})
    components = answer.raise_for_status().json()["components"]
    print(
        f"Python {platform.python_version()}, {os.cpu_count()} cores; an answer of "
        f"{len(answer.content)} bytes, {len(components)} components"
    )
    return answer.content


def rounds(
    ports: dict[str, int], bodies: dict[str, Path], n: int, connections: int
) -> dict[str, list[tuple[float, ...]]]:
    """Measure the loads in turn, one warm-up round first."""
    figures: dict[str, list[tuple[float, ...]]] = {name: [] for name in LOADS}
    for i in range(n + 1):
        for name, (kind, body, requests) in LOADS.items():
            figure = measure(ports[kind], bodies[body], requests, connections)
            if i:
                figures[name].append(figure)
    return figures


def report(figures: dict[str, list[tuple[float, ...]]]) -> None:
    """Print medians, and ratios taken within each round."""
    for name, rows in figures.items():
        rate, median_s, p99_s = (statistics.median(column) for column in zip(*rows, strict=True))
        print(
            f"{name:27s} {rate:8.0f} requests/s   median {median_s * 1e3:7.2f} ms"
            f"   99 % {p99_s * 1e3:7.2f} ms"
        )
    for ours in (name for name in LOADS if name.startswith("thermap")):
        for other in ("bare ASGI", "straightforward"):
            pairs = zip(figures[ours], figures[other], strict=True)
            ratios = [a[0] / b[0] for a, b in pairs]
            print(
                f"{ours:27s} / {other:16s} {statistics.median(ratios):7.2f}"
                f"   ({min(ratios):.2f} to {max(ratios):.2f})"
            )


if __name__ == "__main__":
    main()

"""How long the live table waits at most while long bodies are read, checked and answered.

A million points of the volumetric error, and a verification of 100,000 observations, are sent
to `thermap serve` by a process of their own. Beside them the live table is asked every 10 ms.

    python -m benchmarks.beside_long_bodies
"""

from __future__ import annotations

import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.http_table import free_port

MACHINE = "/v1/machines/mcfv5050"
POINTS = 1_000_000
OBSERVATIONS = 100_000
START = datetime(2026, 3, 1, tzinfo=UTC)


@contextmanager
def service(url: str) -> Iterator[str]:
    """Run `thermap serve`."""
    port = free_port()
    command = [sys.executable, "-m", "app", "serve", "--port", str(port), "--database-url", url]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=os.environ)
    base = f"http://127.0.0.1:{port}"
    try:
        for _ in range(400):
            try:
                httpx.get(f"{base}/healthz")
                break
            except httpx.TransportError:
                time.sleep(0.05)
        yield base
    finally:
        process.terminate()
        process.wait()


def points() -> dict[str, Any]:
    """Ask at random points."""
    rng = np.random.default_rng(8105)
    drawn = np.round(rng.uniform(0.0, 300.0, (POINTS, 3)), 3)
    return {
        "temperatures_c": TEMPERATURES_C,
        "points_mm": drawn.tolist(),
        "missing_components": "zero",
        "outside_travel": "allow",
    }


def readings() -> list[dict[str, Any]]:
    """Record two thousand minutes, so that the observations can be judged."""
    return [
        {
            "time": (START + timedelta(minutes=i)).isoformat(),
            "temperatures_c": {s: t + 0.5 * np.sin(i / 100) for s, t in TEMPERATURES_C.items()},
        }
        for i in range(2000)
    ]


def verification() -> dict[str, Any]:
    """Observe four components and, one time in five, points."""
    rng = np.random.default_rng(8106)
    observations = []
    for i in range(OBSERVATIONS):
        said: dict[str, Any] = {"time": (START + timedelta(seconds=1.2 * i)).isoformat()}
        said["state"] = {"spindle_rpm": 0.0}
        if i % 5:
            said["component"] = ("EXX", "EYY", "EZZ", "EYX")[i % 4]
            said |= {"position_mm": 15.0 * float(rng.integers(21)), "direction": "+"}
            said["measured_um"] = round(rng.normal(), 3)
        else:
            said |= {"point_mm": [float(rng.integers(300)), 10.0, 20.0]}
            said |= {"tool_offset_mm": [0.0, 0.0, 150.0]}
            said["measured_um"] = np.round(rng.normal(size=3), 3).tolist()
        observations.append(said)
    return {"label": "large", "observations": observations}


def send(url: str, body: bytes) -> None:
    """Post a body."""
    headers = {"content-type": "application/json"}
    httpx.post(url, content=body, headers=headers, timeout=600.0).raise_for_status()


def waits_beside(base: str, path: str, said: object) -> tuple[list[float], float]:
    """Ask for the table every 10 ms until a body has been answered: each wait, and in all [s]."""
    body = json.dumps(said).encode()
    sender = multiprocessing.Process(target=send, args=(base + path, body))
    waits = []
    with httpx.Client(base_url=base, timeout=60.0) as client:
        began = time.perf_counter()
        sender.start()
        while sender.is_alive():
            asked = {s: t + 1e-6 * len(waits) for s, t in TEMPERATURES_C.items()}
            started = time.perf_counter()
            client.post(f"{MACHINE}/compensation", json={"temperatures_c": asked})
            waits.append(time.perf_counter() - started)
            time.sleep(0.01)
        lasted = time.perf_counter() - began
    if sender.exitcode:
        raise RuntimeError(f"{path} was not answered")
    return waits, lasted


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        url = database_url(Path(name))
        prepare_database(url)
        with service(url) as base:
            send(f"{base}{MACHINE}/readings", json.dumps(readings()).encode())
            for path, said in (
                (f"{MACHINE}/volumetric-error", points()),
                (f"{MACHINE}/verifications", verification()),
            ):
                waits, lasted = waits_beside(base, path, said)
                print(
                    f"{path:40s} {lasted:6.1f} s   {len(waits)} tables beside it: "
                    f"median {statistics.median(waits) * 1e3:.1f} ms, "
                    f"longest {max(waits) * 1e3:.0f} ms"
                )


if __name__ == "__main__":
    main()

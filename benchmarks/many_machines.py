"""Ten thousand machines with three maps each: memory, and the time to the first table of any.

The database is filled by copying the example machine inside SQLite. The service
is started on it; asked at once for machines drawn at random, which are not in
memory yet, and again when all are.

    python -m benchmarks.many_machines [--machines 10000]
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import tempfile
import time
from pathlib import Path

import httpx
from sqlalchemy import text

from app.storage.database import Database
from benchmarks.example import TEMPERATURES_C, database_url, prepare_database
from benchmarks.http_table import SERVERS, server

ASKED = 200


def multiply(url: str, n: int) -> None:
    """Copy the example machine, its maps and its active version n − 1 times."""
    database = Database(url)
    with database.writing() as session:
        source = "mcfv5050"
        columns = (
            "name, configuration, axes, sensors, out_of_range, extrapolation_margin_c, "
            "extrapolation_error_ratio, "
            "same_temperature, active_version, revision, created_at"
        )
        map_columns = (
            "label, measured_at, temperatures_c, measuring_lines_mm, repeatability_um, "
            "instrument, stored_at, withdrawn_at"
        )
        numbers = (
            f"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {n - 1})"
        )
        for statement in (
            f"{numbers} INSERT INTO machine (id, {columns}) "
            f"SELECT printf('m%05d', i), {columns} FROM n, machine WHERE id = :source",
            f"{numbers} INSERT INTO error_map (id, machine_id, {map_columns}) "
            f"SELECT id + 3 * i, printf('m%05d', i), {map_columns} FROM n, error_map "
            "WHERE machine_id = :source",
            f"{numbers} INSERT INTO error_map_component "
            "SELECT c.error_map_id + 3 * i, c.component, c.place, c.positions_mm, c.errors, "
            "c.backward_errors, c.covariance, c.backward_covariance "
            "FROM n, error_map_component c WHERE c.error_map_id <= 3",
            f"{numbers} INSERT INTO model_version (machine_id, version, created_at, reason, "
            "assignment, effects) SELECT printf('m%05d', i), version, created_at, reason, "
            "assignment, effects FROM n, model_version WHERE machine_id = :source AND version = 3",
            f"{numbers} INSERT INTO model_version_map (machine_id, version, error_map_id) "
            "SELECT printf('m%05d', i), version, error_map_id + 3 * i FROM n, model_version_map "
            "WHERE machine_id = :source AND version = 3",
        ):
            session.execute(text(statement), {"source": source} if ":source" in statement else {})
    database.close()


def process_of(port: int) -> Path:
    """Find the folder below /proc of the process that listens on a port."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            command = (folder / "cmdline").read_bytes().split(b"\0")
            if str(port).encode() in command and b"--port" in command:
                return folder
    raise RuntimeError(f"nothing listens on {port}")


def resident_mib(port: int) -> float:
    """Resident memory of the process that listens on a port [MiB]."""
    status = (process_of(port) / "status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def first_tables(client: httpx.Client, n: int) -> list[float]:
    """Time the table of machines drawn at random [s]."""
    seconds = []
    for number in random.sample(range(1, n), ASKED):
        started = time.perf_counter()
        answer = client.post(
            f"/v1/machines/m{number:05d}/compensation",
            content=json.dumps({"temperatures_c": TEMPERATURES_C}),
            headers={"content-type": "application/json"},
        )
        seconds.append(time.perf_counter() - started)
        answer.raise_for_status()
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=10_000)
    n = parser.parse_args().machines
    random.seed(8105)
    with tempfile.TemporaryDirectory() as folder:
        url = database_url(Path(folder))
        prepare_database(url)
        with server(SERVERS["thermap"], {"THERMAP_DATABASE_URL": url}) as port:
            time.sleep(3)
            print(f"one machine:     {resident_mib(port):7.0f} MiB resident")
        multiply(url, n)
        size = (Path(folder) / "benchmark.db").stat().st_size / 2**20
        print(f"{n} machines:  {size:7.0f} MiB database")
        started = time.perf_counter()
        with (
            server(SERVERS["thermap"], {"THERMAP_DATABASE_URL": url}) as port,
            httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client,
        ):
            print(f"first answer after start {time.perf_counter() - started:5.1f} s")
            show("while machines are being loaded", first_tables(client, n))
            while client.get("/readyz").status_code != 200:
                time.sleep(0.5)
            print(f"all in memory after      {time.perf_counter() - started:5.1f} s")
            print(f"resident memory          {resident_mib(port):5.0f} MiB")
            show("when all are in memory", first_tables(client, n))


def show(when: str, seconds: list[float]) -> None:
    """Print the time to the first table of a machine."""
    print(
        f"first table {when}: median {statistics.median(seconds) * 1e3:.1f} ms, "
        f"longest of {len(seconds)} {max(seconds) * 1e3:.1f} ms"
    )


if __name__ == "__main__":
    main()

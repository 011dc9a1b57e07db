"""How many readings are stored durably in a second, against what the database itself inserts.

Readings of one machine are sent to `thermap serve` on PostgreSQL in batches of 1, 100 and 1000 by
several clients at once, and counted when they are answered with 201. Right after each, pgbench
inserts the same rows into a table of the same columns and keys, in transactions of as many rows, by
as many clients. So each ratio is of one minute on one disk.

    python -m benchmarks.readings [--server postgresql://postgres@127.0.0.1:5432/postgres]
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import tempfile
import threading
import time
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import httpx
import psycopg
from sqlalchemy import make_url

from benchmarks.example import TEMPERATURES_C, prepare_database
from benchmarks.replicas import ROOM, scratch_database, service

BATCHES = (1, 100, 1000)
CLIENTS = 4
START = datetime(2020, 1, 1, tzinfo=UTC)

BARE_TABLE = """
CREATE TABLE bare_machine (id varchar(64) PRIMARY KEY);
INSERT INTO bare_machine VALUES ('mcfv5050');
CREATE TABLE bare (
    id bigserial PRIMARY KEY,
    machine_id varchar(64) NOT NULL REFERENCES bare_machine (id),
    time timestamptz NOT NULL,
    temperatures_c json NOT NULL,
    state json NOT NULL,
    early_s double precision,
    UNIQUE (machine_id, time)
);
CREATE SEQUENCE bare_time;
"""


def pgbench() -> str:
    """Find pgbench, which Debian keeps beside the server."""
    beside = sorted(Path("/usr/lib/postgresql").glob("*/bin/pgbench"))
    found = shutil.which("pgbench") or (str(beside[-1]) if beside else None)
    if found is None:
        raise SystemExit("pgbench is not installed: it comes with PostgreSQL")
    return found


def of_thermap(base: str, batch: int, seconds: float, numbers: count[int]) -> float:
    """Send batches from all clients; say how many readings a second were stored."""
    stored = []
    end = time.perf_counter() + seconds

    def send() -> None:
        with httpx.Client(base_url=base, timeout=120.0) as client:
            while time.perf_counter() < end:
                first = START + timedelta(seconds=1000 * next(numbers))
                body = [
                    {
                        "time": (first + timedelta(seconds=i)).isoformat(),
                        "temperatures_c": TEMPERATURES_C,
                    }
                    for i in range(batch)
                ]
                answer = client.post(f"{ROOM}/readings", json=body)
                answer.raise_for_status()
                stored.append(answer.json()["stored"])

    began = time.perf_counter()
    threads = [threading.Thread(target=send) for _ in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(stored) / (time.perf_counter() - began)


def of_pgbench(url: str, batch: int, seconds: float) -> float:
    """Let pgbench insert as many rows at a time; say how many rows a second."""
    temperatures = str(TEMPERATURES_C).replace("'", '"')
    script = (
        "INSERT INTO bare (machine_id, time, temperatures_c, state) "
        "SELECT 'mcfv5050', to_timestamp(nextval('bare_time')), "
        f"'{temperatures}', '{{}}' FROM generate_series(1, {batch});"
    )
    plain = make_url(url).set(drivername="postgresql").render_as_string(hide_password=False)
    with tempfile.NamedTemporaryFile("w", suffix=".sql") as file:
        file.write(script)
        file.flush()
        command = [pgbench(), "-n", "-M", "prepared", "-c", str(CLIENTS), "-T", f"{seconds:.0f}"]
        ran = subprocess.run(
            [*command, "-f", file.name, plain], check=True, capture_output=True, text=True
        )
    found = re.search(r"tps = ([\d.]+)", ran.stdout)
    if found is None:
        raise RuntimeError(ran.stdout)
    return batch * float(found[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", default="postgresql://postgres@127.0.0.1:5432/postgres")
    parser.add_argument("--seconds", type=float, default=10.0, help="each measurement")
    stated = parser.parse_args()
    numbers = count()
    with ExitStack() as stack:
        url = stack.enter_context(scratch_database(stated.server))
        prepare_database(url)
        plain = make_url(url).set(drivername="postgresql").render_as_string(hide_password=False)
        with psycopg.connect(plain) as connection:
            connection.execute(BARE_TABLE)
        base = stack.enter_context(service(url))
        print("| readings in a batch | thermap, readings/s | pgbench, rows/s | ratio |")
        print("| --- | --- | --- | --- |")
        for batch in BATCHES:
            ours = of_thermap(base, batch, stated.seconds, numbers)
            bare = of_pgbench(url, batch, stated.seconds)
            print(f"| {batch} | {ours:,.0f} | {bare:,.0f} | {ours / bare:.2f} |")


if __name__ == "__main__":
    main()

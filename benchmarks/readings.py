"""How many readings are stored durably in a second, against what the database itself inserts.

Readings of one machine are sent to `thermap serve` on PostgreSQL in batches of 1, 100 and 1000 over
several connections at once, and counted in the table. Right after each, pgbench inserts rows of the
same texts into a table of the same columns and keys, in transactions of as many rows, over as many
connections. All of them share the machine's cores with the load that is made, so each ratio is of
one minute on one disk. pgbench inserts in two ways:

- it sends the rows, as any client has to that has readings: one statement of many values;
- the server makes them up itself (`generate_series`) in a statement that it knows already: nothing
  is sent and nothing read, which is the most that the table takes.

Beside them a bare application on the same HTTP server hands the same bodies to the same table, and
does nothing else (`bare_readings_app`): how much of the rate Python and HTTP leave.

    python -m benchmarks.readings [--server postgresql://postgres@127.0.0.1:5432/postgres]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from urllib.parse import urlsplit

import psycopg
from sqlalchemy import make_url

from benchmarks.example import TEMPERATURES_C, prepare_database
from benchmarks.http_table import server
from benchmarks.load import run_load
from benchmarks.replicas import ROOM, scratch_database, service

BATCHES = (1, 100, 1000)
CLIENTS = 4
START = datetime(2000, 1, 1, tzinfo=UTC)
PLACE = "0001-01-01T00"
"""Where a body says its hour: each has one of its own."""

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

HEAD = """\
| readings in a batch | thermap, readings/s | bare application | pgbench, rows sent | rows made up \
| thermap of rows sent | of rows made up | bare of rows sent | load |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""

INSERT = "INSERT INTO bare (machine_id, time, temperatures_c, state)"


def temperatures(second: int) -> str:
    """Write the temperatures of one reading: they move."""
    return json.dumps(
        {sensor: round(t + 0.01 * (second % 7), 2) for sensor, t in TEMPERATURES_C.items()}
    )


def bodies(batch: int, hours: Iterator[int]) -> Iterator[bytes]:
    """Write batches, each of an hour of its own, one reading a second."""
    readings = [
        f'{{"time":"{PLACE}:{i // 60:02d}:{i % 60:02d}Z","temperatures_c":{temperatures(i)}}}'
        for i in range(batch)
    ]
    body, place = f"[{','.join(readings)}]".encode(), PLACE.encode()
    for hour in hours:
        yield body.replace(
            place, (START + timedelta(hours=hour)).isoformat()[: len(PLACE)].encode()
        )


def of_service(address: str, table: str, url: str, sent: Iterator[bytes], seconds: float) -> float:
    """Send batches over all connections; say how many readings a second were stored.

    Parameters
    ----------
    table
        Where they are looked for after.
    sent
        One after another.
    """
    at = urlsplit(address)
    before = number_of_rows(url, table)

    def rate_of(wanted: int) -> float:
        asked = (str(at.hostname), int(at.port or 0), at.path, sent)
        rate, *_ = asyncio.run(run_load(*asked, wanted, CLIENTS))
        return rate

    first = 10 * CLIENTS
    wanted = max(first, round(seconds * rate_of(first)))
    rate = rate_of(wanted)
    batch = next(sent).count(b"time")
    if number_of_rows(url, table) - before < (first + wanted) * batch:
        raise RuntimeError("fewer readings are in the table than were answered as stored")
    return batch * rate


def of_pgbench(url: str, script: str, protocol: str, batch: int, seconds: float) -> float:
    """Let pgbench insert as many rows at a time; say how many rows a second."""
    with tempfile.NamedTemporaryFile("w", suffix=".sql") as file:
        file.write(script)
        file.flush()
        command = [pgbench(), "-n", "-M", protocol, "-c", str(CLIENTS), "-T", f"{seconds:.0f}"]
        ran = subprocess.run(
            [*command, "-D", "hour=0", "-f", file.name, url],
            check=True,
            capture_output=True,
            text=True,
        )
    found = re.search(r"tps = ([\d.]+)", ran.stdout)
    if found is None:
        raise RuntimeError(ran.stdout)
    return batch * float(found[1])


def rows_sent(batch: int) -> str:
    """Write a script that sends all rows: each client has hours of its own."""
    rows = [
        f"('mcfv5050', to_timestamp((:client_id * 100000 + :hour) * 3600 + {i}), "
        f"'{temperatures(i)}', '{{}}')"
        for i in range(batch)
    ]
    return f"\\set hour :hour + 1\n{INSERT} VALUES {', '.join(rows)};"


def rows_made(batch: int) -> str:
    """Write a script that lets the server make the rows."""
    return (
        f"{INSERT} SELECT 'mcfv5050', to_timestamp(nextval('bare_time')), "
        f"'{temperatures(0)}', '{{}}' FROM generate_series(1, {batch});"
    )


def pgbench() -> str:
    """Find pgbench, which Debian keeps beside the server."""
    beside = sorted(Path("/usr/lib/postgresql").glob("*/bin/pgbench"))
    found = shutil.which("pgbench") or (str(beside[-1]) if beside else None)
    if found is None:
        raise SystemExit("pgbench is not installed: it comes with PostgreSQL")
    return found


def number_of_rows(url: str, table: str) -> int:
    """Count what is stored."""
    with psycopg.connect(url) as connection:
        row = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
    assert row is not None
    return int(row[0])


def emptied(url: str) -> None:
    """Empty the bare table: times begin anew, and no run inserts into more than another."""
    with psycopg.connect(url) as connection:
        connection.execute("TRUNCATE bare")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", default="postgresql://postgres@127.0.0.1:5432/postgres")
    parser.add_argument("--seconds", type=float, default=10.0, help="each measurement")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--batches", type=int, nargs="+", default=BATCHES)
    stated = parser.parse_args()
    hours = count()
    with ExitStack() as stack:
        url = stack.enter_context(scratch_database(stated.server))
        prepare_database(url)
        plain = make_url(url).set(drivername="postgresql").render_as_string(hide_password=False)
        with psycopg.connect(plain) as connection:
            connection.execute(BARE_TABLE)
        base = stack.enter_context(service(url))
        floor = stack.enter_context(
            server(["benchmarks.bare_readings_app:app"], {"BENCHMARK_POSTGRESQL": plain})
        )
        print(HEAD)
        services = ((f"{base}{ROOM}/readings", "reading"), (f"http://127.0.0.1:{floor}/", "bare"))
        for batch in stated.batches:
            rounds = []
            for _ in range(stated.rounds):
                measured = []
                for address, table in services:
                    sent = bodies(batch, hours)
                    measured.append(of_service(address, table, plain, sent, stated.seconds))
                for script, protocol in ((rows_sent, "simple"), (rows_made, "prepared")):
                    emptied(plain)
                    asked = (script(batch), protocol, batch, stated.seconds)
                    measured.append(of_pgbench(plain, *asked))
                emptied(plain)
                rounds.append(measured)
            print(line(batch, rounds), flush=True)


def line(batch: int, rounds: list[list[float]]) -> str:
    """Say the medians of all rounds; ratios are taken within a round."""
    rates = [statistics.median(rates) for rates in zip(*rounds, strict=True)]
    ratios = [statistics.median(r[i] / r[j] for r in rounds) for i, j in ((0, 2), (0, 3), (1, 2))]
    shown = [*(f"{rate:,.0f}" for rate in rates), *(f"{ratio:.2f}" for ratio in ratios)]
    return f"| {batch} | {' | '.join(shown)} | {os.getloadavg()[0]:.0f} |"


if __name__ == "__main__":
    main()

"""How soon a year of readings each second is on the screen.

A machine's four sensors are read each second for some days up to now. The database writes the
readings itself, since it is not storing them that is measured; the service's binner brings them
into hours. Then `thermap serve` is started and asked for what the page of a machine over time
asks: four sensors and the compensation of EXX at a place. The first answer after the start is
printed, and the median of the next ones; and, in Chromium, the time from opening the page, and
from choosing another span on it, to the drawn picture.

    python -m benchmarks.history [--days 366] [--server postgresql://postgres@127.0.0.1:5432/postgres]

A year takes some 7 GB in a temporary folder, and as much on the server.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
from sqlalchemy import text

from app.services.bin_readings import ReadingBinner
from app.services.context import Context
from app.simulation.example.machine import SENSORS
from app.storage.database import Database
from app.storage.partitions import make_months
from app.storage.readings import newest_id
from app.storage.temperature_hours import binned_up_to
from benchmarks.example import database_url, prepare_database
from benchmarks.growth import processor_s
from benchmarks.many_machines import process_of
from benchmarks.replicas import scratch_database, service

ASKED = 10
POINTS = 1100
"""As the page asks for, 1,200 px wide."""
CHUNK_S = 86_400
SPANS_S = {"year": 366 * 86_400, "month": 30 * 86_400, "day": 86_400, "hour": 3600}
LOOK_EVERY_S = 30.0

TEMPERATURE = "round({ambient} + 3 * CAST(sin(s / 13751.0) AS numeric) + 0.05 * (s % 7), 2)"
"""[°C], at a second; it turns once a day."""

SECONDS = {
    "sqlite": (
        "WITH RECURSIVE t(s) AS (SELECT :since UNION ALL SELECT s + 1 FROM t WHERE s < :until - 1) "
        "INSERT INTO reading (machine_id, time, temperatures_c, state) "
        "SELECT 'mcfv5050', strftime('%Y-%m-%d %H:%M:%S', s, 'unixepoch') || '.000000', "
        "json_object({temperatures}), '{{}}' FROM t"
    ),
    "postgresql": (
        "INSERT INTO reading (machine_id, time, temperatures_c, state) "
        "SELECT 'mcfv5050', to_timestamp(s), json_build_object({temperatures}), '{{}}' "
        "FROM (SELECT s::numeric FROM generate_series(:since, :until - 1) s) t"
    ),
}


def fill(url: str, days: int) -> None:
    """Store readings each second up to now, and bin them; print how long both took."""
    prepare_database(url)
    database = Database(url)
    kind = "sqlite" if database.is_sqlite else "postgresql"
    until = datetime.now(UTC).replace(microsecond=0)
    since = until - timedelta(days=days)
    temperatures = ", ".join(
        f"'{sensor}', {TEMPERATURE.format(ambient=21 + i)}" for i, sensor in enumerate(SENSORS)
    )
    statement = text(SECONDS[kind].format(temperatures=temperatures))
    if kind == "postgresql":  # which makes a month when it begins
        with database.writing() as session:
            for day in range(days + 1):
                make_months(session.connection(), since + timedelta(days=day))
    began = time.perf_counter()
    first = int(since.timestamp())
    for chunk in range(first, int(until.timestamp()), CHUNK_S):
        with database.writing() as session:
            session.execute(statement, {"since": chunk, "until": chunk + CHUNK_S})
    written_s = time.perf_counter() - began
    began = time.perf_counter()
    binner = ReadingBinner(Context(database))
    while True:
        binner.look()
        with database.reading() as session:
            newest = newest_id(session)
            if binned_up_to(session) == newest:
                break
        time.sleep(LOOK_EVERY_S)
    binned_s = time.perf_counter() - began
    database.close()
    print(
        f"\n{kind}: {newest:,} readings of {len(SENSORS)} sensors, written by the database in "
        f"{written_s:,.0f} s, binned in {binned_s:,.0f} s",
        flush=True,
    )


def ask(client: httpx.Client, span_s: float) -> tuple[float, int]:
    """Ask for a span up to now; say how long the answer took [s], and how many bins it has."""
    until = datetime.now(UTC)
    query = {
        "from": (until - timedelta(seconds=span_s)).isoformat(),
        "to": until.isoformat(),
        "points": POINTS,
        "sensor": list(SENSORS),
        "component": "EXX",
        "position_mm": 250.0,
    }
    began = time.perf_counter()
    answer = client.get("/v1/machines/mcfv5050/history", params=query)
    took_s = time.perf_counter() - began
    return took_s, len(answer.raise_for_status().json()["sensors"][0]["after_s"])


def show_answers(url: str) -> None:
    """Print a row for each span: after a start of the service, and after that."""
    print(
        "| shown | bins | first answer after a start | median of the next | longest "
        "| processor time of each |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for name, span_s in SPANS_S.items():
        with (
            service(url, "--insecure") as base,
            httpx.Client(base_url=base, timeout=600.0) as client,
        ):
            process = process_of(int(base.rpartition(":")[2]))
            first_s, bins = ask(client, span_s)
            began_s = processor_s(process)
            next_s = [ask(client, span_s)[0] for _ in range(ASKED)]
            used_s = (processor_s(process) - began_s) / ASKED
        print(
            f"| a {name} | {bins:,} | {first_s:.2f} s | {statistics.median(next_s):.2f} s "
            f"| {max(next_s):.2f} s | {used_s:.2f} s |",
            flush=True,
        )


def show_pages(url: str) -> None:
    """Print how long it takes until Chromium has drawn a year, and then other spans."""
    from playwright.sync_api import Page, sync_playwright

    def drawn(page: Page, act: Callable[[], object]) -> float:
        with page.expect_response(lambda answer: "/history?" in answer.url):
            began = time.perf_counter()
            act()
        page.locator("#drawing svg text.h").first.wait_for()
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => setTimeout(done)))")
        return time.perf_counter() - began

    with service(url, "--insecure") as base, sync_playwright() as driver:
        chromium = shutil.which("chromium")
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1366, "height": 900})
        year = f"{base}/machines/mcfv5050/history#span={SPANS_S['year']}&component=EXX"
        year += "".join(f"&sensor={sensor}" for sensor in SENSORS)
        print(f"Chromium: page opened with a year {drawn(page, lambda: page.goto(year)):.2f} s")
        for name, span_s in [*SPANS_S.items()][1:] + [*SPANS_S.items()][:1]:
            button = page.locator(f"[data-span='{span_s}']")
            print(f"Chromium: a {name} chosen on it {drawn(page, button.click):.2f} s", flush=True)
        browser.close()


def measure(url: str, days: int) -> None:
    fill(url, days)
    show_answers(url)
    show_pages(url)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--days", type=int, default=366)
    parser.add_argument("--server", default="postgresql://postgres@127.0.0.1:5432/postgres")
    parser.add_argument("--only", choices=("sqlite", "postgresql"))
    stated = parser.parse_args()
    if stated.only != "postgresql":
        with tempfile.TemporaryDirectory() as folder:
            measure(database_url(Path(folder)), stated.days)
    if stated.only != "sqlite":
        with scratch_database(stated.server) as url:
            measure(url, stated.days)


if __name__ == "__main__":
    main()

"""What grows with the number of positions, components, maps and machines, and how fast.

From one machine of 12 components × 21 positions in three maps one number is changed at a time.
Times are the processor's, of one thread, and so the same beside other work but for caches:
storing the last map (with the version that it makes, on SQLite), bringing the maps together when
the machine is loaded, one table, and one table written as JSON. Machines are
asked over HTTP, each at random, of a service with all of them in memory.

    python -m benchmarks.growth [--machines 3000] [--plot growth.png]

The plot is made by plotly and photographed by Chromium (the extra `test`).
"""

from __future__ import annotations

import argparse
import http.client
import os
import random
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import numpy as np

from app.api.table_json import table_json
from app.geometry.components import COMPONENTS
from app.live.registry import LiveModel
from app.services.context import Context
from app.services.error_maps import store_error_map
from app.services.live_table import table_at
from app.services.machines import create_machine
from app.simulation.example.machine import example_machine
from app.storage.database import Database
from app.storage.migrate import upgrade
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from benchmarks.example import database_url, prepare_database
from benchmarks.fleet_load import body
from benchmarks.http_table import SERVERS, server
from benchmarks.many_machines import multiply, process_of, resident_mib

NOW = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)
SENSORS = ("x-middle", "y-front", "z-column", "spindle")
AT_LEAST_S = 0.2
CODES = (
    *("EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ", "SXY", "SYZ", "SZX"),
    *("EAX", "EBX", "ECX", "EAY", "EBY", "ECY", "EAZ", "EBZ", "ECZ"),
    *("EXX^y", "EXX^z", "EYX^y", "EYX^z", "EZX^y", "EZX^z", "EXY^x", "EXY^z", "EYY^x"),
    *("EYY^z", "EZY^x", "EZY^z", "EXZ^x", "EXZ^y", "EYZ^x", "EYZ^y", "EZZ^x", "EZZ^y"),
)
BASE = {"positions": 21, "components": 12, "maps": 3}
VARIED = {
    "positions": (6, 21, 51, 101, 201, 501, 1001, 2001),
    "components": (1, 3, 6, 12, 21, 39),
    "maps": (2, 3, 6, 12, 25, 50),
}
MACHINES = (1, 30, 300, 3000, 10_000)
ASKED = 3000
COLUMNS = ("store the last map", "load the machine", "a table", "a table as JSON")


@dataclass(frozen=True)
class Cost:
    """Processor time of each of `COLUMNS` [ms], and the bytes of an answer."""

    milliseconds: tuple[float, ...]
    answer_bytes: int


def error_maps(positions: int, components: int, maps: int) -> list[ErrorMap]:
    """Make maps whose temperatures lie far enough apart for every sensor."""
    rng = np.random.default_rng(14)
    x = np.linspace(0.0, 400.0, positions)
    found = []
    for number in range(maps):
        tables = {
            code: ComponentTable.make(
                COMPONENTS[code],
                rng.normal(0.0, 5.0, x.size if COMPONENTS[code].is_table else 1),
                x if COMPONENTS[code].is_table else (),
            )
            for code in CODES[:components]
        }
        temperatures_c = dict.fromkeys(SENSORS, 18.0 + 0.2 * number)
        found.append(
            ErrorMap(
                label=f"{number}",
                measured_at=NOW + timedelta(hours=number),
                temperatures_c=temperatures_c,
                tables=tables,
            )
        )
    return found


def processor_ms(call: Callable[[], object]) -> float:
    """Processor time of a call [ms]: the fastest of three batches of enough repetitions."""
    repetitions = 1
    fastest = np.inf
    batches = 0
    while batches < 3:
        began = time.process_time()
        for _ in range(repetitions):
            call()
        elapsed = time.process_time() - began
        if elapsed < AT_LEAST_S / 4.0:
            repetitions *= 4
            continue
        batches += 1
        fastest = min(fastest, elapsed / repetitions)
    return 1e3 * float(fastest)


def cost_of(positions: int, components: int, maps: int) -> Cost:
    """Measure one size of model."""
    made = error_maps(positions, components, maps)
    machine = example_machine()
    with tempfile.TemporaryDirectory() as folder:
        context = Context(Database(database_url(Path(folder))))
        upgrade(context.database)
        create_machine(context, machine)
        for one in made[:-1]:
            store_error_map(context, machine.id, one)
        began = time.process_time()
        store_error_map(context, machine.id, made[-1])
        stored_ms = 1e3 * (time.process_time() - began)
        context.database.close()
    model = compile_model(machine, made, {})
    live = LiveModel(model, 1, created_at=NOW, revision=1, loaded_at=NOW)
    at = dict.fromkeys(SENSORS, 18.0 + 0.2 * (maps - 1.5))
    return Cost(
        (
            stored_ms,
            processor_ms(lambda: compile_model(machine, made, {})),
            processor_ms(lambda: table_at(live, at, NOW)),
            processor_ms(lambda: table_json(table_at(live, at, NOW))),
        ),
        len(table_json(table_at(live, at, NOW))),
    )


def show_models() -> dict[str, dict[int, Cost]]:
    """Print a table for each number that is changed."""
    found: dict[str, dict[int, Cost]] = {}
    for name, sizes in VARIED.items():
        print(f"\n| {name} | " + " | ".join(COLUMNS) + " | bytes |")
        print("| --- " * (len(COLUMNS) + 2) + "|")
        found[name] = {}
        for size in sizes:
            cost = found[name][size] = cost_of(**(BASE | {name: size}))
            times = " | ".join(f"{ms:,.3g} ms" for ms in cost.milliseconds)
            print(f"| {size:,} | {times} | {cost.answer_bytes:,} |", flush=True)
    return found


@dataclass(frozen=True)
class Fleet:
    """What a service with so many machines takes."""

    ready_s: float
    resident_mib: float
    table_ms: float


def show_fleets(most: int) -> dict[int, Fleet]:
    """Print a table over the number of machines."""
    print("\n| machines | all in memory after | memory | a table over HTTP |")
    print("| --- | --- | --- | --- |")
    found = {}
    for machines in [n for n in MACHINES if n <= most]:
        fleet = found[machines] = fleet_of(machines)
        print(
            f"| {machines:,} | {fleet.ready_s:,.1f} s | {fleet.resident_mib:,.0f} MiB "
            f"| {fleet.table_ms:.3g} ms |",
            flush=True,
        )
    return found


def fleet_of(machines: int) -> Fleet:
    """Start a service on so many machines, and ask for the table of each at random.

    Both times are the processor's, of the service.
    """
    random.seed(8105)
    with tempfile.TemporaryDirectory() as folder:
        url = database_url(Path(folder))
        prepare_database(url)
        multiply(url, machines)
        with server(SERVERS["thermap"], {"THERMAP_DATABASE_URL": url}) as port:
            process = process_of(port)
            while httpx.get(f"http://127.0.0.1:{port}/readyz").status_code != httpx.codes.OK:
                time.sleep(0.2)
            ready_s = processor_s(process)
            client = http.client.HTTPConnection("127.0.0.1", port)
            # What is remembered of each machine's table is made when it is first asked for.
            ask(client, range(machines))
            chosen = random.choices(range(machines), k=ASKED)
            began = processor_s(process)
            ask(client, chosen)
            table_ms = 1e3 * (processor_s(process) - began) / ASKED
            return Fleet(ready_s, resident_mib(port), table_ms)


def ask(client: http.client.HTTPConnection, machines: Iterable[int]) -> None:
    """Ask for tables of machines by their numbers, at temperatures that do not repeat."""
    for machine in machines:
        named = f"m{machine:05d}" if machine else "mcfv5050"
        path = f"/v1/machines/{named}/compensation"
        content = body(random.randrange(10**7))
        client.request("POST", path, content, {"Content-Type": "application/json"})
        answer = client.getresponse()
        answer.read()
        if answer.status != httpx.codes.OK:
            raise RuntimeError(f"{path}: {answer.status}")


def processor_s(process: Path) -> float:
    """Processor time that a process has had [s]."""
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def draw(models: dict[str, dict[int, Cost]], fleets: dict[int, Fleet], path: Path) -> None:
    """Draw all of it on logarithmic axes, a line of proportional growth beside it."""
    from playwright.sync_api import sync_playwright
    from plotly.graph_objects import Figure, Scatter
    from plotly.subplots import make_subplots

    titles = [f"{name} ({', '.join(others(name))})" for name in models] + ["machines"]
    figure: Figure = make_subplots(2, 2, subplot_titles=titles, vertical_spacing=0.14)
    colours = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
    for place, (name, costs) in enumerate(models.items()):
        for number, column in enumerate(COLUMNS):
            figure.add_trace(
                Scatter(
                    x=list(costs),
                    y=[cost.milliseconds[number] for cost in costs.values()],
                    name=column,
                    line={"color": colours[number]},
                    showlegend=not place,
                ),
                row=1 + place // 2,
                col=1 + place % 2,
            )
        figure.update_xaxes(title=name, type="log", row=1 + place // 2, col=1 + place % 2)
    for name, dash, values in (
        ("a table over HTTP [ms]", "solid", [f.table_ms for f in fleets.values()]),
        ("all in memory after [s]", "dash", [f.ready_s for f in fleets.values()]),
        ("memory [100 MiB]", "dot", [f.resident_mib / 100.0 for f in fleets.values()]),
    ):
        line = {"color": "#555555", "dash": dash}
        figure.add_trace(Scatter(x=list(fleets), y=values, name=name, line=line), row=2, col=2)
    figure.update_xaxes(title="machines", type="log", row=2, col=2)
    figure.update_xaxes(dtick=1)
    figure.update_yaxes(type="log", dtick=1, title="processor time [ms]", exponentformat="power")
    figure.update_yaxes(title="", row=2, col=2)
    figure.update_layout(
        width=1100, height=760, template="plotly_white", font={"size": 13}, margin={"t": 40}
    )
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        page_file = Path(folder) / "growth.html"
        figure.write_html(page_file)
        browser = driver.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1120, "height": 820})
        page.goto(page_file.as_uri())
        page.wait_for_selector(".main-svg")
        page.locator(".plotly-graph-div").screenshot(path=path)
        browser.close()


def others(name: str) -> list[str]:
    """Say what stays as it is while one number is changed."""
    return [f"{number} {other}" for other, number in BASE.items() if other != name]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=3000, help="the most of them")
    parser.add_argument("--plot", type=Path, help="draw all of it into a PNG file")
    stated = parser.parse_args()
    models = show_models()
    fleets = show_fleets(stated.machines)
    if stated.plot:
        draw(models, fleets, stated.plot)


if __name__ == "__main__":
    main()

"""What the benchmarks measure: a machine of 12 components × 21 positions in three maps.

The example machine has 21 components. Its 9 linear and 3 squareness errors alone are
measured, so that figures and ratios can be compared with those published before it
had angular errors.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from app.geometry.components import Kind
from app.main import create_app
from app.services.context import Context
from app.services.error_maps import store_error_map
from app.services.machines import create_machine
from app.settings import Settings
from app.simulation.example.error_maps import run_map
from app.simulation.example.machine import example_machine
from app.simulation.example.warm_up import run_temperatures
from app.storage.database import Database
from app.storage.migrate import upgrade
from app.thermal.error_map import ErrorMap

STORED_RUNS = (1, 3, 6)
TEMPERATURES_C = run_temperatures(2)
KINDS = frozenset({Kind.LINEAR, Kind.STRAIGHTNESS, Kind.SQUARENESS})


def measured_map(number: int) -> ErrorMap:
    """Take a run's linear and squareness errors."""
    run = run_map(number)
    chosen = {code: table for code, table in run.tables.items() if table.component.kind in KINDS}
    return replace(run, tables=chosen)


def prepare_database(url: str) -> None:
    """Store the example machine with three maps."""
    context = Context(Database(url))
    upgrade(context.database)
    create_machine(context, example_machine())
    for number in STORED_RUNS:
        store_error_map(context, example_machine().id, measured_map(number))
    context.database.close()


def database_url(folder: Path) -> str:
    """Name the benchmark's SQLite file."""
    return f"sqlite:///{folder / 'benchmark.db'}"


def make_thermap():
    """Make the service on the database that the environment names (for uvicorn --factory)."""
    return create_app(Settings(database_url=os.environ["THERMAP_DATABASE_URL"]))

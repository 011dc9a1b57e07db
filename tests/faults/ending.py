"""A service that is ended while it stores: what it answered is there when it runs again."""

from __future__ import annotations

import signal
import sqlite3
from contextlib import closing
from dataclasses import dataclass

from sqlalchemy import make_url

from tests.faults.service import Service
from tests.faults.writers import Lost, Writers, expect_all, make_machine


@dataclass(frozen=True)
class Ended:
    """How often it was ended, and what had been answered with 201 until then."""

    times: int
    maps: int
    readings: int


def end_under_load(
    database_url: str,
    times: int,
    number: signal.Signals = signal.SIGKILL,
    *,
    maps: int = 2,
    batches: int = 12,
) -> Ended:
    """End a service some times on a new database, each time in the middle of storing.

    Parameters
    ----------
    maps, batches
        How many of each are answered at least before the end comes.

    Raises
    ------
    Lost
        If anything that was answered is not there, or is there by half.
    """
    done: list[Writers] = []
    for i in range(times):
        service = Service(database_url)
        try:
            if not i:
                make_machine(service.url)
            done.append(Writers(service.url, i))
            done[-1].run_until(maps, batches)
        finally:
            code = service.end(number)
        done[-1].join()
        if number is signal.SIGTERM and code != 0:
            raise Lost(f"expected exit code 0 after SIGTERM, got {code}")
    expect_whole(database_url)
    service = Service(database_url)
    try:
        expect_all(service.url, done)
    finally:
        service.end()
    return Ended(
        times,
        sum(len(one.answered_maps) for one in done),
        sum(len(batch) for one in done for batch in one.answered_batches),
    )


def expect_whole(database_url: str) -> None:
    """Let SQLite check its file; Lost where something is wrong in it."""
    url = make_url(database_url)
    if url.get_backend_name() != "sqlite":
        return
    with closing(sqlite3.connect(str(url.database))) as connection:
        for pragma in ("integrity_check", "foreign_key_check"):
            found = connection.execute(f"PRAGMA {pragma}").fetchall()
            if found not in ([], [("ok",)]):
                raise Lost(f"{pragma} found {found[:3]}")

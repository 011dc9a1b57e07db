"""The simulated machine in a service: described, with its maps, and with readings that go on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from app.errors import Conflict
from app.files.csv_writing import csv_of_map
from app.simulation.example.error_maps import run_map
from app.simulation.example.machine import example_machine
from app.simulation.example.warm_up import temperatures_at
from app.thermal.machine import MACHINE
from thermap import ConflictError, ThermapClient, UnknownThingError, calls
from thermap.answers import ReadingSchema

STORED_RUNS: Final = (1, 3, 6)
HISTORY: Final = timedelta(minutes=5)
HISTORY_SPACING_S: Final = 5


def set_up(thermap: ThermapClient) -> str:
    """Make sure that the service has the simulated machine, its maps and some history.

    Raises
    ------
    Conflict
        If a machine of that id is there that is not the simulated one: no simulated
        temperature shall reach a real machine's table.
    """
    machine = example_machine()
    make_sure_of(thermap, MACHINE.dump_python(machine, mode="json"))
    try:
        for number in STORED_RUNS:
            content = csv_of_map(machine.id, run_map(number)).encode()
            name = f"run-{number}.csv"
            thermap.send(calls.send_file(machine.id, name, content, {}, calls.Storing(store=True)))
    except ConflictError as error:
        raise Conflict(f"{error.detail}; or give the demo a new --database-url") from error
    thermap.store_readings(machine.id, _history(datetime.now(UTC)))
    return machine.id


def make_sure_of(thermap: ThermapClient, machine: Mapping[str, Any]) -> bool:
    """Have a simulated machine stored; say whether it was not.

    Raises
    ------
    Conflict
        If a machine of that id is there that is not the simulated one.
    """
    try:
        present = thermap.machine(machine["id"]).name
    except UnknownThingError:
        thermap.create_machine(machine)
        return True
    if present != machine["name"]:
        raise Conflict(
            f"{thermap.base_url} has a machine {machine['id']!r} that is not the simulated one "
            f"({present!r}): give the demo a database of its own"
        )
    return False


def reading_at(moment: datetime) -> ReadingSchema:
    """Read the simulated machine's thermometers.

    At whole seconds, so that the same second always gives the same reading and a
    demo that starts again repeats nothing with other content.
    """
    second = moment.replace(microsecond=0)
    return ReadingSchema(time=second, temperatures_c=temperatures_at(second.timestamp()), state={})


def _history(now: datetime) -> Iterator[ReadingSchema]:
    """Give the last minutes before now."""
    end = now.replace(second=now.second - now.second % HISTORY_SPACING_S, microsecond=0)
    for back in range(int(HISTORY.total_seconds()), -1, -HISTORY_SPACING_S):
        yield reading_at(end - timedelta(seconds=back))

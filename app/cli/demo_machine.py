"""The simulated machine in a service: described, with its maps, and with readings that go on."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from app.cli.described import described
from app.errors import Conflict
from app.simulation.example.error_maps import run_map
from app.simulation.example.machine import example_machine
from app.simulation.example.warm_up import temperatures_at
from app.thermal.error_map import ComponentTable
from thermap import ConflictError, ThermapClient, UnknownThingError
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
    try:
        present = thermap.machine(machine.id)
    except UnknownThingError:
        present = thermap.create_machine(described(machine))
    if present.name != machine.name:
        raise Conflict(
            f"{thermap.base_url} has a machine {machine.id!r} that is not the simulated one "
            f"({present.name!r}): give the demo a database of its own"
        )
    try:
        for number in STORED_RUNS:
            thermap.store_error_map(machine.id, _map_body(number))
    except ConflictError as error:
        raise Conflict(f"{error.detail}; or give the demo a new --database-url") from error
    thermap.store_readings(machine.id, _history(datetime.now(UTC)))
    return machine.id


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


def _map_body(number: int) -> dict[str, Any]:
    """Write a run as the service takes it."""
    run = run_map(number)
    return {
        "label": run.label,
        "measured_at": run.measured_at,
        "temperatures_c": run.temperatures_c,
        "components": [_component_body(table) for table in run.tables.values()],
        "repeatability_um": run.repeatability_um,
        "instrument": run.instrument,
    }


def _component_body(table: ComponentTable) -> dict[str, Any]:
    component = table.component
    body: dict[str, Any] = {"component": component.code}
    if component.is_table:
        return body | {"positions_mm": table.positions_mm, component.input_field: table.errors}
    return body | {component.input_field: float(table.errors[0])}

"""Whether machines can be trusted now: the verdict, from what is in memory and in the database."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from sqlalchemy.orm import Session

from app.errors import InvalidContent, NoReading, StorageUnavailable, capitalised
from app.identification.watch.figures import WatchFigures
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import (
    ahead_warnings,
    current_state,
    database_warnings,
    early_warnings,
    table_of_state,
)
from app.services.load_machine import lacks_reading, load_machine, restore_past
from app.status.judge import NOTHING_LOGGED, Logged, Situation, judge
from app.status.machine_status import LastCheck, MachineStatus, NotAdopted, RunningAnalysis
from app.storage.analyses import analyses_not_adopted, unfinished_analyses
from app.storage.events import lasting_since
from app.storage.limits import QUESTION
from app.storage.model_versions import waiting_versions
from app.storage.watches import NOT_WATCHED, Watched, watched_machines
from app.thermal.sensor_health import Health, SensorState


@dataclass(frozen=True, slots=True)
class Stored:
    """What the database says of all machines' watches, analyses, alarms and versions that wait."""

    watches: Mapping[str, Watched] = field(default_factory=dict)
    analyses: Mapping[str, RunningAnalysis] = field(default_factory=dict)
    not_adopted: Mapping[str, NotAdopted] = field(default_factory=dict)
    logged: Mapping[str, Logged] = field(default_factory=dict)
    waiting: Mapping[str, int] = field(default_factory=dict)


def show_status(context: Context, machine_id: str) -> MachineStatus:
    """Say whether a machine can be trusted now.

    While the database is away the verdict goes on from memory; the watch is then not judged.
    """
    live = machine_in_memory(context, machine_id)
    return status_of(context, live, stored_of_machines(context))


def machine_in_memory(context: Context, machine_id: str) -> LiveMachine:
    """Find a machine in memory, or bring it and its latest readings there."""
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    if lacks_reading(context, live) and context.live.database.trouble is None:
        with suppress(StorageUnavailable):
            restore_past(context, live)
    return live


def show_statuses(context: Context) -> list[MachineStatus]:
    """Say the same of every machine in memory, by id."""
    stored = stored_of_machines(context)
    return [status_of(context, live, stored) for live in context.live.machines()]


def status_of(context: Context, live: LiveMachine, stored: Stored) -> MachineStatus:
    """Judge a machine in memory; nothing is asked of the database."""
    current = live.current
    machine = current.model.machine
    watched = stored.watches.get(machine.id, NOT_WATCHED)
    situation = Situation(
        model=current.model,
        model_version=current.version,
        judged_at=context.now(),
        sensors=[
            _with_absence(live, SensorState(name, Health.MISSING)) for name in machine.sensors
        ],
        record=live.readings.record(machine),
        latest=None,
        table=NoReading("no reading has come yet"),
        notes=_notes(context, live, stored.waiting.get(machine.id)),
        watch=watched.status,
        drifting_since=watched.beyond_since,
        last_check=_last_check(watched.figures),
        not_adopted=stored.not_adopted.get(machine.id),
        logged=stored.logged.get(machine.id, NOTHING_LOGGED),
        analysis=stored.analyses.get(machine.id),
    )
    try:
        state = current_state(context, machine.id, live)
    except NoReading:
        return judge(situation)
    situation = replace(
        situation,
        sensors=[_with_absence(live, sensor) for sensor in state.sensors],
        record=live.readings.record(machine),
        latest=state.reading.time,
        clocks=early_warnings(state.early),
    )
    try:
        return judge(replace(situation, table=table_of_state(context, state)))
    except InvalidContent as why:
        return judge(replace(situation, table=why))


def _with_absence(live: LiveMachine, state: SensorState) -> SensorState:
    """Add since when a sensor's sender says that it has no value."""
    return state._replace(no_value_since=live.without_value.get(state.sensor))


def _last_check(figures: WatchFigures | None) -> LastCheck | None:
    if figures is None:
        return None
    check = figures.check
    if check is None:
        return LastCheck.unjudged(datetime.fromtimestamp(figures.latest.time_s, UTC))
    time = datetime.fromtimestamp(check.time_s, UTC)
    sizes = (check.off, check.scatter, check.setup_scatter, check.at_most)
    return LastCheck.of(time, check.component, check.count, sizes, check.unit)


def _notes(context: Context, live: LiveMachine, waiting: int | None) -> list[str]:
    """What an operator should know of the database, clocks and versions, as sentences."""
    window = live.readings.held
    sentences = [
        *database_warnings(context, live.current),
        *ahead_warnings(window.ahead, more_ahead=window.more_ahead),
    ]
    if waiting is not None:
        sentences.append(
            f"version {waiting} waits to be activated, because tables would lose something: they "
            "are without what was stored since"
        )
    return [f"{capitalised(words)}." for words in sentences]


def read_stored(session: Session) -> Stored:
    """Read what the database says of all machines."""
    return Stored(
        watched_machines(session),
        unfinished_analyses(session),
        analyses_not_adopted(session),
        lasting_since(session),
        waiting_versions(session),
    )


def stored_of_machines(context: Context) -> Stored:
    """Ask the database, unless it is known to be away: who judges goes on without it."""
    if context.live.database.trouble is not None:
        return Stored()
    try:
        with context.database.reading(QUESTION) as session:
            return read_stored(session)
    except StorageUnavailable:
        return Stored()

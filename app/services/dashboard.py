"""What pages show of machines: all of them, one now, its set-up, its maps and versions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from app.arrays import FloatArray
from app.compensation.table import CompensationTable, ComponentCompensation
from app.errors import StorageUnavailable, ThermapError
from app.events.event import Event
from app.geometry.components import Component
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import current_state, table_of_state
from app.services.models import PresentChange, compare_now
from app.services.status import machine_in_memory, status_of, stored_of_machines
from app.status.machine_status import MachineStatus
from app.storage.events import list_events
from app.storage.limits import QUESTION
from app.storage.machines import find_machine
from app.storage.model_versions import active_version, list_versions, waiting_version
from app.storage.records import ModelVersion
from app.thermal.bracket import Status
from app.thermal.group_state import GroupState
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, propose_assignment
from app.units import SECONDS_PER_H

EVENTS_SHOWN = 4

COURSE_S = 2.0 * SECONDS_PER_H
"""How far back the course of a temperature is shown [s]."""


@dataclass(frozen=True, slots=True)
class Course:
    """A sensor's temperatures over the last two hours, as far as memory has them.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Relative to now: from −7200 to 0.
    temperatures_c : ndarray, shape (n,) [°C]
    max_gap_s
        Neighbours further apart are not joined [s].
    rejected_s, rejected_c : ndarray, shape (k,) [s], [°C]
        What was read and not believed.
    """

    times_s: FloatArray
    temperatures_c: FloatArray
    max_gap_s: float
    rejected_s: FloatArray = field(default_factory=lambda: np.empty(0))
    rejected_c: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, slots=True)
class MapCurve:
    """Minus a map's errors, along the positions that it has in common with its neighbour."""

    label: str
    positions_mm: FloatArray
    compensation: FloatArray


@dataclass(frozen=True, slots=True)
class Curve:
    """A component's compensation now, between its two maps.

    `trend` is what going on in a straight line through the maps would give, where it is held.
    `maps` is empty where the numbers are not on one line between two maps.
    """

    entry: ComponentCompensation
    maps: tuple[MapCurve, ...] = ()
    trend: MapCurve | None = None

    @property
    def component(self) -> Component:
        """Which one it is."""
        return self.entry.component


@dataclass(frozen=True, slots=True)
class MachineView:
    """One machine now: its verdict, its temperatures' courses, and its curves."""

    status: MachineStatus
    courses: dict[str, Course]
    curves: tuple[Curve, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    events: tuple[Event, ...] = ()


def show_machine_view(context: Context, machine_id: str) -> MachineView:
    """Gather what the page of a machine shows."""
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    view = MachineView(status, _courses(context, live), events=_latest_events(context, machine_id))
    try:
        table = table_of_state(context, current_state(context, machine_id, live))
    except ThermapError:
        return view
    return replace(view, curves=tuple(_curves(table)), warnings=tuple(table.warnings))


def _latest_events(context: Context, machine_id: str) -> tuple[Event, ...]:
    """Read the last few events; none while the database is away, for the page goes on."""
    if context.live.database.trouble is not None:
        return ()
    try:
        with context.database.reading(QUESTION) as session:
            return tuple(list_events(session, machine_id, limit=EVENTS_SHOWN))
    except StorageUnavailable:
        return ()


def show_machine_views(context: Context) -> list[MachineView]:
    """Gather what the page of all machines shows, by id."""
    stored = stored_of_machines(context)
    return [
        MachineView(status_of(context, live, stored), _courses(context, live))
        for live in context.live.machines()
    ]


def _courses(context: Context, live: LiveMachine) -> dict[str, Course]:
    machine = live.current.model.machine
    record = live.readings.record(machine)
    courses = {}
    for name, sensor in machine.sensors.items():
        times_s, values = record.history.series(name)
        ages_s = times_s - context.now().timestamp()
        recent, believed = ages_s >= -COURSE_S, record.are_believed(name)
        usable, rejected = recent & believed, recent & ~believed
        courses[name] = Course(
            ages_s[usable], values[usable], sensor.max_age_s, ages_s[rejected], values[rejected]
        )
    return courses


def _curves(table: CompensationTable) -> Iterator[Curve]:
    """Put every component's compensation beside its maps."""
    states = {m.component.code: state for state in table.states for m in state.members}
    for entry in table.components:
        state = states.get(entry.component.code)
        is_between = state is not None and entry.basis.lower_map == state.lower_map
        if state is None or not is_between:
            yield Curve(entry)
            continue
        curves = _map_curves(state, entry.component)
        yield Curve(entry, curves[:2], curves[2] if state.status is Status.CLAMPED else None)


def _map_curves(state: GroupState, component: Component) -> tuple[MapCurve, MapCurve, MapCurve]:
    """Give minus the errors of the lower map, of the upper one, and of the line's going on."""
    scale, lower = state.scale, state.bracket.lower
    maps = state.group.maps_in_use(scale.rows[lower], scale.rows[lower + 1])
    member = maps.member(component.code)
    below, above = (-nodes[member.forward] for nodes in maps.nodes)
    share = (state.temperature_c - scale.temperatures_c[lower]) / scale.span_c(lower)
    return (
        MapCurve(state.lower_map, member.positions_mm, below),
        MapCurve(state.upper_map, member.positions_mm, above),
        MapCurve("trend", member.positions_mm, (1.0 - share) * below + share * above),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SetupView:
    """A machine, its newest version, and the sensors that its maps speak for.

    `version` is the one that waits, where one waits: it has all that was stored, and the next
    assignment is made of it. None before the first map.
    """

    status: MachineStatus
    machine: Machine
    version: ModelVersion | None = None
    proposals: Sequence[Proposal] = ()


def show_setup(context: Context, machine_id: str) -> SetupView:
    """Gather what the page of a machine's set-up shows."""
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    machine = live.current.model.machine
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version = waiting_version(session, row) or active_version(session, row)
    if version is None:
        return SetupView(status, machine)
    maps = [stored.error_map for stored in version.maps]
    return SetupView(
        status, machine, version, propose_assignment(machine, maps, version.assignment)
    )


@dataclass(frozen=True, slots=True, eq=False)
class MapsView:
    """A machine's versions, oldest first; which is active, which waits, and which are compared.

    `compared` says by how much tables with `b` differ from those with `a` now; None where there
    are not two versions.
    """

    status: MachineStatus
    sensors: Sequence[str]
    versions: Sequence[ModelVersion]
    active: int | None
    waiting: int | None
    a: int | None = None
    b: int | None = None
    compared: PresentChange | None = None

    @property
    def active_version(self) -> ModelVersion | None:
        """The version that tables follow."""
        return next((version for version in self.versions if version.version == self.active), None)


def show_maps_view(
    context: Context, machine_id: str, a: int | None = None, b: int | None = None
) -> MapsView:
    """Gather what the page of maps and versions shows.

    Parameters
    ----------
    a, b
        The two versions to compare; without them the active one, with the one before it.
    """
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    sensors = tuple(live.current.model.machine.sensors)
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        active, waiting = row.active_version, row.waiting_version
        versions = list_versions(session, machine_id)
    numbers = [version.version for version in versions]
    if active is None or len(numbers) < 2:
        return MapsView(status, sensors, versions, active, waiting)
    b = b or active
    a = a or next((n for n in reversed(numbers) if n < b), next(n for n in numbers if n != b))
    compared = compare_now(context, machine_id, a, b)
    return MapsView(status, sensors, versions, active, waiting, a, b, compared)

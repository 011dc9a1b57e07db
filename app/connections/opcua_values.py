"""What a machine says over OPC UA: names, values, and how far each may be believed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final, TypeAlias, cast

from asyncua import ua

from app.compensation.table import CompensationTable, ComponentCompensation
from app.effects.adopted.held import HELD
from app.errors import NoReading, ThermapError
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import current_state, table_of_state
from app.services.status import Stored, status_of
from app.status.machine_status import MachineStatus, SensorNow, State, Verdict
from app.thermal.bracket import Status
from app.thermal.sensor_health import Health

GOOD: Final = ua.StatusCodes.Good
NO_VALUE: Final = ua.StatusCodes.BadNoData

OpcuaValue: TypeAlias = str | float | bool | datetime | list[str] | list[float] | None


@dataclass(frozen=True, slots=True)
class NodeValue:
    """A value, its type, and its status code.

    A bad one has no value at all: who passes over the status code must not get a number.
    """

    kind: ua.VariantType
    value: OpcuaValue
    code: int = GOOD
    is_array: bool = False

    def at(self, time: datetime) -> ua.DataValue:
        """Make what the server keeps."""
        status = ua.StatusCode(ua.UInt32(self.code))
        stamp = cast("ua.DateTime", time)
        if self.value is None or status.is_bad():
            return ua.DataValue(StatusCode=status, SourceTimestamp=stamp)
        variant = ua.Variant(self.value, self.kind, is_array=self.is_array)
        return ua.DataValue(Value=variant, StatusCode=status, SourceTimestamp=stamp)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A machine's verdict and its table at one moment; None where there is no table."""

    status: MachineStatus
    table: CompensationTable | None


def snapshot_of(context: Context, live: LiveMachine, stored: Stored) -> Snapshot:
    """Judge a machine in memory; the table is never newer than the verdict on it."""
    machine_id = live.current.model.machine.id
    try:
        table = table_of_state(context, current_state(context, machine_id, live))
    except ThermapError:
        table = None
    return Snapshot(status_of(context, live, stored), table)


def seen_of(
    context: Context, live: LiveMachine, stored: Stored
) -> tuple[tuple[Any, ...], float | None]:
    """Say briefly what a verdict would rest on now, and how old the latest reading is [s].

    A verdict takes milliseconds; while this stays the same, only time can change it.
    """
    machine_id = live.current.model.machine.id
    beside = tuple(
        of.get(machine_id)
        for of in (stored.watches, stored.analyses, stored.not_adopted, stored.waiting)
    )
    try:
        state = current_state(context, machine_id, live)
    except NoReading as why:
        return (live.current.stamp, live.current.version, why.detail, beside), None
    return (state.tag, beside), state.age_s


def quality_of(snapshot: Snapshot) -> int:
    """Say how far a machine's compensation may be believed.

    Good only where the machine is trusted; without trust there is no value to be had.
    """
    status = snapshot.status
    if snapshot.table is None or status.verdict is Verdict.NOT_TRUSTED:
        return NO_VALUE
    if status.verdict is Verdict.TRUSTED:
        return GOOD
    if status.state is State.STALE:
        return ua.StatusCodes.UncertainLastUsableValue
    return ua.StatusCodes.UncertainSubNormal


def quality_of_component(snapshot: Snapshot, entry: ComponentCompensation, code: int) -> int:
    """Say the same of one component, never better than its machine.

    Parameters
    ----------
    code
        Of the machine, as `quality_of` says.
    """
    table = snapshot.table
    if table is None or ua.StatusCode(ua.UInt32(code)).is_bad():
        return NO_VALUE
    rests_on = {entry.basis.sensor, *(followed.sensor for followed in entry.basis.follows)}
    for effect in table.effects:
        if entry.component.code in effect.components:
            rests_on |= set(effect.sensors)
    old = {sensor.sensor for sensor in snapshot.status.sensors if sensor.health is Health.STALE}
    if rests_on & old:
        return ua.StatusCodes.UncertainLastUsableValue
    if entry.basis.status in _BEYOND:
        return ua.StatusCodes.UncertainEngineeringUnitsExceeded
    return GOOD if code == GOOD else ua.StatusCodes.UncertainSubNormal


_BEYOND: Final = frozenset({Status.CLAMPED, Status.EXTRAPOLATED, HELD})
"""Statuses of what lies beyond its maps, or beyond where an effect was learnt."""

_QUALITY: Final = {
    Health.OK: GOOD,
    Health.MISSING: NO_VALUE,
    Health.STALE: ua.StatusCodes.UncertainLastUsableValue,
}
"""Of a temperature; a sensor that failed otherwise says nothing."""


def values_of(snapshot: Snapshot) -> Iterator[tuple[str, NodeValue]]:
    """Give all values of a machine by their paths below it."""
    status, code = snapshot.status, quality_of(snapshot)
    table, text = snapshot.table, ua.VariantType.String
    yield "Name", NodeValue(text, status.name)
    yield "Configuration", NodeValue(text, status.configuration)
    yield "Verdict", NodeValue(text, status.verdict.value)
    yield "State", NodeValue(text, status.state.value)
    yield "Sentences", NodeValue(text, list(status.sentences), is_array=True)
    check = status.last_check
    yield "LastCheck", _value_or_none(text, None if check is None else check.text)
    yield "Usable", NodeValue(ua.VariantType.Boolean, code != NO_VALUE)
    complete = table is not None and table.complete and code != NO_VALUE
    yield "Complete", NodeValue(ua.VariantType.Boolean, complete)
    yield "ModelVersion", _value_or_none(ua.VariantType.UInt32, status.model_version)
    yield "ReadingTime", _value_or_none(ua.VariantType.DateTime, status.reading_time)
    yield "ReadingAge", reading_age(status.reading_age_s)
    yield "ComputedAt", computed_at(status.computed_at)
    for sensor in status.sensors:
        yield f"Temperatures/{sensor.sensor}", _temperature(sensor)
    for entry in table.components if table is not None else ():
        yield from _component_values(entry, quality_of_component(snapshot, entry, code))


def reading_age(age_s: float | None) -> NodeValue:
    """Say how old the latest reading is [s]."""
    return _value_or_none(ua.VariantType.Double, age_s)


def computed_at(time: datetime) -> NodeValue:
    """Say when a machine was judged, or nothing was found changed since it was."""
    return NodeValue(ua.VariantType.DateTime, time)


def _component_values(entry: ComponentCompensation, code: int) -> Iterator[tuple[str, NodeValue]]:
    above = f"Components/{entry.component.code}"
    number = ua.VariantType.Double
    yield f"{above}/Positions", NodeValue(number, entry.positions_mm.tolist(), code, is_array=True)
    compensation = entry.compensation.tolist()
    yield f"{above}/Compensation", NodeValue(number, compensation, code, is_array=True)
    if entry.backward_errors is not None:
        backward = (0.0 - entry.backward_errors).tolist()
        yield f"{above}/BackwardCompensation", NodeValue(number, backward, code, is_array=True)
    yield f"{above}/Status", NodeValue(ua.VariantType.String, entry.basis.status, code)


def _temperature(sensor: SensorNow) -> NodeValue:
    code = _QUALITY.get(sensor.health, ua.StatusCodes.BadSensorFailure)
    if sensor.temperature_c is None:
        code = NO_VALUE
    return NodeValue(ua.VariantType.Double, sensor.temperature_c, code)


def _value_or_none(kind: ua.VariantType, value: OpcuaValue) -> NodeValue:
    return NodeValue(kind, value, NO_VALUE if value is None else GOOD)

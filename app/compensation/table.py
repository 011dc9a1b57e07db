"""The compensation table: what a controller adds, and everything a user must know of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from app.arrays import FloatArray
from app.errors import SensorUnavailable, list_names
from app.geometry.components import ORDER, Component
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel, GroupState
from app.thermal.sensor_health import Health, SensorState


@dataclass(frozen=True, slots=True)
class ComponentCompensation:
    """One component's errors at the live temperatures, and minus them.

    All arrays have the shape of `positions_mm`, or (1,) where the component has no
    argument; errors and compensation are in the component's unit. `standard_errors` are
    one standard deviation of the errors, and of the compensation too, as far as the
    measurement of the maps goes; None where a map that enters states none, and where an
    adopted effect is in the errors: how sure that is, the maps do not say.

    `origin` is the group's state between its maps, None where no two maps have the component
    and it consists of effects alone; `effects` are the kinds of those that are in the errors.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None
    standard_errors: FloatArray | None
    backward_standard_errors: FloatArray | None
    origin: GroupState | None
    effects: tuple[str, ...] = ()

    @property
    def compensation(self) -> FloatArray:
        """What is to be added to the command: minus the error, and 0 for 0."""
        return 0.0 - self.errors

    @property
    def backward_compensation(self) -> FloatArray | None:
        """The same for positions approached in the negative direction."""
        return None if self.backward_errors is None else 0.0 - self.backward_errors


@dataclass(frozen=True, slots=True)
class EffectInTable:
    """An adopted effect of the model: what it is, and why it is not in a table, if it is not."""

    kind: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    explanation: str
    missing: str = ""


@dataclass(frozen=True, slots=True)
class CompensationTable:
    """Every component at one thermal state.

    `complete` is False when a component of the maps or an adopted effect is not in the table,
    or one rests on an old temperature; `warnings` say in sentences all that is not as it
    should be; `states` are the groups of components that lie between the same maps, and
    `corrected` the components with effects: they take the place of those in the groups.
    """

    machine_id: str
    model_version: int
    computed_at: datetime
    complete: bool
    warnings: Sequence[str]
    states: Sequence[GroupState]
    corrected: Sequence[ComponentCompensation] = ()
    effects: Sequence[EffectInTable] = ()

    @property
    def components(self) -> list[ComponentCompensation]:
        """All components in the order in which tables list them."""
        plain = [entry for state in self.states for entry in group_compensation(state)]
        found = {entry.component.code: entry for entry in (*plain, *self.corrected)}
        return sorted(found.values(), key=lambda entry: ORDER[entry.component.code])


def compensation_table(
    model: CompiledModel,
    model_version: int,
    sensors: Iterable[SensorState],
    computed_at: datetime,
    warnings: Iterable[str] = (),
) -> CompensationTable:
    """Compute the table at the sensors' present states.

    Parameters
    ----------
    model, model_version
        The compiled model and its number.
    sensors
        Each sensor's value and whether it can be believed: failed ones are replaced
        by their stand-ins, stale ones serve where there is no better, and both are said.
    computed_at
        The time to write into the table.
    warnings
        What else is to be said.

    Raises
    ------
    NotEnoughMaps, SensorUnavailable, OutsideMaps
        As `CompiledModel.errors_at`; the sentence says what the sensors' matter is.
    """
    usable: dict[str, float] = {}
    stale: dict[str, float] = {}
    failures: dict[str, str] = {}
    for sensor in sensors:
        if sensor.health is not Health.OK:
            failures[sensor.sensor] = sensor.detail
        if sensor.temperature_c is not None and sensor.health in (Health.OK, Health.STALE):
            into = usable if sensor.health is Health.OK else stale
            into[sensor.sensor] = sensor.temperature_c
    try:
        states = model.errors_at(usable, stale)
    except SensorUnavailable as error:
        raise SensorUnavailable(
            "; ".join([error.detail, *failures.values()]), error.errors
        ) from None
    omitted = [f"{code} is not in the table: {why}" for code, why in model.omitted.items()]
    old = [
        f"{list_names(state.group.codes)} rest on an old temperature of {state.sensor}"
        for state in states
        if state.sensor not in usable
    ]
    return CompensationTable(
        machine_id=model.machine.id,
        model_version=model_version,
        computed_at=computed_at,
        complete=not omitted and not old,
        warnings=[*warnings, *failures.values(), *old, *_remarks(states), *omitted, *model.notes],
        states=states,
    )


def group_compensation(state: GroupState) -> list[ComponentCompensation]:
    """Take one group's values apart into its components."""
    return [
        ComponentCompensation(
            component=member.component,
            positions_mm=member.positions_mm,
            errors=state.values[member.forward],
            backward_errors=None if member.backward is None else state.values[member.backward],
            standard_errors=state.standard_errors(member.forward),
            backward_standard_errors=(
                None if member.backward is None else state.standard_errors(member.backward)
            ),
            origin=state,
        )
        for member in state.group.members
    ]


_PLAIN = frozenset({Status.INTERPOLATED, Status.AT_MAP})

_REMARKS: Mapping[Status, str] = {
    Status.CLAMPED: "{sensor} at {t:g} °C is outside the maps: {codes} held at {nearest!r}",
    Status.EXTRAPOLATED: (
        "{sensor} at {t:g} °C is outside the maps: {codes} extrapolated "
        "from {lower!r} and {upper!r}"
    ),
}


def _remarks(states: Iterable[GroupState]) -> list[str]:
    """Say what is not plain interpolation between maps of the assigned sensor."""
    remarks = []
    for state in states:
        if state.status in _PLAIN:
            continue
        codes = list_names(state.group.codes)
        if state.is_stand_in:
            remarks.append(f"{state.sensor} stands in for {state.group.sensor}: {codes}")
        if state.status in _REMARKS:
            remarks.append(
                _REMARKS[state.status].format(
                    sensor=state.sensor,
                    t=state.temperature_c,
                    codes=codes,
                    nearest=state.upper_map if state.weight > 0.5 else state.lower_map,
                    lower=state.lower_map,
                    upper=state.upper_map,
                )
            )
    return remarks

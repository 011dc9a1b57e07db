"""The compensation table: what a controller adds, and everything a user must know of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.errors import SensorUnavailable, list_names
from app.geometry.components import ORDER, Component
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import sentences
from app.thermal.group_state import GroupState
from app.thermal.sensor_health import Health, SensorState


class Follows(NamedTuple):
    """A sensor by which a component's maps are read [°C], and the share of that in its row."""

    sensor: str
    temperature_c: float
    share: float


@dataclass(frozen=True, slots=True)
class Basis:
    """What a component's numbers rest on where effects take part.

    Sensor, temperature [°C], the two maps, the upper one's weight and the status as in
    `GroupState`; all but the status are None where no two maps have the component. `follows`
    says by which sensors the maps are read where an adopted effect exchanges the assigned one:
    `sensor` is then the one of the largest share, and the maps and the weight are those that
    give the numbers, None where these are not on one line between two maps.
    """

    sensor: str | None
    temperature_c: float | None
    lower_map: str | None
    upper_map: str | None
    weight: float | None
    status: str
    stand_in_for: str | None = None
    follows: tuple[Follows, ...] = ()

    @classmethod
    def of(cls, state: GroupState) -> Basis:
        """Make the basis of numbers that are the maps' alone."""
        return cls(
            state.sensor,
            state.temperature_c,
            state.lower_map,
            state.upper_map,
            state.weight,
            state.status,
            state.stand_in_for,
        )


@dataclass(frozen=True, slots=True)
class ComponentCompensation:
    """One component's errors at the live temperatures, and minus them.

    All arrays have the shape of `positions_mm`, or (1,) where the component has no
    argument; errors and compensation are in the component's unit. `standard_errors` are
    one standard deviation of the errors, and of the compensation too, as far as the
    measurement of the maps goes; None where a map that enters states none, and where an
    adopted effect is in the errors: how sure that is, the maps do not say.

    `basis` is what the errors rest on; `effects` are the kinds of those that are in them.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None
    standard_errors: FloatArray | None
    backward_standard_errors: FloatArray | None
    basis: Basis
    effects: tuple[str, ...] = ()

    @property
    def compensation(self) -> FloatArray:
        """What is to be added to the command: minus the error, and 0 for 0."""
        return 0.0 - self.errors

    @property
    def backward_compensation(self) -> FloatArray | None:
        """The same approached backward; None where the maps have one direction."""
        return None if self.backward_errors is None else 0.0 - self.backward_errors

    def errors_at(self, positions_mm: FloatArray, *, is_backward: bool = False) -> FloatArray:
        """Give the errors at positions as a controller does: straight between its own.

        Parameters
        ----------
        positions_mm : ndarray, shape (n,); empty for a component without argument

        Returns
        -------
        ndarray, shape (n,), or (1,) without positions [its unit]
            Beyond the ends the value there; approached backward where there is such a table.
        """
        values = self.errors
        if is_backward and self.backward_errors is not None:
            values = self.backward_errors
        if self.positions_mm.size < 2:
            return np.broadcast_to(values, (max(positions_mm.size, 1),))
        return np.interp(positions_mm, self.positions_mm, values)


@dataclass(frozen=True, slots=True)
class Sureness:
    """How sure a learnt effect is of one component at this moment [its unit].

    Parameters
    ----------
    expected
        What was learnt beside the maps.
    learnt_error, wander_error
        Standard deviations of that, and of what no driver explains.
    corrected
        What of it is in the table.
    """

    component: str
    expected: float
    learnt_error: float
    wander_error: float
    corrected: float


@dataclass(frozen=True, slots=True)
class EffectInTable:
    """An adopted effect of the model: what it is, and where it was learnt.

    `missing` says why it is not in a table, if it is not; `held` why it is held at the edge of
    where it was learnt, if it is; `learnt_in` are its ranges, None where they are not known, and
    `measure_again` says until when one that grows with time may be used. `sureness` says of one
    that is corrected only as far as it is sure how sure it is now.
    """

    kind: str
    components: tuple[str, ...]
    sensors: tuple[str, ...]
    explanation: str
    missing: str = ""
    held: Sequence[str] = ()
    learnt_in: Mapping[str, Any] | None = None
    measure_again: str = ""
    sureness: Sequence[Sureness] = ()


class CompensationTable(NamedTuple):
    """Every component at one thermal state.

    `complete` is False when a component of the maps or an adopted effect is not in the table,
    one rests on an old temperature, or ends where other maps of it go on, or when an effect lies
    outside where it was learnt or nobody knows where that was, or would read the maps where the
    machine's policy allows no table; `complete_where_it_reaches` is the same without what is said
    of positions; `warnings` say in
    sentences all that is not as it should be; `states` are the groups of components that lie
    between the same maps, and
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
    complete_where_it_reaches: bool = True

    @property
    def components(self) -> list[ComponentCompensation]:
        """All components in the order in which tables list them."""
        plain = [entry for state in self.states for entry in group_compensation(state)]
        by_code = {entry.component.code: entry for entry in (*plain, *self.corrected)}
        return sorted(by_code.values(), key=lambda entry: ORDER[entry.component.code])


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
    sensors
        Each sensor's value and whether it can be believed: failed ones are replaced
        by their stand-ins, stale ones serve where there is no better, and both are said.

    Raises
    ------
    NotEnoughMaps, SensorUnavailable, OutsideMaps
        As `CompiledModel.errors_at`; the sentence says what the sensors' matter is.
    """
    usable: dict[str, float] = {}
    stale: dict[str, float] = {}
    failures: dict[str, str] = {}
    for sensor in sensors:
        is_ok = sensor.health is Health.OK
        if not is_ok:
            failures[sensor.sensor] = sensor.detail
        # A sensor that failed otherwise may state a number, too: it does not serve even where there
        # is no other.
        if sensor.temperature_c is not None and (is_ok or sensor.health is Health.STALE):
            into = usable if is_ok else stale
            into[sensor.sensor] = sensor.temperature_c
    try:
        states = model.errors_at(usable, stale)
    except SensorUnavailable as error:
        raise SensorUnavailable(
            "; ".join([error.detail, *failures.values()]), error.errors
        ) from None
    omitted = omissions(model.omitted)
    old = [
        f"{list_names(state.group.codes)} {'rests' if len(state.group.codes) == 1 else 'rest'} "
        f"on an old temperature of {state.sensor}"
        for state in states
        if state.scale.sensor not in usable
    ]
    shortened = [words for state in states if state.maps.shortened for words in shortenings(state)]
    return CompensationTable(
        machine_id=model.machine.id,
        model_version=model_version,
        computed_at=computed_at,
        complete=not omitted and not old and not shortened,
        complete_where_it_reaches=not omitted and not old,
        warnings=[
            *warnings,
            *failures.values(),
            *old,
            *remarks(states),
            *shortened,
            *omitted,
            *model.notes,
        ],
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
            basis=Basis.of(state),
        )
        for member in state.members
    ]


def omissions(omitted: Mapping[str, str], limit: int = 20) -> dict[str, tuple[str, ...]]:
    """Say which components of the maps a table lacks, once for each reason.

    Parameters
    ----------
    limit
        Codes that a sentence names; of the others it says how many they are.

    Returns
    -------
    dict of sentence to its codes

    Examples
    --------
    >>> list(omissions({"EXX": "no sensor", "EYY": "no sensor", "EZZ": "one map"}))
    ['EXX, EYY are not in the table: no sensor', 'EZZ is not in the table: one map']
    """
    alike: dict[str, list[str]] = {}
    for code, why in omitted.items():
        alike.setdefault(why, []).append(code)
    by_sentence = {}
    for why, codes in alike.items():
        verb = "is" if len(codes) == 1 else "are"
        by_sentence[f"{list_names(codes, limit)} {verb} not in the table: {why}"] = tuple(codes)
    return by_sentence


def shortenings(state: GroupState, without: Collection[str] = ()) -> list[str]:
    """Say which components of a group end earlier than other maps of theirs."""
    return sentences(item for item in state.maps.shortened.items() if item[0] not in without)


_PLAIN = frozenset({Status.INTERPOLATED, Status.AT_MAP})

_REMARKS: Mapping[Status, str] = {
    Status.CLAMPED: "{sensor} at {t:g} °C is outside the maps: {codes} held at {nearest!r}",
    Status.EXTRAPOLATED: (
        "{sensor} at {t:g} °C is outside the maps: {codes} extrapolated "
        "from {lower!r} and {upper!r}"
    ),
}


def remarks(states: Iterable[GroupState]) -> list[str]:
    """Say what is not plain interpolation between maps of the assigned sensor."""
    listed = []
    for state in states:
        if state.bracket.status in _PLAIN:
            continue
        codes = list_names(state.group.codes)
        if state.is_stand_in:
            listed.append(f"{state.sensor} stands in for {state.group.sensor}: {codes}")
        beyond_c = state.limited_beyond_c
        if beyond_c is not None:
            # Beyond the maps the weight is 0 or less, or 1 or more: ½ tells the sides apart.
            nearest = state.upper_map if state.weight > 0.5 else state.lower_map
            listed.append(
                f"{state.sensor} at {state.temperature_c:g} °C is outside the maps: {codes} "
                f"extrapolated from {state.lower_map!r} and {state.upper_map!r}, which are "
                f"{state.span_c:.3g} K apart, but held from {beyond_c:.3g} K beyond {nearest!r} "
                "on, because the standard error grows too large there; measure a map at the "
                "present temperature"
            )
        elif state.status in _REMARKS:
            listed.append(
                _REMARKS[state.status].format(
                    sensor=state.sensor,
                    t=state.temperature_c,
                    codes=codes,
                    nearest=state.upper_map if state.weight > 0.5 else state.lower_map,
                    lower=state.lower_map,
                    upper=state.upper_map,
                )
            )
    return listed

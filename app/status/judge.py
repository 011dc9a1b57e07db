"""The verdict on a machine: what is the matter with its table now, the worst first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

import numpy as np

from app.compensation.table import (
    CompensationTable,
    ComponentCompensation,
    omissions,
    shortenings,
)
from app.errors import (
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    ThermapError,
    capitalised,
    counted,
    list_names,
)
from app.status.figures import (
    between_maps_c,
    change_per_h,
    excess_k,
    largest_of,
    list_beyond,
    outside_k,
)
from app.status.machine_status import (
    BeyondMaps,
    LastCheck,
    MachineStatus,
    NotAdopted,
    RunningAnalysis,
    SensorNow,
    State,
)
from app.status.sensor_rate import LONGEST_S, rate_k_per_h
from app.thermal.bracket import Status
from app.thermal.compile_model import NO_SENSOR
from app.thermal.compiled_model import CompiledModel
from app.thermal.sensor_health import Health, JudgedRecord, SensorState
from app.thermal.stated_temperatures import asked_in_fahrenheit
from app.units import TemperatureUnit

NO_READING_AGES: Final = 10.0
"""After so many times the age at which a temperature is old, there counts as none."""

LINGERS: Final = timedelta(seconds=30)
"""How long a temperature outside the maps is still said: a state that comes and goes with every
reading tells nobody anything."""

_OUTSIDE: Final = frozenset({State.CLAMPED, State.EXTRAPOLATED})
"""Each has a first sentence that says which components it touches; a second one may say by how
much."""

_LAST_UNPLACED: Final = State.EFFECT_NOT_ADOPTED.gravity
"""Causes after it, as stand-ins, harm no component."""

MOST_CODES: Final = 6
"""Components that a sentence names; of the others it says how many they are."""

NOTHING_RESTS: Final = "no component rests on it"


class Logged(NamedTuple):
    """Since when each state and each sensor's failure lasts, by the event log."""

    states: Mapping[str, datetime]
    sensors: Mapping[str, datetime]


NOTHING_LOGGED: Final = Logged({}, {})


@dataclass(frozen=True, slots=True)
class Situation:
    """Everything that a verdict rests on.

    Parameters
    ----------
    record
        The latest readings, each judged.
    latest
        Time of the reading in use, None without any.
    clocks
        What is said of readings whose clock is wrong, that the table rests on.
    notes
        What else a user should know, without effect on the verdict.
    watch, drifting_since
        What the sequential test of verifications says, and since when it is beyond its limits.
    last_check, not_adopted
        By how much the latest verification was off, and what an analysis confirmed in vain.
    logged
        What the event log says; it knows more than the latest readings of what began long ago.
    analysis
        The analysis that runs or waits, if any.
    """

    model: CompiledModel
    model_version: int | None
    judged_at: datetime
    sensors: Sequence[SensorState]
    record: JudgedRecord
    latest: datetime | None
    table: CompensationTable | ThermapError
    clocks: Sequence[str] = ()
    notes: Sequence[str] = ()
    watch: str = "not-judged"
    drifting_since: datetime | None = None
    last_check: LastCheck | None = None
    not_adopted: NotAdopted | None = None
    logged: Logged = NOTHING_LOGGED
    analysis: RunningAnalysis | None = None


class Cause(NamedTuple):
    """Something that is the matter.

    It touches components, and is about sensors or what else tells it from another of its state.
    """

    state: State
    sentence: str
    since: datetime | None = None
    touches: tuple[str, ...] = ()
    about: tuple[str, ...] = ()


def judge(situation: Situation) -> MachineStatus:
    """Say whether a machine can be trusted now, and why not.

    The worst cause gives the state; causes of one state stay in the order of the sensors. A
    temperature that was outside the maps is said for another 30 s.
    """
    table = situation.table
    beyond: list[BeyondMaps] = []
    if isinstance(table, ThermapError):
        causes = [_no_table(situation, table)]
    else:
        beyond = list_beyond(table)
        causes = list(_causes(situation, table, beyond))
        causes += _otherwise_incomplete(table, causes)
    causes.sort(key=lambda cause: cause.state.gravity)
    components = [] if isinstance(table, ThermapError) else table.components
    rates = {s.sensor: _rate_k_per_h(situation, s) for s in situation.sensors}
    state = causes[0].state if causes else State.FRESH
    # A table that stands still is one to be seen, but nothing that changes.
    stands_still = state is State.NO_READING
    chain = situation.model.machine.chain
    return MachineStatus(
        machine=situation.model.machine.id,
        name=situation.model.machine.name,
        configuration=chain.text,
        verdict=state.verdict,
        state=state,
        about=tuple(dict.fromkeys(a for c in causes if c.state is state for a in c.about)),
        since=_since(situation, causes[0]) if causes else None,
        sentences=(
            *_sentences(causes, components),
            *_asked_in_fahrenheit(situation, causes),
            *situation.notes,
        ),
        computed_at=situation.judged_at,
        reading_time=situation.latest,
        reading_age_s=_age_s(situation),
        model_version=situation.model_version,
        components=len(components),
        complete=not isinstance(table, ThermapError) and table.complete,
        largest=largest_of(
            (c.component, c.positions_mm, c.compensation, c.backward_compensation)
            for c in components
        ),
        change_per_h=None if stands_still else change_per_h(table, rates),
        beyond=tuple(beyond),
        watch=situation.watch,
        last_check=situation.last_check,
        not_adopted=situation.not_adopted,
        analysis=situation.analysis,
        sensors=tuple(_sensors_now(situation, rates)),
    )


def _no_table(situation: Situation, why: ThermapError) -> Cause:
    """Say why there is no table."""
    # In the order in which they have to be put right: without a model no reading is missed, and
    # without readings no sensor has failed.
    if isinstance(why, NotEnoughMaps) or not situation.model.groups:
        return Cause(State.NO_MODEL, _no_model(situation.model.omitted))
    if situation.latest is None:
        absent = {s.sensor: s.no_value_since for s in situation.sensors}
        said = [_no_value_of(situation, name, at) for name, at in absent.items() if at]
        words = "No reading has come yet: there is no compensation table."
        return Cause(State.NO_READING, " ".join([words, *map(_ended, said[:MOST_CODES])]))
    if isinstance(why, OutsideMaps):
        return Cause(State.OUTSIDE_MAPS, _nothing(why))
    if isinstance(why, SensorUnavailable):
        usable = {s.sensor for s in situation.sensors if s.health in (Health.OK, Health.STALE)}
        without = [g for g in situation.model.groups if not {s.sensor for s in g.scales} & usable]
        failed = {s.sensor: s for s in situation.sensors if s.sensor in {g.sensor for g in without}}
        details = [text for s in failed.values() if (text := _detail(situation, s))]
        codes = [code for group in without for code in group.codes]
        since = [_failed_since(situation, name) for name in failed]
        return Cause(
            State.SENSOR_FAULT,
            f"There is no table: {'; '.join(details) or why.detail}. Nothing stands in for it, and "
            f"{counted(len(codes), 'component')} cannot be computed.",
            min((time for time in since if time), default=None),
            about=tuple(failed),
        )
    return Cause(State.SENSOR_FAULT, _nothing(why))


def _nothing(why: ThermapError) -> str:
    return f"There is no table: {why.detail}."


def _no_model(omitted: Mapping[str, str]) -> str:
    """Say what a model lacks that has no component; the maps may be there."""
    unassigned = [code for code, why in omitted.items() if why == NO_SENSOR]
    if unassigned:
        return (
            "There is no compensation table: no sensor is assigned to "
            f"{list_names(unassigned, MOST_CODES)}. Assign one on the page Set-up, or with "
            "`thermap sensors assign`."
        )
    return "No component has maps of two thermal states: there is no compensation table."


def _causes(
    situation: Situation, table: CompensationTable, beyond: Sequence[BeyondMaps]
) -> Iterator[Cause]:
    # The order counts within a state alone: `judge` sorts by gravity and leaves equals as they
    # come.
    yield from _old(situation, table)
    yield from _outside(situation, table, beyond)
    yield from _outside_before(situation, table)
    for effect in table.effects:
        name = f"{effect.kind} of {list_names(effect.components)}"
        for words in effect.held:
            yield Cause(State.HELD, _sentence(words), touches=effect.components, about=(name,))
        if effect.missing:
            yield Cause(
                State.EFFECT_MISSING,
                f"{name} is not in the table: {effect.missing}.",
                touches=effect.components,
                about=(name,),
            )
    yield from _incomplete(situation, table)
    yield from _without_value(situation, table)
    yield from _late(situation, table)
    yield from _checked(situation)
    yield from _standing_in(situation, table)


def _old(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say which temperatures are old, and what rests on them."""
    latest = situation.latest
    if latest is None:
        return
    if _has_stopped(situation):
        at = _clock(latest, situation.judged_at)
        yield Cause(
            State.NO_READING,
            f"No reading since {at}. The table has stood still since then.",
            latest,
            tuple(c.component.code for c in table.components),
        )
        return
    for sensor in situation.sensors:
        codes = _resting_on(table, sensor.sensor)
        if codes and sensor.health is Health.STALE:
            yield Cause(
                State.STALE,
                _because(_not_read(situation, sensor), _rest_on_it(len(codes))),
                _stale_since(situation, sensor),
                tuple(codes),
                (sensor.sensor,),
            )


def _has_stopped(situation: Situation) -> bool:
    """Whether no reading at all has come for so long that the table stands still."""
    limit = timedelta(seconds=NO_READING_AGES * _max_age_s(situation.model))
    return situation.latest is not None and situation.judged_at - situation.latest > limit


def _without_value(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say which sensors have no value by what their senders say, before their last one is old."""
    for sensor in situation.sensors:
        since = sensor.no_value_since
        if since is None or sensor.health is not Health.OK:
            continue
        codes = _resting_on(table, sensor.sensor)
        yield Cause(
            State.LATE if codes else State.FRESH,
            _because(_no_value_of(situation, sensor.sensor, since), _rest_on_last(len(codes))),
            since,
            tuple(codes),
            (sensor.sensor,),
        )


def _detail(situation: Situation, sensor: SensorState) -> str:
    since = sensor.no_value_since
    said = [] if since is None else [_no_value_of(situation, sensor.sensor, since)]
    details = [sensor.detail, *said] if sensor.detail else said
    return "; ".join(details)


def _no_value_of(situation: Situation, sensor: str, since: datetime) -> str:
    return (
        f"{sensor} has no value since {_clock(since, situation.judged_at)}, by what its sender says"
    )


def _late(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say in one sentence which sensors should have come again, and what rests on them."""
    sensors = {
        s.sensor: s
        for s in situation.sensors
        # Where a sender says that there is no value, `_without_value` says so: that is no delay.
        if s.is_late and s.no_value_since is None and _resting_on(table, s.sensor)
    }
    if not sensors:
        return
    resting = {code for name in sensors for code in _resting_on(table, name)}
    codes = tuple(c.component.code for c in table.components if c.component.code in resting)
    longest = max(sensors.values(), key=lambda s: s.age_s or 0.0)
    measured = situation.judged_at - timedelta(seconds=longest.age_s or 0.0)
    words = (
        f"{list_names(sensors, MOST_CODES)} {'has' if len(sensors) == 1 else 'have'} not been "
        f"read since {measured:%H:%M:%S} UTC, where a reading usually comes every "
        f"{round(longest.interval_s or 0.0, 1):g} s"
    )
    yield Cause(
        State.LATE,
        _because(
            words, _rest_on_it(len(codes)) if len(sensors) == 1 else _rest_on_them(len(codes))
        ),
        measured + timedelta(seconds=longest.late_after_s or 0.0),
        codes,
        tuple(sensors),
    )


def _rest_on_it(count: int) -> str:
    return f"{count} component rests on it" if count == 1 else f"{count} components rest on it"


def _rest_on_them(count: int) -> str:
    return f"{count} component rests on them" if count == 1 else f"{count} components rest on them"


def _rest_on_last(count: int) -> str:
    if not count:
        return NOTHING_RESTS
    return (
        f"{count} component rests on its last one"
        if count == 1
        else f"{count} components rest on its last one"
    )


def _because(matter: str, consequence: str) -> str:
    return f"{matter}: {consequence}."


def _ended(words: str) -> str:
    return f"{words}."


def _not_read(situation: Situation, sensor: SensorState) -> str:
    measured = situation.judged_at - timedelta(seconds=sensor.age_s or 0.0)
    now, since = situation.judged_at, sensor.no_value_since
    if since is None:
        return f"{sensor.sensor} has not been read since {_clock(measured, now)}"
    return (
        f"{sensor.sensor} has not been read since {_clock(measured, now)} and has no value "
        f"since {_clock(since, now)}, by what its sender says"
    )


def _stale_since(situation: Situation, sensor: SensorState) -> datetime:
    max_age_s = situation.model.machine.sensors[sensor.sensor].max_age_s
    return situation.judged_at - timedelta(seconds=(sensor.age_s or 0.0) - max_age_s)


def _outside(
    situation: Situation, table: CompensationTable, beyond: Sequence[BeyondMaps]
) -> Iterator[Cause]:
    """Say which sensors are outside the maps, and what is done about it."""
    told: set[str] = set()
    for one in beyond:
        told |= set(one.components)
        where = _outside_words(one.outside_k)
        yield Cause(
            State.EXTRAPOLATED if one.held_at is None else State.CLAMPED,
            _because(f"{one.sensor} is {where}", _done(one)),
            _outside_since(situation, table, one),
            one.components,
            (one.sensor,),
        )
        if one.lacks is not None and round(abs(one.lacks.value), 1) > 0.0:
            yield Cause(
                State.CLAMPED,
                f"If its errors continue in a straight line, {one.lacks.component} lacks "
                f"{abs(one.lacks.value):.1f} {one.lacks.unit} of compensation{one.lacks.place}.",
            )
    # An effect may read the maps of a component by another sensor than the assigned one.
    for c in table.components:
        code, basis = c.component.code, c.basis
        if code not in told and basis.status in (Status.CLAMPED, Status.EXTRAPOLATED):
            yield Cause(
                State(str(basis.status)),
                f"{code} is {basis.status}: {basis.sensor} is outside the maps.",
                touches=(code,),
                about=(code,),
            )


def _asked_in_fahrenheit(situation: Situation, causes: Sequence[Cause]) -> list[str]:
    """Ask whether temperatures that lie outside the maps are in °F, where all fit better so."""
    if not any(c.state in _OUTSIDE or c.state is State.OUTSIDE_MAPS for c in causes):
        return []
    temperatures_c = {
        s.sensor: s.temperature_c for s in situation.sensors if s.temperature_c is not None
    }
    to_c = TemperatureUnit.FAHRENHEIT.to_c
    for group in situation.model.groups:
        ends_c, stated_c = between_maps_c([group]), temperatures_c.get(group.sensor)
        if ends_c is None or stated_c is None:
            continue
        if abs(outside_k(stated_c, ends_c)) <= abs(outside_k(to_c(stated_c), ends_c)):
            return []
    questions = asked_in_fahrenheit([round(t, 1) for t in temperatures_c.values()])
    return [f"{capitalised(question)}." for question in questions]


def _done(one: BeyondMaps) -> str:
    count = len(one.components)
    if one.held_at is None:
        return (
            f"{count} component is extrapolated"
            if count == 1
            else f"{count} components are extrapolated"
        )
    return (
        f"{count} component is held at {one.held_at}"
        if count == 1
        else f"{count} components are held at {one.held_at}"
    )


def _outside_before(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say which sensors were outside the maps a moment ago and are not now."""
    since_s = (situation.judged_at - LINGERS).timestamp()
    for group_state in table.states:
        if group_state.status in (Status.CLAMPED, Status.EXTRAPOLATED):
            continue
        scale = group_state.scale
        times, values = situation.record.believed.series(scale.sensor)
        excess = excess_k(values, scale.temperatures_c)
        recent = np.flatnonzero((excess != 0.0) & (times >= since_s))
        if recent.size:
            until = _time(times[recent[-1]])
            is_clamped = situation.model.machine.out_of_range == "clamp"
            yield Cause(
                State.CLAMPED if is_clamped else State.EXTRAPOLATED,
                f"{scale.sensor} was {_outside_words(float(excess[recent[-1]]))} until "
                f"{until:%H:%M:%S} UTC.",
                about=(scale.sensor,),
            )


def _incomplete(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say what the table lacks although maps have it, and which clocks are wrong."""
    for words, codes in omissions(situation.model.omitted, MOST_CODES).items():
        yield Cause(State.INCOMPLETE, _sentence(words), touches=codes, about=tuple(codes))
    corrected = {c.component.code for c in table.corrected}
    for group_state in table.states:
        for words in shortenings(group_state, corrected):
            yield Cause(State.INCOMPLETE, _sentence(words))
    for words in situation.clocks:
        yield Cause(State.INCOMPLETE, _sentence(words), situation.latest)


def _otherwise_incomplete(table: CompensationTable, causes: Sequence[Cause]) -> Iterator[Cause]:
    """Let no table count as whole that says of itself that it is not."""
    if table.complete or any(c.state.gravity <= State.INCOMPLETE.gravity for c in causes):
        return
    for words in table.warnings or ["The table is not complete"]:
        yield Cause(State.INCOMPLETE, _sentence(words))


def _standing_in(situation: Situation, table: CompensationTable) -> Iterator[Cause]:
    """Say which sensors another one stands in for, and which failed without harm."""
    details = {s.sensor: s for s in situation.sensors}
    served: dict[tuple[str, str], list[str]] = {}
    for c in table.components:
        if c.basis.stand_in_for and c.basis.sensor:
            served.setdefault((c.basis.sensor, c.basis.stand_in_for), []).append(c.component.code)
    for (sensor, assigned), codes in served.items():
        failed = details[assigned]
        is_stale = failed.health is Health.STALE
        why = _not_read(situation, failed) if is_stale else _detail(situation, failed)
        words = (
            f"{sensor} stands in for {assigned} in {len(codes)} component"
            if len(codes) == 1
            else f"{sensor} stands in for {assigned} in {len(codes)} components"
        )
        yield Cause(
            State.STAND_IN,
            _because(words, why) if why else _ended(words),
            _stale_since(situation, failed) if is_stale else _failed_since(situation, assigned),
        )
    replaced = {assigned for _, assigned in served}
    for state in situation.sensors:
        if state.health is Health.OK or state.sensor in replaced:
            continue
        is_used = bool(_resting_on(table, state.sensor))
        if state.health is Health.STALE:
            # Of one that is used `_old` has spoken, and where nothing comes at all it is said of
            # all at once.
            if not is_used and not _has_stopped(situation):
                yield Cause(State.FRESH, _because(_not_read(situation, state), NOTHING_RESTS))
        else:
            said = [_detail(situation, state), *([] if is_used else [NOTHING_RESTS])]
            yield Cause(State.FRESH, _ended("; ".join(said)))


def _checked(situation: Situation) -> Iterator[Cause]:
    """Say what verifications and analyses say against the table."""
    if situation.watch == "beyond":
        yield Cause(
            State.DRIFTING,
            "Verifications are beyond what the model allows: the machine has changed.",
            situation.drifting_since,
        )
    check = situation.last_check
    if check is not None and check.as_expected is False:
        about = () if check.component is None else (check.component,)
        yield Cause(
            State.CHECK_OFF,
            f"The last check was {check.text}.",
            check.time,
            about=about,
        )
    if situation.not_adopted is not None:
        effects = situation.not_adopted.effects
        more = len(effects) - 1
        first = effects[0].removesuffix(".")
        found = (
            f"Analysis {situation.not_adopted.analysis} confirmed what the table does not "
            f"have: {f'{first}, and {more} more' if more else first}."
        )
        needs_analysis = situation.not_adopted.needs_analysis
        what = "Analyse again and adopt it." if needs_analysis else "Adopt it."
        yield Cause(State.EFFECT_NOT_ADOPTED, f"{found} {what}")


def _sentences(causes: Sequence[Cause], components: Sequence[ComponentCompensation]) -> list[str]:
    """Write what is the matter, and what is good all the same."""
    state = causes[0].state if causes else State.FRESH
    said = list(dict.fromkeys(cause.sentence for cause in causes))
    if not components or state is State.NO_READING:
        return said
    count = len(components)
    if state is State.FRESH:
        between = (
            "The one component lies between its maps, on fresh temperatures."
            if count == 1
            else f"All {count} components lie between their maps, on fresh temperatures."
        )
        return [between, *said]
    touched = {code for cause in causes for code in cause.touches}
    others = sum(c.component.code not in touched for c in components)
    # A drift, a check that is off, a wrong clock, positions that are missing: nobody knows whom
    # they touch.
    spares = all(
        c.touches or c.state.gravity > _LAST_UNPLACED or c.state in _OUTSIDE for c in causes
    )
    if spares and touched and 0 < others < count:
        said.append(
            "The other component can be trusted."
            if others == 1
            else f"The {others} other components can be trusted."
        )
    return said


def _sensors_now(situation: Situation, rates: Mapping[str, float | None]) -> Iterator[SensorNow]:
    """Describe every sensor, the assigned ones first; rates in K/h."""
    groups = situation.model.groups
    assigned: dict[str, list[str]] = {}
    for group in groups:
        assigned.setdefault(group.sensor, []).extend(group.codes)
    for sensor in sorted(situation.sensors, key=lambda s: s.sensor not in assigned):
        own = [g for g in groups if g.sensor == sensor.sensor]
        maps_c = between_maps_c(own)
        outside = None
        if maps_c is not None and sensor.temperature_c is not None:
            outside = outside_k(sensor.temperature_c, maps_c)
        yield SensorNow(
            sensor=sensor.sensor,
            temperature_c=sensor.temperature_c,
            age_s=sensor.age_s,
            rate_k_per_h=rates[sensor.sensor],
            interval_s=sensor.interval_s,
            is_late=sensor.is_late,
            no_value_since=sensor.no_value_since,
            health=sensor.health,
            detail=sensor.detail,
            outside_maps_k=outside,
            maps_c=maps_c,
            assigned_to=tuple(assigned.get(sensor.sensor, ())),
        )


def _rate_k_per_h(situation: Situation, state: SensorState) -> float | None:
    """How fast a sensor that is believed changes [K/h]."""
    if state.health is not Health.OK or situation.latest is None:
        return None
    times, values = situation.record.believed.series(state.sensor)
    recent = times >= situation.latest.timestamp() - LONGEST_S
    resolution_c = situation.model.machine.sensors[state.sensor].resolution_c
    return rate_k_per_h(times[recent], values[recent], resolution_c)


def _since(situation: Situation, cause: Cause) -> datetime | None:
    """Since when the state of a cause lasts: by readings, or else by the event log."""
    logged = situation.logged.states.get(cause.state)
    # A clock that was set back leaves alarms of the future behind.
    is_past = logged is not None and logged <= situation.judged_at
    if cause.since is None:
        return logged if is_past else None
    return min(cause.since, situation.judged_at)  # a sender's clock may be ahead, ours go back


def _outside_since(
    situation: Situation, table: CompensationTable, one: BeyondMaps
) -> datetime | None:
    """Since when a sensor has been outside the maps, as far back as readings or log reach."""
    scale = next(s.scale for s in table.states if s.sensor == one.sensor)
    times, values = situation.record.believed.series(one.sensor)
    inside = np.flatnonzero(excess_k(values, scale.temperatures_c) == 0.0)
    first = int(inside[-1]) + 1 if inside.size else 0
    if first >= times.size:
        return situation.latest
    if inside.size:
        return _time(times[first])
    state = State.EXTRAPOLATED if one.held_at is None else State.CLAMPED
    # In all that is in memory it is outside: it began before that, and the log may know when.
    return min(_time(times[0]), situation.logged.states.get(state, situation.judged_at))


def _failed_since(situation: Situation, sensor: str) -> datetime | None:
    """Since when a sensor has not been believed, as far back as readings or log reach."""
    times, _ = situation.record.history.series(sensor)
    are_believed = situation.record.are_believed(sensor)
    if not times.size or are_believed[-1]:
        return None
    believed = np.flatnonzero(are_believed)
    if believed.size:
        return _time(times[believed[-1] + 1])
    return min(_time(times[0]), situation.logged.sensors.get(sensor, situation.judged_at))


def _resting_on(table: CompensationTable, sensor: str) -> list[str]:
    """List the components of the table that rest on a sensor, their effects included."""
    by_maps = {c.component.code for c in table.components if c.basis.sensor == sensor}
    by_effects = {
        code for effect in table.effects if sensor in effect.sensors for code in effect.components
    }
    codes = by_maps | by_effects
    return [c.component.code for c in table.components if c.component.code in codes]


def _max_age_s(model: CompiledModel) -> float:
    """The longest time that a temperature on which components rest may be old [s]."""
    sensors: Mapping[str, object] = {g.sensor: None for g in model.groups} or model.machine.sensors
    return max((model.machine.sensors[name].max_age_s for name in sensors), default=0.0)


def _age_s(situation: Situation) -> float | None:
    if situation.latest is None:
        return None
    return max((situation.judged_at - situation.latest).total_seconds(), 0.0)


def _outside_words(outside_k: float) -> str:
    if outside_k > 0.0:
        return f"{outside_k:.2f} K above the hottest map"
    return f"{-outside_k:.2f} K below the coldest map"


def _sentence(words: str) -> str:
    """End words with a full stop."""
    return words if words.endswith(".") else f"{words}."


def _time(time_s: float) -> datetime:
    return datetime.fromtimestamp(float(time_s), UTC)


def _clock(time: datetime, now: datetime) -> str:
    """Write a time as short as it can be understood, with its zone."""
    is_near = abs(now - time) < timedelta(hours=20)
    return (
        f"{time.astimezone(UTC):%H:%M UTC}"
        if is_near
        else f"{time.astimezone(UTC):%Y-%m-%d %H:%M UTC}"
    )

"""A machine over time: temperatures, the compensation at a place, checks and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Final

import numpy as np
from sqlalchemy.orm import Session

from app.answer import Answer
from app.arrays import FloatArray
from app.errors import Conflict, InvalidContent, UnknownThing
from app.events.event import Event, EventKind
from app.geometry.components import Component, parse_component
from app.services.context import Context
from app.services.loop import show_left_of_check
from app.services.observations import ErrorQuestion
from app.services.predictions import predict_errors
from app.storage.events import list_events
from app.storage.machines import find_machine, stored_machine
from app.storage.readings import newest_id
from app.storage.temperature_hours import (
    MINUTE_S,
    binned_hours,
    binned_up_to,
    bins_of_readings,
    hour_of,
)
from app.storage.verifications import list_verifications
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.temperature_bins import Part, merge_bins, width_for

USUAL_SPAN: Final = timedelta(hours=24)
LONGEST_SPAN: Final = timedelta(days=3660)

READ_DIRECTLY: Final = timedelta(hours=3)
"""Of a shorter time bins are made of the readings themselves, as narrow as wanted."""

LATEST: Final = timedelta(minutes=15)
"""The latest readings are not in hours yet (`app.services.bin_readings`)."""

MOST_UNBINNED: Final = 100_000
"""Readings of all machines that are in no hour yet and are looked through for a history."""

MOST_MARKS: Final = 300
"""Events, and checks: the newest."""

MOST_COMPARED: Final = 50
"""Checks that are held against the active version: the newest."""

MARKED: Final = (
    EventKind.ALARM,
    EventKind.MODEL,
    EventKind.MACHINE,
    EventKind.READINGS,
)


@dataclass(frozen=True, slots=True)
class Place:
    """Where compensation is asked for."""

    component: str
    position_mm: float | None


@dataclass(frozen=True, slots=True)
class TemperatureHistoryAnswer(Answer, published_as="TemperatureCourse"):
    """A sensor's temperatures in bins; bins without a reading are left out."""

    sensor: str
    """Sensor"""
    max_age_s: float
    """What is further apart is not joined: the sensor's `max_age_s` [s]"""
    after_s: tuple[float, ...]
    """Where each bin begins, after `since` [s]; the first may begin before it"""
    low_c: tuple[float, ...]
    """Lowest temperature of each bin [°C]"""
    high_c: tuple[float, ...]
    """Highest temperature [°C]"""
    mean_c: tuple[float, ...]
    """Mean of the readings [°C]"""
    count: tuple[int, ...]
    """Number of readings"""
    gap_s: tuple[float, ...]
    """Longest time without a reading in the bin or before it, up to the bin before [s]"""


@dataclass(frozen=True, slots=True)
class CompensationCourse(Answer):
    """The compensation at one place over time, as one model version has it."""

    component: str
    """Code of the component"""
    position_mm: float | None
    """Position along its axis [mm], null for a component without positions"""
    unit: str
    """Unit of the values"""
    model_version: int | None
    """The version by which all of it is computed: the active one; null where there is none"""
    after_s: tuple[float, ...]
    """Times after `since`: the middles of bins, whose mean temperatures it is computed of [s]"""
    values: tuple[float | None, ...]
    """Minus the error, in `unit`; null where it cannot be computed"""
    warnings: tuple[str, ...]
    """What is not in it, and why"""


@dataclass(frozen=True, slots=True)
class CheckMark(Answer):
    """A verification over time."""

    verification: int
    """Number of the verification"""
    label: str
    """Its label"""
    time: datetime
    """When its last observation was made"""
    status: str
    """`within`, `beyond` or `not-judged`: what the watch said of it"""
    summary: str
    """The same in words"""
    left_um: float | None = None
    """What the active version leaves of its lengths, root mean square [µm]; null where it was not
    asked for, or `why_not`"""
    why_not: str = ""
    """Why nothing can be said of that"""


@dataclass(frozen=True, slots=True)
class History(Answer):
    """What happened to a machine between two times."""

    machine: str
    """Id of the machine"""
    since: datetime
    """The first time, UTC"""
    until: datetime
    """The last one"""
    bin_s: float
    """Width of the bins [s]"""
    sensors: tuple[TemperatureHistoryAnswer, ...]
    """Temperatures"""
    compensation: CompensationCourse | None
    """The compensation at the place that was asked for, null where none was"""
    checks: tuple[CheckMark, ...]
    """Verifications, in order of time"""
    events: tuple[Event, ...]
    """Alarms, versions and other changes, the newest first"""
    notes: tuple[str, ...]
    """What is not shown, and why"""


@dataclass(frozen=True, slots=True)
class _Window:
    """Two times, and the width of bins between them [s]."""

    since: datetime
    until: datetime
    width_s: int

    @property
    def origin_s(self) -> float:
        return self.since.timestamp()


def show_history(
    context: Context,
    machine_id: str,
    since: datetime | None = None,
    until: datetime | None = None,
    sensors: Sequence[str] = (),
    points: int = 1000,
    place: Place | None = None,
    *,
    residuals: bool = False,
) -> History:
    """Gather a machine's history.

    Parameters
    ----------
    since, until
        None: of the last 24 hours before `until`, or before now.
    sensors
        Only these; none for all.
    points
        At most so many bins, or a few more where none are that wide.
    residuals
        Whether the latest checks are held against the active version, which takes longer.

    Raises
    ------
    InvalidContent
        If the times or the place cannot be right.
    """
    window = _window(context, since, until, points)
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        for name in sensors:
            machine.sensor(name)
        _check_place(machine, place)
        chosen = tuple(sensors) or tuple(machine.sensors)
        needed = tuple(machine.sensors) if place is not None else chosen
        bins, notes = _bins(session, machine_id, window, needed, context.now())
        events = list_events(
            session,
            machine_id,
            since=window.since,
            until=window.until,
            kinds=MARKED,
            limit=MOST_MARKS,
        )
        checks = _checks(session, machine_id, window)
    if residuals:
        checks = tuple(
            _with_residuals(context, machine_id, check) for check in checks[-MOST_COMPARED:]
        )
    return History(
        machine_id,
        window.since,
        window.until,
        float(window.width_s),
        tuple(_course(machine, name, bins[name], window) for name in chosen),
        None if place is None else _compensation(context, machine_id, place, bins, window),
        checks,
        tuple(events),
        notes,
    )


def _window(
    context: Context, since: datetime | None, until: datetime | None, points: int
) -> _Window:
    until = context.now() if until is None else until
    since = until - USUAL_SPAN if since is None else since
    if not timedelta(0) < until - since <= LONGEST_SPAN:
        raise InvalidContent.of_field(
            "from",
            f"expected a time before {until:%Y-%m-%d %H:%M:%S} UTC, by at most "
            f"{LONGEST_SPAN.days} days, got {since:%Y-%m-%d %H:%M:%S} UTC",
        )
    width_s = width_for((until - since).total_seconds(), points)
    if until - since > READ_DIRECTLY:
        width_s = max(width_s, MINUTE_S)
    return _Window(since.astimezone(UTC), until.astimezone(UTC), width_s)


def _check_place(machine: Machine, place: Place | None) -> None:
    if place is None:
        return
    component, _ = parse_component(place.component)
    if component.axis is None or not component.is_table:
        return
    if place.position_mm is None:
        raise InvalidContent.of_field(
            "position_mm", f"expected a position along {component.axis} [mm], got none"
        )
    travel = machine.axes.get(component.axis)
    if travel is not None and not travel.holds(place.position_mm):
        raise InvalidContent.of_field(
            "position_mm",
            f"expected a position within the travel of {component.axis} from {travel.min_mm:g} to "
            f"{travel.max_mm:g} mm, got {place.position_mm:g} mm",
        )


def _bins(
    session: Session,
    machine_id: str,
    window: _Window,
    sensors: Sequence[str],
    now: datetime,
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Read temperatures in the window's bins: older ones as hours, the latest themselves.

    Of the older ones those that are in no hour yet are read themselves, too, if they are few.

    Returns
    -------
    dict, tuple
        Bins by sensor, and what is not in them.
    """
    since, until, width_s = window.since, window.until, window.width_s
    if width_s < MINUTE_S:
        bins = bins_of_readings(session, machine_id, since, until, width_s)
        return {name: merge_bins(_of(bins, name), width_s) for name in sensors}, ()
    #     since                               latest             until
    #       ├─ hours, of readings up to the ──────┼─ the readings ───┤
    #       │  number `above`                     │  themselves
    #       └─ readings above that number, if few ┘
    latest = max(hour_of(now - LATEST), hour_of(since))
    hours = binned_hours(
        session,
        machine_id,
        hour_of(since),
        min(latest, until),
        sensors,
        whole=width_s >= 3600,
    )
    above, newest = binned_up_to(session), newest_id(session)
    are_few = newest - above <= MOST_UNBINNED
    added: list[Mapping[str, FloatArray]] = []
    if are_few:
        end = min(latest, until)
        added.append(
            bins_of_readings(session, machine_id, since, end, MINUTE_S, up_to=newest, above=above)
        )
    if until > latest:
        start = max(since, latest)
        added.append(bins_of_readings(session, machine_id, start, until, MINUTE_S))
    binned = {}
    for name in sensors:
        parts = np.concatenate(
            [_within(hours[name], window), *(_of(partial, name) for partial in added)]
        )
        in_order = parts[np.argsort(parts[:, Part.FIRST], kind="stable")]
        binned[name] = merge_bins(in_order, width_s)
    note = (
        "readings are still being summed up: what was stored before an upgrade, or lately for "
        f"times before {latest:%Y-%m-%d %H:%M} UTC, is not all shown yet"
    )
    return binned, () if are_few else (note,)


def _of(bins_by_sensor: Mapping[str, FloatArray], sensor: str) -> FloatArray:
    return bins_by_sensor.get(sensor, np.empty((0, len(Part))))


def _within(bins: FloatArray, window: _Window) -> FloatArray:
    """Leave out what lies before the window and behind it."""
    lasts, firsts = bins[:, Part.LAST], bins[:, Part.FIRST]
    return bins[(lasts >= window.origin_s) & (firsts <= window.until.timestamp())]


def _course(
    machine: Machine, sensor: str, bins: FloatArray, window: _Window
) -> TemperatureHistoryAnswer:
    def column(part: Part, digits: int = 4) -> tuple[float, ...]:
        return tuple(np.round(bins[:, part], digits).tolist())

    return TemperatureHistoryAnswer(
        sensor,
        machine.sensors[sensor].max_age_s,
        tuple(np.round(bins[:, Part.START] - window.origin_s, 3).tolist()),
        column(Part.LOW),
        column(Part.HIGH),
        column(Part.MEAN),
        tuple(bins[:, Part.COUNT].astype(int).tolist()),
        column(Part.GAP, 1),
    )


def _compensation(
    context: Context,
    machine_id: str,
    place: Place,
    bins: Mapping[str, FloatArray],
    window: _Window,
) -> CompensationCourse:
    """Compute the compensation of the bins' mean temperatures."""
    component: Component = parse_component(place.component)[0]
    of_bins: dict[float, dict[str, float]] = {}
    for sensor, rows in bins.items():
        for start, mean in zip(rows[:, Part.START], rows[:, Part.MEAN], strict=True):
            of_bins.setdefault(float(start) + window.width_s / 2.0, {})[sensor] = float(mean)
    readings = [
        Reading(datetime.fromtimestamp(at_s, UTC), temperatures, {})
        for at_s, temperatures in sorted(of_bins.items())
    ]
    questions = [ErrorQuestion(r.time, component.code, place.position_mm) for r in readings]
    after_s = tuple(round(r.time.timestamp() - window.origin_s, 3) for r in readings)
    unit = component.unit.symbol
    if not questions:
        return CompensationCourse(component.code, place.position_mm, unit, None, (), (), ())
    try:
        predicted = predict_errors(context, machine_id, questions, readings=readings)
    except (Conflict, InvalidContent) as why:
        nothing = (None,) * len(questions)
        return CompensationCourse(
            component.code, place.position_mm, unit, None, after_s, nothing, (why.detail,)
        )
    values = tuple(
        round(-value, 4) + 0.0 if isinstance(value, float) else None
        for value in predicted.predicted_um
    )
    return CompensationCourse(
        component.code,
        place.position_mm,
        unit,
        predicted.model_version,
        after_s,
        values,
        tuple(predicted.warnings),
    )


def _with_residuals(context: Context, machine_id: str, mark: CheckMark) -> CheckMark:
    try:
        of_check = show_left_of_check(context, machine_id, mark.verification)
    except UnknownThing:  # deleted meanwhile
        return mark
    size = None if of_check.lengths is None else round(of_check.lengths.rms, 4)
    return replace(mark, left_um=size, why_not=of_check.why_not)


def _checks(session: Session, machine_id: str, window: _Window) -> tuple[CheckMark, ...]:
    verifications = [
        verification
        for verification in list_verifications(session, machine_id)
        if window.since <= verification.last_at <= window.until
    ]
    return tuple(
        CheckMark(
            verification.id,
            verification.label,
            verification.last_at,
            "not-judged" if verification.judgement is None else verification.judgement.status,
            "" if verification.judgement is None else verification.judgement.summary,
        )
        for verification in sorted(verifications, key=lambda verification_: verification_.last_at)[
            -MOST_MARKS:
        ]
    )

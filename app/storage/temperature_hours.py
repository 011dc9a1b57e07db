"""Readings in bins: from the readings themselves, or from hours that were binned before."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final

import numpy as np
from sqlalchemy import delete, select, text, update
from sqlalchemy.orm import Session

from app.arrays import FloatArray
from app.storage.tables import ReadingRow, TemperatureHourRow, TemperatureHoursDoneRow
from app.thermal.temperature_bins import PARTS, merge_bins, no_bins

HOUR: Final = timedelta(hours=1)
MINUTE_S: Final = 60

# 1970 began on the Julian day 2440587.5. SQLite's '%s' cuts the fraction of a second off: enough
# for the place of a bin, not for the first and last time in it.
_BINS: Final = {
    "postgresql": (
        "SELECT v.key, floor(extract(epoch FROM r.time) / :width) * :width AS start, "
        "min(v.value::float8), max(v.value::float8), avg(v.value::float8), count(*), "
        "extract(epoch FROM min(r.time)), extract(epoch FROM max(r.time)) "
        "FROM reading r, json_each_text(r.temperatures_c) v "
        "WHERE {where} GROUP BY 1, 2 ORDER BY 1, 2"
    ),
    "sqlite": (
        "SELECT v.key, strftime('%s', r.time) / :width * :width AS start, "
        "min(v.value), max(v.value), avg(v.value), count(*), "
        "(julianday(min(r.time)) - 2440587.5) * 86400.0, "
        "(julianday(max(r.time)) - 2440587.5) * 86400.0 "
        "FROM reading r, json_each(r.temperatures_c) v "
        "WHERE {where} GROUP BY 1, 2 ORDER BY 1, 2"
    ),
}
_BY_TIME: Final = "r.machine_id = :machine AND r.time >= :since AND r.time < :until"
# The numbers are few, where the times might be those of a year. Neither database looks for an
# expression in an index, and without statistics PostgreSQL takes only a range of both ends for
# narrow.
_BY_NUMBER: Final = {
    "postgresql": (
        "r.id > :above AND r.id <= :up_to AND r.machine_id || '' = :machine "
        "AND r.time + interval '0' >= :since AND r.time + interval '0' < :until"
    ),
    "sqlite": (
        "r.id > :above AND r.id <= :up_to AND +r.machine_id = :machine "
        "AND +r.time >= :since AND +r.time < :until"
    ),
}


def bins_of_readings(
    session: Session,
    machine_id: str,
    since: datetime,
    until: datetime,
    width_s: int,
    *,
    up_to: int | None = None,
    above: int | None = None,
) -> dict[str, FloatArray]:
    """Bin readings in the database, from a time on and before another one; by sensor.

    Gaps between readings of one bin are not looked at: 0.

    Parameters
    ----------
    up_to, above
        Only those with a number up to this one, and above the other; where both are given there
        should be few between them.
    """
    dialect = session.get_bind().dialect.name
    parameters: dict[str, Any] = {
        "machine": machine_id,
        "since": _bound(since, dialect),
        "until": _bound(until, dialect),
        "width": width_s,
    }
    where = _BY_TIME
    if up_to is not None:
        where, parameters["up_to"] = f"{_BY_TIME} AND r.id <= :up_to", up_to
    if above is not None:
        where, parameters["above"] = _BY_NUMBER[dialect], above
    rows: dict[str, list[Sequence[Any]]] = defaultdict(list)
    for sensor, *parts in session.execute(text(_BINS[dialect].format(where=where)), parameters):
        rows[sensor].append((*map(float, parts), 0.0))
    return {sensor: np.array(bins) for sensor, bins in rows.items()}


def _bound(time: datetime, dialect: str) -> Any:
    if dialect != "sqlite":
        return time
    return time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S.%f")


def hour_of(time: datetime) -> datetime:
    """Give the beginning of a time's hour, UTC."""
    return time.astimezone(UTC).replace(minute=0, second=0, microsecond=0)


def bin_hour(session: Session, machine_id: str, hour: datetime, up_to: int) -> None:
    """Bin an hour of a machine that is held, in place of what there is of it.

    Parameters
    ----------
    up_to
        Readings with larger numbers are left for later.
    """
    by_sensor = bins_of_readings(session, machine_id, hour, hour + HOUR, MINUTE_S, up_to=up_to)
    session.execute(
        delete(TemperatureHourRow).where(
            TemperatureHourRow.machine_id == machine_id, TemperatureHourRow.hour == hour
        )
    )
    if not by_sensor:
        return
    session.add(
        TemperatureHourRow(
            machine_id=machine_id,
            hour=hour,
            is_stale=False,
            minutes={sensor: len(bins) for sensor, bins in by_sensor.items()},
            whole=np.concatenate([merge_bins(b, 3600.0) for b in by_sensor.values()]).ravel(),
            bins=np.concatenate([*by_sensor.values()]).ravel(),
        )
    )


def binned_hours(
    session: Session,
    machine_id: str,
    since: datetime,
    until: datetime,
    sensors: Collection[str],
    *,
    whole: bool,
) -> dict[str, FloatArray]:
    """Read hours that begin from a time on and before another one; by sensor, in order of time.

    Parameters
    ----------
    whole
        One bin for each hour; else one for each minute.
    """
    values = TemperatureHourRow.whole if whole else TemperatureHourRow.bins
    query = (
        select(TemperatureHourRow.minutes, values)
        .where(
            TemperatureHourRow.machine_id == machine_id,
            TemperatureHourRow.hour >= since,
            TemperatureHourRow.hour < until,
            TemperatureHourRow.is_stale.is_(False),
        )
        .order_by(TemperatureHourRow.hour)
    )
    pieces: dict[str, list[FloatArray]] = defaultdict(list)
    for minutes, flat in session.execute(query):
        bins = flat.reshape(-1, PARTS)
        place = 0
        for sensor, count in minutes.items():
            taken = 1 if whole else count
            if sensor in sensors:
                pieces[sensor].append(bins[place : place + taken])
            place += taken
    return {
        sensor: np.concatenate(pieces[sensor]) if sensor in pieces else no_bins()
        for sensor in sensors
    }


def hours_written_between(
    session: Session, above: int, until: int
) -> Mapping[str, Collection[datetime]]:
    """Say into which hours readings with numbers above one and up to another fell, by machine."""
    query = select(ReadingRow.machine_id, ReadingRow.time).where(
        ReadingRow.id > above, ReadingRow.id <= until
    )
    hours: dict[str, set[datetime]] = defaultdict(set)
    for machine_id, time in session.execute(query):
        hours[machine_id].add(hour_of(time))
    return hours


def stale_hours(session: Session, most: int) -> Mapping[str, Collection[datetime]]:
    """List hours of which readings were withdrawn, by machine."""
    query = (
        select(TemperatureHourRow.machine_id, TemperatureHourRow.hour)
        .where(TemperatureHourRow.is_stale.is_(True))
        .limit(most)
    )
    hours: dict[str, set[datetime]] = defaultdict(set)
    for machine_id, hour in session.execute(query):
        hours[machine_id].add(hour)
    return hours


def mark_stale(session: Session, machine_id: str, since: datetime, until: datetime) -> None:
    """Note that readings between two times have gone, both included."""
    session.execute(
        update(TemperatureHourRow)
        .where(
            TemperatureHourRow.machine_id == machine_id,
            TemperatureHourRow.hour > since - HOUR,
            TemperatureHourRow.hour <= until,
        )
        .values(is_stale=True)
    )


def delete_hours(session: Session, machine_id: str, before: datetime) -> None:
    """Delete a machine's hours that end before a time."""
    session.execute(
        delete(TemperatureHourRow).where(
            TemperatureHourRow.machine_id == machine_id, TemperatureHourRow.hour <= before - HOUR
        )
    )


def binned_up_to(session: Session) -> int:
    """Say up to which number readings are in hours."""
    return session.scalar(select(TemperatureHoursDoneRow.number)) or 0


def note_binned(session: Session, number: int) -> None:
    """Note up to which number readings are in hours."""
    session.merge(TemperatureHoursDoneRow(id=1, number=number))

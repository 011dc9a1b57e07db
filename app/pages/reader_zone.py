"""The reader's time zone: pages write times as the clock beside the machine shows them.

A browser states its zone in a cookie, and each page writes the zone beside its times; the API, and
what is saved as a document, stays in UTC.
"""

from __future__ import annotations

import re
from contextvars import ContextVar
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

COOKIE: Final = "thermap-zone"

A_DAY: Final = timedelta(days=1)

_zone: ContextVar[tzinfo] = ContextVar("zone", default=UTC)

_IN_UTC: Final = re.compile(r"(?:(\d{4}-\d\d-\d\d)[ T])?(\d\d:\d\d(?::\d\d)?) UTC")


def read_zone(name: str | None) -> None:
    """Take over the zone that a browser states; UTC where it states none, or none that exists.

    Parameters
    ----------
    name
        As in the time zone database: `Europe/Berlin`. Browsers percent-encode nothing of it.
    """
    try:
        zone = UTC if name is None else ZoneInfo(name)
    except (ValueError, OSError, ZoneInfoNotFoundError):  # no name of a zone, or none that exists
        zone = UTC
    _zone.set(zone)


def local(time: datetime) -> datetime:
    """Give a moment in the reader's zone."""
    return time.astimezone(_zone.get())


def zone_name(time: datetime) -> str:
    """Name the reader's zone as it is at a moment: `UTC`, `CET`, `UTC+03`."""
    name = local(time).tzname() or "UTC"
    return f"UTC{name}" if name[0] in "+-" else name


def zone_key() -> str:
    """Name the zone as the time zone database does."""
    return getattr(_zone.get(), "key", "UTC")


def day_and_time(time: datetime) -> str:
    """Write a moment to the second, with its zone."""
    return f"{local(time):%Y-%m-%d %H:%M:%S} {zone_name(time)}"


def localised(sentence: str, near: datetime) -> str:
    """Write the times of a sentence in the reader's zone; sentences of the service are in UTC.

    Parameters
    ----------
    near
        When it was said. A time of day without a date is the one nearest to that.

    Examples
    --------
    >>> read_zone("Europe/Berlin")
    >>> localised("late since 23:30 UTC.", datetime(2026, 7, 2, 1, 0, tzinfo=UTC))
    'late since 01:30 CEST.'
    >>> localised("late since 2026-01-01 23:30 UTC.", datetime(2026, 7, 2, 1, 0, tzinfo=UTC))
    'late since 2026-01-02 00:30 CET.'
    >>> read_zone(None)
    """

    def written(found: re.Match[str]) -> str:
        day, clock = found.groups()
        form = "%H:%M:%S" if clock.count(":") == 2 else "%H:%M"
        if day is not None:
            moment = datetime.fromisoformat(f"{day}T{clock}+00:00")
            return f"{local(moment):%Y-%m-%d {form}} {zone_name(moment)}"
        moment = datetime.fromisoformat(f"{near.astimezone(UTC):%Y-%m-%d}T{clock}+00:00")
        moment = min((moment + n * A_DAY for n in (-1, 0, 1)), key=lambda at: abs(at - near))
        return f"{local(moment):{form}} {zone_name(moment)}"

    return _IN_UTC.sub(written, sentence)

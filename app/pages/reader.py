"""The reader: pages are written in the language, the units and the zone of who reads them.

A browser states them in cookies, and each page writes the zone and the unit beside its figures; the
API, and what is saved as a document, stays English, in SI units and in UTC.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from app.languages import ENGLISH, LANGUAGES

COOKIES: Final = {
    "zone": "thermap-zone",
    "language": "thermap-language",
    "temperature": "thermap-temperature",
    "length": "thermap-length",
}

A_DAY: Final = timedelta(days=1)


@dataclass(frozen=True, slots=True)
class Reader:
    """Who reads a page: their language, zone and units."""

    language: str = ENGLISH
    zone: tzinfo = UTC
    temperature: str = "°C"
    """Or °F."""
    length: str = "mm"
    """Of positions, or in; errors are in µm for everybody."""


_reader: ContextVar[Reader] = ContextVar("reader", default=Reader())  # noqa: B039, it is frozen

_IN_UTC: Final = re.compile(r"(?:(\d{4}-\d\d-\d\d)[ T])?(\d\d:\d\d(?::\d\d)?) UTC")


def read_reader(cookies: Mapping[str, str], accepted: str = "") -> None:
    """Take over what a browser states; what it does not state, or does not exist, is the usual.

    Parameters
    ----------
    cookies
        By the names in `COOKIES`. A zone is named as in the time zone database: `Europe/Berlin`.
    accepted
        Its languages, as in the header Accept-Language.
    """
    stated = {name: cookies.get(cookie, "") for name, cookie in COOKIES.items()}
    language = stated["language"]
    _reader.set(
        Reader(
            language if language in LANGUAGES else _first_spoken(accepted),
            _zone_named(stated["zone"]),
            "°F" if stated["temperature"] == "F" else "°C",
            "in" if stated["length"] == "in" else "mm",
        )
    )


def reader() -> Reader:
    """Who reads what is written now."""
    return _reader.get()


def _first_spoken(accepted: str) -> str:
    """Choose the language that is wanted most of those that there are.

    >>> _first_spoken("fr, de-AT;q=0.9, en;q=0.8"), _first_spoken("en-US,de;q=0.7")
    ('de', 'en')
    """
    wanted = []
    for part in accepted.split(","):
        tag, _, rest = part.strip().partition(";")
        weight = rest.strip().removeprefix("q=") or "1"
        wanted.append((-float(weight) if re.fullmatch(r"[01](\.\d+)?", weight) else 0.0, tag))
    spoken = (tag.partition("-")[0].lower() for _, tag in sorted(wanted, key=lambda one: one[0]))
    return next((language for language in spoken if language in LANGUAGES), ENGLISH)


def _zone_named(name: str) -> tzinfo:
    try:
        return ZoneInfo(name) if name else UTC
    except (ValueError, OSError, ZoneInfoNotFoundError):  # no name of a zone, or none that exists
        return UTC


def local(time: datetime) -> datetime:
    """Give a moment in the reader's zone."""
    return time.astimezone(reader().zone)


def zone_name(time: datetime) -> str:
    """Name the reader's zone as it is at a moment: `UTC`, `CET`, `UTC+03`."""
    name = local(time).tzname() or "UTC"
    return f"UTC{name}" if name[0] in "+-" else name


def zone_key() -> str:
    """Name the zone as the time zone database does."""
    return getattr(reader().zone, "key", "UTC")


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
    >>> read_reader({COOKIES["zone"]: "Europe/Berlin"})
    >>> localised("late since 23:30 UTC.", datetime(2026, 7, 2, 1, 0, tzinfo=UTC))
    'late since 01:30 CEST.'
    >>> localised("late since 2026-01-01 23:30 UTC.", datetime(2026, 7, 2, 1, 0, tzinfo=UTC))
    'late since 2026-01-02 00:30 CET.'
    >>> read_reader({})
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

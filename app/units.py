"""The units of the house and the only factors between them.

Lengths and positions are mm, linear errors µm, angular errors µrad, squareness
µm/m (which is µrad), temperatures °C. A field's name ends in its unit, so this
module also says which unit a field's name promises.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, tzinfo
from enum import StrEnum
from typing import Final

UM_PER_MM: Final = 1000.0
MM_PER_M: Final = 1000.0
URAD_PER_RAD: Final = 1e6
MS_PER_S: Final = 1000.0
SECONDS_PER_MIN: Final = 60.0
SECONDS_PER_H: Final = 3600.0
SECONDS_PER_DAY: Final = 86400.0
KELVIN_AT_0_C: Final = 273.15

SMALLEST_POWER: Final = 5
"""Smaller uncertainties than 10⁻⁵ are written with a power of ten."""

_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Unit(StrEnum):
    """The unit of an error component, spelled as in the names of fields."""

    UM = "um"
    URAD = "urad"
    UM_PER_M = "um_per_m"
    URAD_PER_M = "urad_per_m"

    @property
    def symbol(self) -> str:
        """The unit as people write it."""
        return _SYMBOLS[self.value]


class TemperatureUnit(StrEnum):
    """A unit that a sender states temperatures in, spelled as MTConnect does."""

    CELSIUS = "CELSIUS"
    FAHRENHEIT = "FAHRENHEIT"
    KELVIN = "KELVIN"

    def to_c(self, value: float) -> float:
        """Convert a temperature in this unit to °C.

        >>> TemperatureUnit.FAHRENHEIT.to_c(212.0), TemperatureUnit.KELVIN.to_c(273.15)
        (100.0, 0.0)
        """
        if self is TemperatureUnit.FAHRENHEIT:
            return (value - 32.0) / 1.8
        return value - KELVIN_AT_0_C if self is TemperatureUnit.KELVIN else value


_SYMBOLS: Final = {
    "um_per_m": "µm/m",
    "urad_per_m": "µrad/m",
    "c_per_min": "°C/min",
    "per_mm": "1/mm",
    "um": "µm",
    "urad": "µrad",
    "mm": "mm",
    "c": "°C",
    "deg": "°",
    "s": "s",
    "rpm": "1/min",
}
"""Longest suffix first: `counts_per_mm` is not in mm."""


def unit_of_field(field: str) -> str | None:
    """Read the unit that a field's name promises, or None where it promises none.

    >>> unit_of_field("positions_mm"), unit_of_field("slopes_um_per_m")
    ('mm', 'µm/m')
    >>> unit_of_field("label") is None
    True
    """
    for suffix, symbol in _SYMBOLS.items():
        if field.endswith("_" + suffix):
            return symbol
    return None


def um_from_urad_mm(product: float) -> float:
    """Convert an angle times a lever arm [µrad·mm] to a displacement [µm].

    The factor serves slopes too: µm/m times mm is the same 1/1000 µm.

    >>> um_from_urad_mm(12.0 * 250.0)
    3.0
    """
    return product / MM_PER_M


def plus_minus(value: float, error: float | None, unit: str) -> str:
    """Write a value with its standard error, rounded to what is known.

    Parameters
    ----------
    error
        One standard deviation; None where none was estimated.

    Examples
    --------
    >>> plus_minus(41.23, 1.9, "min"), plus_minus(-0.2137, 0.0114, "µm/K")
    ('41 ± 2 min', '-0.214 ± 0.011 µm/K')
    >>> plus_minus(41.23, None, "min"), plus_minus(2.1e-7, 1e-8, "µm")
    ('41.2 min', '(2.10 ± 0.10)·10⁻⁷ µm')
    """
    if error is None or not error > 0 or not math.isfinite(error):
        return f"{value:.3g} {unit}"
    power = math.floor(math.log10(error))
    if power < -SMALLEST_POWER:
        exponent = math.floor(math.log10(max(abs(value), error)))
        scaled = plus_minus(value / 10.0**exponent, error / 10.0**exponent, "").strip()
        return f"({scaled})·10{str(exponent).translate(_RAISED)} {unit}"
    digits = max(-power + (1 if error / 10.0**power < 1.5 else 0), 0)
    return f"{value:.{digits}f} ± {error:.{digits}f} {unit}"


def true_minus(number: str) -> str:
    """Write a number's hyphens as minus signs.

    >>> true_minus("-1.2")
    '−1.2'
    """
    return number.replace("-", "−")


def date_text(time_s: float) -> str:
    """Write a time as people do.

    Parameters
    ----------
    time_s
        Seconds since 1970-01-01 UTC.

    Examples
    --------
    >>> date_text(0.0)
    '1970-01-01 00:00 UTC'
    """
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M} UTC"


def exact_time(time: datetime) -> str:
    """Write a time in UTC with all the digits that it has, as it may be stated again.

    >>> exact_time(datetime(2026, 3, 1, 6, 0, 0, 250000, UTC))
    '2026-03-01T06:00:00.250000Z'
    """
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")


class LacksZone(ValueError):
    """A time that states no zone."""


EARLIEST_TIME: Final = datetime(1900, 1, 1, tzinfo=UTC)
LATEST_TIME: Final = datetime(3000, 1, 1, tzinfo=UTC)

LONGEST_TIME: Final = 40
"""Of a time as text [characters]."""


def expect_usable_time(time: datetime) -> datetime:
    """Keep clear of the calendar's ends, beyond which no zone can be reckoned into another.

    Raises
    ------
    ValueError
        If it is before 1900 or after 2999.

    Examples
    --------
    >>> expect_usable_time(datetime(1, 1, 1, tzinfo=UTC))
    Traceback (most recent call last):
    ValueError: a time from the year 1900 to 2999
    """
    if not EARLIEST_TIME <= time < LATEST_TIME:
        raise ValueError("a time from the year 1900 to 2999")
    return time


_DAY_FIRST: Final = re.compile(
    r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})"
    r"(?P<clock>(?:[ T][\d:.]+)?) ?(?P<zone>(?:Z|[+-][\d:]+)?)",
    re.ASCII,
)


def read_time(text: str, zone: tzinfo | None = None) -> datetime:
    """Read a time in ISO 8601, or with the day first where dots show it, and keep its zone.

    Parameters
    ----------
    zone
        Of a time that states none.

    Raises
    ------
    LacksZone
        If it states none, and there is no other.
    ValueError
        If it is no time, or one that cannot be reckoned with.

    Examples
    --------
    >>> read_time("2026-03-01T06:00:00+01:00").isoformat()
    '2026-03-01T06:00:00+01:00'
    >>> read_time("1.3.2026 06:00 +01:00").isoformat()
    '2026-03-01T06:00:00+01:00'
    """
    if len(text) > LONGEST_TIME:
        raise ValueError("a time such as 2026-03-01T06:00:00Z")
    if dotted := _DAY_FIRST.fullmatch(text):
        text = f"{dotted['year']}-{dotted['month']:0>2}-{dotted['day']:0>2}{dotted['clock']}"
        text += dotted["zone"]
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        if zone is None:
            raise LacksZone("a time with its zone, such as 2026-03-01T06:00:00Z")
        time = time.replace(tzinfo=zone)
    return expect_usable_time(time)


def time_since_1970(seconds: float) -> datetime:
    """Give the time that a count of seconds since 1970-01-01 UTC means; ValueError as `read_time`.

    >>> time_since_1970(0.5).isoformat()
    '1970-01-01T00:00:00.500000+00:00'
    """
    try:
        return expect_usable_time(datetime.fromtimestamp(seconds, UTC))
    except (OverflowError, OSError):
        raise ValueError("a time from the year 1900 to 2999") from None


def duration_text(seconds: float) -> str:
    """Write a span of time in seconds, hours or days, whichever is read most easily.

    Examples
    --------
    >>> duration_text(601.4), duration_text(43200.0), duration_text(345600.0)
    ('601 s', '12 h', '4 days')
    >>> duration_text(24928676.0)
    '289 days'
    """
    days, hours = seconds / SECONDS_PER_DAY, seconds / SECONDS_PER_H
    if days >= 2.0:
        return f"{days:.0f} days" if days >= 10.0 else f"{days:.2g} days"
    return f"{hours:.2g} h" if hours >= 2.0 else f"{seconds:.0f} s"


def utc_time(time_s: float) -> datetime:
    """Give a time with its zone, to the second.

    Parameters
    ----------
    time_s
        Seconds since 1970-01-01 UTC.

    Examples
    --------
    >>> utc_time(59.9)
    datetime.datetime(1970, 1, 1, 0, 0, 59, tzinfo=datetime.timezone.utc)
    """
    return datetime.fromtimestamp(math.floor(time_s), UTC)


def iso_time(time_s: float) -> str:
    """Write a time as HTTP answers do, to the second.

    Parameters
    ----------
    time_s
        Seconds since 1970-01-01 UTC.

    Examples
    --------
    >>> iso_time(0.0)
    '1970-01-01T00:00:00Z'
    """
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%dT%H:%M:%SZ}"

"""Numbers as the dashboard writes them: signs, units, ages, clocks."""

from __future__ import annotations

from datetime import datetime
from typing import Final

from markupsafe import Markup

from app.pages.reader_zone import local
from app.units import SECONDS_PER_DAY, SECONDS_PER_H, SECONDS_PER_MIN

MINUS: Final = "\N{MINUS SIGN}"
DECIMALS: Final = 4
"""Of a length or angle as the API answers it [µm, µrad]."""

NO_BREAK: Final = "\N{NO-BREAK SPACE}"


def signed(value: float, digits: int = 1) -> str:
    r"""Write a number with its sign; what rounds to zero has none.

    It is rounded from the number that the API answers, so that both say the same at a half.

    >>> signed(-21.94), signed(0.04), signed(-0.04), signed(1234.5), signed(-28.849999999)
    ('−21.9', '0.0', '0.0', '+1\xa0234.5', '−28.9')
    """
    value = round(value, DECIMALS)
    text = f"{abs(value):,.{digits}f}".replace(",", NO_BREAK)
    if float(f"{value:.{digits}f}") == 0.0:
        return text
    return ("+" if value > 0 else MINUS) + text


def number(value: float, digits: int = 2) -> str:
    r"""Write a number that needs no plus.

    >>> number(-3.5), number(-0.001), number(11108608.8, 1)
    ('−3.50', '0.00', '11\xa0108\xa0608.8')
    """
    return f"{value:z,.{digits}f}".replace("-", MINUS).replace(",", NO_BREAK)


def short(value: float) -> str:
    """Write a position or a tick as short as it can be.

    >>> short(-487.5), short(-650.0), short(0.0)
    ('−487.5', '−650', '0')
    """
    return f"{value + 0.0:g}".replace("-", MINUS)


def with_unit(text: str, unit: str) -> Markup:
    """Write a unit behind its number, quieter than that."""
    return Markup('{}&nbsp;<span class="unit">{}</span>').format(text, unit)


def age(seconds: float) -> str:
    """Write an age as short as it can be read.

    >>> age(0.42), age(42.4), age(250.0), age(6120.0), age(3 * 86400.0)
    ('0.4 s', '42 s', '4 min 10 s', '1 h 42 min', '3 d')
    """
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < SECONDS_PER_MIN:
        return f"{whole} s"
    if whole < SECONDS_PER_H:
        return f"{whole // 60} min {whole % 60} s" if whole % 60 else f"{whole // 60} min"
    if whole < SECONDS_PER_DAY:
        return f"{whole // 3600} h {whole % 3600 // 60} min"
    return f"{whole // 86400} d"


def clock(time: datetime, now: datetime) -> str:
    """Write a time of day in the reader's zone, with the date where it is not today's.

    >>> from datetime import UTC
    >>> now = datetime(2026, 3, 6, 12, 0, tzinfo=UTC)
    >>> clock(datetime(2026, 3, 6, 5, 12, tzinfo=UTC), now)
    '05:12'
    >>> clock(datetime(2026, 2, 8, 23, 59, tzinfo=UTC), now)
    '2026-02-08 23:59'
    """
    time = local(time)
    return f"{time:%H:%M}" if time.date() == local(now).date() else f"{time:%Y-%m-%d %H:%M}"

"""Numbers as the dashboard writes them: signs, decimal mark, units, ages, clocks.

Values come in SI units and are written in the reader's; the scripts do the same (`ask.js`).
"""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Final

from markupsafe import Markup

from app.languages import decimal_mark, said_in
from app.pages.reader import local, reader
from app.units import SECONDS_PER_DAY, SECONDS_PER_H, SECONDS_PER_MIN

if TYPE_CHECKING:
    from app.status.machine_status import Largest

MM_PER_INCH: Final = 25.4
F_PER_K: Final = 1.8
F_AT_0_C: Final = 32.0
INCH_DECIMALS: Final = 3
"""Of a position as it is read: 25 µm."""
TYPED_DECIMALS: Final = 5
"""Of a position in inches as it is typed: 0.25 µm."""

MINUS: Final = "\N{MINUS SIGN}"
DECIMALS: Final = 4
"""Of a length or angle as the API answers it [µm, µrad]."""

NO_BREAK: Final = "\N{NO-BREAK SPACE}"


def marked(text: str) -> str:
    """Write a number's decimal point as the reader does."""
    return text.replace(".", decimal_mark(reader().language))


def signed(value: float, digits: int = 1) -> str:
    r"""Write a number with its sign; what rounds to zero has none.

    It is rounded from the number that the API answers, so that both say the same at a half.

    >>> signed(-21.94), signed(0.04), signed(-0.04), signed(1234.5), signed(-28.849999999)
    ('−21.9', '0.0', '0.0', '+1\xa0234.5', '−28.9')
    """
    value = round(value, DECIMALS)
    text = marked(f"{abs(value):,.{digits}f}".replace(",", NO_BREAK))
    if float(f"{value:.{digits}f}") == 0.0:
        return text
    return ("+" if value > 0 else MINUS) + text


def number(value: float, digits: int = 2) -> str:
    r"""Write a number that needs no plus.

    >>> number(-3.5), number(-0.001), number(11108608.8, 1)
    ('−3.50', '0.00', '11\xa0108\xa0608.8')
    """
    return marked(f"{value:z,.{digits}f}".replace("-", MINUS).replace(",", NO_BREAK))


def short(value: float) -> str:
    """Write a tick as short as it can be.

    >>> short(-487.5), short(-650.0), short(0.0)
    ('−487.5', '−650', '0')
    """
    return marked(f"{value + 0.0:g}".replace("-", MINUS))


def in_readers_degrees(value_c: float) -> float:
    """Give a temperature [°C] in the reader's unit."""
    return value_c * F_PER_K + F_AT_0_C if reader().temperature == "°F" else value_c


def temperature(value_c: float, digits: int = 2) -> str:
    """Write a temperature [°C] in the reader's unit, which stands beside it.

    >>> temperature(24.1)
    '24.10'
    """
    return number(in_readers_degrees(value_c), digits)


def degrees(value_c: float) -> Markup:
    """Write a temperature [°C] with the reader's unit."""
    return with_unit(temperature(value_c), reader().temperature)


def difference(value_k: float) -> float:
    """Give a difference of temperatures [K] in the reader's unit: °F have no zero there."""
    return value_k * F_PER_K if reader().temperature == "°F" else value_k


def difference_unit() -> str:
    """Name the unit of a difference of temperatures."""
    return "°F" if reader().temperature == "°F" else "K"


def position(value_mm: float) -> str:
    """Write a position [mm] in the reader's unit as short as it can be.

    >>> position(-487.5)
    '−487.5'
    """
    if reader().length == "mm":
        return short(value_mm)
    return short(round(value_mm / MM_PER_INCH, INCH_DECIMALS))


def at_position(axis: str, value_mm: float) -> str:
    """Write an axis and a position on it; where lengths are not in mm, that is said.

    >>> at_position("x", 400.0)
    'X 400'
    """
    unit = "" if reader().length == "mm" else f"{NO_BREAK}{reader().length}"
    return f"{axis.upper()} {position(value_mm)}{unit}"


def place_of(one: Largest) -> str:
    """Write where a value is; empty without a position.

    >>> from app.status.machine_status import Largest
    >>> place_of(Largest("EXX", -21.9, "µm", "x", -400.0, is_backward=True))
    'at X −400 backward'
    """
    if one.axis is None or one.position_mm is None:
        return ""
    return place_words(one.axis, one.position_mm, is_backward=one.is_backward)


def place_words(axis: str, value_mm: float, *, is_backward: bool) -> str:
    """Write where on an axis a value is, and from where it is approached."""
    place = at_position(axis, value_mm)
    if is_backward:
        return said_in(reader().language, "at %(place)s backward", place=place)
    return said_in(reader().language, "at %(place)s", place=place)


def typed_position(value_mm: float) -> Markup:
    """Write what a field for a position holds at first, and exactly what that is [mm].

    What is sent back as it was shown is stored as it was.

    >>> typed_position(-487.5)
    Markup('value="-487.5" data-si="-487.5"')
    """
    shown = value_mm if reader().length == "mm" else round(value_mm / MM_PER_INCH, TYPED_DECIMALS)
    return Markup('value="{}" data-si="{}"').format(marked(f"{shown:.10g}"), repr(value_mm))


def with_unit(text: str, unit: str) -> Markup:
    """Write a unit behind its number, quieter than that."""
    return Markup('{}&nbsp;<span class="unit">{}</span>').format(text, unit)


def age(seconds: float) -> str:
    """Write an age as short as it can be read.

    >>> age(0.42), age(42.4), age(250.0), age(6120.0), age(3 * 86400.0)
    ('0.4 s', '42 s', '4 min 10 s', '1 h 42 min', '3 d')
    """
    if seconds < 10.0:
        return marked(f"{seconds:.1f} s")
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

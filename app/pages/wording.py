"""What pages say, in the reader's language; English sentences are the keys of the catalogues."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Final

from markupsafe import Markup

from app.languages import ENGLISH, said_in, translations
from app.languages.recognised import FIGURE_BEGINS, FIGURE_ENDS, recognised
from app.pages.dashboard.numbers import F_AT_0_C, F_PER_K, MM_PER_INCH, marked
from app.pages.reader import Reader, localised, reader

_FIGURE: Final = rf"{FIGURE_BEGINS}([^{FIGURE_BEGINS}{FIGURE_ENDS}]*){FIGURE_ENDS}"
_WITH_UNIT: Final = re.compile(
    rf"{_FIGURE}(?:(?P<between> ± |[ ,]* \w+ |, ){_FIGURE})?"
    r"(?P<space>[  ])(?P<unit>°C|K|mm)(?![\w/·²])"
)
_ALONE: Final = re.compile(_FIGURE)
_NEXT_SENTENCE: Final = re.compile(r"(?<=[.?!]) (?=[A-Z])")
_INCH_DIGITS: Final = 2
"""More of a length in inches than it has in mm: 0.1 mm is as much as 0.004 in."""


def _(message: str, /, **values: object) -> str:
    """Say a message; its places are such as `%(name)s`, and a per cent sign is `%%`."""
    return said_in(reader().language, message, **values)


def message(text: str) -> str:
    """Mark a text that is said later, by `_`; nothing but that."""
    return text


def counted(count: int, one: str, more: str, /, **values: object) -> str:
    """Say a message of so many things, as `%(count)s`.

    >>> counted(2, "%(count)s map", "%(count)s maps")
    '2 maps'
    """
    pattern = translations(reader().language).ngettext(one, more, count)
    return pattern % {"count": count, **values}


def listed(names: Sequence[str], limit: int = 20) -> str:
    """Write names: the first `limit`, then how many more there are.

    >>> listed(["EXX", "EYX", "EZX"], 2)
    'EXX, EYX and 1 more'
    """
    first = ", ".join(names[:limit])
    more = len(names) - limit
    if more > 0:
        return _("%(names)s and %(more)s more", names=first, more=more)
    return first or _("none")


def said(text: str, near: datetime | None = None) -> Markup | str:
    """Say a text of the service in the reader's language and units.

    A sentence of it that is not recognised stays English, and is marked as such.

    Parameters
    ----------
    near
        When it was said, for the times in it, as in `localised`; None where it has none.
    """
    whole = said_as_a_whole(text, near)
    if whole is not None or not text:
        return whole or text
    parts = [(one, said_as_a_whole(one, near)) for one in _NEXT_SENTENCE.split(text)]
    return Markup(" ").join(
        _in_english(english if near is None else localised(english, near)) if one is None else one
        for english, one in parts
    )


def said_plainly(text: str, near: datetime | None = None) -> str:
    """Say a text where nothing can be marked, as in a title; else as `said`."""
    return said_as_a_whole(text, near) or text


def all_said(texts: Iterable[str], near: datetime) -> Markup:
    """Say sentences one after the other."""
    return Markup(" ").join(said(text, near) for text in texts)


def said_as_a_whole(text: str, near: datetime | None = None) -> str | None:
    """Say a text as a whole; None where it is not recognised."""
    who = reader()
    if who.language == ENGLISH and (who.temperature, who.length) == ("°C", "mm"):
        spoken: str | None = text
    else:
        spoken = recognised(who.language, text)
        if spoken is None and who.language == ENGLISH:
            spoken = text
    if spoken is None:
        return None
    spoken = _WITH_UNIT.sub(lambda found: _converted(found, who), spoken)
    spoken = _ALONE.sub(lambda found: marked(found[1]), spoken)
    return spoken if near is None else localised(spoken, near)


def _converted(found: re.Match[str], who: Reader) -> str:
    """Write a figure, or two with one unit, in the reader's unit."""
    one, other, unit = found[1], found[3], found["unit"]
    if "," in one + (other or ""):  # of thousands, or written for the reader already
        return found[0]
    between = found["between"] or ""
    is_error = between == " ± "
    figures = [_in_unit(one, unit, who)]
    if other is not None:
        figures.append(_in_unit(other, "K" if is_error and unit == "°C" else unit, who))
    shown = {"°C": who.temperature, "mm": who.length}.get(unit, "K")
    if unit == "K" and who.temperature == "°F":
        shown = "°F"
    return f"{between.join(figures)}{found['space']}{shown}"


def _in_unit(figure: str, unit: str, who: Reader) -> str:
    """Convert a figure; its digits say no more, and no less, than they did."""
    decimals = len(figure.partition(".")[2])
    value = float(figure.lstrip("+±").replace("−", "-").replace(",", "").replace("\xa0", ""))
    if unit == "mm" and who.length != "mm":
        value, decimals = value / MM_PER_INCH, decimals + _INCH_DIGITS
    elif unit != "mm" and who.temperature == "°F":
        value = value * F_PER_K + (F_AT_0_C if unit == "°C" else 0.0)
    else:
        return marked(figure)
    sign = figure[0] if figure[0] in "+±" and value >= 0.0 else ""
    return marked(f"{sign}{value:.{decimals}f}".replace("-", "−"))


def _in_english(text: str) -> Markup | str:
    """Mark what is English for everybody, so that it is read out as such."""
    if reader().language == ENGLISH:
        return text
    return Markup('<span lang="en">{}</span>').format(text)

"""Sentences that are said in English, and can be said in other languages too.

Whoever writes one needs no language: the API sends it as the English text that it is, and a page
says it as its reader wants it (`app/pages/wording.py`).
"""

from __future__ import annotations

from collections.abc import Sequence


class Message(str):
    """An English sentence that knows what it was made of.

    Parameters
    ----------
    pattern
        With places such as `%(sensor)s`; the catalogues of languages are keyed by it.
    more
        The pattern where `count` is not one.
    values
        What stands in the places; those that are messages or quantities are said anew as well.

    Examples
    --------
    >>> Message("%(sensor)s is late.", sensor="spindle")
    'spindle is late.'
    """

    __slots__ = ("more", "pattern", "values")

    pattern: str
    more: str | None
    values: dict[str, object]

    def __new__(cls, pattern: str, more: str | None = None, /, **values: object) -> Message:
        """Say it in English."""
        is_one = more is None or values["count"] == 1
        said = super().__new__(cls, (pattern if is_one else more or pattern) % values)
        said.pattern, said.more, said.values = pattern, more, values
        return said

    def __reduce__(self) -> tuple[object, ...]:
        """Say how it is made again, for copies."""
        return _again, (self.pattern, self.more, self.values)


def _again(pattern: str, more: str | None, values: dict[str, object]) -> Message:
    return Message(pattern, more, **values)


def several(one: str, more: str, /, *, count: int, **values: object) -> Message:
    """Say a sentence of so many things.

    >>> several("%(count)s map", "%(count)s maps", count=2)
    '2 maps'
    """
    return Message(one, more, count=count, **values)


class Quantity(str):
    """A figure with its unit, which a page may write in another one.

    >>> Quantity(2.344, 2, "K")
    '2.34 K'
    """

    __slots__ = ("digits", "unit", "value")

    value: float
    digits: int
    unit: str

    def __new__(cls, value: float, digits: int, unit: str) -> Quantity:
        """Write it in the unit that it comes in."""
        written = super().__new__(cls, f"{value:.{digits}f} {unit}")
        written.value, written.digits, written.unit = value, digits, unit
        return written

    def __reduce__(self) -> tuple[object, ...]:
        """Say how it is made again, for copies."""
        return Quantity, (self.value, self.digits, self.unit)


def joined(parts: Sequence[str], separator: str = " ") -> str:
    """Join sentences to one that can be said in other languages.

    >>> joined(["It is late.", "Nothing rests on it."])
    'It is late. Nothing rests on it.'
    """
    if len(parts) == 1:
        return parts[0]
    places = separator.join(f"%(part{i})s" for i in range(len(parts)))
    return Message(places, **{f"part{i}": part for i, part in enumerate(parts)})

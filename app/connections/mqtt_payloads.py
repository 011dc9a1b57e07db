"""What a payload says: a number, or numbers and a time inside a JSON document."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Final, TypeGuard

import orjson

from app.decimal_text import read_number
from app.errors import ThermapError
from app.foreign_text import shown
from app.units import MS_PER_S, read_time, time_since_1970

_STEP: Final = re.compile(r'(?:^|(?<!^)\.)([^.\[\]"]+)|\[(\d{1,6})\]|\["([^"]+)"\]')

LONGEST_EXCERPT: Final = 60
"""Of a payload that cannot be read [characters]."""


class Unusable(ThermapError):
    """A payload does not say what was expected; the sentence says what it does."""


class TimeForm(StrEnum):
    """How a sender writes its time."""

    ISO_8601 = "iso8601"
    EPOCH_S = "epoch_s"
    EPOCH_MS = "epoch_ms"


@dataclass(frozen=True, slots=True)
class JsonPath:
    """A place in a JSON document, as `d.temps[0]` or `["a.b"].c`."""

    text: str
    steps: tuple[str | int, ...]

    @classmethod
    def parse(cls, text: str) -> JsonPath:
        """Read a path; ValueError says what was expected.

        >>> JsonPath.parse('d.temps[0]["a.b"]').steps
        ('d', 'temps', 0, 'a.b')
        """
        steps: list[str | int] = []
        at = 0
        while at < len(text):
            step = _STEP.match(text, at)
            if step is None:
                raise ValueError(f"expected a path as d.temps[0], got {text!r:.80}")
            name, index, quoted = step.groups()
            steps.append(int(index) if index is not None else name or quoted)
            at = step.end()
        if not steps:
            raise ValueError("expected a path as d.temps[0], got an empty one")
        return cls(text, tuple(steps))

    def is_null(self, document: Any) -> bool:
        """Whether null is there, and not only nothing.

        >>> JsonPath.parse("a.b").is_null({"a": {"b": None}}), JsonPath.parse("a").is_null({})
        (True, False)
        """
        *above, last = self.steps
        place = self._walk(document, above)
        return self.find(document) is None and (
            last in place
            if isinstance(place, dict)
            else isinstance(place, list) and isinstance(last, int) and last < len(place)
        )

    def find(self, document: Any) -> Any:
        """Give what is there; None where nothing is."""
        return self._walk(document, self.steps)

    @staticmethod
    def _walk(document: Any, steps: Sequence[str | int]) -> Any:
        for step in steps:
            if isinstance(step, int):
                is_there = isinstance(document, list) and step < len(document)
            else:
                is_there = isinstance(document, dict) and step in document
            if not is_there:
                return None
            document = document[step]
        return document


def read_text(payload: bytes) -> float:
    """Read a payload that is a number and nothing else.

    >>> read_text(b" 21.5 ")
    21.5
    """
    text = payload[: LONGEST_EXCERPT * 4].decode("utf-8", "replace").strip()
    number = read_number(text, decimal_comma=False)
    if len(payload) > LONGEST_EXCERPT * 4 or number is None:
        raise Unusable(f"expected a number, got {text[:LONGEST_EXCERPT]!r}")
    return number


def read_json(payload: bytes) -> Any:
    """Read a JSON document."""
    try:
        return orjson.loads(payload)
    except orjson.JSONDecodeError as why:
        excerpt = payload[:LONGEST_EXCERPT].decode("utf-8", "replace")
        raise Unusable(f"expected JSON, got {excerpt!r}: {why}") from None


def number_at(document: Any, path: JsonPath) -> float | None:
    """Read a number, or a text that is one; None where nothing or null is."""
    value = path.find(document)
    if isinstance(value, str):
        return read_text(value.encode("utf-8"))
    if value is None:
        return None
    if not is_number(value):
        raise Unusable(f"expected a number at {path.text}, got {_excerpt(value)}")
    return float(value)


def time_at(document: Any, path: JsonPath, form: TimeForm) -> datetime:
    """Read the sender's time, with its zone."""
    value = path.find(document)
    try:
        if form is TimeForm.ISO_8601 and isinstance(value, str):
            return read_time(value)
        if form is not TimeForm.ISO_8601 and is_number(value):
            return time_since_1970(value / (MS_PER_S if form is TimeForm.EPOCH_MS else 1.0))
    except ValueError:
        pass
    raise Unusable(
        f"expected a time as {_TIME_FORMS[form]} at {path.text}, from the year 1900 to 2999, got "
        f"{_excerpt(value)}"
    )


_TIME_FORMS: Final = {
    TimeForm.ISO_8601: "ISO 8601 with its zone",
    TimeForm.EPOCH_S: "seconds since 1970-01-01 UTC",
    TimeForm.EPOCH_MS: "milliseconds since 1970-01-01 UTC",
}


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether a value of JSON is a number: true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _excerpt(value: Any) -> str:
    if isinstance(value, dict | list):
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value)}"
    return shown(orjson.dumps(value).decode(), LONGEST_EXCERPT)

"""Reading JSON strictly, and long texts in pieces, between which others have their turn.

One call that reads ten megabytes holds Python's lock for a second, and the live table waits
as long, whichever thread it runs in. So a long text is looked over first: where its brackets
and commas stand, strings left out. Then it is cut between the entries of its lists and
objects, and no call reads more than some kilobytes. Each piece is read strictly and nothing
but brackets and commas stands between them, so cutting neither takes nor refuses anything
that a reading as a whole would not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

import jiter
import numpy as np
from numpy.typing import NDArray

from app.arrays import IntArray

SHORT_TEXT: Final = 16_384
"""A text or piece of it that is read at once [bytes]: up to a millisecond."""

MOST_VALUES: Final = 5_000_000
"""Values in one text; a million points have four million."""

MOST_NAMES: Final = 5_000
"""Names in one object of a long text."""

LONGEST_VALUE: Final = 1 << 21
"""One text or number [bytes]."""

MOST_LEVELS: Final = 32
"""Lists and objects in one another in a long text."""

_BLOCK: Final = 1 << 18
_BACKSLASH: Final = ord("\\")
_QUOTE: Final = ord('"')
_STEP: Final[NDArray[np.int8]] = np.zeros(256, dtype=np.int8)
_STEP[[ord("["), ord("{")]] = 1
_STEP[[ord("]"), ord("}")]] = -1
_IS_MARK: Final = _STEP != 0
_IS_MARK[ord(",")] = True
_REPEATED: Final = re.compile(r'Detected duplicate key "(.*)" at line', re.DOTALL)
_SPACE: Final = b" \t\r\n"
_PLACE: Final = re.compile(r" at line \d+ column \d+$")


_MINUS_ZERO: Final = re.compile(rb"-0(?:\.0*)?(?:[eE][+-]?\d{1,9})?(?=[\s,\]}]|$)")
_TEXT_OR_MINUS_ZERO: Final = re.compile(rb'"(?:[^"\\]|\\.)*+"?|' + _MINUS_ZERO.pattern, re.DOTALL)


class NoJsonError(ValueError):
    """The text is no JSON, or more than anyone needs."""


class RepeatedNameError(ValueError):
    """An object has a name twice; readers differ in which of them counts."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


def read_json(text: bytes) -> Any:
    """Read JSON in UTF-8; NaN and infinities are read, for those who refuse them by name.

    Raises
    ------
    NoJsonError
        If the text is none.
    RepeatedNameError
        If an object has a name twice.
    """
    if len(text) <= SHORT_TEXT:
        return _read_at_once(text)
    marks = _marks(text)
    if not len(marks.at):
        return _read_piece(text)  # no list and no object: one value
    if text[: marks.at[0]].strip(_SPACE) or text[marks.at[-1] + 1 :].strip(_SPACE):
        raise NoJsonError("expected one value, got more")
    return _read_container(text, marks, 0, len(marks.at) - 1)


def without_minus_zeros(text: bytes) -> bytes:
    """Write 0 for each number of JSON that is −0: what is stored and answered has none.

    >>> without_minus_zeros(b'{"-0.0,": [-0.0, -0, -0e3, -0.5]}')
    b'{"-0.0,": [0.0, 0, 0e3, -0.5]}'
    """
    if not _MINUS_ZERO.search(text):
        return text
    return _TEXT_OR_MINUS_ZERO.sub(lambda match: match[0].removeprefix(b"-"), text)


def _read_at_once(text: bytes) -> Any:
    try:
        return jiter.from_json(without_minus_zeros(text), catch_duplicate_keys=True)
    except ValueError as error:
        message = str(error)
        repeated = _REPEATED.match(message)
        if repeated:
            raise RepeatedNameError(repeated[1]) from None
        raise NoJsonError(message) from None


def _read_piece(piece: bytes) -> Any:
    if len(piece) > LONGEST_VALUE:
        raise NoJsonError(f"expected a number or a text of at most {LONGEST_VALUE} bytes")
    try:
        return _read_at_once(piece)
    except NoJsonError as error:
        raise NoJsonError(_PLACE.sub("", str(error))) from None  # the piece's, not the text's


@dataclass(frozen=True, slots=True)
class _Marks:
    """The brackets and commas outside strings: where they stand, and how deep one is after each."""

    at: IntArray
    step: NDArray[np.int8]
    depth: IntArray


def _marks(text: bytes) -> _Marks:
    """Find the brackets and commas of a text, in blocks: numpy lets others in between.

    Raises
    ------
    NoJsonError
        If brackets do not match, or there are more values or levels than anyone needs.
    """
    data = np.frombuffer(text, dtype=np.uint8)
    marks: list[IntArray] = []
    count = 0
    in_string = escaped = False
    for start in range(0, len(data), _BLOCK):
        block = data[start : start + _BLOCK]
        quotes = block == _QUOTE
        at, escaped = _escaped(block, escaped)
        quotes[at] = False
        inside = (np.cumsum(quotes, dtype=np.uint8) & 1).astype(bool) ^ in_string
        here = np.flatnonzero(_IS_MARK[block] & ~inside)
        marks.append(here + start)
        in_string = bool(inside[-1])
        count += int(np.count_nonzero(_STEP[block[here]] >= 0))
        if count > MOST_VALUES:
            raise NoJsonError(f"expected at most {MOST_VALUES} values, got more")
    where = np.concatenate(marks)
    step = _STEP[data[where]]
    depth = np.cumsum(step, dtype=np.int64)
    if len(depth):
        if depth.max() > MOST_LEVELS:
            raise NoJsonError(f"expected at most {MOST_LEVELS} levels, got {depth.max()}")
        if depth[-1] != 0 or depth[:-1].min(initial=1) < 1:
            raise NoJsonError("expected brackets in pairs, got one without the other")
    return _Marks(where, step, depth)


def _escaped(block: NDArray[np.uint8], first: bool) -> tuple[IntArray, bool]:
    """Find the characters after an odd number of backslashes.

    `first` says whether the block's first character is one, the second value returned
    whether the next block's is.
    """
    at = np.flatnonzero(block == _BACKSLASH)
    lone = np.zeros(int(first and block[0] != _BACKSLASH), dtype=np.int64)
    if not len(at):
        return lone, False
    breaks = np.flatnonzero(np.diff(at) != 1)
    starts = at[np.concatenate(([0], breaks + 1))]
    stops = at[np.concatenate((breaks, [len(at) - 1]))] + 1
    length = stops - starts - (first & (starts == 0))
    odd = stops[length % 2 == 1]
    return np.concatenate((lone, odd[odd < len(block)])), bool(len(odd) and odd[-1] == len(block))


def _read_container(text: bytes, marks: _Marks, first: int, last: int) -> Any:
    """Read the list or object between two marks, entry by entry or many small ones at once."""
    start, stop = int(marks.at[first]), int(marks.at[last])
    if stop - start < SHORT_TEXT:
        return _read_piece(text[start : stop + 1])
    opening, closing = text[start : start + 1], text[stop : stop + 1]
    is_list = opening == b"["
    if closing != (b"]" if is_list else b"}"):
        raise NoJsonError("expected brackets in pairs, got one without the other")
    depth = marks.depth[first]
    inner = slice(first + 1, last)
    at, step, depths = marks.at[inner], marks.step[inner], marks.depth[inner]
    commas = at[(step == 0) & (depths == depth)]
    opened = np.flatnonzero((step == 1) & (depths == depth + 1)) + first + 1
    closed = np.flatnonzero((step == -1) & (depths == depth)) + first + 1
    opened_at = marks.at[opened]
    edges = np.concatenate(([start], commas, [stop]))
    if not is_list and len(commas) >= MOST_NAMES:
        raise NoJsonError(f"expected at most {MOST_NAMES} names in an object, got more")
    items: list[Any] = []
    fields: dict[str, Any] = {}
    i = 0
    while i < len(edges) - 1:
        # As many entries as fit into a piece, but at least one.
        j = max(i + 1, int(np.searchsorted(edges, edges[i] + SHORT_TEXT, side="right")) - 1)
        low, high = int(edges[i]) + 1, int(edges[j])
        inside = int(np.searchsorted(opened_at, low))
        is_long = j == i + 1 and high - low >= SHORT_TEXT
        if not is_long or inside == len(opened) or opened_at[inside] > high:
            piece = _read_piece(opening + text[low:high] + closing)
            if len(piece) != j - i and (piece or len(commas)):
                raise NoJsonError("expected a value between two commas, got none")
        else:
            begin, end = int(opened_at[inside]), int(marks.at[closed[inside]])
            # What stands before the long entry: nothing in a list, in an object its name.
            head = _read_piece(opening + text[low:begin] + b"null" + closing)
            if text[end + 1 : high].strip(_SPACE):
                raise NoJsonError("expected a comma behind a value")
            value = _read_container(text, marks, int(opened[inside]), int(closed[inside]))
            piece = [value] if is_list else dict.fromkeys(head, value)
        if is_list:
            items += piece
        else:
            _add_fields(fields, piece)
        i = j
    return items if is_list else fields


def _add_fields(fields: dict[str, Any], more: dict[str, Any]) -> None:
    for name, value in more.items():
        if name in fields:
            raise RepeatedNameError(name)
        fields[name] = value

"""English sentences of the service, recognised by the patterns of a catalogue and said anew.

What is stored or answered is English text. Each message of a catalogue that has places,
`%(sensor)s is late`, is also a pattern that such a text is read with; what stands in its places is
a figure, a code, a name, or text that is recognised in turn. So a text is said anew as a whole, or
not at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache, lru_cache, partial
from typing import Final, NamedTuple

from app.languages import ENGLISH, LANGUAGES, catalogue, translations

FIGURE_BEGINS: Final = "\ue000"
FIGURE_ENDS: Final = "\ue001"
"""Around each number of what was said anew: the reader's decimal mark and unit are still to come.

Of Unicode's private use; a text that has them is not recognised.
"""

PAGES: Final = "app/pages/dashboard/"
"""What is said there is said by its name; its words may be names of sensors."""

LONGEST: Final = 1200
MOST_PARTS: Final = 1000
MOST_STEPS: Final = 20_000
MOST_DEEP: Final = 12
"""Letters of a text that is read, parts of it that are looked at, places where these may end, parts
inside of each other: what has more is left as it is."""

_PLACE: Final = re.compile(r"%\((\w+)\)s|(%%)")
_NUMBER: Final = re.compile(r"(?<![\w.])[+±−-]?\d+(?:[,  ]\d{3})*(?:\.\d+)?(?![\w.]*\w)")
_TOKEN: Final = re.compile(
    r"[(\[]*(?:"
    r"[+±−<>=≤≥~√×-]*\d[\d.,:/·×⁻⁰¹²³⁴⁵⁶⁷⁸⁹]*(?:e[+-]?\d+)?%?"  # numbers, clocks, 1/min
    r"|\d{4}-\d\d-\d\d(?:T[\d:.]+Z)?"
    r"|[+±−–—→=×…·/|-]+"
    r"|(?:°C|°|K|%|mm|m|µm|µrad|mrad|deg|s|ms|h|min|d|day|kg|W|MB|GB|V)²?"
    r"(?:/(?:°C|K²?|mm|m|min|h|s|d|day|kg|[a-z]+_[a-z_]+))*"
    r"|UTC|RMS"
    r"|[A-Z][A-Z0-9]{0,2}|[vV]\d+|[A-Z]{2,}\d*"  # axes, codes of components, versions
    r"|[^\W_]+(?:[._]+[^\W_]+|\[\d*\])+"  # fields
    r")[)\]]*[,;:…]?"
)
"""What needs no language: figures with their units, times, codes, names of fields."""

_NO_NAME: Final = re.compile(
    r"(?<![\w-])(?:an?|and|are|as|at|be|before|but|by|changes?|exceeds?|falling|follows?|for|from|had"
    r"|has|have|in|instead|is|its?|late|minus|moves?|no|none|nor|not|of|on|or|over|rather|rising|settles?"
    r"|since|so|than|that|the|their|then|they|this|to|until|was|were|where|which|while|with|within"
    r"|without|would)(?![\w-])|[±→≤≥°]"
)
"""Words of sentences: what has such a word is not taken for a name."""

_CODE: Final = re.compile(r"\b(?:[A-Z][A-Z0-9]{0,2}|[A-Z]{4,}\d*)\b")
_GOES_ON: Final = re.compile("[.:;] ")
_FILE: Final = re.compile(r".+\.[A-Za-z]{2,5}")
_CODES: Final = re.compile("codes?|components?")
"""Places that hold codes of components, where they are expected."""

_SEVERAL: Final = re.compile(r" and \d+ more$|^points [xyz], ")
_QUOTED: Final = re.compile(r"`[^`]*`|'[^']*'|“[^“”]*”|\"[^\"]*\"")
_NAME: Final = re.compile(r"(?!.*(?:[.;:!?] |  ))[^\s,;:](?:.{0,80}[^\s,;:])?", re.DOTALL)

NAMES: Final = re.compile(
    "around|assigned|backward_field|cold|drivers|drifting|field|files?|first|have|having|headings?"
    "|held_at|instead|key|labels?|lacking|lost|lower|lower_map|machine(?:s|_id)?|minus|missing"
    "|mixed|names?|nearest|on|other|other_sensor|parent|pattern|present|present_sensor"
    "|receiver|rival|second|sensors?|setup|spare|stand_in|states?|steady|still_used|subjects"
    "|tied|twice|unassigned|unknown|unmeasured|upper|upper_map|variant|warm|who"
)
"""Places that hold what users name: anything may stand in them that has no end of a sentence."""


class Said(NamedTuple):
    """How a text can be said anew; the least is the best.

    Parameters
    ----------
    unread
        Letters and digits of names and codes, which no message has.
    outside
        Of these what is a code where no name is expected.
    pieces
        Messages that it is made of.
    """

    unread: int
    outside: int
    pieces: int
    text: str


class _Entry(NamedTuple):
    """A message: the literals around its places, which are one fewer."""

    literals: tuple[str, ...]
    places: tuple[str, ...]
    longest: str
    forms: tuple[str, str]
    is_more: bool
    ends_alike: bool
    """Whether what stands at its end stands at the end in the language too."""

    def may_be(self, text: str) -> bool:
        """Whether a text has all the literals, in their order."""
        first, *between, last = self.literals
        at, end = len(first), len(text) - len(last)
        if at > end or not text.startswith(first) or not text.endswith(last):
            return False
        for literal in between:
            at = text.find(literal, at, end)
            if at < 0:
                return False
            at += len(literal)
        return True

    def may_be_empty(self, place: int) -> bool:
        """Whether nothing may stand in a place: only where it clings to what is beside it."""
        before, after = self.literals[place], self.literals[place + 1]
        if place == 0 and not before:
            return not after[:1].isspace()
        return not before[-1:].isspace()


@cache
def _entries(language: str) -> tuple[dict[str, _Entry], tuple[list[_Entry], ...]]:
    """Give the messages without places, by their text, and those with places: alike together."""
    whole = {}
    open_: dict[tuple[str, ...], list[_Entry]] = {}
    # All catalogues have the same messages.
    for message in catalogue(LANGUAGES[-1] if language == ENGLISH else language):
        if not message.id or not any(is_said_by_the_service(file) for file, _ in message.locations):
            continue
        ids = (message.id,) if isinstance(message.id, str) else message.id
        texts = (message.string,) if isinstance(message.string, str) else message.string or ()
        if not all(texts):
            continue
        for at, pattern in enumerate(ids):
            literals, places = parts_of(pattern)
            longest = max(literals, key=len)
            end = f"%({places[-1]})s" if places else ""
            ends_alike = language == ENGLISH or all(text.endswith(end) for text in texts)
            entry = _Entry(literals, places, longest, (ids[0], ids[-1]), at > 0, ends_alike)
            if not places:
                whole[literals[0]] = entry
            else:
                open_.setdefault(literals, []).append(entry)
    by_words = sorted(open_.values(), key=lambda entries: -sum(map(len, entries[0].literals)))
    return whole, tuple(by_words)


def is_said_by_the_service(file: str) -> bool:
    """Whether sentences of a file reach pages as text, and are recognised there."""
    return file.endswith(".py") and not file.startswith(PAGES)


def parts_of(pattern: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split a pattern at its places.

    >>> parts_of("%(size)s of %(most)s %%")
    (('', ' of ', ' %'), ('size', 'most'))
    """
    literals, places, literal, at = [], [], "", 0
    for match in _PLACE.finditer(pattern):
        literal += pattern[at : match.start()]
        at = match.end()
        if match[1] is None:
            literal += "%"
        else:
            literals.append(literal)
            places.append(match[1])
            literal = ""
    return (*literals, literal + pattern[at:]), tuple(places)


@lru_cache(maxsize=4096)
def recognised(language: str, text: str) -> str | None:
    """Say a text of the service in a language; None where it is not recognised as a whole.

    In English it is as it was, but for the marks.

    Returns
    -------
    str or None
        With its numbers between `FIGURE_BEGINS` and `FIGURE_ENDS`.
    """
    if len(text) > LONGEST or FIGURE_BEGINS in text or FIGURE_ENDS in text:
        return None
    best = _Reading(language).sentences(text)
    return None if best is None else best.text


class _Reading:
    """One text that is read: what was found of its parts is looked up again."""

    def __init__(self, language: str) -> None:
        self._language = language
        self._whole, self._open = _entries(language)
        self._read: dict[str, Said | None] = {}
        self._deep = 0
        self._steps = 0

    def sentences(self, text: str) -> Said | None:
        """Read a text, or a part of it."""
        if text not in self._read:
            self._read[text] = None  # a part that contains itself is no part
            self._deep += 1
            if self._deep < MOST_DEEP and len(self._read) < MOST_PARTS:
                self._read[text] = min(self._readings(text), default=None)
            self._deep -= 1
        return self._read[text]

    def _readings(self, text: str) -> Iterator[Said]:
        """Give all ways to read a text by what says most of it in its own words."""
        if not text or is_without_language(text):
            codes = sum(map(len, _CODE.findall(text)))
            yield Said(codes, codes, 0, marked_figures(text))
        elif text in self._whole:
            yield Said(0, 0, 1, self._in_language(self._whole[text], {}))
        else:
            ways = (*self._patterns_of(text), self._by_lists, self._otherwise_written)
            for way in (self._behind_codes, *ways):
                if (read := min(way(text), default=None)) is not None:
                    yield read
                    return

    def _patterns_of(self, text: str) -> Iterator[Callable[[str], Iterator[Said]]]:
        for entries in self._open:
            if entries[0].longest in text and entries[0].may_be(text):
                yield partial(self._by_patterns, entries)

    def _by_patterns(self, entries: Iterable[_Entry], text: str) -> Iterator[Said]:
        """Read a text by patterns of the same words: what stands between them tells them apart."""
        for entry in entries:
            begin, end = len(entry.literals[0]), len(text) - len(entry.literals[-1])
            for unread, outside, pieces, values in self._values(entry, text, begin, end, 0):
                yield Said(unread, outside, pieces + 1, self._in_language(entry, values))

    def _values(
        self, entry: _Entry, text: str, begin: int, end: int, place: int
    ) -> Iterator[tuple[int, int, int, dict[str, str]]]:
        """Find what may stand in the places of a pattern from one of them on."""
        name = entry.places[place]
        literal = entry.literals[place + 1]
        is_last = place == len(entry.places) - 1
        for at in [end] if is_last else _occurrences(text, literal, begin, end):
            self._steps += 1
            if self._steps > MOST_STEPS or (at == begin and not entry.may_be_empty(place)):
                continue
            if text[at - 1 : at].isalnum() and text[at : at + 1].isalnum():
                continue  # in the middle of a word
            part, is_end = text[begin:at], is_last and not literal
            if is_end and not entry.ends_alike and _GOES_ON.search(part):
                continue  # that would stand in the middle
            if "; " in part and not is_end and not entry.literals[place].endswith(": "):
                continue  # one thing more does not stand in the middle, but behind a colon
            read = self._value(name, part)
            if read is None:
                continue
            if is_last:
                yield *read[:3], {name: read.text}
                continue
            after = at + len(literal)
            rest = self._values(entry, text, after, end, place + 1)
            for unread, outside, pieces, values in rest:
                if values.setdefault(name, read.text) == read.text:
                    unread, outside = unread + read.unread, outside + read.outside
                    yield unread, outside, pieces + read.pieces, values

    def _value(self, place: str, text: str) -> Said | None:
        if _CODES.fullmatch(place.rstrip("0123456789")) and is_without_language(text):
            return Said(sum(map(len, _CODE.findall(text))), 0, 0, marked_figures(text))
        if not NAMES.fullmatch(place.rstrip("0123456789")) or not is_name(text):
            return self.sentences(text)
        if _SEVERAL.search(text) or (" " in text and text in self._whole):
            return self.sentences(text)
        return Said(sum(map(str.isalnum, text)), 0, 0, text)

    def _behind_codes(self, text: str) -> Iterator[Said]:
        """Read what is said of components, fields or a file, before patterns are tried."""
        codes, colon, words = text.partition(": ")
        is_code = is_without_language(codes) or (_FILE.fullmatch(codes) and is_name(codes))
        if colon and is_code and (read := self.sentences(words)) is not None:
            count = sum(map(len, _CODE.findall(codes)))
            yield Said(
                count + read.unread,
                count + read.outside,
                read.pieces + 1,
                f"{marked_figures(codes)}{colon}{read.text}",
            )

    def _by_lists(self, text: str) -> Iterator[Said]:
        """Read what is strung together."""
        for separator in ("; ", ", ", ". ", ": ", " "):
            for at in _occurrences(text, separator, 1, len(text) - 1):
                left, right = text[:at], text[at + len(separator) :]
                if separator == ". " and not right[:1].isupper():
                    continue
                if separator == " " and left[-1] not in ".?:":
                    continue
                one = self.sentences(left)
                other = None if one is None else self.sentences(right)
                if one is not None and other is not None:
                    yield Said(
                        one.unread + other.unread,
                        one.outside + other.outside,
                        one.pieces + other.pieces + 1,
                        f"{one.text}{separator}{other.text}",
                    )

    def _otherwise_written(self, text: str) -> Iterator[Said]:
        """Read a text without the full stop, or the capital, that it was given later."""
        if text[-1] == "." and (read := self.sentences(text[:-1])) is not None:
            yield read._replace(text=f"{read.text}.")
        if " " in text and text[0].isupper() and not text[1].isupper():
            read = self.sentences(f"{text[0].lower()}{text[1:]}")
            if read is not None:
                yield read._replace(text=f"{read.text[:1].upper()}{read.text[1:]}")

    def _in_language(self, entry: _Entry, values: dict[str, str]) -> str:
        one, more = entry.forms
        said = translations(self._language)
        if one == more:
            return said.gettext(one) % values
        digits = re.sub(r"\D", "", values.get("count", ""))
        count = int(digits) if digits else 1 + entry.is_more
        return said.ngettext(one, more, count) % values


def is_name(text: str) -> bool:
    """Whether a text may be a name that users gave, or several.

    >>> is_name("Bed front, Column"), is_name("Column is"), is_name("table")
    (True, False, True)
    """
    return _NAME.fullmatch(text) is not None and not _NO_NAME.search(text)


def is_without_language(text: str) -> bool:
    """Whether a text is the same in all languages: figures, codes, what is quoted.

    >>> is_without_language("26.3 ± 0.2 °C, EXX"), is_without_language("late")
    (True, False)
    """
    unquoted = _QUOTED.sub("0", text)
    return all(_TOKEN.fullmatch(token) for token in unquoted.split())


def marked_figures(text: str) -> str:
    """Mark the numbers of a text, but of what is quoted."""
    parts, at = [], 0
    for quoted in _QUOTED.finditer(text):
        parts += [_with_marks(text[at : quoted.start()]), quoted[0]]
        at = quoted.end()
    return "".join([*parts, _with_marks(text[at:])])


def _with_marks(text: str) -> str:
    return _NUMBER.sub(lambda found: f"{FIGURE_BEGINS}{found[0]}{FIGURE_ENDS}", text)


def _occurrences(text: str, part: str, begin: int, end: int) -> Iterable[int]:
    """Find where a part begins; an empty one may be anywhere."""
    at = text.find(part, begin, end)
    while at >= 0:
        yield at
        at = text.find(part, at + 1, end) if at < end else -1

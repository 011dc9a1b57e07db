"""How many steps a backtracking matcher needs, such as Python's: counted, and not timed.

It walks the tree that Python's own parser makes of a pattern, without the shortcuts of the real
matcher, which change no order of growth.
"""

import re
import string
import sys
from contextlib import contextmanager
from itertools import product
from re import _constants as op
from re import _parser

LONG = 40
"""A repetition that may go on for longer is one that can be pumped."""

_SAMPLES = {
    op.CATEGORY_DIGIT: "5",
    op.CATEGORY_NOT_DIGIT: "q",
    op.CATEGORY_SPACE: " ",
    op.CATEGORY_NOT_SPACE: "q",
    op.CATEGORY_WORD: "q",
    op.CATEGORY_NOT_WORD: "-",
}
_CATEGORIES = {
    op.CATEGORY_DIGIT: str.isdigit,
    op.CATEGORY_SPACE: str.isspace,
    op.CATEGORY_WORD: lambda c: c.isalnum() or c == "_",
    op.CATEGORY_NOT_DIGIT: lambda c: not c.isdigit(),
    op.CATEGORY_NOT_SPACE: lambda c: not c.isspace(),
    op.CATEGORY_NOT_WORD: lambda c: not (c.isalnum() or c == "_"),
}
_REPEATS = (op.MAX_REPEAT, op.MIN_REPEAT, op.POSSESSIVE_REPEAT)


class TooManySteps(Exception):
    """They grow faster than the square of the text's length."""


class Backtracker:
    """A pattern that counts its steps.

    `text` is what is matched at present, `steps` how often a character was looked at.
    """

    def __init__(self, pattern):
        self.tree = _parser.parse(pattern.pattern, pattern.flags & ~re.UNICODE.value)
        self.ignores_case = bool(pattern.flags & re.IGNORECASE)
        self.dot_takes_all = bool(pattern.flags & re.DOTALL)
        self.text, self.steps, self.most = "", 0, 0
        self._match = self._sequence(list(self.tree))

    def count(self, text, method):
        """Count the steps that a method of a pattern needs for a text, or raise TooManySteps."""
        self.text, self.steps, self.most = text, 0, 4 * (len(text) + 10) ** 2
        if method in ("match", "fullmatch"):
            whole = method == "fullmatch"
            self._match(0, lambda end: not whole or end == len(text))
            return self.steps
        at, ends = 0, []
        while at <= len(text):
            self.steps += 1
            ends.clear()
            if self._match(at, lambda end: ends.append(end) or True) and method == "search":
                break
            at = max(at + 1, *ends) if ends else at + 1
        return self.steps

    def _sequence(self, items):
        parts = [self._item(kind, value) for kind, value in items]

        def match(at, then, first=0):
            if first == len(parts):
                return then(at)
            return parts[first](at, lambda end: match(end, then, first + 1))

        return match

    def _item(self, kind, value):
        if kind in _REPEATS:
            return self._repeat(kind, *value)
        if kind is op.SUBPATTERN:
            return self._sequence(list(value[3]))
        if kind is op.ATOMIC_GROUP:
            return self._atomic(self._sequence(list(value)))
        if kind is op.BRANCH:
            ways = [self._sequence(list(way)) for way in value[1]]
            return lambda at, then: any(way(at, then) for way in ways)
        if kind is op.AT:
            return lambda at, then: self._is_at(value, at) and then(at)
        if kind in (op.ASSERT, op.ASSERT_NOT):
            return self._look(kind is op.ASSERT, *value)
        return self._one(kind, value)

    def _one(self, kind, value):
        def match(at, then):
            self.steps += 1
            if self.steps > self.most:
                raise TooManySteps
            return at < len(self.text) and self._takes(kind, value, self.text[at]) and then(at + 1)

        return match

    def _takes(self, kind, value, letter):
        cases = {letter, letter.lower(), letter.upper()} if self.ignores_case else {letter}
        if kind is op.ANY:
            return self.dot_takes_all or letter != "\n"
        if kind is op.LITERAL:
            return chr(value) in cases
        if kind is op.NOT_LITERAL:
            return chr(value) not in cases
        if kind is op.CATEGORY:
            return _CATEGORIES[value](letter)
        if kind is op.RANGE:
            return any(value[0] <= ord(one) <= value[1] for one in cases if len(one) == 1)
        assert kind is op.IN, kind
        negated = value[0][0] is op.NEGATE
        return negated != any(self._takes(*one, letter) for one in value[negated:])

    def _repeat(self, kind, least, most, items):
        inner = self._sequence(list(items))

        def match(at, then, times=0):
            def again():
                return times < most and inner(
                    at, lambda end: (end != at or times < least) and match(end, then, times + 1)
                )

            def enough():
                return times >= least and then(at)

            return enough() or again() if kind is op.MIN_REPEAT else again() or enough()

        return self._atomic(match) if kind is op.POSSESSIVE_REPEAT else match

    def _atomic(self, inner):
        def match(at, then):
            ends = []
            return inner(at, lambda end: ends.append(end) or True) and then(ends[0])

        return match

    def _look(self, wanted, direction, items):
        inner = self._sequence(list(items))
        width = items.getwidth()[0]

        def match(at, then):
            begin = at if direction > 0 else at - width
            there = begin >= 0 and bool(inner(begin, lambda end: direction > 0 or end == at))
            return there == wanted and then(at)

        return match

    def _is_at(self, where, at):
        def is_word(i):
            return 0 <= i < len(self.text) and _CATEGORIES[op.CATEGORY_WORD](self.text[i])

        if where in (op.AT_BEGINNING, op.AT_BEGINNING_STRING):
            return at == 0
        if where in (op.AT_END, op.AT_END_STRING):
            return at == len(self.text)
        assert where is op.AT_BOUNDARY, where
        return is_word(at) != is_word(at - 1)


def letters_of(items):
    """List letters that a pattern speaks of: of a class, its ends and one of each category."""
    for kind, value in items:
        if kind in (op.LITERAL, op.NOT_LITERAL):
            yield chr(value)
        elif kind is op.RANGE:
            yield from (chr(value[0]), chr(value[1]))
        elif kind is op.CATEGORY:
            yield _SAMPLES[value]
        elif kind is op.IN:
            yield from letters_of(value)
        elif kind in _REPEATS:
            yield from letters_of(value[2])
        elif kind is op.SUBPATTERN:
            yield from letters_of(value[3])
        elif kind is op.ATOMIC_GROUP:
            yield from letters_of(value)
        elif kind is op.BRANCH:
            for way in value[1]:
                yield from letters_of(way)
        elif kind in (op.ASSERT, op.ASSERT_NOT):
            yield from letters_of(value[1])


def sentence(matcher, items):
    """Write a short text that the items match, each repetition as seldom as it may be, or once."""
    return "".join(_shortest(matcher, kind, value) for kind, value in items)


def _shortest(matcher, kind, value):
    if kind in _REPEATS:
        return sentence(matcher, value[2]) * value[0]
    if kind is op.SUBPATTERN:
        return sentence(matcher, value[3])
    if kind is op.ATOMIC_GROUP:
        return sentence(matcher, value)
    if kind is op.BRANCH:
        return min((sentence(matcher, way) for way in value[1]), key=len)
    if kind in (op.AT, op.ASSERT, op.ASSERT_NOT):
        return ""
    letters = [*string.printable, *letters_of([(kind, value)])]
    return next(letter for letter in letters if matcher._takes(kind, value, letter))


def pumps(matcher, items, before=""):
    """Give every long repetition: what leads to it, and what it repeats."""
    for i, (kind, value) in enumerate(items):
        lead = before + sentence(matcher, items[:i])
        inner = []
        if kind in _REPEATS:
            inner = [value[2]]
            if value[1] is op.MAXREPEAT or value[1] > LONG:
                yield lead, sentence(matcher, value[2])
        elif kind is op.SUBPATTERN:
            inner = [value[3]]
        elif kind is op.ATOMIC_GROUP:
            inner = [value]
        elif kind is op.BRANCH:
            inner = value[1]
        for one in inner:
            yield from pumps(matcher, list(one), lead)


@contextmanager
def deep_calls():
    """Let calls be nested as deeply as texts are long."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(100_000)
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


def quadratic_text(pattern, method):
    """Find a text for which the steps grow faster than its length; None where none is found."""
    matcher = Backtracker(pattern)
    items = list(matcher.tree)
    found = list(pumps(matcher, items))
    letters = dict.fromkeys([*letters_of(items), *" \tq5.-+"])
    leads = dict.fromkeys(["", *(lead for lead, _ in found), sentence(matcher, items)])
    whole = [lead + body for lead, body in found]
    bodies = dict.fromkeys([*(body for _, body in found if body), *letters, *filter(None, whole)])
    with deep_calls():
        for lead in leads:
            for body in bodies:
                for end in ("", "\0", "\n", " \0", "5"):
                    if _grows(matcher, method, lead, body, end):
                        return f"{lead!r} + n × {body!r} + {end!r}"
        # Where a match may begin anywhere, it may begin behind another letter each time.
        pairs = product(letters, letters) if method not in ("match", "fullmatch") else ()
        for body in map("".join, pairs):
            for end in ("\0", "5"):
                if _grows(matcher, method, "", body, end):
                    return f"n × {body!r} + {end!r}"
    return None


def _grows(matcher, method, lead, body, end):
    def steps(times):
        return matcher.count(lead + body * times + end, method)

    few = 24
    try:
        if steps(few) <= 6 * (len(lead) + few * len(body)):
            return False  # half its square would be more
        return steps(256) > 8 * steps(64)
    except TooManySteps:
        return True

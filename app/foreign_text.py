"""Text that others wrote, for a sentence, a log or a terminal: short, on one line, no secrets."""

from __future__ import annotations

import re
from typing import Final

LONGEST: Final = 500
"""Of a text that somebody else wrote, where it is repeated [characters]."""

HIDDEN: Final = "***"

_SECRET: Final = re.compile(r"(?i)(password|passwd|passphrase|secret|token)=[^&\s]*")
_GAP: Final = re.compile(r"(\s+)")


def shown(text: str, longest: int = LONGEST) -> str:
    r"""Render what came from outside: cut, control characters escaped, passwords hidden.

    Controls, also C1, line separators and marks of direction are what a terminal obeys and
    nobody sees.

    >>> shown("no \x1b[31magent at http://me:s3cret@10.0.0.5:5000/probe")
    'no \\x1b[31magent at http://me:***@10.0.0.5:5000/probe'
    >>> shown("x" * 600, 3)
    'xxx… (600 characters)'
    """
    # A secret that the cut would go through is longer than any that is used.
    start = printable(without_secrets(text[: 2 * longest]))
    if len(text) <= 2 * longest and len(start) <= longest:
        return start
    return f"{start[:longest]}… ({len(text)} characters)"


def printable(text: str) -> str:
    r"""Escape what is no letter, sign or plain space.

    >>> printable("a\tb\x9b\u2028c °C")
    'a\\tb\\x9b\\u2028c °C'
    """
    if text.isprintable():
        return text
    return "".join(
        letter
        if letter.isprintable()
        else letter.encode("unicode_escape", "backslashreplace").decode()
        for letter in text
    )


def without_secrets(text: str) -> str:
    """Hide passwords: before the host of a URL, and where `password=` or the like says it.

    >>> without_secrets("postgresql://me:p/w@db/thermap?sslmode=require&password=p")
    'postgresql://me:***@db/thermap?sslmode=require&password=***'
    >>> without_secrets("mail@example.org")
    'mail@example.org'
    """
    if "@" in text:
        text = "".join(_without_login(word) for word in _GAP.split(text))
    return _SECRET.sub(rf"\1={HIDDEN}", text)


def _without_login(word: str) -> str:
    before, at, after = word.rpartition("@")
    scheme, separator, login = before.partition("://") if "://" in before else ("", "", before)
    user, colon, _ = login.partition(":")
    if not at or not colon:
        return word
    return f"{scheme}{separator}{user}:{HIDDEN}@{after}"

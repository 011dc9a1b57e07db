"""What pages say, in the reader's language; English sentences are the keys of the catalogues."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from markupsafe import Markup

from app.message import Message, Quantity
from app.pages.dashboard.numbers import number, with_readers_unit
from app.pages.languages import ENGLISH, said_in, translations
from app.pages.reader import localised, reader


def _(message: str, /, **values: object) -> str:
    """Say a message; its places are such as `%(name)s`, and a per cent sign is `%%`."""
    return said_in(reader().language, message, **values)


def counted(count: int, one: str, more: str, /, **values: object) -> str:
    """Say a message of so many things, as `%(count)s`.

    >>> counted(2, "%(count)s map", "%(count)s maps")
    '2 maps'
    """
    pattern = translations(reader().language).ngettext(one, more, count)
    return pattern % {"count": count, **values}


def said(text: str) -> str:
    """Say a sentence of the service as far as it can be said in the reader's language."""
    if isinstance(text, Quantity):
        value, unit = with_readers_unit(text.value, text.unit)
        return f"{number(value, text.digits)} {unit}"
    if not isinstance(text, Message):
        return text
    values = {
        name: said(value) if isinstance(value, str) else value
        for name, value in text.values.items()
    }
    catalogue = translations(reader().language)
    if text.more is None:
        return catalogue.gettext(text.pattern) % values
    count = text.values["count"]
    assert isinstance(count, int)
    return catalogue.ngettext(text.pattern, text.more, count) % values


def in_english(text: str) -> Markup | str:
    """Mark what is English for everybody, so that it is read out as such."""
    if reader().language == ENGLISH or not text:
        return text
    return Markup('<span lang="en">{}</span>').format(text)


def all_said(texts: Iterable[str], near: datetime) -> Markup:
    """Say sentences one after the other, as `said_near`."""
    return Markup(" ").join(said_near(text, near) for text in texts)


def said_near(text: str, near: datetime) -> Markup | str:
    """Say a sentence with the times in it as the reader's clock shows them; else as `localised`."""
    spoken = localised(said(text), near)
    return spoken if isinstance(text, Message) else in_english(spoken)

"""Languages of the pages: a catalogue each, `de.po`, keyed by the English sentence.

English needs none. A catalogue is read as it is written, when it is first needed.
"""

from __future__ import annotations

import gettext
import io
from functools import cache
from importlib.resources import files
from typing import Final

from babel import Locale
from babel.messages.catalog import Catalog
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from babel.numbers import get_decimal_symbol

ENGLISH: Final = "en"
SCRIPTS: Final = "app/pages/assets/"
"""Where messages stand that a browser's scripts write."""

_SUFFIX: Final = ".po"

LANGUAGES: Final = (
    ENGLISH,
    *sorted(
        file.name.removesuffix(_SUFFIX)
        for file in files(__name__).iterdir()
        if file.name.endswith(_SUFFIX)
    ),
)


@cache
def catalogue(language: str) -> Catalog:
    """Read a catalogue; English's is empty."""
    if language == ENGLISH:
        return Catalog(ENGLISH)
    text = (files(__name__) / f"{language}{_SUFFIX}").read_text(encoding="utf-8")
    return read_po(io.StringIO(text), locale=language)


@cache
def translations(language: str) -> gettext.NullTranslations:
    """Give a catalogue as gettext looks messages up in it."""
    if language == ENGLISH:
        return gettext.NullTranslations()
    compiled = io.BytesIO()
    write_mo(compiled, catalogue(language))
    compiled.seek(0)
    return gettext.GNUTranslations(compiled)


def said_in(language: str, message: str, /, **values: object) -> str:
    """Say a message in a language."""
    return translations(language).gettext(message) % values


@cache
def messages_of_scripts(language: str) -> dict[str, list[str]]:
    """List what scripts write: an English message and its forms, one for each plural."""
    found = {}
    for message in catalogue(language):
        if any(place.startswith(SCRIPTS) for place, _ in message.locations):
            ids = (message.id,) if isinstance(message.id, str) else message.id
            forms = (message.string,) if isinstance(message.string, str) else message.string
            found[ids[0]] = list(forms or ())
    return found


@cache
def decimal_mark(language: str) -> str:
    """Give the decimal point or comma of a language.

    >>> decimal_mark("en"), decimal_mark("de")
    ('.', ',')
    """
    return get_decimal_symbol(language)


@cache
def names() -> dict[str, str]:
    """Name each language as who speaks it does."""
    return {one: str(Locale(one).display_name) for one in LANGUAGES}

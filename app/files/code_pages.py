"""The text in a file that does not say how its letters are coded.

UTF-8 proves itself. Of the older code pages, in which spreadsheets and instruments still write,
those of Chinese and Japanese are told by the signs that they yield: nearly all of them are common
ones, and stand where a word of theirs would. What is left is Western, where letters with accents
stand alone or in pairs; longer rows of them are no text, and marked as unreadable.
"""

from __future__ import annotations

import codecs
import re
from typing import Final

UNREADABLE: Final = "\N{REPLACEMENT CHARACTER}"

_WESTERN: Final = "cp1252"
_COMMON: Final = {"gb18030": ("gb2312", 0xB0, 0xD7), "cp932": ("shift_jis", 0x88, 0x97)}
"""Code page to the one of its common signs, and the first bytes of the most frequent ones."""

_FEWEST_COMMON: Final = 0.8
_KANA: Final = range(0x3041, 0x30FF)
_IDEOGRAPHS: Final = range(0x3400, 0xA000)
_OTHERS: Final = (range(0xAC00, 0xD7B0), range(0xFF66, 0xFFA0), range(0xE000, 0xF900))
"""Hangul, narrow kana, and signs of private use."""

_NO_WORD: Final = re.compile("[\u0080-\u00ff\u0152-\u0192]{4,}")


def decoded(content: bytes) -> str:
    r"""Read a text in UTF-8 or UTF-16, or in the code page that it is most likely in.

    Letters that nobody can tell are `UNREADABLE`.

    >>> decoded("Müller, Größe".encode("cp1252")), decoded("X轴补偿前".encode("gbk"))
    ('Müller, Größe', 'X轴补偿前')
    >>> decoded("X軸補正前".encode("cp932")), decoded("Проверка".encode("cp1251"))
    ('X軸補正前', '\ufffd\ufffd\ufffd\ufffd\ufffd\ufffd\ufffd\ufffd')
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    for page in _COMMON:
        try:
            text = content.decode(page)
        except UnicodeDecodeError:
            continue
        if _is_likely(text, page):
            return text
    western = content.decode(_WESTERN, errors="replace")
    return _NO_WORD.sub(lambda row: UNREADABLE * len(row[0]), western)


def _is_likely(text: str, page: str) -> bool:
    signs = [sign for sign in text if _is_sign(sign)]
    common = [sign for sign in signs if _is_common(sign, page)]
    return len(common) >= max(_FEWEST_COMMON * len(signs), 1) and not any(
        _is_inside_a_word(*three) for three in zip(text, text[1:], text[2:], strict=False)
    )


def _is_sign(letter: str) -> bool:
    return any(ord(letter) in letters for letters in (_KANA, _IDEOGRAPHS, *_OTHERS))


def _is_inside_a_word(before: str, letter: str, after: str) -> bool:
    """Whether a sign stands alone between letters of ours, where no such language has it."""
    return (
        ord(letter) in _IDEOGRAPHS
        and before.isascii()
        and before.isalpha()
        and after.isascii()
        and after.isalpha()
    )


def _is_common(sign: str, page: str) -> bool:
    if ord(sign) in _KANA:
        return page == "cp932"
    name, first, last = _COMMON[page]
    try:
        return first <= sign.encode(name)[0] <= last
    except UnicodeEncodeError:
        return False

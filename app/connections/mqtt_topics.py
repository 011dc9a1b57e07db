"""Topics of MQTT: filters with wildcards and named levels, and what they match."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

NAMES: Final = ("machine", "sensor")
"""What a level of a topic may name."""

LONGEST: Final = 1000
"""Of a filter [bytes in UTF-8]."""

_NAMED: Final = re.compile(r"\{(.*)\}")
_SHARED: Final = "$share/"


@dataclass(frozen=True, slots=True)
class TopicPattern:
    """A filter whose levels may be `+`, `#` at the end, and `{machine}` or `{sensor}`.

    Parameters
    ----------
    group
        Of a shared subscription, `$share/GROUP/…`; empty for one's own.
    """

    group: str
    levels: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> TopicPattern:
        """Read a filter.

        Raises
        ------
        ValueError
            That says what was expected.

        Examples
        --------
        >>> TopicPattern.parse("$share/g/shop/{machine}/+/{sensor}").filter
        '$share/g/shop/+/+/+'
        """
        if len(text.encode("utf-8", "surrogatepass")) > LONGEST or "\0" in text:
            raise ValueError(f"expected a topic of at most {LONGEST} bytes, got {text!r:.80}")
        group, rest = "", text
        if text.startswith(_SHARED):
            group, _, rest = text.removeprefix(_SHARED).partition("/")
            if not group or set(group) & set("+#{}"):
                raise ValueError(f"expected $share/GROUP/TOPIC, got {text!r:.80}")
        if not rest:
            raise ValueError(f"expected a topic, got {text!r:.80}")
        parsed = cls(group, tuple(rest.split("/")))
        parsed._check(text)
        return parsed

    @property
    def filter(self) -> str:
        """What the broker is asked for."""
        joined = "/".join("+" if _NAMED.fullmatch(level) else level for level in self.levels)
        return f"{_SHARED}{self.group}/{joined}" if self.group else joined

    @property
    def names(self) -> tuple[str, ...]:
        """What its levels name."""
        return tuple(m[1] for level in self.levels if (m := _NAMED.fullmatch(level)))

    def match(self, topic: str) -> Mapping[str, str] | None:
        """Give what the levels of a topic name; None where it is another topic.

        >>> TopicPattern.parse("shop/{machine}/#").match("shop/vmc/a/b")
        {'machine': 'vmc'}
        >>> TopicPattern.parse("shop/+").match("shop/vmc/a") is None
        True
        """
        values: dict[str, str] = {}
        levels = topic.split("/")
        for i, wanted in enumerate(self.levels):
            # A wildcard in front never matches what the broker says of itself.
            if wanted in ("#", "+") and i == 0 and topic.startswith("$"):
                return None
            if wanted == "#":
                return values
            if i >= len(levels):
                return None
            named = _NAMED.fullmatch(wanted)
            if named:
                values[named[1]] = levels[i]
            elif wanted not in ("+", levels[i]):
                return None
        return values if len(levels) == len(self.levels) else None

    def _check(self, text: str) -> None:
        for i, level in enumerate(self.levels):
            named = _NAMED.fullmatch(level)
            if named and named[1] not in NAMES:
                raise ValueError(f"expected {{machine}} or {{sensor}}, got {level!r} in {text!r}")
            if not named and set(level) & set("{}"):
                raise ValueError(f"expected {{NAME}} as a whole level, got {level!r} in {text!r}")
            is_last = i == len(self.levels) - 1
            if set(level) & set("+#") and level not in ("+", "#"):
                raise ValueError(f"expected + and # as whole levels, got {level!r} in {text!r}")
            if level == "#" and not is_last:
                raise ValueError(f"expected # as the last level, got {text!r}")
        for name in NAMES:
            if self.names.count(name) > 1:
                raise ValueError(f"expected {{{name}}} once, got {text!r}")

"""Warnings of what is wrong again and again: one in a while, with how many were left out."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from time import monotonic
from typing import Final

log = logging.getLogger("thermap")

LOGGED_EVERY_S: Final = 60.0
"""After so long a warning of the same thing is logged again [s]."""


@dataclass(slots=True)
class SparingLog:
    """Logs warnings; of each thing one in `LOGGED_EVERY_S`. Things have to be few."""

    _said_s: dict[str, float] = field(default_factory=dict)
    _left_out: dict[str, int] = field(default_factory=dict)

    def warn(self, about: str, words: str) -> None:
        """Log the words, or count them where something was said of it a short while ago."""
        now_s, last_s = monotonic(), self._said_s.get(about)
        if last_s is not None and now_s - last_s < LOGGED_EVERY_S:
            self._left_out[about] = self._left_out.get(about, 0) + 1
            return
        left_out = self._left_out.pop(about, 0)
        more = f" (and {left_out} more since the last)" if left_out else ""
        log.warning("%s%s", words, more)
        self._said_s[about] = now_s

"""A file that a worker writes again and again, so that others on its computer know it lives."""

from __future__ import annotations

import json
import logging
import os
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, Final

from app.errors import InvalidContent

log = logging.getLogger("thermap")

LIVES_S: Final = 60.0
"""A worker that has not written for so long does nothing any more [s].

It looks at its queue every two seconds; a database that hangs may hold it up for half a minute.
"""


class Beat:
    """Writes that a worker lives, and when its queue answered last.

    Times are of the clock that only goes forward, which all processes of a computer share.

    Parameters
    ----------
    file
        None where nobody asks.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._answered_s: float | None = None

    def begin(self) -> None:
        """Write for the first time; InvalidContent where the file cannot be written."""
        try:
            self._write(answered=False)
        except OSError as error:
            raise InvalidContent.of_field(
                "beat_file", f"expected a file that can be written, got {self._file}: {error}"
            ) from error

    def write(self, answered: bool) -> None:
        """Write that the queue was looked at, and whether it answered.

        A disk that is full keeps no analysis from running; the check says then that nothing lives.
        """
        try:
            self._write(answered)
        except OSError as error:
            log.warning("cannot write that this worker lives: %s", error)

    def _write(self, answered: bool) -> None:
        if self._file is None:
            return
        now_s = monotonic()
        if answered:
            self._answered_s = now_s
        text = json.dumps({"beat_s": now_s, "queue_answered_s": self._answered_s})
        beside = self._file.with_name(f"{self._file.name}.{os.getpid()}")
        beside.write_text(text, encoding="utf-8")
        beside.replace(self._file)  # whoever reads finds one or the other, whole

    def end(self) -> None:
        """Write no more: a worker that ended does not live for another minute."""
        if self._file is not None:
            with suppress(OSError):
                self._file.unlink(missing_ok=True)


def check_beat(file: Path) -> tuple[bool, str]:
    """Say whether a worker lives, and in a sentence how it is.

    A worker whose database is away lives: begun anew it could do no more, and would lose what runs.
    """
    try:
        written: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        beat_s, answered_s = float(written["beat_s"]), written["queue_answered_s"]
    except FileNotFoundError:
        return False, f"no worker writes {file}"
    except (OSError, ValueError, KeyError, TypeError) as error:
        return False, f"{file} is not what a worker writes: {error}"
    ago_s = monotonic() - beat_s
    if not 0.0 <= ago_s < LIVES_S:
        # One that is ahead was written before this computer was started.
        since = f"for {ago_s:.0f} s" if ago_s > 0.0 else "since this computer was started"
        return False, f"the worker has not looked at its queue {since}"
    if answered_s is None:
        return True, "the worker lives; its database has not answered yet"
    unanswered_s = beat_s - float(answered_s)
    away = f"; its database has not answered for {unanswered_s:.0f} s" if unanswered_s else ""
    return True, f"the worker lives{away}"

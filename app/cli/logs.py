"""The service's log: lines for people, or JSON for programs that gather logs."""

from __future__ import annotations

import json
import logging
from datetime import UTC, datetime
from typing import Any, Final, Literal

from app.api.request_log import request_id
from app.foreign_text import shown

LogFormat = Literal["text", "json"]

LONGEST_MESSAGE: Final = 2000
"""Of what one line of the log says [characters]."""

LONGEST_TRACEBACK: Final = 20_000
"""Of all lines of a traceback [characters]."""

_MORE: Final = ("method", "path", "status", "duration_ms", "bytes")


def write_log_as(form: LogFormat) -> None:
    """Let everything that is logged come in one form, with the number of its request."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Json() if form == "json" else _Text())
    logging.basicConfig(handlers=[handler], force=True)


class _Text(logging.Formatter):
    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        number = request_id.get()
        return f"{super().format(record)}{f' [{number}]' if number else ''}"

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        """Write a record, whatever strangers wrote into it, as one line."""
        record.message = shown(record.message, LONGEST_MESSAGE)
        return super().formatMessage(record)

    def formatException(self, exc_info: Any) -> str:  # noqa: N802
        """Write a traceback; what an exception says of a stranger's text is escaped, too."""
        return _lines(super().formatException(exc_info))


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": shown(record.getMessage(), LONGEST_MESSAGE),
        }
        if number := request_id.get():
            line["request_id"] = number
        line |= {name: getattr(record, name) for name in _MORE if hasattr(record, name)}
        if record.exc_info:
            line["exception"] = _lines(self.formatException(record.exc_info))
        return json.dumps(line, ensure_ascii=False)


def _lines(text: str) -> str:
    return "\n".join(shown(line, LONGEST_MESSAGE) for line in text[:LONGEST_TRACEBACK].split("\n"))

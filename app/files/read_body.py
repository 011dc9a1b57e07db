"""What a file says, as it is to be sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ReadBody:
    """A request's body, not checked, the machine that the file names, and what was noticed.

    `lines` are those of a verification's observations.
    """

    body: dict[str, Any]
    machine: str | None
    remarks: Sequence[str]
    lines: Sequence[int] = ()

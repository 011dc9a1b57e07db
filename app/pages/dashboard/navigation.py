"""The pages of a machine, in the order of the bar at the top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from app.message import Message

MACHINE_PAGES: Final[tuple[tuple[str, str], ...]] = (
    ("", Message("Now")),
    ("/loop", Message("Loop")),
    ("/maps", Message("Maps and versions")),
    ("/volume", Message("Volume")),
    ("/history", Message("History")),
    ("/events", Message("Events")),
    ("/setup", Message("Set-up")),
)
"""Where each stands below `/machines/{machine}`, and its title."""


@dataclass(frozen=True, slots=True)
class Shown:
    """The machine that a page is about."""

    id: str
    name: str

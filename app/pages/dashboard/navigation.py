"""The pages of a machine, in the order of the bar at the top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from app.pages.wording import message

MACHINE_PAGES: Final[tuple[tuple[str, str], ...]] = (
    ("", message("Now")),
    ("/loop", message("Loop")),
    ("/maps", message("Maps and versions")),
    ("/volume", message("Volume")),
    ("/history", message("History")),
    ("/events", message("Events")),
    ("/setup", message("Set-up")),
)
"""Where each stands below `/machines/{machine}`, and its title."""


@dataclass(frozen=True, slots=True)
class Shown:
    """The machine that a page is about."""

    id: str
    name: str

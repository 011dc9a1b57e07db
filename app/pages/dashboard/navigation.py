"""The pages of a machine, in the order of the bar at the top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MACHINE_PAGES: Final[tuple[tuple[str, str], ...]] = (
    ("", "Now"),
    ("/loop", "Loop"),
    ("/maps", "Maps and versions"),
    ("/volume", "Volume"),
    ("/history", "History"),
    ("/events", "Events"),
    ("/setup", "Set-up"),
)
"""Where each stands below `/machines/{machine}`, and its title."""


@dataclass(frozen=True, slots=True)
class Shown:
    """The machine that a page is about."""

    id: str
    name: str

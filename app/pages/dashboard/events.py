"""The page of what happened to a machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final
from urllib.parse import urlencode

from app.events.event import Event, EventKind, Events
from app.pages.environment import render_machine
from app.pages.wording import message
from app.services.tell_receivers import Receiver
from app.status.machine_status import MachineStatus, State

KINDS: Final[Mapping[str, str]] = {
    "alarm": message("Alarms"),
    "sensor": message("Sensors"),
    "model": message("Models"),
    "verification": message("Checks"),
    "watch": message("Watch"),
    "analysis": message("Analyses"),
    "readings": message("Readings"),
    "machine": message("Settings"),
}
"""What the list may be held to, and its title."""


def events_page(
    status: MachineStatus,
    found: Events,
    receivers: Sequence[Receiver],
    now: datetime,
    kind: str = "",
    before: int | None = None,
) -> str:
    """Write the page of a machine's log.

    Parameters
    ----------
    kind
        One of `KINDS` that the list is held to; empty for all.
    before
        What the list goes on from, where it is not the newest.
    """
    only = {"kind": kind} if kind else {}
    return render_machine(
        "events",
        "/events",
        status.machine,
        status.name,
        now,
        kinds=KINDS,
        chosen=kind,
        is_newest=before is None,
        lasting=[row for row in map(event_row, found.events) if row["lasts"]],
        receivers=receivers,
        rows=[event_row(event) for event in found.events],
        older=None if found.next is None else urlencode(only | {"before": found.next}),
        csv=urlencode(only | {"limit": 10_000, "format": "csv"}),
    )


def event_row(event: Event) -> dict[str, object]:
    """Write an event as a page shows it: when, which symbol, what, who."""
    is_passing = event.kind in (EventKind.ALARM, EventKind.SENSOR)
    return {
        "id": event.id,
        "time": event.time,
        "until": event.until,
        "lasts": is_passing and event.until is None,
        "is_passing": is_passing,
        "symbol": _symbol(event),
        "text": event.text,
        "text_now": event.text_now,
        "who": event.who,
        "count": event.count,
    }


def _symbol(event: Event) -> str:
    if event.kind is EventKind.SENSOR:
        return "service"
    if event.kind is not EventKind.ALARM:
        return ""
    try:
        return str(State(event.details.get("state", "")).verdict)
    except ValueError:  # a state of another version
        return "limited"

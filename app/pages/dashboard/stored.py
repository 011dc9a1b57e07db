"""The page of one stored map or check: what was measured, drawn, and to be downloaded."""

from __future__ import annotations

from datetime import datetime
from urllib.parse import quote

from app.effects.observations import Verification
from app.pages.environment import render_machine
from app.pages.what_was_read import WhatWasRead, read_of_map, read_of_verification
from app.pages.wording import _
from app.storage.records import StoredMap
from app.thermal.machine import Machine


def stored_map_page(machine: Machine, stored: StoredMap, now: datetime, *, in_use: bool) -> str:
    """Write the page of one error map."""
    words = _("In the active version.") if in_use else _("Not in the active version.")
    read = read_of_map(stored.error_map)
    return _page(
        machine, now, "/maps", f"error-maps/{stored.id}", read, stored.error_map.label, words
    )


def stored_check_page(machine: Machine, number: int, check: Verification, now: datetime) -> str:
    """Write the page of one check, as it was measured."""
    read = read_of_verification(check)
    words = _("As it was measured; its residuals stand on the page Loop.")
    return _page(machine, now, "/loop", f"verifications/{number}", read, check.label, words)


def _page(
    machine: Machine,
    now: datetime,
    page: str,
    address: str,
    read: WhatWasRead,
    label: str,
    words: str,
) -> str:
    return render_machine(
        "stored",
        page,
        machine.id,
        machine.name,
        now,
        label=label,
        words=words,
        address=f"/v1/machines/{quote(machine.id)}/{address}",
        read=read,
    )

"""The page of a controller's files: which controller, its options, and what it cannot hold."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any

from app.controllers.format import Format
from app.controllers.registry import FORMATS, format_named
from app.pages.dashboard.navigation import Shown
from app.pages.environment import render_live
from app.status.machine_status import MachineStatus


def export_page(status: MachineStatus, controller: str | None, now: datetime) -> str:
    """Write the page on which a controller is chosen and its files are made.

    Raises
    ------
    UnknownThing
        If there is no such controller.
    """
    chosen = None if controller is None else format_named(controller)
    return render_live(
        "dashboard/export.html",
        page="/export",
        machine=Shown(status.machine, status.name),
        stream=f"/v1/machines/{status.machine}/compensation/stream",
        now=now,
        status=status,
        formats=list(FORMATS.values()),
        chosen=chosen,
        options=[] if chosen is None else _options(chosen),
    )


def _options(chosen: Format) -> list[dict[str, Any]]:
    """List what a format can be told, what has to be stated first."""
    found = []
    for name, field in chosen.options.model_fields.items():
        default = (
            None
            if field.is_required()
            else field.get_default(call_default_factory=True, validated_data={})
        )
        found.append(
            {
                "name": name,
                "about": (field.description or "").replace("`", ""),
                "is_required": field.is_required(),
                "default": "" if default is None else json.dumps(default, default=str),
            }
        )
    return sorted(found, key=lambda one: not one["is_required"])

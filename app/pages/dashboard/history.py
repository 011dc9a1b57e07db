"""The page of a machine over time; what it draws it asks `GET …/history` for."""

from __future__ import annotations

from datetime import datetime
from typing import Final

import numpy as np

from app.compensation.table import ComponentCompensation
from app.pages.environment import render_machine
from app.pages.wording import message
from app.services.dashboard import MachineView

SPANS: Final[tuple[tuple[int, str], ...]] = (
    (3600, message("1 hour")),
    (86_400, message("1 day")),
    (7 * 86_400, message("1 week")),
    (30 * 86_400, message("30 days")),
    (91 * 86_400, message("3 months")),
    (366 * 86_400, message("1 year")),
)
"""What may be chosen at once [s]."""


def history_page(view: MachineView, now: datetime) -> str:
    """Write the page: what may be chosen, and where it is drawn."""
    status = view.status
    return render_machine(
        "history",
        "/history",
        status.machine,
        status.name,
        now,
        spans=SPANS,
        sensors=[sensor.sensor for sensor in status.sensors],
        components=[_place(curve.entry) for curve in view.curves],
    )


def _place(entry: ComponentCompensation) -> tuple[str, str | None, float | None]:
    """Name a component, its axis, and the position where it is largest [mm]."""
    component = entry.component
    if not component.is_table:
        return component.code, None, None
    largest = int(np.argmax(np.abs(entry.errors)))
    return component.code, component.axis, float(entry.positions_mm[largest])

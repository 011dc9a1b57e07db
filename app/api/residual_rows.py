"""Single residuals: the first of them as objects, or all of them as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from app.csv_text import csv_line
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.identification.residuals.residuals import channel_unit
from app.services.residuals import ShownResiduals

SIGNS: Final = {1.0: "+", -1.0: "-", 0.0: "0"}


def residual_rows(residuals: ShownResiduals, most: int | None = None) -> list[dict[str, Any]]:
    """Write residuals as objects, in the order in which they were measured.

    Parameters
    ----------
    most
        At most so many; None: all.
    """
    rows, report = residuals.report.residuals.rows, residuals.report
    names = rows.channels
    units = [channel_unit(name).symbol for name in names]
    return [
        {
            "verification": residuals.verification_ids[rows.verification[i]],
            "observation": int(rows.observation[i]),
            "time": datetime.fromtimestamp(rows.times_s[i], UTC),
            "component": names[rows.channel[i]],
            "unit": units[rows.channel[i]],
            **{
                f"{axis}_mm": None if np.isnan(at) else float(at)
                for axis, at in zip("xyz", rows.points_mm[i], strict=True)
            },
            "direction": _direction(names[rows.channel[i]], rows.directions[i].tolist()),
            "measured": float(rows.measured[i]),
            "predicted": float(report.residuals.predicted[i]),
            "residual": float(report.values[i]),
        }
        for i in range(len(rows) if most is None else min(most, len(rows)))
    ]


def residuals_csv(residuals: ShownResiduals) -> str:
    """Write all residuals as CSV with a header."""
    rows = residual_rows(residuals)
    lines = [csv_line(rows[0])]
    for row in rows:
        dated = row | {"time": f"{row['time']:%Y-%m-%dT%H:%M:%S.%fZ}"}
        lines.append(csv_line(dated.values()))
    return "".join(lines)


def _direction(channel: str, directions: Sequence[float]) -> str:
    """Write the approach of a component's own axis, or of all three at a point."""
    signs = [SIGNS[d] for d in directions]
    if channel not in COMPONENTS:
        return "".join(signs)
    axis = COMPONENTS[channel].axis
    return SIGNS[0.0] if axis is None else signs[LINEAR_LETTERS.index(axis)]

"""Single residuals: the first of them as objects, or all of them as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from datetime import UTC, datetime
from typing import Final

import numpy as np

from app.answer import fields_of
from app.csv_text import csv_line
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.identification.residuals.residuals import channel_unit
from app.services.residuals import ResidualRow, ShownResiduals

SIGNS: Final = {1.0: "+", -1.0: "-", 0.0: "0"}


def residual_rows(residuals: ShownResiduals, most: int | None = None) -> list[ResidualRow]:
    """List single residuals in the order in which they were measured.

    Parameters
    ----------
    most
        At most so many; None: all.
    """
    rows, report = residuals.report.residuals.rows, residuals.report
    names = rows.channels
    units = [channel_unit(name).symbol for name in names]
    written = []
    for i in range(len(rows) if most is None else min(most, len(rows))):
        x, y, z = (None if np.isnan(at) else float(at) for at in rows.points_mm[i])
        row = ResidualRow(
            verification=residuals.verification_ids[rows.verification[i]],
            observation=int(rows.observation[i]),
            time=datetime.fromtimestamp(rows.times_s[i], UTC),
            component=names[rows.channel[i]],
            unit=units[rows.channel[i]],
            x_mm=x,
            y_mm=y,
            z_mm=z,
            direction=_direction(names[rows.channel[i]], rows.directions[i].tolist()),
            measured=float(rows.measured[i]),
            predicted=float(report.residuals.predicted[i]),
            residual=float(report.values[i]),
        )
        written.append(row)
    return written


def residuals_csv(residuals: ShownResiduals) -> str:
    """Write all residuals as CSV with a header."""
    lines = [csv_line(field.name for field in fields(ResidualRow))]
    for row in residual_rows(residuals):
        dated = fields_of(row) | {"time": f"{row.time:%Y-%m-%dT%H:%M:%S.%fZ}"}
        lines.append(csv_line(dated.values()))
    return "".join(lines)


def _direction(channel: str, directions: Sequence[float]) -> str:
    """Write the approach of a component's own axis, or of all three at a point."""
    signs = [SIGNS[d] for d in directions]
    if channel not in COMPONENTS:
        return "".join(signs)
    axis = COMPONENTS[channel].axis
    return SIGNS[0.0] if axis is None else signs[LINEAR_LETTERS.index(axis)]
